"""Sampling, preparation and faults of a record: rate and gaps, fewer samples, a band, clipped and aliased signals.

Filters.  Frequencies above half the new sampling rate would appear as lower ones (aliasing), so that a low-pass filter
precedes the selection of every n-th sample.  The filters are symmetric finite impulse responses with a Kaiser window
and so shift no phase: they keep amplitudes within 1e-4 in the pass band, and suppress the stop band by 80 dB.  Results
that would need samples beyond the record are left out.  Decimation removes 13 new samples at either end and keeps
frequencies up to 80 % of half the new rate.  A band removes 5 periods of each limit at either end, and suppresses
frequencies below half the lower and above 1.5 times the upper limit.

No loss at the ends.  Near a release, a filter would need samples that do not exist.  ``project_on_cosines`` keeps the
slowest terms of a discrete cosine transform instead.  This is an orthogonal projection: white noise stays white, with
the same power at each frequency, and scalar products with slow curves are kept up to the ends.

Clipping.  A swing is a stretch of a record between two crossings of its middle.  A clipped swing has a flat end: at
least three successive samples have exactly the extreme value, and few lie just below it, because the record passes
there with its full velocity.  A sine that is not clipped spends more time in the highest 1 % of its range than at the
top step, even in a record of a few quantisation steps q: with the band max(1 % of the range, 3 q) below the extreme
value,

    samples at the extreme value / samples in the band <= 1,    1 at worst, if a peak of height 4 q ends at a step.

A record is clipped at its highest or lowest value if the median of this ratio over at least three flat swings is 2 or
more, and swings that do not reach the extreme value have no flat ends, as a motion with naturally flat swings has.  A
record with fewer than ``MIN_LEVELS`` quantisation steps in its highest tenth is not judged.

Aliasing.  Without a filter before the sampling, vibrations above half the sampling rate appear below it.  A missing
filter shows at the end of the spectrum, which a filter would suppress: the highest line within 4 % of half the rate
exceeds 50 times the median of the upper third of an averaged periodogram and 10 times the band before it, and has an
amplitude of 1 % of the largest or more.

References
----------
J. F. Kaiser, Nonrecursive digital filter design using the I0-sinh window function, Proceedings of the IEEE
International Symposium on Circuits and Systems (1974).
G. Strang, The discrete cosine transform, SIAM Review 41 (1999).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Index

UNEVEN = 0.1  # largest deviation of a time from the even grid, in steps
FLAT = 3  # equal samples in succession at the end of a clipped swing
FLAT_SWINGS = 3  # of a clipped record
CLIPPED_RATIO = 2.0  # samples at the extreme value per sample in the band below it, of a clipped swing
MIN_LEVELS = 5  # of the quantisation in the highest tenth of the range; with fewer, steps look like flat ends
PERIODOGRAMS = 8  # of the averaged periodogram
MIN_SEGMENT = 64  # samples


def sampling_step(time: Array) -> float:
    """Return the step of evenly spaced times, s; an error names the first time that deviates."""
    steps = np.diff(time)
    step = float(np.median(steps))
    wrong = np.abs(steps - step) > UNEVEN * step
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"is not evenly spaced: after {time[first]:g} s the step is {steps[first]:g} s instead of {step:g} s; "
            "cut the record to an interval without gaps, or fit it as it is",
            "time",
        )
    return float((time[-1] - time[0]) / (len(time) - 1))


def decimate(values: Array, factor: int) -> tuple[Array, int]:
    """Return every ``factor``-th value after the low-pass filter, and the index of the first."""
    from scipy.signal import upfirdn  # slow to import

    filter_ = _low_pass(1.0 / factor, 2 * (1 - 0.8) / factor)
    filter_ = np.pad(filter_, -(len(filter_) // 2) % factor)  # its half is then a multiple of the factor
    half = len(filter_) // 2  # index of the first value with as many before it as the filter needs
    count = (len(values) - 1 - 2 * half) // factor + 1
    return np.asarray(upfirdn(filter_, values, down=factor)[2 * half // factor :][:count], dtype=float), half


def band_pass(values: Array, low: float | None, high: float | None) -> tuple[Array, int]:
    """Return the values in a band, relative to half the sampling rate, and the index of the first value."""
    from scipy.signal import oaconvolve  # slow to import

    first = 0
    for limit, width in ((low, low and 0.5 * low), (high, high and min(0.5 * high, 1.0 - high))):
        if limit is None or width is None:
            continue
        filter_ = _low_pass(limit + (0.5 if limit is high else -0.5) * width, width)
        half = len(filter_) // 2
        if len(values) < 2 * half + 2:
            return values[:0], half
        slow = oaconvolve(values, filter_, mode="valid")
        values = slow if limit is high else values[half : len(values) - half] - slow
        first += half
    return np.asarray(values, dtype=float), first


def _low_pass(limit: float, width: float) -> Array:
    """Return a symmetric filter of odd length, with its limit and the width of its flank relative to half the rate."""
    from scipy.signal import firwin, kaiserord  # slow to import

    taps, beta = kaiserord(80.0, width)  # attenuation, dB
    return np.asarray(firwin(taps // 2 * 2 + 1, limit, window=("kaiser", beta)))


def amplitude_spectrum(grid: Array, values: Array) -> tuple[Array, Array]:
    """Return frequencies (Hz) and amplitudes of values at even times (s), after a Hann window."""
    window = np.hanning(len(values))
    amplitudes = 2 * np.abs(np.fft.rfft((values - values.mean()) * window)) / window.sum()
    return np.fft.rfftfreq(len(values), (grid[-1] - grid[0]) / (len(grid) - 1)), amplitudes


def project_on_cosines(values: Array, count: int) -> Array:
    """Return the projection of evenly sampled values (m,) on their slowest ``count`` cosines, at ``count`` even times.

    Each time is the middle of a step if the steps of the values and of the result span the same interval.  A slope at
    an end leaves an error near this end, of about the change of the values over a fifth of the new step; residuals of
    a fit have hardly any slope there.
    """
    from scipy.fft import dct, idct  # slow to import

    return np.asarray(idct(dct(values, 2)[:count], 2) * (count / len(values)), dtype=float)


def without_line(time: Array, values: Array) -> Array:
    """Return values minus their least-squares straight line."""
    centred = time - time.mean()
    slope = float(centred @ values) / float(centred @ centred)
    return np.asarray(values - values.mean() - slope * centred)


def sampling(time: Array) -> dict[str, float]:
    """Return the sampling of increasing times (s), as plain data; nan for what does not exist.

    It has the number of samples, the first and the last time, the samples per second between gaps, the number of gaps
    (steps of more than 1.5 times the median), the number of samples that would fill them, length and begin of the
    longest gap, and the standard deviation of the other steps relative to the median (``jitter``).
    """
    names = "samples", "begin", "end", "rate", "gaps", "missing", "longest_gap", "longest_gap_at", "jitter"
    if len(time) < 2:
        edges = (float(time[0]), float(time[-1])) if len(time) else (math.nan, math.nan)
        properties = (len(time), *edges, math.nan, 0, 0, math.nan, math.nan, math.nan)
        return dict(zip(names, properties, strict=True))
    steps = np.diff(time)
    step = float(np.median(steps))
    long = steps > 1.5 * step  # a longer step is a gap
    regular = steps[~long]
    longest = int(np.argmax(steps))
    missing = np.rint(steps[long] / step) - 1
    properties = (
        len(time),
        float(time[0]),
        float(time[-1]),
        1 / float(regular.mean()),
        int(long.sum()),
        int(min(missing.sum(), 1e15)),
        float(steps[longest]) if long.any() else math.nan,
        float(time[longest]) if long.any() else math.nan,
        float(regular.std()) / step,
    )
    return dict(zip(names, properties, strict=True))


def resolution(values: Array) -> float:
    """Return the step between the values of a quantised record; 0 if most values differ."""
    levels = np.unique(values)
    return float(np.median(np.diff(levels))) if 1 < len(levels) < len(values) / 4 else 0.0


def quality_warnings(time: Array, values: Array) -> list[str]:
    """Return a warning for each fault of a record without gaps."""
    return [text for text in (_clipping_warning(values), _aliasing_warning(time, values)) if text]


def has_flat_top(values: Array) -> bool:
    """Return whether a stretch of a record is clipped at its highest value, even in one swing."""
    levels = np.unique(values)
    if len(levels) < MIN_LEVELS:
        return False
    band = max(0.01 * float(np.ptp(values)), 3.0 * float(np.diff(levels[-MIN_LEVELS:]).min()))
    return _flatness(values, band) >= CLIPPED_RATIO


def _clipping_warning(values: Array) -> str:
    """Return a warning if a record is clipped at its highest or lowest value, else an empty text."""
    (top, top_count), (bottom, bottom_count) = _flat_swings(values), _flat_swings(-values)
    clipped = [(value, count) for value, count in ((top, top_count), (-bottom, bottom_count)) if count]
    if not clipped:
        return ""
    ends = " and ".join(f"{count} swings at {value:.5g}" for value, count in clipped)
    return (
        f"the record is clipped: {ends} end flat at exactly the same value, as where a sensor or amplifier saturates; "
        "the amplitudes are too small there: begin later, or measure again with a larger range"
    )


def _flat_swings(values: Array) -> tuple[float, int]:
    """Return the highest value and the number of swings clipped there, 0 if the record is not clipped."""
    top, span = float(values.max()), float(np.ptp(values))
    if np.count_nonzero(_runs(values == top) >= FLAT) < FLAT_SWINGS:
        return top, 0
    levels = np.unique(values[values > top - span / 10])  # near the end: the quantisation shows there
    if len(levels) < MIN_LEVELS:
        return top, 0
    band = max(0.01 * span, 3.0 * float(np.diff(levels).min()))
    ratios_at_top, ratios_of_lower = list[float](), list[float]()
    for swing in _swings(values > top - span / 2, values):
        peak = swing.max()
        if peak > top - span / 4:
            (ratios_at_top if peak == top else ratios_of_lower).append(_flatness(swing, band))
    count = int(np.count_nonzero(ratios_at_top))
    lower_are_flat = bool(ratios_of_lower) and np.median(ratios_of_lower) >= CLIPPED_RATIO
    is_clipped = count >= FLAT_SWINGS and np.median(ratios_at_top) >= CLIPPED_RATIO and not lower_are_flat
    return top, count if is_clipped else 0


def _flatness(values: Array, band: float) -> float:
    """Return the samples at the highest value per sample in a band below it; 0 if it is not flat."""
    top = values.max()
    at_top = values == top
    below = ~at_top & (values >= top - band)
    return float(at_top.sum() / max(1, below.sum())) if _runs(at_top).max() >= FLAT else 0.0


def _swings(above: NDArray[np.bool_], values: Array) -> list[Array]:
    """Return the stretches of a record above its middle."""
    edges: Index = np.flatnonzero(np.diff(above.astype(np.int8))) + 1
    return np.split(values, edges)[0 if above[0] else 1 :: 2]


def _runs(equal: NDArray[np.bool_]) -> Index:
    """Return the lengths of the runs of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], equal.astype(np.int8), [0]])))
    return np.diff(edges)[::2]


def _aliasing_warning(time: Array, values: Array) -> str:
    """Return a warning if an evenly sampled record has a spectral peak next to half its rate, else an empty text."""
    size = 2 * len(values) // (PERIODOGRAMS + 1)
    if len(np.unique(values)) < 50:  # coarse quantisation causes lines too
        return ""
    steps = np.diff(time)
    if size < MIN_SEGMENT or np.abs(steps - np.median(steps)).max() > 0.1 * np.median(steps):
        return ""
    window = np.hanning(size)
    segments = [values[k * size // 2 :][:size] for k in range(PERIODOGRAMS)]
    power = np.mean([np.abs(np.fft.rfft(window * (segment - segment.mean()))) ** 2 for segment in segments], axis=0)
    relative = 2 * np.arange(len(power)) / size  # frequency over half the sampling rate
    edge, upper_third = power[relative > 0.96], power[relative > 2 / 3]
    band_below = power[(relative > 0.8) & (relative < 0.94)]
    highest = float(edge.max())
    if highest <= max(50.0 * float(np.median(upper_third)), 10.0 * float(band_below.max()), 1e-4 * float(power.max())):
        return ""
    frequency = relative[relative > 0.96][int(np.argmax(edge))] * 0.5 * (len(time) - 1) / (time[-1] - time[0])
    return (
        f"the spectrum has a peak at {frequency:.4g} Hz, next to half the sampling rate, where a filter against "
        "aliasing leaves nothing: vibrations or interference above half the rate appear as lower ones; sample "
        "faster, or filter before sampling"
    )
