"""Slow flow of a free decay: amplitude and phase, with a frequency that depends on the amplitude.

Averaged over a period, the free oscillation r = A cos(theta) of one mode obeys

    A' = -(c + a A + b A^2)    or    A' = -D A^p,        theta' = omega(A),

with friction c, linear damping a, quadratic damping b, or a force with a free exponent (``power``).  The frequency is

    constant      omega
    linear        omega (1 + k1 A)        joints and clamps: micro-slip, contacts that open
    quadratic     omega (1 + k2 A^2)      geometry and elasticity: for r'' + omega^2 r + alpha r^3 = 0,
                                          k2 = 3 alpha/(8 omega^2)

with omega the frequency at zero amplitude.  The phase needs two integrals of the amplitude,

    theta = phi + omega (t + k1 I1 + k2 I2),    I1 = int A dt,    I2 = int A^2 dt.

All is of first order in the damping and in the change of the frequency: in the coefficients a, b, c, D the frequency is
omega.

For A' = -(c + a A + b A^2), the solution is the quotient A = h/g of the linear system

    h' = -a h - c g,    g' = b h,    h(0) = e0,    g(0) = 1.

With Z = int h dt and V = int t h dt, this gives g = 1 + b Z and

    I1 = Z l(b Z),    I2 = (e0 Z - c V)/(1 + b Z) - a Z^2 d(b Z),

so that b = 0 is no special case.  I2 follows from the integral of the equation of motion, e0 - A = c t + a I1 + b I2.
Three functions of the closed forms are 0/0 at one point, and written so that they and their derivatives are smooth
there, by their series near x = 0:

    m(x) = (1 - exp(-x))/x                   the mean of exp(-s) over s from 0 to x
    l(x) = ln(1 + x)/x                       the mean of 1/(1 + s)
    d(x) = (l(x) - 1/(1 + x))/x              the rest of l above its lower bound

References
----------
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Sections 2.3, 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import casadi as cs

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)

LEAST_BAND = 1e-9  # least width of the transition to a stop, relative to the amplitude at the release
SERIES_BELOW = 0.02  # |x| below which a series replaces a closed form; ten terms are exact to 0.02^10 = 1e-17


@dataclass(frozen=True, eq=False)
class Flow(Generic[Value]):
    """Amplitude of a decay and its integrals, at the same times.

    Parameters
    ----------
    amplitude : MX, SX or DM
        Amplitude A, m.
    first : MX, SX or DM
        Integral I1 of the amplitude since the release, m s.
    second : MX, SX or DM
        Integral I2 of its square, m^2 s.
    """

    amplitude: Value
    first: Value
    second: Value


def riccati_flow(amplitude: Value, Z: Value, cV: Value, a: Value, b: Value, e0: Value) -> Flow[Value]:
    """Return the flow of A' = -(c + a A + b A^2) from its amplitude, Z = int h dt, and c V = c int t h dt."""
    x = b * Z
    first = Z * log_ratio(x)
    second = (e0 * Z - cV) / (1 + x) - a * Z**2 * log_defect(x)
    return Flow(amplitude, first, second)


def mean_decay(x: Value) -> Value:
    """Return (1 - exp(-x))/x; 1 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(
        near, polynomial([(-1) ** k / math.factorial(k + 1) for k in range(10)], x), -cs.expm1(-away) / away
    )


def log_ratio(x: Value) -> Value:
    """Return ln(1 + x)/x for x > -1; 1 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(near, polynomial([(-1) ** k / (k + 1) for k in range(10)], x), cs.log1p(away) / away)


def log_defect(x: Value) -> Value:
    """Return (ln(1 + x)/x - 1/(1 + x))/x for x > -1; 1/2 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(
        near,
        polynomial([(-1) ** k * (k + 1) / (k + 2) for k in range(10)], x),
        (cs.log1p(away) / away - 1 / (1 + away)) / away,
    )


def stopping(value: Value, band: Value) -> Value:
    """Return a falling value while above a band, 0 below the negative of the band, and a smooth transition between."""
    ratio = cs.fmin(cs.fmax(value / band, -1), 1)
    return cs.if_else(value > band, value, band * (3 - ratio) * (ratio + 1) ** 3 / 16)


def polynomial(coefficients: Sequence[float], x: Value) -> Value:
    """Return the polynomial with the given coefficients, that of the lowest power first."""
    value = 0 * x
    for coefficient in reversed(coefficients):
        value = coefficient + x * value
    return value


def _apart(x: Value) -> tuple[Value, Value]:
    """Return a mask of x near 0, and x with 1 in those places, which keeps the closed form and derivatives finite."""
    near = cs.fabs(x) < SERIES_BELOW
    return near, cs.if_else(near, 1, x)
