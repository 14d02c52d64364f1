"""Array types for annotations, and the root mean square."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


def root_mean_square(values: Array) -> float:
    """Return the root mean square of values; those that are not finite do not count."""
    kept = values[np.isfinite(values)]
    return math.sqrt(float(np.mean(kept**2))) if kept.size else math.nan
