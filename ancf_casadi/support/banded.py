"""Banded matrices: storage, LU factors, and low-rank updates.

A matrix A with w diagonals on either side of the main one is stored by diagonals: entry (i, j) is in row w + i - j and
column j of an array (2 w + 1, N).  LAPACK's LU factors need w more rows on top for pivoting: entry (i, j) is in row
2 w + i - j of an array (3 w + 1, N).

Woodbury's identity solves systems with A + U V^T with the factors of A,

    (A + U V^T)^-1 = A^-1 - X (1 + V^T X)^-1 V^T A^-1,    X = A^-1 U.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.linalg import lapack

from ancf_casadi.support.arrays import Array, Index

ROUTINES = {"d": (lapack.dgbtrf, lapack.dgbtrs), "D": (lapack.zgbtrf, lapack.zgbtrs)}  # factorise, solve


def sparse(banded: Array) -> scipy.sparse.dia_array:
    """Return a matrix stored by diagonals, (2 w + 1, N), as a sparse array."""
    width, size = len(banded) // 2, banded.shape[1]
    return scipy.sparse.dia_array((banded, np.arange(width, -width - 1, -1)), shape=(size, size))


def lapack_place(rows: Index, columns: Index, width: int) -> Index:
    """Return the indices of entries in LAPACK's storage, read column by column."""
    return np.asarray(2 * width + rows - columns + (3 * width + 1) * columns)


def lapack_storage(values: NDArray[Any], width: int) -> NDArray[Any]:
    """Return a view of values, given column by column, as an array in LAPACK's storage, (3 w + 1, N)."""
    return values.reshape(-1, 3 * width + 1).T


def factorise(banded: Array) -> BandedFactors:
    """Return the factors of a matrix stored by diagonals, (2 w + 1, N); a singular one raises ``LinAlgError``."""
    width, size = len(banded) // 2, banded.shape[1]
    storage = np.zeros((3 * width + 1, size), order="F")
    storage[width:] = banded
    factors = BandedFactors.of(storage, width)
    if not factors.band[2 * width].all():
        raise np.linalg.LinAlgError("singular matrix")
    return factors


@dataclass(frozen=True, eq=False)
class BandedFactors:
    """The factors of a matrix A + U V^T with banded A; they contain infinite values or NaN if A is singular."""

    band: NDArray[Any]  # triangular factors of A in LAPACK's storage
    pivots: NDArray[Any]  # row interchanges of these factors
    width: int  # number w of diagonals of A on either side of the main one
    rows: NDArray[Any]  # V^T, (m, N)
    correction: NDArray[Any]  # X (1 + V^T X)^-1, (N, m)

    @staticmethod
    def of(
        band: NDArray[Any], width: int, u: NDArray[Any] | None = None, v: NDArray[Any] | None = None
    ) -> BandedFactors:
        """Factorise A + U V^T; the storage of A, LAPACK's (3 w + 1, N), is overwritten."""
        factorise, substitute = ROUTINES[band.dtype.char]
        factors, pivots, _ = factorise(band, width, width, overwrite_ab=1)
        if u is None or v is None or not v.size:
            no_rows = np.empty((0, band.shape[1]))
            return BandedFactors(factors, pivots, width, no_rows, no_rows.T)
        x, rows = substitute(factors, width, width, u, pivots)[0], v.T.astype(band.dtype)
        correction = x @ np.linalg.inv(np.eye(len(rows)) + rows @ x)
        return BandedFactors(factors, pivots, width, rows, correction)

    @property
    def determinant(self) -> tuple[float, float]:
        """Sign of the determinant of A, and the logarithm of its size."""
        diagonal, swaps = self.band[2 * self.width], self.pivots != np.arange(self.band.shape[1])
        sign = np.prod(np.sign(diagonal)) * (-1.0) ** np.count_nonzero(swaps)
        return float(sign), float(np.log(np.abs(diagonal)).sum())

    def solve(self, right: NDArray[Any], *, overwrite: bool = False) -> NDArray[Any]:
        """Return the solutions for right-hand sides, a vector or columns."""
        solution = self._substitute(right, overwrite_b=overwrite)
        if self.rows.size:
            solution -= self.correction.dot(self.rows.dot(solution))
        return solution

    def solve_transpose(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return the solutions with the transposed matrix."""
        if self.rows.size:
            right = right - self.rows.T @ (self.correction.T @ right)
        return self._substitute(right, trans=1)

    def _substitute(self, right: NDArray[Any], **options: int) -> NDArray[Any]:
        """Return the solutions with the factors of A alone."""
        routine = ROUTINES[self.band.dtype.char][1]
        return np.asarray(routine(self.band, self.width, self.width, right, self.pivots, **options)[0])
