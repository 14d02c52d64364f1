"""The beam as rigid segments with springs between them.

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
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.small_motion import Discrete, Energy
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.section import masses_per_length
from ancf_casadi.mechanics.supports import Clamp, Pin
from ancf_casadi.support.arrays import Array, Index

GREGORY = 5 / 12  # part of a segment for which the joint at the clamp stands


@dataclass(frozen=True)
class CarriedMass:
    """A point mass on a segment (number from 0), at a distance from its joint (m); mass (kg) and inertia (kg m^2)."""

    segment: int
    distance: float
    mass: float
    rotary_inertia: float


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
    carried: tuple[CarriedMass, ...]

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.masses)

    @property
    def unloaded(self) -> Array:
        """Angles of the segments without load, rad."""
        return self.axis + np.cumsum(self.natural)

    def energy(self) -> Energy:
        """Return coordinates, places, inertias and energy; the places are x, y and angle of each mass, then the tip."""
        theta = cs.SX.sym("theta", self.count)
        at, places, inertias, ends = cs.SX(cs.DM(self.origin)), [], [], []
        for k in range(self.count):
            along = cs.vertcat(cs.cos(theta[k]), cs.sin(theta[k]))
            own = [(self.masses[k], self.centres[k], self.inertias[k])]
            own += [(one.mass, one.distance, one.rotary_inertia) for one in self.carried if one.segment == k]
            for mass, distance, inertia in own:
                places += [at + distance * along, theta[k]]
                inertias += [mass, mass, inertia]
            at = at + self.length * along
            ends.append(at)
        turns = theta - cs.vertcat(self.axis, theta[:-1])
        bending = cs.sumsqr(cs.sqrt(cs.DM(self.stiffness)) * (turns - cs.DM(self.natural))) / 2
        x, y = self.gravity
        weights = np.array(inertias) * np.tile([x, y, 0.0], len(inertias) // 3)
        return Energy(theta, cs.vertcat(*places), np.array(inertias), turns, bending, cs.DM(weights), at)

    def discrete(self) -> Discrete:
        """Return small motion about the equilibrium."""
        return self.energy().about(self.unloaded)


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
        carried.append(CarriedMass(segment, one.point - segment * length, one.mass, one.rotary_inertia))
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
        carried=tuple(carried),
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
