"""Steady states of the full beam against long integrations in time, under each damping law."""

from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import (
    FrictionDamping,
    HarmonicBase,
    HarmonicLoad,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    frequency_response,
    linear_frf,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
)
from ancf_casadi.response.harmonic_balance.beams import full_system, reduced_system

MODAL_RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)
AMPLITUDE = {1: 1.5e-3, 3: 0.3e-3}  # of the base, m; the tip swings up to 0.23 L in mode 1
FRICTION = {1: 0.1, 3: 2.0}  # eta0, m/s^2


@pytest.fixture(scope="module")
def beam(paper_beam):
    """The paper's beam, hanging, with four elements."""
    return Model(paper_beam(4))


@pytest.fixture(scope="module")
def modes(beam):
    return natural_modes(beam, count=5)


def law(name, modes, mode):
    slow = RayleighDamping(alpha=0.2325, beta=2e-5)
    return {
        "Rayleigh": slow,
        "quadratic": QuadraticDamping(0.2, 2.0),
        "modal": ModalDamping(modes, MODAL_RATIOS),
        "friction": slow + FrictionDamping(eta0=FRICTION[mode], smoothing_speed=0.1),
    }[name]


def continued(motion, damping, periods, factor=1.0, samples=8, tolerance=1e-9):
    """Integrate from the steady state, with its velocities relative to the clamp times a factor."""
    model, start = motion.trajectory().model, motion.trajectory().state(0)
    velocities = start.velocities.copy()
    velocities[4:] *= factor
    base = HarmonicBase(motion.drive_amplitude, motion.frequency)
    return simulate(
        model, damping=damping, base=base, start=replace(start, velocities=velocities),
        duration=periods / motion.frequency, sample_rate=samples * motion.frequency, method="radau",
        tolerance=tolerance,
    )  # fmt: skip


def distance(run, motion, samples=8):
    """Return the largest distance of the tip in the last period from the steady state, relative to the length."""
    expected = motion.trajectory(512).tip[:: 512 // samples]
    return np.abs(run.tip[-samples - 1 :] - expected).max() / run.model.beam.length


def check(motion, damping, periods=60):
    """Check the balance of energy, and that a long integration from the steady state remains there."""
    assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-9)
    assert motion.stable
    assert distance(continued(motion, damping, periods), motion) < 1e-6


def test_each_parameter_of_a_system_is_within_its_bounds(beam, modes):
    """Gravity may have either sign; the bounds of the other parameters are those of the law."""
    damping = ModalDamping(modes, [0.01] * modes.count)
    reduced = reduce_model(beam, modes=modes, damping=damping)
    for system in (full_system(beam, damping), reduced_system(reduced)):
        assert all(own.lower <= own.value <= own.upper for own in system.parameters)
        gravity = {own.name: (own.value, own.lower) for own in system.parameters if "gravity" in own.name}
        assert gravity == {"gravity_x": (0.0, -np.inf), "gravity_y": (-9.81, -np.inf)}
        assert {own.name: own.upper for own in damping.parameters}.items() <= {
            own.name: own.upper for own in system.parameters
        }.items()


@pytest.mark.slow
def test_a_load_at_a_point_shakes_the_full_and_the_reduced_beam_as_the_linear_response_says_and_beyond(paper_beam):
    """1 N at 0.12 m moves the tip and 0.2 m by the receptance while small, else the same in both models."""
    beam, damping, f = Model(paper_beam(8)), RayleighDamping(alpha=0.5), 9.0
    reduced = reduce_model(beam, modes=8, damping=damping)
    frf = linear_frf(beam, damping, [f], points=(0.2, beam.beam.length), load_points=(0.12,))
    for size in (1e-5, 0.02):
        load = HarmonicLoad((size, 0.0), f, point=0.12)
        full, few = periodic_motion(beam, damping=damping, load=load), periodic_motion(reduced, load=load)
        amplitudes = [[motion.amplitude(s) for s in frf.points] for motion in (full, few)]
        np.testing.assert_allclose(amplitudes[0], amplitudes[1], rtol=2e-3)
        if size < 1e-3:
            np.testing.assert_allclose(amplitudes[0], size * frf.amplitude[:, 0, 0], rtol=1e-4)
    assert full.supplied_energy == pytest.approx(full.dissipated_energy, rel=1e-9)
    shaken = full.trajectory()
    run = simulate(beam, damping=damping, load=load, start=shaken.state(0), duration=1 / f, sample_rate=4 * f)
    np.testing.assert_allclose(run.tip[-1], shaken.tip[-1], atol=1e-6)


@pytest.mark.slow
def test_a_large_steady_state_continues_in_a_time_integration(beam, modes):
    damping = law("Rayleigh", modes, 1)
    motion = periodic_motion(beam, damping=damping, base=HarmonicBase(AMPLITUDE[1], modes.frequencies[0]))
    assert motion.amplitude() > 0.2 * beam.beam.length
    check(motion, damping)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mode", "ratio"),  # each pair of values of any two of them
    [
        (name, (1, 3)[(i + j) % 2], ratio)
        for i, name in enumerate(["Rayleigh", "quadratic", "modal", "friction"])
        for j, ratio in enumerate([0.97, 0.99, 1.01])
    ],
)
def test_steady_states_under_each_law_continue_in_a_time_integration(beam, modes, name, mode, ratio):
    damping = law(name, modes, mode)
    base = HarmonicBase(AMPLITUDE[mode], ratio * modes.frequencies[mode - 1])
    check(periodic_motion(beam, damping=damping, base=base), damping)


@pytest.mark.slow
def test_a_beam_that_starts_at_rest_reaches_the_steady_state(beam, modes):
    """The steady state ignores the ramp of the base, by which the simulation begins."""
    damping = law("Rayleigh", modes, 1)
    base = HarmonicBase(AMPLITUDE[1], 0.97 * modes.frequencies[0], ramp=20.0)
    motion = periodic_motion(beam, damping=damping, base=base)
    run = simulate(
        beam, damping=damping, base=base, duration=240 / base.frequency, sample_rate=8 * base.frequency,
        method="radau", tolerance=1e-9,
    )  # fmt: skip
    assert motion.amplitude() > 0.05 * beam.beam.length
    assert distance(run, motion) < 1e-6


@pytest.mark.slow
def test_between_the_folds_of_mode_3_disturbed_runs_return_to_stable_motions_and_leave_the_unstable_one(beam, modes):
    damping, third = law("Rayleigh", modes, 3), modes.frequencies[2]
    curve = frequency_response(
        beam, (0.98 * third, 1.01 * third), damping=damping, base=HarmonicBase(0.1e-3, third), points=30
    )
    assert [point.kind for point in curve.bifurcations] == ["fold", "fold"]
    (up,), (down,) = curve.jumps
    assert down < 0.99 * third < up
    crossings = np.flatnonzero(np.diff(np.sign(curve.frequencies - 0.986 * third)))
    motions = [curve.motions[k] for k in crossings]
    assert [motion.stable for motion in motions] == [True, False, True]
    for motion in motions:
        assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-9)
        assert distance(continued(motion, damping, 1), motion) < 1e-6
        early, late = (distance(continued(motion, damping, n, 1.02, tolerance=1e-7), motion) for n in (1, 200))
        assert late < 0.2 * early if motion.stable else late > 10 * early
