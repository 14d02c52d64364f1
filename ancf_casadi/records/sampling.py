"""Sampling of a record: rate, missing samples and jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array


@dataclass(frozen=True)
class Sampling:
    """Sampling of a record.

    Parameters
    ----------
    samples : int
        Number of samples.
    begin, end : float
        First and last time, s.
    rate : float
        Samples per second between gaps; nan for fewer than two samples.
    gaps : int
        Number of gaps: steps of more than 1.5 times the median.
    missing : int
        Number of samples that would fill the gaps.
    longest_gap, longest_gap_at : float
        Length of the longest gap, and its begin, s; nan without a gap.
    jitter : float
        Standard deviation of the steps without the gaps, relative to the median.
    """

    samples: int
    begin: float
    end: float
    rate: float
    gaps: int
    missing: int
    longest_gap: float
    longest_gap_at: float
    jitter: float


def sampling(time: Array) -> Sampling:
    """Return the sampling of increasing times (s)."""
    if len(time) < 2:
        edges = (float(time[0]), float(time[-1])) if len(time) else (math.nan, math.nan)
        return Sampling(len(time), *edges, math.nan, 0, 0, math.nan, math.nan, math.nan)
    steps = np.diff(time)
    step = float(np.median(steps))
    long = steps > 1.5 * step  # a longer step is a gap
    regular = steps[~long]
    longest = int(np.argmax(steps))
    missing = np.rint(steps[long] / step) - 1
    return Sampling(
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
