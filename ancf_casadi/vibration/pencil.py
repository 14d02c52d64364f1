"""The matrix K - lambda M at an eigenvalue lambda, solvable although it is singular.

K - lambda M is singular in the direction of its mode shape phi alone.  Rows and columns are scaled to give K a unit
diagonal.  If the unknown is held at zero in the coordinate in which phi, scaled likewise, is largest, the system is
regular and keeps its band (Nelson).

References
----------
R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import BandedFactors, factorised
from ancf_casadi.vibration.assembly import BANDWIDTH


@dataclass(frozen=True, eq=False)
class Pencil:
    """Factors of the scaled K - lambda M with one coordinate held.

    Parameters
    ----------
    factors : BandedFactors
        The factors.
    scale : array (free,)
        Multipliers of the rows and columns, 1/K_ii^1/2.
    held : int
        Index of the coordinate that is held at zero.
    """

    factors: BandedFactors
    scale: Array
    held: int

    @classmethod
    def of(cls, pencil: Array, diagonal: Array, phi: Array) -> Pencil:
        """Factorise K - lambda M, stored by diagonals, with the diagonal of K and the mode shape of lambda."""
        scale = 1 / np.sqrt(diagonal)
        size, held = len(scale), int(np.abs(phi / scale).argmax())
        rows = np.arange(size) - np.arange(BANDWIDTH, -BANDWIDTH - 1, -1)[:, None]
        inside = (rows >= 0) & (rows < size)
        banded = np.where(inside, pencil * scale * scale[np.clip(rows, 0, size - 1)], 0.0)
        banded[rows == held] = 0.0
        banded[:, held] = 0.0
        banded[BANDWIDTH, held] = 1.0
        return cls(factorised(banded), scale, held)

    def solve(self, right: Array) -> Array:
        """Return the solutions, as columns, that are zero in the held coordinate."""
        right = np.multiply(self.scale[:, None], right, order="F")
        right[self.held] = 0.0
        return np.asarray(self.scale[:, None] * self.factors.solve(right))
