"""Free decays: closed forms for linear and quadratic damping, and first guesses from a measured record.

One mode that swings freely about its equilibrium obeys r'' + eta1 r' + eta2 r' |r'| + omega^2 r = 0, Eq. (26).
With eta2 = 0, eta1 = 2 zeta omega and omega_d = omega (1 - zeta^2)^1/2 it decays like

    r(t) = exp(-zeta omega t) (r0 cos omega_d t + (v0 + zeta omega r0)/omega_d sin omega_d t),           Eq. (9)

and with both terms, to first order in the damping,

    e(t) = a(t) cos(omega t + phi),
    a(t) = e0 exp(-x) / (1 + 4 omega eta2 e0 t/(3 pi) (1 - exp(-x))/x),    x = eta1 t/2,                 Eq. (27)

here written so that eta1 = 0 is no exception.  The viscous ratio that loses as much energy in a period at the amplitude
A is zeta_eq = eta1/(2 omega) + 4 eta2 A/(3 pi), and 2 eta0/(pi omega^2 A) more with friction, which is another file.

The closed forms take and give CasADi values, MX, SX or DM, and are smooth in all their arguments.

A record may begin with rest, or with an excitation (``release``).  From the release on, the highest peak of the
spectrum gives the frequency.  The decay rate is the best of a list, the coefficients that are linear being fitted for
each.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (9), (26), (27); in the latter the limit
eta1 -> 0 is put right.
G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
separate, SIAM Journal on Numerical Analysis 10 (1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.measurement import Measurement
from ancf_casadi.release import MINIMUM_SAMPLES, Release, find_release, peak_frequency

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)
Series = NDArray[np.float64]

MINIMUM_PERIODS = 1.5  # as the spectrum sees them; its peak is up to half a period off
SERIES_BELOW = 0.01  # where the series of (1 - exp(-x))/x takes over from the closed form
SERIES_TERMS = 7  # 0.01^7/8! is below 1e-18
NOISE_ODDS = 1e-4  # chance to take pure noise for an oscillation


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
    return e0 * cs.exp(-x) / (1 + 4 * ω * η2 * e0 * time / (3 * math.pi) * _mean_decay(x))


def quadratic_decay(time: Value, ω: Value, η1: Value, η2: Value, e0: Value, φ: Value) -> Value:
    """Return the free decay under linear and quadratic damping, Eq. (27), with a phase φ (rad) at the release."""
    return quadratic_envelope(time, ω, η1, η2, e0) * cs.cos(ω * time + φ)


def equivalent_damping_ratio(η1: Value, η2: Value, ω: Value, amplitude: Value, η0: Value | None = None) -> Value:
    """Return the viscous damping ratio with the same loss of energy in a period at an amplitude (m).

    Of linear (1/s) and quadratic (1/m) damping, and of friction η0 (force by mass, m/s^2) if there is any.
    """
    viscous = η1 / (2 * ω) + 4 * η2 * amplitude / (3 * math.pi)
    return viscous if η0 is None else viscous + 2 * η0 / (math.pi * ω**2 * amplitude)


@dataclass(frozen=True)
class DecayGuess:
    """Where to start the fit of a decay.

    Parameters
    ----------
    release : int
        Index of the first sample of the free decay.
    reason : str
        Why it begins there.
    duration : float
        How long there is something to see: ``length`` or 1/(zeta omega), the lesser, s.
    length : float
        Length of the record from there on, s.
    ω : float
        Natural frequency, rad/s.
    ζ : float
        Damping ratio.
    amplitude : float
        Amplitude at the release, m.
    phase : float
        Phase at the release, rad; 0 at the highest displacement.
    offset : float
        Equilibrium the decay tends to, m; where it is at the release, if it drifts.
    drift : float
        Velocity of the equilibrium, m/s.
    """

    release: int
    reason: str
    duration: float
    length: float
    ω: float
    ζ: float
    amplitude: float
    phase: float
    offset: float
    drift: float = 0.0

    @property
    def r0(self) -> float:
        """Displacement from the offset at the release, m."""
        return self.amplitude * math.cos(self.phase)

    @property
    def v0(self) -> float:
        """Velocity at the release, m/s."""
        ω_d = self.ω * math.sqrt(1 - self.ζ**2)
        return -self.amplitude * (self.ζ * self.ω * math.cos(self.phase) + ω_d * math.sin(self.phase))


def first_guess(
    record: Measurement, *, release_time: float | None = None, offset: bool = True, drift: bool = False
) -> DecayGuess:
    """Guess the parameters of a decay from its record.

    Parameters
    ----------
    record : Measurement
        The record; rest or an excitation may come before the decay.
    release_time : float, optional
        When the decay begins, s; found in the record if not given.
    offset : bool
        Whether the decay may tend to another value than 0.
    drift : bool
        Whether the equilibrium may move, at a constant velocity.

    Raises
    ------
    InputError
        If there are too few samples or periods, or nothing oscillates.
    """
    time, displacement = _evenly_spaced(record)
    if release_time is None:
        found = find_release(time, _without_line(time, displacement) if drift else displacement)
    else:
        found = Release(int(np.searchsorted(time, release_time)), "given")
    release = found.index
    t, y = time[release:] - time[min(release, len(time) - 1)], displacement[release:]
    if len(t) < MINIMUM_SAMPLES:
        raise InputError(f"has {len(t)} samples of free decay; a fit needs at least {MINIMUM_SAMPLES}", "record")
    if np.ptp(y) == 0.0:
        raise InputError("is constant, nothing oscillates", "record")
    ω_d = 2 * math.pi * peak_frequency(t, _without_line(t, y) if drift else y - y.mean())
    if ω_d * t[-1] < 2 * math.pi * MINIMUM_PERIODS:
        raise InputError("has fewer than two periods of free decay, or nothing oscillates", "record")
    λ, c, s, level, slope = _best_rate(t, y, ω_d, offset, drift)
    ω = math.hypot(ω_d, λ)
    return DecayGuess(
        release=int(np.searchsorted(record.time, time[release] - (time[1] - time[0]) / 2)),
        reason=found.reason,
        duration=min(float(t[-1]), 1 / λ) if λ else float(t[-1]),
        length=float(t[-1]),
        ω=ω,
        ζ=λ / ω,
        amplitude=math.hypot(c, s),
        phase=math.atan2(-s, c),
        offset=level,
        drift=slope,
    )


def _mean_decay(x: Value) -> Value:
    """Return (1 - exp(-x))/x, the mean of exp(-s) over s from 0 to x; smooth, and 1 at x = 0."""
    near = cs.fabs(x) < SERIES_BELOW
    series = 0 * x + 1
    for k in range(SERIES_TERMS, 1, -1):
        series = 1 - x / k * series
    away = cs.if_else(near, 1, x)  # keeps 0/0 out of the derivatives
    return cs.if_else(near, series, -cs.expm1(-away) / away)


def _evenly_spaced(record: Measurement) -> tuple[Series, Series]:
    time = np.linspace(record.time[0], record.time[-1], len(record.time))
    return time, np.interp(time, record.time, record.displacement)


def _without_line(time: Series, displacement: Series) -> Series:
    """Return what a straight line, fitted by least squares, leaves."""
    t: Series = time - time.mean()
    rest: Series = displacement - displacement.mean() - t * (t @ displacement) / (t @ t)
    return rest


def _best_rate(t: Series, y: Series, ω_d: float, offset: bool, drift: bool) -> tuple[float, float, float, float, float]:
    """Return decay rate, cosine and sine coefficient, offset and drift that fit best, for a given frequency.

    Raises
    ------
    InputError
        If the oscillation does not stand out from the noise.
    """
    baseline = np.array([np.ones(len(t)), t])[[offset, drift]]
    waves = np.array([np.cos(ω_d * t), np.sin(ω_d * t)])
    rates = np.geomspace(0.1 / t[-1], ω_d / 2, 2 + int(math.log2(5 * ω_d * t[-1])))  # about a factor of 2 apart
    best, coefficients, rate = math.inf, np.zeros(4), 0.0
    for λ in (0.0, *rates.tolist()):
        basis = np.vstack([np.exp(-λ * t) * waves, baseline])
        linear = np.linalg.lstsq(basis @ basis.T, basis @ y)[0]
        left = float(np.sum((y - linear @ basis) ** 2))
        if left < best:
            best, coefficients, rate = left, linear, λ
    constant = np.linalg.lstsq(baseline @ baseline.T, baseline @ y)[0] @ baseline if len(baseline) else 0.0
    explained = float(np.sum((y - constant) ** 2)) - best
    if explained * len(t) < 4 * math.log(len(t) / NOISE_ODDS) * best:
        raise InputError("is noise, nothing oscillates", "record")
    level = np.zeros(2)
    level[[offset, drift]] = coefficients[2:]
    return rate, float(coefficients[0]), float(coefficients[1]), float(level[0]), float(level[1])
