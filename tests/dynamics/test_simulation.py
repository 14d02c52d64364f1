"""Simulated motions against exact solutions, an explicit integrator, energy and momentum."""

import warnings

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from ancf_casadi import (
    Beam,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    StrainMeasures,
    natural_modes,
    simulate,
    static_equilibrium,
)

WEIGHTLESS = {"gravity": (0.0, 0.0)}
AMPLITUDE, FREQUENCY = 20e-3, 1.85
OMEGA = 2 * np.pi * FREQUENCY
ETA1, ETA2, RATIOS = 0.1, 0.5, (0.01, 0.02)


@pytest.fixture(scope="module")
def released(paper_beam):
    """A horizontal beam released under gravity, by number of elements."""
    return {
        elements: simulate(
            Model(paper_beam(elements, axis=(1.0, 0.0))), duration=0.3, start="straight", sample_rate=200.0
        )
        for elements in (10, 20, 40)
    }


def clamped(model, displacement=(0.0, 0.0), velocity=(0.0, 0.0), acceleration=(0.0, 0.0)):
    """Clamped node of a base that does not turn: position, slope, velocities and accelerations."""
    return np.array([*displacement, *model.beam.axis, *velocity, 0.0, 0.0, *acceleration, 0.0, 0.0])


def explicit(model, pieces, instants, coordinates, velocities, damping=None):
    """Solve M e_tt = Q_g - Q_e - Q_damp by Dormand and Prince's explicit method of order 8; return the tip.

    ``pieces`` are pairs of an end time and a function from time to the clamped node, as ``clamped``.
    """
    free, size = slice(4, model.size), model.size - 4
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


@pytest.mark.slow
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


@pytest.mark.slow
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


def test_a_beam_at_rest_whose_base_starts_with_a_velocity_suffers_an_impact(rubber):
    base, settings = HarmonicBase(AMPLITUDE, FREQUENCY), {"duration": 0.02, "sample_rate": 500.0, "tolerance": 1e-9}
    run = simulate(rubber, base=base, start="impact", method="idas", **settings)
    rest = static_equilibrium(rubber).coordinates
    tip = explicit(rubber, [(np.inf, harmonic(rubber))], run.time, rest, np.zeros(rubber.size))
    assert np.abs(run.velocities[0, 4:]).max() < 1e-12 * AMPLITUDE * OMEGA
    assert run.velocities[0, 0] == pytest.approx(AMPLITUDE * OMEGA)
    assert abs(run.tip - tip).max() < 2e-7
    assert abs(run.tip[-1] - rest[-4:-2]).max() > 1e-6


@pytest.mark.slow
def test_a_base_that_stops_at_once_causes_an_impact_too(rubber):
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
    assert np.abs(run.velocities[run.time > stop, :4]).max() < 1e-12 * AMPLITUDE * OMEGA
    assert abs(run.balance_error).max() < 1e-4 * np.ptp(run.energy)  # the impact does work


def test_a_beam_at_rest_follows_a_base_whose_amplitude_grows_from_the_first_instant_on(rubber):
    """The integrators begin where nothing moves, and their steps do not jump over the first cycles."""
    ramp, time = 0.5, np.linspace(0.0, 0.2, 401)
    growth = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])(np.minimum(time * FREQUENCY / ramp, 1.0))
    moved = np.column_stack([growth * AMPLITUDE * np.sin(OMEGA * time), 0 * time])
    settings = {"duration": 0.2, "sample_rate": 50.0, "tolerance": 1e-9}
    sampled = simulate(rubber, base=SampledBase(time, moved), method="radau", **settings)
    assert abs(sampled.tip[:, 0]).max() > 0.1 * AMPLITUDE
    for method in ("idas", "radau"):
        run = simulate(rubber, base=HarmonicBase(AMPLITUDE, FREQUENCY, ramp=ramp), method=method, **settings)
        assert np.abs(run.velocities[0]).max() < 1e-10 * AMPLITUDE * OMEGA
        assert abs(run.tip - sampled.tip).max() < 2e-7


@pytest.mark.slow
def test_a_base_that_shifts_and_turns_carries_the_beam_as_an_explicit_integrator_has_it(rubber):
    """Base motion u = 20 mm (sin 7t, 1 - cos 5t), phi = 0.3 sin 6t, sampled every millisecond."""
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


@pytest.mark.slow
@pytest.mark.parametrize("ratios", [(0.1, 0.05, 0.03, 0.02, 0.01), (0.9,) * 5], ids=["light", "heavy"])
def test_a_law_of_low_rank_gives_the_motion_of_the_same_law_written_as_a_dense_force(rubber, ratios):
    law = ModalDamping(natural_modes(rubber), ratios)
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


# --------------------------------------------------------------------------------------------------------- energy


@pytest.mark.slow
@pytest.mark.parametrize("elements", [10, 20, 40])
def test_an_undamped_beam_under_gravity_keeps_its_energy(released, elements):
    run = released[elements]
    assert run.kinetic_energy.max() > 1e-3
    assert abs(run.energy - run.energy[0]).max() < 1e-5 * run.kinetic_energy.max()
    assert not run.dissipated_energy.any() and not run.base_work.any()


@pytest.mark.slow
def test_a_falling_beam_converges_with_the_elements(released):
    """Released horizontally under gravity: 20 and 40 elements differ by 1e-6 m while the tip falls 0.25 m."""
    assert released[20].tip[:, 1].min() < -0.24
    coarse, fine = (abs(released[n].tip - released[40].tip).max() for n in (10, 20))
    assert fine < 3e-6
    assert coarse < 2e-5


@pytest.mark.slow
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
    assert np.ptp(driven.base_work[~moving]) < 1e-12 * scale


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


@pytest.mark.slow
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
        axial_forces, bending_moments = ([f(s)[-1] for s in places] for f in (run.axial_force, run.bending_moment))
        axial_error = np.abs(np.subtract(axial_forces, pulls)).max() / abs(weight)
        errors.append((axial_error, np.abs(np.subtract(bending_moments, moments)).max() / abs(moments[0])))
        stiffness = 210e9 * model.beam.sections[0].second_moment
        np.testing.assert_allclose(run.curvature(0.2), run.bending_moment(0.2) / stiffness)
        np.testing.assert_allclose(run.clamp_force[-1, :2], [0.0, -weight], atol=1e-8)
    assert max(errors[1]) < 5e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[0], errors[1])), 2.0, atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("elements", "points", "wrong"), [(50, 2, True), (50, 3, False), (20, 2, False)])
def test_a_bent_beam_with_short_elements_is_warned_of(elements, points, wrong):
    """At 1 rad, elements of 0.4 thicknesses are unstable with two axial Gauss points, those of 1 thickness are not."""
    beam = Beam.uniform(length=0.1, width=0.01, thickness=5e-3, density=1000.0, elastic_modulus=1e8, elements=elements,
                        axis=(1.0, 0.0), gravity=(0.0, 0.0))  # fmt: skip
    rest = static_equilibrium(Model(beam, StrainMeasures(axial_points=points)), tip_moment=1e8 * 0.01 * 5e-3**3 / 1.2)
    assert rest.tip_angle == pytest.approx(1.0, rel=1e-3)
    assert rest.stable != wrong
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulate(rest.model, start=rest, duration=2e-4, sample_rate=1e4)
    assert ["use fewer elements" in str(warning.message) for warning in caught] == [True] * wrong
