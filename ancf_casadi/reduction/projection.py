"""The forces of the full beam, projected on the motions of the reduced one.

With e = u + P r' (``slopes``) the virtual displacements are de = P n Theta dq, where n is r' turned by a quarter, and

    e_t = u_t + P n theta_t,    e_tt = u_tt + P (n theta_tt - r' theta_t^2),    theta_t = phi_t + Theta q_t.

Virtual work, all terms from the full model at its properties, leaves as many equations as modes,

    Theta^T n . (P^T M P (n theta_tt - r' theta_t^2) - P^T M 1 (g - u_tt) + P^T Q_damp) + f_0 + K_b q = 0.

The elastic force is that of bending alone, linear in q because the curvature theta' is,

    f_0 = (P n Theta)^T Q_e at rest,    K_b = W^T K W,

with the tangent stiffness K of the straight beam, and W the displacements across it whose slopes are Theta.

A damping law meets ``Projected`` in the place of the model, and its forces come out projected.  Of the strain rate
there is that of bending, K_b q_t.  The ``tangent`` stiffness also has that of the tension, which is taken to balance
gravity and the acceleration of the base but not that of the beam's own motion.  The drag is integrated at Gauss points
of the whole beam, with weights that integrate the mass.  Generic damping turns by the rotation phi of the clamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, Forces
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.element import STILL
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.shape import gauss
from ancf_casadi.reduction.kinematics import Slopes
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes

BASE = 9  # displacement (x, y) and rotation of the clamp, their first and their second rates


@dataclass(frozen=True, eq=False)
class Projection:
    """The numbers of the full model that the equations of the reduced one need.

    Parameters
    ----------
    slopes : Slopes
        The slopes that make the shape.
    mass_factor : array (k, k)
        R with R^T R = P^T M P, upper triangular, of either component.
    mass_moment : array (k,)
        P^T M 1.
    total_mass : float
        1^T M 1, kg.
    tip_mass : float
        The part of it at the tip, which the air does not damp, kg.
    bending_stiffness : array (m, m)
        K_b.
    rest_force : array (m,)
        f_0.
    rest_energy : float
        Strain energy at rest, J.
    drag_shape, drag_mass : array (d, k), (d,)
        From slopes to the positions of the points where the drag acts, and the mass each stands for, kg.
    """

    slopes: Slopes
    mass_factor: Array
    mass_moment: Array
    total_mass: float
    tip_mass: float
    bending_stiffness: Array
    rest_force: Array
    rest_energy: float
    drag_shape: Array
    drag_mass: Array


def projection_of(modes: Modes, whole: Slopes, few: Slopes, drag_points: int) -> Projection:
    """Project mass and stiffness of the full model.

    Parameters
    ----------
    modes : Modes
        The modes kept.
    whole, few : Slopes
        The slopes at all points, and at those selected.
    drag_points : int
        Gauss points of the drag.
    """
    model, rest = modes.model, modes.equilibrium.coordinates
    p, beam = model.properties, model.beam
    mass = model.mass(p).full()[::2, ::2]
    moment = mass @ np.tile([1.0, 0.0], len(mass) // 2)
    across = np.kron(whole.shape @ whole.rotations, [[-beam.axis[1]], [beam.axis[0]]])
    first = np.kron(whole.shape, np.eye(2)) @ whole.first_order.reshape(-1, modes.count)
    places, weights = gauss(drag_points)
    return Projection(
        slopes=few,
        mass_factor=np.linalg.cholesky(few.shape.T @ mass @ few.shape).T,
        mass_moment=few.shape.T @ moment,
        total_mass=float(moment[::2].sum()),
        tip_mass=beam.tip_mass,
        bending_stiffness=across.T @ (model.tangent_stiffness(model.straight, p).sparse() @ across),
        rest_force=first.T @ model.elastic_force(rest, p).full().ravel(),
        rest_energy=float(model.strain_energy(rest, p)),
        drag_shape=np.array([model.interpolation(float(s))[0, ::2] for s in places * beam.length]) @ few.shape,
        drag_mass=_mass_weights(model, places, weights),
    )


@dataclass(frozen=True, eq=False)
class Projected:
    """A reduced beam in motion: its terms as CasADi expressions, and what a damping law asks of a model.

    Parameters
    ----------
    projection : Projection
        The numbers.
    q, v : MX
        Modal coordinates and their rates, (m,).
    base : MX
        Motion of the clamp, (9,).
    gravity : MX
        Acceleration of gravity, (2,), m/s^2.
    """

    projection: Projection
    q: cs.MX
    v: cs.MX
    base: cs.MX
    gravity: cs.MX

    @property
    def size(self) -> int:
        """Number of modal coordinates m."""
        return int(self.projection.slopes.rotations.shape[1])

    @property
    def slope(self) -> tuple[cs.MX, cs.MX]:
        """Components of r', each (k,)."""
        slopes = self.projection.slopes
        angle = self.base[2] + cs.DM(slopes.angles) + cs.DM(slopes.rotations) @ self.q
        return cs.DM(slopes.stretches) * cs.cos(angle), cs.DM(slopes.stretches) * cs.sin(angle)

    @property
    def turning(self) -> cs.MX:
        """theta_t, (k,), rad/s."""
        return self.base[5] + cs.DM(self.projection.slopes.rotations) @ self.v

    @property
    def slope_rate(self) -> tuple[cs.MX, cs.MX]:
        """Components of r'_t, each (k,)."""
        x, y = self.slope
        return -y * self.turning, x * self.turning

    @property
    def pull(self) -> cs.MX:
        """Acceleration of gravity as a beam feels it whose base accelerates, (2,)."""
        return self.gravity - self.base[6:8]

    def on_modes(self, x: cs.MX, y: cs.MX) -> cs.MX:
        """Return the modal forces of forces on the slopes, (m,)."""
        slope = self.slope
        return cs.DM(self.projection.slopes.rotations.T) @ (slope[0] * y - slope[1] * x)

    def inertia(self, x: cs.MX, y: cs.MX) -> cs.MX:
        """Return the modal forces of P^T M P times second or other rates of the slopes, (m,)."""
        factor = _upper(self.projection)
        return sum((side.T @ (factor @ part) for side, part in zip(self._sides(), (x, y), strict=True)), cs.MX(0))

    @property
    def mass(self) -> cs.MX:
        """Mass matrix of the modal coordinates, (m, m)."""
        x, y = self._sides()
        return x.T @ x + y.T @ y

    def driving(self) -> cs.MX:
        """Return the forces on the left of the equation of motion without the damping at q_tt = 0, (m,)."""
        x, y = self.slope
        square, turn = self.turning**2, self.base[8]
        weight = cs.DM(self.projection.mass_moment)
        inertia = self.inertia(-y * turn - x * square, x * turn - y * square)
        gravity = self.on_modes(weight * self.pull[0], weight * self.pull[1])
        return inertia - gravity + cs.DM(self.projection.rest_force) + self.bending(self.q)

    def bending(self, q: cs.MX) -> cs.MX:
        """Return K_b times modal coordinates or their rates, (m,)."""
        return cs.DM(self.projection.bending_stiffness) @ q

    def damping(self, law: DampingLaw, parameters: cs.MX, modes: Modes) -> cs.MX:
        """Return the modal damping force of a law of the full model, (m,)."""
        model = modes.model
        local = law.local_force(cast(Forces, self), self.q, self.v, cs.MX(cs.DM(model.properties)), parameters)
        shape, B = self.projection.slopes.shape, law.projection(model)
        both = [cs.DM(shape.T @ B[component::2]) for component in (0, 1)]
        whole = [cs.DM(B[component::4].sum(axis=0)) for component in (0, 1)]
        back = _rotated(-self.base[2], *self.slope_rate), _rotated(-self.base[2], self.base[3], self.base[4])
        rates = [part.T @ slope + total * speed for part, total, slope, speed in zip(both, whole, *back, strict=True)]
        force = law.modal_coefficients(parameters) * sum(rates, cs.MX.zeros(B.shape[1]))
        return local + self.on_modes(*_rotated(self.base[2], both[0] @ force, both[1] @ force))

    def inertia_force(self, rates: cs.MX, properties: cs.MX) -> cs.MX:
        """Return the modal force of M e_t, of the motion itself."""
        weight = cs.DM(self.projection.mass_moment)
        return self.inertia(*self.slope_rate) + self.on_modes(weight * self.base[3], weight * self.base[4])

    def line_inertia_force(self, rates: cs.MX, properties: cs.MX) -> cs.MX:
        """Return the modal force of int S^T mu r_t dp, of the motion itself: without the tip mass."""
        shape = cs.DM(self.projection.slopes.shape[-2])
        rate = [self.base[3 + k] + cs.dot(shape, part) for k, part in enumerate(self.slope_rate)]
        tip = self.on_modes(*(self.projection.tip_mass * shape * part for part in rate))
        return self.inertia_force(rates, properties) - tip

    def strain_rate_force(self, q: cs.MX, v: cs.MX, properties: cs.MX) -> cs.MX:
        """Return the modal force of Q_v, bending alone."""
        return self.bending(v)

    def tangent_force(self, q: cs.MX, v: cs.MX, properties: cs.MX) -> cs.MX:
        """Return the modal force of K e_t, under the tension that gravity and the acceleration of the base make."""
        x, y = self.slope
        weight = cs.DM(self.projection.mass_moment)
        tension = self.turning * weight * (x * self.pull[0] + y * self.pull[1])
        return self.bending(v) + cs.DM(self.projection.slopes.rotations.T) @ tension

    def drag_force(self, rates: cs.MX, properties: cs.MX) -> cs.MX:
        """Return the modal force of int S^T mu |v| v dp, of the motion itself."""
        shape = cs.DM(self.projection.drag_shape)
        x, y = (self.base[3 + k] + shape @ rate for k, rate in enumerate(self.slope_rate))
        size = cs.DM(self.projection.drag_mass) * cs.sqrt(x**2 + y**2 + STILL**2)
        return self.on_modes(shape.T @ (size * x), shape.T @ (size * y))

    def __getattr__(self, name: str) -> Any:
        """Refuse what only the full model has."""
        if name.startswith("_"):
            raise AttributeError(name)
        raise InputError(
            "is a law that bending alone does not define, such as one with the reference stiffness, which is not "
            "objective; use stiffness='strain-rate'",
            "damping",
        )

    def _sides(self) -> tuple[cs.MX, cs.MX]:
        """R times the change of either component of the slopes with the modal coordinates, (k, m)."""
        x, y = self.slope
        rotations, factor = cs.DM(self.projection.slopes.rotations), _upper(self.projection)
        return factor @ (cs.repmat(-y, 1, self.size) * rotations), factor @ (cs.repmat(x, 1, self.size) * rotations)


def _rotated(angle: cs.MX, x: cs.MX, y: cs.MX) -> tuple[cs.MX, cs.MX]:
    """Return the components of vectors rotated by an angle."""
    cosine, sine = cs.cos(angle), cs.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


def _upper(projection: Projection) -> cs.DM:
    """R as a sparse matrix."""
    return cs.sparsify(cs.DM(projection.mass_factor))


def _mass_weights(model: Model, places: Array, weights: Array) -> Array:
    """Return the masses at points of [0, 1] that integrate polynomials over the mass of the elements, (d,), kg."""
    beam, degree = model.beam, len(places) - 1
    width, thickness, density, _ = model.properties
    own, inner = gauss(degree // 2 + 1)
    where = (np.arange(beam.elements)[:, None] + own) / beam.elements
    masses = (width * thickness * density * beam.element_length)[:, None] * inner
    legendre = np.polynomial.legendre.legvander
    moments = masses.ravel() @ legendre(2 * where.ravel() - 1, degree)
    return np.asarray(weights * (legendre(2 * places - 1, degree) @ (moments * (2 * np.arange(degree + 1) + 1))))
