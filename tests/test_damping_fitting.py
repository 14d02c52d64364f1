"""Proportional damping from modal ratios: Eq. (17), least squares, bounds, and what is refused."""

import math

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems.damping_fitting import fit_rayleigh

FREQUENCIES = (1.85, 10.19, 26.84, 53.20, 88.60)  # Hz, Table 2
RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)
ω = 2 * np.pi * np.array(FREQUENCIES)


def test_two_modes_give_the_coefficients_of_table_3():
    """Eq. (17) with Table 2; the beta of 3.18E-4 printed in Table 3 is ten times too large."""
    fit = fit_rayleigh(FREQUENCIES[:2], RATIOS[:2])
    assert fit.alpha == pytest.approx(0.228181, rel=1e-5)
    assert fit.beta == pytest.approx(3.18013e-5, rel=1e-5)
    assert fit.ratios == pytest.approx(RATIOS[:2], rel=1e-14)
    assert fit.frequencies == FREQUENCIES[:2]
    assert fit.measured == RATIOS[:2]
    assert math.isnan(fit.standard_errors.alpha)
    assert fit.warnings == ()


@pytest.mark.parametrize(("alpha", "beta"), [(0.228, 3.18e-5), (4.0, 1e-4), (0.0, 1e-5), (0.3, 0.0)])
def test_ratios_that_obey_the_law_give_back_its_coefficients(alpha, beta):
    ratios = alpha / (2 * ω) + beta * ω / 2
    for modes in (2, 3, 5):
        fit = fit_rayleigh(FREQUENCIES[:modes], ratios[:modes])
        assert fit.alpha == pytest.approx(alpha, rel=1e-8, abs=1e-7)
        assert fit.beta == pytest.approx(beta, rel=1e-8, abs=1e-10)
        assert fit.ratios == pytest.approx(ratios[:modes], rel=1e-6)


def test_five_modes_agree_with_linear_regression():
    deviations = np.array([1e-4, 2e-4, 1e-4, 3e-4, 5e-4])
    basis = np.array([1 / (2 * ω), ω / 2]).T / deviations[:, None]
    scaled = np.array(RATIOS) / deviations
    (alpha, beta), (left,), *_ = np.linalg.lstsq(basis, scaled)
    covariance = left / 3 * np.linalg.inv(basis.T @ basis)
    fit = fit_rayleigh(FREQUENCIES, RATIOS, standard_deviations=deviations)
    assert (fit.alpha, fit.beta) == pytest.approx((alpha, beta), rel=1e-9)
    assert fit.standard_errors.alpha == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-6)
    assert fit.standard_errors.beta == pytest.approx(math.sqrt(covariance[1, 1]), rel=1e-6)
    assert fit.ratios == pytest.approx(alpha / (2 * ω) + beta * ω / 2)


@pytest.mark.parametrize(
    ("ratios", "at_bound", "free", "value"),
    [((0.01, 0.05), "alpha", "beta", 0.022 / math.pi), ((0.05, 0.001), "beta", "alpha", 0.1616 * math.pi)],
)
def test_two_modes_that_would_need_a_negative_coefficient_are_not_matched(ratios, at_bound, free, value):
    """Alone, beta is 2 sum(zeta omega)/sum(omega^2), and alpha 2 sum(zeta/omega)/sum(1/omega^2)."""
    fit = fit_rayleigh((1.0, 2.0), ratios)
    assert getattr(fit, at_bound) == 0.0
    assert getattr(fit, free) == pytest.approx(value, rel=1e-9)
    assert fit.warnings == (f"{at_bound} is at its bound 0; below it the law would feed energy in",)
    assert max(abs(a - b) for a, b in zip(fit.ratios, ratios, strict=True)) > 1e-3


def test_no_damping_gives_no_coefficients():
    for modes in (2, 3):
        fit = fit_rayleigh(FREQUENCIES[:modes], [0.0] * modes)
        assert (fit.alpha, fit.beta) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("frequencies", "ratios", "deviations", "message"),
    [
        ((1.85,), (0.01,), None, "frequencies: needs at least 2 modes, got 1"),
        ((), (), None, "frequencies: needs at least 2 modes, got 0"),
        ((1.85, 10.19), (0.01,), None, "ratios: has 1 values for 2 frequencies"),
        ((1.85, 10.19), (0.01, 0.01), (1.0,), "standard_deviations: has 1 values for 2 frequencies"),
        ((10.19, 1.85), (0.01, 0.01), None, "frequencies: must ascend"),
        ((1.85, 1.85), (0.01, 0.01), None, "frequencies: must ascend"),
        ((-1.85, 1.85), (0.01, 0.01), None, "frequencies: must be positive"),
        ((1.85, math.nan), (0.01, 0.01), None, "frequencies: must be a finite number"),
        ((1.85, 10.19), (0.01, 1.0), None, "ratios: must be at least 0 and below 1"),
        ((1.85, 10.19), (-0.01, 0.5), None, "ratios: must be at least 0 and below 1"),
        ((1.85, 10.19), (0.01, "a"), None, "ratios: must be a finite number"),
        ((1.85, 10.19), (0.01, 0.02), (0.0, 1.0), "standard_deviations: must be positive"),
    ],
)
def test_unusable_input_is_refused(frequencies, ratios, deviations, message):
    with pytest.raises(InputError, match=message):
        fit_rayleigh(frequencies, ratios, standard_deviations=deviations)
