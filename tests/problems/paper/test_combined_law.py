"""One law for all modes: recovery and coverage of a known truth, rejection of a false one, and independent routes."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Measurement, natural_modes
from ancf_casadi.decay.closed_forms import quadratic_decay
from ancf_casadi.estimation.agreement import Agreement
from problems import fit_decay
from problems.paper.combined_law import drag_constants, fit_combined_law, ratio_curves
from problems.study.kinds.decays import unbounded_coefficients
from problems.study.step import LawChoice

RATIOS = np.array([0.006, 0.0025, 0.0026, 0.0022, 0.0027])
ETA2 = 0.11
FREQUENCIES, PRINTED = (1.85, 10.19, 26.84, 53.20, 88.60), (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)  # Table 2
ETA1_PRINTED, ETA2_PRINTED = (0.15, 0.31, 0.89, 1.46, 3.00), (0.11, 0.060, 0.050, 0.050, 0.050)  # Table 4
AMPLITUDES = (0.076, 0.0149, 0.0076, 0.0055, 0.0144)  # m, at which they have the printed ratios
ERRORS = np.array([[0.002, 0.0034], [0.0075, 0.0133], [0.013, 0.0235], [0.027, 0.0357], [0.028, 0.0091]])
CORRELATIONS = (-0.997, -0.994, -0.967, -0.948, -0.939)


@pytest.fixture(scope="module")
def modes(weightless):
    return natural_modes(weightless)


def draw_coefficients(modes, rng, eta2=ETA2, ratios=RATIOS):
    """Coefficients of five modes with the errors of real fits, drawn about a truth with one or five eta2."""
    means = np.column_stack([2 * modes.angular_frequencies * ratios, drag_constants(modes) * eta2])
    correlations = np.array([[[1.0, rho], [rho, 1.0]] for rho in CORRELATIONS])
    covariances = ERRORS[:, :, None] * ERRORS[:, None, :] * correlations
    pairs = zip(means, covariances, strict=True)
    coefficients = np.array([rng.multivariate_normal(mean, covariance) for mean, covariance in pairs])
    return modes.frequencies, coefficients, covariances


def test_drag_constants_are_those_of_the_true_modes(modes):
    exact = np.array([0.738914, 0.647144, 0.632013, 0.622715, 0.617725])
    np.testing.assert_allclose(drag_constants(modes) * 876 / 1183, exact, atol=5e-4)


def test_coefficients_without_errors_return_the_truth(modes):
    coefficients = np.column_stack([4 * math.pi * modes.frequencies * RATIOS, drag_constants(modes) * ETA2])
    fit = fit_combined_law(modes.frequencies, coefficients, np.tile(1e-12 * np.eye(2), (5, 1, 1)), modes)
    assert fit.ratios == pytest.approx(RATIOS)
    assert fit.eta2 == pytest.approx(ETA2)
    (ratios,) = ratio_curves(fit.choice, modes, [0.02])
    assert ratios == pytest.approx(RATIOS + 4 * drag_constants(modes) * ETA2 * 0.02 / (3 * np.pi))


@pytest.mark.slow
def test_estimates_are_unbiased_and_intervals_cover_the_truth_in_95_percent_of_draws(modes):
    rng, truth = np.random.default_rng(3), np.append(RATIOS, ETA2)
    scores, rejected = [], 0
    for _ in range(1000):
        fit = fit_combined_law(*draw_coefficients(modes, rng), modes)
        estimates = np.append(fit.ratios, fit.eta2)
        scores.append((estimates - truth) / np.array(fit.errors))
        rejected += not fit.explains_all_modes
    covered = (np.abs(scores) < 1.96).mean(axis=0)
    assert abs(np.mean(scores, axis=0)).max() < 0.12
    assert (covered > 0.93).all() and (covered < 0.97).all()
    assert rejected < 25  # 1 % of them on average


def test_different_drag_of_the_modes_is_rejected_and_enlarges_the_errors(modes):
    different = np.array([0.11, 0.06, 0.05, 0.05, 0.05])
    fits = [fit_combined_law(*draw_coefficients(modes, np.random.default_rng(k), different), modes) for k in range(20)]
    assert sum(not fit.explains_all_modes for fit in fits) >= 18
    (first, *_) = [fit for fit in fits if not fit.explains_all_modes]
    same = fit_combined_law(*draw_coefficients(modes, np.random.default_rng(0)), modes)
    factor = math.sqrt(first.chi_squared / first.degrees_of_freedom)
    assert first.errors[-1] == pytest.approx(factor * same.errors[-1])
    assert "one eta2 does not explain all modes (chi-squared" in first.warnings[0]
    assert same.warnings == ()


def test_the_common_eta2_and_its_test_are_the_weighted_mean_of_the_modes(modes):
    """The linear ratios are free, so eta2 and Q follow from eta2_n/c_n and their errors alone."""
    measured = draw_coefficients(modes, np.random.default_rng(7))
    _, coefficients, covariances = measured
    fit, constants = fit_combined_law(*measured, modes), drag_constants(modes)
    beam_eta2, errors = coefficients[:, 1] / constants, np.sqrt(covariances[:, 1, 1]) / constants
    mean = Agreement("eta2", "1/m", beam_eta2, errors)
    weights = errors**-2
    assert fit.eta2 == pytest.approx(weights @ beam_eta2 / weights.sum())
    assert fit.errors[-1] == pytest.approx(weights.sum() ** -0.5)
    assert fit.probability == pytest.approx(mean.probability)
    assert fit.degrees_of_freedom == 4


def test_a_ratio_that_would_be_negative_is_at_its_bound_and_reported(modes):
    ratios = np.array([-0.002, 0.0025, 0.0026, 0.0022, 0.0027])
    fit = fit_combined_law(*draw_coefficients(modes, np.random.default_rng(1), ratios=ratios), modes)
    assert fit.ratios[0] == 0.0
    assert math.isnan(fit.errors[0])
    assert fit.warnings[0] == "ratio1 is at its bound 0; the other standard errors take it as known"


@pytest.mark.slow
def test_table_4_has_no_common_drag_coefficient(modes):
    """Decays by Eq. (27) with its parameters, 500 frames per second for 5 s, noise of 0.2 mm."""
    time, rng, fits = np.arange(0.0, 5.0, 1 / 500), np.random.default_rng(22), []
    rows = zip(FREQUENCIES, ETA1_PRINTED, ETA2_PRINTED, AMPLITUDES, strict=True)
    for f, eta1, eta2, e0 in rows:
        clean = quadratic_decay(cs.DM(time), *map(cs.DM, (2 * math.pi * f, eta1, eta2, e0, 0.0))).full().ravel()
        fits.append(fit_decay(time, clean + 2e-4 * rng.standard_normal(time.size), law="quadratic"))
    eta1, eta2, covariances = map(np.array, zip(*map(unbounded_coefficients, fits), strict=True))
    assert eta1 == pytest.approx([fit.eta1 for fit in fits], rel=1e-4)
    assert eta2 == pytest.approx([fit.eta2 for fit in fits], rel=1e-4)
    errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    exact = [[fit.standard_errors["eta1"], fit.standard_errors["eta2"]] for fit in fits]
    assert errors == pytest.approx(np.array(exact), rel=1e-3)
    correlations = covariances[:, 0, 1] / errors.prod(axis=1)
    assert correlations == pytest.approx([fit.correlation for fit in fits], abs=1e-4)
    frequencies = np.array([fit.frequency for fit in fits])
    combined = fit_combined_law(frequencies, np.column_stack([eta1, eta2]), covariances, modes)
    assert not combined.explains_all_modes
    assert combined.verdict.startswith("One eta2 does not explain all modes: chi-squared")


@pytest.mark.slow
def test_a_fit_at_its_bound_gives_a_pair_as_if_it_had_none():
    """Mean and covariance over linear decays with noise, half of whose fits end at eta2 = 0."""
    time, omega = np.arange(0.0, 5.0, 1 / 200.0), 2 * np.pi * 10.0
    clean = 0.005 * np.exp(-0.1 * time) * np.cos(omega * time)
    rng, scores, bounds = np.random.default_rng(0), [], 0
    for _ in range(60):
        fit = fit_decay(Measurement(time, clean + 2e-4 * rng.standard_normal(time.size)), law="quadratic")
        bounds += "eta2" in fit.at_bound
        eta1, eta2, covariance = unbounded_coefficients(fit)
        scores.append([eta1 - 0.2, eta2] / np.sqrt(np.diag(covariance)))
    assert 15 < bounds < 45
    assert abs(np.mean(scores, axis=0)).max() < 3 / math.sqrt(60)
    assert np.std(scores, axis=0) == pytest.approx([1.0, 1.0], abs=0.3)


def test_curves_of_the_laws_are_straight_in_the_amplitude(modes):
    laws = {
        "modal": ({"law": "modal", "ratios": PRINTED},),
        "proportional": ({"law": "rayleigh", "alpha": 0.228, "beta": 3.18e-5},),
        "quadratic": ({"law": "quadratic", "eta1": 0.15, "eta2": 0.11},),
        "modal + quadratic": ({"law": "modal", "ratios": RATIOS.tolist()}, {"law": "quadratic", "eta2": ETA2}),
    }
    curves = {name: ratio_curves(LawChoice(name, terms), modes, [0.0, 0.01, 0.04]) for name, terms in laws.items()}
    assert curves["modal"] == pytest.approx(np.tile(PRINTED, (3, 1)))
    assert curves["proportional"][0] == pytest.approx(curves["proportional"][2])
    slope = 4 * ETA2 * drag_constants(modes) / (3 * np.pi)
    assert curves["modal + quadratic"] == pytest.approx(RATIOS + np.outer([0.0, 0.01, 0.04], slope))
    assert curves["quadratic"][2] - curves["quadratic"][0] == pytest.approx(0.04 * slope)
