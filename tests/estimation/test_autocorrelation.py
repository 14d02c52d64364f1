"""Effective number of independent residuals: white and autoregressive noise, oscillations, several series."""

import math

import numpy as np
import pytest

from ancf_casadi.estimation.autocorrelation import autocorrelation, effective_samples


def autoregressive(seed, rho, size=2500):
    """Return noise of order 1 whose successive values correlate at rho."""
    noise = np.random.default_rng(seed).standard_normal(size + 500)
    for k in range(1, len(noise)):
        noise[k] += rho * noise[k - 1]
    return noise[500:]


def test_the_autocorrelation_is_the_sum_of_the_products():
    r = np.random.default_rng(1).standard_normal(57)
    expected = [r[: 57 - k] @ r[k:] / (r @ r) for k in range(57)]
    np.testing.assert_allclose(autocorrelation(r), expected, atol=1e-14)


def test_products_run_within_a_series_only():
    first, second = np.random.default_rng(2).standard_normal((2, 40))
    both = autocorrelation(np.concatenate([first, second[:30]]), (40, 30))
    expected = (first[:-7] @ first[7:] + second[:23] @ second[7:30]) / (first @ first + second[:30] @ second[:30])
    assert both[7] == pytest.approx(expected)
    assert len(both) == 40


@pytest.mark.parametrize("size", [60, 300, 2500])
def test_white_residuals_count_in_full(size):
    """Except for a few percent of the short records, where a correlation is significant by chance."""
    worth = np.array([effective_samples(autoregressive(seed, 0.0, size)) for seed in range(200)]) / size
    assert np.mean(worth == 1.0) >= 0.96
    assert worth.mean() > 0.98


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9, -0.5])
def test_autoregressive_residuals_count_as_theory_says(rho):
    """In the median of 100 records, at most 15 % above theory: the sum omits the insignificant tail."""
    worth = np.median([effective_samples(autoregressive(seed, rho)) for seed in range(100)])
    expected = 2500 * (1 - abs(rho)) / (1 + abs(rho))
    assert 0.95 < worth / expected < 1.15


def test_residuals_that_swing_are_hardly_worth_anything():
    """The residuals are one wave; its correlations would cancel in a sum with signs."""
    swing = np.cos(2 * math.pi * 0.01 * np.arange(2500))
    assert 1.0 < effective_samples(swing) < 3.0
    assert abs(1 + 2 * autocorrelation(swing)[1:].sum()) < 0.1


def test_several_series_count_together():
    parts = [autoregressive(seed, 0.6) for seed in (5, 6)]
    together = effective_samples(np.concatenate(parts), (2500, 2500))
    assert together == pytest.approx(sum(map(effective_samples, parts)), rel=0.1)
    assert effective_samples(np.zeros(10)) == 10.0
    assert np.isnan(autocorrelation(np.zeros(3))).all()
