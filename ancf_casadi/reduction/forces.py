"""Forces of the reduced beam in motion, as CasADi expressions.

With e = u + P r' (``kinematics``), and n the slope r' turned by 90 degrees, the virtual displacements are
de = P n Theta dq, and velocity and acceleration are

    e_t = u_t + P n theta_t,    e_tt = u_tt + P (n theta_tt - r' theta_t^2),    theta_t = phi_t + Theta q_t.

The virtual work of all forces in Eq. (6) gives one equation per mode,

    Theta^T n . (P^T M P (n theta_tt - r' theta_t^2) - P^T M 1 (g - u_tt) + P^T Q_damp) + f_0 + K_b q = 0.

A damping law combines the forces of ``ProjectedForces`` as it combines those of the full model.  The strain-rate force
is that of bending alone, K_b q_t.  The tangent stiffness also includes the tension that balances gravity and the
acceleration of the clamp, but not the tension due to the motion of the beam itself.  The modal (generic) law,
R B diag(d) B^T R^T e_t of Eq. (32), turns by the rotation phi of the clamp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.element import STILL
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.projection import Projection

BASE_SIZE = 9  # displacement (x, y) and rotation of the clamp, their velocities and their accelerations


@dataclass(frozen=True, eq=False)
class ReducedMotion:
    """A motion of the reduced beam, and its forces without damping.

    Parameters
    ----------
    projection : Projection
        The constants of the reduced model.
    q, v : SX
        Modal coordinates and their velocities, (m,).
    base : SX
        Motion of the clamp, (9,).
    gravity : SX
        Acceleration of gravity, (2,), m/s^2.
    """

    projection: Projection
    q: cs.SX
    v: cs.SX
    base: cs.SX
    gravity: cs.SX

    @cached_property
    def slope(self) -> tuple[cs.SX, cs.SX]:
        """Components of r', each (k,)."""
        slopes = self.projection.slopes
        angle = self.base[2] + cs.DM(slopes.angles) + cs.DM(slopes.rotations) @ self.q
        return cs.DM(slopes.lengths) * cs.cos(angle), cs.DM(slopes.lengths) * cs.sin(angle)

    @cached_property
    def angular_velocity(self) -> cs.SX:
        """Angular velocity theta_t of the slopes, (k,), rad/s."""
        return self.base[5] + cs.DM(self.projection.slopes.rotations) @ self.v

    @cached_property
    def slope_velocity(self) -> tuple[cs.SX, cs.SX]:
        """Components of r'_t, each (k,)."""
        x, y = self.slope
        return -y * self.angular_velocity, x * self.angular_velocity

    @property
    def relative_gravity(self) -> cs.SX:
        """Acceleration of gravity in the frame of the accelerated clamp, g - u_tt, (2,)."""
        return self.gravity - self.base[6:8]

    def nodal(self, x: cs.SX, y: cs.SX, base: cs.SX) -> cs.SX:
        """Return u + P (x, y) at all nodes, (4 n + 4,): e from slopes and u, or e_t from their velocities."""
        shape = cs.DM(self.projection.slopes.shape)
        position = cs.repmat(cs.DM([1.0, 0.0]), shape.size1() // 2, 1)
        return cs.vec(cs.horzcat(shape @ x + position * base[0], shape @ y + position * base[1]).T)

    def modal_force(self, x: cs.SX, y: cs.SX) -> cs.SX:
        """Return the modal forces of forces (x, y) on the slopes, (m,)."""
        slope_x, slope_y = self.slope
        return cs.DM(self.projection.slopes.rotations.T) @ (slope_x * y - slope_y * x)

    def inertia(self, x: cs.SX, y: cs.SX) -> cs.SX:
        """Return the modal forces of P^T M P (x, y), where (x, y) is a velocity or acceleration of the slopes, (m,)."""
        factor, (side_x, side_y) = _mass_factor(self.projection), self._factored_jacobian
        return side_x.T @ (factor @ x) + side_y.T @ (factor @ y)

    @property
    def mass(self) -> cs.SX:
        """Mass matrix M(q) of the modal coordinates, (m, m)."""
        x, y = self._factored_jacobian
        return x.T @ x + y.T @ y

    @property
    def undamped_forces(self) -> cs.SX:
        """Left side of the equation of motion at q_tt = 0, without the damping force, (m,)."""
        x, y = self.slope
        square, angular_acceleration = self.angular_velocity**2, self.base[8]
        weight = cs.DM(self.projection.mass_moment)
        inertia = self.inertia(-y * angular_acceleration - x * square, x * angular_acceleration - y * square)
        gravity = self.modal_force(weight * self.relative_gravity[0], weight * self.relative_gravity[1])
        return inertia - gravity + cs.DM(self.projection.rest_force) + self.bending(self.q)

    def bending(self, q: cs.SX) -> cs.SX:
        """Return K_b times modal coordinates or their velocities, (m,)."""
        return cs.DM(self.projection.bending_stiffness) @ q

    def damping(self, law: DampingLaw, parameters: cs.SX, model: Model) -> cs.SX:
        """Return the modal force of a damping law of the full model, (m,).

        Raises
        ------
        InputError
            If the law needs a force that the reduced model does not have.
        """
        properties = cs.SX(cs.DM(model.properties))
        local = law.local_force(ProjectedForces(self), self.q, self.v, properties, parameters)
        return local + self._low_rank_damping(law, parameters, model)

    @property
    def energies(self) -> tuple[cs.SX, cs.SX, cs.SX]:
        """Kinetic energy, strain energy and potential of gravity, J."""
        projection, u, u_t = self.projection, self.base[:2], self.base[3:5]
        slope, velocity = cs.horzcat(*self.slope), cs.horzcat(*self.slope_velocity)
        moment, mass = cs.DM(projection.mass_moment), projection.total_mass
        relative = cs.sumsqr(_mass_factor(projection) @ velocity) / 2
        return (
            relative + mass / 2 * cs.sumsqr(u_t) + cs.dot(u_t, velocity.T @ moment),
            projection.rest_energy + cs.dot(cs.DM(projection.rest_force) + self.bending(self.q) / 2, self.q),
            -cs.dot(self.gravity, slope.T @ moment + mass * u),
        )

    @cached_property
    def _factored_jacobian(self) -> tuple[cs.SX, cs.SX]:
        """Return R times the derivative of each component of the slopes with respect to q, (k, m)."""
        x, y = self.slope
        rotations, factor = cs.DM(self.projection.slopes.rotations), _mass_factor(self.projection)
        m = self.q.numel()
        return factor @ (cs.repmat(-y, 1, m) * rotations), factor @ (cs.repmat(x, 1, m) * rotations)

    def _low_rank_damping(self, law: DampingLaw, parameters: cs.SX, model: Model) -> cs.SX:
        """Return the modal force of R B diag(d) B^T R^T e_t, where R rotates by phi."""
        symbols = cs.MX.sym("parameters", parameters.numel())
        d = cs.Function("d", [symbols], [law.modal_coefficients(symbols)])(parameters)
        B, angle = law.projection(model), self.base[2]
        slopes = [cs.DM(self.projection.slopes.shape.T @ B[component::2]) for component in (0, 1)]
        clamp = [cs.DM(B[component::4].sum(axis=0)) for component in (0, 1)]
        slope_velocity = _rotated(-angle, *self.slope_velocity)
        clamp_velocity = _rotated(-angle, self.base[3], self.base[4])
        modal_velocity = cs.SX.zeros(B.shape[1])
        for component in (0, 1):
            modal_velocity += slopes[component].T @ slope_velocity[component]
            modal_velocity += clamp[component] * clamp_velocity[component]
        force = d * modal_velocity
        return self.modal_force(*_rotated(angle, slopes[0] @ force, slopes[1] @ force))


@dataclass(frozen=True, eq=False)
class ProjectedForces:
    """The forces that a damping law combines, projected on the modes; see ``damping.Forces``.

    The forces are those of ``motion``.  The arguments q and v are not used, because they lack the motion of the clamp.

    Parameters
    ----------
    motion : ReducedMotion
        The motion of the reduced beam.
    """

    motion: ReducedMotion

    def inertia_force(self, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Return the modal force of M e_t, (m,)."""
        motion = self.motion
        moment = cs.DM(motion.projection.mass_moment)
        clamp = motion.modal_force(moment * motion.base[3], moment * motion.base[4])
        return motion.inertia(*motion.slope_velocity) + clamp

    def line_inertia_force(self, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Return the modal force of int S^T mu r_t dp, which excludes the mass at the tip, (m,)."""
        motion = self.motion
        shape = cs.DM(motion.projection.slopes.shape[-2])
        x, y = (motion.base[3 + k] + cs.dot(shape, part) for k, part in enumerate(motion.slope_velocity))
        weight = motion.projection.tip_mass * shape
        return self.inertia_force(v, properties) - motion.modal_force(weight * x, weight * y)

    def strain_rate_force(self, q: cs.SX, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Return the modal force of Q_v in bending, K_b q_t, (m,)."""
        return self.motion.bending(self.motion.v)

    def tangent_force(self, q: cs.SX, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Return the modal force of K e_t, under the tension due to gravity and the acceleration of the clamp, (m,)."""
        motion = self.motion
        (x, y), gravity = motion.slope, motion.relative_gravity
        tension = cs.DM(motion.projection.mass_moment) * (x * gravity[0] + y * gravity[1])
        rotations = cs.DM(motion.projection.slopes.rotations)
        return motion.bending(motion.v) + rotations.T @ (motion.angular_velocity * tension)

    def reference_force(self, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Refuse K e_t with K of the straight beam, which the reduced model does not have."""
        raise InputError(
            "the reduced model has no force of the reference stiffness, which resists rigid rotations; "
            "use stiffness='strain-rate'",
            "damping",
        )

    def drag_force(self, v: cs.SX, properties: cs.SX) -> cs.SX:
        """Return the modal force of int S^T mu |v| v dp, (m,)."""
        return self._surface_force(lambda square: cs.sqrt(square + STILL**2))

    def friction_force(self, v: cs.SX, properties: cs.SX, smoothing_speed: float) -> cs.SX:
        """Return the modal force of int S^T mu v/(|v|^2 + v0^2)^(1/2) dp with the smoothing speed v0, (m,)."""
        return self._surface_force(lambda square: 1 / cs.sqrt(square + smoothing_speed**2))

    def _surface_force(self, factor: Callable[[cs.SX], cs.SX]) -> cs.SX:
        """Return the modal force of int S^T mu f(|v|^2) v dp, (m,)."""
        motion, projection = self.motion, self.motion.projection
        shape = cs.DM(projection.drag_shape)
        x, y = (motion.base[3 + k] + shape @ part for k, part in enumerate(motion.slope_velocity))
        weight = cs.DM(projection.drag_mass) * factor(x**2 + y**2)
        return motion.modal_force(shape.T @ (weight * x), shape.T @ (weight * y))


def _mass_factor(projection: Projection) -> cs.DM:
    """Return R as a sparse matrix."""
    return cs.sparsify(cs.DM(projection.mass_factor))


def _rotated(angle: cs.SX, x: cs.SX, y: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Return the components of vectors rotated by an angle."""
    cosine, sine = cs.cos(angle), cs.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
