"""Long records: fits that use fewer samples give the estimates and the errors of fits that use all."""

import math

import numpy as np
import pytest

from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import project_on_cosines
from problems.decay.fitting import fit_decay, fit_decays

NAMES = ("frequency", "damping_ratio", "amplitude", "offset")


def hammer(seed=0, samples=12000, rate=2400.0, amplitude=0.01):
    """A mode of 22 Hz beside one of 138 Hz, in slightly coloured noise, rounded to 20 um."""
    rng, t, ω = np.random.default_rng(seed), np.arange(samples) / rate, 2 * math.pi * 22.0
    white = 1e-4 * rng.standard_normal(samples + 1)
    y = amplitude * np.exp(-0.004 * ω * t) * np.cos(ω * t - 1.0) + white[1:] + 0.3 * white[:-1]
    y += 0.1 * amplitude * np.exp(-0.003 * 6.27 * ω * t) * np.sin(6.27 * ω * t + 0.5)
    return Measurement(t + 3.0, 2e-5 * np.round(y / 2e-5))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["linear", "quadratic"])
def test_fewer_samples_give_the_estimates_and_errors_of_all(law):
    """A record without its last sample but one has uneven times, so that a fit uses all others."""
    record = hammer()
    fewer = fit_decay(record, law=law)
    every = fit_decay(np.delete(record.time, -2), np.delete(record.values, -2), law=law)
    assert (fewer.fitted_samples, every.fitted_samples) == (2500, 11999)
    assert fewer.samples == len(fewer.residuals) == 12000
    assert "fitted as 2500 samples at 500" in fewer.report()
    assert "fitted as" not in every.report()
    for name in NAMES:
        error = every.standard_errors[name]
        assert getattr(fewer, name) == pytest.approx(getattr(every, name), abs=0.01 * error)
        assert fewer.standard_errors[name] == pytest.approx(error, rel=0.1)
    assert fewer.residual_rms == pytest.approx(every.residual_rms, rel=1e-3)
    assert (
        (fewer.release_time, fewer.release_reason)
        == (every.release_time, every.release_reason)
        == (3.0, "the first sample")
    )


def test_a_mode_that_needs_all_samples_gets_them():
    """Of 8000 samples, 2500 are enough at 40 per period; at 10 per period, half of them would not be."""
    time = np.arange(8000) / 800.0
    slow, fast = (
        fit_decay(time, np.exp(-0.5 * time) * np.cos(2 * math.pi * f * time)).fitted_samples for f in (20.0, 80.0)
    )
    assert (slow, fast) == (2500, 8000)


@pytest.mark.slow
def test_short_uneven_and_robust_fits_use_all_samples():
    record = hammer()
    short = record.cut(3.0, 3.0 + 4999.5 / 2400.0)
    gap = Measurement(np.delete(record.time, slice(4000, 4100)), np.delete(record.values, slice(4000, 4100)))
    for fit in (fit_decay(short), fit_decay(gap), fit_decay(record, robust=True)):
        assert fit.fitted_samples == fit.samples


@pytest.mark.slow
def test_takes_keep_the_weights_of_their_samples():
    """Samples of takes of different length become fewer by the same ratio, as their noise is taken as equal."""
    takes = fit_decays([hammer(1), hammer(2, samples=6000)])
    assert [fit.fitted_samples for fit in takes] == [5000, 2500]
    assert [fit.samples for fit in takes] == [12000, 6000]


def test_a_projection_keeps_white_noise_and_slow_curves():
    """Its rows are orthogonal, and slow cosines keep their values at the new times."""
    whole, count = 600, 60
    rows = project_on_cosines(np.eye(whole)[0], count)
    every = np.array([project_on_cosines(column, count) for column in np.eye(whole)]).T
    np.testing.assert_allclose(every @ every.T, count / whole * np.eye(count), atol=1e-12)
    np.testing.assert_allclose(every[:, 0], rows)
    middle = (np.arange(whole) + 0.5) / whole, (np.arange(count) + 0.5) / count
    fine, coarse = (np.cos(7 * math.pi * t) + 2.0 for t in middle)
    np.testing.assert_allclose(project_on_cosines(fine, count), coarse, atol=1e-12)
