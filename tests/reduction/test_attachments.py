"""The reduced model of beams with masses, springs and dashpots at points, other supports and a natural curvature."""

import functools

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    HarmonicBase,
    Model,
    Pin,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    RotationalSpring,
    SampledBase,
    Spring,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
    simulate_reduced,
    static_equilibrium,
)

MODES = 4
SPRINGS = (Spring(0.31, (0.3, 0.8)), Spring(0.5, (0.0, 0.2)))
DASHPOTS = (Dashpot(0.31, (2e-3, 5e-3)), Dashpot(0.42, (0.0, 1e-2)))
MASSES = (PointMass(0.2, 2e-3, 1e-7), PointMass(0.5, 1e-3))
SET_UPS = {
    "everything": {"attachments": SPRINGS + MASSES, "axis": (0.8, -0.6), "supports": (Clamp(0.0, 0.02),)},
    "hinge": {"supports": (Pin(0.0),), "attachments": (RotationalSpring(0.0, 0.02), *MASSES), "axis": (1.0, 0.0)},
    "pendulum": {"supports": (Pin(0.0),), "attachments": MASSES},
    "bent": {"natural_curvature": np.linspace(2.0, 6.0, 20), "attachments": SPRINGS},
    "turned": {"supports": (Clamp(0.0, rotation=0.5, displacement=(0.02, -0.01)),), "attachments": SPRINGS},
    "thick": {"thickness": 0.01, "rotary_sections": True},
}
STILL = np.zeros(9)
RNG = np.random.default_rng(3)
Q, V = (RNG.uniform(-1, 1, MODES) * size for size in ((4e-3, 1e-3, 4e-4, 2e-4), 0.05))
BASE = RNG.uniform(-1, 1, 9) * (0.1, 0.1, 1.0, 0.5, 0.5, 3.0, 5.0, 5.0, 20.0)


def strip(elements=20, thickness=0.5e-3, **changes):
    return Model(Beam.uniform(length=0.5, width=5e-3, thickness=thickness, density=8000.0, elastic_modulus=210e9,
                              elements=elements, **changes))  # fmt: skip


def linearised(reduced):
    """Angular frequencies (rad/s) and damping ratios of small motion about q = 0."""
    q, v, base, p = reduced.rhs.mx_in()
    matrix = cs.jacobian(cs.vertcat(v, reduced.rhs(q, v, base, p)), cs.vertcat(q, v))
    zero = np.zeros(reduced.count)
    roots = np.linalg.eigvals(cs.Function("A", [q, v, base, p], [matrix])(zero, zero, STILL, reduced.values).full())
    roots = sorted(roots[roots.imag > 0], key=abs)
    return np.abs(roots), -np.real(roots) / np.abs(roots)


@pytest.mark.slow
@pytest.mark.parametrize("name", SET_UPS)
def test_small_motion_has_the_frequencies_and_the_equilibrium_of_the_full_beam(name):
    model = strip(**SET_UPS[name])
    modes = natural_modes(model, count=MODES)
    for slope_points, limit in ((41, 2e-5), (None, 5e-4)):
        reduced = reduce_model(model, modes=modes, slope_points=slope_points)
        frequencies, ratios = linearised(reduced)
        np.testing.assert_allclose(frequencies, modes.angular_frequencies, rtol=limit)
        assert np.abs(ratios).max() < 1e-10
    zero = np.zeros(MODES)
    np.testing.assert_allclose(reduced.tip(zero, STILL).full().ravel(), static_equilibrium(model).tip, atol=1e-6)
    assert np.abs(reduced.rhs(zero, zero, STILL, reduced.values).full()).max() < 2e-5 * 9.81


@pytest.fixture(scope="module")
def coarse_modes():
    """Modes of a beam of twelve elements by the name of its set-up."""

    @functools.cache
    def modes(name):
        changes = {"natural_curvature": np.linspace(2.0, 6.0, 12)} if name == "bent" else {}
        return natural_modes(strip(12, **{**SET_UPS[name], **changes}), count=MODES)

    return modes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "names"),
    [
        (RayleighDamping(alpha=0.2), ("everything", "pendulum")),
        (RayleighDamping(beta=3e-5), ("pendulum", "bent")),
        (RayleighDamping(beta=3e-5, stiffness="tangent"), ("everything", "bent")),
        (QuadraticDamping(eta1=0.15), ("everything", "pendulum", "bent")),
    ],
    ids=str,
)
def test_small_motion_has_the_damping_ratios_of_the_law(coarse_modes, law, names):
    for modes in map(coarse_modes, names):
        expected = law.damping_ratios(modes, np.zeros(MODES))
        reduced = reduce_model(modes.model, modes=modes, damping=law, slope_points=25, drag_points=64)
        np.testing.assert_allclose(linearised(reduced)[1], expected, rtol=5e-4)


def test_dashpots_resist_the_motion_relative_to_the_base_as_in_the_full_model():
    """Generalized force of the dashpots in a large motion of beam and base, and damping ratios of small motion."""
    model = strip(attachments=(*SPRINGS, *MASSES, *DASHPOTS), axis=(0.8, -0.6))
    modes = natural_modes(model, count=MODES)
    reduced = reduce_model(model, modes=modes)
    bare = reduce_model(
        strip(attachments=(*SPRINGS, *MASSES, Dashpot(0.42, (0.0, 0.0))), axis=(0.8, -0.6)), modes=MODES
    )
    force = reduced.mass(Q).full() @ np.subtract(
        *(one.rhs(Q, V, BASE, one.values).full().ravel() for one in (bare, reduced))
    )
    e, e_t = (part.full().ravel() for part in reduced.coordinates(Q, V, BASE))
    e_t[:4] = *BASE[3:5], *(BASE[5] * np.array([-e[3], e[2]]))
    jacobian = reduced.coordinates.jacobian()(Q, V, BASE, e, e_t)[0].full()
    expected = jacobian.T @ model.dashpot_force(e_t, model.properties).full().ravel()
    assert np.abs(force - expected).max() < 1e-4 * np.abs(expected).max()
    resisted = model.dashpot_force(modes.shapes, model.properties).full()
    ratios = (modes.shapes * resisted).sum(axis=0) / (2 * modes.angular_frequencies)
    assert ratios[0] > 0.02
    np.testing.assert_allclose(linearised(reduced)[1], ratios, rtol=0.05)


def test_a_beam_on_a_displaced_clamp_bends_and_turns_as_elsewhere():
    """The same accelerations on a base that only moves; the displacement turns with the base."""
    displacement, still = np.array([0.02, -0.03]), BASE * ([1.0, 1.0, 0.0] * 3)
    here, there = (
        reduce_model(strip(4, axis=(0.8, -0.6), supports=(Clamp(rotation=0.5, displacement=place),)), modes=MODES)
        for place in ((0.0, 0.0), displacement)
    )
    accelerations = [one.rhs(Q, V, still, one.values).full().ravel() for one in (here, there)]
    np.testing.assert_allclose(accelerations[1], accelerations[0], rtol=1e-6)
    cosine, sine = np.cos(BASE[2]), np.sin(BASE[2])
    moved = (there.tip(Q, BASE) - here.tip(Q, BASE)).full().ravel()
    np.testing.assert_allclose(moved, np.array([[cosine, -sine], [sine, cosine]]) @ displacement, atol=1e-9)


def test_springs_store_the_work_of_a_base_that_turns_and_energy_is_constant():
    model = strip(**SET_UPS["everything"])
    reduced = reduce_model(model, modes=MODES)

    def stored(base):
        """Energy of springs whose other ends turn with the base."""
        e = reduced.coordinates(Q, V, base)[0].full().ravel()
        cosine, sine = np.cos(base[2]), np.sin(base[2])
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        away = [e[model.nodes_of(one.point)[:2]] - base[:2] - rotation @ (one.point * np.array(model.beam.axis))
                for one in SPRINGS]  # fmt: skip
        return sum(np.dot(one.stiffness, d**2) / 2 for one, d in zip(SPRINGS, away, strict=True))

    energies = [float(reduced.energies(Q, V, base, reduced.values)[1]) for base in (BASE, STILL)]
    assert np.subtract(*energies) == pytest.approx(stored(BASE) - stored(STILL), rel=1e-9)
    q, v, base, values = reduced.energies.mx_in()
    total = sum(reduced.energies(q, v, base, values))
    change = cs.jtimes(total, q, v) + cs.jtimes(total, v, reduced.rhs(q, v, base, values))
    rate = float(cs.Function("rate", [q, v, base, values], [change])(Q, V, STILL, reduced.values))
    assert abs(rate) < 1e-12 * energies[0] * reduced.modes.angular_frequencies[0] + 1e-13


TIME = np.linspace(0.0, 0.4, 81)
MOVED = SampledBase(
    TIME, 0.02 * np.outer(1 - np.cos(5 * np.pi * TIME), (1.0, 0.5)), 0.2 * (1 - np.cos(np.pi * TIME / 0.4))
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["everything", "hinge", "pendulum", "bent"])
def test_motion_converges_to_that_of_the_full_beam_with_the_modes(name):
    changes = dict(SET_UPS[name])
    if "natural_curvature" in changes:
        changes["natural_curvature"] = np.linspace(2.0, 6.0, 8)
    changes["attachments"] = (*changes["attachments"], *DASHPOTS)
    model, law = strip(8, **changes), RayleighDamping(alpha=0.2, beta=3e-5)
    settings = {"base": MOVED, "duration": 0.5, "sample_rate": 100.0}
    full = simulate(model, damping=law, method="radau", tolerance=1e-6, **settings)
    errors = []
    for m in (1, 3, 5):
        run = simulate_reduced(reduce_model(model, modes=m, damping=law), **settings)
        errors.append(np.linalg.norm(run.tip - full.tip, axis=1).max() / 0.5)
    assert np.ptp(full.relative_coordinates[:, -4:-2], axis=0).max() > 0.02
    assert errors[2] < 2e-4
    assert errors[2] < errors[1] < errors[0]


@pytest.mark.slow
def test_a_steady_state_is_that_of_the_full_beam_and_its_energy_is_balanced():
    model = strip(8, attachments=(*SPRINGS, *MASSES, *DASHPOTS), axis=(0.8, -0.6))
    law, base = RayleighDamping(alpha=0.1), HarmonicBase(5e-3, 2.5)
    full = periodic_motion(model, damping=law, base=base)
    found = periodic_motion(reduce_model(model, modes=5, damping=law), base=base)
    assert found.amplitude() == pytest.approx(full.amplitude(), rel=1e-4)
    assert found.phase() == pytest.approx(full.phase(), abs=1e-4)
    assert found.supplied_energy == pytest.approx(found.dissipated_energy, rel=1e-6)
    assert found.dissipated_energy == pytest.approx(full.dissipated_energy, rel=1e-3)
