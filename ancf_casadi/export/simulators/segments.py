"""The beam as rigid segments with springs between them, and small motion of discretised beams.

A beam with its only support at the beginning becomes n segments of the length l = L/n.  Each has the mass, the centre
of mass and the moment of inertia of its stretch of the beam.  The joint at the beginning of segment j, at arc length
j l, turns by the difference of the angles of two segments and carries the bending moment

    k_j (theta_j - theta_(j-1) - phi_j),    1/k_j = int ds/(E I),    phi_j = int kappa_0 ds,

with the natural curvature kappa_0.  The integrals are over the stretch of the beam that the joint represents: half a
segment on each side, but 5/12 of a segment behind the clamp and 13/12 about the next joint.  These are Gregory's
weights, which integrate the moment of a deflected beam from its clamp with an error of third order, and not of
second.  An elastic clamp is one more spring in series at the first joint, a pin a joint without stiffness.  The last
half segment does not bend.

Rigid segments have the inertia of a rod, and not that of masses at the joints: in a wave, the errors of the springs and
of the inertia then cancel to leading order.

The coordinates q place the masses at r(q) and store the energy V(q).  About the equilibrium V'(q) = 0, small motion is

    M q_tt + D q_t + K q = 0,    M = J^T m J,    D = J^T c J + T^T (b k) T,    K = V'',    J = dr/dq,

with dampers c at the masses and dampers b k at the joints, whose turns are T q.  One step of an integrator of the
length h takes (q, v) to Z (q, v).  Its eigenvalues z are those of a motion exp(s t) with s = log(z)/h, which has the
frequency |s|/2 pi and the damping ratio -Re s/|s| that a user of the program sees, errors of the step included.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.supports import Clamp, Pin
from ancf_casadi.support.arrays import Array, Index

CLAMP_JOINT_SHARE = 5 / 12  # of a segment, represented by the joint at the clamp
MIN_POLE = 1e-6  # imaginary part of an oscillating pole, 1/s


@dataclass(frozen=True)
class SegmentedBeam:
    """Rigid segments from the base to the tip; arrays have one value per segment, or per joint at its beginning."""

    origin: tuple[float, float]  # of the first joint, m
    axis: float  # angle of the unloaded beam at the first joint, rad
    gravity: tuple[float, float]
    length: float  # of each segment, m
    masses: Array
    centres: Array  # distance of the centre of mass from the joint, m
    inertias: Array  # about the centre, kg m^2
    section_inertias: Array  # the part that the rotary inertia of the sections has in them, kg m^2
    widths: Array  # of boxes with the inertia of a segment about its three axes
    thicknesses: Array
    diameters: Array  # of round segments; 0 for boxes
    stiffness: Array  # of the joints, N m/rad
    natural_angles: Array  # of the joints without moment, rad
    point_masses: Sequence[tuple[int, float, PointMass]]  # with segment (from 0) and distance from its joint, m

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.masses)

    @property
    def unloaded_angles(self) -> Array:
        """Angles of the segments without load, rad."""
        return self.axis + np.cumsum(self.natural_angles)

    def small_motion(self) -> SmallMotion:
        """Return small motion about the equilibrium; the positions are x, y and angle of each mass."""
        theta = cs.SX.sym("theta", self.count)
        joint, positions, inertias = cs.SX(cs.DM(self.origin)), [], []
        for k in range(self.count):
            direction = cs.vertcat(cs.cos(theta[k]), cs.sin(theta[k]))
            segment_masses = [(self.masses[k], self.centres[k], self.inertias[k])]
            segment_masses += [
                (p.mass, distance, p.rotary_inertia) for segment, distance, p in self.point_masses if segment == k
            ]
            for mass, distance, inertia in segment_masses:
                positions += [joint + distance * direction, theta[k]]
                inertias += [mass, mass, inertia]
            joint = joint + self.length * direction
        turns = theta - cs.vertcat(self.axis, theta[:-1])
        bending = cs.sumsqr(cs.sqrt(cs.DM(self.stiffness)) * (turns - cs.DM(self.natural_angles))) / 2
        return linearise_at_equilibrium(
            theta, cs.vertcat(*positions), np.array(inertias), turns, bending, self.gravity, joint, self.unloaded_angles
        )


def divide_beam(beam: Beam, count: int) -> SegmentedBeam:
    """Divide a beam with its only support at the beginning into segments."""
    support = check_support(beam)
    length, ends = beam.length / count, np.linspace(0.0, beam.length, count + 1)
    cells = np.concatenate([[0.0, CLAMP_JOINT_SHARE], np.arange(1.5, count)]) * length
    nodes = beam.node_points
    compliance = _integrals(1 / beam.bending_stiffness, nodes, cells)
    if isinstance(support, Clamp) and math.isfinite(support.stiffness):
        compliance[0] += 1 / support.stiffness
    stiffness = 1 / compliance
    if isinstance(support, Pin):
        stiffness[0] = 0.0
    breakpoints = np.union1d(ends, nodes)
    pieces, middles = np.diff(breakpoints), (breakpoints[:-1] + breakpoints[1:]) / 2
    owners: Index = np.minimum((middles / length).astype(np.int64), count - 1)
    density = beam.mass_per_length
    elements = np.clip(np.searchsorted(nodes, middles) - 1, 0, beam.elements - 1)
    mass = density[elements] * pieces
    masses: Array = np.bincount(owners, mass).astype(np.float64)
    centres = np.bincount(owners, mass * middles) / masses
    thicknesses: Array = np.array(beam.thickness)
    of_sections = np.bincount(owners, beam.rotary_sections * mass * thicknesses[elements] ** 2 / 12).astype(np.float64)
    inertias: Array = np.bincount(owners, mass * (pieces**2 / 12 + (middles - centres[owners]) ** 2)).astype(np.float64)
    point_masses = []
    for attachment in beam.attachments:
        if not isinstance(attachment, PointMass):
            raise InputError(f"a {type(attachment).__name__} cannot be written; only point masses can", "attachments")
        segment = min(int(attachment.point / length), count - 1)
        point_masses.append((segment, attachment.point - segment * length, attachment))
    diameters = np.array([section.depth if section.shape.kind == "round" else 0.0 for section in beam.sections])
    is_round = diameters > 0.0
    all_round = _integrals(np.where(is_round, 0.0, 1.0), nodes, ends) == 0.0
    curvature = np.array(beam.natural_curvature or [0.0] * beam.elements)
    return SegmentedBeam(
        origin=support.displacement,
        axis=math.atan2(beam.axis[1], beam.axis[0]) + support.angle,
        gravity=beam.gravity,
        length=length,
        masses=masses,
        centres=centres - ends[:-1],
        inertias=inertias + of_sections,
        section_inertias=of_sections,
        widths=_integrals(np.where(is_round, thicknesses, beam.width), nodes, ends) / length,
        thicknesses=_integrals(thicknesses, nodes, ends) / length,
        diameters=all_round * _integrals(diameters, nodes, ends) / length,
        stiffness=stiffness,
        natural_angles=_integrals(curvature, nodes, cells),
        point_masses=point_masses,
    )


def check_support(beam: Beam) -> Clamp | Pin:
    """Return the only support of a beam, which must be a clamp or a pin at its beginning."""
    if len(beam.supports) == 1 and isinstance(beam.supports[0], Clamp | Pin) and beam.supports[0].point == 0.0:
        return beam.supports[0]
    raise InputError("must be one clamp or pin at the beginning of the beam, to be written for a simulator", "supports")


def _integrals(values: Array, nodes: Array, ends: Array) -> Array:
    """Return the integrals between consecutive ends of a quantity that is constant in each element."""
    total = np.concatenate([[0.0], np.cumsum(values * np.diff(nodes))])
    return np.diff(np.interp(ends, nodes, total))


def linearise_at_equilibrium(
    q: cs.SX,
    positions: cs.SX,
    inertias: Array,
    turns: cs.SX,
    elastic: cs.SX,
    gravity: tuple[float, float],
    tip: cs.SX,
    guess: Array,
) -> SmallMotion:
    """Solve for the equilibrium by Newton's method from ``guess``, and return small motion about it.

    The positions of the masses (x, y, angle), the turns of the joints, the elastic energy and the position of the tip
    are expressions of the coordinates q.
    """
    weights = cs.DM(inertias * np.tile([*gravity, 0.0], len(inertias) // 3))
    hessian, gradient = cs.hessian(elastic - cs.dot(weights, positions), q)
    balance = cs.Function("balance", [q], [gradient, hessian])
    coordinates = guess
    for _ in range(100):
        force, stiffness = (value.full() for value in balance(coordinates))
        step = -np.linalg.solve(stiffness, force)[:, 0]
        coordinates = coordinates + step * min(1.0, 0.3 / np.abs(step).max(initial=1e-300))
        if np.abs(step).max() < 1e-10:
            break
    else:
        raise EquilibriumError("no equilibrium of the discretised beam was found; use more segments")
    jacobians = [cs.jacobian(expression, q) for expression in (positions, turns, tip)]
    values = cs.Function("small_motion", [q], [*jacobians, hessian, positions[2::3]])(coordinates)
    jacobian, turns_jacobian, tip_jacobian, stiffness, angles = (value.full() for value in values)
    c, s = np.cos(angles), np.sin(angles)
    x, y = jacobian[0::3].copy(), jacobian[1::3].copy()
    jacobian[0::3], jacobian[1::3] = c * x + s * y, c * y - s * x
    return SmallMotion(coordinates, jacobian, inertias, turns_jacobian, stiffness, tip_jacobian)


@dataclass(frozen=True)
class SmallMotion:
    """Small motion about an equilibrium."""

    equilibrium: Array  # coordinates
    jacobian: Array  # J: displacements of the masses along and across the beam, and rotations, per coordinate
    inertias: Array  # m
    turns: Array  # T
    stiffness: Array  # K
    tip: Array  # Jacobian of the position of the tip

    @property
    def mass(self) -> Array:
        """The mass matrix M."""
        return np.asarray((self.jacobian.T * self.inertias) @ self.jacobian)

    def damping(self, at_masses: Array | float, at_joints: Array | float = 0.0) -> Array:
        """Return D of dampers at the masses (N s/m, N m s/rad) and at the joints (N m s/rad)."""
        return np.asarray((self.jacobian.T * at_masses) @ self.jacobian + (self.turns.T * at_joints) @ self.turns)

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return angular frequencies (rad/s) and shapes of the lowest modes, with a tip displacement of 1 m."""
        values, shapes = scipy.linalg.eigh(self.stiffness, self.mass, subset_by_index=(0, count - 1))
        if values[0] <= 0.0:
            raise EquilibriumError("the equilibrium of the discretised beam is unstable; use more segments")
        tip_displacements = self.tip @ shapes
        larger_component = np.abs(tip_displacements).argmax(axis=0)
        signs = np.sign(tip_displacements[larger_component, np.arange(count)])
        return np.sqrt(values), shapes * signs / np.linalg.norm(tip_displacements, axis=0)

    def ratio(self, damping: Array, mode: int) -> float:
        """Return the damping ratio of a mode (counted from 0) under light damping D."""
        omega, shapes = self.modes(mode + 1)
        shape = shapes[:, mode]
        return float(shape @ damping @ shape / (2 * omega[mode] * (shape @ self.mass @ shape)))


def poles(matrix: Array, step: float, count: int) -> tuple[Array, Array, bool]:
    """Return frequencies (Hz) and damping ratios of the slowest poles of a step matrix, and whether it is stable."""
    z = np.linalg.eigvals(matrix)
    s = np.log(z.astype(complex)) / step
    s = s[s.imag > MIN_POLE]
    s = s[np.argsort(np.abs(s))][:count]
    return np.abs(s) / (2 * math.pi), -s.real / np.abs(s), bool(np.abs(z).max() <= 1.0 + 1e-9)  # rounding


def step_matrix(
    mass: Array, damping: Array, stiffness: Array, step: float, *, implicit: bool = True, early: float = 0.0
) -> Array:
    """Return Z of q1 = q + e h v, M v' = M v - h K q1 - h D w, q' = q1 + (1 - e) h v'; w is v' if implicit, else v."""
    eye = np.eye(len(mass))
    after, before = (mass + step * damping, mass) if implicit else (mass, mass - step * damping)
    inverse = np.linalg.inv(after)
    kick = np.block([[eye, 0.0 * eye], [-step * inverse @ stiffness, inverse @ before]])
    drift_before, drift_after = (np.block([[eye, e * step * eye], [0.0 * eye, eye]]) for e in (early, 1.0 - early))
    return np.asarray(drift_after @ kick @ drift_before)
