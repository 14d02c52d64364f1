"""Spectrum of a record at any times: typical step, and frequencies of the highest peaks.

At even times the spectrum is a discrete Fourier transform with zeros appended.  At uneven times, with frames missing or
a gap, the samples are put on the nearest points of a finer even grid and the rest of the grid is zero.  The transform
of this grid is the classical periodogram of the samples themselves (Press and Rybicki), without values invented between
them; a grid of a quarter of the step moves a sample by at most an eighth of it.

A gap of length G in the middle gives each peak neighbours at distances of about 1/G that can be nearly as high.  All
peaks that reach half the power of the highest are therefore candidates for the frequency of an oscillation.

References
----------
J. D. Scargle, Studies in astronomical time series analysis II, Astrophysical Journal 263 (1982).
W. H. Press, G. B. Rybicki, Fast algorithm for spectral analysis of unevenly sampled data, Astrophysical Journal 338
(1989).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ancf_casadi.decay.bic import gain_threshold
from ancf_casadi.records.processing import UNEVEN, without_line
from ancf_casadi.support.arrays import Array

PADDING = 4  # length of the transform in lengths of the record, and points of the grid for uneven times per step
GAP = 5.0  # median steps beyond which a step is a gap
CANDIDATE_POWER = 0.5  # power of a candidate, relative to the highest peak
STEP_PERIODS = 6.0  # periods in a record, fewer of which may be the slow part of a step
MIN_WINDOW_SAMPLES = 8  # that show an oscillation and the noise beside it
MAXIMA_TRIED = 100  # of a spectrum, the highest
PEAK_WIDTH = 1.1  # ratio of frequencies within which one peak counts: test_noise_on_the_flank_of_a_peak_is_no_peak


def typical_step(time: Array) -> float:
    """Return the mean step (s) of increasing times, without the gaps."""
    steps = np.diff(time)
    return float(steps[steps <= GAP * np.median(steps)].mean())


def has_even_steps(time: Array) -> bool:
    """Return whether times are equally spaced."""
    even_times = np.linspace(time[0], time[-1], len(time))
    return bool(np.abs(time - even_times).max() <= UNEVEN * (even_times[1] - even_times[0]))


def peak_frequencies(time: Array, swing: Array) -> list[float]:
    """Return candidates for the frequency (Hz) of an oscillation about 0, the highest peak first; one at even times."""
    frequency, power = power_spectrum(time, swing)
    peaks = 1 + np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:]))
    if has_even_steps(time) or not peaks.size:
        return [float(frequency[1 + np.argmax(power[1:])])]
    peaks = peaks[np.argsort(-power[peaks], kind="stable")]
    return [float(peak) for peak in frequency[peaks[power[peaks] >= CANDIDATE_POWER * power[peaks[0]]]]]


def strongest_peak(time: Array, values: Array, lowest_frequency: float) -> float | None:
    """Return the frequency (Hz) above the lowest whose power stands out most of that around it; None if none does."""
    frequency, power = power_spectrum(time, values)
    best_ratio, peak_frequency = gain_threshold(len(values), 3) / 2, None  # to the mean power of noise, median/ln 2
    octaves = math.log2(max(frequency[-1] / lowest_frequency, 1.0))
    edges = np.searchsorted(frequency, lowest_frequency * 2 ** np.arange(0.0, octaves, 0.5))
    for begin, end in pairwise([*edges.tolist(), len(frequency)]):
        if end - begin > 2 * PADDING:
            peak = begin + int(np.argmax(power[begin:end]))
            noise = float(np.median(power[max(begin - 2 * PADDING, 0) : end + 2 * PADDING])) / math.log(2)
            if power[peak] > best_ratio * noise:
                best_ratio, peak_frequency = power[peak] / noise, float(frequency[peak])
    return peak_frequency


def clear_peaks(frequency: Array, amplitude: Array, most: int) -> list[int]:
    """Return the places of the highest peaks of an amplitude spectrum that stand out of the octaves around them."""
    limit = gain_threshold(2 * len(amplitude), 3) / 2 / math.log(2)  # power over that of noise at the median
    maxima = 1 + np.flatnonzero((amplitude[1:-1] > amplitude[:-2]) & (amplitude[1:-1] >= amplitude[2:]))
    peaks: list[int] = []
    for place in maxima[np.argsort(-amplitude[maxima])][:MAXIMA_TRIED].tolist():
        near, around = (
            amplitude[slice(*np.searchsorted(frequency, [frequency[place] / ratio, frequency[place] * ratio]))]
            for ratio in (PEAK_WIDTH, 2.0)
        )
        if amplitude[place] == near.max() and amplitude[place] ** 2 > limit * np.median(around) ** 2:
            peaks.append(place)
        if len(peaks) == most:
            break
    return peaks


def oscillating_power(time: Array, values: Array, lowest_frequency: float) -> float:
    """Return the mean square of what oscillates in values above a frequency (Hz), without drift and white noise."""
    oscillation = without_line(time, values)
    frequency, power = power_spectrum(time, oscillation)
    band_power = power[frequency >= lowest_frequency]
    if not (band_power.any() and power.any()):
        return 0.0
    noise = float(np.median(band_power)) / math.log(2) * band_power.size
    return max(float(band_power.sum()) - noise, 0.0) / float(power.sum()) * float(np.mean(oscillation**2))


def step_frequency(time: Array, values: Array) -> float:
    """Return the frequency (Hz) of the strongest oscillation in a record that may have steps.

    The spectrum of a step falls as 1/f, that of its derivative is flat.  Noise also has a flat spectrum, and is
    subtracted before the power is multiplied by f^2.  Its power follows from the median of the spectrum.
    A short decay fills the whole spectrum, so that only the slow part of a step is left above a multiple of the median.
    The noise is then estimated from the lower quartile of the variance about a line in pieces of the record.  Uneven
    times are interpolated, so that a level is no oscillation.
    """
    if not has_even_steps(time):
        even_times = np.linspace(time[0], time[-1], 1 + round((time[-1] - time[0]) / float(np.median(np.diff(time)))))
        time, values = even_times, np.interp(even_times, time, values)
    frequency, power = _even_spectrum((time[-1] - time[0]) / (len(time) - 1), values - values.mean())
    mean_noise, peak_ratio = float(np.median(power)) / math.log(2), gain_threshold(len(values), 3) / 2
    for noise in (mean_noise, min(mean_noise, len(values) * _quiet_variance(values))):
        derivative_power = frequency**2 * np.maximum(power - peak_ratio * noise, 0.0)
        peak_frequency = float(frequency[1 + np.argmax(derivative_power[1:] if derivative_power.any() else power[1:])])
        if peak_frequency * (time[-1] - time[0]) > STEP_PERIODS:
            break
    return peak_frequency


def _quiet_variance(values: Array) -> float:
    """Return the lower quartile of the variance about a line, in pieces of the record."""
    pieces = values[: len(values) // MIN_WINDOW_SAMPLES * MIN_WINDOW_SAMPLES].reshape(-1, MIN_WINDOW_SAMPLES)
    if not len(pieces):
        return math.inf
    line = np.vander(np.linspace(-1.0, 1.0, MIN_WINDOW_SAMPLES), 2)
    residuals = pieces - pieces @ np.linalg.pinv(line).T @ line.T
    return float(np.quantile(np.sum(residuals**2, axis=1), 0.25)) / (MIN_WINDOW_SAMPLES - 2)


def power_spectrum(time: Array, values: Array) -> tuple[Array, Array]:
    """Return the frequencies (Hz) and the power of values at any times, up to half the sampling rate."""
    if has_even_steps(time):
        return _even_spectrum((time[-1] - time[0]) / (len(time) - 1), values)
    step = float(np.median(np.diff(time)))
    grid_indices = np.round((time - time[0]) / (step / PADDING)).astype(int)
    grid = np.zeros(grid_indices[-1] + 1)
    np.add.at(grid, grid_indices, values)
    frequency, power = _even_spectrum(step / PADDING, grid)
    end = max(3, int(np.searchsorted(frequency, 1 / (2 * step), side="right")))
    return frequency[:end], power[:end]


def _even_spectrum(step: float, values: Array) -> tuple[Array, Array]:
    """Return the frequencies (Hz) and the power of values at an even step (s), with zeros appended (``PADDING``)."""
    length = 2 ** math.ceil(math.log2(PADDING * len(values)))
    power = np.abs(np.fft.rfft(values, length)) ** 2
    return np.arange(len(power)) / (length * step), power
