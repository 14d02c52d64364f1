"""First guess of frequency, damping ratio and amplitude from a measured free decay.

A record may begin at rest or with an excitation (``release``).  From the release on, the highest peak of the spectrum
gives the frequency.  For each decay rate of a list, the linear coefficients are fitted to the samples at their own
times; the rate with the smallest residuals is taken.  With gaps, several peaks of the spectrum are candidates
(``spectrum``).  Each is refined by the iteration of ``local_decay``, and the one with the smallest residuals is
taken; if another explains the record nearly as well, a note says that the frequency is ambiguous.

References
----------
G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
separate, SIAM Journal on Numerical Analysis 10 (1973).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ancf_casadi.decay.bic import larger_model_is_evident
from ancf_casadi.decay.local_decay import local_decay
from ancf_casadi.decay.release import MIN_PERIODS, MIN_SAMPLES, MOTION_LEVEL, Release, find_release, grows_slowly
from ancf_casadi.decay.rest_position import REST_TERMS, Rest, rest_position
from ancf_casadi.decay.spectrum import peak_frequencies
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import without_line
from ancf_casadi.support.arrays import Array

# Tests that fail if one is halved or doubled: test_few_samples_per_period_are_enough,
# test_an_oscillation_no_larger_than_the_noise_is_found (INDEPENDENT_SHARE halved), and
# test_noise_that_a_sensor_averages_over_three_samples_is_hardly_ever_taken_for_an_oscillation (doubled).
FEW_SAMPLES = 3.0  # per period, below which a note warns of aliasing
DECAYED = 3.0  # decay times after which an oscillation is over: a longer record would show no more of it
HEAVY_TRIALS = 16  # of a heavily damped oscillation, and rates of a relaxation, that are tried
INDEPENDENT_SHARE = 0.5  # of the samples, as the noise of few sensors is white
SAME_MODE_DISTANCE = 0.1  # relative distance of two frequencies, below which they may be of one mode


@dataclass(frozen=True)
class DecayGuess:
    """Release and oscillation of a free decay before a law is fitted, with their limitations."""

    release: int  # index of the first sample of the free decay
    reason: str  # for this release, as in ``Release``
    duration: float  # the smaller of ``length`` and 1/(zeta omega), s
    length: float  # of the record from the release on, s
    ω: float  # natural frequency, rad/s
    ζ: float
    amplitude: float  # at the release, in the unit of the record
    phase: float  # at the release, rad; 0 at the highest value
    rest: tuple[float, ...]  # unknowns of the rest position (``REST_TERMS``), in the unit of the record
    notes: tuple[str, ...] = ()  # limitations that make the release or the frequency uncertain

    def equilibrium(self, time: Array) -> Array:
        """Return the rest position at times (s) after the release."""
        return np.asarray(rest_position(cs.DM(time), [cs.DM(value) for value in self.rest])).ravel()


def first_guess(record: Measurement, *, release_time: float | None = None) -> DecayGuess:
    """Guess the parameters of a decay from its record at any times, which may begin at rest or with an excitation.

    The oscillation is one about a line: a drift that no one asks for must not hide it.
    """
    release = find_release(record.time, record.values, release_time)
    t, y = record.time[release.index :], record.values[release.index :]
    if len(t) < MIN_SAMPLES:
        detected = release.index and release.reason != "given"
        doubt = f" after {release.reason}, or nothing oscillates" if detected else ""
        raise InputError(f"has {len(t)} samples of free decay{doubt}; a fit needs at least {MIN_SAMPLES}", "record")
    t = t - t[0]
    swing = without_line(t, y)
    _check_motion(y, swing, f" from {record.time[release.index]:g} s on" if release.index else "")
    best, *rivals = _candidates(t, y, swing)
    if not _has_periods(best, t):
        release, best = _find_heavy_damping(record, release)
        (t, y), rivals = _since(record, release.index), []
    _check_oscillation(t, y, best)
    c, s, offset, drift = best.linear.tolist()
    ω = math.hypot(best.ω_d, best.λ)
    return DecayGuess(
        release=release.index,
        reason=release.reason,
        duration=min(float(t[-1]), 1 / best.λ) if best.λ else float(t[-1]),
        length=float(t[-1]),
        ω=ω,
        ζ=best.λ / ω,
        amplitude=math.hypot(c, s),
        phase=math.atan2(-s, c),
        rest=(offset, drift / float(t[-1])),
        notes=(*record.warnings, *release.notes, *_notes(record, release, t, best, rivals)),
    )


def _since(record: Measurement, index: int) -> tuple[Array, Array]:
    """Return times since a sample, s, and the values from there on."""
    return record.time[index:] - record.time[index], record.values[index:]


def _has_periods(oscillation: _Candidate, t: Array) -> bool:
    """Return whether times have enough periods to show that something oscillates."""
    return bool(oscillation.ω_d * t[-1] >= 2 * math.pi * MIN_PERIODS)


def _find_heavy_damping(record: Measurement, release: Release) -> tuple[Release, _Candidate]:
    """Return the release of a heavily damped oscillation, which has few periods, and the oscillation.

    Raise an InputError if there is none, or if it neither has enough periods nor is over by the end of the record.
    """
    t, y = _since(record, release.index)
    departure = 0 if release.reason == "given" else _first_departure(y)
    heavily_damped = _fit_heavy_damping(t[departure:] - t[departure], y[departure:])
    if heavily_damped is not None:
        reason = "the end of rest" if departure else release.reason
        release, t = replace(release, index=release.index + departure, reason=reason), t[departure:] - t[departure]
        if _has_periods(heavily_damped, t) or heavily_damped.λ * t[-1] > DECAYED:
            return release, heavily_damped
    raise InputError(
        f"has fewer than two periods of free decay in the {t[-1]:.3g} s from {record.time[release.index]:g} s on "
        f"({release.reason}), or nothing oscillates; record longer, or give the time of the release",
        "record",
    )


def _check_motion(y: Array, swing: Array, since: str) -> None:
    """Raise an InputError if values are constant or a straight line, from which they swing by less than rounding."""
    if np.ptp(y) == 0.0:
        raise InputError(f"is constant{since}, nothing oscillates", "record")
    if np.ptp(swing) <= len(y) * np.spacing(np.abs(y).max()):
        raise InputError("is a straight line, nothing oscillates", "record")


def with_rest_position(guess: DecayGuess, record: Measurement, rest: Rest) -> DecayGuess:
    """Return the guess about a rest position of a kind; a note says if it drifts though it is taken as constant."""
    t, y = _since(record, guess.release)
    ω_d, λ = guess.ω * math.sqrt(1 - guess.ζ**2), guess.ζ * guess.ω
    term_count = len(REST_TERMS[rest])
    rates = np.geomspace(1 / t[-1], guess.ω / (2 * math.pi), 8).tolist() if rest == "creep" else [0.0]
    fits = []
    for rate in rates:
        creep = np.asarray(rest_position(cs.DM(t), [cs.DM(value) for value in (0.0, 1.0, rate)])).ravel()
        fits.append((_with_rate(t, y, ω_d, λ, np.vstack([np.ones(len(t)), creep])[:term_count]), rate))
    best, rate = min(fits, key=lambda fit: fit[0].misfit)
    c, s, *rest_terms = best.linear.tolist()
    line = _line(t)
    note = [] if term_count > 1 else _drift(record, best, _with_rate(t, y, ω_d, λ, line))
    return replace(
        guess,
        amplitude=math.hypot(c, s),
        phase=math.atan2(-s, c),
        rest=(*rest_terms, rate)[:term_count],
        notes=(*guess.notes, *note),
    )


@dataclass(frozen=True)
class _Candidate:
    """A damped oscillation with the least residuals for its frequency: rates (rad/s), coefficients, misfit."""

    ω_d: float
    λ: float
    linear: Array
    misfit: float


def _candidates(t: Array, y: Array, swing: Array) -> list[_Candidate]:
    """Return an oscillation about a line for each peak of the spectrum, that with the smallest residuals first."""
    baseline, frequencies = _line(t), peak_frequencies(t, swing)
    oscillations = [_best_rate(t, y, 2 * math.pi * frequency, baseline) for frequency in frequencies]
    if len(oscillations) == 1:
        return oscillations
    candidates = []
    for oscillation in oscillations:
        refinement = local_decay(t - t[-1] / 2, y, oscillation.λ, oscillation.ω_d)
        if refinement is not None and 0.0 < refinement.ω < math.pi / float(np.median(np.diff(t))):
            refined = _with_rate(t, y, refinement.ω, max(refinement.λ, 0.0), baseline)
            oscillation = min(oscillation, refined, key=lambda candidate: candidate.misfit)
        candidates.append(oscillation)
    return sorted(candidates, key=lambda candidate: candidate.misfit)


def _line(t: Array) -> Array:
    """Return the baseline of a drift: its value at time 0, and its change over the record."""
    return np.vstack([np.ones(len(t)), t / t[-1]])


def _first_departure(y: Array) -> int:
    """Return the index of the first sample that departs from the level of the first ones, 0 if too few follow."""
    first_samples = y[:MIN_SAMPLES]
    departed = np.abs(y - np.median(first_samples)) > max(MOTION_LEVEL * np.ptp(y), 4 * float(np.std(first_samples)))
    index = int(np.argmax(departed))
    return index if len(y) - index >= MIN_SAMPLES else 0


def _fit_heavy_damping(t: Array, y: Array) -> _Candidate | None:
    """Return a heavily damped oscillation, which has no peak in the spectrum; None if it may as well be a relaxation.

    A relaxation is the sum of two exponentials.
    """
    baseline = _line(t)
    frequencies = np.geomspace(math.pi / t[-1], math.pi * len(t) / (4 * t[-1]), HEAVY_TRIALS)
    best = min(
        (_with_rate(t, y, ω_d, λ, baseline) for ω_d in frequencies.tolist() for λ in (0.5 * ω_d, ω_d, 1.5 * ω_d)),
        key=lambda candidate: candidate.misfit,
    )
    for width in (0.5, 0.25, 0.1, 0.05):  # relative, of a search about the best so far
        factors = np.exp(width * np.linspace(-1.0, 1.0, 5)).tolist()
        trials = [_with_rate(t, y, a * best.ω_d, b * best.λ, baseline) for a in factors for b in factors]
        best = min(best, *trials, key=lambda candidate: candidate.misfit)
    rates = np.geomspace(0.5 / t[-1], len(t) / (4 * t[-1]), HEAVY_TRIALS)
    exponentials = np.exp(-np.outer(rates, t))
    pairs = itertools.combinations(exponentials, 2)
    relaxation_misfit = min(_misfit(y, np.vstack([*pair, baseline])) for pair in pairs)
    samples, motion = INDEPENDENT_SHARE * len(y), float(np.var(y)) * len(y)
    return best if larger_model_is_evident(relaxation_misfit, best.misfit, samples, 0, motion) else None


def _misfit(y: Array, basis: Array) -> float:
    """Return the sum of the squares that the rows of a basis leave."""
    basis = basis / np.linalg.norm(basis, axis=1)[:, None]
    return float(np.sum((y - np.linalg.lstsq(basis @ basis.T, basis @ y)[0] @ basis) ** 2))


def _best_rate(t: Array, y: Array, ω_d: float, baseline: Array) -> _Candidate:
    """Return the oscillation with the best decay rate of a list, for a given frequency."""
    rates = np.geomspace(0.1 / t[-1], ω_d / 2, 2 + max(0, int(math.log2(5 * ω_d * t[-1]))))  # a factor of 2 apart
    return min(
        (_with_rate(t, y, ω_d, λ, baseline) for λ in (0.0, *rates.tolist())), key=lambda candidate: candidate.misfit
    )


def _with_rate(t: Array, y: Array, ω_d: float, λ: float, baseline: Array) -> _Candidate:
    """Return the oscillation with a given frequency and decay rate."""
    fading = np.exp(-λ * t)
    basis = np.vstack([fading * np.cos(ω_d * t), fading * np.sin(ω_d * t), baseline])
    length = np.linalg.norm(basis, axis=1)  # a drift per second may be far smaller or larger than the oscillation
    length[length == 0.0] = 1.0
    basis /= length[:, None]
    linear = np.linalg.lstsq(basis @ basis.T, basis @ y)[0]
    return _Candidate(ω_d, λ, linear / length, float(np.sum((y - linear @ basis) ** 2)))


def _check_oscillation(t: Array, y: Array, best: _Candidate) -> None:
    """Raise an InputError if the oscillation is not significant beside a line."""
    baseline = _line(t)
    constant = np.linalg.lstsq(baseline @ baseline.T, baseline @ y)[0] @ baseline
    explained = float(np.sum((y - constant) ** 2)) - best.misfit
    samples = INDEPENDENT_SHARE * (len(y) - 4 - len(baseline))
    if not larger_model_is_evident(explained + best.misfit, best.misfit, samples, 4, explained):
        raise InputError("is noise or drift, nothing oscillates", "record")


def _notes(
    record: Measurement, release: Release, t: Array, best: _Candidate, rivals: Sequence[_Candidate]
) -> list[str]:
    """Return notes on another mode than the driven one, rival frequencies, and aliasing; t (s) from the release."""
    notes, frequency, driven = list[str](), best.ω_d / (2 * math.pi), release.frequency
    if abs(driven / frequency - 1) >= SAME_MODE_DISTANCE and grows_slowly(record.time, record.values, driven):
        notes.append(
            f"the excitation had {driven:.3g} Hz, and the decay has {frequency:.3g} Hz: another mode than the driven "
            "one is the largest; let the excitation grow slowly (ramp), measure at another point, or fit several modes"
        )
    motion = float(np.var(record.values[-len(t) :])) * len(t)
    alternatives = [
        f"{candidate.ω_d / (2 * math.pi):.4g}"
        for candidate in rivals
        if not larger_model_is_evident(candidate.misfit, best.misfit, len(t), 0, motion)
        and abs(candidate.ω_d - best.ω_d) * t[-1] > math.pi
    ]
    if alternatives:
        notes.append(
            f"the gaps in the record leave the frequency ambiguous: {' or '.join(alternatives)} Hz would fit as well "
            f"as {frequency:.4g} Hz; record without gaps"
        )
    samples_per_period = 1 / (frequency * float(np.median(np.diff(t))))
    if samples_per_period < FEW_SAMPLES:
        notes.append(
            f"the record has {samples_per_period:.2g} samples per period: a frequency above half the sampling rate "
            "would look the same (alias); sample faster"
        )
    return notes


def _drift(record: Measurement, level: _Candidate, line: _Candidate) -> list[str]:
    """Return a note if an oscillation about a line leaves far less than one about a constant."""
    if line.misfit > level.misfit / 2:
        return []
    moved = f"{abs(line.linear[3]):.2g} {record.sensor.unit}"
    return [f"the rest position moves by about {moved} over the record; fit it too (rest='drift', or 'creep')"]
