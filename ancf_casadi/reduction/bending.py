"""Motion of a beam that does not stretch, from the rotations of its slopes.

The parts r of the shape are the slopes r' at selected points (``projection``).  With n the slope turned by 90 degrees,

    dr' = n Theta dq,    r'_t = n theta_t,    r'_tt = n theta_tt - r' theta_t^2,    theta_t = phi_t + Theta q_t,

and the elastic force is f_0 + K_b q.  The strain-rate force is that of bending, K_b q_t.  The tangent stiffness also
includes the tension that balances the forces on the slopes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ancf_casadi.reduction.forces import Expression, ReducedMotion, columns_of, mass_factor, rows_of
from ancf_casadi.reduction.projection import SlopeProjection


@dataclass(frozen=True, eq=False)
class BendingMotion(ReducedMotion):
    """A motion of a beam that does not stretch."""

    projection: SlopeProjection

    @cached_property
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r', each (k,)."""
        slopes = self.projection.slopes
        turned = cs.DM(slopes.rotations) @ self.q
        angle = rows_of(self.base[2, :], turned) + columns_of(slopes.angles, turned) + turned
        lengths = columns_of(slopes.lengths, turned)
        return lengths * cs.cos(angle), lengths * cs.sin(angle)

    @cached_property
    def angular_velocity(self) -> Expression:
        """Angular velocity theta_t of the slopes, (k,), rad/s."""
        turning = cs.DM(self.projection.slopes.rotations) @ self.v
        return rows_of(self.base[5, :], turning) + turning

    @property
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r'_t, each (k,)."""
        x, y = self.parts
        return -y * self.angular_velocity, x * self.angular_velocity

    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r'_tt at q_tt = a, each (k,)."""
        (x, y), square = self.parts, self.angular_velocity**2
        turning = cs.DM(self.projection.slopes.rotations) @ a
        turning += rows_of(self.base[8, :], turning)
        return -y * turning - x * square, x * turning - y * square

    def modal_force(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of forces (x, y) on the slopes, (m,)."""
        slope_x, slope_y = self.parts
        return cs.DM(self.projection.slopes.rotations.T) @ (slope_x * y - slope_y * x)

    @property
    def mass(self) -> Expression:
        """Mass matrix M(q) of the modal coordinates, (m, m), from R times the derivatives of the slopes."""
        (x, y), m = self.parts, self.q.numel()
        rotations, factor = cs.DM(self.projection.slopes.rotations), mass_factor(self.projection)
        by_x, by_y = factor @ (cs.repmat(-y, 1, m) * rotations), factor @ (cs.repmat(x, 1, m) * rotations)
        return by_x.T @ by_x + by_y.T @ by_y

    @property
    def elastic_force(self) -> Expression:
        """f_0 + K_b q, (m,)."""
        return columns_of(self.projection.rest_force, self.q) + self._bending(self.q)

    @property
    def strain_energy(self) -> Expression:
        """Strain energy, without that of the springs, J."""
        force = cs.DM(self.projection.rest_force) + self._bending(self.q) / 2
        return self.projection.rest_energy + cs.dot(force, self.q)

    @property
    def strain_rate(self) -> Expression:
        """K_b q_t, (m,)."""
        return self._bending(self.v)

    def tangent_rate(self, x: Expression, y: Expression) -> Expression:
        """Return K_b q_t and the force of the tension that balances the forces (x, y) on the slopes, (m,)."""
        slope_x, slope_y = self.parts
        rotations = cs.DM(self.projection.slopes.rotations)
        return self._bending(self.v) + rotations.T @ (self.angular_velocity * (slope_x * x + slope_y * y))

    def _bending(self, q: Expression) -> Expression:
        return cs.DM(self.projection.bending_stiffness) @ q
