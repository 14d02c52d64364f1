"""Array types for annotations, the root mean square, and named blocks of a vector, which replace index arithmetic."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


def root_mean_square(values: Array) -> float:
    """Return the root mean square of the finite values; nan if there are none."""
    finite_values = values[np.isfinite(values)]
    return math.sqrt(float(np.mean(finite_values**2))) if finite_values.size else math.nan


def maxima(values: Array) -> Index:
    """Return the indices of the local maxima of values (m,), without the ends; scipy.signal takes long to import."""
    rises = np.diff(values) > 0.0
    return np.flatnonzero(rises[:-1] & ~rises[1:]) + 1


def extremes(time: Array, values: Array, columns: int) -> tuple[Array, Array, Array]:
    """Return the begin of each column of a diagram over time, and the smallest and the largest value in it."""
    edges = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], columns, endpoint=False)))
    return time[edges], np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


@dataclass(frozen=True)
class Layout:
    """The consecutive blocks of a vector."""

    sizes: tuple[tuple[str, int], ...]  # name and size of each block

    @staticmethod
    def of(**sizes: int) -> Layout:
        """Return the layout of blocks in order: ``Layout.of(q=8, v=8)``."""
        return Layout(tuple(sizes.items()))

    @cached_property
    def offsets(self) -> list[int]:
        """The first index of each block, and the size of the vector."""
        return [0, *accumulate(size for _, size in self.sizes)]

    @property
    def size(self) -> int:
        """Size of the vector."""
        return self.offsets[-1]

    def __getitem__(self, name: str) -> slice:
        """Return the indices of a block."""
        return self._slices[name]

    @cached_property
    def _slices(self) -> dict[str, slice]:
        return {name: slice(*ends) for (name, _), ends in zip(self.sizes, pairwise(self.offsets), strict=True)}

    def split(self, vector: Array) -> list[Array]:
        """Return the blocks of a vector, or of the rows of an array, as views."""
        return np.split(vector, self.offsets[1:-1])

    def join(self, columns: int, **blocks: Array) -> Array:
        """Return an array (size, columns) of blocks (size of the block, columns), zero for missing blocks."""
        result = np.zeros((self.size, columns))
        for name, block in blocks.items():
            result[self[name]] = block
        return result
