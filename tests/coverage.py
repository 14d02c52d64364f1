"""Exact limits of the number of intervals that hold the truth."""

from scipy.stats import binom


def covers(hits: int, runs: int, level: float = 0.95) -> bool:
    """Return whether a number of hits is within the limits that right intervals of a level keep in 99.8 % of tests.

    For 60, 128 and 200 intervals of 95 %, the lower limits are 51, 113 and 179 hits.  Intervals two thirds as wide fall
    below them in 74, 98 and 99.9 % of tests.
    """
    low, high = binom.ppf([0.001, 0.999], runs, level)
    return bool(low <= hits <= high)
