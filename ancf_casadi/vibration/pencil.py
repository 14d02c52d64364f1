"""The matrix K - lambda M at an eigenvalue lambda, solvable although it is singular.

K - lambda M is singular along its mode shape phi alone.  With the largest component of the unknown held at zero the
system is regular and keeps its band (Nelson).  Rows and columns are scaled by the diagonal of K.

References
----------
R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import Factors, factorised
from ancf_casadi.vibration.assembly import BAND


@dataclass(frozen=True, eq=False)
class Pencil:
    """Factors of the scaled K - lambda M with one coordinate held.

    Parameters
    ----------
    factors : Factors
        The factors.
    scale : array (free,)
        Factors by which rows and columns were multiplied.
    held : int
        Number of the coordinate that is held.
    """

    factors: Factors
    scale: Array
    held: int

    @classmethod
    def of(cls, pencil: Array, diagonal: Array, phi: Array) -> Pencil:
        """Factorise K - lambda M, stored by diagonals, with the diagonal of K and the mode shape of lambda."""
        scale = 1 / np.sqrt(diagonal)
        size, held = len(scale), int(np.abs(phi / scale).argmax())
        rows = np.arange(size) - np.arange(BAND, -BAND - 1, -1)[:, None]
        inside = (rows >= 0) & (rows < size)
        banded = np.where(inside, pencil * scale * scale[np.clip(rows, 0, size - 1)], 0.0)
        banded[rows == held] = 0.0
        banded[:, held] = 0.0
        banded[BAND, held] = 1.0
        return cls(factorised(banded), scale, held)

    def solve(self, right: Array) -> Array:
        """Return the solutions, as columns, that are zero in the held coordinate."""
        right = np.multiply(self.scale[:, None], right, order="F")
        right[self.held] = 0.0
        return np.asarray(self.scale[:, None] * self.factors.solve(right))
