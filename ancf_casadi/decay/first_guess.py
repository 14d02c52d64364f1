"""First guess of frequency, damping ratio and amplitude from a measured free decay.

A record may begin at rest or with an excitation (``release``).  From the release on, the highest peak of the spectrum
gives the frequency.  For each decay rate of a list, the linear coefficients are fitted; the rate that leaves the
smallest residuals is taken.

References
----------
G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
separate, SIAM Journal on Numerical Analysis 10 (1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.decay.release import MINIMUM_SAMPLES, Release, find_release, peak_frequency
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array

MINIMUM_PERIODS = 1.5  # counted from the peak of the spectrum, which may be too low by half a period
NOISE_ODDS = 1e-4  # probability of mistaking pure noise for an oscillation


@dataclass(frozen=True)
class DecayGuess:
    """Starting values for the fit of a decay.

    Parameters
    ----------
    release : int
        Index of the first sample of the free decay.
    reason : str
        Reason for this release, as in ``Release``.
    duration : float
        The smaller of ``length`` and 1/(zeta omega), s.
    length : float
        Length of the record from the release on, s.
    ω : float
        Natural frequency, rad/s.
    ζ : float
        Damping ratio.
    amplitude : float
        Amplitude at the release, m.
    phase : float
        Phase at the release, rad; 0 at the highest displacement.
    offset : float
        Equilibrium, m; with drift, the one at the release.
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
        Record, which may begin at rest or with an excitation.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.
    offset : bool
        Whether the equilibrium may differ from 0.
    drift : bool
        Whether the equilibrium may move at a constant velocity.

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
    λ, c, s, level, velocity = _best_rate(t, y, ω_d, offset, drift)
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
        drift=velocity,
    )


def _evenly_spaced(record: Measurement) -> tuple[Array, Array]:
    time = np.linspace(record.time[0], record.time[-1], len(record.time))
    return time, np.interp(time, record.time, record.values)


def _without_line(time: Array, displacement: Array) -> Array:
    """Return the displacement minus a straight line fitted by least squares."""
    t: Array = time - time.mean()
    rest: Array = displacement - displacement.mean() - t * (t @ displacement) / (t @ t)
    return rest


def _best_rate(t: Array, y: Array, ω_d: float, offset: bool, drift: bool) -> tuple[float, float, float, float, float]:
    """Return the best decay rate, coefficients of cosine and sine, offset and drift for a given frequency.

    Raises
    ------
    InputError
        If the oscillation is not significant.
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
