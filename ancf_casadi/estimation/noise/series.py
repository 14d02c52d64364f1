"""Series of residuals on even grids of times, and their autocorrelation.

Samples that are missing leave zeros in an even grid.  Samples between the times of the grid are assigned to the nearest
one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.support.arrays import Array, ComplexArray, Index

SPARSE_GRID = 16  # length of the grid over the number of samples, beyond which the samples are counted instead
MOST_CONCENTRATION = 3.0  # concentration beyond which residuals are not noise; 1 for white noise


def series_grids(series: Sequence[int], times: Array | None) -> list[tuple[slice, Index]]:
    """Return the rows of each series that is not empty, and the positions of its samples in an even grid."""
    bounds = [slice(*ends) for ends in pairwise(np.cumsum([0, *series]).tolist()) if ends[0] < ends[1]]
    return [(rows, grid_slots(rows.stop - rows.start, None if times is None else times[rows])) for rows in bounds]


def grid_slots(count: int, times: Array | None) -> Index:
    """Return the positions of samples in an even grid of times, the spacing of which is the median one."""
    if times is None or count < 2:
        return np.arange(count)
    step = float(np.median(np.diff(times)))
    length = (times[-1] - times[0]) / step if step > 0.0 else math.inf
    return np.rint((times - times[0]) / step).astype(int) if length < SPARSE_GRID * count else np.arange(count)


def transform(columns: Array, slots: Index, length: int) -> ComplexArray:
    """Return the Fourier transform of columns (m, n) whose rows have slots in a grid; the other rows are zero."""
    grid = np.zeros((int(slots[-1]) + 1, columns.shape[1]))
    np.add.at(grid, slots, columns)
    return np.asarray(np.fft.rfft(grid, length, axis=0))


def even_transform(half: Array, length: int) -> Array:
    """Return the Fourier transform of an even function of the period ``length`` from its values at 0, 1, 2, ..."""
    return np.asarray(scipy.fft.dct(np.pad(half, (0, length // 2 + 1 - len(half))), type=1))


def autocorrelation(residuals: Array, series: Sequence[int] = (), times: Array | None = None) -> Array:
    """Return the autocorrelation rho_0 = 1, rho_1, ... of residuals, one series if none is given; nan if all are zero.

    With the residuals r of several series, rho_k = sum r_i r_(i+k) / sum r_i^2, both sums over all series, and products
    within a series only.
    """
    grids = series_grids(tuple(series) or (len(residuals),), times)
    products = np.zeros(1 + max(int(slots[-1]) for _, slots in grids))
    for rows, slots in grids:
        size = int(slots[-1]) + 1
        power = np.abs(transform(residuals[rows, None], slots, 2 * size)[:, 0]) ** 2
        products[:size] += np.fft.irfft(power, 2 * size)[:size]
    return products / products[0] if products[0] > 0.0 else np.full(len(products), math.nan)


def concentration(residuals: Array, series: Sequence[int] = (), times: Array | None = None) -> float:
    """Return (1 + 2 sum_k rho_k^2)/2, the mean square of the power spectrum over that of white noise; nan for zeros.

    It is about 1 for white noise, (1 + rho^2)/(1 - rho^2) for an autoregressive process of order 1, and of the order of
    the number of samples for a sine.
    """
    return float(np.sum(autocorrelation(residuals, series, times) ** 2)) - 0.5
