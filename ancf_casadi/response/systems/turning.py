"""Corrections of the motion of a beam in coordinates that turn with it.

The axial stiffness of a thin beam is thousands of times its bending stiffness, and its direction turns with the beam.
The coordinates here are relative to the displacement of the clamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.mechanics.shape import gauss
from ancf_casadi.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Turning:
    """Corrections of the free coordinates that turn the slopes of a beam; a sum would stretch it.

    The coordinates are equivalent to pairs G q + g: the slopes r' at the two Gauss points of each element and, with an
    elastic clamp, slope and position of the first node.  A correction turns each slope by the angle (r' x dr')/|r'|^2
    and multiplies its length by exp(r' . dr'/|r'|^2).

    Parameters
    ----------
    matrix, constant : array (4 n, 4 n), (4 n,)
        G and g.
    slopes : int
        Number of slopes among the pairs; they come first.
    """

    matrix: Array
    constant: Array
    slopes: int

    @staticmethod
    def of(model: Model) -> Turning:
        """Return the corrections of a beam."""
        l, n = model.beam.element_length, model.beam.elements
        points = ((np.arange(n)[:, None] + gauss(2)[0]) * l).ravel()
        rows = [model.slope_interpolation(float(s)) for s in points]
        first = np.eye(model.size)[NODE : 2 * NODE]
        rows += [first[2:], first[:2]] if model.root else []
        pairs = np.vstack(rows)
        constant = pairs[:, :NODE] @ np.array([0.0, 0.0, *model.beam.axis])
        return Turning(pairs[:, NODE:], constant, 2 * n + model.root)

    def moved(self, q: Array, change: Array) -> Array:
        """Return coordinates (4 n, N) after corrections (4 n, N)."""
        pairs = self._pairs(q)
        turn = (self.matrix @ change).reshape(pairs.shape)
        x, y = pairs[: self.slopes].transpose(1, 0, 2)
        u, v = turn[: self.slopes].transpose(1, 0, 2)
        square = x**2 + y**2
        # logarithm of the factor by which a correction stretches a slope at most
        angle, growth = (x * v - y * u) / square, np.exp(np.minimum((x * u + y * v) / square, 5.0))
        cosine, sine = growth * np.cos(angle), growth * np.sin(angle)
        moved = pairs + turn
        moved[: self.slopes] = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        return np.asarray(self._inverse @ (moved.reshape(q.shape) - self.constant[:, None]))

    def forth(self, reference: Array, q: Array, change: Array) -> Array:
        """Return corrections, with each slope turned by its angle from the reference to q."""
        return np.asarray(self._inverse @ self._turned(reference, q, self.matrix @ change, 1.0))

    def back(self, reference: Array, q: Array, residual: Array) -> Array:
        """Return residuals: the transposed of ``forth``."""
        return np.asarray(self.matrix.T @ self._turned(reference, q, self._inverse.T @ residual, -1.0))

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.matrix))

    def _pairs(self, q: Array) -> Array:
        """Return the slopes, and the position behind an elastic clamp, (k, 2, N)."""
        return np.asarray((self.matrix @ q + self.constant[:, None]).reshape(-1, 2, q.shape[1]))

    def _turned(self, reference: Array, q: Array, pairs: Array, sign: float) -> Array:
        """Return vectors (2 k, N), those of the slopes turned by the angles from the reference to q, or back."""
        x, y = self._pairs(reference)[: self.slopes].transpose(1, 0, 2)
        u, v = self._pairs(q)[: self.slopes].transpose(1, 0, 2)
        cosine, sine = x * u + y * v, sign * (x * v - y * u)
        size = np.hypot(cosine, sine)
        turned = pairs.reshape(-1, 2, q.shape[1]).copy()
        a, b = turned[: self.slopes].transpose(1, 0, 2)
        both = np.stack([cosine * a - sine * b, sine * a + cosine * b], axis=1) / size[:, None]
        turned[: self.slopes] = both
        return turned.reshape(pairs.shape)
