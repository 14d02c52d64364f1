"""Detection of the start of the free decay in a record: the end of an initial rest, or the end of an excitation.

Rest.  Before the largest swing, the last window of half a period in which almost nothing moves gives the level of rest.
The decay begins at the first sample after the last one at this level: the release itself lies between the two, and the
closed forms hold from any later instant on.  A window holds the samples at their own times.  One with a hole of more
than half its length may hide a swing and is not taken for rest.

Excitation.  See ``excitation``.

Gaps.  A piece of less than one and a half periods between the release and a gap is left out, because it does not show
whether the beam rests or moves.  If the decay begins at the end of a gap, a note says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.decay.excitation import end_of_excitation
from ancf_casadi.decay.spectrum import GAP, LEAST_SAMPLES, step_frequency, typical_step
from ancf_casadi.records.processing import without_line
from ancf_casadi.support.arrays import Array, Index

# Tests that fail: test_a_record_in_which_nothing_oscillates_is_refused (either minimum halved),
# test_an_excitation_that_grows_out_of_the_noise_is_not_taken_for_rest_and_release (REST_SWING doubled, GROWN halved),
# test_a_release_after_rest_is_no_excitation (GROWN doubled), and
# test_the_decay_begins_at_the_first_sample_in_motion (LEVEL halved).
MINIMUM_SAMPLES = 10
MINIMUM_PERIODS = 1.5  # fewer do not show whether the beam rests or moves
REST_SWING = 0.25  # largest swing of a window at rest, relative to all; with a free oscillation it is at least 0.5
GROWN = 0.8  # relative swing that a released beam reaches within a period; that of a driven beam grows slowly
LEVEL = 0.02  # departure that does not count as motion, relative to the largest swing


@dataclass(frozen=True)
class Release:
    """Start of a free decay.

    Parameters
    ----------
    index : int
        First sample of the decay.
    reason : str
        Reason: the first sample, the end of rest, the end of an excitation, the end of a gap, or given.
    notes : tuple of str
        Reasons for doubt.
    """

    index: int
    reason: str
    notes: tuple[str, ...] = ()


def find_release(time: Array, measured: Array) -> Release:
    """Return the start of the free decay; the first sample unless rest or an excitation precedes it.

    Parameters
    ----------
    time : ndarray
        Increasing times, s.
    measured : ndarray
        Value at each, of any sensor.
    """
    if len(time) < MINIMUM_SAMPLES or np.ptp(measured) == 0.0:
        return Release(0, "the first sample")
    period = 1 / step_frequency(time, without_line(time, measured))
    rest, grows = _end_of_rest(time, measured, period)
    forced = rest + end_of_excitation(time[rest:], measured[rest:])
    if forced == rest and grows:
        forced = end_of_excitation(time, measured)  # the rest may be a weak excitation
    begin = _after_gaps(time, max(rest, forced), period)
    gap = float(time[begin] - time[begin - 1]) if begin else 0.0
    reason = "the end of an excitation" if forced > rest else "the end of rest" if rest else "the first sample"
    if gap <= GAP * typical_step(time):
        return Release(begin, reason)
    note = (
        f"a gap of {gap:.3g} s hides the release or follows it closely; the decay is taken from the end of the gap on, "
        f"{time[begin]:g} s"
    )
    return Release(begin, "the end of a gap", (note,))


def _after_gaps(time: Array, begin: int, period: float) -> int:
    """Return the first sample after gaps that leave too little of the record before them to tell rest from motion."""
    longest = max(period / 2, GAP * typical_step(time))
    early = slice(begin, int(np.searchsorted(time, time[begin] + 4 * MINIMUM_PERIODS * period)))
    for gap in (begin + np.flatnonzero(np.diff(time[early]) > longest)).tolist():
        if time[gap] - time[begin] < MINIMUM_PERIODS * period:
            begin = gap + 1
    return begin


def _end_of_rest(time: Array, displacement: Array, period: float) -> tuple[int, bool]:
    """Return the index of the first sample after rest, 0 if there is none, and whether the swing then grows slowly."""
    step = typical_step(time)
    least = min(LEAST_SAMPLES, max(LEAST_SAMPLES // 2, math.ceil(period / step)))
    width = max(period / 2, (least - 1) * step)
    last = np.maximum(np.searchsorted(time, time + width - step / 2), np.arange(len(time)) + least - 1)
    last = last[last < len(time)]
    if not last.size:
        return 0, False
    flat = without_line(time, displacement)
    swing = _highest(flat, last) + _highest(-flat, last)
    whole = _highest(np.append(np.diff(time), 0.0), last - 1) <= max(width / 2, 2.5 * step)
    quiet = np.flatnonzero((whole & (swing <= REST_SWING * swing.max()))[: int(np.argmax(swing))])
    if quiet.size == 0:
        return 0, False
    begin, end = int(quiet[-1]), int(last[quiet[-1]])
    level = np.median(displacement[begin : end + 1])
    departure = np.abs(displacement - level)
    still = departure <= max(LEVEL * swing.max(), 3 * np.median(departure[begin : end + 1]))
    rest = begin + int(np.flatnonzero(still[begin : end + 1])[-1])
    while still[rest + 1 : rest + 3].any():  # beyond the window, which ends before a hole
        rest += 1 if still[rest + 1] else 2
    if rest + 1 == len(time):
        return 0, False
    near = slice(rest, int(np.searchsorted(time, time[rest] + 2 * width)))
    return rest + 1, bool(whole[near].all() and swing[near].max(initial=0.0) < GROWN * swing.max())


def _highest(values: Array, last: Index) -> Array:
    """Return the maximum of ``values`` from each index i to ``last[i]``, from maxima over 1, 2, 4, ... values."""
    begin = np.arange(len(last))
    count = last - begin + 1
    found, maximum, span = np.empty(len(last)), values, 1
    while span <= count.max():
        here = (span <= count) & (count < 2 * span)
        found[here] = np.maximum(maximum[begin[here]], maximum[last[here] - span + 1])
        if span > count.max() // 2:
            break
        maximum, span = np.maximum(maximum[:-span], maximum[span:]), 2 * span
    return found
