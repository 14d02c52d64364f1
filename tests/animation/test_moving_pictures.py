"""Moving pictures are true to scale and to time, say how slow they are, and are written as a whole or not at all."""

import base64
import io
import re
import stat
import sys

import numpy as np
import pytest
from PIL import Image

from ancf_casadi import (
    Clamp,
    Footage,
    HarmonicBase,
    InputError,
    Model,
    Pin,
    Roller,
    Trajectory,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
)
from ancf_casadi.animation import drawing, motions
from ancf_casadi.dynamics.dense_output import MotionSamples
from ancf_casadi.support.figures import COMPUTED

GREEN = np.array([int(COMPUTED[k : k + 2], 16) for k in (1, 3, 5)])


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(4))


@pytest.fixture(scope="module")
def run(model):
    """A swing of the driven beam."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ANCF_CASADI_COMPILE", "0")
        return simulate(model, base=HarmonicBase(20e-3, 1.9), duration=0.6, sample_rate=200.0, tolerance=1e-4)


@pytest.fixture
def film(monkeypatch):
    """What the pictures would show, instead of a file."""
    seen = []
    monkeypatch.setattr(motions, "encode_pictures", lambda *_: b"")
    monkeypatch.setattr(motions, "pictures", seen.append)
    return seen


def moving(model, coordinates, rate):
    """Return a motion with given coordinates (k, 4 n + 4) at a sample rate."""
    time, force = np.arange(len(coordinates)) / rate, np.zeros((len(coordinates), 4))
    source = MotionSamples(time, np.array([coordinates, 0 * coordinates]), force, force[:, 1:], force[:, 1:])
    return Trajectory(model, time, source, 0, 0.0, ())


def frames(path):
    """Return the pictures of a GIF file, (k, rows, columns, 3), and how long each is shown, s."""
    with Image.open(path) as file:
        shown = []
        for k in range(file.n_frames):
            file.seek(k)
            shown.append((np.asarray(file.convert("RGB")).astype(int), file.info["duration"] / 1e3))
    return np.array([picture for picture, _ in shown]), [seconds for _, seconds in shown]


def inked(picture, colour=GREEN):
    """Return columns and rows, (m, 2), of the pixels in the full colour of a line, and how far they reach."""
    rows, columns = np.nonzero(np.abs(picture - colour).max(axis=-1) < 40)
    return np.column_stack([columns, rows])


@pytest.mark.slow
def test_a_circle_is_as_high_as_wide(paper_beam, tmp_path):
    """As the end moment 2 pi E I / L bends a beam without weight."""
    angle, radius = np.linspace(0.0, 2 * np.pi, 21), 0.5 / (2 * np.pi)
    nodes = [radius * np.sin(angle), radius * (1 - np.cos(angle)), np.cos(angle), np.sin(angle)]
    model = Model(paper_beam(20).with_(axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    run = moving(model, np.tile(np.column_stack(nodes).ravel(), (3, 1)), 25.0)
    run.animate(tmp_path / "circle.gif", slower=1.0, points=())
    width, height = np.ptp(inked(frames(tmp_path / "circle.gif")[0][0]), axis=0)
    assert width == pytest.approx(height, abs=1) and width > 300


@pytest.mark.slow
def test_the_tip_is_where_it_was_computed(run, tmp_path):
    """The straight beam of the first picture gives the origin and the scale of the others."""
    run.animate(tmp_path / "swing.gif", slower=1.0, points=())
    pictures, _ = frames(tmp_path / "swing.gif")
    straight = inked(pictures[0])
    (left, top), (right, bottom) = straight.min(axis=0), straight.max(axis=0)
    scale, origin = (bottom - top - 1) / 0.5, np.array([(left + right) / 2, top + 0.5])
    for k in (5, 9, 14):
        tip, before = run.tip[8 * k], run.position(0.48)[8 * k]
        expected = origin + scale * tip * [1, -1]
        onwards = (tip - before) * [1, -1] / np.linalg.norm(tip - before)
        line = inked(pictures[k])
        reached = line[(line @ onwards).argmax()]
        assert np.linalg.norm(reached - expected) < 2.5, k  # pixels; the beam is 2.8 pixels wide
    swing = np.ptp(run.tip[::8, 0]) * scale
    assert swing > 50 and run.tip[8 * 14, 0] != pytest.approx(run.tip[8 * 13, 0], abs=3 / scale)


@pytest.mark.slow
def test_a_file_has_the_pictures_and_the_duration_that_slow_motion_needs(run, tmp_path):
    run.animate(tmp_path / "swing.gif", slower=4.0, begin=0.2, end=0.3)
    pictures, seconds = frames(tmp_path / "swing.gif")
    assert len(pictures) == 11 and seconds == pytest.approx([0.04] * 11)
    run.animate(tmp_path / "swing.gif", slower=1.0, frame_rate=10.0)
    assert frames(tmp_path / "swing.gif")[1] == pytest.approx([0.1] * 7)


@pytest.mark.parametrize(("slower", "says"), [(1.0, "in real time"), (10.0, "10 times slower"),
                                              (0.25, "4 times faster"), (None, "5 times slower")])  # fmt: skip
def test_the_pictures_say_how_slow_they_are(run, film, slower, says):
    """By default they last two seconds at least."""
    motions.moving_pictures({"": run}, "x.gif", slower=slower)
    assert film[0].clock[0].endswith(f"s, {says}")


@pytest.mark.parametrize(("frequency", "slower"), [(1.0, 1.0), (2.05, 1.0), (2.1, 2.0), (40.0, 20.0), (90.0, 50.0)])
def test_a_period_has_twelve_pictures_by_default(model, film, frequency, slower):
    """25 pictures per second show 2.083 Hz in real time."""
    time = np.arange(0.0, 10.0, 1e-3)
    swing = np.tile(model.straight, (len(time), 1))
    swing[:, -4] += 0.1 * np.sin(2 * np.pi * frequency * time)
    end = 10.0 if frequency < 10.0 else 2.0
    motions.moving_pictures({"": moving(model, swing, 1e3)}, "x.gif", end=end)
    step = float(re.match(r"\s*([\d.]+)", film[0].clock[1])[1])
    assert step == pytest.approx(0.04 / slower, abs=1e-9)


def test_a_beam_is_shown_while_its_run_lasts_and_its_tip_leaves_a_trace(run, model, film):
    short = moving(model, run.coordinates[:41], 200.0)  # 0.2 s
    motions.moving_pictures({"a": run, "b": short}, "x.gif", slower=2.0, begin=0.1)
    (_, beams), *more = film[0].panels
    assert not more and len(film[0].clock) == 26
    assert beams["a"].positions[:, -1] == pytest.approx(run.tip[20:121:4], abs=1e-9)
    assert np.isfinite(beams["b"].positions[:6]).all() and np.isnan(beams["b"].positions[6:]).all()
    (trail,) = beams["a"].trails
    assert trail[10, 0] == pytest.approx(run.tip[60]) and trail[10, -1] == pytest.approx(run.tip[20])  # since begin
    assert trail[-1, -51] == pytest.approx(run.tip[70])  # 0.25 s before
    motions.moving_pictures({"a": run, "b": short}, "x.gif", slower=2.0, beside=True)
    assert [title for title, _ in film[1].panels] == ["a", "b"]


def test_markers_are_shown_where_and_while_they_were_measured(run, film):
    time = run.time[20:81] + 1e-3
    seen = np.stack([run.position(0.25)[20:81], run.tip[20:81]], axis=1)
    seen[10:20, 0] = np.nan
    motions.moving_pictures({"": run}, "x.gif", slower=2.0, markers=(time, seen))
    found = film[0].markers  # at 0, 0.02, ...
    assert found.shape == (31, 2, 2)
    assert np.isnan(found[:6]).all() and np.isnan(found[21:]).all() and np.isfinite(found[6:21, 1]).all()
    assert np.isnan(found[8:10, 0]).all() and np.isfinite(found[11:21, 0]).all()
    assert found[11, 1] == pytest.approx([np.interp(0.22 - 1e-3, run.time, x) for x in run.tip.T])


def test_supports_move_and_turn_with_the_base(paper_beam, film):
    """But a roller keeps its direction; a clamp also has its own rotation."""
    supports = (Pin(0.0), Roller(0.25), Clamp(0.5, rotation=0.2))
    beam = paper_beam(2).with_(axis=(1.0, 0.0), supports=supports)
    nodes = np.tile(Model(beam).straight, (3, 1)).reshape(3, -1, 4)
    angle = np.array([0.0, 0.3, 0.6])
    nodes[:, 0] = np.column_stack([0.1 * angle, 0 * angle, np.cos(angle), np.sin(angle)])
    nodes[:, 1, 0] += 0.1 * angle
    motions.moving_pictures({"": moving(Model(beam), nodes.reshape(3, -1), 25.0)}, "x.gif", slower=1.0)
    moves = []
    figure = drawing._draw(film[0], moves)
    pin, roller, clamp = (
        line for line in figure.axes[0].lines if line.get_linestyle() == "None" and line.get_zorder() == 3
    )
    for k in (0, 2):
        for _, move in moves:
            move(k)
        assert pin.get_xdata() == pytest.approx([100 * angle[k]])
        directions = [mark._marker.get_user_transform().transform_affine((1.0, 0.0)) for mark in (pin, roller, clamp)]
        turned = [np.arctan2(y, x) for x, y in directions]
        assert turned == pytest.approx([angle[k], 0.0, np.pi / 2 + angle[k] + 0.2])
    assert roller.get_xdata() == pytest.approx([250.0])


def test_a_periodic_motion_is_repeated_without_a_jump(model, film, tmp_path):
    """The picture after the last is the first; the text allows for their whole number."""
    reduced = reduce_model(model, modes=1)
    steady = periodic_motion(reduced, base=HarmonicBase(20e-3, 1.5))
    steady.animate(tmp_path / "steady.gif")
    (_, beams), *_ = film[0].panels
    count, tip = len(film[0].clock), beams[""].positions[:, -1]
    assert 0.04 * count >= 2.0 and f"{0.04 * count * 1.5:.3g} times slower" in film[0].clock[0]
    expected = steady.trajectory(4 * count).tip[:-1:4]
    assert tip == pytest.approx(expected, abs=2e-4 * 0.5)
    assert beams[""].trails[0][0] == pytest.approx(beams[""].trails[0][-1])  # the whole path


def test_modes_swing_about_the_equilibrium_and_say_how_they_are_exaggerated(model, film, tmp_path):
    modes = natural_modes(model, count=3)
    modes.animate(tmp_path / "modes.gif", modes=(1, 3))
    slow = [f"{2 * frequency:.3g} times slower" for frequency in modes.frequencies[[0, 2]]]
    assert [title.split("\n")[1] for title, _ in film[0].panels] == slow
    assert film[0].panels[1][0].startswith(f"mode 3: {modes.frequencies[2]:.4g} Hz")
    assert set(film[0].clock) == {"exaggerated to 15 % of the length"} and len(film[0].clock) == 50
    for _, beams in film[0].panels:
        swing = beams[""].positions - beams[""].positions[0]
        assert np.linalg.norm(swing, axis=-1).max() == pytest.approx(0.15 * 0.5, rel=5e-3)


@pytest.mark.slow
def test_computed_motion_lies_on_the_pictures_of_a_video(run, model, tmp_path):
    """Each picture is drawn at the time of that of the video, whose camera is turned."""
    time, turn = np.arange(0.0, 0.6, 0.07), 0.1
    images = np.full((len(time), 300, 400), 180, dtype=np.uint8)
    footage = Footage(time, images, scale=2e-3, origin=(200.0, 20.0), rotation=turn)
    assert footage.pixels((0.1, -0.4)) == pytest.approx(
        [200 + 50 * np.cos(turn) + 200 * np.sin(turn), 20 - 50 * np.sin(turn) + 200 * np.cos(turn)]
    )
    run.animate(tmp_path / "video.gif", slower=1.0, points=(), background=footage)
    pictures, seconds = frames(tmp_path / "video.gif")
    assert pictures.shape[1:] == (300, 400, 3) and np.abs(pictures[0, 150, 20] - 180).max() <= 6
    assert len(pictures) == len(time) and sum(seconds) == pytest.approx(0.6)  # GIF files join pictures that are alike
    for k, instant in enumerate(time):
        tip = footage.pixels([np.interp(instant, run.time, one) for one in run.tip.T])
        before = footage.pixels([np.interp(instant, run.time, one) for one in run.position(0.48).T])
        line = inked(pictures[k])
        assert np.linalg.norm(line[(line @ (tip - before)).argmax()] - tip) < 2.5, k


@pytest.mark.slow
def test_a_page_holds_the_pictures_of_the_gif_and_loads_nothing(run, tmp_path):
    for suffix in ("gif", "html"):
        run.animate(tmp_path / f"swing.{suffix}", slower=1.0)
    page = (tmp_path / "swing.html").read_text()
    assert "http" not in page
    texts = re.findall(r'"(iVBOR[^"]+)"', page)
    pictures, _ = frames(tmp_path / "swing.gif")
    assert len(texts) == len(pictures) == 16
    layers = [Image.open(io.BytesIO(base64.b64decode(text))).convert("RGBA") for text in texts]
    for picture, layer in zip(pictures, layers, strict=True):
        assert (np.asarray(Image.alpha_composite(layers[0], layer))[..., :3] == picture).all()
    assert all((np.asarray(layer)[..., 3] == 0).mean() > 0.95 for layer in layers[1:])


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """A stand-in for ffmpeg, which writes what it is given."""

    def write(script):
        path = tmp_path / "ffmpeg"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setitem(motions.rcParams, "animation.ffmpeg_path", str(path))

    return write


def test_ffmpeg_gets_all_pictures(run, tmp_path, ffmpeg):
    ffmpeg('for last; do :; done; echo "$@" > "$last"; cat >> "$last"')
    run.animate(tmp_path / "swing.mp4", slower=1.0)
    options, _, raw = (tmp_path / "swing.mp4").read_bytes().partition(b"\n")
    width, height = (int(one) for one in re.search(rb"-s (\d+)x(\d+) -r 25.0", options).groups())
    assert len(raw) == 16 * 3 * width * height and width % 2 == height % 2 == 0


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ('for last; do :; done; echo part > "$last"; echo no codec >&2; exit 1', "ffmpeg failed: no codec"),
        ("", "ffmpeg failed: no message"),
    ],
)
def test_a_failure_of_ffmpeg_is_one_line_and_leaves_no_file(run, tmp_path, ffmpeg, script, message):
    ffmpeg(script)
    with pytest.raises(InputError, match=message):
        run.animate(tmp_path / "swing.mp4", slower=1.0)
    assert not (tmp_path / "swing.mp4").exists()


def test_without_ffmpeg_a_line_says_what_to_do(run, tmp_path, monkeypatch):
    monkeypatch.setitem(motions.rcParams, "animation.ffmpeg_path", "no-such-program")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InputError, match=r"needs ffmpeg, or the package imageio-ffmpeg; or write \.gif or \.html"):
        run.animate(tmp_path / "swing.mp4")


@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        ("swing.avi", {}, r"swing\.avi: must end in \.gif, \.mp4 or \.html"),
        (".", {}, "is a folder"),
        ("a.gif", {"slower": 1e5}, "slower: 100000 makes 1.5e.06 pictures, not 2 to 3000"),
        ("a.gif", {"frame_rate": 200.0}, "frame_rate: must be from 1 to 50 pictures per second, got 200"),
        ("a.gif", {"begin": 0.4, "end": 0.2}, "begin: must be before the end, within 0 to 0.6 s"),
        ("a.gif", {"points": [0.6]}, "0.6"),
        ("a.gif", {"markers": ([0.0, 0.1], [[0.0, 0.0]])}, "markers: have shapes"),
        ("a.gif", {"markers": ([0.1, 0.0], np.zeros((2, 2)))}, "markers: must have times that increase"),
        ("a.gif", {"background": "video.mp4"}, "background: must be a Footage, got 'video.mp4'"),
    ],
)
def test_what_cannot_be_shown_is_refused_before_a_file_is_written(run, tmp_path, path, options, message):
    with pytest.raises(InputError, match=message):
        run.animate(tmp_path / path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": np.zeros((2, 8, 8))}, "images: picture 0 is no array of bytes"),
        ({"images": np.zeros((3, 8, 8), np.uint8)}, "images: must be a sequence of 2 pictures"),
        ({"images": {0: 1, 1: 2}}, "images: must be a sequence of 2 pictures"),
        ({"time": [0.1, 0.1]}, "time: must be numbers that increase"),
        ({"scale": 0.0}, "scale: must be positive"),
    ],
)
def test_pictures_that_are_none_are_refused(change, message):
    valid = {"time": [0.0, 0.1], "images": np.zeros((2, 8, 8), np.uint8), "scale": 1e-3, "origin": (0.0, 0.0)}
    with pytest.raises(InputError, match=message):
        Footage(**valid | change)
