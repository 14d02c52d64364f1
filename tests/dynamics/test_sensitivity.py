"""Derivatives of a motion against differences of tightly integrated motions, forward ones against reverse ones."""

import gc
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    FixedBase,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    Pin,
    QuadraticDamping,
    RayleighDamping,
    SampledLoad,
    Spring,
    motion,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.derivatives import differentiable as module
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.dynamics.derivatives.tangent import MotionRun
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import model_with_properties
from ancf_casadi.mechanics.nodes import NODE

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
def test_derivatives_are_those_of_a_tightly_integrated_motion_away_from_the_model(case, model, law):
    """Central differences of runs at 1e-9; the law, the amplitude, and all thicknesses, densities and moduli."""
    start, _, symbols, tip = case
    at = [1.05 * part for part in values(law, model)]
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
    for jacobian, product in zip(forward, reverse, strict=False):
        np.testing.assert_allclose(product.full().ravel(), (jacobian.T @ cs.vec(weights)).full().ravel(), rtol=1e-8)
    direction = np.random.default_rng(2).normal(size=model.properties.shape) * model.properties
    along = cs.Function("D", symbols, [cs.jtimes(cs.vec(tip), symbols[2], cs.DM(direction))])(*at)
    assert float(cs.dot(along, cs.vec(weights))) == pytest.approx(float(cs.dot(reverse[2], direction)), rel=1e-8)


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_derivative_by_an_amplitude_that_grows_is_that_of_differences(model):
    base, amplitude = replace(BASE, ramp=0.3), cs.MX.sym("amplitude")
    settings = {**SETTINGS, "tolerance": 1e-10}  # from one amplitude to the next, steps differ
    tip = motion(model, base=base, **settings)(np.zeros(0), amplitude, model.properties)[-4, :]
    exact = cs.Function("exact", [amplitude], [tip, cs.jacobian(tip, amplitude)])
    above, (_, slopes), below = (
        [part.full().ravel() for part in exact(BASE.amplitude * factor)] for factor in (1.001, 1.0, 0.999)
    )
    differences = (above[0] - below[0]) / (2e-3 * BASE.amplitude)
    assert abs(slopes).max() > 0.1
    np.testing.assert_allclose(slopes, differences, atol=1e-5 * abs(slopes).max())


def test_a_load_between_two_samples_has_exact_derivatives(model):
    blow, alpha = SampledLoad([0.061, 0.063, 0.065], [[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]]), cs.MX.sym("alpha")
    settings = {**SETTINGS, "sample_rate": 25.0, "tolerance": 1e-10}
    function = motion(model, damping=RayleighDamping(alpha=0.6), load=blow, **settings)
    tip = function(alpha, np.zeros(0), model.properties)[-4, :]
    exact = cs.Function("exact", [alpha], [tip, cs.jacobian(tip, alpha)])
    above, (_, slopes), below = ([part.full().ravel() for part in exact(0.6 * factor)] for factor in (1.01, 1.0, 0.99))
    assert abs(slopes).max() > 1e-5
    np.testing.assert_allclose(slopes, (above[0] - below[0]) / 0.012, atol=1e-3 * abs(slopes).max())


def test_values_without_a_motion_give_nan_and_a_warning(model):
    function = motion(model, base=BASE, **SETTINGS)
    at = [np.zeros(0), np.array([BASE.amplitude]), model.properties.copy()]
    at[2][3] = -1.0
    with pytest.warns(RuntimeWarning, match="elastic_modulus"):
        found = function(*at)
    assert np.isnan(found.full()).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"duration": 0.0}, "duration: must be positive"),
        ({"tolerance": -1.0}, "tolerance: must be positive"),
        ({"most_steps": 0.4}, "most_steps: must be a whole number"),
        ({"largest_step": 0.0}, "largest_step: must be positive"),
        ({"lumped": True}, "lumped: the beam has no mass"),
    ],
)
def test_settings_that_make_no_sense_are_refused(model, settings, message):
    with pytest.raises(InputError, match=message):
        motion(model, **{"duration": 0.1} | settings)


def runs_alive():
    gc.collect()
    return sum(type(item) is MotionRun for item in gc.get_objects())


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


@pytest.mark.slow
def test_a_motion_of_too_many_steps_is_given_up(model):
    settings = SETTINGS | {"duration": 0.05, "base": BASE, "start": "equilibrium"}
    at = [np.zeros(0), np.array([0.02]), model.properties.copy()]
    unlimited = motion(model, **settings)
    with pytest.warns(RuntimeWarning, match=r"too many steps: 3 up to 0\.0\d+ s, the last of them \S+ s long; try"):
        assert np.isnan(motion(model, **settings, most_steps=3)(*at).full()).all()
    assert np.isfinite(unlimited(*at).full()).all()


def test_a_trial_is_given_up_by_the_steps_of_the_first_run(model, monkeypatch):
    """If the clamp moves 100 times as far, the same tolerance takes more than twice the steps."""
    monkeypatch.setattr(module, "FEW_STEPS", 1)
    problem = SensitivityProblem(
        equations=Equations(model, RayleighDamping(alpha=0.1)),
        base=BASE,
        start="equilibrium",
        times=np.arange(6) / 100,
        tolerance=1e-7,
    )
    first, far = (np.array([0.1, b, *model.properties.ravel(order="F")]) for b in (2e-4, 0.02))
    runs = module.Runs(problem, patience=2.0)
    assert problem.solve(far).steps > 2 * runs.run(first).steps
    with pytest.raises(SimulationError, match="too many steps"):
        runs.run(far)
    assert isinstance(runs.failure, SimulationError)
    assert runs.run(first).steps and runs.failure is None
    runs.forget()
    assert module.Runs(problem).run(far).steps


@pytest.mark.slow
def test_no_step_is_longer_than_the_largest(model):
    """As in ``simulate``: limited to a tenth of the longest free step, a motion takes more steps, none longer."""
    settings = {"base": BASE, "start": "equilibrium", "times": np.arange(6) / 100, "tolerance": 1e-7}
    at = np.array([0.1, 0.02, *model.properties.ravel(order="F")])
    equations = Equations(model, RayleighDamping(alpha=0.1))
    free = SensitivityProblem(equations=equations, **settings).solve(at)
    largest = free.passages[0].steps.lengths.max() / 10
    limited = SensitivityProblem(equations=equations, **settings, largest_step=largest).solve(at)
    assert limited.passages[0].steps.lengths.max() <= largest * (1 + 1e-12)
    assert abs(limited.samples - free.samples).max() < 1e-6 * model.beam.length


LUMPED = {"tip_mass": 1e-3, "clamp_stiffness": 1e-4}  # a quarter of the strip; it turns 11 times as far as its clamp


def lumped_problem(model, start="equilibrium", base=BASE, damping="local", lumped=LUMPED, **settings):
    """The motion of the strip with lumped properties, by which it is differentiable, and the values."""
    heavy = Model(model.beam.with_(**lumped))
    law = RayleighDamping(alpha=0.6, beta=2e-3) + QuadraticDamping(eta2=2.0)
    if damping == "modal":
        law = ModalDamping(natural_modes(heavy, count=2), (0.03, 0.02))
    if start == "held":
        start = static_equilibrium(heavy, tip_force=(0.002, 0.0))
    options = {"times": np.arange(13) / 100, "tolerance": 1e-9, "lumped": True} | settings
    problem = SensitivityProblem(equations=Equations(heavy, law), base=base, start=start, **options)
    theta, b = ([parameter.value for parameter in owner.parameters] for owner in (law, base))
    return problem, np.array([*theta, *b, *heavy.properties.T.ravel(), *lumped.values(), *[0.0] * problem.held * 6])


def lumped_directions(problem, at):
    """Directions of the values, each as large as a lumped property."""
    place = problem.layout["lumped"]
    return np.eye(at.size)[:, place] * at[place]


@pytest.mark.slow
@pytest.mark.parametrize("damping", ["local", "modal"])
@pytest.mark.parametrize(
    ("start", "base"), [("equilibrium", BASE), ("held", FixedBase()), ("impact", BASE), ("straight", FixedBase())]
)
def test_derivatives_by_tip_mass_and_clamp_stiffness_are_those_of_differences(model, start, base, damping):
    """Coordinates and velocities; a swing of the base, a free decay from a load, a blow, and the fall of a strip.

    The last one lies: hanging straight, it would not move.  Differences of accelerations are too noisy here under the
    modal law, which leaves modes of the mesh undamped.
    """
    if start == "straight":
        model = Model(model.beam.with_(axis=(1.0, 0.0)))
    problem, at = lumped_problem(model, start, base, damping, orders=2)
    run, directions = problem.solve(at), lumped_directions(problem, at)
    assert np.ptp(run.samples[:, 0, -4:-2], axis=0).max() > 2e-3
    found = problem.forward(run, directions)
    for k, direction in enumerate(directions.T):
        ends = [problem.solve(at + sign * 1e-3 * direction).samples for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-3
        size = abs(expected).max(axis=(0, 2), keepdims=True)
        assert size.min() > 1e-3  # m and m/s, for a change as large as the value
        assert (abs(found[..., k] - expected) / size).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("damping", ["local", "modal"])
def test_reverse_derivatives_by_lumped_properties_are_the_transposed_of_the_forward_ones(model, damping):
    problem, at = lumped_problem(model, "held", damping=damping, held=True, tolerance=1e-6, times=np.arange(5) / 50)
    at[-6:] = 0.002, 0.0, 1e-5, 0.01, 0.0, 1e-4
    run, random = problem.solve(at), np.random.default_rng(3)
    directions, weights = np.diag(at), random.normal(size=(*run.samples.shape, 2))
    forward, reverse = problem.forward(run, directions), problem.reverse(run, weights)
    expected = np.einsum("kond,konw->dw", forward, weights)
    assert abs(expected[problem.layout["lumped"]]).min() > 1e-3
    np.testing.assert_allclose(directions @ reverse, expected, atol=1e-9 * abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", LUMPED)
def test_a_beam_with_one_lumped_property_has_one_more_input_with_exact_derivatives(model, name):
    """The tip after a swing; also without the tip mass, a limit that a fit may try."""
    heavy = Model(model.beam.with_(**{name: LUMPED[name]}))
    function = motion(heavy, base=BASE, lumped=True, **SETTINGS | {"duration": 0.1, "tolerance": 1e-9})
    assert function.name_in() == ["damping", "base", "properties", "lumped"]
    x = cs.MX.sym("x")
    tip = function(np.zeros(0), BASE.amplitude, heavy.properties, x)[-4, :]
    exact = cs.Function("exact", [x], [tip, cs.jacobian(tip, x)])
    step = 1e-3 * LUMPED[name]
    for at in [LUMPED[name], step][: 1 + (name == "tip_mass")]:
        above, (_, slopes), below = ([part.full().ravel() for part in exact(at + d)] for d in (step, 0.0, -step))
        expected = (above[0] - below[0]) / (2 * step)
        assert LUMPED[name] * abs(expected).max() > 5e-6  # m, for a change as large as the value
        np.testing.assert_allclose(slopes, expected, atol=2e-3 * abs(expected).max())


@pytest.mark.slow
def test_other_values_of_the_lumped_properties_give_the_motion_of_another_beam(model):
    problem, at = lumped_problem(model, "equilibrium", tolerance=1e-8)
    at[problem.layout["lumped"]] = 5e-4, 5e-5
    other = Model(model.beam.with_(tip_mass=5e-4, clamp_stiffness=5e-5))
    settings = {"duration": 0.12, "sample_rate": 100.0, "tolerance": 1e-8}
    expected = simulate(
        other, damping=problem.equations.law, base=BASE, start="equilibrium", method="radau", **settings
    )
    assert abs(problem.solve(at).samples[:, 0] - expected.coordinates).max() < 1e-6 * model.beam.length


@pytest.mark.parametrize("start", [pytest.param("equilibrium", marks=pytest.mark.slow), "held"])
def test_supports_stay_in_place_as_curvature_and_prestress_change(model, start, uncompiled):
    """The motion at other values is that of the other beam on the same supports, and so are its derivatives."""
    lumped = {"natural_curvature": 0.5, "prestress": 200.0}
    held = Model(model.beam.with_(supports=(Clamp(0.0), Pin(0.12, displacement=(1e-3, 2e-5)))))
    base = HarmonicBase(2e-3, 20.0) if start == "equilibrium" else FixedBase()
    times = np.linspace(0.0, 0.05, 11)
    options = {"lumped": lumped, "tolerance": 1e-8, "times": times, "held": start == "held"}
    problem, at = lumped_problem(held, start, base, **options)
    first, place = problem.equations.model, problem.layout["lumped"]
    directions = lumped_directions(problem, at)
    at[place] = 0.8, 300.0
    other = model_with_properties(first, np.concatenate([first.properties.ravel(), at[place]]))
    begin = static_equilibrium(other, tip_force=(0.002, 0.0)) if start == "held" else start
    settings = {"duration": 0.05, "sample_rate": 200.0, "tolerance": 1e-8, "method": "radau"}
    expected = simulate(other, damping=problem.equations.law, base=base, start=begin, **settings).coordinates
    if start == "held":
        at[problem.layout["start"].start] = 0.002
    run = problem.solve(at)
    assert np.ptp(expected, axis=0).max() > 1e-4
    assert abs(run.samples[:, 0] - expected).max() < 1e-6 * model.beam.length
    found = problem.forward(run, directions)[:, 0]
    for k, direction in enumerate(directions.T):
        ends = [problem.solve(at + sign * 1e-3 * direction).samples[:, 0] for sign in (1, -1)]
        change = (ends[0] - ends[1]) / 2e-3
        assert abs(change).max() > 1e-5
        assert abs(found[..., k] - change).max() < 2e-4 * abs(change).max()


@pytest.mark.slow
def test_the_first_accelerations_after_a_release_are_those_of_the_changed_tip_mass(model, uncompiled):
    """The mass of the first accelerations is that of the values; so are their derivatives."""
    problem, at = lumped_problem(model, "held", FixedBase(), orders=3, times=np.array([0.0, 1e-3]))
    direction = lumped_directions(problem, at)[:, :1]
    at += 0.5 * direction[:, 0]
    runs = [problem.solve(at + sign * 1e-4 * direction[:, 0]) for sign in (1, 0, -1)]
    first = [run.samples[0, 2] for run in runs]
    equations = replace(problem.equations, model=Model(problem.equations.model.beam.with_(tip_mass=1.5e-3)))
    excitation = np.append(runs[1].samples[0][:, :NODE], np.zeros(4))
    motion = [equations.model.of_free(x) for x in runs[1].samples[0]]
    no_strains = np.zeros(equations.internal_shape)
    forces = Collocation(equations).balance(*motion, excitation, equations.parameters, no_strains).full()
    assert abs(forces).max() < 1e-9  # N, of a load of 2 mN
    expected = (first[0] - first[2]) / 2e-4
    assert abs(expected).max() > 0.1
    found = problem.forward(runs[1], direction)[0, 2, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-5 * abs(expected).max())


def test_the_curvature_of_a_beam_on_springs_is_no_input(model):
    """Springs are free of force where the beam is without load, and would move with the curvature."""
    spring = Spring(0.1, stiffness=(1.0, 0.0))
    bent = Model(model.beam.with_(natural_curvature=2.0, attachments=[spring]))
    with pytest.raises(InputError, match="natural_curvature: cannot be estimated"):
        motion(bent, duration=0.1, lumped=True)


def test_lumped_properties_that_a_beam_cannot_have_are_refused(model):
    problem, at = lumped_problem(model)
    at[problem.layout["lumped"]] = 1e-3, np.inf
    with pytest.raises(InputError, match="clamp_stiffness: must be a finite number"):
        problem.solve(at)
