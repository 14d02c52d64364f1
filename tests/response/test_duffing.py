"""Duffing's oscillator, x_tt + 2 zeta x_t + x + mu x^3 = F sin(Omega t), through the interface for systems of users."""

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ancf_casadi import HarmonicForce, Parameter, SecondOrderSystem, frequency_response, periodic_motion

HZ = 1 / (2 * np.pi)


def duffing(ζ, μ):
    """Return the oscillator as a system."""
    q, v, a, u, p = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "p"))
    return SecondOrderSystem.of(
        q, v, a, u, p, conservative=a + q + p * q**3, damping=2 * ζ * v, excitation=u,
        parameters=[Parameter("mu", μ, "1/m^2", "cubic stiffness")],
    )  # fmt: skip


def integrated(ζ, μ, F, Ω, start, periods):
    """Return the state (x, x_t) after a number of periods, by an explicit method of order 8."""

    def rate(t, x):
        return [x[1], F * np.sin(Ω * t) - 2 * ζ * x[1] - x[0] - μ * x[0] ** 3]

    run = solve_ivp(rate, (0, periods * 2 * np.pi / Ω), start, method="DOP853", rtol=1e-12, atol=1e-14)
    return run.y[:, -1]


def settled(ζ, μ, F, Ω, start):
    """Return the state after as many periods as reduce a disturbance by a factor of 1e12."""
    return integrated(ζ, μ, F, Ω, start, round(28 / ζ * Ω / (2 * np.pi)))


class FirstOrder:
    """The response to first order in zeta, mu and F (Nayfeh and Mook, Nonlinear Oscillations, Section 4.1.1).

    With the detuning s = Omega - 1 and the lag g, x = A sin(Omega t - g),

        zeta A = F/2 sin g,    (3/8 mu A^2 - s) A = F/2 cos g,

    and a disturbance grows as exp(lambda t), (lambda + zeta)^2 = -(s - 3/8 mu A^2)(s - 9/8 mu A^2).
    """

    def __init__(self, ζ, μ, F):
        self.ζ, self.μ, self.F = ζ, μ, F

    def detuning(self, A, below):
        """Return s at an amplitude, on the side of the resonance below or above the backbone."""
        root = np.sqrt((self.F / (2 * A)) ** 2 - self.ζ**2)
        return 3 / 8 * self.μ * A**2 + np.where(below, -root, root)

    def lag(self, A, s):
        return np.arctan2(2 * self.ζ * A, 2 * A * (3 / 8 * self.μ * A**2 - s))

    def exponents(self, A, s):
        root = np.emath.sqrt(-(s - 3 / 8 * self.μ * A**2) * (s - 9 / 8 * self.μ * A**2))
        return -self.ζ + root, -self.ζ - root

    def folds(self):
        """Return s and A at both folds."""

        def slope(A):  # ds/dA above the backbone
            return 3 / 4 * self.μ * A - (self.F / 2) ** 2 / A**3 / np.sqrt((self.F / (2 * A)) ** 2 - self.ζ**2)

        A = np.linspace(0, self.F / (2 * self.ζ), 1000)[1:-1]
        turns = np.flatnonzero(np.diff(np.sign(slope(A))))
        found = [brentq(slope, A[k], A[k + 1]) for k in turns]
        return [(float(self.detuning(turn, below=False)), turn) for turn in found]


def small_motion_errors(ε):
    """Return the relative differences from the first order for damping and forces of order eps^2 and eps^3."""
    ζ, μ, F = 0.25 * ε**2, 1.0, ε**3
    theory = FirstOrder(ζ, μ, F)
    curve = frequency_response(duffing(ζ, μ), ((1 - 4 * ε**2) * HZ, (1 + 6 * ε**2) * HZ), force=HarmonicForce(F, HZ))
    s, A, lag = curve.frequencies / HZ - 1, curve.amplitude(), -curve.phase()
    balance = ((s - 3 / 8 * μ * A**2) ** 2 + ζ**2) / (F / (2 * A)) ** 2
    exponents = np.stack(theory.exponents(A, s), axis=1)
    growth = np.log([motion.multipliers for motion in curve.motions]) * curve.frequencies[:, None]
    folds = sorted(point.motion.frequency / HZ - 1 for point in curve.bifurcations if point.kind == "fold")
    expected = sorted(s for s, _ in theory.folds())
    clear = np.abs(exponents.real.max(axis=1)) > ζ / 20
    assert np.array_equal(curve.stable[clear], exponents.real.max(axis=1)[clear] < 0)
    assert not np.all(curve.stable)
    return np.array([
        np.abs(balance - 1).max(),
        np.abs(lag - theory.lag(A, s)).max(),
        np.abs((growth.prod(axis=1) - exponents.prod(axis=1)) / F ** (4 / 3)).max(),
        np.abs(np.array(folds) / np.array(expected) - 1).max(),
    ])  # fmt: skip


@pytest.mark.slow
def test_small_motion_follows_the_first_order_closed_form():
    """Amplitude, phase, growth of disturbances and folds; the remaining differences are of order eps^2."""
    coarse, fine = small_motion_errors(0.05), small_motion_errors(0.025)
    assert np.all(fine < 0.02)
    np.testing.assert_allclose(coarse / fine, 4, rtol=0.1)


def state(motion):
    """Return (x, x_t) at the phase 0 of the force."""
    X = motion.harmonics()
    return np.array([X.sum().imag, 2 * np.pi * motion.frequency * (np.arange(len(X)) * X).sum().real])


STRONG = (0.03, 1.0, 0.6)  # damping ratio, cubic stiffness and force of a motion whose amplitude reaches 3


@pytest.mark.slow
@pytest.mark.parametrize("Ω", [0.3, 0.9, 1.35, 4.0])
def test_the_steady_state_at_large_amplitude_is_the_end_of_a_time_integration_from_rest(Ω):
    ζ, μ, F = STRONG
    motion = periodic_motion(duffing(ζ, μ), force=HarmonicForce(F, Ω * HZ), tolerance=1e-10)
    assert motion.stable
    np.testing.assert_allclose(state(motion), settled(ζ, μ, F, Ω, (0.0, 0.0)), rtol=0, atol=1e-8)
    assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-9)


@pytest.mark.slow
def test_points_of_the_curve_at_large_amplitude_return_to_themselves_and_unstable_ones_leave():
    ζ, μ, F = STRONG
    curve = frequency_response(duffing(ζ, μ), (0.8 * HZ, 4 * HZ), force=HarmonicForce(F, HZ), tolerance=1e-10)
    assert curve.amplitude().max() > 3
    assert [point.kind for point in curve.bifurcations] == ["fold", "fold"]
    for motion in curve.motions[::8]:
        Ω, at_start = motion.frequency / HZ, state(motion)
        end = integrated(ζ, μ, F, Ω, at_start, 60 if motion.stable else 1)
        np.testing.assert_allclose(end, at_start, rtol=0, atol=1e-8)
        if not motion.stable:
            disturbed = integrated(ζ, μ, F, Ω, at_start + 1e-6, 60)
            assert np.abs(disturbed - at_start).max() > 1e-2


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "sign"), [("up", 1), ("down", -1)])
def test_a_slow_sweep_jumps_where_the_curve_says(direction, sign):
    """Integrate at frequencies just before and after the jump, from the steady state 1 % before it."""
    ζ, μ, F = STRONG
    curve = frequency_response(duffing(ζ, μ), (0.8 * HZ, 4 * HZ), force=HarmonicForce(F, HZ))
    (jump,) = getattr(curve.jumps, direction)
    (fold,) = (point for point in curve.bifurcations if point.motion.frequency == pytest.approx(jump, rel=1e-6))
    branch = curve.motions[: fold.index] if sign > 0 else curve.motions[fold.index + 1 :]
    near = min(branch, key=lambda motion: abs(motion.frequency / jump - 1 + 0.01 * sign))
    assert near.stable

    def amplitude(Ω):
        end = settled(ζ, μ, F, Ω, state(near))
        return np.abs([integrated(ζ, μ, F, Ω, end, share)[0] for share in np.linspace(0, 1, 33)]).max()

    before, after = (amplitude(jump / HZ * (1 + share * sign)) for share in (-2e-3, 2e-3))
    assert before == pytest.approx(fold.motion.amplitude(), rel=0.1)
    assert abs(after - before) > 0.5 * before
