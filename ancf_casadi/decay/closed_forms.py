"""Closed forms of the free decay of one mode, for linear and quadratic damping.

The free oscillation of one mode about its equilibrium obeys r'' + eta1 r' + eta2 r' |r'| + omega^2 r = 0, Eq. (26).
With eta2 = 0, eta1 = 2 zeta omega and omega_d = omega (1 - zeta^2)^1/2 the displacement is

    r(t) = exp(-zeta omega t) (r0 cos omega_d t + (v0 + zeta omega r0)/omega_d sin omega_d t),           Eq. (9)

and with both terms, to first order in the damping,

    e(t) = a(t) cos(omega t + phi),
    a(t) = e0 exp(-x) / (1 + 4 omega eta2 e0 t/(3 pi) (1 - exp(-x))/x),    x = eta1 t/2,                 Eq. (27)

written so that eta1 = 0 is no special case.  The viscous damping ratio with the same energy loss per period at the
amplitude A is zeta_eq = eta1/(2 omega) + 4 eta2 A/(3 pi); friction adds 2 eta0/(pi omega^2 A) (``friction``).

The closed forms take and return CasADi values, MX, SX or DM, and are smooth in all their arguments.

References
----------
"Comparison of external damping models in a large deformation problem", Eqs. (9), (26), (27).  Eq. (27) as printed is
0/0 at eta1 = 0; the form above has the right limit.
"""

from __future__ import annotations

import math
from typing import TypeVar

import casadi as cs

from ancf_casadi.decay.slow_flow import Flow, mean_decay, riccati_flow

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)


def linear_decay(time: Value, ω: Value, ζ: Value, r0: Value, v0: Value) -> Value:
    """Return the free decay under linear damping, Eq. (9).

    Parameters
    ----------
    time : MX, SX or DM
        Time after the release, s.
    ω : MX, SX or DM
        Undamped natural frequency, rad/s.
    ζ : MX, SX or DM
        Damping ratio, below 1.
    r0, v0 : MX, SX or DM
        Displacement (m) and velocity (m/s) at the release.
    """
    ω_d = ω * cs.sqrt(1 - ζ**2)
    return cs.exp(-ζ * ω * time) * (r0 * cs.cos(ω_d * time) + (v0 + ζ * ω * r0) / ω_d * cs.sin(ω_d * time))


def quadratic_envelope(time: Value, ω: Value, η1: Value, η2: Value, e0: Value) -> Value:
    """Return the amplitude of the free decay under linear and quadratic damping, a(t) of Eq. (27).

    Parameters
    ----------
    time : MX, SX or DM
        Time after the release, s.
    ω : MX, SX or DM
        Natural frequency, rad/s.
    η1, η2 : MX, SX or DM
        Linear (1/s) and quadratic (1/m) damping coefficient.
    e0 : MX, SX or DM
        Amplitude at the release, m.
    """
    x = η1 * time / 2
    return e0 * cs.exp(-x) / (1 + 4 * ω * η2 * e0 * time / (3 * math.pi) * mean_decay(x))


def quadratic_flow(time: Value, ω: Value, η1: Value, η2: Value, e0: Value) -> Flow[Value]:
    """Return the amplitude under linear and quadratic damping, and its integrals; see ``quadratic_envelope``."""
    a, b = η1 / 2, 4 * ω * η2 / (3 * math.pi)
    Z = e0 * time * mean_decay(a * time)
    return riccati_flow(quadratic_envelope(time, ω, η1, η2, e0), Z, 0 * Z, a, b, e0)


def quadratic_decay(time: Value, ω: Value, η1: Value, η2: Value, e0: Value, φ: Value) -> Value:
    """Return the free decay under linear and quadratic damping, Eq. (27), with a phase φ (rad) at the release."""
    return quadratic_envelope(time, ω, η1, η2, e0) * cs.cos(ω * time + φ)


def equivalent_damping_ratio(η1: Value, η2: Value, ω: Value, amplitude: Value, η0: Value | None = None) -> Value:
    """Return the viscous damping ratio with the same energy loss per period at an amplitude (m).

    The loss is due to linear damping η1 (1/s), quadratic damping η2 (1/m) and, if given, friction η0 (m/s^2).
    """
    viscous = η1 / (2 * ω) + 4 * η2 * amplitude / (3 * math.pi)
    return viscous if η0 is None else viscous + 2 * η0 / (math.pi * ω**2 * amplitude)
