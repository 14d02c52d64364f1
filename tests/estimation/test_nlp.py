"""Least squares and nonlinear programs: certified values, closed forms, bounds, and all failures."""

import io
import math
import re
import sys
from functools import partial

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, frequency_response, reduce_model
from ancf_casadi.estimation.fit import SolverSettings
from ancf_casadi.estimation.solver import gauss_newton
from ancf_casadi.estimation.solver.gauss_newton import loss
from ancf_casadi.estimation.solver.least_squares import TIGHT, least_squares
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support import progress
from problems import FrequencyRecord, fit_beam, fit_mode

# NIST StRD, Misra1a (Misra 1978): y = b1 (1 - exp(-b2 x)), with certified estimates and standard deviations.
MISRA_X = [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0]
MISRA_Y = [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78]
MISRA = np.array([2.3894212918e02, 5.5015643181e-04])
MISRA_ERRORS = np.array([2.7070075241e00, 7.2668688436e-06])
MISRA_RESIDUAL_SUM = 1.2455138894e-01

X = np.linspace(0.0, 3.0, 40)
NOISE = np.random.default_rng(1).standard_normal(40)


def misra(b1, b2):
    return b1 * (1 - cs.exp(-b2 * cs.DM(MISRA_X))) - cs.DM(MISRA_Y)


def line(a, b):
    """A line with slope 2, intercept -1 and noise 0.1."""
    return a + b * cs.DM(X) - cs.DM(-1 + 2 * X + 0.1 * NOISE)


@pytest.mark.parametrize("start", [(500.0, 0.0001), (250.0, 0.0005)])
def test_certified_values_and_standard_errors_from_both_published_starts(start):
    fit = least_squares(misra, [Unknown("b1", start[0], 100.0), Unknown("b2", start[1], 1e-4)])
    np.testing.assert_allclose(fit.values, MISRA, rtol=1e-9)
    np.testing.assert_allclose(fit.errors, MISRA_ERRORS, rtol=1e-9)
    assert fit.residuals @ fit.residuals == pytest.approx(MISRA_RESIDUAL_SUM, rel=1e-9)
    assert fit.residual_rms == pytest.approx(math.sqrt(MISRA_RESIDUAL_SUM / 14), rel=1e-9)
    assert not fit.active_bounds.any()


def test_a_line_has_the_covariance_of_linear_regression():
    fit = least_squares(line, [Unknown("a", 0.0), Unknown("b", 0.0)])
    slope_intercept, covariance = np.polyfit(X, -1 + 2 * X + 0.1 * NOISE, 1, cov=True)
    np.testing.assert_allclose(fit.values, slope_intercept[::-1], rtol=1e-10)
    np.testing.assert_allclose(fit.covariance, covariance[::-1, ::-1], rtol=1e-9)
    assert fit["b"] == fit.values[1]
    assert fit.standard_errors["b"] == math.sqrt(fit.covariance[1, 1])
    assert fit.correlations[0, 1] == pytest.approx(covariance[0, 1] / math.sqrt(np.prod(np.diag(covariance))))


def test_units_of_the_unknowns_do_not_change_the_answer():
    plain = least_squares(line, [Unknown("a", 0.0), Unknown("b", 0.0)])
    scaled = least_squares(lambda a, b: line(a * 1e6, b), [Unknown("a", 0.0, 1e-6), Unknown("b", 0.0, 10.0)])
    np.testing.assert_allclose(scaled.values * [1e6, 1], plain.values, rtol=1e-9)
    np.testing.assert_allclose(scaled.errors * [1e6, 1], plain.errors, rtol=1e-9)


def test_an_unknown_at_its_bound_is_taken_as_known():
    fit = least_squares(line, [Unknown("a", -0.5, lower=-0.5), Unknown("b", 0.0)])
    alone = least_squares(lambda b: line(-0.5, b), [Unknown("b", 0.0)])
    assert fit.active_bounds.tolist() == [True, False]
    assert fit["a"] == -0.5
    assert fit["b"] == pytest.approx(alone["b"], rel=1e-9)
    assert math.isnan(fit.standard_errors["a"])
    assert math.isnan(fit.correlations[0, 1])
    assert fit.standard_errors["b"] == pytest.approx(alone.standard_errors["b"], rel=1e-9)


def test_a_minimum_that_just_touches_a_bound_is_at_the_bound():
    fit = least_squares(lambda a, b: a + b * cs.DM(X) - 2 * cs.DM(X), [Unknown("a", 1.0, lower=0.0), Unknown("b", 0.0)])
    assert fit["a"] == 0.0
    assert fit.active_bounds.tolist() == [True, False]
    assert fit["b"] == pytest.approx(2.0, rel=1e-8)


def test_standard_errors_of_derived_quantities_agree_with_differences():
    fit = least_squares(misra, [Unknown("b1", 250.0, 100.0), Unknown("b2", 5e-4, 1e-4)])
    values, errors = fit.derived(lambda b1, b2: cs.vertcat(b1 * b2, cs.log(b1), 7))

    def quantities(b):
        return np.array([b[0] * b[1], np.log(b[0]), 7])

    steps = 1e-5 * fit.values
    slopes = [(quantities(fit.values + d) - quantities(fit.values - d)) / 2 for d in np.diag(steps)]
    slopes = np.array(slopes).T / steps
    np.testing.assert_allclose(values, quantities(fit.values))
    np.testing.assert_allclose(errors[:2] ** 2, np.diag(slopes @ fit.covariance @ slopes.T)[:2], rtol=1e-6)
    assert math.isnan(errors[2])


def test_a_quantity_of_an_unknown_at_its_bound_has_no_standard_error():
    fit = least_squares(line, [Unknown("a", -0.5, lower=-0.5), Unknown("b", 0.0)])
    _, errors = fit.derived(lambda a, b: cs.vertcat(2 * a, a + b))
    assert math.isnan(errors[0])
    assert errors[1] == pytest.approx(fit.standard_errors["b"])


@pytest.mark.parametrize("huber", [math.inf, 0.1])
@pytest.mark.parametrize("closed_form", [True, False])
def test_the_minimum_is_that_of_ipopt_with_second_derivatives(huber, closed_form):
    """Two unknowns that correlate at 0.999; without a closed form, the steps end within 1 % of an error."""
    b = cs.MX.sym("b", 2)
    exact = solve_nlp({"x": b, "f": 1e6 * loss(misra(100 * b[0], 1e-4 * b[1]), huber)}, np.array([2.5, 5.0])).x
    unknowns = [Unknown("b1", 500.0, 100.0), Unknown("b2", 1e-4, 1e-4)]
    fit = least_squares(misra, unknowns, huber=huber, settings=SolverSettings(closed_form))
    assert (abs(fit.values - exact * [100.0, 1e-4]) < (1e-4 if closed_form else 0.01) * fit.errors).all()


@pytest.mark.parametrize("closed_form", [True, False])
def test_the_minimum_stays_within_the_bounds(closed_form):
    unknowns = [Unknown("a", 0.5, lower=-0.5), Unknown("b", 0.0, upper=1.5)]
    fit = least_squares(line, unknowns, settings=SolverSettings(closed_form))
    assert fit.active_bounds.tolist() == [False, True] and fit["b"] == 1.5
    assert fit["a"] == pytest.approx(np.mean(-1 + 0.5 * X + 0.1 * NOISE), rel=1e-9)


def test_nothing_is_printed(capfd):
    least_squares(line, [Unknown("a", 0.0), Unknown("b", 0.0)])
    with pytest.raises(FitError):
        least_squares(lambda a: cs.log(a) - cs.DM([1, 2]), [Unknown("a", -1.0)])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": 0.0}, "a: scale: must be positive"),
        ({"scale": math.nan}, "a: scale: must be a finite number"),
        ({"lower": 2.0, "upper": 1.0}, "a: the lower bound 2 is not below the upper 1"),
        ({"lower": math.nan}, "a: the lower bound nan is not below"),
        ({"upper": -1.0}, r"a: the guess 0 is not within \[-inf, -1\]"),
        ({"guess": math.inf}, "a: the guess inf is not within"),
    ],
)
def test_unusable_unknowns_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        Unknown(**{"name": "a", "guess": 0.0, **changes})


@pytest.mark.parametrize(
    ("residuals", "unknowns", "message"),
    [
        (line, [Unknown("a", 0.0)] * 2, "unknowns: share a name: a, a"),
        (lambda a, b: a + b, [Unknown("a", 0.0), Unknown("b", 0.0)], "residuals: 1 values cannot determine 2 unknowns"),
        (lambda a, b, c: a + (b + c) * cs.DM(X), [Unknown(name, 1.0) for name in "abc"], "do not determine b, c"),
        (lambda a: 0 * a + cs.DM(X), [Unknown("a", 0.0)], "derivatives of the residuals are zero"),
        (lambda a: cs.sqrt(a) - cs.DM(X), [Unknown("a", -1.0)], "derivatives of the residuals are not finite"),
    ],
)
def test_residuals_that_determine_nothing_are_refused(residuals, unknowns, message):
    with pytest.raises((InputError, FitError), match=message):
        least_squares(residuals, unknowns)


def test_a_fit_that_does_not_converge_says_what_to_try(monkeypatch):
    monkeypatch.setattr(gauss_newton, "MOST_STEPS", 2)
    unknowns = [Unknown("b1", 500.0, 100.0), Unknown("b2", 1e-4, 1e-4)]
    with pytest.raises(FitError, match="2 Gauss-Newton steps do not converge; start closer") as caught:
        least_squares(misra, unknowns, settings=SolverSettings(closed_form=False))
    assert caught.value.stats == {"iter_count": 2}
    np.testing.assert_allclose(least_squares(misra, unknowns).values, MISRA, rtol=1e-8)  # by IPOPT
    monkeypatch.setitem(TIGHT, "ipopt.max_iter", 2)
    with pytest.raises(FitError, match=r"Maximum_Iterations_Exceeded.*raise 'ipopt.max_iter'") as caught:
        least_squares(misra, unknowns)
    assert caught.value.stats["iter_count"] == 2


def test_a_constrained_problem_reaches_its_published_minimum():
    """Hock and Schittkowski (1981), problem 71: minimum 17.0140173 at (1, 4.7429994, 3.8211503, 1.3794082)."""
    x = cs.MX.sym("x", 4)
    nlp = {
        "x": x,
        "f": x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
        "g": cs.vertcat(x[0] * x[1] * x[2] * x[3], cs.sumsqr(x)),
    }
    solution = solve_nlp(
        nlp,
        np.array([1.0, 5.0, 5.0, 1.0]),
        lower=1.0,
        upper=5.0,
        constraint_lower=np.array([25.0, 40.0]),
        constraint_upper=np.array([math.inf, 40.0]),
    )
    np.testing.assert_allclose(solution.x, [1.0, 4.7429994, 3.8211503, 1.3794082], atol=1e-6)
    assert solution.objective == pytest.approx(17.0140173, abs=1e-6)
    assert solution.iterations > 0
    assert 0.0 < solution.solve_seconds < 10.0


def test_options_reach_the_solver():
    x = cs.MX.sym("x", 2)
    rosenbrock = {"x": x, "f": (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2}
    start = np.array([-1.2, 1.0])
    exact = solve_nlp(rosenbrock, start)
    secant = solve_nlp(rosenbrock, start, options={"ipopt.hessian_approximation": "limited-memory"})
    np.testing.assert_allclose(secant.x, [1.0, 1.0], rtol=1e-6)
    assert secant.iterations > exact.iterations


@pytest.mark.parametrize(
    ("objective", "constraint", "options", "message"),
    [
        (lambda x: cs.sum1(x), lambda x: cs.sumsqr(x) + 1, {}, "Infeasible_Problem_Detected.*widen the bounds"),
        (lambda x: cs.sum1(x), lambda x: cs.MX(0, 1), {}, "Diverging_Iterates.*diverged"),
        (lambda x: cs.sumsqr(cs.log(x - 5)), lambda x: cs.MX(0, 1), {}, "Invalid_Number_Detected.*not finite"),
        (lambda x: cs.sumsqr(x), lambda x: cs.MX(0, 1), {"ipopt.linear_solver": "ma27"}, "Invalid_Option"),
        (lambda x: cs.sumsqr(x), lambda x: cs.MX(0, 1), {"ipopt.nonsense": 1}, "No such IPOPT option: nonsense"),
        (lambda x: cs.sumsqr(x) + cs.MX.sym("p"), lambda x: cs.MX(0, 1), {}, r"variables \[p\] are free"),
    ],
)
def test_every_failure_is_one_short_error(objective, constraint, options, message, capfd):
    x = cs.MX.sym("x", 2)
    with pytest.raises(FitError, match=message) as caught:
        solve_nlp({"x": x, "f": objective(x), "g": constraint(x)}, np.array([1.0, 2.0]), options=options)
    assert len(str(caught.value)) < 400
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    assert capfd.readouterr().out == ""


class Terminal(io.StringIO):
    def isatty(self):
        return True


def watched_terminal(monkeypatch):
    """Standard error as a terminal, on which counters appear at once."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(progress, "BAR_DELAY", 0.0)
    monkeypatch.setattr(progress, "tqdm", partial(progress.tqdm, mininterval=0.0))
    return terminal


def test_a_terminal_shows_the_iterations_and_the_solution_is_the_same(monkeypatch):
    """A long solution proceeds visibly."""
    terminal = watched_terminal(monkeypatch)
    x = cs.MX.sym("x", 2)
    problem = {"x": x, "f": 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2, "g": x[0] + x[1]}
    bounds = {"constraint_lower": -10.0, "constraint_upper": 10.0}
    silent = solve_nlp(problem, np.array([-1.2, 1.0]), **bounds)
    assert terminal.getvalue() == ""
    with progress.counter("fit"):
        shown = solve_nlp(problem, np.array([-1.2, 1.0]), **bounds)
    assert re.search(rf"fit: {silent.iterations} steps, 00:\d\d, +[\d.]+ steps/s", terminal.getvalue())
    np.testing.assert_array_equal(shown.x, silent.x)


def small_beam():
    return Model(Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=2e11, elements=2))


def fit_of_a_beam():
    model = small_beam()
    record = FrequencyRecord(model, [1.9, 10.8], std=[0.01, 0.05])
    fit_beam(model, record, unknowns=["elastic_modulus"], progress=True)


def fit_of_a_mode():
    time = np.arange(200) / 50.0
    noise = 1e-5 * np.random.default_rng(0).standard_normal(200)
    fit_mode((time, 0.01 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise), progress=True)


def curve_of_a_beam():
    reduced = reduce_model(small_beam(), modes=1, damping=RayleighDamping(alpha=0.3))
    base = HarmonicBase(amplitude=1e-4, frequency=10.0)
    with progress.counter("response"):
        frequency_response(reduced, (1.6, 1.7), base=base, points=3)


@pytest.mark.parametrize("work", [fit_of_a_beam, fit_of_a_mode, curve_of_a_beam])
def test_long_work_shows_its_progress(monkeypatch, work):
    terminal = watched_terminal(monkeypatch)
    work()
    assert re.search(r"(fit|response): [1-9]\d* steps, 00:\d\d, +[\d.]+ steps/s", terminal.getvalue())
