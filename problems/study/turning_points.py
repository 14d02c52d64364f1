"""Turning points of a vibration about zero."""

from __future__ import annotations

import numpy as np

from ancf_casadi.support.arrays import Array, Index


def turning_points(displacement: Array) -> Index:
    """Return the indices of the samples at which a vibration turns, on both sides of 0."""
    size = np.abs(displacement)
    steps = np.sign(np.diff(size))
    changes = np.flatnonzero(steps)  # a top may be level: several equal samples
    tops = np.flatnonzero((steps[changes][:-1] > 0) & (steps[changes][1:] < 0))
    return (changes[tops] + 1 + changes[tops + 1]) // 2
