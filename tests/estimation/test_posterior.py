"""The posterior density of a fit and its samples: closed forms, differences, profile likelihood, known truth."""

import importlib.util
import math
import pickle
from concurrent.futures import ProcessPoolExecutor

import casadi as cs
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ancf_casadi import Beam, InputError, Model
from ancf_casadi.estimation.intervals import profile_interval
from ancf_casadi.estimation.posterior.log_density import LogDensity
from ancf_casadi.estimation.posterior.sampling import (
    _chain,
    largest_r_hat,
    resample,
    sample_posterior,
    second_order_density,
)
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from problems import FrequencyRecord, corner_figure, fit_beam, fit_decay

TIME = np.linspace(0.0, 10.0, 501)
DECAY = 0.02 * np.exp(-0.1 * TIME) * np.cos(12.0 * TIME)
BEAM = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=2)


def noise(seed, size=1e-4, correlation=0.0):
    white = size * np.random.default_rng(seed).standard_normal(len(TIME))
    return lfilter([1.0], [1.0, -correlation], white)


def line(values, lower=-math.inf, upper=math.inf):
    """Return the density of the mean of values, which may be within bounds."""
    values = np.asarray(values)
    fit = least_squares(lambda mean: mean - cs.DM(values), [Unknown("mean", 0.5, 1.0, lower, upper)])
    return LogDensity(fit)


def quantiles(density, shares):
    """Return quantiles of the unknown of a density, by quadrature over its coordinate."""
    steps = np.sinh(np.linspace(-8.0, 8.0, 401))  # in units of the scale; fine in the middle, and far out
    x = density.start + density.scale[0] * steps
    weights = np.exp([density.value(np.array([coordinate])) for coordinate in x])
    if density.unknowns(x[:1, None])[0, 0] > density.unknowns(x[-1:, None])[0, 0]:  # a reciprocal
        x, weights = x[::-1], weights[::-1]
    parts = (weights[1:] + weights[:-1]) / 2 * np.abs(np.diff(x))
    return np.interp(shares, np.append(0.0, np.cumsum(parts)) / parts.sum(), density.unknowns(x[:, None])[:, 0])


@pytest.fixture(scope="module")
def densities():
    """Densities of decays with white and coloured noise, robust, at a bound, and of a beam."""
    model = Model(BEAM)
    beam = fit_beam(model, FrequencyRecord(model, [1.9, 10.8, 30.6], std=[0.01] * 3), unknowns=["elastic_modulus"])
    fits = {
        "white": fit_decay(TIME, DECAY + noise(0)),
        "coloured": fit_decay(TIME, DECAY + noise(1, correlation=0.9)),
        "robust": fit_decay(TIME, DECAY + noise(2), robust=True),
        "at a bound": fit_decay(TIME, DECAY + noise(9, 1e-3), law="quadratic"),
        "beam": beam,
    }
    assert fits["at a bound"].at_bound == ("eta2",)
    assert not fits["coloured"].fit.noise.white
    return {name: fit.log_density() for name, fit in fits.items()}


CASES = ["white", "coloured", "robust", "at a bound", "beam"]


@pytest.mark.parametrize("name", CASES)
def test_the_gradient_agrees_with_differences(densities, name):
    density, rng = densities[name], np.random.default_rng(0)
    for distance in (0.0, 0.5, 2.0):
        x = density.start + distance * density.scale @ rng.standard_normal(len(density.names))
        _, gradient = density.value_and_gradient(x)
        for step in 2e-3 * density.scale.T:  # differences of order 4
            values = [density.value(x + k * step) for k in (-2, -1, 1, 2)]
            difference = float(np.dot(values, [1.0, -8.0, 8.0, -1.0])) / 12
            assert gradient @ step / 2e-3 == pytest.approx(difference / 2e-3, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", ["white", "coloured", "robust"])
def test_its_curvature_at_the_estimates_is_the_inverse_of_the_reported_covariance(densities, name):
    density = densities[name]
    f, n = density.fit.noise.freedom, len(density.names)
    rows = [
        np.subtract(*(density.value_and_gradient(density.start + k * step)[1] for k in (-1, 1))) / 2e-3
        for step in 1e-3 * density.scale.T
    ]
    curvature = np.array(rows) @ density.scale
    np.testing.assert_allclose(curvature, (f + n) / f * np.eye(n), atol=0.01)  # the residuals are not quite linear
    covariance = np.diag(density.transformation.slopes(density.start)) @ density.scale
    np.testing.assert_allclose(covariance @ covariance.T, density.fit.covariance, rtol=1e-6)


def test_a_linear_fit_of_a_few_values_has_the_distribution_of_student():
    values = [0.1, 0.5, 0.2, 0.9]
    truth = stats.t(3, np.mean(values), np.std(values, ddof=1) / 2)
    shares = [0.025, 0.2, 0.5, 0.9, 0.975]
    np.testing.assert_allclose(quantiles(line(values), shares), truth.ppf(shares), atol=2e-3)


@pytest.mark.parametrize(("lower", "upper"), [(0.0, math.inf), (-math.inf, 0.5), (0.2, 0.55), (0.4, 3.0)])
def test_bounds_truncate_it(lower, upper):
    """The transformations and their Jacobian determinants leave the distribution as it is."""
    values = [0.1, 0.5, 0.2, 0.9]
    truth = stats.t(3, np.mean(values), np.std(values, ddof=1) / 2)
    shares = np.array([0.025, 0.2, 0.5, 0.9, 0.975])
    low, high = truth.cdf([lower, upper])
    expected = truth.ppf(low + shares * (high - low))
    np.testing.assert_allclose(quantiles(line(values, lower, upper), shares), expected, atol=3e-3)


def held(values, std, unknown):
    """Return the density of the mean of values with a standard deviation, and with a prior."""
    fit = least_squares(lambda mean: cs.vertcat((mean - cs.DM(values)) / std, unknown.prior_residual(mean)), [unknown])
    return LogDensity(fit)


@pytest.mark.parametrize("offset", [None, 0.0, 1.5])
@pytest.mark.parametrize(
    ("settings", "truth"),
    [
        ({"prior": (2.0, 0.5)}, stats.norm(2.0, 0.5)),
        ({"prior": (2.0, 0.5), "relative_prior": True}, stats.lognorm(0.5, scale=2.0)),
    ],
)
def test_it_is_the_prior_where_the_data_say_nothing(settings, truth, offset):
    """The prior is one of the unknown, also if the solver works with its reciprocal."""
    values = 500.0 * np.random.default_rng(0).standard_normal(50)
    bounds = (0.0, math.inf) if offset is None else (1e-3, 1e3)
    density = held(values, 500.0, Unknown("mean", 2.0, 1.0, *bounds, offset=offset, **settings))
    shares = [0.025, 0.2, 0.5, 0.9, 0.975]
    np.testing.assert_allclose(quantiles(density, shares), truth.ppf(shares), rtol=0.02)
    x = density.start + density.scale[0]
    step = 1e-4 * density.scale[0]
    difference = (density.value(x + step) - density.value(x - step)) / (2 * step[0])
    assert density.value_and_gradient(x)[1][0] == pytest.approx(difference, rel=1e-6)


def test_data_and_prior_weigh_as_their_variances():
    values = 1.0 + np.random.default_rng(1).standard_normal(400)
    density = held(values, np.std(values), Unknown("mean", 1.0, 1.0, prior=(1.05, 0.05)))
    information = 400 / np.var(values), 1 / 0.05**2
    truth = stats.norm(np.dot(information, (values.mean(), 1.05)) / sum(information), sum(information) ** -0.5)
    shares = [0.025, 0.5, 0.975]
    np.testing.assert_allclose(quantiles(density, shares), truth.ppf(shares), atol=0.05 * truth.std())
    assert density.fit.data_shares["mean"] == pytest.approx(information[0] / sum(information), rel=0.02)


@pytest.mark.parametrize("name", CASES)
def test_coordinates_and_unknowns_are_inverse_and_pass_between_processes(densities, name):
    density = densities[name]
    x = density.start + density.scale @ np.linspace(-1.0, 1.0, len(density.names))
    np.testing.assert_allclose(density.coordinates(density.unknowns(x)), x, rtol=1e-9, atol=1e-9 * density.scale.max())
    again = pickle.loads(pickle.dumps(density))
    assert again.value(x) == pytest.approx(density.value(x), rel=1e-12)
    with pytest.raises(AttributeError):
        density.fit = None


def test_where_it_cannot_be_computed_it_is_minus_infinity(densities):
    density = densities["white"]
    assert density.value(np.full(5, np.inf)) == -math.inf
    value, gradient = density.value_and_gradient(np.full(5, np.nan))
    assert value == -math.inf and not gradient.any()


def test_what_is_no_density_or_no_point_of_it_is_refused(densities):
    density = densities["white"]
    with pytest.raises(InputError, match="x: must be 5 numbers, for omega, zeta"):
        density.value(np.zeros(2))
    with pytest.raises(InputError, match="unknowns: must be within their bounds"):
        density.coordinates(np.full(5, -1.0))
    with pytest.raises(InputError, match="fit: has no scatter"):
        line([0.5])


def test_the_expansion_to_second_order_is_exact_for_residuals_of_second_order():
    def residuals(a, b):
        return cs.vertcat(a - 1, b - 2, a + b + 0.1 * a * b - 3, a - b + 0.2 * a**2, 0.3 * b**2, a * b - 1)

    density = LogDensity(least_squares(residuals, [Unknown("a", 1.0, lower=0.0), Unknown("b", 1.0)]))
    for c in ([0.0, 0.0], [1.0, 2.0], [-1.5, 1.0]):
        x = density.start + density.scale @ c
        (value, gradient), (exact, exact_gradient) = (
            d.value_and_gradient(x) for d in (second_order_density(density), density)
        )
        assert value == pytest.approx(exact, rel=1e-9)
        np.testing.assert_allclose(gradient, exact_gradient, rtol=1e-7, atol=1e-7)


def test_a_missing_sampler_is_named(densities, monkeypatch):
    fit = fit_decay(TIME, DECAY + noise(0))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="nutpie: is not installed, but sampling needs it; pip install nutpie"):
        fit.sample()


@pytest.mark.slow
def test_samples_of_a_nearly_linear_fit_agree_with_its_intervals():
    fit = fit_decay(TIME, DECAY + noise(0))
    data = fit.sample(draws=1000, chains=2)
    assert set(data.posterior.data_vars) == set(fit.estimates)
    assert data.posterior["frequency"].attrs["units"] == "Hz"
    for name, (low, high) in fit.intervals().items():
        ends = np.quantile(data.posterior[name].values, [0.025, 0.975])
        np.testing.assert_allclose(ends, [low, high], atol=0.1 * (high - low))
    first, again, other = (fit.sample(draws=50, chains=1, seed=seed).posterior["eta1"].values for seed in (0, 0, 1))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert corner_figure(data).axes[0].patches


@pytest.mark.slow
def test_short_chains_that_have_converged_do_not_warn():
    """R-hat is 1.012 by chance; of chains whose means are 0.6 standard deviations apart, it is above the limit."""
    samples = fit_decay(TIME, DECAY + noise(0, 1e-3), release_time=0.0).sample(draws=250, chains=2)
    arviz = importlib.import_module("arviz")
    apart = np.random.default_rng(0).standard_normal((2, 250)) + np.array([[0.3], [-0.3]])
    assert float(arviz.rhat(apart)) > largest_r_hat(250, 2, 5) > max(map(float, arviz.rhat(samples).values())) > 1.01
    assert largest_r_hat(500, 4, 5) == pytest.approx(1.01, abs=1e-3)


@pytest.mark.slow
def test_samples_of_a_strongly_curved_fit_agree_with_its_profile_and_with_the_truth():
    """With b - 2 a^2 and a independent, a has the distribution of Student, and b one that is far from normal.

    The tolerances are four standard errors of some 700 independent draws.  A normal distribution misses the quantiles
    of b by 0.42, 0.20 and 0.74 standard deviations.
    """
    rng = np.random.default_rng(0)
    first, second = 2.0 * rng.standard_normal((2, 50))
    fit = least_squares(
        lambda a, b: cs.vertcat(a - cs.DM(first), b - 2 * a**2 - cs.DM(second)), [Unknown("a", 0.1), Unknown("b", 0.1)]
    )
    spread = math.sqrt(fit.noise.variance / 50)
    a = first.mean() + spread * stats.t(98).rvs(100_000, random_state=1)
    b = 2 * a**2 + second.mean() + spread * stats.t(98).rvs(100_000, random_state=2)
    settings = {"draws": 2000, "chains": 2, "seed": 0, "executor": None, "jobs": 1, "progress": False}
    data = sample_posterior(LogDensity(fit), (("a", "b"), ("", ""), lambda *x: cs.vertcat(*x)), **settings)
    ends = np.quantile(data.posterior["a"].values, [0.025, 0.975])
    np.testing.assert_allclose(ends, profile_interval(fit, "a"), atol=0.4 * spread)
    np.testing.assert_allclose(ends, np.quantile(a, [0.025, 0.975]), atol=0.4 * spread)
    shares = [0.05, 0.5, 0.95]
    errors = np.quantile(data.posterior["b"].values, shares) - np.quantile(b, shares)
    assert (np.abs(errors) < np.array([0.06, 0.07, 0.37]) * b.std()).all()


def test_weights_correct_draws_that_depend_on_each_other():
    """Of a normal distribution to a narrower one, which a Metropolis chain of these proposals misses by 0.1 to 0.7."""
    rng = np.random.default_rng(0)
    draws = lfilter([math.sqrt(1 - 0.95**2)], [1.0, -0.95], rng.standard_normal(200_000))
    truth = stats.norm(0.5, 0.8)
    places = resample(truth.logpdf(draws) - stats.norm.logpdf(draws), rng)
    shares = [0.025, 0.2, 0.5, 0.8, 0.975]
    np.testing.assert_allclose(np.quantile(draws[places], shares), truth.ppf(shares), atol=0.04)
    assert (np.diff(places) >= 0).all() and len(places) == len(draws)


def test_weights_that_count_for_too_few_draws_are_refused():
    rng = np.random.default_rng(0)
    assert np.array_equal(resample(np.zeros(5), rng), np.arange(5))
    assert resample(np.append(np.full(5, -math.inf), np.zeros(5)), rng) is not None
    assert resample(np.append(np.full(6, -math.inf), np.zeros(4)), rng) is None
    assert resample(np.full(5, -math.inf), rng) is None


@pytest.mark.slow
def test_a_chain_corrects_what_the_expansion_leaves_out():
    """Of exp a - y, the expansion lacks the third order: its median agrees, and its lower tail does not."""
    values = 1.0 + 2.0 * np.random.default_rng(0).standard_normal(30)
    density = LogDensity(least_squares(lambda a: cs.exp(a) - cs.DM(values), [Unknown("a", 0.1, 1.0, -3.0, 2.0)]))
    draws, *_ = _chain(density, second_order_density(density), 1500, np.random.SeedSequence(0))
    shares = [0.1, 0.5, 0.9]
    found = np.quantile(density.unknowns(draws)[:, 0], shares)
    exact, without = quantiles(density, shares), quantiles(second_order_density(density), shares)
    assert np.abs(without - exact).max() > 0.2  # what there is to correct
    np.testing.assert_allclose(found, exact, atol=0.1)


@pytest.mark.slow
def test_a_chain_in_another_process_has_the_same_draws():
    fit = fit_decay(TIME, DECAY + noise(0))
    with ProcessPoolExecutor(2) as executor:
        found = [fit.sample(draws=100, chains=1, executor=one).posterior["eta1"].values for one in (None, executor)]
    np.testing.assert_array_equal(*found)
