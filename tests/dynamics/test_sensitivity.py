"""Derivatives of a motion against differences of tightly integrated motions, forward ones against reverse ones."""

import gc
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    motion,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.derivatives import runs as module
from ancf_casadi.dynamics.derivatives.run import Run
from ancf_casadi.dynamics.derivatives.sensitivity import Problem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.exceptions import SimulationError

BASE = HarmonicBase(0.02, 3.0, stop=0.15)
SETTINGS = {"duration": 0.24, "sample_rate": 100.0, "tolerance": 1e-7}


@pytest.fixture(scope="module")
def model():
    """A soft strip of silicone, hanging."""
    return Model(
        Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=3)
    )


@pytest.fixture(scope="module")
def law(model):
    modes = natural_modes(model, count=2)
    return RayleighDamping(alpha=0.6, beta=2e-3) + QuadraticDamping(eta2=2.0) + ModalDamping(modes, (0.03, 0.02))


def values(law, model):
    return [np.array([parameter.value for parameter in law.parameters]), np.array([BASE.amplitude]), model.properties]


@pytest.fixture(scope="module", params=["equilibrium", "straight", "impact", "released"])
def case(request, model, law):
    """A motion, its values, and its tip as an expression of symbols."""
    start = static_equilibrium(model, tip_force=(0.002, 0.0)) if request.param == "released" else request.param
    function = motion(model, damping=law, base=BASE, start=start, **SETTINGS)
    symbols = [cs.MX.sym(name, *function.size_in(k)) for k, name in enumerate("abc")]
    return start, function, symbols, function(*symbols)[-4:-2, :]


@pytest.mark.slow
def test_the_function_gives_the_motion_that_simulate_finds(case, model, law):
    start, function, _, _ = case
    run = simulate(model, damping=law, base=BASE, start=start, method="radau", **SETTINGS)
    found = function(*values(law, model)).full().T
    assert np.ptp(run.tip, axis=0).max() > 0.01
    assert abs(found - run.coordinates).max() < 1e-6 * model.beam.length


@pytest.mark.slow
@pytest.mark.parametrize("place", [0, 1])
def test_derivatives_are_those_of_a_tightly_integrated_motion_at_two_points(case, model, law, place):
    """Central differences of runs at 1e-9; the law, the amplitude, and all thicknesses, densities and moduli."""
    start, _, symbols, tip = case
    at = [part * (1.0 + 0.05 * place) for part in values(law, model)]
    jacobian = cs.Function("J", symbols, [cs.jacobian(tip, symbol) for symbol in symbols])
    found = [part.full() for part in jacobian(*at)]
    tight = motion(model, damping=law, base=BASE, start=start, **SETTINGS | {"tolerance": 1e-9})

    def difference(k, direction):
        step = 2e-3
        ends = []
        for sign in (1, -1):
            moved = [part.copy() for part in at]
            moved[k] = at[k] + sign * step * direction
            ends.append(tight(*moved).full()[-4:-2].ravel(order="F"))
        return (ends[0] - ends[1]) / (2 * step)

    unit = np.eye(at[0].size)
    directions = [(0, at[0] * unit[j]) for j in range(at[0].size)] + [(1, at[1])]
    directions += [(2, at[2] * (np.arange(4) == j)[:, None]) for j in (1, 2, 3)]
    for k, direction in directions:
        expected = difference(k, direction)
        assert abs(expected).max() > 1e-6  # m, for a change as large as the value
        np.testing.assert_allclose(
            found[k] @ direction.ravel(order="F"), expected, atol=1e-3 * abs(expected).max() + 2e-8
        )


@pytest.mark.slow
def test_reverse_derivatives_are_the_transposed_of_the_forward_ones(case, law, model):
    _, _, symbols, tip = case
    at = values(law, model)
    weights = cs.DM(np.random.default_rng(1).normal(size=tip.shape))
    forward = cs.Function("J", symbols, [cs.jacobian(tip, symbol) for symbol in symbols[:2]])(*at)
    products = [cs.jtimes(cs.vec(tip), symbol, cs.vec(weights), True) for symbol in symbols]
    reverse = cs.Function("G", symbols, products)(*at)
    for one, other in zip(forward, reverse, strict=False):
        np.testing.assert_allclose(other.full().ravel(), (one.T @ cs.vec(weights)).full().ravel(), rtol=1e-8)
    direction = np.random.default_rng(2).normal(size=model.properties.shape) * model.properties
    along = cs.Function("D", symbols, [cs.jtimes(cs.vec(tip), symbols[2], cs.DM(direction))])(*at)
    assert float(cs.dot(along, cs.vec(weights))) == pytest.approx(float(cs.dot(reverse[2], direction)), rel=1e-8)


def test_a_motion_stands_in_an_expression_and_its_gradient_finds_the_damping_it_was_made_with(model):
    """Take Gauss-Newton steps from 20 % off, by the derivatives of the expression."""
    law = RayleighDamping(alpha=0.6)
    function = motion(model, damping=law, base=BASE, **SETTINGS)
    fixed = [np.array([BASE.amplitude]), model.properties]
    alpha = cs.MX.sym("alpha")
    measured = function(np.array([0.6]), *fixed)[-4, :]
    misfit = (function(alpha, *fixed)[-4, :] - measured).T
    step = cs.Function("step", [alpha], [misfit, cs.jacobian(misfit, alpha)])
    value = 0.72
    for _ in range(3):
        residual, jacobian = (part.full().ravel() for part in step(value))
        value -= (jacobian @ residual) / (jacobian @ jacobian)
    assert value == pytest.approx(0.6, rel=1e-6)


def test_the_derivative_by_an_amplitude_that_grows_is_that_of_differences(model):
    base, amplitude = replace(BASE, ramp=0.3), cs.MX.sym("amplitude")
    tip = motion(model, base=base, **SETTINGS)(np.zeros(0), amplitude, model.properties)[-4, :]
    exact = cs.Function("exact", [amplitude], [tip, cs.jacobian(tip, amplitude)])
    above, (_, slopes), below = (
        [part.full().ravel() for part in exact(BASE.amplitude * factor)] for factor in (1.001, 1.0, 0.999)
    )
    differences = (above[0] - below[0]) / (2e-3 * BASE.amplitude)
    assert abs(slopes).max() > 0.1
    np.testing.assert_allclose(slopes, differences, atol=1e-4 * abs(slopes).max())


def test_values_without_a_motion_give_nan_and_a_warning(model):
    function = motion(model, base=BASE, **SETTINGS)
    at = [np.zeros(0), np.array([BASE.amplitude]), model.properties.copy()]
    at[2][3] = -1.0
    with pytest.warns(RuntimeWarning, match="elastic_modulus"):
        found = function(*at)
    assert np.isnan(found.full()).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"duration": 0.0}, "duration: must be positive"), ({"tolerance": -1.0}, "tolerance: must be positive")],
)
def test_settings_that_make_no_sense_are_refused(model, settings, message):
    with pytest.raises(InputError, match=message):
        motion(model, **{"duration": 0.1} | settings)


def runs_alive():
    gc.collect()
    return sum(isinstance(one, Run) for one in gc.get_objects())


@pytest.mark.slow
def test_expressions_keep_a_motion_alive_and_without_them_its_steps_are_freed(model):
    settings = SETTINGS | {"duration": 0.05, "base": BASE, "start": "equilibrium"}
    motion(model, **settings)  # a new Function drops the runs of those that are gone
    gone = runs_alive()
    x = cs.MX.sym("x")
    at = [np.zeros(0), x, model.properties]
    tip = motion(model, **settings)(*at)[-4:-2, -1]
    value, derivative = cs.Function("f", [x], [tip]), cs.Function("J", [x], [cs.jacobian(tip, x)])
    del tip
    assert runs_alive() == gone  # nothing was computed yet
    h = 1e-4
    difference = (value(0.02 + h) - value(0.02 - h)).full() / (2 * h)
    assert runs_alive() == gone + 1  # the last run alone, however many there were
    del value
    np.testing.assert_allclose(derivative(0.02).full(), difference, rtol=1e-3)
    del derivative
    motion(model, **settings)
    assert runs_alive() == gone


def test_a_function_of_derivatives_alone_keeps_the_motion_alive(model):
    function = motion(model, **SETTINGS | {"duration": 0.05, "base": BASE, "start": "equilibrium"})
    at = [np.zeros(0), 0.02, model.properties]
    forward, there = function.forward(1), function(*at)
    seeds = [np.zeros(0), 1.0, np.zeros(model.properties.shape)]
    before = forward(*at, there, *seeds).full()
    del function
    motion(model, **SETTINGS)
    gc.collect()
    np.testing.assert_array_equal(forward(*at, there, *seeds).full(), before)
    assert abs(before).max() > 0.1


def test_a_motion_is_integrated_once_for_its_value_and_all_its_derivatives(model, law, monkeypatch):
    solve, seen = Problem.solve, []
    monkeypatch.setattr(Problem, "solve", lambda *given: (seen.append(1), solve(*given))[1])
    function = motion(model, damping=law, base=BASE, start="equilibrium", **SETTINGS | {"duration": 0.05})
    symbols = [cs.MX.sym(name, *function.size_in(k)) for k, name in enumerate("abc")]
    tip = function(*symbols)[-4:-2, :]
    outputs = [tip, cs.jacobian(tip, symbols[0]), cs.gradient(cs.sumsqr(tip), symbols[2])]
    cs.Function("f", symbols, outputs)(*values(law, model))
    assert len(seen) == 1


def test_a_motion_of_too_many_steps_is_given_up(model, monkeypatch):
    settings = SETTINGS | {"duration": 0.05, "base": BASE, "start": "equilibrium"}
    at = [np.zeros(0), np.array([0.02]), model.properties.copy()]
    unlimited = motion(model, **settings)
    with pytest.warns(RuntimeWarning, match=r"too many steps: 3 up to 0\.0\d+ s, the last of them \S+ s long; try"):
        assert np.isnan(motion(model, **settings, most_steps=3)(*at).full()).all()
    assert np.isfinite(unlimited(*at).full()).all()
    with pytest.raises(InputError, match="most_steps: must be positive"):
        motion(model, **settings, most_steps=0)


def test_a_trial_is_given_up_by_the_steps_of_the_first_run(model, monkeypatch):
    """If the clamp moves 100 times as far, the same tolerance takes more than twice the steps."""
    monkeypatch.setattr(module, "FEW_STEPS", 1)
    problem = Problem(
        equations=Equations(model, RayleighDamping(alpha=0.1)),
        base=BASE,
        start="equilibrium",
        times=np.arange(6) / 100,
        tolerance=1e-7,
    )
    first, far = ([cs.DM([0.1]), cs.DM(b), cs.DM(model.properties)] for b in (2e-4, 0.02))
    runs = module.Runs(problem, patience=2.0)
    assert problem.solve(np.array([0.1, 0.02, *model.properties.ravel(order="F")])).steps > 2 * runs.run(first).steps
    with pytest.raises(SimulationError, match="too many steps"):
        runs.run(far)
    assert isinstance(runs.failure, SimulationError)
    assert runs.run(first).steps and runs.failure is None
    runs.forget()
    assert module.Runs(problem).run(far).steps


def test_no_step_is_longer_than_the_largest(model):
    """As in ``simulate``: limited to a tenth of the longest free step, a motion takes more steps, none longer."""
    settings = {"base": BASE, "start": "equilibrium", "times": np.arange(6) / 100, "tolerance": 1e-7}
    at = np.array([0.1, 0.02, *model.properties.ravel(order="F")])
    equations = Equations(model, RayleighDamping(alpha=0.1))
    free = Problem(equations=equations, **settings).solve(at)
    largest = max(step.length for step in free.passages[0].steps) / 10
    limited = Problem(equations=equations, **settings, largest_step=largest).solve(at)
    assert max(step.length for step in limited.passages[0].steps) <= largest * (1 + 1e-12)
    assert abs(limited.samples - free.samples).max() < 1e-6 * model.beam.length
    with pytest.raises(InputError, match="largest_step: must be positive"):
        motion(model, **SETTINGS, largest_step=0.0)
