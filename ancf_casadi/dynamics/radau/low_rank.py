"""The part of low rank in the matrices of Newton's method, by Woodbury's identity.

A part B diag(d) B^T of the damping adds s V diag(d) V^T to a matrix A, so that the solution becomes

    x = y - W T V^T y,    y = A^-1 r,    W = A^-1 V,    T = s diag(d) (1 + V^T W s diag(d))^-1.

The real and the complex system are solved side by side, with three real columns (``elimination``).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs

from ancf_casadi.support.arrays import Layout


@dataclass(frozen=True)
class LowRank:
    """The part of rank m in matrices of k unknowns."""

    unknowns: int
    rank: int

    @property
    def layout(self) -> Layout:
        """Layout of the factors: V, then W and T of the real system and of the complex one, as real numbers."""
        m = self.rank
        return Layout.of(v=self.unknowns * m, w=3 * self.unknowns * m, real=m**2, pair=4 * m**2)

    def factors(self, v: cs.MX, solutions: list[cs.MX], coefficients: cs.MX, rates: cs.MX) -> cs.MX:
        """Return the factors from V (k, m), the solutions (k, 3) for its columns, d (m,), and s of both systems.

        ``rates`` are s of the real system, and its real and imaginary part of the complex one.
        """
        real, *pair = (cs.horzcat(*columns) for columns in zip(*map(cs.horzsplit, solutions), strict=True))
        gamma, a, b = cs.vertsplit(rates)
        inner = self._inner([v.T @ real], [gamma * coefficients])
        inner_pair = self._inner([v.T @ x for x in pair], [a * coefficients, b * coefficients])
        parts: list[cs.MX] = [v, real, *pair, inner, inner_pair]
        return cs.vertcat(*(cs.vec(part) for part in parts))

    def correction(self, factors: cs.MX, y: cs.MX) -> cs.MX:
        """Return W T V^T y for the solutions y (k, 3)."""
        m = self.rank
        v, w, real, pair = cs.vertsplit(factors, self.layout.offsets)
        w0, w1, w2 = cs.horzsplit(cs.reshape(w, self.unknowns, 3 * m), m)
        u = cs.reshape(v, self.unknowns, m).T @ y
        t0 = cs.reshape(real, m, m) @ u[:, 0]
        t1, t2 = cs.vertsplit(cs.reshape(pair, 2 * m, 2 * m) @ cs.vec(u[:, 1:]), m)
        return cs.horzcat(w0 @ t0, w1 @ t1 - w2 @ t2, w2 @ t1 + w1 @ t2)

    @staticmethod
    def _inner(projected: list[cs.MX], coefficients: list[cs.MX]) -> cs.MX:
        """Return T, from V^T W and s d, real or real and imaginary parts."""
        d, w = (_as_real(parts) for parts in ([*map(cs.diag, coefficients)], projected))
        inner: cs.MX = cs.solve((cs.MX.eye(d.shape[0]) + w @ d).T, d.T, "qr").T
        return inner


def _as_real(parts: list[cs.MX]) -> cs.MX:
    """Return a matrix, or the real matrix that multiplies real above imaginary parts as a complex one does."""
    return parts[0] if len(parts) == 1 else cs.blockcat([[parts[0], -parts[1]], [parts[1], parts[0]]])
