"""Intervals and reports of fits: linear regression, published values, one-sided intervals at bounds, outliers."""

import json
import math

import casadi as cs
import numpy as np
import pytest
from scipy import stats

from ancf_casadi.estimation.fit import colour_warning, quantile
from ancf_casadi.estimation.intervals import derived_intervals, profile_interval, profiles
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown, with_guesses
from ancf_casadi.exceptions import InputError

X = np.linspace(0.0, 3.0, 40)
NOISE = np.random.default_rng(1).standard_normal(40)
# Puromycin, treated: Bates and Watts, Nonlinear Regression Analysis and Its Applications (1988), Appendix 1; with the
# Michaelis-Menten curve.  Estimates and standard errors are those of R's nls.
CONCENTRATION = np.repeat([0.02, 0.06, 0.11, 0.22, 0.56, 1.10], 2)
VELOCITY = np.array([76.0, 47, 97, 107, 123, 139, 159, 152, 191, 201, 207, 200])


def line(a, b):
    return a + b * cs.DM(X) - cs.DM(-1 + 2 * X + 0.1 * NOISE)


def puromycin(**options):
    c, v = cs.DM(CONCENTRATION), cs.DM(VELOCITY)
    return least_squares(
        lambda vm, k: vm * c / (k + c) - v, [Unknown("Vm", 200.0, 100.0), Unknown("K", 0.1, 0.1, **options)]
    )


class Curve(LeastSquaresResult):
    kind = "curve"

    def predict(self, record):
        raise NotImplementedError


def straight(*, lower=-math.inf):
    return least_squares(line, [Unknown("a", -0.5, lower=lower, unit="m"), Unknown("b", 0.0)])


def test_intervals_of_a_line_are_those_of_linear_regression_both_ways():
    fit = straight()
    reference = stats.linregress(X, -1 + 2 * X + 0.1 * NOISE)
    half = stats.t.ppf(0.975, 38) * np.array([reference.intercept_stderr, reference.stderr])
    centre = np.array([reference.intercept, reference.slope])
    np.testing.assert_allclose(fit.intervals(), np.array([centre - half, centre + half]).T, rtol=1e-8)
    np.testing.assert_allclose(profile_interval(fit, "a"), fit.intervals()[0], rtol=1e-7)
    np.testing.assert_allclose(profile_interval(fit, "b", 0.5), fit.intervals(0.5)[1], rtol=1e-7)
    assert np.diff(fit.intervals(0.99)).min() > np.diff(fit.intervals()).min()


@pytest.mark.parametrize("rigid", [False, True])
def test_data_linear_in_the_coordinate_of_a_stiffness_give_the_intervals_of_a_mean(rigid):
    """The deflection 1/(k + s) has the interval of a mean, also if that reaches beyond 0 or a hinge."""
    beside, deflections = 2.0, (0.005 if rigid else 0.35) + 0.03 * NOISE
    fit = least_squares(lambda k: 1 / (k + beside) - cs.DM(deflections),
                        [Unknown("k", 50.0, 50.0, 0.0, 1e9, offset=beside)])  # fmt: skip
    half = stats.t.ppf(0.975, 39) * stats.sem(deflections)
    least, most = (float(end) for end in deflections.mean() + np.array([-half, half]))
    assert fit.estimates["k"] == pytest.approx(1 / deflections.mean() - beside, rel=1e-6)
    expected = [1 / most - beside, math.inf if least < 0.0 else 1 / least - beside]
    np.testing.assert_allclose(fit.intervals()[0], expected, rtol=1e-6)
    assert math.isinf(expected[1]) == rigid


def test_slopes_of_a_coordinate_are_those_of_differences():
    y = Coordinates.of([Unknown("k", 0.3, 1.0, 0.0, 9.0, offset=2.0), Unknown("E", 3.0, 1.0, 1.0, 9.0, offset=0.0)])
    x, step = np.array([0.3, 3.0]), 1e-6
    np.testing.assert_allclose(y.unknowns(y.at(x)), x, rtol=1e-12)
    change = (y.at(x * (1 + step)) - y.at(x * (1 - step))) / (2 * step)
    np.testing.assert_allclose(y.relative_slopes(y.at(x)), change, rtol=1e-8)
    np.testing.assert_allclose(y.slopes(y.at(x)), x / change, rtol=1e-8)


@pytest.mark.parametrize("bound", [0.0, 0.06, 0.07])
def test_with_a_curved_unknown_held_intervals_are_those_by_profile_likelihood(bound):
    """For given K, the rates are linear in Vm; K is free, or near its bound, or at it."""
    fit = puromycin(lower=bound, curved=True)
    assert fit.at_bound == (("K",) if bound == 0.07 else ())

    def rates(vm, k):
        return cs.vertcat(*(vm * c / (k + c) for c in (0.01, 0.1, 10.0)), k, vm, 3.0)

    found = derived_intervals(fit, rates)
    assert np.isnan(found[-1]).all()
    for j in range(5):
        exact = profile_interval(fit, lambda *x, j=j: rates(*x)[j])
        np.testing.assert_allclose(found[j], exact, atol=1e-2 * (exact[1] - exact[0]))
    first_order = derived_intervals(puromycin(lower=bound), rates)
    assert (np.abs(found - first_order)[:5] / np.ptp(first_order, axis=1)[:5, None]).max() > 0.03


def test_a_curved_unknown_that_is_linear_leaves_first_order_intervals():
    def both(a, b):
        return cs.vertcat(a + b, a - b)

    fit = least_squares(line, [Unknown("a", -0.5), Unknown("b", 0.0, lower=-9.0, upper=9.0, curved=True)])
    np.testing.assert_allclose(derived_intervals(fit, both), derived_intervals(straight(), both), rtol=2e-3)


def test_profile_intervals_of_a_curve_are_where_the_profiled_sum_of_squares_says():
    """The sum of squares has a closed-form profile: for given K, Vm is linear."""
    fit = puromycin()
    np.testing.assert_allclose(fit.values, [212.68, 0.06412], rtol=1e-4)
    np.testing.assert_allclose(fit.errors, [6.947, 0.00828], rtol=2e-3)

    def left(k):
        column = CONCENTRATION / (k + CONCENTRATION)
        return float(np.sum((VELOCITY - column * (column @ VELOCITY) / (column @ column)) ** 2))

    least = left(fit["K"])
    low, high = profile_interval(fit, "K")
    threshold = stats.t.ppf(0.975, 10) ** 2 * least / 10
    assert low < fit["K"] < high
    for end in (low, high):
        assert left(end) - least == pytest.approx(threshold, rel=1e-6)
    assert high - fit["K"] > 1.1 * (fit["K"] - low)  # not symmetric


def test_the_interval_of_a_curved_fit_is_that_by_profile_likelihood():
    """K of the Michaelis-Menten curve, and a power of it; the same data twenty times leave little curvature."""
    fit = puromycin()
    result = Curve(fit, again=lambda _: None)
    assert result.profiled == ("K",)
    assert result.intervals(0.9) == {"Vm": tuple(fit.intervals(0.9)[0]), "K": profile_interval(fit, "K", 0.9)}
    assert "by profile likelihood" in result.report() and result.to_dict()["profiled"] == ["K"]
    c, v, rows = cs.DM(np.tile(CONCENTRATION, 20)), cs.DM(np.tile(VELOCITY, 20)), fit.unknowns
    many = least_squares(lambda vm, k: vm * c / (k + c) - v, rows)
    assert Curve(many, again=lambda _: None).profiled == ()
    assert set(profiles(fit, ("K^4",), lambda vm, k: k**4, 0.95)) == {"K^4"}


def test_a_profile_interval_does_not_depend_on_how_the_quantity_is_stated():
    fit = puromycin()
    low, high = profile_interval(fit, "K")
    np.testing.assert_allclose(profile_interval(fit, lambda vm, k: cs.log(k)), np.log([low, high]), rtol=1e-7)
    assert profile_interval(fit, lambda vm, k: -k) == pytest.approx((-high, -low), rel=1e-7)


def test_intervals_end_at_bounds_and_the_fit_says_so():
    free = straight()
    bound = float(free.intervals()[0, 0]) + 0.01
    fit = straight(lower=bound)
    assert not fit.active_bounds.any()
    assert fit.intervals()[0, 0] == bound
    assert profile_interval(fit, "a") == pytest.approx((bound, free.intervals()[0, 1]), rel=1e-7)
    assert any(note.startswith(f"a does not differ significantly from its bound {bound:g}") for note in fit.warnings)
    assert not any("differ significantly" in note for note in straight(lower=bound - 0.02).warnings)


def test_an_interval_at_a_bound_is_one_sided_and_both_ways_agree_for_a_line():
    """The sum of squares there is left(a) = s + (a - a*)^2/C, with a* below the bound."""
    free = straight()
    bound = free["a"] + free.standard_errors["a"]
    fit = straight(lower=bound)
    low, high = fit.intervals()[0]
    assert fit.active_bounds.tolist() == [True, False]
    assert low == bound
    assert profile_interval(fit, "a") == pytest.approx((low, high), rel=1e-7)
    variance = float(fit.residuals @ fit.residuals) / 39
    unit = free.standard_errors["a"] ** 2 * 38 / float(free.residuals @ free.residuals)
    rise = ((high - free["a"]) ** 2 - (bound - free["a"]) ** 2) / unit
    assert rise == pytest.approx(stats.t.ppf(0.975, 39) ** 2 * variance, rel=1e-7)
    below = least_squares(lambda a, b: line(-a, b), [Unknown("a", 0.0, upper=-bound), Unknown("b", 0.0)])
    assert below.intervals()[0] == pytest.approx((-high, -low), rel=1e-7)


def test_a_quantity_of_an_unknown_at_its_bound_has_its_interval():
    fit = straight(lower=-0.5)
    np.testing.assert_allclose(
        derived_intervals(fit, lambda a, b: cs.vertcat(-2 * a, b, 7)),
        [-2 * fit.intervals()[0][::-1], fit.intervals()[1], [math.nan, math.nan]],
        rtol=1e-12,
    )


def test_a_fit_that_starts_at_its_solution_stays_there_though_an_unknown_is_at_its_bound():
    """A decay without friction: pushed off its bound by 0.01, friction of that size would drive the others away."""
    time = np.linspace(0.0, 1.0, 201)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(201)
    y = cs.DM(np.exp(-time) * np.cos(40 * time) + noise)

    def decay(rate, friction, frequency):
        return (cs.exp(-rate * cs.DM(time)) - friction * cs.DM(time)) * cs.cos(frequency * cs.DM(time)) - y

    unknowns = [Unknown("rate", 0.9, lower=0.0), Unknown("friction", 0.05, lower=0.0), Unknown("frequency", 40.1)]
    fit = least_squares(decay, unknowns)
    assert fit.active_bounds.tolist() == [False, True, False]
    again = least_squares(decay, with_guesses(fit.unknowns, fit.estimates))
    assert again.values == pytest.approx(fit.values, rel=1e-8, abs=1e-12)
    assert again.iterations < fit.iterations / 2


def test_outliers_are_borne():
    """One value in ten has an error of fifty times the noise, which hardly affects the pseudo-Huber loss."""
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 3.0, 400)
    y = -1 + 2 * x + 0.1 * rng.standard_normal(400) + np.where(rng.random(400) < 0.1, 5.0, 0.0)

    def residuals(a, b):
        return a + b * cs.DM(x) - cs.DM(y)

    unknowns = [Unknown("a", 0.0), Unknown("b", 0.0)]
    plain, robust = least_squares(residuals, unknowns), least_squares(residuals, unknowns, huber=0.1345)
    assert abs(plain["a"] + 1) > 0.3
    assert abs(robust["a"] + 1) < 4 * robust.standard_errors["a"] < 0.08
    assert robust["b"] == pytest.approx(2.0, abs=4 * robust.standard_errors["b"])
    assert profile_interval(robust, "b") == pytest.approx(robust.intervals()[1], rel=1e-2)


@pytest.mark.slow
def test_a_robust_fit_knows_its_scatter():
    """300 fits with noise of Student's distribution, 2 degrees of freedom, whose variance is infinite."""
    rng = np.random.default_rng(4)
    fits = []
    for _ in range(300):
        y = cs.DM(-1 + 2 * X + 0.1 * rng.standard_t(2, len(X)))
        unknowns = [Unknown("a", 0.0), Unknown("b", 0.0)]
        fits.append(least_squares(lambda a, b, y=y: a + b * cs.DM(X) - y, unknowns, huber=0.15))
    scatter = np.std([fit.values for fit in fits], axis=0)
    errors = np.sqrt(np.mean([fit.errors**2 for fit in fits], axis=0))
    np.testing.assert_allclose(scatter / errors, 1.0, atol=0.15)
    covered = [(fit.intervals()[:, 0] < [-1, 2]) & (fit.intervals()[:, 1] > [-1, 2]) for fit in fits]
    assert 0.92 <= np.mean(covered) <= 0.98


def test_least_squares_is_the_limit_of_the_robust_loss():
    robust = least_squares(line, [Unknown("a", 0.0, unit="m"), Unknown("b", 0.0)], huber=1e3)
    np.testing.assert_allclose(robust.values, straight().values, rtol=1e-6)
    np.testing.assert_allclose(robust.covariance, straight().covariance, rtol=1e-6)


def test_rank_condition_and_correlations_are_those_of_the_jacobian():
    fit = straight()
    columns = np.column_stack([np.ones(40), X])
    columns /= np.linalg.norm(columns, axis=0)
    assert (fit.rank, fit.degrees_of_freedom) == (2, 38)
    assert fit.condition == pytest.approx(np.linalg.cond(columns))
    assert fit.correlations[0, 1] == pytest.approx(-0.86, abs=0.01)
    np.testing.assert_allclose(np.diag(fit.correlations), 1.0)
    assert straight(lower=-0.5).rank == 1


@pytest.mark.parametrize(("noise", "named"), [(0.0, False), (0.3, False), (1.0, True)])  # errors of 0, 2.6, 8.8 %
def test_unknowns_hardly_told_apart_are_named(noise, named):
    exact, x = -1 + 2 * X, cs.DM(X)
    far = least_squares(
        lambda a, b: a + b * (x - 100) - cs.DM(exact + noise * NOISE), [Unknown("a", 0.0), Unknown("b", 0.0)]
    )
    assert abs(far.correlations[0, 1]) > 0.999
    assert any("a and b (1.000) are strongly correlated" in note for note in far.warnings) == named


def test_the_result_reads_as_text_and_as_json():
    fit = straight(lower=-0.5)
    table = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    a, b = table["unknowns"]
    assert (a["name"], a["unit"], a["value"], a["standard_error"], a["at_bound"]) == ("a", "m", -0.5, None, True)
    assert a["bounds"] == [-0.5, None]
    assert b["interval_95"] == fit.intervals()[1].tolist()
    assert table["covariance"][1][1] == fit.covariance[1, 1]
    assert table["rank"] == 1
    lines = fit.lines()
    assert "1 of 2 unknowns free of bounds, condition number 1" in lines
    assert lines[-1] == f"converged after {fit.iterations} iterations"
    assert fit.warnings[0].startswith("a is at its bound -0.5")


def test_the_text_says_nothing_of_a_correlation_that_is_unknown():
    single = least_squares(lambda a: cs.vertcat(a - 1, a - 2), [Unknown("a", 0.0)], noise=AssumedNoise([1, 1]))
    assert math.isnan(single.autocorrelation) and single.to_dict()["autocorrelation"] is None
    assert "correlate" not in single.lines()[0]
    assert "successive residuals correlate at" in straight().lines()[0]


def test_as_many_residuals_as_unknowns_give_no_interval():
    fit = least_squares(lambda a, b: cs.vertcat(a - 1, a * b - 6), [Unknown("a", 2.0), Unknown("b", 2.0)])
    np.testing.assert_allclose(fit.values, [1.0, 6.0], rtol=1e-9)
    assert np.isnan(fit.errors).all() and np.isnan(fit.intervals()).all()
    with pytest.raises(InputError, match="fit: has no scatter"):
        profile_interval(fit, "a")


@pytest.mark.parametrize(
    ("request_of", "message"),
    [
        *(
            (lambda level=level: straight().intervals(level), "level: must be")
            for level in (0.0, 1.0, math.nan, "high")
        ),
        (lambda: profile_interval(straight(), "a", -1.0), "level: must be"),
        (lambda: profile_interval(straight(), "c"), "c: is not an unknown of the fit"),
        (lambda: least_squares(line, [Unknown("a", 0.0), Unknown("b", 0.0)], huber=0.0), "huber: must be positive"),
    ],
)
def test_unusable_requests_are_refused(request_of, message):
    with pytest.raises(InputError, match=message):
        request_of()


def test_the_quantile_is_students():
    for freedom in (1, 10, 5000):
        assert quantile(0.95, freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-10)


def noisy_line(a, b, change=0.0):
    return a + b * cs.DM(X) - cs.DM(-1 + 2 * X + 0.1 * NOISE) + cs.DM(change * np.ones(len(X)))


@pytest.mark.parametrize("huber", [math.inf, 0.1])
def test_shifts_are_those_of_a_fit_to_changed_data_in_standard_errors(huber):
    small = 1e-4 * np.sin(5 * X)
    unknowns = [Unknown("a", -0.5, 10.0), Unknown("b", 0.0, 0.1)]
    fit = least_squares(noisy_line, unknowns, huber=huber)
    moved = least_squares(lambda a, b: noisy_line(a, b, 1e-4 * np.sin(5 * X)), unknowns, huber=huber)
    expected = (moved.values - fit.values) / fit.errors
    assert abs(expected).min() > 1e-5
    np.testing.assert_allclose(fit.shifts(small), expected, rtol=2e-3)


def test_at_a_bound_the_shift_is_that_without_the_bound_by_the_reach_inwards():
    fit = least_squares(noisy_line, [Unknown("a", -0.5, lower=-0.5), Unknown("b", 0.0)])
    free = least_squares(noisy_line, [Unknown("a", -0.5), Unknown("b", 0.0)])
    change = 1e-3 * X**2
    assert fit.active_bounds.tolist() == [True, False]
    low, high = fit.intervals()[0]
    error = (high - low) / quantile(0.95, fit.degrees_of_freedom)
    expected = free.shifts(change)[0] * free.errors[0] / error
    assert fit.shifts(change)[0] == pytest.approx(expected, rel=1e-9)
    alone = least_squares(lambda b: noisy_line(-0.5, b), [Unknown("b", 0.0)])
    assert fit.shifts(change)[1] == pytest.approx(alone.shifts(change)[0], rel=1e-9)


def test_a_systematic_error_within_what_is_allowed_for_shifts_no_unknown_beyond_its_standard_error():
    """The worst error of that size is along the part of a column that the other unknowns cannot compensate."""
    unknowns = [Unknown("a", -0.5), Unknown("b", 0.0)]
    exact = lambda a, b: a + b * cs.DM(X) - cs.DM(-1 + 2 * X)  # noqa: E731
    fit = least_squares(exact, unknowns, systematic=1e-3)
    assert fit.residual_rms < 1e-9
    worst = X - X.mean()
    worst *= 1e-3 / math.sqrt(np.mean(worst**2))
    moved = least_squares(lambda a, b: exact(a, b) + cs.DM(worst), unknowns)
    assert abs(moved["b"] - fit["b"]) == pytest.approx(fit.standard_errors["b"], rel=1e-6)
    other = 1e-3 * math.sqrt(2) * np.sin(40 * X)
    assert abs(fit.shifts(other)).max() < 0.5
    noisy = least_squares(line, unknowns, systematic=1e-3)
    plain = least_squares(line, unknowns)
    allowed = 40 * 1e-6 * np.linalg.inv(plain.jacobian.T @ plain.jacobian)
    np.testing.assert_allclose(noisy.covariance, plain.covariance + allowed, rtol=1e-9)
    low, high = profile_interval(noisy, "b")
    np.testing.assert_allclose([low, high], noisy.intervals()[1], rtol=1e-7)


def test_residuals_that_are_not_noise_are_told_of_unless_they_are_within_the_noise_free():
    x = np.linspace(0.0, 3.0, 400)
    white = np.random.default_rng(1).standard_normal(400)
    coloured = np.convolve(np.random.default_rng(1).standard_normal(407), np.ones(8), "valid")

    def fit(noise):
        unknowns = [Unknown("a", -0.5), Unknown("b", 0.0)]
        return least_squares(lambda a, b: a + b * cs.DM(x) - cs.DM(noise), unknowns, noise=AssumedNoise([400]))

    assert colour_warning(fit(white)) is None
    biased = fit(coloured)
    assert biased.effective_samples < 100
    assert f"the 400 residuals are not noise and determine the unknowns as well as {biased.effective_samples:.0f} " in (
        colour_warning(biased)
    )
    assert (biased.errors > 2 * biased.white_errors).all()
    assert "times those for white" in biased.colour()
    assert biased.to_dict()["unknowns"][0]["standard_error_white"] == pytest.approx(biased.white_errors[0])
    assert colour_warning(biased, noise_free=2 * math.sqrt(np.mean(coloured**2))) is None


@pytest.mark.parametrize("lower", [-math.inf, 0.5])
def test_profile_intervals_allow_for_coloured_residuals(lower):
    """For a line, both intervals are the same, also that of an intercept at its bound."""
    x = np.linspace(0.0, 3.0, 400)
    coloured = np.convolve(np.random.default_rng(1).standard_normal(407), np.ones(8), "valid")
    unknowns = [Unknown("a", 1.0, lower=lower), Unknown("b", 0.0)]
    fit = least_squares(lambda a, b: a + b * cs.DM(x) - cs.DM(coloured), unknowns, noise=AssumedNoise([400]))
    assert fit.at_bound == ("a",) * math.isfinite(lower)
    for k, name in enumerate(fit.names[: 1 if fit.at_bound else 2]):
        np.testing.assert_allclose(profile_interval(fit, name), fit.intervals()[k], rtol=1e-6)
