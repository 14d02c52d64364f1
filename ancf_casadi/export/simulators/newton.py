"""The beam as a script of Newton (newton-physics): links with hinges, whose joints have springs and dampers.

    joints          revolute, with the stiffness k_j and the damping beta k_j, no armature
    links           mass and inertia of a segment, point masses on it included
    air             a Warp kernel that writes forces on the links: alpha, eta1 and eta2
    solver          ``SolverFeatherstone``: semi-implicit steps, explicit in damping, without its own angular damping

    v' = v - h M^-1 (K q + D v),    q' = q + h v'.

Newton's rod joints need its solver VBD, which is implicit and iterative: twelve of them in steps of 1 ms with 10
iterations swing too slowly by more than 10 %, and lose as much as a damping ratio of omega h/2.  Hinges do neither.
Newton computes in single precision.

References
----------
Newton documentation: solvers, joints, conventions.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.export.simulators.segments import Discrete, SegmentedBeam
from ancf_casadi.export.simulators.settings import ExportedBeam, Segmented, written
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array


class LinkedBeam(Segmented):
    """The links in Newton."""

    implicit = False

    @cached_property
    def links(self) -> SegmentedBeam:
        """The segments, each with the point masses that it carries."""
        beam = self.beam
        masses, centres, inertias = (own.copy() for own in (beam.masses, beam.centres, beam.inertias))
        for k, distance, one in beam.carried:
            total, away = masses[k] + one.mass, distance - centres[k]
            inertias[k] += one.rotary_inertia + masses[k] * one.mass / total * away**2
            centres[k] += one.mass / total * away
            masses[k] = total
        return replace(beam, masses=masses, centres=centres, inertias=inertias, carried=())

    @cached_property
    def discrete(self) -> Discrete:
        """Small motion about rest."""
        return self.links.discrete()

    @property
    def air(self) -> tuple[Array, Array, Array]:
        """Force per velocity, force per velocity squared, and moment per rate of turn, of each link."""
        law = self.law
        rates = law.alpha * self.links.masses + law.eta1 * self.beam.masses
        return rates, law.drag * self.beam.masses, (law.alpha + law.eta1) * self.links.inertias

    @property
    def poses(self) -> Array:
        """Angles of the hinges at rest, and with the tip moved by 1 m in each of the first modes to first order."""
        rest, shapes = self.discrete.rest, self.modes[1]
        return np.diff(np.vstack([rest, rest + shapes.T]), prepend=self.beam.axis)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""
        rates, drag, turns = self.air
        size = rates + drag * np.linalg.norm(self.speeds(mode)[:, :2], axis=1)
        return self.discrete.damping(np.column_stack([size, size, turns]).ravel(), self.law.beta * self.beam.stiffness)


def write_newton(
    model: Model,
    path: str | Path,
    *,
    damping: DampingLaw | None = None,
    segments: int | None = None,
    tolerance: float = 0.01,
    amplitude: float | None = None,
) -> ExportedBeam:
    """Write a beam as a script of Newton: links with hinges in the plane of x and y, released in mode 1.

    The script needs Newton alone.  Its function ``run`` returns time and position of the tip.

    Parameters
    ----------
    model, damping, segments, tolerance, amplitude
        See ``write_mujoco``.
    path : str or Path
        File to write, usually named ``.py``; an earlier one of this function is replaced.

    Raises
    ------
    InputError, EquilibriumError
        See ``write_mujoco``.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import write_newton
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_newton(Model(beam), "beam_newton.py", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> found.segments
    12
    """
    return written(LinkedBeam, "newton.py.jinja", model, path, damping, segments, tolerance, amplitude)
