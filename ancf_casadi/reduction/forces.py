"""Constants and forces of the reduced beam in motion, as CasADi expressions.

The coordinates are e = u + P r with the displacement u of the base, a constant matrix P and the parts r of the shape,
which are functions of the modal coordinates q and of the rotation phi of the base.  Mass, gravity and drag of the full
model are projected once,

    P^T M P = R^T R,    P^T M 1,    1^T M 1             inertia and gravity, M of one component.

The drag acts at Gauss points along the whole beam.  With their masses as weights, sums over these points integrate
polynomials exactly over the mass of the elements.

The virtual work of all forces in Eq. (6) gives one equation per mode,

    (dr/dq)^T (P^T M P r_tt - P^T M 1 (g - u_tt) + P^T Q_damp) + dU/dq = 0.

The resultant of the forces on all nodes, 1^T (M e_tt - M 1 g + Q_damp), is the force of the base on the clamp.  The
two components of this resultant follow the m modal forces wherever a force has m + 2 components: these belong to the
coordinates (q, u).

A motion may have N instants side by side.  Then q and v are (m, N), a component of r is (k, N), and so on.

Springs and dashpots join points of the beam to the base, which keeps the places of these points as it turns.  Their
forces have no resultant.

A damping law combines the forces of ``ReducedMotion`` as it combines those of the full model (``damping.Forces``); they
are the forces of the motion itself, whatever their arguments, but for the velocity of the base, which a flow changes.
The strain-rate force is that of the beam and of the springs.  The tangent stiffness also includes the tension that
balances gravity, the acceleration of the base and the springs, but not the tension due to the inertia of the beam
itself.  The modal (generic) law, R B diag(d) B^T R^T e_t of Eq. (32), turns by the rotation phi of the base.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.law import refuse_branches
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Dashpot, PointMass, Spring
from ancf_casadi.mechanics.element import SMOOTHING_SPEED
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import gauss, point_force
from ancf_casadi.support.arrays import Array

Expression = Any  # SX or MX

BASE_SIZE = 9  # displacement (x, y) and rotation of the clamp, their velocities and their accelerations


@dataclass(frozen=True, eq=False)
class BaseJoints:
    """Points of the beam that springs or dashpots connect to the base."""

    shape: Array  # from the parts to the positions of the points, (d, k)
    places: Array  # of the points without load, which the base keeps as it turns, (d, 2), m
    coefficients: Array  # along x and y, (d, 2), N/m or N s/m


@dataclass(frozen=True, eq=False)
class Projection:
    """Constants of any reduced equation of motion, for coordinates e = u + P r with parts r (k,) of each component."""

    shape: Array  # P, for one component of the coordinates, (size/2, k)
    mass_factor: Array  # R with R^T R = P^T M P, upper triangular, (k, k) or with fewer rows
    mass_moment: Array  # P^T M 1, (k,)
    total_mass: float  # 1^T M 1, kg
    lumped_shape: Array  # from the parts to the coordinates of point masses and rotary inertias, (l, k)
    lumped_mass: Array  # of these coordinates, which have no drag, (l,), kg or kg m^2
    lumped_moved: Array  # 1 for a position, which the base displaces, and 0 for a slope, (l,)
    springs: BaseJoints
    dashpots: BaseJoints
    drag_shape: Array  # from the parts to the positions of the drag points, (d, k)
    drag_mass: Array  # at each of these points, (d,), kg


@dataclass(frozen=True, eq=False)
class ReducedMotion(ABC):
    """A motion of a reduced beam, its forces without damping, and those that a damping law combines."""

    projection: Projection
    q: Expression  # modal coordinates, (m,)
    v: Expression  # their velocities, (m,)
    base: Expression  # motion of the base, (9,)
    gravity: Expression  # acceleration, (2,), m/s^2

    @property
    @abstractmethod
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r, each (k,)."""

    @property
    @abstractmethod
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r_t, each (k,)."""

    @abstractmethod
    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r_tt at q_tt = a, each (k,)."""

    @abstractmethod
    def modal_force(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces (dr/dq)^T (x, y) of forces (x, y) on the parts, (m,)."""

    @property
    @abstractmethod
    def mass(self) -> Expression:
        """Mass matrix M(q) of the modal coordinates, (m, m)."""

    @property
    @abstractmethod
    def elastic_force(self) -> Expression:
        """Elastic force, without that of the springs, (m,)."""

    @property
    @abstractmethod
    def strain_energy(self) -> Expression:
        """Strain energy, without that of the springs, J."""

    @property
    @abstractmethod
    def strain_rate(self) -> Expression:
        """The force of Q_v, without that of the springs, (m,)."""

    @abstractmethod
    def tangent_rate(self, x: Expression, y: Expression) -> Expression:
        """Return the force of K e_t, without that of the springs, under the forces (x, y) on the parts, (m,)."""

    @property
    def relative_gravity(self) -> Expression:
        """Acceleration of gravity in the frame of the accelerated clamp, g - u_tt, (2,)."""
        acceleration = self.base[6:8, :]
        return cs.repmat(self.gravity, 1, acceleration.size2()) - acceleration

    def nodal(self, x: Expression, y: Expression, base: Expression) -> Expression:
        """Return u + P (x, y) at all nodes, (size, N): e from the parts and u, or e_t or e_tt from their rates."""
        shape = cs.DM(self.projection.shape)
        position = cs.repmat(cs.DM([1.0, 0.0]), shape.size1() // 2, 1)
        rows = (cs.vec(shape @ component + position @ base[k, :]).T for k, component in enumerate((x, y)))
        return cs.reshape(cs.vertcat(*rows), 2 * shape.size1(), base.size2())

    def inertia(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of P^T M P (x, y), where (x, y) is a rate or acceleration of the parts, (m,)."""
        mass = cs.DM(self.projection.mass_factor.T @ self.projection.mass_factor)
        return self.modal_force(mass @ x, mass @ y)

    def undamped_forces(self, a: Expression) -> Expression:
        """Return the left side of the equation of motion at q_tt = a, without the damping force, (m + 2,)."""
        (x_tt, y_tt), gravity = self.part_accelerations(a), self.relative_gravity
        moment, mass = cs.DM(self.projection.mass_moment), self.projection.total_mass
        inertia = self.inertia(x_tt, y_tt) - self.modal_force(moment @ gravity[0, :], moment @ gravity[1, :])
        modal = inertia + self.elastic_force
        modal += self._joint_force(self.projection.springs, *self._elongations(self.projection.springs))
        return cs.vertcat(modal, moment.T @ x_tt - mass * gravity[0, :], moment.T @ y_tt - mass * gravity[1, :])

    def load_force(self, load: Expression, position: Array, slope: Array) -> Expression:
        """Return the force of a load (force x and y, N, and moment, N m) at a point, (m + 2,).

        ``position`` and ``slope`` are the rows of the point, for one component of the coordinates.
        """
        x, y = self.parts
        to_position, to_slope = (cs.DM(row @ self.projection.shape) for row in (position, slope))
        F, h = point_force(cs.vertcat(to_slope.T @ x, to_slope.T @ y), load, follower=False)
        modal = self.modal_force(*(to_position @ F[k, :] + to_slope @ h[k, :] for k in range(2)))
        return cs.vertcat(modal, load[:2, :])

    def damping(self, law: DampingLaw, parameters: Expression, model: Model) -> Expression:
        """Return the force of a damping law of the full model, (m + 2,)."""
        refuse_branches(law)
        properties = cs.SX(cs.DM(model.properties))
        position, velocity = cs.vertcat(self.q, self.base[:2, :]), cs.vertcat(self.v, self.base[3:5, :])
        local = law.local_force(self, position, velocity, properties, parameters)
        dashpots = self.projection.dashpots
        dashpot_force = _internal_force(self._joint_force(dashpots, *self._elongation_rates(dashpots)))
        return local + self._low_rank_damping(law, parameters, model) + dashpot_force

    @property
    def energies(self) -> tuple[Expression, Expression, Expression]:
        """Kinetic energy, strain energy and potential of gravity, J."""
        projection, u, u_t = self.projection, self.base[:2], self.base[3:5]
        shape_coordinates, velocity = cs.horzcat(*self.parts), cs.horzcat(*self.part_rates)
        moment, mass = cs.DM(projection.mass_moment), projection.total_mass
        relative_energy = cs.sumsqr(mass_factor(projection) @ velocity) / 2
        elongations = cs.horzcat(*self._elongations(projection.springs))
        spring_energy = cs.dot(cs.DM(projection.springs.coefficients) * elongations, elongations) / 2
        return (
            relative_energy + mass / 2 * cs.sumsqr(u_t) + cs.dot(u_t, velocity.T @ moment),
            self.strain_energy + spring_energy,
            -cs.dot(self.gravity, shape_coordinates.T @ moment + mass * u),
        )

    @property
    def unit_velocities(self) -> Array:
        """Rates of (q, u) at a unit velocity along x and along y, (m + 2, 2)."""
        return np.eye(self.q.shape[0] + 2)[:, -2:]

    def inertia_force(self, v: Expression, properties: Expression) -> Expression:
        """Return the force of M e_t."""
        x, y = self.part_rates
        moment, mass = cs.DM(self.projection.mass_moment), self.projection.total_mass
        x_t, y_t = v[-2, :], v[-1, :]
        modal = self.inertia(x, y) + self.modal_force(moment @ x_t, moment @ y_t)
        return cs.vertcat(modal, moment.T @ x + mass * x_t, moment.T @ y + mass * y_t)

    def line_inertia_force(self, v: Expression, properties: Expression) -> Expression:
        """Return the force of int S^T mu r_t dp, which excludes point masses and rotary inertias."""
        projection = self.projection
        shape, displaced = projection.lumped_shape, projection.lumped_moved
        x, y = self._velocities(shape, displaced, v)
        mass = repeat_columns(projection.lumped_mass, x)
        return self.inertia_force(v, properties) - self._point_forces(shape, mass * x, mass * y, displaced)

    def strain_rate_force(self, q: Expression, v: Expression, properties: Expression) -> Expression:
        """Return the force of Q_v in bending, K_b q_t, and in the springs."""
        return _internal_force(self.strain_rate + self._spring_rate)

    def tangent_force(self, q: Expression, v: Expression, properties: Expression) -> Expression:
        """Return the force of K e_t, under the tension due to gravity, the acceleration of the base and the springs."""
        gravity, springs = self.relative_gravity, self.projection.springs
        moment, spring_force = cs.DM(self.projection.mass_moment), self._on_parts(springs, *self._elongations(springs))
        rate = self.tangent_rate(moment @ gravity[0, :] - spring_force[0], moment @ gravity[1, :] - spring_force[1])
        return _internal_force(rate + self._spring_rate)

    def reference_force(self, v: Expression, properties: Expression) -> Expression:
        """Refuse K e_t with K of the straight beam, which the reduced model does not have."""
        raise InputError(
            "the reduced model has no force of the reference stiffness, which resists rigid rotations; "
            "use stiffness='strain-rate'",
            "damping",
        )

    def drag_force(self, v: Expression, properties: Expression) -> Expression:
        """Return the force of int S^T mu |v| v dp."""
        return self._surface_force(v, lambda square: cs.sqrt(square + SMOOTHING_SPEED**2))

    def friction_force(self, v: Expression, properties: Expression, smoothing_speed: float) -> Expression:
        """Return the force of int S^T mu v/(|v|^2 + v0^2)^(1/2) dp with the smoothing speed v0."""
        return self._surface_force(v, lambda square: 1 / cs.sqrt(square + smoothing_speed**2))

    def _low_rank_damping(self, law: DampingLaw, parameters: Expression, model: Model) -> Expression:
        """Return the force of R B diag(d) B^T R^T e_t, where R rotates by phi, (m + 2,)."""
        symbols = cs.MX.sym("parameters", parameters.numel())
        d = cs.Function("d", [symbols], [law.modal_coefficients(symbols)])(parameters)
        B, angle = law.projection(model), self.base[2, :]
        slopes = [cs.DM(self.projection.shape.T @ B[component::2]) for component in (0, 1)]
        clamp = [cs.DM(B[component::4].sum(axis=0)) for component in (0, 1)]
        slope_velocity = rotate_vectors(-angle, *self.part_rates)
        clamp_velocity = rotate_vectors(-angle, self.base[3, :], self.base[4, :])
        x, y = (slopes[c].T @ slope_velocity[c] + clamp[c] @ clamp_velocity[c] for c in (0, 1))
        force = cs.repmat(d, 1, x.size2()) * (x + y)
        modal = self.modal_force(*rotate_vectors(angle, slopes[0] @ force, slopes[1] @ force))
        return cs.vertcat(modal, *rotate_vectors(angle, clamp[0].T @ force, clamp[1].T @ force))

    def _surface_force(self, v: Expression, factor: Callable[[Expression], Expression]) -> Expression:
        """Return the force of int S^T mu f(|v|^2) v dp."""
        projection = self.projection
        displaced = np.ones(len(projection.drag_mass))
        x, y = self._velocities(projection.drag_shape, displaced, v)
        weight = repeat_columns(projection.drag_mass, x) * factor(x**2 + y**2)
        return self._point_forces(projection.drag_shape, weight * x, weight * y, displaced)

    def _velocities(self, shape: Array, displaced: Array, v: Expression) -> tuple[Expression, Expression]:
        """Return the rates (d,) of the coordinates ``shape`` (d, k) times r, plus u_t of v for those ``displaced``."""
        x, y = (cs.DM(shape) @ component for component in self.part_rates)
        return x + cs.DM(displaced) @ v[-2, :], y + cs.DM(displaced) @ v[-1, :]

    def _point_forces(self, shape: Array, x: Expression, y: Expression, displaced: Array) -> Expression:
        """Return the generalized force of forces (x, y) on the coordinates ``shape`` (d, k) times r."""
        modal = self.modal_force(cs.DM(shape.T) @ x, cs.DM(shape.T) @ y)
        return cs.vertcat(modal, cs.DM(displaced).T @ x, cs.DM(displaced).T @ y)

    def _elongations(self, joints: BaseJoints) -> tuple[Expression, Expression]:
        """Return the displacements of points from their places on the base, (d,)."""
        x, y = (cs.DM(joints.shape) @ component for component in self.parts)
        place_x, place_y = rotate_vectors(
            self.base[2, :], *(repeat_columns(component, x) for component in joints.places.T)
        )
        return x - place_x, y - place_y

    def _elongation_rates(self, joints: BaseJoints) -> tuple[Expression, Expression]:
        """Return the rates of these displacements, (d,)."""
        x, y = (cs.DM(joints.shape) @ component for component in self.part_rates)
        angular_velocity = repeat_rows(self.base[5, :], x)
        place_x, place_y = rotate_vectors(
            self.base[2, :], *(repeat_columns(component, x) for component in joints.places.T)
        )
        return x + angular_velocity * place_y, y - angular_velocity * place_x

    def _on_parts(self, joints: BaseJoints, x: Expression, y: Expression) -> tuple[Expression, Expression]:
        """Return the forces on the parts, (k,), of springs or dashpots for such displacements or rates."""
        transfer, (along_x, along_y) = cs.DM(joints.shape.T), joints.coefficients.T
        return transfer @ (repeat_columns(along_x, x) * x), transfer @ (repeat_columns(along_y, y) * y)

    def _joint_force(self, joints: BaseJoints, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of springs or dashpots for such displacements or rates, (m,)."""
        return self.modal_force(*self._on_parts(joints, x, y))

    @property
    def _spring_rate(self) -> Expression:
        """The force of the springs in proportion to the rates of their lengths, (m,)."""
        springs = self.projection.springs
        return self._joint_force(springs, *self._elongation_rates(springs))


def mass_factor(projection: Projection) -> cs.DM:
    """Return R as a sparse matrix."""
    return cs.sparsify(cs.DM(projection.mass_factor))


def rotate_vectors(angle: Expression, x: Expression, y: Expression) -> tuple[Expression, Expression]:
    """Return the components of vectors rotated by the angle of each instant."""
    cosine, sine = repeat_rows(cs.cos(angle), x), repeat_rows(cs.sin(angle), x)
    return cosine * x - sine * y, sine * x + cosine * y


def repeat_rows(row: Expression, pattern: Expression) -> Expression:
    """Return a row repeated for each row of another expression."""
    return cs.repmat(row, pattern.size1(), 1)


def repeat_columns(column: Array, pattern: Expression) -> cs.DM:
    """Return a column repeated for each column of an expression."""
    return cs.repmat(cs.DM(column), 1, pattern.size2())


def _internal_force(modal: Expression) -> Expression:
    """Append the zero resultant of an internal force to its modal forces, (m + 2,)."""
    return cs.vertcat(modal, type(modal).zeros(2, modal.size2()))


def projected_constants(model: Model, shape: Array, drag_points: int) -> dict[str, Any]:
    """Return the fields of ``Projection`` but the factor of the mass, for a given P (size/2, k)."""
    mass, lumped = component_mass(model), _lumped_rows(model)
    moment = mass @ np.tile([1.0, 0.0], len(mass) // 2)
    points, weights = gauss(drag_points)
    return {
        "shape": shape,
        "mass_moment": shape.T @ moment,
        "total_mass": float(moment[::2].sum()),
        "lumped_shape": shape[[row for row, _ in lumped]],
        "lumped_mass": np.array([value for _, value in lumped]),
        "lumped_moved": np.array([1.0 - row % 2 for row, _ in lumped]),
        "springs": _base_joints(model, shape, Spring, "stiffness"),
        "dashpots": _base_joints(model, shape, Dashpot, "coefficient"),
        "drag_shape": np.array([model.interpolation(float(s))[0, ::2] for s in points * model.beam.length]) @ shape,
        "drag_mass": _point_masses(model, points, weights),
    }


def component_mass(model: Model) -> Array:
    """Return M of one component of the coordinates, (size/2, size/2)."""
    return np.asarray(model.mass(model.properties).full()[::2, ::2])


def _lumped_rows(model: Model) -> list[tuple[int, float]]:
    """Return the rows, in one component of the coordinates, of point masses and rotary inertias, with their values."""
    masses = [mass for mass in model.beam.attachments if isinstance(mass, PointMass)]
    values = [(model.nodes_of(mass.point)[2 * k] // 2, value) for mass in masses
              for k, value in enumerate((mass.mass, mass.rotary_inertia)) if value]  # fmt: skip
    return [(int(row), value) for row, value in values]


def _base_joints(model: Model, shape: Array, kind: type[Spring | Dashpot], attribute: str) -> BaseJoints:
    """Return the points that attachments of a kind join to the base."""
    attachments = [attachment for attachment in model.beam.attachments if isinstance(attachment, kind)]
    nodes = np.array([model.nodes_of(attachment.point)[:2] for attachment in attachments], dtype=int).reshape(-1, 2)
    values = np.array([getattr(attachment, attribute) for attachment in attachments]).reshape(-1, 2)
    return BaseJoints(shape[nodes[:, 0] // 2], model.straight[nodes], values)


def _point_masses(model: Model, points: Array, weights: Array) -> Array:
    """Return masses at points of [0, 1] that integrate polynomials over the mass of the elements, (d,), kg."""
    beam, degree = model.beam, len(points) - 1
    element_points, element_weights = gauss(degree // 2 + 1)
    mass_points = (beam.node_points[:-1, None] + beam.element_lengths[:, None] * element_points) / beam.length
    masses = (beam.mass_per_length * beam.element_lengths)[:, None] * element_weights
    legendre = np.polynomial.legendre.legvander
    moments = masses.ravel() @ legendre(2 * mass_points.ravel() - 1, degree)
    return np.asarray(weights * (legendre(2 * points - 1, degree) @ (moments * (2 * np.arange(degree + 1) + 1))))
