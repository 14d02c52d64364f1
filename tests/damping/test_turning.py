"""Modal (generic) damping turns with the clamp: in simulation, derivatives, exported Functions, reduced model."""

import casadi as cs
import numpy as np
import pytest
from scipy.optimize import least_squares

from ancf_casadi import (
    Beam,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    motion,
    natural_modes,
    reduce_model,
    simulate,
    simulate_reduced,
)
from ancf_casadi.dynamics.derivatives.tangent import Tangent, stage_motion
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.idas import SemiExplicit
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.export import Document, beam_functions, read_document, write_document

RATIOS = (0.03, 0.01)
BOTH = pytest.mark.parametrize("method", ["idas", "radau"])
ANGLES = pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0])


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def turned(vectors, angle):
    """Turn the pairs (x, y) in the last axis by an angle."""
    return (vectors.reshape(*vectors.shape[:-1], -1, 2) @ rotation(angle).T).reshape(vectors.shape)


def smooth(x):
    """A step from 0 to 1 with two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


WEIGHTLESS = {"gravity": (0.0, 0.0), "elastic_modulus": 210e9 / 100}


@pytest.fixture(scope="module")
def modes(rubber_beam):
    """Modes at 6.6 and 41.5 Hz of a beam without gravity."""
    return natural_modes(Model(rubber_beam(4, **WEIGHTLESS)), count=2)


def turned_and_shifted(angle):
    """Turn the clamp in 0.5 s, then shift it across the beam by 1 mm in 15 ms, and hold it."""
    time = np.linspace(0.0, 0.52, 521)
    across = rotation(angle) @ [1e-3, 0.0]
    return SampledBase(time, np.outer(smooth((time - 0.5) / 0.015), across), angle * smooth(time / 0.5))


def ratio_of(time, displacement, omega):
    """Return the damping ratio of the exponential that fits a decay."""
    size, phase = abs(displacement).max(), omega * (time - time[0])

    def residuals(x):
        swing = x[2] * np.cos(x[1] * phase) + x[3] * np.sin(x[1] * phase)
        return np.exp(-x[0] * phase) * swing - displacement / size

    return least_squares(residuals, [0.01, 1.0, 0.5, 0.5], xtol=1e-14, ftol=1e-14, gtol=1e-14).x[0]


@pytest.mark.slow
@BOTH
@ANGLES
def test_the_modes_of_a_turned_beam_decay_with_the_ratios_given(modes, method, degrees):
    angle, law = np.radians(degrees), ModalDamping(modes, RATIOS)
    base = turned_and_shifted(angle)
    settings = {"duration": 1.0, "sample_rate": 1000.0, "method": method, "tolerance": 1e-9}
    run = simulate(modes.model, damping=law, base=base, **settings)
    held = run.time > 0.53
    back = turned(run.relative_coordinates[held], -angle)
    for mode, ratio in enumerate(RATIOS):
        displacement = modes.modal_coordinate(back, mode)
        assert 2e-4 < abs(displacement).max() < 1e-2
        assert ratio_of(run.time[held], displacement, modes.angular_frequencies[mode]) == pytest.approx(ratio, rel=5e-3)


def test_modes_of_a_hanging_beam_damp_the_same_beam_lying(rubber_beam, modes):
    lying = natural_modes(Model(rubber_beam(4, axis=(1.0, 0.0), **WEIGHTLESS)), count=2)
    np.testing.assert_allclose(ModalDamping(modes, RATIOS).damping_ratios(lying, np.zeros(2)), RATIOS, rtol=1e-9)


@ANGLES
@pytest.mark.parametrize("make", [beam_functions, reduce_model], ids=["full", "reduced"])
def test_exported_accelerations_turn_with_the_beam(modes, make, degrees):
    """If everything turns, without gravity, the accelerations of the full beam turn too; modal ones do not change."""
    functions = make(modes.model, damping=ModalDamping(modes, RATIOS), modes=2)
    undamped = make(modes.model, modes=2)
    angle, random = np.radians(degrees), np.random.default_rng(3)
    full = make is beam_functions
    straight = modes.model.straight[slice(4, modes.model.size)] if full else np.zeros(2)
    q = straight + random.normal(size=straight.size) * 1e-4
    v = random.normal(size=straight.size) * 0.1
    base = np.concatenate([random.normal(size=2), [0.2], random.normal(size=6)])
    along = base.copy()
    for k in (0, 3, 6):
        along[k : k + 2] = turned(base[k : k + 2], angle)
    along[2] += angle

    def turn(vector):
        return turned(vector, angle) if full else vector

    def accelerations(functions, *state):
        p = np.array([signal.value for signal in functions.parameters])
        return functions.rhs(*state, p).full().ravel()

    expected = turn(accelerations(functions, q, v, base))
    found = accelerations(functions, turn(q), turn(v), along)
    difference = abs(expected - turn(accelerations(undamped, q, v, base))).max()
    assert difference > 1e-3
    assert abs(found - expected).max() < 1e-6 * difference


@pytest.mark.slow
def test_the_jacobians_of_the_residual_are_those_of_differences_under_a_turned_clamp(modes):
    functions = beam_functions(modes.model, ModalDamping(modes, RATIOS), modes=2)
    random = np.random.default_rng(4)
    base = np.concatenate([np.zeros(2), [1.0], random.normal(size=6)])
    q = turned(modes.model.straight[slice(4, modes.model.size)], 1.0)
    state = [q, random.normal(size=q.size), np.zeros(q.size), base]
    p = np.array([signal.value for signal in functions.parameters])
    jacobians = functions.residual_jacobians(*state, p)
    undamped = beam_functions(modes.model, modes=2).residual_jacobians(*state, p[:-2])
    for place, step in ((1, 1e-2), (3, 1e-6)):
        expected = np.empty(jacobians[place].shape)
        for k in range(state[place].size):
            ends = []
            for sign in (1, -1):
                moved = [part.copy() for part in state]
                moved[place][k] += sign * step
                ends.append(functions.residual(*moved, p).full().ravel())
            expected[:, k] = (ends[0] - ends[1]) / (2 * step)
        difference = abs(jacobians[place] - undamped[place]).full().max()
        assert difference > 1e-4
        assert abs(jacobians[place].full() - expected).max() < 1e-4 * difference


def test_a_law_read_from_a_document_turns_too(modes, tmp_path):
    model, law = modes.model, ModalDamping(modes, RATIOS)
    write_document(tmp_path / "beam.json", Document(model, law))
    again = read_document(tmp_path / "beam.json").damping
    e, e_t = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    force, read = (cs.Function("Q", [e, e_t], [given.force(model, e, e_t)]) for given in (law, again))
    shape = turned(modes.shapes[:, 0], 1.0)
    expected = turned(force(model.straight, modes.shapes[:, 0]).full().ravel(), 1.0)
    found = read(turned(model.straight, 1.0), shape).full().ravel()
    assert abs(found - expected).max() < 1e-12 * abs(expected).max()
    assert np.array_equal(found, force(turned(model.straight, 1.0), shape).full().ravel())


# ------------------------------------------------------------------------------------------------- a clamp that turns

TIME = np.linspace(0.0, 0.4, 81)
TURNING = SampledBase(TIME, np.outer(smooth(TIME / 0.4), [0.02, 0.01]), 1.5 * smooth(TIME / 0.4))


@pytest.fixture(scope="module")
def strip():
    """A soft hanging strip of silicone."""
    return Model(
        Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=3)
    )


@pytest.fixture(scope="module")
def law(strip):
    return ModalDamping(natural_modes(strip, count=2), (0.05, 0.02))


@pytest.mark.slow
def test_derivatives_are_those_of_differences_and_reverse_ones_the_transposed(strip, law):
    settings = {"damping": law, "base": TURNING, "duration": 0.5, "sample_rate": 50.0}
    coarse, tight = (motion(strip, **settings, tolerance=tolerance) for tolerance in (1e-7, 1e-9))
    at = [np.array([parameter.value for parameter in law.parameters]), np.zeros(0), strip.properties]
    symbols = [cs.MX.sym(name, *coarse.size_in(k)) for k, name in enumerate("abc")]
    tip = cs.vec(coarse(*symbols)[-4:-2, :])
    directions = [np.array([1.0, 0.0]), np.array([0.0, 1.0])], [strip.properties * (np.arange(4) == 1)[:, None]]
    weights = np.random.default_rng(1).normal(size=tip.numel())
    for k, several in zip((0, 2), directions, strict=True):
        for direction in several:
            forward = cs.Function("D", symbols, [cs.jtimes(tip, symbols[k], cs.DM(direction))])(*at).full().ravel()
            ends = []
            for sign in (1, -1):
                moved = [part + sign * 2e-3 * direction if j == k else part for j, part in enumerate(at)]
                ends.append(tight(*moved).full()[-4:-2].ravel(order="F"))
            expected = (ends[0] - ends[1]) / 4e-3
            assert abs(expected).max() > 1e-5
            np.testing.assert_allclose(forward, expected, atol=1e-3 * abs(expected).max() + 2e-8)
            reverse = cs.Function("G", symbols, [cs.jtimes(tip, symbols[k], cs.DM(weights), True)])(*at)
            assert float(cs.dot(reverse, direction)) == pytest.approx(float(forward @ weights), rel=1e-8)


@pytest.mark.slow
def test_the_reduced_model_moves_like_the_full_one(paper_beam):
    model = Model(paper_beam(8))
    law = ModalDamping(natural_modes(model), (0.1, 0.05, 0.05, 0.05, 0.05))
    settings = {"base": TURNING, "duration": 0.7, "sample_rate": 100.0}
    full, undamped = (
        simulate(model, damping=given, method="radau", tolerance=1e-6, **settings) for given in (law, None)
    )
    reduced = simulate_reduced(reduce_model(model, modes=5, damping=law), **settings)
    error, difference = (np.linalg.norm(run.tip - full.tip, axis=1).max() for run in (reduced, undamped))
    assert difference > 0.05
    assert error < 2e-3 * difference


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("stiffness", ["strain-rate", "tangent"])
def test_energy_balances_and_every_law_takes_energy_while_the_clamp_turns(strip, law, method, stiffness):
    every = law + RayleighDamping(alpha=0.3, beta=2e-3, stiffness=stiffness) + QuadraticDamping(eta1=0.2, eta2=1.0)
    run = simulate(strip, damping=every, base=TURNING, duration=0.8, sample_rate=500.0, method=method, tolerance=1e-8)
    lost = run.dissipated_energy
    assert np.ptp(run.tip, axis=0).max() > 0.2 * strip.beam.length
    assert lost[-1] > 0.2 * run.kinetic_energy.max()
    assert np.diff(lost).min() > -1e-9 * lost[-1]
    assert abs(run.balance_error).max() < 1e-4 * lost[-1]


# -------------------------------------------------------------------------------------------- the integrators' matrices


def excitations_turned(angles):
    """Excitations (k, 16) of a moving hanging beam with a load at its tip, turned by the given angles."""
    axis = np.array([0.0, -1.0])
    motions = np.random.default_rng(6).normal(size=(len(angles), 11))  # velocities, accelerations and loads
    turned = [rotation(angle) @ axis for angle in angles]
    return np.array([[0.01, 0.02, *slope, *part, 0.0] for slope, part in zip(turned, motions, strict=True)])


def test_the_linearised_step_is_that_of_the_residual_where_the_clamp_turns_within_the_step(modes):
    equations = Equations(modes.model, ModalDamping(modes, RATIOS))
    form, p, random, h = Collocation(equations), equations.parameters, np.random.default_rng(5), 1e-2
    tangent, free = Tangent(form), equations.free
    q, v = modes.model.straight[slice(4, modes.model.size)], random.normal(size=free)
    Z, excitations = 1e-3 * random.normal(size=(3, free)), excitations_turned([0.3, 0.8, 1.3])

    unknowns = cs.MX.sym("Z", free, 3)
    pairs, load = stage_motion(unknowns, cs.DM(q), cs.DM(v), cs.MX(h), cs.DM(excitations.T))
    motion = [form.equations.model.whole(*pair) for pair in pairs]
    forces = form.balance.map(3)(*motion, load, cs.repmat(cs.DM(p), 1, 3))
    jacobian = cs.Function("G", [unknowns], [cs.jacobian(cs.vec(forces[4:, :]), cs.vec(unknowns))])(Z.T).full()
    step = RadauStep(0.0, h, q, v, 0 * v, Z, excitations)
    (entries, _), rates = tangent.bound(0).at(step, p)(), tangent.modal_coefficients(p)
    factors = tangent.factors(entries, step, rates)
    ordered = np.empty_like(jacobian)
    ordered[np.ix_(tangent.order, tangent.order)] = jacobian
    for matrix, solve in ((ordered, factors.solve), (ordered.T, factors.solve_transpose)):
        right = random.normal(size=(3 * free, 2))
        expected = np.linalg.solve(matrix, right)
        np.testing.assert_allclose(solve(right.copy(order="F")), expected, atol=1e-9 * abs(expected).max())
    plain = tangent.factors(entries, step, 0 * rates)
    assert (
        abs(plain.solve(right.copy(order="F")) - factors.solve(right.copy(order="F"))).max()
        > 1e-6 * abs(expected).max()
    )


def test_the_jacobian_that_idas_uses_is_that_of_differences_under_a_turned_clamp(modes):
    """The residual of the unknowns w is linear in accelerations and velocities, so that differences are exact."""
    equations = Equations(modes.model, ModalDamping(modes, RATIOS))
    form, random, m = SemiExplicit(equations), np.random.default_rng(7), len(RATIOS)
    (excitation,) = excitations_turned([1.0])
    x, z = (1e-3 * random.normal(size=form.residual.size1_in(k)) for k in range(2))
    by_x, by_z = (form.residual.jacobian()(x, z, excitation, 0, 0)[k].full() for k in (3, 4))

    def remainder(x, z):
        return form.residual(x, z, excitation)[1].full().ravel()

    free = equations.free
    rates = np.column_stack([remainder(x + unit, z) - remainder(x - unit, z) for unit in np.eye(x.size)[free:]]) / 2
    forces = np.column_stack([remainder(x, z + unit) - remainder(x, z - unit) for unit in np.eye(z.size)]) / 2
    for found, expected in ((by_x[-m:, free:], rates[-m:]), (by_z[:, -m:], forces[:, -m:])):
        assert abs(expected).max() > 1e-6
        assert abs(found - expected).max() < 1e-6 * abs(expected).max()
