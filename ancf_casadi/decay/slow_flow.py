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

where l and d are the functions of ``smooth``, so that b = 0 is no special case.  I2 follows from the integral of the
equation of motion, e0 - A = c t + a I1 + b I2.

References
----------
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Sections 2.3, 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import casadi as cs

from ancf_casadi.decay.smooth import log_defect, log_ratio

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)


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
