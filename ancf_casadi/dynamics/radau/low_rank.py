"""The part of low rank in the matrices of Newton's method, by Woodbury's identity.

A part B diag(d) B^T of the damping adds s V diag(d) V^T to a matrix A, so that the solution becomes

    x = y - W T V^T y,    y = A^-1 r,    W = A^-1 V,    T = s diag(d) (1 + V^T W s diag(d))^-1.

The real and the complex system are solved side by side: the 3 m numbers V^T y are those of the real one, and the real
and the imaginary parts of those of the complex one (``elimination``).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.radau.link import VALUES
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array, Layout

# from a solution for a column of V, (real, real part, imaginary part): that of the real system alone, and those of the
# complex system for the real and for the imaginary unit
SEPARATE = (
    np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
)


@dataclass(frozen=True)
class LowRank:
    """The part of rank m in the matrices of a number of links."""

    links: int
    rank: int

    @property
    def layout(self) -> Layout:
        """Layout of the factors: V, and W and T of both systems, as real numbers."""
        m = self.rank
        return Layout.of(v=NODE * self.links * m, w=VALUES * self.links * 3 * m, t=(3 * m) ** 2)

    def factors(self, v: cs.MX, solutions: cs.MX, coefficients: cs.MX, rates: cs.MX) -> cs.MX:
        """Return the factors from V (4 links, m), the solutions for its columns (12, m links), d (m,), and s.

        ``rates`` are s of the real system, and its real and imaginary part in the complex one.
        """
        gamma, a, b = (rate * coefficients for rate in cs.vertsplit(rates))
        projected = [v.T @ cs.reshape(part, *v.shape) for part in cs.vertsplit(solutions, NODE)]
        t = cs.diagcat(_inner(projected[:1], [gamma]), _inner(projected[1:], [a, b]))
        w = [cs.reshape(_of_parts(separate) @ solutions, VALUES * self.links, self.rank) for separate in SEPARATE]
        parts: list[cs.MX] = [v, *w, cs.densify(t)]
        return cs.vertcat(*(cs.vec(part) for part in parts))

    def correction(self, factors: cs.MX, y: cs.MX) -> cs.MX:
        """Return W T V^T y (12, links) for solutions y (12, links)."""
        m = self.rank
        v, w, t = cs.vertsplit(factors, self.layout.offsets)
        columns = cs.horzcat(*(cs.vec(part) for part in cs.vertsplit(y, NODE)))
        projected = cs.vec(cs.reshape(v, -1, m).T @ columns)
        return cs.reshape(cs.reshape(w, -1, 3 * m) @ (cs.reshape(t, 3 * m, 3 * m) @ projected), *y.shape)


def _inner(projected: list[cs.MX], coefficients: list[cs.MX]) -> cs.MX:
    """Return T, from V^T W and s d, real or real and imaginary parts."""
    d, w = _as_real([cs.diag(part) for part in coefficients]), _as_real(projected)
    inner: cs.MX = cs.solve((cs.MX.eye(d.shape[0]) + w @ d).T, d.T, "qr").T
    return inner


def _as_real(parts: list[cs.MX]) -> cs.MX:
    """Return a matrix, or the real matrix that multiplies real above imaginary parts as a complex one does."""
    return parts[0] if len(parts) == 1 else cs.blockcat([[parts[0], -parts[1]], [parts[1], parts[0]]])


def _of_parts(matrix: Array) -> cs.DM:
    """Return the matrix that combines the parts of the numbers of a node."""
    return cs.sparsify(cs.DM(np.kron(matrix, np.eye(NODE))))
