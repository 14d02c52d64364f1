"""Rayleigh damping from modal ratios: Eq. (17), least squares, bounds, and refusals."""

import json
import math

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems.modal_damping.rayleigh import fit_rayleigh

FREQUENCIES = (1.85, 10.19, 26.84, 53.20, 88.60)  # Hz, Table 2
RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)
ω = 2 * np.pi * np.array(FREQUENCIES)


def errors(fit):
    return fit.standard_errors["alpha"], fit.standard_errors["beta"]


def test_two_modes_give_the_coefficients_of_table_3():
    """Eq. (17) with Table 2; the beta of 3.18E-4 printed in Table 3 is ten times too large."""
    fit = fit_rayleigh(FREQUENCIES[:2], RATIOS[:2])
    assert fit.alpha == pytest.approx(0.228181, rel=1e-5)
    assert fit.beta == pytest.approx(3.18013e-5, rel=1e-5)
    assert fit.ratios == pytest.approx(RATIOS[:2], rel=1e-14)
    assert fit.frequencies == FREQUENCIES[:2]
    assert fit.measured == RATIOS[:2]
    assert math.isnan(fit.standard_errors["alpha"])  # nothing tells how uncertain the ratios are
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
    (alpha, beta), (squares,), *_ = np.linalg.lstsq(basis, scaled)
    covariance = np.linalg.inv(basis.T @ basis)
    fit = fit_rayleigh(FREQUENCIES, RATIOS, ratio_std=deviations)
    assert (fit.alpha, fit.beta) == pytest.approx((alpha, beta), rel=1e-9)
    assert errors(fit) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert fit.ratios == pytest.approx(alpha / (2 * ω) + beta * ω / 2)
    missed = (np.array(RATIOS) - fit.ratios) / deviations
    assert missed @ missed == pytest.approx(squares)
    named = [warning.split(",")[0] for warning in fit.warnings if "differs from the measured" in warning]
    assert named == [f"mode {k + 1}" for k in range(5) if abs(missed[k]) > 3]
    assert 0 < len(named) < 5


def test_without_deviations_the_scatter_tells_the_errors():
    basis = np.array([1 / (2 * ω), ω / 2]).T
    _, (squares,), *_ = np.linalg.lstsq(basis, np.array(RATIOS))
    fit = fit_rayleigh(FREQUENCIES, RATIOS)
    assert errors(fit) == pytest.approx(np.sqrt(squares / 3 * np.diag(np.linalg.inv(basis.T @ basis))), rel=1e-6)
    assert fit.ratio_std is None
    assert fit.warnings == ()


@pytest.mark.slow
def test_the_errors_of_two_modes_are_those_of_their_ratios():
    """Eq. (17) is linear in the ratios: so are the fits to noisy ratios, and so their scatter."""
    deviations = np.array([3e-4, 1e-4])
    fit = fit_rayleigh(FREQUENCIES[:2], RATIOS[:2], ratio_std=deviations)
    ω1, ω2 = ω[:2]
    slopes = 2 / (ω2**2 - ω1**2) * np.array([[ω1 * ω2**2, -(ω1**2) * ω2], [-ω1, ω2]])
    assert errors(fit) == pytest.approx(np.hypot(*(slopes * deviations).T), rel=1e-12)
    for noise in deviations * np.random.default_rng(1).standard_normal((20, 2)):
        noisy = fit_rayleigh(FREQUENCIES[:2], np.array(RATIOS[:2]) + noise)
        assert (noisy.alpha - fit.alpha, noisy.beta - fit.beta) == pytest.approx(slopes @ noise, rel=1e-6)
    assert fit.warnings == ()


def test_deviations_are_absolute():
    """Twice as uncertain ratios give twice as uncertain coefficients; one deviation may stand for all."""
    for modes in (2, 5):
        single, twice = (
            fit_rayleigh(FREQUENCIES[:modes], RATIOS[:modes], ratio_std=deviation) for deviation in (1e-4, 2e-4)
        )
        assert errors(twice) == pytest.approx(2 * np.array(errors(single)), rel=1e-9)
        assert (twice.alpha, twice.beta) == pytest.approx((single.alpha, single.beta), rel=1e-9)
        assert single.ratio_std == (1e-4,) * modes


def test_a_mode_that_the_law_does_not_reach_is_named():
    """The fourth ratio is ten standard deviations from the law of all others, whose weight dominates."""
    ratios = 0.228 / (2 * ω) + 3.18e-5 * ω / 2
    ratios[3] += 10 * 1e-3
    deviations = (1e-5, 1e-5, 1e-5, 1e-3, 1e-5)
    (warning,) = fit_rayleigh(FREQUENCIES, ratios, ratio_std=deviations).warnings
    assert warning.startswith("mode 4, 53.2 Hz: the fitted damping ratio ")
    assert "differs from the measured" in warning and "by 10.0 standard deviations" in warning
    ratios[3] -= 8 * 1e-3
    assert fit_rayleigh(FREQUENCIES, ratios, ratio_std=deviations).warnings == ()


def test_the_result_reads_as_text_and_as_json():
    fit = fit_rayleigh((1.0, 2.0, 3.0), (0.01, 0.05, 0.07), ratio_std=(1e-3, 2e-3, 1e-3))
    assert fit.warnings
    text = fit.report()
    assert f"beta {fit.beta:.6g} +- {fit.standard_errors['beta']:.2g} s" in text
    assert all(f"note: {warning}" in text for warning in fit.warnings)
    table = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    assert "alpha 0 1/s  (at its bound)" in text and "nan" not in text
    assert (table["alpha"], table["alpha_stderr"]) == (0.0, None)
    assert (table["beta"], table["beta_stderr"]) == (fit.beta, fit.standard_errors["beta"])
    assert table["fitted_ratios"] == list(fit.ratios)
    assert table["ratio_std"] == [1e-3, 2e-3, 1e-3]
    assert table["warnings"] == list(fit.warnings)
    unknown = fit_rayleigh(FREQUENCIES[:2], RATIOS[:2])
    assert unknown.to_dict()["ratio_std"] is unknown.to_dict()["beta_stderr"] is None
    assert "alpha 0.228181 1/s  (standard error unknown)" in unknown.report()


@pytest.mark.parametrize(
    ("ratios", "at_bound", "free", "value"),
    [((0.01, 0.05), "alpha", "beta", 0.022 / math.pi), ((0.05, 0.001), "beta", "alpha", 0.1616 * math.pi)],
)
def test_two_modes_that_would_need_a_negative_coefficient_are_not_matched(ratios, at_bound, free, value):
    """Alone, beta is 2 sum(zeta omega)/sum(omega^2), and alpha 2 sum(zeta/omega)/sum(1/omega^2)."""
    fit = fit_rayleigh((1.0, 2.0), ratios)
    assert getattr(fit, at_bound) == 0.0
    assert getattr(fit, free) == pytest.approx(value, rel=1e-9)
    assert fit.warnings == (
        f"{at_bound} is at its bound 0: the ratios alone would make it negative, and the law would supply energy",
    )
    assert max(abs(a - b) for a, b in zip(fit.ratios, ratios, strict=True)) > 1e-3


def test_no_damping_gives_no_coefficients():
    for modes in (2, 3):
        fit = fit_rayleigh(FREQUENCIES[:modes], [0.0] * modes)
        assert (fit.alpha, fit.beta) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("frequencies", "ratios", "deviation", "message"),
    [
        ((1.85,), (0.01,), None, "frequencies: needs at least 2 modes, got 1"),
        ((1.85, 10.19), (0.01,), None, "ratios: has 1 values for 2 frequencies"),
        ((1.85, 10.19), (0.01, 0.01), (1.0,), "ratio_std: has 1 values for 2 frequencies"),
        ((1.85, 1.85), (0.01, 0.01), None, "frequencies: must increase"),
        ((1.85, 10.19), (0.01, 1.0), None, "ratios: must be at least 0 and below 1"),
        ((1.85, 10.19), (0.01, "a"), None, "ratios: must be a finite number"),
        ((1.85, 10.19), (0.01, 0.02), -1e-4, "ratio_std: must be positive"),
    ],
)
def test_unusable_input_is_refused(frequencies, ratios, deviation, message):
    with pytest.raises(InputError, match=message):
        fit_rayleigh(frequencies, ratios, ratio_std=deviation)
