"""The reduced model of beams that supports hold beyond their beginning."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    Guide,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    Pin,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Roller,
    RotationalSpring,
    SampledBase,
    Spring,
    backbone,
    linear_frf,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
    simulate_reduced,
)
from ancf_casadi.reduction.reduced import rebuild_reduction
from ancf_casadi.response.harmonic_balance.beams import reduced_system
from tests.boundary.cases import REFERENCES

LENGTH, SLENDERNESS = 1.0, 1000.0  # m, length per radius of gyration
RADIUS = LENGTH / SLENDERNESS  # of gyration, m
PINNED, CLAMPED = (Pin(0.0), Pin(LENGTH)), (Clamp(0.0), Clamp(LENGTH))
MODES, STILL = 3, np.zeros(9)
ATTACHED = (
    Spring(0.3, (200.0, 900.0)),
    PointMass(0.3, 0.02, 1e-5),
    PointMass(0.7, 0.03),
    Dashpot(0.7, (1.0, 2.0)),
    RotationalSpring(0.5, 3.0),
)
SET_UPS = {
    "pinned": {"supports": PINNED},
    "clamped": {"supports": CLAMPED, "attachments": ATTACHED, "axis": (0.8, 0.6), "prestress": 2e6},
    "overhanging": {"supports": (Clamp(0.0), Pin(0.6)), "attachments": ATTACHED},
    "rolling": {"supports": (Pin(0.0), Roller(LENGTH))},
    "guided": {"supports": (Guide(0.0, (0.0, 1.0)), Clamp(LENGTH, 5.0))},
    "arch": {"supports": PINNED, "natural_curvature": 0.1},
    "pulled": {"supports": (Clamp(0.0), Clamp(LENGTH, displacement=(2e-5, 0.0)))},
}
RNG = np.random.default_rng(2)
Q, V = RNG.uniform(-1, 1, MODES) * (4e-4, 1e-4, 4e-5), RNG.uniform(-1, 1, MODES) * 0.02
BASE = RNG.uniform(-1, 1, 9) * (0.1, 0.1, 1.0, 0.5, 0.5, 3.0, 5.0, 5.0, 20.0)


def strip(elements, **changes):
    """Steel strip along x that sags a little."""
    settings = {"axis": (1.0, 0.0), "gravity": (0.0, -0.5), **changes}
    return Model(Beam.uniform(length=LENGTH, width=0.02, thickness=12**0.5 * RADIUS, density=8000.0,
                              elastic_modulus=210e9, elements=elements, **settings))  # fmt: skip


@pytest.fixture(scope="module", params=SET_UPS)
def modes(request):
    return natural_modes(strip(10, **SET_UPS[request.param]), count=MODES)


@pytest.fixture(scope="module")
def bare(modes):
    """The reduced model without damping."""
    return reduce_model(modes.model, modes=modes)


def linearised(reduced):
    """Matrices of small motion about q = 0: stiffness and damping, divided by the mass."""
    q, v, base, p = reduced.rhs.mx_in()
    rhs = reduced.rhs(q, v, base, p)
    zero = np.zeros(reduced.count)
    matrices = cs.Function("A", [q, v, base, p], [-cs.jacobian(rhs, q), -cs.jacobian(rhs, v)])
    return [part.full() for part in matrices(zero, zero, STILL, reduced.values)]


def test_small_motion_has_the_frequencies_the_equilibrium_and_the_damping_of_the_full_beam(modes):
    model, p, shapes, rest = modes.model, modes.model.properties, modes.shapes, modes.equilibrium.coordinates
    ratios = (0.01, 0.02, 0.03)
    law = RayleighDamping(alpha=0.3, beta=1e-5) + ModalDamping(modes, ratios) + QuadraticDamping(eta1=0.1)
    law = law + RayleighDamping(beta=2e-5, stiffness="tangent")
    reduced = reduce_model(model, modes=modes, damping=law, drag_points=64)
    stiffness, damping = linearised(reduced)
    np.testing.assert_allclose(stiffness, np.diag(modes.angular_frequencies**2), rtol=1e-6,
                               atol=1e-6 * modes.angular_frequencies[0] ** 2)  # fmt: skip
    e, e_t = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    force = law.force(model, e, e_t) + model.dashpot_force(e_t, p)
    matrix = cs.Function("D", [e, e_t], [cs.jacobian(force, e_t)])(rest, np.zeros(model.size)).full()
    expected = shapes.T @ matrix @ shapes
    np.testing.assert_allclose(damping, expected, atol=2e-5 * np.abs(expected).max())
    zero = np.zeros(MODES)
    np.testing.assert_allclose(reduced.coordinates(zero, zero, STILL)[0].full().ravel(), rest, atol=1e-12)
    assert np.abs(reduced.rhs(zero, zero, STILL, reduced.values).full()).max() < 1e-6


def test_the_elastic_force_is_that_of_the_full_beam_up_to_the_third_power(modes, bare):
    model, reduced = modes.model, bare
    q = cs.MX.sym("q", MODES)
    gradient = cs.Function("dU", [q], [cs.gradient(reduced.energies(q, STILL[:MODES], STILL, reduced.values)[1], q)])
    errors, sizes = [], []
    for factor in (1.0, 0.5):
        at = factor * Q
        e, e_t = (part.full().ravel() for part in reduced.coordinates(at, 0 * at, STILL))
        jacobian = reduced.coordinates.jacobian()(at, 0 * at, STILL, e, e_t)[0].full()[:, :MODES]
        full = jacobian.T @ model.elastic_force(e, model.properties).full().ravel()
        errors.append(np.abs(gradient(at).full().ravel() - full).max())
        rest = model.elastic_force(modes.equilibrium.coordinates, model.properties).full().ravel()
        sizes.append(np.abs(full - jacobian.T @ rest).max())
    assert errors[0] < 1e-3 * sizes[0]
    assert errors[0] > 12 * errors[1] or errors[0] < 1e-8 * sizes[0]  # rounding


def test_the_acceleration_balances_the_forces_of_the_full_model_on_a_base_that_moves(modes, bare):
    """Virtual work with e_tt from differentiating the coordinates twice; the elastic force is that of the energy."""
    model, law = modes.model, RayleighDamping(alpha=0.3) + QuadraticDamping(eta2=20.0)
    reduced = reduce_model(model, modes=modes, damping=law, drag_points=100)
    moved = BASE * (
        1.0 if all(support.sliding is None for support in model.beam.supports) else (1, 1, 0, 1, 1, 0, 1, 1, 0)
    )
    a, p = reduced.rhs(Q, V, moved, reduced.values).full().ravel(), model.properties
    t = cs.MX.sym("t")
    where, rate, rate2 = moved[:3], moved[3:6], moved[6:]
    base = cs.vertcat(where + rate * t + rate2 * t**2 / 2, rate + rate2 * t, rate2)
    e, e_t = reduced.coordinates(Q + V * t + a * t**2 / 2, V + a * t, base)
    at = cs.Function("at", [t], [e, e_t, cs.jacobian(e, t) - e_t, cs.jacobian(cs.jacobian(e, t), t)])
    e, e_t, difference, e_tt = (part.full().ravel() for part in at(0.0))
    assert np.abs(difference).max() < 1e-12
    x, x_t = cs.MX.sym("x", model.size), cs.MX.sym("x_t", model.size)
    damping = cs.Function("Q", [x, x_t], [law.force(model, x, x_t) + model.dashpot_force(x_t, p)])(e, e_t)
    forces = damping + model.inertia_force(e_tt, p) - model.gravity_force(p, model.beam.gravity)
    jacobian = reduced.coordinates.jacobian()(Q, V, moved, e, e_t)[0].full()[:, :MODES]
    q = cs.MX.sym("q", MODES)
    gradient = cs.Function("dU", [q], [cs.gradient(bare.energies(q, V, moved, bare.values)[1], q)])
    elastic = gradient(Q).full().ravel()
    assert np.abs(jacobian.T @ forces.full().ravel() + elastic).max() < 2e-5 * np.abs(elastic).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("supports", "name", "amplitudes"),
    [(PINNED, "backbone_pp", (0.5, 1, 2, 3, 5)), (CLAMPED, "backbone_cc", (0.5, 1, 1.5))],
)
def test_ends_that_do_not_move_harden_the_beam(supports, name, amplitudes):
    """Amplitudes are those of the middle, in radii of gyration."""
    reduced = reduce_model(strip(20, supports=supports, gravity=(0.0, 0.0)), modes=5)
    curve = backbone(reduced, amplitude=1.02 * max(amplitudes) * RADIUS, points=10)
    for amplitude, (ratio,) in zip(amplitudes, REFERENCES[name]["rows"].values(), strict=True):
        assert curve.frequency(amplitude * RADIUS) / curve.natural_frequency == pytest.approx(ratio, rel=5e-5)


@pytest.mark.slow
def test_a_beam_whose_end_slides_changes_its_frequency_as_the_full_beam():
    """Inertia along the beam and the curvature of large bending, both of the square of the amplitude."""
    model = strip(6, supports=(Pin(0.0), Roller(LENGTH)), gravity=(0.0, 0.0))
    shifts = []
    for body in (model, reduce_model(model, modes=3)):
        curve = backbone(body, amplitude=0.06, points=6)
        shifts.append(curve.frequency(0.05) / curve.natural_frequency - 1)
    assert abs(shifts[0]) > 1e-3
    assert shifts[1] == pytest.approx(shifts[0], rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pinned", "clamped", "overhanging", "arch", "guided"])
def test_a_steady_state_is_that_of_the_full_beam_and_its_energy_is_balanced(name):
    model = strip(6, **SET_UPS[name])
    first = natural_modes(model, count=1).frequencies[0]
    law, base = RayleighDamping(alpha=4.0, beta=1e-5), HarmonicBase(4e-5, 1.02 * first, direction=(0.3, 1.0))
    full = periodic_motion(model, damping=law, base=base)
    found = periodic_motion(reduce_model(model, modes=5, damping=law), base=base)
    assert found.amplitude() == pytest.approx(full.amplitude(), rel=2e-3)
    assert found.phase() == pytest.approx(full.phase(), abs=2e-3)
    assert found.supplied_energy == pytest.approx(found.dissipated_energy, rel=1e-6)
    assert found.dissipated_energy == pytest.approx(full.dissipated_energy, rel=5e-3)
    if name in ("pinned", "clamped"):  # the beam hardens
        direction = {"direction": (-model.beam.axis[1], model.beam.axis[0]), "load_direction": (0.3, 1.0)}
        linear = linear_frf(model, law, [1.02 * first], kind="relative-transmissibility", **direction)
        assert full.amplitude() > 1.04 * 4e-5 * linear.amplitude[0, 0, 0]


@pytest.mark.slow
def test_motion_on_a_base_that_moves_and_turns_is_that_of_the_full_beam():
    model, law = strip(6, **SET_UPS["clamped"]), RayleighDamping(alpha=4.0, beta=1e-5)
    time = np.linspace(0.0, 0.2, 81)
    wave = (1 - np.cos(10 * np.pi * time)) / 2
    base = SampledBase(time, np.outer(wave, (2e-4, 1e-3)), 0.01 * wave)
    settings = {"base": base, "duration": 0.3, "sample_rate": 500.0}
    full = simulate(model, damping=law, method="radau", tolerance=1e-6, **settings)
    errors = []
    for m in (1, 3, 5):
        run = simulate_reduced(reduce_model(model, modes=m, damping=law), **settings)
        errors.append(np.linalg.norm(run.position(0.5) - full.position(0.5), axis=1).max())
    size = np.ptp(full.relative_coordinates @ model.interpolation(0.5).T, axis=0).max()
    assert size > RADIUS / 3
    assert errors[2] < 2e-3 * size
    assert errors[2] < errors[1] < errors[0]


def test_a_model_rebuilt_with_the_same_properties_is_the_same(bare):
    motion = Q, V, V, np.zeros(12), bare.values
    models = bare, rebuild_reduction(bare, bare.model)
    forces = [reduced_system(model).functions(1).balance(*motion) for model in models]
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-8)


def test_what_cannot_be_reduced_is_refused():
    model = strip(4, supports=(Pin(0.0), Roller(LENGTH)))
    with pytest.raises(InputError, match=r"^slope_points: have no meaning where supports hold"):
        reduce_model(model, modes=2, slope_points=6)
    with pytest.raises(InputError, match=r"^modes: must be at most 12 where supports hold .*, got 14"):
        reduce_model(model, modes=14)
    with pytest.raises(InputError, match=r"^modes: mode 1 is a motion without bending"):
        reduce_model(strip(4, supports=(), gravity=(0.0, 0.0)), modes=4)
    turned = SampledBase(np.linspace(0.0, 1.0, 6), np.zeros((6, 2)), np.linspace(0.0, 0.1, 6))
    with pytest.raises(InputError, match=r"^base: turns, while a roller or guide keeps its direction"):
        simulate_reduced(reduce_model(model, modes=2), base=turned, duration=0.1)


@pytest.mark.parametrize(("last", "stays"), [(Roller(LENGTH), True), (Pin(LENGTH), False)])
def test_an_exported_beam_on_rollers_says_that_its_base_must_not_turn(last, stays):
    signals = {signal.name: signal for signal in reduce_model(strip(4, supports=(Pin(0.0), last)), modes=2).base}
    assert ("keep it 0" in signals["base_angle"].description) is stays
