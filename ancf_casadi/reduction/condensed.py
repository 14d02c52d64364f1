"""Motion of a condensed beam, whose coordinates are polynomials of the modal coordinates.

In the frame of the base, both components of e - u are linear in the products z = (1, q_i, q_i q_j)
(``condensation``).  The parts r of the shape are (z, 0) along x and (0, z) along y, turned by the rotation phi of the
base.  Forces y on the products have the modal forces (dz/dq)^T y.

The strain-rate force is W_s z_t.  The tangent stiffness includes the tension that balances the forces on the parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ancf_casadi.reduction.condensation import CondensedProjection
from ancf_casadi.reduction.forces import Expression, ReducedMotion, mass_factor, rotated, rows_of


@dataclass(frozen=True, eq=False)
class CondensedMotion(ReducedMotion):
    """A motion of a condensed beam."""

    projection: CondensedProjection

    @cached_property
    def products(self) -> Expression:
        """The products z, (1 + m + p,)."""
        return cs.vertcat(cs.DM.ones(1, self.q.size2()), self.q, self._first(self.q) * self._second(self.q))

    @cached_property
    def product_rates(self) -> Expression:
        """z_t, (1 + m + p,)."""
        return cs.vertcat(cs.DM.zeros(1, self.q.size2()), self.v, self._mixed(self.q, self.v))

    @property
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r, each (k,)."""
        z = self.products
        return self._turned(z, 0 * z, 0 * z, z)

    @property
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r_t, each (k,)."""
        z, z_t = self.products, self.product_rates
        turning = rows_of(self.base[5, :], z)
        return self._turned(z_t, -turning * z, turning * z, z_t)

    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r_tt at q_tt = a, each (k,)."""
        z, z_t, turning = self.products, self.product_rates, rows_of(self.base[5, :], self.products)
        squares = 2 * self._first(self.v) * self._second(self.v)
        z_tt = cs.vertcat(cs.DM.zeros(1, self.q.size2()), a, self._mixed(self.q, a) + squares)
        along = z_tt - turning**2 * z
        across = 2 * turning * z_t + rows_of(self.base[8, :], z) * z
        return self._turned(along, -across, across, along)

    def modal_force(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of forces (x, y) on the parts, (m,)."""
        return self._pulled(self._on_products(x, y), self.q, linear=True)

    @property
    def mass(self) -> Expression:
        """Mass matrix M(q) of the modal coordinates, (m, m), from R times the derivatives of the parts."""
        m, first, second = self.q.numel(), cs.DM(self.projection.first), cs.DM(self.projection.second)
        by_q = first * cs.repmat(second @ self.q, 1, m) + second * cs.repmat(first @ self.q, 1, m)
        change = cs.vertcat(cs.DM.zeros(1, m), cs.DM.eye(m), by_q)
        by_x, by_y = (own @ change for own in cs.horzsplit(mass_factor(self.projection), change.size1()))
        return by_x.T @ by_x + by_y.T @ by_y

    @property
    def elastic_force(self) -> Expression:
        """(dz/dq)^T W z, (m,)."""
        return self._pulled(cs.DM(self.projection.energy) @ self.products, self.q, linear=True)

    @property
    def strain_energy(self) -> Expression:
        """Strain energy, without that of the springs, J."""
        return cs.dot(self.products, cs.DM(self.projection.energy) @ self.products) / 2

    @property
    def strain_rate(self) -> Expression:
        """(dz/dq)^T W_s z_t, (m,)."""
        return self._pulled(cs.DM(self.projection.dissipation) @ self.product_rates, self.q, linear=True)

    def tangent_rate(self, x: Expression, y: Expression) -> Expression:
        """Return the rate of the elastic force less that of dz/dq under the forces (x, y) on the parts, (m,)."""
        W, z, z_t = cs.DM(self.projection.energy), self.products, self.product_rates
        changed = self._pulled(W @ z - self._on_products(x, y), self.v, linear=False)
        return self._pulled(W @ z_t, self.q, linear=True) + changed

    def _first(self, q: Expression) -> Expression:
        """Return q_i of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.first)) @ q

    def _second(self, q: Expression) -> Expression:
        """Return q_j of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.second)) @ q

    def _mixed(self, q: Expression, v: Expression) -> Expression:
        """Return q_i v_j + v_i q_j of each product."""
        return self._first(q) * self._second(v) + self._first(v) * self._second(q)

    def _pulled(self, y: Expression, q: Expression, *, linear: bool) -> Expression:
        """Return (dz/dq)^T y, or its part that is linear in q alone."""
        m, first, second = q.size1(), self.projection.first, self.projection.second
        on_pairs = y[1 + m :, :]
        by_pairs = cs.sparsify(cs.DM(first.T)) @ (self._second(q) * on_pairs)
        by_pairs += cs.sparsify(cs.DM(second.T)) @ (self._first(q) * on_pairs)
        return y[1 : 1 + m, :] + by_pairs if linear else by_pairs

    def _turned(
        self, x: Expression, x_of_y: Expression, y_of_x: Expression, y: Expression
    ) -> tuple[Expression, Expression]:
        """Return components (x, x_of_y) and (y_of_x, y) in the frame of the base, turned by phi."""
        return rotated(self.base[2, :], cs.vertcat(x, x_of_y), cs.vertcat(y_of_x, y))

    def _on_products(self, x: Expression, y: Expression) -> Expression:
        """Return the forces on the products of forces (x, y) on the parts."""
        back_x, back_y = rotated(-self.base[2, :], x, y)
        count = back_x.size1() // 2
        return back_x[:count, :] + back_y[count:, :]
