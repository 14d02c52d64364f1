"""The colour of residuals: white and autoregressive noise, gaps, lines, interpolation, and several series."""

import math

import casadi as cs
import numpy as np
import pytest
import scipy

from ancf_casadi.estimation.fit import quantile
from ancf_casadi.estimation.noise.autoregression import first_correlation
from ancf_casadi.estimation.noise.series import autocorrelation, concentration, series_grids
from ancf_casadi.estimation.noise.spectrum import estimated_noise
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from tests.coverage import covers

SAMPLES = 2000
ANGLE = 2 * math.pi * 0.01 * np.arange(SAMPLES)


def autoregressive(rng, rho, size=SAMPLES):
    """Return noise of order 1 and variance 1 whose successive values correlate at rho."""
    noise = rng.standard_normal(size + 500)
    for k in range(1, len(noise)):
        noise[k] = rho * noise[k - 1] + math.sqrt(1 - rho**2) * noise[k]
    return noise[500:]


def wave(kept=slice(None)):
    """Return an orthonormal basis of a sine, a cosine and a constant at the samples that are kept."""
    return np.linalg.qr(np.column_stack([np.cos(ANGLE), np.sin(ANGLE), np.ones(SAMPLES)])[kept])[0]


def estimates(noise, kept=slice(None)):
    """Return the linear estimates for a wave of noise alone, their variances, and whether the noise counts as white."""
    basis = wave(kept)
    x = basis.T @ noise
    times = np.arange(SAMPLES, dtype=float)[kept]
    found = estimated_noise(noise - basis @ x, basis, [len(noise)], times)
    return x, np.diag(found.form(basis)), found.white


def scatter(make, runs=400):
    """Return mean stated variance over mean square of the estimates, for the wave and for the constant."""
    rng = np.random.default_rng(1)
    results = [estimates(*make(rng)) for _ in range(runs)]
    ratio = np.mean([v for _, v, _ in results], axis=0) / np.mean([x**2 for x, _, _ in results], axis=0)
    return (ratio[0] + ratio[1]) / 2, ratio[2], np.mean([white for _, _, white in results])


@pytest.mark.slow
def test_white_residuals_count_as_white_and_have_the_errors_of_an_ordinary_fit():
    rng = np.random.default_rng(2)
    x = cs.DM(ANGLE)
    for _ in range(20):
        y = cs.DM(3.0 + np.cos(ANGLE) + rng.standard_normal(SAMPLES))
        fits = [
            least_squares(
                lambda a, b, y=y: a * cs.cos(x) + b - y,
                [Unknown("a", 1.0), Unknown("b", 3.0)],
                noise=AssumedNoise(series),
            )
            for series in ([SAMPLES], [])
        ]
        np.testing.assert_array_equal(fits[0].covariance, fits[1].covariance)
        np.testing.assert_allclose(fits[0].white_errors, fits[0].errors, rtol=1e-12)
        assert fits[0].effective_samples == SAMPLES
    share = scatter(lambda rng: (rng.standard_normal(SAMPLES),), 200)[2]
    assert share > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.3, 0.9, -0.5])
def test_variances_are_those_of_the_estimates_for_autoregressive_noise(rho):
    """800 squares of the wave give their mean to 5 %, 400 of the constant to 7 %; three of these are allowed.

    The residuals of a constant hold no noise at frequency 0; for rho = 0.9 the spectrum there is steep.
    """
    oscillation, constant, white = scatter(lambda rng: (autoregressive(rng, rho),))
    assert oscillation == pytest.approx(1.0, abs=0.15)
    assert constant == pytest.approx(1.0, abs=0.21)
    assert white == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_missing_samples_and_bursts_of_them_do_not_spoil_the_variances(rho):
    def make(rng):
        kept = rng.random(SAMPLES) > 0.3
        kept[700:900] = False
        kept[[0, -1]] = True
        return autoregressive(rng, rho)[kept], kept

    oscillation, constant, _ = scatter(make)
    assert oscillation == pytest.approx(1.0, abs=0.15)
    assert constant == pytest.approx(1.0, abs=0.21)


@pytest.mark.slow
def test_interpolation_adds_no_information():
    """A tenth of the samples are measured, the others are interpolated between them."""

    def make(rng):
        coarse = rng.standard_normal(SAMPLES // 10 + 1)
        return (np.interp(np.arange(SAMPLES) / 10, np.arange(len(coarse)), coarse),)

    oscillation, _, _ = scatter(make)
    assert 0.85 < oscillation < 1.5


def test_a_line_elsewhere_in_the_spectrum_does_not_enlarge_the_errors_by_its_power():
    """The line has 50 times the power of the noise, and its frequency is nine times that of the wave."""
    rng = np.random.default_rng(3)
    line = 10 * np.cos(9.37 * ANGLE + 0.3)
    variances = [estimates(line + rng.standard_normal(SAMPLES))[1] for _ in range(20)]
    assert 0.5 < np.mean(variances) < 3.0
    assert concentration(line + rng.standard_normal(SAMPLES)) > 100.0


@pytest.mark.parametrize(("rho", "expected"), [(0.0, 1.0), (0.5, 5 / 3), (0.9, 1.81 / 0.19)])
def test_the_concentration_is_that_of_the_process(rho, expected):
    rng = np.random.default_rng(4)
    found = np.mean([concentration(autoregressive(rng, rho)) for _ in range(40)])
    assert found == pytest.approx(expected, rel=0.1)


def test_series_of_equal_noise_share_it_and_series_of_unequal_noise_do_not():
    rng = np.random.default_rng(5)
    basis = np.linalg.qr(np.kron(np.eye(2), wave()))[0]
    series = [SAMPLES, SAMPLES]
    equal = rng.standard_normal(2 * SAMPLES)
    assert estimated_noise(equal - basis @ (basis.T @ equal), basis, series, None).white
    unequal = equal * np.repeat([1.0, 3.0], SAMPLES)
    found = estimated_noise(unequal - basis @ (basis.T @ unequal), basis, series, None)
    np.testing.assert_allclose(np.diag(found.form(basis)), np.repeat([1.0, 9.0], 3), rtol=0.15)
    assert found.along(basis[:, 0]) == pytest.approx(found.form(basis)[0, 0])


def test_residuals_without_order_too_few_or_zero_count_as_white():
    basis = wave()
    swing = np.sin(3 * ANGLE)
    assert estimated_noise(swing, basis, [], None).white
    assert estimated_noise(swing[:7], np.ones((7, 1)) / 7**0.5, [7], None).white
    assert estimated_noise(0 * swing, basis, [SAMPLES], None).variance == 0.0
    assert math.isnan(estimated_noise(np.zeros(2), np.eye(2), [2], None).variance)


def test_the_autocorrelation_is_the_sum_of_the_products():
    r = np.random.default_rng(1).standard_normal(57)
    expected = [r[: 57 - k] @ r[k:] / (r @ r) for k in range(57)]
    np.testing.assert_allclose(autocorrelation(r), expected, atol=1e-14)
    assert np.isnan(autocorrelation(np.zeros(3))).all()


def test_products_run_within_a_series_and_over_gaps_in_its_times():
    first, second = np.random.default_rng(2).standard_normal((2, 40))
    both = autocorrelation(np.concatenate([first, second[:30]]), (40, 30))
    expected = (first[:-7] @ first[7:] + second[:23] @ second[7:30]) / (first @ first + second[:30] @ second[:30])
    assert both[7] == pytest.approx(expected)
    assert len(both) == 40
    late = np.delete(np.arange(40.0), [10, 11, 12])
    kept = np.where(np.isin(np.arange(40), late), first, 0.0)
    np.testing.assert_allclose(
        autocorrelation(first[late.astype(int)], (37,), 0.01 * late), autocorrelation(kept), atol=1e-14
    )


def swings(size):
    """Return an orthonormal basis of frequency, damping, amplitude, phase and offset of six periods of a decay."""
    t = np.arange(size) / size
    swing = np.exp(-3 * t)[:, None] * np.column_stack([np.cos(12 * math.pi * t), np.sin(12 * math.pi * t)])
    return np.linalg.qr(np.column_stack([swing, t[:, None] * swing, np.ones(size)]))[0]


@pytest.mark.slow
def test_the_correlation_of_few_residuals_is_that_of_their_noise():
    """The fitted curve absorbs slow noise: the residuals themselves correlate at 0.41, and white ones at -0.06."""
    rng, basis = np.random.default_rng(0), swings(100)
    for rho in (0.0, 0.5):
        found = []
        for _ in range(200):
            noise = autoregressive(rng, rho, 100)
            rest = noise - basis @ (basis.T @ noise)
            found.append(first_correlation(rest, basis, series_grids([100], None))[0])
        assert np.mean(found) == pytest.approx(rho, abs=0.025)  # 3.5 standard deviations
        assert np.std(found) == pytest.approx(math.sqrt((1 - rho**2) / 100), rel=0.25)


@pytest.mark.slow
def test_series_of_different_colours_have_their_own_spectra():
    """A white sensor and one with slow noise, which determine an unknown each: no common process fits both."""
    rng, swing, runs = np.random.default_rng(1), swings(100), 100
    basis, hits, stated = np.zeros((200, 10)), 0, np.zeros(10)
    basis[:100, :5], basis[100:, 5:] = swing, swing
    for _ in range(runs):
        noise = np.concatenate([rng.standard_normal(100), autoregressive(rng, 0.8, 100)])
        x = basis.T @ noise
        found = estimated_noise(noise - basis @ x, basis, [100, 100], None)
        variances = np.diag(found.form(basis))
        hits += np.count_nonzero(np.abs(x[5:9]) < quantile(0.95, found.freedom) * np.sqrt(variances[5:9]))
        stated += variances / runs
    assert covers(hits, 4 * runs)  # with a common process 77 %
    np.testing.assert_allclose(stated[:4], 1.0, atol=0.15)
    true = np.diag(swing.T @ scipy.linalg.toeplitz(0.8 ** np.arange(100)) @ swing)
    np.testing.assert_allclose(stated[5:9], true[:4], rtol=0.3)
