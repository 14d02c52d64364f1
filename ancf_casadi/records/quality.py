"""Faults of a record that no fit can mend: clipped swings, and a peak at the end of the spectrum.

Clipping.  A swing is the part of a record between two crossings of its middle.  A clipped swing ends flat: at least
three samples in succession have exactly the extreme value, and few lie just below it, because the record passes there
with its full velocity.  Of a sine that is not clipped, the highest 1 % of the range takes longer than the step at the
top, even in a record of a few quantisation steps q: with the band max(1 % of the range, 3 q) below the extreme value,

    samples at the extreme value / samples in the band <= 1,    1 at worst, if a peak of height 4 q ends at a step.

A record is clipped if the median of this ratio over at least three flat swings is 2 or more, on one side or the other,
and swings that do not reach the extreme value are not flat at their own ends, as those of a motion are that is flat by
itself.  A record with fewer than ``FEWEST_LEVELS`` quantisation steps in its highest tenth is not judged.

Aliasing.  Without a filter before the sampling, vibrations above half the sampling rate appear below it.  That a filter
is missing shows at the end of the spectrum, where a filter leaves nothing: the highest line within 4 % of half the rate
exceeds 50 times the median of the upper third of an averaged periodogram and 10 times what the band before it has, and
holds an amplitude of 1 % of the largest or more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.support.arrays import Array, Index

FLAT = 3  # equal samples in succession at the end of a clipped swing
FLAT_SWINGS = 3  # of a clipped record
CROWDED = 2.0  # samples at the extreme value per sample in the band below it, of a clipped swing
FEWEST_LEVELS = 5  # of the quantisation in the highest tenth of the range; with fewer, steps look like flat ends
PERIODOGRAMS = 8  # of the averaged periodogram
SHORTEST_SEGMENT = 64  # samples


def quality_warnings(time: Array, values: Array) -> list[str]:
    """Return a sentence for each fault of a record without gaps."""
    return [text for text in (_clipped(values), _aliased(time, values)) if text]


def _clipped(values: Array) -> str:
    """Return a warning of a record that is clipped at its highest or lowest value."""
    found = {float(sign * top): count for sign in (1.0, -1.0) for top, count in [_flat_swings(sign * values)] if count}
    if not found:
        return ""
    ends = " and ".join(f"{count} swings at {value:.5g}" for value, count in found.items())
    return (
        f"the record is clipped: {ends} end flat at exactly the same value, as where a sensor or amplifier saturates; "
        "the amplitudes are too small there: begin later, or measure again with a larger range"
    )


def _flat_swings(values: Array) -> tuple[float, int]:
    """Return the highest value, and the number of swings that are clipped there, 0 if the record is not."""
    top, bottom = float(values.max()), float(values.min())
    if np.count_nonzero(_runs(values == top) >= FLAT) < FLAT_SWINGS:
        return top, 0
    levels = np.unique(values[values > top - 0.1 * (top - bottom)])  # near the end: the quantisation shows there
    if len(levels) < FEWEST_LEVELS:
        return top, 0
    band = max(0.01 * (top - bottom), 3.0 * float(np.diff(levels).min()))
    swings = [
        swing for swing in _swings(values > 0.5 * (top + bottom), values) if swing.max() > top - (top - bottom) / 4
    ]
    flat, other = list[float](), list[float]()
    for swing in swings:
        own = swing.max()
        at_end = swing == own
        below = int(np.count_nonzero(~at_end & (swing >= own - band)))
        crowd = int(np.count_nonzero(at_end)) / max(1, below)
        (flat if own == top else other).append(crowd if _runs(at_end).max() >= FLAT else 0.0)
    clipped = [crowd for crowd in flat if crowd]
    if len(clipped) < FLAT_SWINGS or np.median(flat) < CROWDED or (other and np.median(other) >= CROWDED):
        return top, 0
    return top, len(clipped)


def _swings(above: NDArray[np.bool_], values: Array) -> list[Array]:
    """Return the parts of a record that lie above its middle."""
    edges: Index = np.flatnonzero(np.diff(above.astype(np.int8))) + 1
    return [part for part, own in zip(np.split(values, edges), np.split(above, edges), strict=True) if own[0]]


def _runs(equal: NDArray[np.bool_]) -> Index:
    """Return the lengths of the runs of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], equal.astype(np.int8), [0]])))
    return np.diff(edges)[::2]


def _aliased(time: Array, values: Array) -> str:
    """Return a warning of an evenly sampled record whose spectrum has a peak next to half the sampling rate."""
    size = 2 * len(values) // (PERIODOGRAMS + 1)
    if len(np.unique(values)) < 50:  # steps of the quantisation make lines of their own
        return ""
    steps = np.diff(time)
    if size < SHORTEST_SEGMENT or np.abs(steps - np.median(steps)).max() > 0.1 * np.median(steps):
        return ""
    window = np.hanning(size)
    swing = values - values.mean()
    parts = [swing[k * size // 2 :][:size] for k in range(PERIODOGRAMS)]
    power = np.mean([np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2 for part in parts], axis=0)
    share = np.arange(len(power)) / (len(power) - 1)  # of half the sampling rate
    edge, before, upper = power[share > 0.96], power[(share > 0.8) & (share < 0.94)], power[share > 2 / 3]
    highest = float(edge.max())
    if highest <= max(50.0 * float(np.median(upper)), 10.0 * float(before.max()), 1e-4 * float(power.max())):
        return ""
    place = share[share > 0.96][int(np.argmax(edge))] * 0.5 * (len(time) - 1) / (time[-1] - time[0])
    return (
        f"the spectrum has a peak at {place:.4g} Hz, next to half the sampling rate, where a filter against aliasing "
        "leaves nothing: vibrations or interference above half the rate appear as lower ones; sample faster, or filter "
        "before sampling"
    )
