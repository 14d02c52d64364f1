"""The beam as a script of Newton (newton-physics): links with hinges, whose joints have springs and dampers.

    joints          revolute, with the stiffness k_j and the damping beta k_j, no armature
    links           mass and inertia of a segment, point masses on it included
    air             a Warp kernel that writes forces on the links: alpha, eta1 and eta2
    solver          ``SolverFeatherstone``: semi-implicit steps, explicit in damping, without its own angular damping

    v' = v - h M^-1 (K q + D v),    q' = q + h v'.

Newton's rod joints need its solver VBD, which is implicit and iterative: with twelve of them, steps of 1 ms and 10
iterations, the frequency is too low by more than 10 %, and the steps add a damping ratio of omega h/2.  Hinges avoid
both errors.
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
from ancf_casadi.export.simulators.segments import SegmentedBeam, SmallMotion
from ancf_casadi.export.simulators.settings import ExportedBeam, SimulatorBeam, write_segments
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array


class LinkedBeam(SimulatorBeam):
    """The links in Newton."""

    implicit = False

    @cached_property
    def links(self) -> SegmentedBeam:
        """The segments, each rigidly joined with its point masses."""
        beam = self.beam
        masses, centres, inertias = (values.copy() for values in (beam.masses, beam.centres, beam.inertias))
        for segment, distance, point_mass in beam.point_masses:
            total, offset = masses[segment] + point_mass.mass, distance - centres[segment]
            inertias[segment] += point_mass.rotary_inertia + masses[segment] * point_mass.mass / total * offset**2
            centres[segment] += point_mass.mass / total * offset
            masses[segment] = total
        return replace(beam, masses=masses, centres=centres, inertias=inertias, point_masses=())

    @cached_property
    def small_motion(self) -> SmallMotion:
        """Small motion about the equilibrium."""
        return self.links.small_motion()

    @property
    def air(self) -> tuple[Array, Array, Array]:
        """Force per velocity, force per velocity squared, and moment per rate of turn, of each link."""
        coefficients, links, beam = self.coefficients, self.links, self.beam
        linear = coefficients.alpha * links.masses + coefficients.eta1 * beam.masses
        return linear, coefficients.drag * beam.masses, (coefficients.alpha + coefficients.eta1) * links.inertias

    @property
    def poses(self) -> Array:
        """Angles of the hinges in equilibrium, and with a linear tip displacement of 1 m in each mode."""
        equilibrium, shapes = self.small_motion.equilibrium, self.modes[1]
        return np.diff(np.vstack([equilibrium, equilibrium + shapes.T]), prepend=self.beam.axis)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag linearised at the amplitude of a mode."""
        linear, drag, rotational = self.air
        linear = linear + drag * np.linalg.norm(self.speeds(mode)[:, :2], axis=1)
        at_links = np.column_stack([linear, linear, rotational]).ravel()
        return self.small_motion.damping(at_links, self.coefficients.beta * self.beam.stiffness)


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
    return write_segments(LinkedBeam, "newton.py.jinja", model, path, damping, segments, tolerance, amplitude)
