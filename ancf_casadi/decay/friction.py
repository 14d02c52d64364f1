"""Free decay of one mode under friction, linear and quadratic damping.

Coulomb friction, a force of constant magnitude against the motion, adds a third term to the equation of motion (26),

    r'' + eta0 sign(r') + eta1 r' + eta2 r' |r'| + omega^2 r = 0,

with eta0 the friction force per mass, m/s^2.  For r = A cos(omega t + phi) with A changing slowly, the energy per mass
omega^2 A^2/2 falls at the mean power of the three terms over a period.  With the means

    <|r'|> = 2 omega A/pi,    <r'^2> = omega^2 A^2/2,    <|r'|^3> = 4 omega^3 A^3/(3 pi)

this gives omega^2 A A' = -eta0 <|r'|> - eta1 <r'^2> - eta2 <|r'|^3>, that is

    A' = -c - a A - b A^2,    a = eta1/2,    b = 4 omega eta2/(3 pi),    c = 2 eta0/(pi omega).

Friction alone reduces the amplitude by c 2 pi/omega = 4 eta0/omega^2 in each period, which is exact.  The quotient
A = p/q of the solution of the linear system p' = -(a/2) p - c q, q' = b p + (a/2) q solves this Riccati equation; the
square of its matrix is k = a^2/4 - b c times the identity, and so

    A(t) = (e0 - (a e0/2 + c) s) / (1 + (a/2 + b e0) s),    s = tanh(k^1/2 t)/k^1/2,

with s = tan(|k|^1/2 t)/|k|^1/2 for k < 0, and s = t for k = 0.  A reaches zero before this tangent becomes infinite,
and friction holds the mode from then on.  With eta0 = 0 this is Eq. (27).  Friction shifts the centre of each half
swing by d = eta0/omega^2, half the width of the band of rest.  The averaged displacement ignores this shift; it is
valid as long as A is well above d.  Within the last half period, where -d < A < d and averages mean nothing, A is
replaced by (3 d - A)(A + d)^3/(16 d^3), which goes to zero with two continuous derivatives, so that a fit can find the
stop.

References
----------
"Comparison of external damping models in a large deformation problem", Eqs. (26), (27).
B. F. Feeny, J. W. Liang, A decrement method for the simultaneous estimation of Coulomb and viscous friction, Journal of
Sound and Vibration 195 (1996).
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Section 3.3.
"""

from __future__ import annotations

import math
from typing import TypeVar

import casadi as cs

from ancf_casadi.decay.closed_forms import LEAST_BAND, smooth, stopping

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)


def friction_envelope(time: Value, ω: Value, η0: Value, η1: Value, η2: Value, e0: Value) -> Value:
    """Return the amplitude of the free decay under friction, linear and quadratic damping; 0 after the stop.

    Parameters
    ----------
    time : MX, SX or DM
        Time after the release, s.
    ω : MX, SX or DM
        Natural frequency, rad/s.
    η0, η1, η2 : MX, SX or DM
        Friction force per mass (m/s^2), linear (1/s) and quadratic (1/m) damping coefficient, none negative.
    e0 : MX, SX or DM
        Amplitude at the release, m.
    """
    a, b, c = _rates(ω, η0, η1, η2)
    s = time * _tanh_ratio(time**2 * (a**2 / 4 - b * c))
    amplitude = (e0 - (a * e0 / 2 + c) * s) / (1 + (a / 2 + b * e0) * s)
    return stopping(amplitude, η0 / ω**2 + LEAST_BAND * e0)


def friction_decay(time: Value, ω: Value, η0: Value, η1: Value, η2: Value, e0: Value, φ: Value) -> Value:
    """Return the free decay under friction, linear and quadratic damping, with a phase φ (rad) at the release."""
    return friction_envelope(time, ω, η0, η1, η2, e0) * cs.cos(ω * time + φ)


def _rates(ω: Value, η0: Value, η1: Value, η2: Value) -> tuple[Value, Value, Value]:
    """Return a (1/s), b (1/(m s)) and c (m/s) of the averaged equation."""
    return η1 / 2, 4 * ω * η2 / (3 * math.pi), 2 * η0 / (math.pi * ω)


def _tanh_ratio(y: Value) -> Value:
    """Return tanh(y^1/2)/y^1/2; smooth also at y <= 0, where it is a tangent."""

    def closed(y: Value) -> Value:
        root = cs.sqrt(cs.fabs(y))
        angle = cs.fmin(root, 1.57)  # just below pi/2; the motion stops earlier
        return cs.if_else(y > 0, cs.tanh(root) / root, cs.tan(angle) / angle)

    series = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925, 21844 / 6081075, -929569 / 638512875)
    return smooth(y, series, closed)
