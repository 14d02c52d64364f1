"""Closed forms of the free decay of one mode: displacement, and slow flow of amplitude and phase.

The free oscillation of one mode about its equilibrium obeys r'' + eta1 r' + eta2 r' |r'| + omega^2 r = 0, Eq. (26).
With eta2 = 0, eta1 = 2 zeta omega and omega_d = omega (1 - zeta^2)^1/2 the displacement is

    r(t) = exp(-zeta omega t) (r0 cos omega_d t + (v0 + zeta omega r0)/omega_d sin omega_d t),           Eq. (9)

and with both terms, to first order in the damping,

    e(t) = a(t) cos(omega t + phi),
    a(t) = e0 exp(-x) / (1 + 4 omega eta2 e0 t/(3 pi) (1 - exp(-x))/x),    x = eta1 t/2,                 Eq. (27)

written so that eta1 = 0 is no special case.  The viscous damping ratio with the same energy loss per period at the
amplitude A is zeta_eq = eta1/(2 omega) + 4 eta2 A/(3 pi); friction adds 2 eta0/(pi omega^2 A).  To second order, the
phase also lags: the oscillation is slower than omega by the fraction eta1/(4 omega) zeta_eq, and by 0.092 times the
square of the part of zeta_eq that is due to eta2.  Eq. (27) leaves this out, so its omega is that of the oscillation.

Slow flow.  Averaged over a period, the free oscillation r = A cos(theta) of one mode obeys

    A' = -(c + a A + b A^2)    or    A' = -D A^p,

with friction c, linear damping a, quadratic damping b, or a force with a free exponent; ``phase`` has theta.  Two
functions of the closed forms are 0/0 at x = 0; their series keep them and their derivatives smooth there:

    m(x) = (1 - exp(-x))/x                   the mean of exp(-s) over s from 0 to x
    l(x) = ln(1 + x)/x                       the mean of 1/(1 + s)

Friction.  Coulomb friction, a force of constant magnitude against the motion, adds a third term to Eq. (26),

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

Free exponent.  The force per mass eta_p |r'|^p sign(r'), with eta_p in m^(1-p) s^(p-2), is friction for p = 0, linear
damping for p = 1 and quadratic damping for p = 2; micro-slip in joints has an exponent between 1 and 2.  The energy per
mass omega^2 A^2/2 falls at the mean power eta_p <|r'|^(p+1)>, which gives

    D = eta_p omega^(p-1) s(p),    s(p) = <|sin|^(p+1)> = Gamma(p/2 + 1)/(pi^1/2 Gamma(p/2 + 3/2)).

The viscous damping ratio with the same energy loss per period is zeta(A) = D A^(p-1)/omega.  As eta_p itself has a unit
that depends on p, the law is stated with the ratio zeta_p at an amplitude R of reference.  From the amplitude e0, with
the rate r = zeta_p omega (e0/R)^(p-1) there, the solution is

    A = e0 exp(-r u),    u = t l(-(1 - p) r t),

in which p = 1 is no special case.  For p < 1 the mode stops at t = 1/((1 - p) r), where y = 1 - (1 - p) r t is zero.
As under friction, y is replaced by a smooth transition in the band |y| < pi r/(2 omega), which is the band of rest for
p = 0, so that a fit can find the stop.

The closed forms take and return CasADi values, MX, SX or DM, and are smooth in all their arguments: the time after the
release (s), the undamped natural frequency omega (rad/s), coefficients of the damping (eta0 in m/s^2, eta1 in 1/s,
eta2 in 1/m; with friction none negative), and amplitude e0 (m), displacement r0 (m), velocity v0 (m/s) or phase (rad)
at the release.

References
----------
"Comparison of external damping models in a large deformation problem", Eqs. (9), (26), (27).  Eq. (27) as printed is
0/0 at eta1 = 0; the form above has the right limit.
B. F. Feeny, J. W. Liang, A decrement method for the simultaneous estimation of Coulomb and viscous friction, Journal of
Sound and Vibration 195 (1996).
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Sections 2.3, 3.3.
C. Lanczos, A precision approximation of the gamma function, SIAM Journal on Numerical Analysis B 1 (1964).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import casadi as cs

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)

MIN_BAND = 1e-9  # least width of the transition to a stop, relative to the amplitude at the release
SERIES_BELOW = 0.02  # |x| below which a series replaces a closed form; ten terms are exact to 0.02^10 = 1e-17
LANCZOS = (  # for g = 7
    0.99999999999980993, 676.5203681218851, -1259.1392167224028, 771.32342877765313, -176.61502916214059,
    12.507343278686905, -0.13857109526572012, 9.9843695780195716e-6, 1.5056327351493116e-7,
)  # fmt: skip


def linear_decay(time: Value, ω: Value, ζ: Value, r0: Value, v0: Value) -> Value:
    """Return the free decay under linear damping with a ratio ζ below 1, Eq. (9), from displacement and velocity."""
    ω_d = ω * cs.sqrt(1 - ζ**2)
    return cs.exp(-ζ * ω * time) * (r0 * cs.cos(ω_d * time) + (v0 + ζ * ω * r0) / ω_d * cs.sin(ω_d * time))


def quadratic_envelope(time: Value, ω: Value, η1: Value, η2: Value, e0: Value) -> Value:
    """Return the amplitude of the free decay under linear and quadratic damping, a(t) of Eq. (27)."""
    x = η1 * time / 2
    return e0 * cs.exp(-x) / (1 + 4 * ω * η2 * e0 * time / (3 * math.pi) * mean_decay(x))


def quadratic_decay(time: Value, ω: Value, η1: Value, η2: Value, e0: Value, φ: Value) -> Value:
    """Return the free decay under linear and quadratic damping, Eq. (27), with a phase φ (rad) at the release."""
    return quadratic_envelope(time, ω, η1, η2, e0) * cs.cos(ω * time + φ)


def equivalent_damping_ratio(η1: Value, η2: Value, ω: Value, amplitude: Value, η0: Value | None = None) -> Value:
    """Return the viscous damping ratio with the same energy loss per period at an amplitude (m)."""
    viscous = η1 / (2 * ω) + 4 * η2 * amplitude / (3 * math.pi)
    return viscous if η0 is None else viscous + 2 * η0 / (math.pi * ω**2 * amplitude)


def friction_envelope(time: Value, ω: Value, η0: Value, η1: Value, η2: Value, e0: Value) -> Value:
    """Return the amplitude of the free decay under friction, linear and quadratic damping; 0 after the stop."""
    a, b, c = η1 / 2, 4 * ω * η2 / (3 * math.pi), 2 * η0 / (math.pi * ω)
    s = time * _tanh_ratio(time**2 * (a**2 / 4 - b * c))
    amplitude = (e0 - (a * e0 / 2 + c) * s) / (1 + (a / 2 + b * e0) * s)
    return smooth_stop(amplitude, η0 / ω**2 + MIN_BAND * e0)


def friction_decay(time: Value, ω: Value, η0: Value, η1: Value, η2: Value, e0: Value, φ: Value) -> Value:
    """Return the free decay under friction, linear and quadratic damping, with a phase φ (rad) at the release."""
    return friction_envelope(time, ω, η0, η1, η2, e0) * cs.cos(ω * time + φ)


def power_envelope(time: Value, ω: Value, rate: Value, p: Value, e0: Value) -> Value:
    """Return the amplitude of the free decay under a force with an exponent; 0 after the stop."""
    band = cs.fmin(math.pi * rate / (2 * ω) + MIN_BAND, 0.5)
    y = smooth_stop(1 - (1 - p) * rate * time, band) + 1e-12  # so that its logarithm stays finite after the stop
    u = time * log_ratio(y - 1)
    return e0 * cs.exp(-rate * u)


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


def mean_decay(x: Value) -> Value:
    """Return (1 - exp(-x))/x; 1 at x = 0."""
    return smooth(x, [(-1) ** k / math.factorial(k + 1) for k in range(10)], lambda x: -cs.expm1(-x) / x)


def log_ratio(x: Value) -> Value:
    """Return ln(1 + x)/x for x > -1; 1 at x = 0."""
    return smooth(x, [(-1) ** k / (k + 1) for k in range(10)], lambda x: cs.log1p(x) / x)


def _tanh_ratio(y: Value) -> Value:
    """Return tanh(y^1/2)/y^1/2; smooth also at y <= 0, where it is a tangent."""

    def closed_form(y: Value) -> Value:
        root = cs.sqrt(cs.fabs(y))
        angle = cs.fmin(root, 1.57)  # just below pi/2; the motion stops earlier
        return cs.if_else(y > 0, cs.tanh(root) / root, cs.tan(angle) / angle)

    series = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925, 21844 / 6081075, -929569 / 638512875)
    return smooth(y, series, closed_form)


def smooth(x: Value, series: Sequence[float], closed_form: Callable[[Value], Value]) -> Value:
    """Return a function of x whose closed form is 0/0 at x = 0: its power series near 0, the closed form elsewhere."""
    is_small = cs.fabs(x) < SERIES_BELOW
    return cs.if_else(
        is_small, polynomial(series, x), closed_form(cs.if_else(is_small, 1, x))
    )  # all derivatives stay finite


def smooth_stop(value: Value, band: Value) -> Value:
    """Return a falling value while above a band, 0 below the negative of the band, and a smooth transition between."""
    ratio = cs.fmin(cs.fmax(value / band, -1), 1)
    return cs.if_else(value > band, value, band * (3 - ratio) * (ratio + 1) ** 3 / 16)


def polynomial(coefficients: Sequence[float], x: Value) -> Value:
    """Return the polynomial with the given coefficients, that of the lowest power first."""
    value = 0 * x
    for coefficient in reversed(coefficients):
        value = coefficient + x * value
    return value
