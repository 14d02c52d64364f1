"""Free decay of one mode under a damping force with a free exponent.

The force per mass eta_p |r'|^p sign(r'), with eta_p in m^(1-p) s^(p-2), is friction for p = 0, linear damping for p = 1
and quadratic damping for p = 2; micro-slip in joints has an exponent between 1 and 2.  For r = A cos(omega t + phi) the
energy per mass omega^2 A^2/2 falls at the mean power eta_p <|r'|^(p+1)>, which gives

    A' = -D A^p,    D = eta_p omega^(p-1) s(p),    s(p) = <|sin|^(p+1)> = Gamma(p/2 + 1)/(pi^1/2 Gamma(p/2 + 3/2)).

The viscous damping ratio with the same energy loss per period is zeta(A) = D A^(p-1)/omega.  As eta_p itself has a unit
that depends on p, the law is stated with the ratio zeta_p at an amplitude R of reference.  From the amplitude e0, with
the rate r = zeta_p omega (e0/R)^(p-1) there, the solution is

    A = e0 exp(-r u),    u = t l(-(1 - p) r t),    l(x) = ln(1 + x)/x,

in which p = 1 is no special case.  For p < 1 the mode stops at t = 1/((1 - p) r), where y = 1 - (1 - p) r t is zero.
As under friction, y is replaced by a smooth transition in the band |y| < pi r/(2 omega), which is the band of rest for
p = 0, so that a fit can find the stop.  The integrals for ``slow_flow`` are

    int A dt = e0 u m((2 - p) r u),    int A^2 dt = e0^2 u m((3 - p) r u),    m(x) = (1 - exp(-x))/x.

References
----------
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Section 3.3.
C. Lanczos, A precision approximation of the gamma function, SIAM Journal on Numerical Analysis B 1 (1964).
"""

from __future__ import annotations

import math
from typing import TypeVar

import casadi as cs

from ancf_casadi.decay.slow_flow import LEAST_BAND, Flow, log_ratio, mean_decay, stopping

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)

LANCZOS = (  # for g = 7
    0.99999999999980993, 676.5203681218851, -1259.1392167224028, 771.32342877765313, -176.61502916214059,
    12.507343278686905, -0.13857109526572012, 9.9843695780195716e-6, 1.5056327351493116e-7,
)  # fmt: skip


def power_flow(time: Value, ω: Value, rate: Value, p: Value, e0: Value) -> Flow[Value]:
    """Return the amplitude under a force with an exponent, and its integrals.

    Parameters
    ----------
    time : MX, SX or DM
        Time after the release, s.
    ω : MX, SX or DM
        Natural frequency, rad/s.
    rate : MX, SX or DM
        Decay rate -A'/A at the release, 1/s.
    p : MX, SX or DM
        Exponent.
    e0 : MX, SX or DM
        Amplitude at the release, m.
    """
    band = cs.fmin(math.pi * rate / (2 * ω) + LEAST_BAND, 0.5)
    left = stopping(1 - (1 - p) * rate * time, band) + 1e-12  # so that its logarithm stays finite after the stop
    u = time * log_ratio(left - 1)
    first, second = (e0**n * u * mean_decay((n + 1 - p) * rate * u) for n in (1, 2))
    return Flow(e0 * cs.exp(-rate * u), first, second)


def power_ratio(amplitude: Value, ratio: Value, p: Value, reference: float) -> Value:
    """Return the equivalent damping ratio at an amplitude (m), from the one at an amplitude of reference (m)."""
    return ratio * (amplitude / reference) ** (p - 1)


def power_coefficient(ratio: Value, p: Value, ω: Value, reference: float) -> Value:
    """Return eta_p, m^(1-p) s^(p-2), from the damping ratio at an amplitude of reference (m)."""
    return ratio * ω / ((ω * reference) ** (p - 1) * mean_power(p))


def mean_power(p: Value) -> Value:
    """Return the mean of |sin|^(p+1) over a period, Gamma(p/2 + 1)/(pi^1/2 Gamma(p/2 + 3/2)), for p > -1."""
    return cs.exp(_log_gamma(p / 2 + 1) - _log_gamma(p / 2 + 1.5)) / math.sqrt(math.pi)


def _log_gamma(z: Value) -> Value:
    """Return the logarithm of the gamma function for z >= 1/2, exact to about 1e-15, by Lanczos' series."""
    series = LANCZOS[0] + sum((coefficient / (z - 1 + k) for k, coefficient in enumerate(LANCZOS[1:], 1)), 0 * z)
    base = z + 6.5
    return math.log(2 * math.pi) / 2 + (z - 0.5) * cs.log(base) - base + cs.log(series)
