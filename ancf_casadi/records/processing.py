"""Sampling and preparation of a record: rate and gaps, fewer samples per second, a band, and no straight line.

Filters.  Frequencies above half the new sampling rate would appear as lower ones (aliasing), so that a low-pass filter
precedes the selection of every n-th sample.  The filters are symmetric finite impulse responses with a Kaiser window
and so shift no phase: they keep amplitudes within 1e-4, and suppress what they do not keep by 80 dB.  Where a filter
would need samples beyond the record, its result is left out: 13 new samples at either end if the record gets fewer,
which keeps up to 80 % of half the new rate; 5 periods of each limit of a band, beyond half the lower and 1.5 times the
upper of which nothing is left.

No loss at the ends.  Near a release, a filter mixes samples with others that it has to invent.  ``projected`` keeps the
slowest terms of a discrete cosine transform instead.  This is an orthogonal projection: white noise stays white, with
the same power at each frequency, and scalar products with slow curves are kept up to the ends.

References
----------
J. F. Kaiser, Nonrecursive digital filter design using the I0-sinh window function, Proceedings of the IEEE
International Symposium on Circuits and Systems (1974).
G. Strang, The discrete cosine transform, SIAM Review 41 (1999).
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array

UNEVEN = 0.1  # largest deviation of a time from the even grid, in steps


def sampling_step(time: Array) -> float:
    """Return the step of evenly spaced times, s; refuse others by the first place that differs."""
    steps = np.diff(time)
    step = float(np.median(steps))
    wrong = np.abs(steps - step) > UNEVEN * step
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"is not evenly spaced: after {time[first]:g} s the step is {steps[first]:g} s instead of {step:g} s; "
            "cut the record to a part without gaps, or fit it as it is",
            "time",
        )
    return float((time[-1] - time[0]) / (len(time) - 1))


def decimated(values: Array, factor: int) -> tuple[Array, int]:
    """Return every ``factor``-th value after the low-pass filter, and the place of the first one."""
    from scipy.signal import upfirdn  # slow to import

    filter_ = _low_pass(1.0 / factor, 2 * (1 - 0.8) / factor)
    filter_ = np.pad(filter_, -(len(filter_) // 2) % factor)  # begins at a sample that is kept
    half = len(filter_) // 2
    count = (len(values) - 1 - 2 * half) // factor + 1
    return np.asarray(upfirdn(filter_, values, down=factor)[2 * half // factor :][:count], dtype=float), half


def in_band(values: Array, low: float | None, high: float | None) -> tuple[Array, int]:
    """Return what lies between frequencies relative to half the sampling rate, and the place of the first value."""
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


def projected(values: Array, count: int) -> Array:
    """Return the projection of evenly sampled values (m,) on their slowest ``count`` cosines, at as many even times.

    If the steps of the values and of the result begin and end together, these times are in their middles.  A slope at
    an end leaves an error near this end, of about the change of the values over a fifth of the new step; residuals of
    a fit have hardly any.
    """
    from scipy.fft import dct, idct  # slow to import

    return np.asarray(idct(dct(values, 2)[:count], 2) * (count / len(values)), dtype=float)


def without_line(time: Array, values: Array) -> Array:
    """Return values minus the straight line that fits them best."""
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
        found = (len(time), *edges, math.nan, 0, 0, math.nan, math.nan, math.nan)
        return dict(zip(names, found, strict=True))
    steps = np.diff(time)
    step = float(np.median(steps))
    long = steps > 1.5 * step  # a longer step is a gap
    regular = steps[~long]
    longest = int(np.argmax(steps))
    missing = np.rint(steps[long] / step) - 1
    found = (
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
    return dict(zip(names, found, strict=True))
