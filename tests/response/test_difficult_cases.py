"""Isolas, internal resonances, vanishing damping and violent drives: the right curve, or one line that says why not."""

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ancf_casadi import (
    HarmonicBase,
    HarmonicForce,
    InputError,
    Model,
    NumericsError,
    RayleighDamping,
    SecondOrderSystem,
    amplitude_response,
    frequency_response,
    natural_modes,
    periodic_motion,
    simulate,
)

HZ = 1 / (2 * np.pi)


def state(motion, count=1):
    """Return displacements and velocities of the coordinates at the phase 0 of the force."""
    X = np.array([motion.harmonics(k) for k in range(count)])
    order = np.arange(X.shape[1])
    return np.concatenate([X.sum(axis=1).imag, motion.frequency / HZ * (order * X).sum(axis=1).real])


def integrated(acceleration, Ω, start, periods):
    """Return the state after a number of periods of x_tt = acceleration(t, x, x_t), by a method of order 8."""

    def rate(t, z):
        x, v = np.split(z, 2)
        return np.concatenate([v, acceleration(t, x, v)])

    return solve_ivp(rate, (0, periods / (HZ * Ω)), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


def oscillator(stiffness, damping):
    """Return a system of one coordinate from its stiffness and damping force."""
    q, v, a, u = (cs.SX.sym(name) for name in "qvau")
    return SecondOrderSystem.of(q, v, a, u, conservative=a + stiffness(q), damping=damping(v), excitation=u)


# The damping force c1 v - c3 v^3 + c5 v^5 does the work of c v, c = c1 - 3/4 c3 A^2 + 5/8 c5 A^4, at the frequency 1.
C1, C3, C5, HARDENING = 0.1, 0.12, 0.045, 0.002
WEAK, STRONG = 0.04, 0.06


def isola_system():
    return oscillator(lambda q: q + HARDENING * q**3, lambda v: C1 * v - C3 * v**3 + C5 * v**5)


def resonant_force(A):
    return A * (C1 - 3 / 4 * C3 * A**2 + 5 / 8 * C5 * A**4)


def test_a_curve_does_not_jump_to_an_isola():
    curve = frequency_response(isola_system(), (0.7 * HZ, 1.3 * HZ), force=HarmonicForce(WEAK, HZ))
    top = brentq(lambda A: resonant_force(A) - WEAK, 0.1, 0.7)
    assert curve.amplitude().max() == pytest.approx(top, rel=0.01)
    assert not curve.bifurcations and np.all(curve.stable)


@pytest.mark.slow
def test_an_isola_is_a_closed_curve_with_the_amplitudes_of_the_closed_form():
    """At its largest and smallest amplitude, the force balances the damping, to first order."""
    system, weak = isola_system(), HarmonicForce(WEAK, HZ)
    strong = periodic_motion(system, force=HarmonicForce(STRONG, HZ))
    isola = frequency_response(system, (0.9 * HZ, 1.1 * HZ), force=weak, start=strong)
    assert isola.closed
    np.testing.assert_array_equal(isola.drive_amplitudes, WEAK)
    low = brentq(lambda A: resonant_force(A) - WEAK, 0.8, 1.2)
    high = brentq(lambda A: resonant_force(A) - WEAK, 1.3, 2.0)
    assert isola.amplitude().max() == pytest.approx(high, rel=0.01)
    assert isola.amplitude().min() == pytest.approx(low, rel=0.01)
    assert sorted(point.kind for point in isola.bifurcations) == ["fold", "fold"]
    assert np.all(isola.stable[isola.amplitude() > 1.3]) and not np.any(isola.stable[isola.amplitude() < 1.1])


def test_a_start_of_another_frequency_or_system_is_refused_in_one_line():
    system = isola_system()
    motion = periodic_motion(system, force=HarmonicForce(STRONG, HZ))
    with pytest.raises(InputError, match=r"start: vibrates at 0.159155 Hz, outside the range"):
        frequency_response(system, (0.2, 0.3), force=HarmonicForce(STRONG, HZ), start=motion)


def coupled(ratio, coupling, damping):
    """Return two oscillators of frequencies 1 and ``ratio``, coupled by the potential; the first is driven."""
    q, v, a = (cs.SX.sym(name, 2) for name in "qva")
    u = cs.SX.sym("u")
    linear = cs.vertcat(q[0], ratio**2 * q[1])
    return SecondOrderSystem.of(
        q, v, a, u, conservative=a + linear + cs.gradient(coupling(q), q), damping=damping * v,
        excitation=cs.vertcat(u, 0),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("Ω", [1.0, 1.03])
def test_an_internal_resonance_of_one_to_three_is_the_end_of_a_time_integration(Ω):
    damping, force = 0.08, 0.12
    system = coupled(3.05, lambda q: 0.1 * q[0] ** 4 + 0.3 * q[0] ** 3 * q[1], damping)
    motion = periodic_motion(system, force=HarmonicForce(force, Ω * HZ), tolerance=1e-9)

    def acceleration(t, x, v):
        pull = np.array([0.4 * x[0] ** 3 + 0.9 * x[0] ** 2 * x[1], 0.3 * x[0] ** 3])
        return np.array([force * np.sin(Ω * t), 0.0]) - damping * v - x * np.array([1.0, 3.05**2]) - pull

    settled = integrated(acceleration, Ω, np.zeros(4), round(2 * 24 / damping * Ω * HZ))
    assert motion.stable
    assert motion.amplitude(1) > 0.03 * motion.amplitude(0)
    np.testing.assert_allclose(state(motion, 2), settled, rtol=0, atol=1e-8)


def test_the_second_mode_saturates_by_a_period_doubling_at_the_amplitude_of_the_closed_form():
    """A driven mode of twice the frequency excites the other parametrically (Nayfeh and Mook, Section 6.5).

    The first mode, x_tt + c x_t + (1 + 2 b y) x = 0 with y = A sin 2t, loses its stability at A = c/b.
    """
    c, b = 0.02, 0.2
    q, v, a = (cs.SX.sym(name, 2) for name in "qva")
    u = cs.SX.sym("u")
    system = SecondOrderSystem.of(
        q, v, a, u, damping=c * v, excitation=cs.vertcat(0, u),
        conservative=a + cs.vertcat(q[0] + 2 * b * q[0] * q[1], 4 * q[1] + b * q[0] ** 2),
    )  # fmt: skip
    curve = amplitude_response(system, (1e-3, 0.01), force=HarmonicForce(1.0, 2 * HZ))
    (found,) = curve.bifurcations
    assert found.kind == "period doubling"
    assert found.motion.amplitude(1) == pytest.approx(c / b, rel=2e-3)
    assert np.all(curve.stable == (curve.drive_amplitudes <= found.motion.drive_amplitude))
    assert curve.amplitude(0).max() < 1e-9


def test_without_damping_a_motion_beside_the_resonance_is_found():
    """The amplitude to first order in the hardening: (1 + 3/4 A^2/100 - Omega^2) A = F."""
    motion = periodic_motion(oscillator(lambda q: q + q**3 / 100, lambda v: 0 * v), force=HarmonicForce(0.3, 0.7 * HZ))
    A = brentq(lambda A: (1 - 0.7**2 + 0.0075 * A**2) * A - 0.3, 0, 1)
    assert motion.amplitude() == pytest.approx(A, rel=1e-3)
    assert motion.stable
    np.testing.assert_allclose(np.abs(motion.multipliers), 1, atol=1e-9)
    assert motion.dissipated_energy == 0 and abs(motion.supplied_energy) < 1e-14


@pytest.mark.parametrize("conservative", [lambda q: 0 * q, lambda q: cs.sqrt(q - 1)])
def test_a_system_without_an_equilibrium_is_refused_in_one_line(conservative):
    with pytest.raises(NumericsError, match="no equilibrium near its state of rest"):
        periodic_motion(oscillator(conservative, lambda v: 0.1 * v), force=HarmonicForce(0.3, HZ))


@pytest.mark.slow
@pytest.mark.parametrize(("amplitude", "ratio", "swing"), [(0.3, 0.3, 0.08), (0.1, 1.5, 0.45), (5e-3, 1.0, 0.6)])
def test_violent_drives_agree_with_a_time_integration(paper_beam, amplitude, ratio, swing):
    """A base that moves by 0.6 L and back, and tips that swing by more than 0.4 L."""
    model = Model(paper_beam(4))
    damping = RayleighDamping(alpha=0.2325, beta=2e-5)
    base = HarmonicBase(amplitude, ratio * natural_modes(model, count=1).frequencies[0])
    motion = periodic_motion(model, damping=damping, base=base)
    start = motion.trajectory().state(0)
    run = simulate(
        model, damping=damping, base=base, start=start, duration=60 / base.frequency,
        sample_rate=base.frequency, method="radau", tolerance=1e-9,
    )  # fmt: skip
    assert motion.amplitude() > swing * model.beam.length
    assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-8)
    assert np.abs(run.tip[-1] - run.tip[0]).max() < 1e-6 * model.beam.length


@pytest.mark.slow
def test_a_force_too_sharp_for_the_harmonics_gives_one_line():
    sharp = oscillator(lambda q: q, lambda v: 0.1 * cs.tanh(1e5 * v))
    with pytest.raises(NumericsError, match=r"needs more than \d+ harmonics"):
        periodic_motion(sharp, force=HarmonicForce(0.3, 0.9 * HZ))


def test_a_force_with_the_square_of_the_excitation_drives_at_twice_its_frequency():
    """The force u^2 of an electrode is A^2/2 (1 - cos 2 w t); its linear response is zero."""
    q, v, a, u = (cs.SX.sym(name) for name in "qvau")
    system = SecondOrderSystem.of(q, v, a, u, conservative=a + q, damping=0.05 * v, excitation=u**2)
    Ω, A = 1.3, 0.1
    harmonics = periodic_motion(system, force=HarmonicForce(amplitude=A, frequency=Ω * HZ)).harmonics()
    assert harmonics[0].imag == pytest.approx(A**2 / 2)
    assert abs(harmonics[2]) == pytest.approx(A**2 / 2 / abs(1 - (2 * Ω) ** 2 + 2j * Ω * 0.05))
    assert abs(harmonics[1]) < 1e-12
