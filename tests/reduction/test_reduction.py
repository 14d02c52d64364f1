from pathlib import Path

import casadi as cs
import numpy as np
import pytest
import scipy.optimize

from ancf_casadi import (
    Beam,
    FrictionDamping,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    State,
    natural_modes,
    reduce_model,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.dynamics.base_motion import BaseMotion, Piece
from ancf_casadi.reduction.bending import nodal_slopes
from ancf_casadi.reduction.stepping import project

RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)
SEED = np.random.default_rng(5)
Q = SEED.uniform(-1, 1, 5) * (4e-3, 1e-3, 4e-4, 2e-4, 1e-4)  # bends the paper's beam by 0.3 L
V = SEED.uniform(-1, 1, 5) * 0.05
BASE = SEED.uniform(-1, 1, 9) * (0.1, 0.1, 1.0, 0.5, 0.5, 3.0, 5.0, 5.0, 20.0)
STILL = np.zeros(9)
HEAVY = {"tip_mass": 5e-3}
ELASTIC = {"tip_mass": 2e-3, "clamp_stiffness": 0.5, "axis": (1.0, -1.0)}


@pytest.fixture(scope="module")
def modes(hanging):
    return natural_modes(hanging, count=5)


def linearised(reduced):
    """Angular frequencies (rad/s) and damping ratios of small motion about q = 0."""
    q, v, base, p = reduced.rhs.mx_in()
    matrix = cs.jacobian(cs.vertcat(v, reduced.rhs(q, v, base, p)), cs.vertcat(q, v))
    zero = np.zeros(reduced.count)
    roots = np.linalg.eigvals(cs.Function("A", [q, v, base, p], [matrix])(zero, zero, STILL, reduced.values).full())
    roots = sorted(roots[roots.imag > 0], key=abs)
    return np.abs(roots), -np.real(roots) / np.abs(roots)


def uneven(elements=20):
    rng = np.random.default_rng(1)
    return {"width": 5e-3 * rng.uniform(0.9, 1.1, elements), "thickness": 5e-4 * rng.uniform(0.9, 1.1, elements)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [{"axis": (1.0, 0.0)}, uneven(), ELASTIC],
    ids=["horizontal", "hanging and uneven", "elastic clamp and tip mass"],
)
def test_small_motion_has_the_frequencies_and_the_equilibrium_of_the_full_beam(paper_beam, changes):
    model = Model(paper_beam(**changes))
    modes = natural_modes(model)
    for slope_points, limit in ((41, 1.2e-5), (None, 3e-5)):
        reduced = reduce_model(model, modes=modes, slope_points=slope_points)
        frequencies, ratios = linearised(reduced)
        np.testing.assert_allclose(frequencies, modes.angular_frequencies, rtol=limit)
        assert np.abs(ratios).max() < 1e-12
    zero = np.zeros(5)
    np.testing.assert_allclose(reduced.tip(zero, STILL).full().ravel(), static_equilibrium(model).tip, atol=1e-9)
    assert np.abs(reduced.rhs(zero, zero, STILL, reduced.values).full()).max() < 1e-5 * 9.81


@pytest.mark.parametrize(
    "law",
    [
        RayleighDamping(alpha=0.2),
        RayleighDamping(beta=3e-5),
        RayleighDamping(beta=3e-5, stiffness="tangent"),
        QuadraticDamping(eta1=0.15),
        RayleighDamping(alpha=0.1, beta=1e-5) + QuadraticDamping(eta1=0.1),
    ],
    ids=str,
)
def test_small_motion_has_the_damping_ratios_of_the_law(hanging, modes, law):
    expected = law.damping_ratios(modes, np.zeros(5))
    assert expected.min() > 1e-5
    np.testing.assert_allclose(linearised(reduce_model(hanging, modes=modes, damping=law))[1], expected, rtol=2e-4)


@pytest.mark.parametrize("changes", [HEAVY, ELASTIC], ids=["tip mass", "elastic clamp"])
def test_a_tip_mass_and_an_elastic_clamp_are_damped_as_in_the_full_model(paper_beam, changes):
    model = Model(paper_beam(**changes))
    modes = natural_modes(model, count=3)
    law = RayleighDamping(alpha=0.1, beta=1e-5) + QuadraticDamping(eta1=0.1)
    expected, air = (part.damping_ratios(modes, np.zeros(3)) for part in (law, QuadraticDamping(eta1=0.1)))
    assert air[0] < 0.9 * 0.1 / (2 * modes.angular_frequencies[0])  # the tip mass has no drag
    np.testing.assert_allclose(linearised(reduce_model(model, modes=modes, damping=law))[1], expected, rtol=2e-4)


def test_the_modal_law_and_its_symbolic_parameters_give_the_measured_ratios(hanging, modes):
    reduced = reduce_model(hanging, modes=modes, damping=ModalDamping(modes, RATIOS))
    np.testing.assert_allclose(linearised(reduced)[1], RATIOS, rtol=2e-5)
    names = [signal.name for signal in reduced.parameters]
    assert names == ["gravity_x", "gravity_y", *(f"ratio{k}" for k in range(1, 6))]
    undamped, damped = reduce_model(hanging, modes=modes), (reduced.values, np.append(reduced.values[:2], np.zeros(5)))
    rates = [reduced.rhs(Q, V, BASE, p).full() for p in damped]
    bare = undamped.rhs(Q, V, BASE, undamped.values).full()
    np.testing.assert_allclose(rates[1], bare, rtol=1e-9)
    assert np.abs(rates[0] - bare).max() > 1e-4 * np.abs(bare).max()


def projected(reduced, q, v, base, force):
    """Return the modal forces of a force on the nodal coordinates."""
    e, e_t = (part.full().ravel() for part in reduced.coordinates(q, v, base))
    jacobian = reduced.coordinates.jacobian()(q, v, base, e, e_t)[0].full()
    return jacobian.T @ force(e, e_t)


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [
        (lambda modes: RayleighDamping(alpha=0.2), 1e-9),
        (lambda modes: ModalDamping(modes, RATIOS), 1e-9),
        (lambda modes: QuadraticDamping(eta2=0.11), 5e-5),
        (lambda modes: FrictionDamping(eta0=0.1), 5e-3),
        (lambda modes: QuadraticDamping(eta1=0.1, eta2=0.1) + ModalDamping(modes, RATIOS[:2]), 5e-5),
    ],
)
def test_large_motion_of_beam_and_base_is_damped_as_in_the_full_model(hanging, modes, law, tolerance):
    law = law(modes)
    damped, undamped = (reduce_model(hanging, modes=modes, damping=given, drag_points=64) for given in (law, None))
    change = (part.rhs(Q, V, BASE, part.values).full().ravel() for part in (undamped, damped))
    force = damped.mass(Q).full() @ np.subtract(*change)
    e, e_t = cs.MX.sym("e", hanging.size), cs.MX.sym("e_t", hanging.size)
    full = cs.Function("Q", [e, e_t], [law.force(hanging, e, e_t)])
    expected = projected(damped, Q, V, BASE, lambda e, e_t: full(e, e_t).full().ravel())
    assert np.abs(force - expected).max() < tolerance * np.abs(expected).max()


def test_few_drag_points_dissipate_the_right_energy_in_a_mode(hanging, modes):
    """Power of the drag in each mode alone, on which the equivalent damping ratios rest."""
    law = QuadraticDamping(eta2=0.11)
    damped, undamped = (reduce_model(hanging, modes=modes, damping=given) for given in (law, None))
    shapes = modes.shapes.T
    for v, shape in zip(0.05 * np.eye(5), 0.05 * shapes, strict=True):
        change = (part.rhs(np.zeros(5), v, STILL, part.values).full().ravel() for part in (undamped, damped))
        drag = hanging.drag_force(shape, hanging.properties).full().ravel()
        assert v @ np.subtract(*change) == pytest.approx(1183 / 876 * 0.11 * shape @ drag, rel=1e-3)


def test_the_strain_rate_force_is_zero_in_a_rigid_rotation(hanging, modes):
    law = RayleighDamping(beta=1e-3)
    damped, undamped = (reduce_model(hanging, modes=modes, damping=given) for given in (law, None))
    for v, zero in ((np.zeros(5), True), (V, False)):
        change = np.subtract(*(part.rhs(Q, v, BASE, part.values).full() for part in (damped, undamped)))
        assert (np.abs(change).max() < 1e-9 * np.abs(undamped.rhs(Q, v, BASE, undamped.values).full()).max()) == zero


def test_the_acceleration_balances_the_forces_of_the_full_model(hanging, modes):
    """Virtual work with e_tt from differentiating the coordinates twice, while the base moves and rotates."""
    reduced = reduce_model(hanging, modes=modes)
    a, p = reduced.rhs(Q, V, BASE, reduced.values).full().ravel(), hanging.properties
    t = cs.MX.sym("t")
    where, rate, rate2 = BASE[:3], BASE[3:6], BASE[6:]
    base = cs.vertcat(where + rate * t + rate2 * t**2 / 2, rate + rate2 * t, rate2)
    e, e_t = reduced.coordinates(Q + V * t + a * t**2 / 2, V + a * t, base)
    e_tt = cs.jacobian(cs.jacobian(e, t), t)
    at = cs.Function("at", [t], [cs.jacobian(e, t) - e_t, e_tt])
    difference, acceleration = (part.full().ravel() for part in at(0.0))
    assert np.abs(difference).max() < 1e-12
    inertia = hanging.inertia_force(acceleration, p) - hanging.gravity_force(p, hanging.beam.gravity)
    work = projected(reduced, Q, V, BASE, lambda e, e_t: inertia.full().ravel())
    q = cs.MX.sym("q", 5)
    gradient = cs.Function("dU", [q], [cs.gradient(reduced.energies(q, V, BASE, reduced.values)[1], q)])
    elastic = gradient(Q).full().ravel()
    assert np.abs(work + elastic).max() < 1e-9 * np.abs(elastic).max()


@pytest.mark.slow
def test_energies_are_those_of_the_full_model_and_constant_without_damping(hanging, modes):
    reduced = reduce_model(hanging, modes=modes, slope_points=41)
    e, e_t = (part.full().ravel() for part in reduced.coordinates(Q, V, BASE))
    kinetic, strain, potential = (float(part) for part in reduced.energies(Q, V, BASE, reduced.values))
    p = hanging.properties
    assert kinetic == pytest.approx(float(e_t @ hanging.inertia_force(e_t, p).full().ravel()) / 2, rel=1e-10)
    assert potential == pytest.approx(-float(e @ hanging.gravity_force(p, hanging.beam.gravity).full().ravel()))
    slopes = e.reshape(-1, 4)[:, 2:]
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=1), 1.0, atol=1e-6)
    whole = nodal_slopes(modes)
    angles, stiffness = whole.angles + whole.rotations @ Q, 210e9 * hanging.beam.sections[0].second_moment
    steps = ((k, k * hanging.beam.element_lengths[0] / 2) for k in (1, 2))
    fine, coarse = (stiffness * (np.diff(angles[::k]) ** 2).sum() / h / 2 for k, h in steps)
    assert strain == pytest.approx(fine + (fine - coarse) / 3, rel=1e-3)

    q, v, base, values = reduced.energies.mx_in()
    total = sum(reduced.energies(q, v, base, values))
    change = cs.jtimes(total, q, v) + cs.jtimes(total, v, reduced.rhs(q, v, base, values))
    rate = cs.Function("rate", [q, v, base, values], [change])
    limit = 1e-12 * np.abs(kinetic) * reduced.modes.angular_frequencies[0] + 1e-13
    assert abs(float(rate(Q, V, STILL, reduced.values))) < limit


def test_gravity_is_a_parameter_and_the_static_bend_converges_with_the_modes(weightless):
    """Horizontal beam under its own weight, in modes without gravity; tip position from the elastica in references/."""
    errors = []
    for count in (1, 2, 4, 6):
        reduced = reduce_model(weightless, modes=count)
        p, zero = np.array([0.0, -9.81]), np.zeros(count)
        rest = scipy.optimize.root(lambda q: reduced.rhs(q, zero, STILL, p).full().ravel(), zero, tol=1e-12)  # noqa: B023
        errors.append(np.linalg.norm(reduced.tip(rest.x, STILL).full().ravel() - (0.4795670775, -0.1322053449)) / 0.5)
    assert np.all(np.array(errors) < (1e-2, 1e-3, 1e-4, 3e-5))
    assert np.all(np.diff(errors) < 0)


def test_the_frequency_rises_with_the_square_of_the_amplitude_by_the_exact_coefficient(weightless, docs):
    """0.0193835 (A/L)^2 for an inextensible beam: spectral Galerkin with harmonic balance, no ANCF."""
    reduced = reduce_model(weightless, modes=5)
    small, large = ((docs.frequency(reduced, share * 0.5) - 1) / share**2 for share in (0.05, 0.1))
    assert (4 * small - large) / 3 == pytest.approx(0.0193835, rel=2e-4)


@pytest.fixture
def docs(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs"))
    import reduction

    return reduction


TIME = np.linspace(0.0, 0.4, 81)
TURNED = SampledBase(TIME, np.zeros((81, 2)), 0.25 * (1 - np.cos(np.pi * TIME / 0.4)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "limits"),
    [
        (HarmonicBase(amplitude=0.02, frequency=1.85, stop=0.5), (5e-3, 1e-4, 3e-5)),
        (TURNED, (1e-2, 1e-4, 1e-4)),
    ],
    ids=["driven", "rotated"],
)
def test_motion_on_a_base_that_stops_converges_to_that_of_the_full_beam_with_the_modes(paper_beam, base, limits):
    model, law = Model(paper_beam(elements=8)), RayleighDamping(alpha=0.2, beta=3e-5)
    settings = {"base": base, "duration": 0.7, "sample_rate": 100.0}
    full = simulate(model, damping=law, method="radau", tolerance=1e-6, **settings)
    errors = []
    for m in (1, 3, 5):
        run = simulate_reduced(reduce_model(model, modes=m, damping=law), **settings)
        errors.append(np.linalg.norm(run.tip - full.tip, axis=1).max() / 0.5)
        np.testing.assert_allclose(run.base[:, :2], full.base, atol=1e-12)
    assert np.abs(full.tip[:, 0]).max() > 0.1 * 0.5
    assert np.all(np.array(errors) < limits)
    assert errors[2] < errors[1] < errors[0] / 4


def test_a_beam_at_rest_in_a_flow_stays_there(hanging):
    law = QuadraticDamping(0.2, 0.5, flow=(1.5, 0.0))
    run = simulate_reduced(reduce_model(hanging, modes=3, damping=law), duration=0.5)
    assert np.ptp(run.tip, axis=0).max() < 1e-4 * abs(run.tip[0, 0])
    assert run.tip[0, 0] == pytest.approx(simulate(hanging, damping=law, duration=0.01).tip[0, 0], rel=1e-3)


def test_a_piece_of_the_base_motion_may_lie_between_two_samples():
    class TwoStops(BaseMotion):
        def pieces(self):
            return tuple(
                Piece(end, lambda t, parameters: cs.MX(cs.DM([0.0, 0.0, 0.0]))) for end in (0.101, 0.105, np.inf)
            )

    beam = Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8000.0, elastic_modulus=210e9, elements=2)
    run = simulate_reduced(reduce_model(Model(beam), modes=1), duration=0.2, base=TwoStops(), sample_rate=100.0)
    assert run.time.shape == run.q[:, 0].shape == run.base[:, 0].shape


def test_an_impulse_of_the_clamp_does_no_work_on_the_modes(hanging, modes):
    reduced = reduce_model(hanging, modes=modes)
    moving, stopped = BASE.copy(), BASE.copy()
    stopped[3:] = 0.0
    e, e_t = (part.full().ravel() for part in reduced.coordinates(Q, V, moving))
    x = project(reduced, State(e, e_t), stopped)
    np.testing.assert_allclose(x[:5], Q, rtol=1e-9, atol=1e-12)
    after = reduced.coordinates(x[:5], x[5:], stopped)[1].full().ravel()
    impulse = hanging.inertia_force(after - e_t, hanging.properties).full().ravel()
    size = projected(reduced, Q, V, stopped, lambda *_: hanging.inertia_force(e_t, hanging.properties).full().ravel())
    assert np.abs(projected(reduced, Q, V, stopped, lambda *_: impulse)).max() < 1e-9 * np.abs(size).max()
    assert np.abs(x[5:] - V).max() > 1e-3


def test_a_step_is_of_order_four_and_exact_for_small_motion(hanging, modes):
    reduced = reduce_model(hanging, modes=modes, damping=RayleighDamping(alpha=0.2, beta=3e-5))
    base = np.zeros((9, 3))

    def end(step, q, count):
        x = np.array(q), np.zeros(5)
        for _ in range(count):
            x = step(*x, base, reduced.values, 0.02 / count)
        return np.concatenate([part.full().ravel() for part in map(cs.DM, x)])

    exact = end(reduced.step, Q, 256)
    errors = [np.abs(end(reduced.step, Q, n) - exact).max() for n in (16, 32, 64)]
    assert np.log2(errors[0] / errors[1]) > 3.7
    assert np.log2(errors[1] / errors[2]) > 3.7

    undamped = reduce_model(hanging, modes=modes)
    tiny = 1e-7 * np.ones(5)
    found = undamped.step(tiny, np.zeros(5), base, undamped.values, 0.01)[0].full().ravel()
    np.testing.assert_allclose(found, tiny * np.cos(modes.angular_frequencies * 0.01), atol=1e-4 * 1e-7)


def test_markers_and_states_agree_with_the_full_beam(hanging):
    reduced = reduce_model(hanging, modes=3, markers=(0.2, 0.5))
    start = static_equilibrium(hanging, tip_force=(2e-3, 0.0))
    run = simulate_reduced(reduced, start=start, duration=0.1, sample_rate=50.0)
    np.testing.assert_allclose(run.tip[0], start.tip, atol=2e-3)
    np.testing.assert_allclose(reduced.markers(run.q[2], run.base[2]).full().T, [run.position(0.2)[2], run.tip[2]])
    again = simulate_reduced(reduced, start=run.state(2), duration=0.06, sample_rate=50.0)
    np.testing.assert_allclose(again.q, run.q[2:], atol=1e-8 * np.abs(run.q).max())
    np.testing.assert_allclose(run.energy.sum(axis=1), run.energy[0].sum(), rtol=1e-7)


def test_unusable_input_is_refused(hanging, paper_beam, rubber_beam, modes):
    with pytest.warns(UserWarning, match="objective"):
        law = RayleighDamping(beta=1e-5, stiffness="reference")
    with pytest.raises(InputError, match=r"damping: .*strain-rate"):
        reduce_model(hanging, damping=law)
    with pytest.raises(InputError, match="modes: mode 5 stretches"):
        reduce_model(Model(rubber_beam(elements=4)), modes=6)
    with (
        pytest.warns(UserWarning, match="an element bends"),
        pytest.raises(InputError, match=r"^modes: mode 1 stretches .* elements or more$"),
    ):
        reduce_model(Model(paper_beam(4, thickness=1e-4, axis=(1.0, 0.0))), modes=1)
    for count in (0, 100, 2.5):
        with pytest.raises(InputError, match=r"^modes: must be a whole number, 1 to 80, got"):
            reduce_model(hanging, modes=count)
    with pytest.raises(InputError, match="another model"):
        reduce_model(Model(rubber_beam(elements=4)), modes=modes)
    for slope_points in (5, 42, 12.5, "many"):
        with pytest.raises(InputError, match=r"^slope_points: must be a whole number, 6 to 41, got"):
            reduce_model(hanging, modes=modes, slope_points=slope_points)
    for points in (0, 101, 2.5):
        with pytest.raises(InputError, match=r"^drag_points: must be a whole number, 1 to 100, got"):
            reduce_model(hanging, modes=modes, drag_points=points)
    with pytest.raises(InputError, match=r"^markers: must be a sequence of numbers"):
        reduce_model(hanging, modes=modes, markers=0.2)
    with pytest.raises(InputError, match="on the beam"):
        reduce_model(hanging, modes=modes, markers=(0.6,))
    reduced = reduce_model(hanging, modes=1)
    with pytest.raises(InputError, match="steps_per_period"):
        simulate_reduced(reduced, duration=1.0, steps_per_period=0.0)
    with pytest.raises(InputError, match="start"):
        simulate_reduced(reduced, duration=1.0, start="sideways")


@pytest.fixture(scope="module")
def driven_in_mode_5(paper_beam):
    """Mode 5 of a damped strip, driven by 0.1 mm for half a second, and the modal motion at the tip after it, m."""
    modes = natural_modes(Model(paper_beam(6)), count=5)
    reduced = reduce_model(modes.model, modes=modes, damping=ModalDamping(modes, RATIOS))

    def tip_amplitudes(ramp):
        base = HarmonicBase(1e-4, modes.frequencies[4], stop=0.5, ramp=ramp)
        run = simulate_reduced(reduced, base=base, duration=1.1, sample_rate=1000.0)
        free = run.relative_coordinates[run.time > base.stop_time]
        return [abs(modes.modal_coordinate(free, mode)).max() for mode in range(5)]

    return tip_amplitudes


@pytest.mark.slow
def test_a_drive_of_a_high_mode_that_starts_as_a_sine_leaves_more_of_the_first_mode(driven_in_mode_5, paper_beam):
    """The clamp starts with the velocity A omega_5, and so does the beam, while the clamp stays where it is."""
    modes = natural_modes(Model(paper_beam(6)), count=5)
    first, *_, fifth = driven_in_mode_5(ramp=0.0)
    participation = 1.57  # of the tip of a cantilever in its first mode, Blevins 1979, Table 8-1
    velocity = 1e-4 * modes.angular_frequencies[4]
    assert first == pytest.approx(participation * velocity / modes.angular_frequencies[0], rel=0.1)
    assert first > 3 * fifth


@pytest.mark.slow
@pytest.mark.parametrize("ramp", [1.0, 5.0, 20.0])
def test_with_a_ramp_it_leaves_the_mode_that_is_driven(driven_in_mode_5, ramp):
    """The rest of mode 1 is that of the stop, which holds the clamp 0.1 mm away from its mean position."""
    first, *others, fifth = driven_in_mode_5(ramp)
    assert first == pytest.approx(1.57 * 1e-4, rel=0.1)
    assert max(others) < 0.1 * fifth
    assert fifth == pytest.approx(driven_in_mode_5(0.0)[-1], rel=0.1)
