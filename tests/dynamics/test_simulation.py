import re
import shutil

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from ancf_casadi import (
    BaseMotion,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    SimulationError,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics import integration
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.support import compilation

WEIGHTLESS = {"gravity": (0.0, 0.0)}
AMPLITUDE, FREQUENCY = 20e-3, 1.85
OMEGA = 2 * np.pi * FREQUENCY
ETA1, ETA2, RATIOS = 0.1, 0.5, (0.01, 0.02)


@pytest.fixture(scope="module")
def small(paper_beam):
    """The paper's beam, hanging, with four elements."""
    return Model(paper_beam(4))


@pytest.fixture(scope="module")
def rubber(rubber_beam):
    """A hanging rubber beam with three elements."""
    return Model(rubber_beam())


@pytest.fixture(scope="module")
def released(paper_beam):
    """A horizontal beam released under gravity, by number of elements."""
    return {
        elements: simulate(
            Model(paper_beam(elements, axis=(1.0, 0.0))), duration=0.3, start="straight", sample_rate=200.0
        )
        for elements in (10, 20, 40)
    }


@pytest.fixture(scope="module")
def driven(rubber):
    """A damped beam on a base that moves and stops between two samples."""
    modes = natural_modes(rubber, count=2)
    law = ModalDamping(modes, RATIOS) + QuadraticDamping(ETA1, ETA2)
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.3)
    return simulate(rubber, damping=law, base=base, duration=0.6, sample_rate=970.0, tolerance=1e-9)


def clamped(model, displacement=(0.0, 0.0), velocity=(0.0, 0.0), acceleration=(0.0, 0.0)):
    """Clamped node of a base that does not turn: position, slope, velocities and accelerations."""
    return np.array([*displacement, *model.beam.axis, *velocity, 0.0, 0.0, *acceleration, 0.0, 0.0])


def explicit(model, pieces, instants, coordinates, velocities, damping=None):
    """Solve M e_tt = Q_g - Q_e - Q_damp by Dormand and Prince's explicit method of order 8; return the tip.

    ``pieces`` are pairs of an end time and a function from time to the clamped node, as ``clamped``.
    """
    free, size = model.free, model.size - 4
    mass = model.mass(model.properties).full()
    gravity = model.gravity_force(model.properties, model.beam.gravity).full().ravel()
    q, v, node = cs.MX.sym("q", size), cs.MX.sym("v", size), cs.MX.sym("node", 12)
    e, e_t = cs.vertcat(node[:4], q), cs.vertcat(node[4:8], v)
    force = gravity - model.elastic_force(e, model.properties) - cs.DM(mass[:, :4]) @ node[8:]
    if damping is not None:
        force -= damping(e, e_t)
    a = cs.DM(np.linalg.inv(mass[free, free])) @ force[free]
    acceleration = cs.Function("acceleration", [q, v, node], [a]).expand()
    state, begin, tips = np.concatenate([coordinates[free], velocities[free]]), 0.0, []
    for end, motion in pieces:
        inside = instants[(instants >= begin if begin == 0.0 else instants > begin) & (instants <= end)]
        finish = min(end, instants[-1])
        run = solve_ivp(
            lambda t, x, motion=motion: np.concatenate(
                [x[size:], acceleration(x[:size], x[size:], motion(t)).full().ravel()]
            ),
            (begin, finish),
            state,
            method="DOP853",
            t_eval=np.union1d(inside, finish),
            rtol=1e-10,
            atol=1e-12,
        )
        tips.append(run.y[size - 4 : size - 2, : len(inside)].T)
        state, begin = run.y[:, -1], end
    return np.vstack(tips)


def harmonic(model):
    """Clamped node of u = A sin(omega t) along x."""

    def node(t):
        u = AMPLITUDE * np.sin(OMEGA * t)
        return clamped(model, (u, 0.0), (AMPLITUDE * OMEGA * np.cos(OMEGA * t), 0.0), (-(OMEGA**2) * u, 0.0))

    return node


def rigid(model, speed):
    """Velocities of a beam that moves along x as a rigid body."""
    return np.tile([speed, 0.0, 0.0, 0.0], model.beam.elements + 1)


# ---------------------------------------------------------------------------------------- against exact solutions


def test_a_released_beam_swings_as_the_sum_of_its_exact_modes(paper_beam, bending_stiffness):
    """Released from a small tip force F: tip = sum 4 F/(m omega_k^2) cos omega_k t, with the mass m of the beam."""
    model = Model(paper_beam(16, **WEIGHTLESS))
    stiffness, mass = bending_stiffness(model.beam), model.beam.mass
    force = 6e-3 * stiffness / 0.5**2
    roots = np.array([1.875104068712, 4.694091132974, 7.854757438238, *(np.pi * (np.arange(3, 12) + 0.5))])
    omega = roots**2 * np.sqrt(stiffness / (mass / 0.5)) / 0.5**2
    start = static_equilibrium(model, tip_force=(force, 0.0))
    run = simulate(model, start=start, duration=0.7, tolerance=1e-9)
    exact = np.cos(np.outer(run.time, omega)) @ (4 * force / (mass * omega**2))
    assert exact[0] == pytest.approx(force * 0.5**3 / (3 * stiffness), rel=3e-5)  # twelve modes
    assert abs(run.tip[:, 0] - exact).max() < 1e-3 * exact[0]


def test_a_beam_at_rest_stays_at_rest(small):
    run = simulate(small, duration=0.2, sample_rate=50.0)
    np.testing.assert_allclose(run.tip, np.tile(static_equilibrium(small).tip, (11, 1)), atol=1e-12)
    assert abs(run.velocities).max() < 1e-9


# ------------------------------------------------------------------------------- against an independent integrator


def test_a_damped_beam_under_a_base_that_moves_and_stops_agrees_with_an_explicit_integrator(rubber, driven):
    """With the law written out: C = M Phi diag(2 zeta omega) Phi^T M + eta1 M, and the drag of Eq. (23)."""
    modes, stop = natural_modes(rubber, count=2), 1.5 / (2 * FREQUENCY)
    mass = rubber.mass(rubber.properties).full()
    shapes = mass @ modes.shapes
    C = cs.DM(shapes @ np.diag(2 * np.array(RATIOS) * modes.angular_frequencies) @ shapes.T + ETA1 * mass)
    tip = explicit(
        rubber,
        [(stop, harmonic(rubber)), (np.inf, lambda t: clamped(rubber, (-AMPLITUDE, 0.0)))],
        driven.time[::10],
        static_equilibrium(rubber).coordinates,
        rigid(rubber, AMPLITUDE * OMEGA),
        lambda e, e_t: C @ e_t + ETA2 * 1183 / 876 * rubber.drag_force(e_t, rubber.properties),
    )
    assert abs(tip[:, 0]).max() > 3 * AMPLITUDE
    assert abs(driven.tip[::10] - tip).max() < 5e-7


def test_a_beam_at_rest_whose_base_starts_with_a_speed_is_struck(rubber):
    base, settings = HarmonicBase(AMPLITUDE, FREQUENCY), {"duration": 0.02, "sample_rate": 500.0, "tolerance": 1e-9}
    run = simulate(rubber, base=base, start="impact", method="idas", **settings)
    rest = static_equilibrium(rubber).coordinates
    tip = explicit(rubber, [(np.inf, harmonic(rubber))], run.time, rest, np.zeros(rubber.size))
    assert not run.velocities[0, 4:].any()
    assert run.velocities[0, 0] == pytest.approx(AMPLITUDE * OMEGA)
    assert abs(run.tip - tip).max() < 2e-7
    assert abs(run.tip[-1] - rest[-4:-2]).max() > 1e-6


def test_a_base_that_stops_at_once_strikes_the_beam_too(rubber):
    stop = 0.0513
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=stop, stop_at="once")
    run = simulate(rubber, base=base, duration=0.07, sample_rate=500.0, tolerance=1e-9)
    held = AMPLITUDE * np.sin(OMEGA * stop)
    tip = explicit(
        rubber,
        [(stop, harmonic(rubber)), (np.inf, lambda t: clamped(rubber, (held, 0.0)))],
        run.time,
        static_equilibrium(rubber).coordinates,
        rigid(rubber, AMPLITUDE * OMEGA),
    )
    assert abs(run.tip - tip).max() < 2e-7
    assert not run.velocities[run.time > stop, :4].any()
    assert abs(run.balance_error).max() < 1e-4 * np.ptp(run.energy)  # the impact does work


def test_a_base_that_shifts_and_turns_carries_the_beam_as_an_explicit_integrator_has_it(rubber):
    """U = 20 mm (sin 7t, 1 - cos 5t), phi = 0.3 sin 6t, sampled every millisecond; the beam starts with the base."""
    t = np.arange(0.0, 0.301, 1e-3)
    shift = 0.02 * np.column_stack([np.sin(7 * t), 1 - np.cos(5 * t)])
    run = simulate(
        rubber,
        base=SampledBase(t, shift, 0.3 * np.sin(6 * t)),
        duration=0.25,
        sample_rate=100.0,
        tolerance=1e-9,
    )

    def node(t):
        """Node (u, R axis) with the axis along -y: R axis = (sin phi, -cos phi)."""
        phi, rate, acceleration = 0.3 * np.sin(6 * t), 1.8 * np.cos(6 * t), -10.8 * np.sin(6 * t)
        along, across = np.array([np.sin(phi), -np.cos(phi)]), np.array([np.cos(phi), np.sin(phi)])
        shift = 0.02 * np.array([[np.sin(7 * t), 1 - np.cos(5 * t)], [7 * np.cos(7 * t), 5 * np.sin(5 * t)]])
        return np.concatenate(
            [
                shift[0],
                along,
                shift[1],
                rate * across,
                0.02 * np.array([-49 * np.sin(7 * t), 25 * np.cos(5 * t)]),
                acceleration * across - rate**2 * along,
            ]
        )

    rest = static_equilibrium(rubber).coordinates
    velocities = 1.8 * (rest.reshape(-1, 2) @ np.array([[0.0, 1.0], [-1.0, 0.0]])).ravel() + rigid(rubber, 0.14)
    tip = explicit(rubber, [(np.inf, node)], run.time, rest, velocities)
    np.testing.assert_allclose(run.velocities[0], velocities, atol=1e-9)
    assert abs(run.tip - tip).max() < 5e-7


# --------------------------------------------------------------------------------------------------------- energy


@pytest.mark.parametrize("elements", [10, 20, 40])
def test_an_undamped_beam_under_gravity_keeps_its_energy(released, elements):
    run = released[elements]
    assert run.kinetic_energy.max() > 1e-3
    assert abs(run.energy - run.energy[0]).max() < 1e-5 * run.kinetic_energy.max()
    assert not run.dissipated_energy.any() and not run.base_work.any()


def test_a_falling_beam_converges_with_the_elements(released):
    """Released horizontally under gravity: 20 and 40 elements differ by 1e-6 m while the tip falls 0.25 m."""
    assert released[20].tip[:, 1].min() < -0.24
    coarse, fine = (abs(released[n].tip - released[40].tip).max() for n in (10, 20))
    assert fine < 3e-6
    assert coarse < 2e-5


@pytest.mark.parametrize(
    "law",
    [
        RayleighDamping(alpha=0.5),
        RayleighDamping(beta=1e-3),
        RayleighDamping(beta=1e-3, stiffness="tangent"),
        QuadraticDamping(eta1=0.5),
        QuadraticDamping(eta2=1.0),
    ],
    ids=repr,
)
@pytest.mark.parametrize(("method", "tolerance"), [("idas", 1e-8), ("radau", 1e-7)])
def test_every_law_lets_the_energy_only_fall_and_accounts_for_what_is_gone(paper_beam, law, method, tolerance):
    run = simulate(
        Model(paper_beam(6, axis=(1.0, 0.0))),
        damping=law,
        start="straight",
        duration=0.3,
        sample_rate=500.0,
        method=method,
        tolerance=tolerance,
    )
    lost = run.energy[0] - run.energy[-1]
    assert lost > 1e-3 * run.kinetic_energy.max()
    assert (np.diff(run.energy) < 1e-7 * lost).all()
    assert abs(run.balance_error).max() < 1e-3 * lost
    assert run.dissipated_energy[-1] == pytest.approx(lost, rel=1e-3)


def test_work_of_the_base_and_energy_lost_account_for_the_change_of_energy(driven):
    """Also across the stop; the work is the integral of the clamp force times the clamp velocity."""
    scale = np.ptp(driven.energy)
    moving = driven.time < 1.5 / (2 * FREQUENCY)
    power = (driven.clamp_force[moving] * driven.velocities[moving, :4]).sum(axis=1)
    assert abs(driven.base_work).max() > 0.1 * scale and driven.dissipated_energy[-1] > 1e-3 * scale
    assert abs(driven.balance_error).max() < 1e-5 * scale
    assert trapezoid(power, driven.time[moving]) == pytest.approx(driven.base_work[moving][-1], abs=1e-3 * scale)


def test_the_clamps_force_and_the_weight_change_the_momentum(rubber):
    """Integral of F + m g over time, by Simpson's rule, undamped."""
    run = simulate(
        rubber,
        base=HarmonicBase(AMPLITUDE, FREQUENCY),
        duration=0.2,
        sample_rate=1000.0,
        tolerance=1e-10,
    )
    mass = rubber.mass(rubber.properties).full()
    momentum = run.velocities @ mass @ np.tile(np.eye(4, 2), (rubber.beam.elements + 1, 1))
    force = run.clamp_force[:, :2] + rubber.beam.mass * np.array([0.0, -9.81])
    impulse = (force[0] + 4 * force[1:-1:2].sum(axis=0) + 2 * force[2:-1:2].sum(axis=0) + force[-1]) / 3000.0
    np.testing.assert_allclose(momentum[-1] - momentum[0], impulse, atol=1e-3 * abs(momentum).max())


def test_forces_in_a_sagging_beam_are_those_of_statics_to_second_order_in_the_element_length(paper_beam):
    """The weight w beyond a section loads it: N = w . t, M = int (r - r(s)) x mu g ds."""
    errors = []
    for elements in (10, 20):
        model = Model(paper_beam(elements, axis=(1.0, 0.0)))
        run = simulate(model, duration=0.01, sample_rate=100.0)
        weight, places = model.beam.mass * -9.81, (0.0, 0.0401, 0.1, 0.2, 0.31, 0.5)
        beyond = [np.linspace(s, 0.5, 401) for s in places]
        arms = [
            [run.position(p)[-1, 0] - run.position(s)[-1, 0] for p in part]
            for s, part in zip(places, beyond, strict=True)
        ]
        moments = [trapezoid(arm, part) * weight / 0.5 for arm, part in zip(arms, beyond, strict=True)]
        pulls = [(1 - s / 0.5) * weight * np.sin(run.slope(s)[-1]) for s in places]
        errors.append(
            (
                np.max(
                    [abs(run.axial_force(s)[-1] - pull) / abs(weight) for s, pull in zip(places, pulls, strict=True)]
                ),
                np.max(
                    [abs(run.bending_moment(s)[-1] - m) / abs(moments[0]) for s, m in zip(places, moments, strict=True)]
                ),
            )
        )
        stiffness = 210e9 * model.beam.sections[0].second_moment
        np.testing.assert_allclose(run.curvature(0.2), run.bending_moment(0.2) / stiffness)
        np.testing.assert_allclose(run.clamp_force[-1, :2], [0.0, -weight], atol=1e-8)
    assert max(errors[1]) < 5e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[0], errors[1])), 2.0, atol=0.3)


# --------------------------------------------------------------------------------- what the numbers do not depend on


def test_the_error_falls_with_the_tolerance(rubber):
    def tip(tolerance):
        base = HarmonicBase(AMPLITUDE, FREQUENCY)
        return simulate(rubber, base=base, duration=0.4, sample_rate=100.0, tolerance=tolerance).tip

    exact = tip(3e-11)
    errors = [abs(tip(tolerance) - exact).max() for tolerance in (1e-6, 1e-7, 1e-8, 1e-9)]
    assert errors[0] > 3 * errors[1] > 9 * errors[2] > 27 * errors[3]
    assert errors[2] < 1e-5


def test_a_law_of_low_rank_gives_the_motion_of_the_same_law_written_as_a_dense_force(rubber):
    law = ModalDamping(natural_modes(rubber), (0.1, 0.05, 0.03, 0.02, 0.01))
    start = static_equilibrium(rubber, tip_force=(0.2, 0.0))
    settings = {"start": start, "duration": 0.4, "sample_rate": 100.0, "tolerance": 1e-9}
    sparse, undamped = (simulate(rubber, damping=damping, **settings) for damping in (law, None))
    still = [(np.inf, lambda t: clamped(rubber))]
    dense = explicit(
        rubber, still, sparse.time, start.coordinates, np.zeros(rubber.size), lambda e, e_t: law.force(rubber, e, e_t)
    )
    assert law.projection(rubber).shape == (16, 5)
    assert abs(sparse.tip - dense).max() < 1e-6
    assert abs(sparse.tip - undamped.tip).max() > 1e-3


@pytest.mark.parametrize("segments", [1, 7, 60])
def test_the_motion_does_not_depend_on_how_often_the_integrator_restarts(rubber, monkeypatch, segments):
    def run():
        base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.1)
        return simulate(rubber, base=base, duration=0.3, sample_rate=100.0, tolerance=1e-9)

    usual = run()
    monkeypatch.setattr(integration, "SEGMENTS", segments)
    other = run()
    np.testing.assert_array_equal(other.time, usual.time)
    assert abs(other.coordinates - usual.coordinates).max() < 1e-6
    assert abs(other.balance_error).max() < 1e-5 * np.ptp(usual.energy)


@pytest.mark.parametrize("rate", [10.0, 97.0, 250.0, 1000 / 7])
def test_the_motion_does_not_depend_on_the_sampling_nor_on_where_the_stop_falls_between_samples(rubber, rate):
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.1)
    settings = {"base": base, "tolerance": 1e-9}
    sampled = simulate(rubber, duration=0.3, sample_rate=rate, **settings)
    fine = simulate(rubber, duration=0.3, sample_rate=7 * rate, **settings)
    np.testing.assert_allclose(sampled.time, np.arange(int(0.3 * rate + 1e-9) + 1) / rate, rtol=1e-14)
    np.testing.assert_allclose(fine.time[::7][: len(sampled.time)], sampled.time, atol=1e-14)
    assert abs(fine.coordinates[::7][: len(sampled.time)] - sampled.coordinates).max() < 1e-6


@pytest.mark.parametrize("stop", [0.02, 0.25, 15.0, np.inf])
def test_the_clamp_follows_the_base_to_the_last_sample_wherever_the_stop_is(small, stop):
    """With a stop after the end, the last sample of the clamp was once at the position of the stop."""
    base = HarmonicBase(5e-3, FREQUENCY, stop=stop, direction=(0.6, 0.8))
    run = simulate(small, base=base, duration=0.3, sample_rate=100.0, tolerance=1e-7)
    u = 5e-3 * np.sin(OMEGA * np.minimum(run.time, base.stop_time))
    v = 5e-3 * OMEGA * np.cos(OMEGA * run.time) * (run.time < base.stop_time)
    np.testing.assert_allclose(run.base, np.outer(u, [0.6, 0.8]), atol=1e-16)
    np.testing.assert_allclose(run.velocities[:, :2], np.outer(v, [0.6, 0.8]), atol=1e-15)
    np.testing.assert_array_equal(run.coordinates[:, 2:4], np.tile([0.0, -1.0], (31, 1)))


def test_a_run_can_be_continued_from_its_last_state(rubber):
    law, settings = QuadraticDamping(0.2, 1.0), {"sample_rate": 100.0, "tolerance": 1e-10}
    start = static_equilibrium(rubber, tip_force=(0.01, 0.0))
    whole = simulate(rubber, damping=law, start=start, duration=0.4, **settings)
    first = simulate(rubber, damping=law, start=start, duration=0.2, **settings)
    second = simulate(rubber, damping=law, start=first.state(-1), duration=0.2, **settings)
    assert abs(np.vstack([first.tip, second.tip[1:]]) - whole.tip).max() < 1e-6


@pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="there is no C compiler")
def test_compiled_equations_give_the_motion_of_the_interpreted_ones_and_are_found_again(
    rubber_beam, monkeypatch, tmp_path
):
    model = Model(rubber_beam(2))
    settings = {"damping": RayleighDamping(1.0, 1e-4), "base": HarmonicBase(5e-3, FREQUENCY)}
    settings |= {"duration": 1.0, "sample_rate": 50.0, "tolerance": 1e-9}
    monkeypatch.setenv("ANCF_CASADI_CACHE", str(tmp_path))
    monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")
    interpreted = simulate(model, **settings)
    assert not list(tmp_path.iterdir())
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)
    compiled = simulate(model, **settings)
    libraries = sorted(tmp_path.iterdir())
    again = simulate(model, **settings)
    assert [library.suffix for library in libraries] == [".so", ".so"]
    assert sorted(tmp_path.iterdir()) == libraries
    np.testing.assert_array_equal(compiled.tip, interpreted.tip)
    np.testing.assert_array_equal(again.tip, compiled.tip)


def test_a_compiler_that_does_not_work_is_done_without(paper_beam, monkeypatch, tmp_path):
    monkeypatch.setenv("ANCF_CASADI_CACHE", str(tmp_path))
    settings = {"damping": RayleighDamping(1.0, 1e-3), "method": "idas", "duration": 1.0, "sample_rate": 50.0}
    interpreted = simulate(Model(paper_beam(2)), **settings)
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)
    monkeypatch.setenv("CC", "false")
    monkeypatch.setattr(compilation, "_failed", set())
    with pytest.warns(UserWarning, match="false fails: exit code 1"):
        np.testing.assert_array_equal(simulate(Model(paper_beam(2)), **settings).tip, interpreted.tip)


# ------------------------------------------------------------------------------------------------- starts and samples


def test_a_run_starts_as_told(small):
    base = HarmonicBase(5e-3, FREQUENCY)
    held = static_equilibrium(small, tip_force=(1e-3, 0.0))
    rest, none = static_equilibrium(small).coordinates, np.zeros(small.size)
    with_base = rigid(small, 5e-3 * OMEGA)
    swinging = with_base + np.where(np.arange(small.size) < 4, 0.0, 0.1)
    for start, coordinates, velocities in (
        ("equilibrium", rest, with_base),
        ("impact", rest, none),
        ("straight", small.straight, with_base),
        (held, held.coordinates, with_base),
        (State(rest, swinging), rest, swinging),
    ):
        run = simulate(small, base=base, start=start, duration=1e-4, sample_rate=1e4, method="radau")
        np.testing.assert_allclose(run.coordinates[0], coordinates, atol=1e-14)
        np.testing.assert_allclose(run.velocities[0, 4:], velocities[4:], atol=1e-14)
        np.testing.assert_allclose(run.velocities[0, :4], with_base[:4], atol=1e-14)


def test_places_and_speeds_are_those_of_the_points_asked_for(driven):
    np.testing.assert_array_equal(driven.position(0.5), driven.tip)
    np.testing.assert_array_equal(driven.position(0.0), driven.base)
    step = 1 / 970.0
    differences = (driven.position(0.3)[2:] - driven.position(0.3)[:-2]) / (2 * step)
    np.testing.assert_allclose(driven.velocity(0.3)[1:-1], differences, atol=2e-3)
    relative = driven.relative_coordinates
    np.testing.assert_allclose(relative[:, -4:-2], driven.tip - driven.base, atol=1e-16)
    np.testing.assert_array_equal(relative[:, 2::4], driven.coordinates[:, 2::4])
    assert driven.steps > 100 and driven.wall_seconds > 0.0


def test_the_slope_is_unwrapped_where_a_beam_turns_over(rubber_beam):
    stiff = Model(rubber_beam(elastic_modulus=210e9 / 16))
    t = np.linspace(0.0, 0.5, 201)
    turn = 2 * np.pi * (10 * (2 * t) ** 3 - 15 * (2 * t) ** 4 + 6 * (2 * t) ** 5)
    turning = SampledBase(t, np.zeros((201, 2)), turn)
    run = simulate(stiff, base=turning, duration=0.5, sample_rate=400.0, tolerance=1e-7)
    np.testing.assert_allclose(run.slope(0.0), turn - np.pi / 2, atol=1e-9)
    assert abs(run.slope(0.5) - run.slope(0.0)).max() < 1.5


# ---------------------------------------------------------------------------------------------- progress and failure


def test_progress_is_shown_on_the_error_stream_only_when_asked_for(small, capfd):
    simulate(small, duration=0.1)
    assert capfd.readouterr() == ("", "")
    simulate(small, duration=0.1, progress=True)
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "100%" in shown.err and "0.10/0.10 s [" in shown.err


def test_a_failing_integration_is_one_line_of_advice_and_nothing_else_is_printed(small, capfd):
    with pytest.raises(
        SimulationError, match=r"^IDAS took too many steps between two samples at \S+e-\d\d s: modes .*; try "
    ) as caught:
        simulate(small, start="straight", duration=0.1, method="idas", options={"max_num_steps": 1})
    assert "\n" not in str(caught.value)
    assert 0.0 < caught.value.time < 1e-6
    assert caught.value.__cause__ is None and caught.value.__suppress_context__
    assert len(caught.value.partial.time) == 0
    assert capfd.readouterr() == ("", "")


def test_a_run_that_fails_on_the_way_keeps_what_it_has(small):
    """The impact of a sudden stop takes more steps than allowed."""
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.2, stop_at="once")
    settings = {"base": base, "duration": 0.3, "sample_rate": 100.0, "tolerance": 1e-7, "method": "idas"}
    with pytest.raises(SimulationError) as caught:
        simulate(small, options={"max_num_steps": 1000}, **settings)
    partial = caught.value.partial
    assert 0.2 < caught.value.time < 0.21
    assert partial.time[-1] == pytest.approx(0.2)
    undisturbed = simulate(small, **settings | {"base": HarmonicBase(AMPLITUDE, FREQUENCY), "duration": 0.2})
    assert abs(partial.tip - undisturbed.tip).max() < 1e-4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nonsense": 1}, "Unknown option: nonsense"),
        ({"reltol": "small"}, "Illegal type for reltol: OT_STRING cannot be cast to OT_DOUBLE."),
        ({"linear_solver": "ma99"}, "Cannot load shared library 'libcasadi_linsol_ma99."),
        ({"max_multistep_order": 7}, 'IDASetMaxOrd returned "IDA_ILL_INPUT"'),
        ({"abstol": -1.0}, 'IDASStolerances returned "IDA_ILL_INPUT"'),
    ],
)
def test_an_option_that_idas_refuses_is_named_in_one_line(small, capfd, options, message):
    expected = re.escape(f"options: CasADi's IDAS interface refuses them: {message}")
    with pytest.raises(InputError, match=f"^{expected}") as caught:
        simulate(small, duration=0.1, options=options)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_options_override_the_defaults(small):
    settings = {"start": "straight", "duration": 0.05, "method": "idas"}
    loose = simulate(small, options={"abstol": 1e-5}, **settings)
    assert loose.steps < simulate(small, **settings).steps / 2


@pytest.mark.parametrize("method", ["idas", "radau"])
def test_a_run_that_crawls_is_given_up_and_keeps_what_it_has(small, method):
    with pytest.raises(
        SimulationError, match=r"^the integrator took \d+ steps up to 0\.\d+ s, more than 10, "
    ) as caught:
        simulate(small, start="straight", duration=0.1, most_steps=10, method=method, tolerance=1e-10)
    assert caught.value.partial.time[-1] == pytest.approx(caught.value.time)


@pytest.mark.parametrize("method", ["idas", "radau"])
def test_no_step_is_longer_than_allowed(small, method):
    """A beam at rest needs only a few steps otherwise."""
    free = simulate(small, duration=0.1, method=method)
    bounded = simulate(small, duration=0.1, method=method, largest_step=1e-4)
    assert free.steps < 500 and bounded.steps >= 999


def test_radau_below_rounding_says_so_with_time_and_step(small):
    with pytest.raises(SimulationError, match=r"^the integrator could not go on at 0 s with a step of \S+ s: "):
        simulate(small, start="straight", duration=0.1, tolerance=1e-40, method="radau")


class Endless(BaseMotion):
    """A motion that becomes infinite."""

    def pieces(self):
        return (Piece(np.inf, lambda t, parameters: cs.vertcat(cs.log(0.05 - t), 0.0, 0.0)),)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"duration": 0.0}, "duration: must be positive, got 0"),
        ({"duration": np.inf}, "duration: must be a finite number, got inf"),
        ({"duration": 1e-3, "sample_rate": 10.0}, "duration: must be at least one sampling interval, 0.1 s, got 0.001"),
        ({"sample_rate": -1.0}, "sample_rate: must be positive, got -1"),
        ({"tolerance": 0.0}, "tolerance: must be positive, got 0"),
        ({"method": "bdf"}, "method: must be one of auto, idas, radau, got 'bdf'"),
        ({"method": "radau", "options": {"reltol": 1.0}}, "options: are those of IDAS; method='radau' has none"),
        ({"largest_step": 0.0}, "largest_step: must be positive, got 0"),
        ({"most_steps": 0}, "most_steps: must be a whole number, 1 or more, got 0"),
        ({"base": Endless()}, "base: its position, velocity or acceleration is not finite at 0.05 s"),
        ({"tolerance": "tight"}, "tolerance: must be a finite number, got 'tight'"),
        (
            {"start": "rest"},
            "start: must be one of equilibrium, straight, impact, an Equilibrium or a State, got 'rest'",
        ),
        ({"start": State(np.zeros(4), np.zeros(20))}, "start: the coordinates must be 20 finite numbers"),
        ({"start": State(np.zeros(20), np.full(20, np.nan))}, "start: the velocities must be 20 finite numbers"),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name(small, settings, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        simulate(small, **{"duration": 0.1} | settings)


def test_an_equilibrium_of_another_model_is_no_start(small, rubber):
    with pytest.raises(InputError, match=r"^start: the equilibrium belongs to another model$"):
        simulate(small, start=static_equilibrium(rubber), duration=0.1)


def test_a_linear_mode_shape_of_finite_amplitude_is_no_start_since_it_stretches_the_beam(small):
    modes = natural_modes(small, count=1)
    bent = modes.equilibrium.coordinates + 0.1 * modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    with pytest.raises(
        InputError, match=r"^start: stretches the beam by \d\.\d %, which sets off axial waves; bend it"
    ):
        simulate(small, start=State(bent, np.zeros(small.size)), duration=0.1)


def test_a_sample_or_a_point_that_is_not_there_is_refused(driven):
    with pytest.raises(InputError, match=r"^index: must be a whole number, -583 to 582, got 583$"):
        driven.state(583)
    for quantity in ("position", "velocity", "slope", "curvature", "axial_force", "bending_moment"):
        with pytest.raises(InputError, match=r"^s: the point must be on the beam, 0 to 0\.5 m, got 0\.6$"):
            getattr(driven, quantity)(0.6)
