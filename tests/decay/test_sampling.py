"""Records with dropped frames, gaps, few samples per period, drift: release, first guess and coverage of the fit."""

import math

import numpy as np
import pytest

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.release import find_release
from ancf_casadi.decay.spectrum import has_even_steps, peak_frequencies, typical_step
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from problems import fit_decay
from tests.coverage import covers

F, ζ, A = 6.9, 0.01, 0.02
ω = 2 * math.pi * F


def released(time, release, kind="static"):
    """Return a beam held at A and let go, or struck, at the release; at rest before."""
    t, ω_d = np.maximum(time - release, 0.0), ω * math.sqrt(1 - ζ**2)
    cosine = np.cos(ω_d * t) + ζ / math.sqrt(1 - ζ**2) * np.sin(ω_d * t)
    return A * np.exp(-ζ * ω * t) * (cosine if kind == "static" else np.sin(ω_d * t))


def sampled(samples, periods=40.0):
    return np.arange(0.0, periods / F, 1 / (samples * F))


def kept(time, how, rng):
    if how == "dropped":
        return rng.random(len(time)) > 0.3
    keep = np.ones(len(time), dtype=bool)
    if how == "bursts":
        while keep.mean() > 0.7:
            begin = int(rng.integers(len(time)))
            keep[begin : begin + int(rng.integers(3, 12))] = False
    if how == "gap":
        begin = rng.uniform(0.3, 0.7) * time[-1]
        keep = (time < begin) | (time > begin + 4 / F)
    return keep


@pytest.mark.parametrize("how", ["whole", "dropped", "bursts", "gap"])
@pytest.mark.parametrize("samples", [5.0, 12.0, 40.0])
@pytest.mark.parametrize("kind", ["static", "struck"])
def test_the_decay_begins_at_the_first_sample_in_motion(kind, samples, how):
    """Never before the release; and soon after it, unless a burst of dropped frames near it is left out with a note."""
    rng = np.random.default_rng(1)
    for _ in range(10):
        release, time = rng.uniform(0.8, 1.1), sampled(samples)
        time = time[kept(time, how, rng)]
        y = released(time, release, kind) + 0.01 * A * rng.standard_normal(len(time))
        found = find_release(time, y)
        first = time[time > release][:5]
        assert found.index > 0
        assert time[found.index] >= release - 1e-9
        assert time[found.index] <= first[-1] + 0.05 / F or found.notes


def test_a_gap_that_hides_the_release_is_reported():
    rng, time = np.random.default_rng(2), sampled(40.0)
    time = time[(time < 0.7) | (time > 1.3)]
    fit = fit_decay(time, released(time, 1.0) + 1e-4 * rng.standard_normal(len(time)))
    assert fit.release_time == pytest.approx(1.3, abs=0.01)
    assert fit.release_reason == "the end of a gap"
    assert any(warning.startswith("a gap of 0.6") for warning in fit.warnings)


@pytest.mark.parametrize("samples", [2.6, 3.4, 5.0])
@pytest.mark.parametrize("how", ["whole", "dropped"])
def test_few_samples_per_period_are_enough(samples, how):
    rng, time = np.random.default_rng(3), sampled(samples)
    time = time[kept(time, how, rng)]
    fit = fit_decay(time, released(time, 0.9) + 0.01 * A * rng.standard_normal(len(time)))
    for name, truth in (("frequency", F), ("damping_ratio", ζ)):
        assert getattr(fit, name) == pytest.approx(truth, abs=4 * fit.standard_errors[name])
    assert any("(alias)" in warning for warning in fit.warnings) == (samples < 3.0)


@pytest.mark.parametrize("change", ["detrended", "drifting", "trimmed", "decimated"])
def test_the_frequency_is_found_in_a_record_that_was_changed(change):
    time = sampled(40.0)
    y = released(time, 0.5) + 0.3 + 1e-4 * np.random.default_rng(4).standard_normal(len(time))
    if change == "detrended":
        y = y - np.polyval(np.polyfit(time, y, 1), time)
    if change == "drifting":
        y = y + 10 * A * time / time[-1]
    if change == "trimmed":
        time, y = time[(time > 0.53) & (time < 1.0)], y[(time > 0.53) & (time < 1.0)]
    if change == "decimated":
        time, y = time[::10], y[::10]
    fit, drifting = fit_decay(time, y), fit_decay(time, y, rest="drift")
    assert fit.frequency == pytest.approx(F, rel=0.01)
    assert any("fit it too" in warning for warning in fit.warnings) == (change in ("detrended", "drifting"))
    assert drifting.frequency == pytest.approx(F, rel=2e-3)
    assert drifting.damping_ratio == pytest.approx(ζ, rel=0.1)


def test_a_step_with_a_short_decay_is_found_with_few_samples():
    """The slow part of a step is no oscillation, though a short decay fills the spectrum."""
    time = np.arange(0.0, 5.0, 0.04)
    t = np.maximum(time - 0.71, 0.0)
    y = 0.01 * (1 - np.exp(-0.055 * 48.8 * t) * np.cos(48.8 * t))
    fit = fit_decay(time, y + 2e-5 * np.random.default_rng(5).standard_normal(len(time)))
    assert fit.frequency == pytest.approx(48.8 / math.sqrt(1 - 0.055**2) / (2 * math.pi), rel=3e-3)


def test_the_spectrum_of_uneven_times_has_its_peak_at_the_frequency():
    rng = np.random.default_rng(8)
    for time in (np.sort(rng.uniform(0.0, 10.0, 300)), np.arange(0.0, 10.0, 1 / 30)[rng.random(300) > 0.3]):
        assert not has_even_steps(time)
        assert peak_frequencies(time, np.cos(2 * math.pi * 6.9 * time))[0] == pytest.approx(6.9, abs=0.02)


def test_two_short_pieces_far_apart_leave_the_frequency_ambiguous():
    time = np.concatenate([np.arange(0.0, 0.6, 0.01), np.arange(6.0, 6.6, 0.01)])
    noise = np.random.default_rng(9).standard_normal(len(time))
    y = np.exp(-0.01 * time) * np.cos(2 * math.pi * 5.0 * time)
    assert any("ambiguous" in note for note in first_guess(Measurement(time, y + 0.6 * noise)).notes)
    assert first_guess(Measurement(time, y)).ω == pytest.approx(2 * math.pi * 5.0, rel=1e-3)


def test_a_rest_position_far_from_zero_leaves_no_frequency_ambiguous():
    time = np.concatenate([start + np.arange(0.0, 1.5, 0.01) for start in (0.0, 12.0, 24.0)])
    noise = np.random.default_rng(0).standard_normal(len(time))
    y = np.exp(-0.05 * time) * np.cos(2 * math.pi * 2.0 * time) + 0.003 * noise
    for rest in (0.0, 1000.0):
        assert not first_guess(Measurement(time, rest + y)).notes


def test_a_record_of_gaps_is_refused_for_this_reason():
    time = np.concatenate([np.arange(20) * 1e-3, 1e4 + np.arange(20) * 1e-3])
    with pytest.raises(InputError, match=r"record: .*gaps for 100%"):
        first_guess(Measurement(time, np.cos(500 * time)))


@pytest.mark.parametrize(("share", "refused"), [(0.93, False), (0.97, True)])
def test_a_record_is_refused_from_a_share_of_gaps_of_95_percent_on(share, refused):
    """Its spectrum would be that of the gaps."""
    piece = np.arange(0.0, 1.0, 0.01)
    time = np.concatenate([piece, piece + 2 / (1 - share) - 1.0])
    record = Measurement(time, np.exp(-0.01 * time) * np.cos(40.0 * time))
    if refused:
        with pytest.raises(InputError, match=r"record: .*gaps for 97%"):
            first_guess(record)
    else:
        assert first_guess(record).ω == pytest.approx(40.0, rel=1e-3)


def test_the_typical_step_ignores_gaps():
    time = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(5.0, 6.0, 0.01)])
    assert typical_step(time) == pytest.approx(0.01)


@pytest.mark.slow
def test_intervals_cover_the_truth_in_records_with_dropped_frames():
    """30 % of the frames are missing."""
    rng, inside, runs = np.random.default_rng(10), [0, 0], 100
    for _ in range(runs):
        time = sampled(rng.uniform(8, 40))
        time = time[rng.random(len(time)) > 0.3]
        y = released(time, rng.uniform(0.3, 0.8), rng.choice(["static", "struck"]))
        fit = fit_decay(time, y + 0.01 * A * rng.standard_normal(len(time)))
        for k, (name, truth) in enumerate((("frequency", F), ("damping_ratio", ζ))):
            low, high = fit.intervals()[name]
            inside[k] += low <= truth <= high
    assert all(covers(hits, runs) for hits in inside)
