"""A beam that does not stretch, and bends in a few modes as far as it likes.

One clamp or pin holds the beam at its beginning; for others see ``condensed``.

The slope r' = lambda (cos theta, sin theta) keeps the length lambda it has at rest.  Its angle to the x axis is

    theta(s, t) = phi(t) + theta_0(s) + sum_k Theta_k(s) q_k(t),

with the rotation phi of the base, the angle theta_0 at rest, and the rotation Theta_k of the slope in mode k of the
full beam.  Integration along the beam gives the positions.  The beam therefore keeps its length exactly, at any
amplitude, and needs no separate function for the shortening of its projection.

Mesh.  The slopes at the 2 n + 1 nodes and midpoints are integrated by Simpson's rule, which is exact for the cubic
elements.  The nodal coordinates are e = u + P r' with a constant matrix P and the displacement u of the clamp.  The
state at rest and, to first order in q, the modes of the full beam are exact.

Selected points.  The slopes at a few points determine all others (discrete empirical interpolation).  Random bent
shapes give snapshots of r'.  The snapshots lie close to the space of their leading left singular vectors U.  QR with
pivoting selects as many points as there are vectors, and r' = U (U_selected)^-1 r'_selected holds at all points.  The
state at rest and the first-order motion are snapshots of large weight, so the interpolation error affects large motion
only.

Constants.  Beside those of any reduced beam (``forces``),

    K_b = int E I Theta'^T Theta' ds + sum_j k_j Theta(s_j)^T Theta(s_j),    f_0 = (dr'/dq)^T P^T Q_e    bending,

with the slopes Theta of the modes as rotations of a straight beam, k of the torsional springs between beam and base at
the points s_j, and the elastic force Q_e at rest, without that of the springs.  The elastic force f_0 + K_b q is linear
in q because the curvature theta' is.

Motion.  The parts r of the shape are the slopes r' at the selected points.  With n the slope turned by 90 degrees,

    dr' = n Theta dq,    r'_t = n theta_t,    r'_tt = n theta_tt - r' theta_t^2,    theta_t = phi_t + Theta q_t.

The strain-rate force is that of bending, K_b q_t.  The tangent stiffness also includes the tension that balances the
forces on the slopes.

References
----------
Drmac and Gugercin 2016, "A new selection operator for the discrete empirical interpolation method - improved a priori
error bound and extensions" (the selection by QR).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import RotationalSpring, Spring
from ancf_casadi.mechanics.mesh_limits import bend_advice, largest_bend
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.reduction.forces import (
    Expression,
    Projection,
    ReducedMotion,
    component_mass,
    mass_factor,
    projected_constants,
    repeat_columns,
    repeat_rows,
)
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.modes import Modes


@dataclass(frozen=True, eq=False)
class Slopes:
    """Nodal slopes at points of the beam, and the shape that they determine."""

    angles: Array  # theta_0 of the slope at rest, (k,), rad
    lengths: Array  # lambda of the slope, which is constant, (k,)
    rotations: Array  # Theta of the slope per unit modal coordinate, (k, m), rad/(m kg^1/2)
    shape: Array  # P, for one component of the coordinates, (2 n + 2, k), or (2 n + 4, k) with a node of the base
    rows: Index  # places among the nodes and midpoints, (k,); a node of the base comes first

    @property
    def at_rest(self) -> Array:
        """The slopes at rest, (k, 2)."""
        return np.asarray(self.lengths * np.array([np.cos(self.angles), np.sin(self.angles)])).T

    @property
    def jacobian(self) -> Array:
        """Jacobian of the slopes with respect to the modal coordinates, at rest, (k, 2, m)."""
        x, y = self.at_rest.T
        return np.stack([-y[:, None] * self.rotations, x[:, None] * self.rotations], axis=1)


def is_held_at_begin_only(model: Model) -> bool:
    """Return whether one clamp or pin holds the beam at its beginning, and no other support."""
    return [(support.point, support.sliding) for support in model.beam.supports] == [(0.0, None)]


def nodal_slopes(modes: Modes) -> Slopes:
    """Return the slopes at all nodes and midpoints of the mesh."""
    model, beam = modes.model, modes.model.beam
    points = np.interp(np.arange(2 * beam.elements + 1) / 2, np.arange(beam.elements + 1), beam.node_points)
    interpolation = np.array([model.slope_interpolation(s) for s in points.tolist()])
    slopes_at_rest, modal_slopes = interpolation @ modes.equilibrium.coordinates, interpolation @ modes.shapes
    (x, y), square = slopes_at_rest.T, (slopes_at_rest**2).sum(axis=1)
    rotations = (x[:, None] * modal_slopes[:, 1] - y[:, None] * modal_slopes[:, 0]) / square[:, None]
    strains = (x[:, None] * modal_slopes[:, 0] + y[:, None] * modal_slopes[:, 1]) / square[:, None]
    # axial strain per unit rotation; a mode with more is not a bending mode
    axial = np.abs(strains).max(axis=0) > 0.1 * np.abs(rotations).max(axis=0)
    if axial.any():
        advice = bend_advice(model, largest_bend(model, modes.equilibrium.coordinates)) or "keep fewer modes"
        raise InputError(
            f"mode {axial.argmax() + 1} stretches the beam, and the reduced model only bends; {advice}", "modes"
        )
    root = model.root  # 1 if the base has its own slope, which turns with phi alone
    angles = np.concatenate([[np.arctan2(*beam.axis[::-1])] * root, np.arctan2(y, x)])
    return Slopes(
        angles=np.unwrap(angles),
        lengths=np.concatenate([np.ones(root), np.sqrt(square)]),
        rotations=np.vstack([np.zeros((root, modes.count)), rotations]),
        shape=_simpson(model),
        rows=np.arange(root + len(points)),
    )


def select_points(slopes: Slopes, count: int, rows: Index | None = None) -> Slopes:
    """Return the slopes at the ``count`` points, or at given ones, that best determine all slopes; more than modes."""
    points, m = slopes.rotations.shape
    # rad, of the slope in a snapshot: root of the sum of squares over the modes
    max_coordinates = 0.8 / np.sqrt(m) / np.abs(slopes.rotations).max(axis=0)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (200, m)) * max_coordinates  # random bent shapes
    angles = slopes.angles + q @ slopes.rotations.T
    bent_slopes = np.vstack([slopes.lengths * np.cos(angles), slopes.lengths * np.sin(angles)])
    first_order = np.concatenate([slopes.at_rest[:, :, None], slopes.jacobian * max_coordinates], axis=2)
    # weight of the state at rest and of the first-order motion among the snapshots
    snapshots = np.column_stack([1e4 * first_order.reshape(points, -1), bent_slopes.T])
    basis = scipy.linalg.svd(snapshots, full_matrices=False)[0][:, :count]
    if rows is None:
        rows = np.sort(scipy.linalg.qr(basis.T, pivoting=True, mode="r")[1][:count])
    return Slopes(
        angles=slopes.angles[rows],
        lengths=slopes.lengths[rows],
        rotations=slopes.rotations[rows],
        shape=np.linalg.solve(basis[rows].T, (slopes.shape @ basis).T).T,
        rows=rows,
    )


def displaced_slopes(slopes: Slopes, model: Model) -> Slopes:
    """Return slopes of a beam with the displacement of its support as one more, which the base alone turns."""
    x, y = model.beam.supports[0].displacement
    if not (x or y):
        return slopes
    displaced_nodes = np.zeros((len(slopes.shape), 1))
    displaced_nodes[2 * model.root :: 2] = 1.0
    return replace(
        slopes,
        angles=np.append(slopes.angles, math.atan2(y, x)),
        lengths=np.append(slopes.lengths, math.hypot(x, y)),
        rotations=np.vstack([slopes.rotations, np.zeros(slopes.rotations.shape[1])]),
        shape=np.hstack([slopes.shape, displaced_nodes]),
    )


def _simpson(model: Model) -> Array:
    """Return P, from the slopes at nodes and midpoints (and of a node of the base) to the nodal coordinates."""
    elements = model.beam.elements
    shape = np.zeros((2 * elements + 2, 2 * elements + 1))
    positions, slopes = shape[::2], shape[1::2]  # of the nodes
    slopes[:, ::2] = np.eye(elements + 1)
    for i, l in enumerate(model.beam.element_lengths.tolist()):
        positions[i + 1] = positions[i]
        positions[i + 1, 2 * i : 2 * i + 3] += l / 6 * np.array([1.0, 4.0, 1.0])
    return np.asarray(scipy.linalg.block_diag(*[np.array([[0.0], [1.0]])] * model.root, shape))


@dataclass(frozen=True, eq=False)
class SlopeProjection(Projection):
    """The constants of the equation of motion of a beam that does not stretch; the parts are slopes."""

    slopes: Slopes  # those that determine the shape
    bending_stiffness: Array  # K_b, (m, m)
    rest_force: Array  # f_0, (m,)
    rest_energy: float  # strain energy at rest, without that of the springs, J


def project_model(modes: Modes, nodal: Slopes, selected: Slopes, drag_points: int) -> SlopeProjection:
    """Project the full model on the modes, by the slopes at all nodes and midpoints and at the selected points."""
    model, coordinates = modes.model, modes.equilibrium.coordinates
    constants = projected_constants(model, selected.shape, drag_points)
    jacobian = np.kron(nodal.shape, np.eye(2)) @ nodal.jacobian.reshape(-1, modes.count)
    shape_mass = selected.shape.T @ component_mass(model) @ selected.shape
    rounding = 1e-14 * float(shape_mass.diagonal().max())  # of a mesh so coarse that it is singular
    springs, force = constants["springs"], model.elastic_force(coordinates, model.properties).full().ravel()
    at_rest = springs.shape @ selected.at_rest - springs.places
    rows = [model.nodes_of(spring.point)[:2] for spring in model.beam.attachments if isinstance(spring, Spring)]
    np.subtract.at(force, np.array(rows, dtype=int).reshape(-1, 2), springs.coefficients * at_rest)
    spring_energy = float((springs.coefficients * at_rest**2).sum()) / 2
    return SlopeProjection(
        **constants,
        mass_factor=np.asarray(np.linalg.cholesky(shape_mass + rounding * np.eye(len(shape_mass))).T),
        slopes=selected,
        bending_stiffness=_bending_stiffness(model, nodal),
        rest_force=jacobian.T @ force,
        rest_energy=float(model.strain_energy(coordinates, model.properties)) - spring_energy,
    )


def _bending_stiffness(model: Model, nodal: Slopes) -> Array:
    """Return K_b, the integral of E I Theta'^2, with the torsional springs between beam and base."""
    beam, slope_angles = model.beam, nodal.shape @ nodal.rotations
    curvature = np.array([model.curvature_interpolation(s)[0, ::2] for s in model.all_gauss_points]) @ slope_angles
    stiffness = np.kron(beam.bending_stiffness * beam.element_lengths, gauss(2)[1])
    springs: list[Any] = [spring for spring in beam.attachments if isinstance(spring, RotationalSpring)]
    springs += [clamp for clamp in beam.supports if isinstance(clamp, Clamp) and clamp.stiffness < math.inf]
    rotation = slope_angles[[model.nodes_of(spring.point)[2] // 2 for spring in springs]]
    spring_stiffness = np.array([spring.stiffness for spring in springs])
    return np.asarray((curvature.T * stiffness) @ curvature + (rotation.T * spring_stiffness) @ rotation)


@dataclass(frozen=True, eq=False)
class BendingMotion(ReducedMotion):
    """A motion of a beam that does not stretch."""

    projection: SlopeProjection

    @cached_property
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r', each (k,)."""
        slopes = self.projection.slopes
        rotation = cs.DM(slopes.rotations) @ self.q
        angle = repeat_rows(self.base[2, :], rotation) + repeat_columns(slopes.angles, rotation) + rotation
        lengths = repeat_columns(slopes.lengths, rotation)
        return lengths * cs.cos(angle), lengths * cs.sin(angle)

    @cached_property
    def angular_velocity(self) -> Expression:
        """Angular velocity theta_t of the slopes, (k,), rad/s."""
        rate = cs.DM(self.projection.slopes.rotations) @ self.v
        return repeat_rows(self.base[5, :], rate) + rate

    @property
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r'_t, each (k,)."""
        x, y = self.parts
        return -y * self.angular_velocity, x * self.angular_velocity

    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r'_tt at q_tt = a, each (k,)."""
        (x, y), square = self.parts, self.angular_velocity**2
        acceleration = cs.DM(self.projection.slopes.rotations) @ a
        acceleration += repeat_rows(self.base[8, :], acceleration)
        return -y * acceleration - x * square, x * acceleration - y * square

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
        return repeat_columns(self.projection.rest_force, self.q) + self._bending(self.q)

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
