"""Scale, time, and faults of videos."""

import sys

import numpy as np
import pytest

from ancf_casadi import Footage, InputError, read_recording, track_video
from ancf_casadi.records.video.recording import _time
from ancf_casadi.records.video.view import View
from problems.cli import main


def test_a_ruler_the_clamp_and_a_vertical_line_give_metres_in_the_laboratory_frame():
    """A picture that is turned by 0.1 rad, with 0.5 mm per pixel."""
    c, s = np.cos(0.1), np.sin(0.1)
    right, down = np.array([c, s]), np.array([-s, c])
    clamp, true = np.array([300.0, 50.0]), np.array([[0.03, -0.1], [-0.02, 0.04]])
    points = clamp + (true[:, :1] * right - true[:, 1:] * down) / 0.5e-3
    line = (*(clamp + 7.0), *(clamp + 7.0 + 90.0 * down))
    ruler = (10.0, 20.0, 10.0 + 120.0, 20.0 + 160.0, 0.1)
    for vertical in (line, (*line[2:], *line[:2])):
        positions, scale = View.of(ruler=ruler, clamp=clamp.tolist(), vertical=vertical).positions(None, points)
        np.testing.assert_allclose(positions, true, atol=1e-12)
        assert scale == pytest.approx(0.5e-3)


def test_distortion_of_the_lens_is_taken_out():
    cv2 = pytest.importorskip("cv2")
    focal, centre, distortion = 600.0, (320.0, 240.0), (-0.2, 0.05, 1e-3, -5e-4)
    straight = np.array([[100.0, 100.0], [500.0, 80.0], [320.0, 400.0]])
    rays = np.column_stack([(straight - centre) / focal, np.ones(3)])
    camera = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera, np.array(distortion))[0].reshape(-1, 2)
    assert np.abs(seen - straight).max() > 5.0
    gap = np.vstack([seen, [[np.nan, np.nan]]])
    positions, _ = View.of(lens=(focal, focal, *centre, *distortion)).positions(cv2, gap)
    np.testing.assert_allclose(positions[:3] * [1, -1], straight, atol=2e-3)
    assert np.isnan(positions[3]).all()


def test_footage_shows_the_tracks_where_they_were_seen(strip):
    path, true = strip(13)
    view = {"ruler": (10.0, 10.0, 310.0, 50.0, 0.3), "clamp": (160.0, 12.0), "vertical": (150.0, 12.0, 160.0, 200.0)}
    recording = track_video(path, markers=true[0], **view)
    footage = Footage.from_video(path, **view, begin=1.5 / 240, every=3)
    np.testing.assert_allclose(footage.time, [2 / 240, 5 / 240, 8 / 240, 11 / 240])
    positions = np.stack([[recording.channel(f"{axis}{k}_m").values for axis in "xy"] for k in (1, 2, 3, 4)])
    seen = footage.pixels(np.moveaxis(positions, 2, 0)[2::3])
    assert np.abs(seen - true[2::3]).max() < 0.2  # px
    for rate in (1000.0, 3000.0):  # the time of a frame is rounded
        for k in (3, 7, 11):
            assert Footage.from_video(path, sample_rate=rate, begin=k / rate, end=12 / rate).time[0] == pytest.approx(
                k / rate
            )
            assert Footage.from_video(path, sample_rate=rate, end=k / rate).time[-1] == pytest.approx(k / rate)
    with pytest.raises(InputError, match="ends before 1 s"):
        Footage.from_video(path, begin=1.0)


@pytest.mark.parametrize("rate", [None, 240.0])
def test_uneven_times_are_told_whatever_the_rate(strip, monkeypatch, rate):
    path, true = strip(12)
    monkeypatch.setattr("ancf_casadi.records.video.recording._time", lambda stamps, _: (stamps, "uneven"))
    assert track_video(path, markers=true[0], sample_rate=rate).notes[0].startswith("uneven")


@pytest.mark.slow
def test_slow_motion_is_told_and_its_true_rate_is_taken(strip):
    path, true = strip(20, rate=30.0, exposure=0.02)
    recording = track_video(path, markers=true[0])
    np.testing.assert_allclose(recording.time, np.arange(20) / 30.0)
    assert "if it plays in slow motion, give the rate of the recording" in recording.notes[0]
    fast = track_video(path, markers=true[2], sample_rate=240.0, begin=2 / 240, end=15.1 / 240)
    np.testing.assert_allclose(fast.time, np.arange(2, 16) / 240)
    assert not fast.notes


def test_times_of_the_file_are_taken_where_frames_are_missing_but_not_where_they_are_rounded():
    even = np.arange(100) / 240.0
    times, note = _time(np.round(even, 3), 240.0)
    np.testing.assert_allclose(times, even)
    assert note.startswith("times from the frame rate of the file, 240 1/s")
    missing = np.delete(even, 50)
    times, note = _time(missing, 240.0)
    np.testing.assert_array_equal(times, missing)
    assert "not even" in note


@pytest.mark.parametrize("rate", [240.0, 2000.0, 10_000.0])
def test_one_missing_frame_makes_the_times_uneven_at_any_rate(rate):
    stamps = np.delete(np.arange(100) / rate, 50)
    np.testing.assert_array_equal(_time(stamps, rate)[0], stamps)


@pytest.mark.slow
def test_the_command_writes_a_file_that_inspect_and_fits_read(strip, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, true = strip(20, covered=[(1, 8, 12)])
    scale = ["--ruler", "0,0,100,0,0.05", "--clamp", "160,12"]
    assert main(["track", path.name, *scale, "--out", "a.csv", "--preview", "a.png"]) == 0
    assert "Next: ancf-casadi inspect a.csv" in capsys.readouterr().out
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    recording = read_recording("a.csv")
    assert [channel.name for channel in recording.channels[:4]] == ["x1_m", "y1_m", "std1_m", "x2_m"]
    assert {channel.unit.quantity for channel in recording.channels} == {"length"}
    np.testing.assert_allclose(recording.time, np.arange(20) / 240.0)
    np.testing.assert_allclose(recording.channel("y4_m").values, 0.5e-3 * (12 - true[:, 3, 1]), atol=1e-4)
    assert np.isnan(recording.channel("x2_m").values[8:12]).sum() >= 3
    assert main(["inspect", "a.csv", "--column", "x4_m"]) == 0


def still(render, path, grey):
    picture = np.full((120, 160), grey, np.uint8)
    if grey:
        picture[40:44, 60:64] = picture[80:83, 100:103] = 0
    noise = np.random.default_rng(0).integers(0, 5, (20, 120, 160)).astype(np.uint8)
    render.write_video(path, [picture + (one if grey else 0) for one in noise], 30.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("still", "nothing moves: no marker by more than 0"),
        ("black", "no marks are found in the first frame"),
        ("short", "has 4 frames; needs at least 10"),
        ("cut", r"no marker is seen after 0\.1208 s, as behind a cut"),
        ("truncated", r"breaks off after \d+ of 40 frames; give --end 0\."),
        ("header", "is no video that can be read, or is damaged"),
        ("text", "is no video that can be read, or is damaged"),
        ("playlist", "is no video that can be read, or is damaged"),
        ("empty", "is empty"),
        ("folder", "cannot be read"),
    ],
)
def test_a_faulty_video_ends_in_one_line(strip, render, tmp_path, capfd, fault, message):
    path, _ = strip(4 if fault == "short" else 40)
    other = tmp_path / "other.avi"
    content = path.read_bytes()
    if fault in ("still", "black"):
        still(render, other, 200 if fault == "still" else 0)
    elif fault == "cut":
        pictures = [frame for _, frame in frames_of(path)][:30]
        noise = np.random.default_rng(0).integers(60, 80, (10, 240, 320)).astype(np.uint8)
        render.write_video(other, [*pictures, *noise], 240.0)
    elif fault == "folder":
        other.mkdir()
    elif fault != "short":
        other.write_bytes({
            "truncated": content[: len(content) // 2], "header": content[:150], "text": b"t,x\n0,1\n",
            "playlist": f"#EXTM3U\n#EXTINF:1,\n{path}\n".encode(), "empty": b"",
        }[fault])  # fmt: skip
    assert main(["track", str(other if fault != "short" else path)]) == 2
    out, err = capfd.readouterr()
    assert not out and err.count("\n") == 1
    with pytest.raises(InputError, match=message):
        track_video(other if fault != "short" else path)


def frames_of(path):
    from ancf_casadi.records.video.frames import open_video

    with open_video(path) as video:
        yield from video.frames


@pytest.mark.slow
def test_damaged_bytes_anywhere_end_in_a_track_or_in_one_line(strip):
    path, true = strip(30)
    content = path.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(4):
        damaged = bytearray(content)
        for place in rng.integers(0, len(content), 30):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            assert len(track_video(path, markers=true[0]).channels) == 12
        except InputError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"markers": [1.0, 2.0]}, "^markers: must have the shape"),
        ({"markers": [[60.0, 200.0]], "radius": 5}, "marker 1 at .60, 200.: there is no dot, corner or texture"),
        ({"markers": [[159.4, 81.9]], "radius": 5}, "there is no dot, corner or texture"),  # an edge of the strip
        ({"markers": [[2.0, 2.0]]}, "or the picture ends there"),
        ({"region": (5, 5, 1, 9)}, "^region: must be left, top, right and bottom"),
        ({"ruler": (0, 0, 1, 1)}, "^ruler: must be 5 numbers, got 4"),
        ({"vertical": (3, 3, 3, 3)}, "^vertical: its two points must differ"),
        ({"begin": 9.0}, "ends before 9 s"),
        ({"begin": 0.2, "end": 0.1}, "end: must be after begin"),
    ],
)
def test_a_wrong_argument_is_named(strip, arguments, message):
    path, _ = strip(12, noise=0.0)
    with pytest.raises(InputError, match=message):
        track_video(path, **arguments)


def test_without_opencv_one_line_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"^cv2: is not installed, but video files need it"):
        track_video(tmp_path / "a.avi")
