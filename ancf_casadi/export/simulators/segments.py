"""The beam as rigid segments with springs between them, and small motion of discretised beams.

A beam that is held at its beginning alone becomes n segments of the length l = L/n, each with the mass, the centre and
the moment of inertia of its part of the beam.  The joint at the beginning of segment j, at arc length j l, turns by the
difference of the angles of two segments and carries the bending moment

    k_j (theta_j - theta_(j-1) - phi_j),    1/k_j = int ds/(E I),    phi_j = int kappa_0 ds,

with the natural curvature kappa_0.  The integrals are over the part of the beam that the joint stands for: half a
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
from ancf_casadi.mechanics.section import masses_per_length
from ancf_casadi.mechanics.supports import Clamp, Pin
from ancf_casadi.support.arrays import Array, Index

GREGORY = 5 / 12  # part of a segment for which the joint at the clamp stands
SLOWEST = 1e-6  # 1/s; slower poles are those of motion that does not oscillate


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
    widths: Array
    thicknesses: Array
    stiffness: Array  # of the joints, N m/rad
    natural: Array  # angle of the joints without moment, rad
    carried: Sequence[tuple[int, float, PointMass]]  # with segment (from 0) and distance from its joint, m

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.masses)

    @property
    def unloaded(self) -> Array:
        """Angles of the segments without load, rad."""
        return self.axis + np.cumsum(self.natural)

    def discrete(self) -> Discrete:
        """Return small motion about the equilibrium; the places are x, y and angle of each mass."""
        theta = cs.SX.sym("theta", self.count)
        at, places, inertias = cs.SX(cs.DM(self.origin)), [], []
        for k in range(self.count):
            along = cs.vertcat(cs.cos(theta[k]), cs.sin(theta[k]))
            moved = [(self.masses[k], self.centres[k], self.inertias[k])]
            moved += [(one.mass, distance, one.rotary_inertia) for own, distance, one in self.carried if own == k]
            for mass, distance, inertia in moved:
                places += [at + distance * along, theta[k]]
                inertias += [mass, mass, inertia]
            at = at + self.length * along
        turns = theta - cs.vertcat(self.axis, theta[:-1])
        bending = cs.sumsqr(cs.sqrt(cs.DM(self.stiffness)) * (turns - cs.DM(self.natural))) / 2
        return about_rest(
            theta, cs.vertcat(*places), np.array(inertias), turns, bending, self.gravity, at, self.unloaded
        )


def segmented(beam: Beam, count: int) -> SegmentedBeam:
    """Return a beam that is held at its beginning alone as segments; refuse any other."""
    support = held_at_beginning(beam)
    length, ends = beam.length / count, np.linspace(0.0, beam.length, count + 1)
    cells = np.concatenate([[0.0, GREGORY], np.arange(1.5, count)]) * length
    sections, nodes = beam.sections, beam.node_points
    rigidity = np.array([e * s.second_moment for e, s in zip(beam.elastic_modulus, sections, strict=True)])
    compliance = _integrals(1 / rigidity, nodes, cells)
    if isinstance(support, Clamp) and math.isfinite(support.stiffness):
        compliance[0] += 1 / support.stiffness
    stiffness = 1 / compliance
    if isinstance(support, Pin):
        stiffness[0] = 0.0
    marks = np.union1d(ends, nodes)
    pieces, middles = np.diff(marks), (marks[:-1] + marks[1:]) / 2
    owners: Index = np.minimum((middles / length).astype(np.int64), count - 1)
    density = masses_per_length(beam.density, sections)
    of_element = np.clip(np.searchsorted(nodes, middles) - 1, 0, beam.elements - 1)
    mass = density[of_element] * pieces
    masses: Array = np.bincount(owners, mass).astype(np.float64)
    centres = np.bincount(owners, mass * middles) / masses
    inertias: Array = np.bincount(owners, mass * (pieces**2 / 12 + (middles - centres[owners]) ** 2)).astype(np.float64)
    carried = []
    for one in beam.attachments:
        if not isinstance(one, PointMass):
            raise InputError(f"a {type(one).__name__} cannot be written; only point masses can", "attachments")
        segment = min(int(one.point / length), count - 1)
        carried.append((segment, one.point - segment * length, one))
    curvature = np.array(beam.natural_curvature or [0.0] * beam.elements)
    return SegmentedBeam(
        origin=support.displacement,
        axis=math.atan2(beam.axis[1], beam.axis[0]) + support.angle,
        gravity=beam.gravity,
        length=length,
        masses=masses,
        centres=centres - ends[:-1],
        inertias=inertias,
        widths=_integrals(np.array(beam.width), nodes, ends) / length,
        thicknesses=_integrals(np.array(beam.thickness), nodes, ends) / length,
        stiffness=stiffness,
        natural=_integrals(curvature, nodes, cells),
        carried=carried,
    )


def held_at_beginning(beam: Beam) -> Clamp | Pin:
    """Return the only support of a beam; refuse others than a clamp or a pin at the beginning."""
    if len(beam.supports) == 1 and isinstance(beam.supports[0], Clamp | Pin) and beam.supports[0].point == 0.0:
        return beam.supports[0]
    raise InputError("must be one clamp or pin at the beginning of the beam, to be written for a simulator", "supports")


def _integrals(values: Array, nodes: Array, ends: Array) -> Array:
    """Return the integrals, between neighbouring ends, of a quantity that is constant in each element."""
    total = np.concatenate([[0.0], np.cumsum(values * np.diff(nodes))])
    return np.diff(np.interp(ends, nodes, total))


def about_rest(
    q: cs.SX,
    places: cs.SX,
    inertias: Array,
    turns: cs.SX,
    elastic: cs.SX,
    gravity: tuple[float, float],
    tip: cs.SX,
    first: Array,
) -> Discrete:
    """Return small motion about the equilibrium next to some coordinates; refuse one that is not found.

    The coordinates q place the masses (x, y, angle) and the tip, turn the joints and store elastic energy.
    """
    weights = cs.DM(inertias * np.tile([*gravity, 0.0], len(inertias) // 3))
    hessian, gradient = cs.hessian(elastic - cs.dot(weights, places), q)
    balance = cs.Function("balance", [q], [gradient, hessian])
    at = first
    for _ in range(100):
        force, stiffness = (one.full() for one in balance(at))
        step = -np.linalg.solve(stiffness, force)[:, 0]
        at = at + step * min(1.0, 0.3 / np.abs(step).max(initial=1e-300))
        if np.abs(step).max() < 1e-10:
            break
    else:
        raise EquilibriumError("no equilibrium of the discretised beam was found; use more segments")
    changes = [cs.jacobian(one, q) for one in (places, turns, tip)]
    found = cs.Function("found", [q], [*changes, hessian, places])(at)
    jacobian, of_turns, of_tip, stiffness, rest = (one.full() for one in found)
    c, s = np.cos(rest[2::3]), np.sin(rest[2::3])
    x, y = jacobian[0::3].copy(), jacobian[1::3].copy()
    jacobian[0::3], jacobian[1::3] = c * x + s * y, c * y - s * x
    return Discrete(at, jacobian, inertias, of_turns, stiffness, of_tip)


@dataclass(frozen=True)
class Discrete:
    """Small motion about an equilibrium."""

    rest: Array
    jacobian: Array  # J of the places, along and across the beam there, and of the angle
    inertias: Array
    turns: Array  # T
    stiffness: Array  # K
    tip: Array  # Jacobian of the position of the tip

    @property
    def mass(self) -> Array:
        """The mass matrix M."""
        return np.asarray((self.jacobian.T * self.inertias) @ self.jacobian)

    def damping(self, places: Array, joints: Array | float = 0.0) -> Array:
        """Return D of dampers at the places (N s/m, N m s/rad) and at the joints (N m s/rad)."""
        return np.asarray((self.jacobian.T * places) @ self.jacobian + (self.turns.T * joints) @ self.turns)

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return angular frequencies (rad/s) and shapes of the lowest modes, whose tip moves by 1."""
        values, shapes = scipy.linalg.eigh(self.stiffness, self.mass, subset_by_index=(0, count - 1))
        if values[0] <= 0.0:
            raise EquilibriumError("the equilibrium of the discretised beam is unstable; use more segments")
        moved = self.tip @ shapes
        larger = np.abs(moved).argmax(axis=0)
        signs = np.sign(moved[larger, np.arange(count)])
        return np.sqrt(values), shapes * signs / np.linalg.norm(moved, axis=0)

    def ratio(self, damping: Array, mode: int) -> float:
        """Return the damping ratio of a mode (number from 0) under light damping D."""
        omega, shapes = self.modes(mode + 1)
        phi = shapes[:, mode]
        return float(phi @ damping @ phi / (2 * omega[mode] * (phi @ self.mass @ phi)))


def poles(matrix: Array, step: float, count: int) -> tuple[Array, Array, bool]:
    """Return frequencies (Hz) and damping ratios of the slowest poles of a step matrix, and whether no motion grows."""
    z = np.linalg.eigvals(matrix)
    s = np.log(z.astype(complex)) / step
    s = s[s.imag > SLOWEST]
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
    first, last = (np.block([[eye, share * step * eye], [0.0 * eye, eye]]) for share in (early, 1.0 - early))
    return np.asarray(last @ kick @ first)
