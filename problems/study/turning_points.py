"""Turning points of a vibration about zero."""

from __future__ import annotations

import numpy as np

from ancf_casadi.support.arrays import Array, Index


def turning_points(displacement: Array) -> Index:
    """Return the indices of the samples at which a vibration turns, on both sides of 0."""
    from scipy.signal import find_peaks  # slow to import

    return np.asarray(find_peaks(np.abs(displacement))[0])
