"""Tracks of rendered marks against their true places."""

import numpy as np
import pytest

from ancf_casadi import InputError, track_video
from ancf_casadi.records.video.marks import Pose, mark_at, refine_pose, tracked_point
from ancf_casadi.records.video.recording import SMOOTHING
from ancf_casadi.records.video.tracking import _scatter
from problems import fit_decay

WHITE = 205.0  # grey level of the strip: a bar of it hides dark marks, and nothing else


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pattern", "codec", "name"),
    [("dots", "MJPG", "a.avi"), ("checkers", "mp4v", "a.mp4"), ("texture", "MJPG", "a.avi")],
)
def test_marks_are_tracked_within_a_twentieth_of_a_pixel(strip, found, render, monkeypatch, pattern, codec, name):
    """60 degrees to either side, noise, blur by a quarter of a frame, light that fades, bars over each mark."""
    monkeypatch.setattr(render, "BLIND", WHITE)
    marks = (10, 20, 30, 40, 50, 60)
    covered = [(m, 10 + 18 * m, 22 + 18 * m + 18 * (m == 2)) for m in range(6)]
    path, true = strip(
        120, name=name, codec=codec, marks=marks, small=False, pattern=pattern, drift=-0.2, covered=covered
    )
    places, std = found(track_video(path, markers=true[0]))
    error = places - true
    lost = np.isnan(error[..., 0])
    hidden = np.zeros_like(lost)
    for mark, begin, end in covered:
        hidden[begin - 1 : end + 1, mark] = True
    assert not (lost & ~hidden).any()
    assert lost.sum() > 0.7 * sum(end - begin for _, begin, end in covered)
    assert np.sqrt(np.nanmean(error**2)) < (0.015 if pattern == "dots" else 0.03)
    assert np.nanmax(np.abs(error)) < 0.5  # of a mark that is covered in part
    ratio = np.sqrt(np.nanmean(std**2, axis=0) / np.nanmean(error**2, axis=(0, 2)))
    assert 0.5 < ratio.min() and 0.8 < np.median(ratio) < 2.5


@pytest.mark.slow
def test_the_fit_of_a_track_finds_frequency_and_damping_ratio(strip, found):
    """Those of the fit of the exact motion, which is an arc, and therefore not exactly a decay."""
    path, true = strip(240, rate=60.0, largest=0.2, marks=(30, 60))
    recording = track_video(path)
    places, _ = found(recording)
    fit, exact = (fit_decay(recording.time, track[:, 1, 0]) for track in (places, true))
    for name, tolerance, stated in (("frequency", 1e-4, 2.0), ("damping_ratio", 0.02, 0.01)):
        assert exact.estimates[name] == pytest.approx(stated, rel=1e-2)
        assert fit.estimates[name] == pytest.approx(exact.estimates[name], rel=tolerance)
        low, high = fit.intervals()[name]
        assert low <= exact.estimates[name] <= high


@pytest.mark.parametrize(("pattern", "largest"), [("dots", 0.0025), ("checkers", 0.0055), ("texture", 0.0025)])
@pytest.mark.parametrize("start", [(60.0, 60.3), (60.3, 60.0), (60.5, 60.6)])
def test_the_place_within_a_pixel_does_not_matter(render, pattern, largest, start):
    """Errors of an rms of 0.005 to 0.01 px, periodic in the pixel, come from linear interpolation."""
    cv2 = pytest.importorskip("cv2")
    still = np.array([0.0, 1.0])
    errors, mark = [], None
    for shift in np.arange(0.0, 1.0, 0.05):
        place = np.add(start, (shift, 0.0))
        line = place + np.linspace(-60.0, 60.0, 61)[:, None] * (0.0, 1.0)
        shapes = np.stack([line, line])
        picture = next(render.frames(still, shapes, [30], pattern=pattern, size=(120, 120), noise=0.0))
        smooth = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), SMOOTHING)
        mark = mark or mark_at(smooth, place, 9)
        errors.append(tracked_point(mark, refine_pose(mark, smooth, Pose(np.rint(place)))) - place)
    assert np.std(errors, axis=0).max() < largest


@pytest.mark.parametrize("rate", [240.0, 22.0])
def test_the_scatter_of_a_track_is_that_of_its_noise(rate):
    """At 2 Hz, and with 11 frames per period or more."""
    time = np.arange(400) / rate
    motion = 150.0 * np.stack([np.cos(12.6 * time), 0.3 * np.sin(25.2 * time)], axis=1)
    noise = 0.03 * np.random.default_rng(0).standard_normal(motion.shape)
    noise[100:110] = np.nan
    assert _scatter(motion + noise) == pytest.approx(0.03, rel=0.1)
    noise[::2] = np.nan  # no two frames in a row
    assert np.isnan(_scatter(motion + noise))


@pytest.mark.slow
def test_large_steps_between_frames_are_tracked(strip, found):
    """30 frames per second, and up to 43 px from frame to frame."""
    path, true = strip(30, rate=30.0, exposure=0.02, covered=[(3, 8, 14)])
    places, _ = found(track_video(path, markers=true[0]))
    assert np.nanmax(np.abs(places - true)) < 0.2
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(places[:, 3, 0])), np.arange(8, 14))


@pytest.mark.slow
def test_an_only_marker_is_not_mistaken_for_another_mark_when_it_comes_back_too_late(strip):
    path, true = strip(30, rate=30.0, exposure=0.02, covered=[(3, 8, 14)])
    with pytest.raises(InputError, match=r"no marker is seen after 0\.2333 s, as behind a cut"):
        track_video(path, markers=true[0, 3:])


@pytest.mark.slow
def test_marks_that_are_covered_together_come_back_as_themselves(strip, found):
    path, true = strip(60, covered=[(m, 20, 28) for m in range(4)])
    places, _ = found(track_video(path, markers=true[0]))
    assert np.nanmax(np.abs(places - true)) < 0.2
    assert np.isnan(places[21:27]).all() and np.isfinite(places[30:]).all()


@pytest.mark.slow
def test_dots_are_found_and_numbered_from_the_clamp(strip, found):
    """Also beside them, from a place that the user clicks: the centre of a dot is tracked."""
    path, true = strip(20)
    places, _ = found(track_video(path, clamp=(0.0, 0.0), region=(0, 0, 319, 239)))
    assert np.abs(places - true).max() < 0.2
    clicked, _ = found(track_video(path, markers=true[0] + [1.0, -0.8]))
    assert np.abs(clicked - true).max() < 0.2


@pytest.mark.slow
def test_corners_are_found_where_there_are_no_dots(strip, found):
    path, true = strip(20, pattern="checkers")
    places, _ = found(track_video(path, region=(100, 40, 300, 220)))
    nearest = np.hypot(*(places[0][:, None] - true[0][None]).transpose(2, 0, 1)).argmin(axis=1)
    assert {0, 1, 2} <= set(nearest.tolist())
    moved = np.abs((places - places[0])[:, :, 0]).max(axis=0)
    assert (moved > 5.0).any()
