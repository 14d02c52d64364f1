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

IsaacLab reads a cable as a USD curve, whose segments Newton joins by rod joints for its solver VBD.  A joint has the
stiffness of half a segment on each side, so the first segment is fixed with its middle at the clamp: then each joint
represents one segment of the beam.  A converged step is one of implicit Euler,

    (M + h D + h^2 K) v' = M v - h K q,    q' = q + h v',

which adds a damping ratio of about omega h/2; the bend damping provides the remainder of the ratio of mode 1.  VBD
converges in 20 iterations only if stretch and shear are soft; a shear stiffness S lowers the frequency of mode k by a
fraction of about sqrt(E I m) omega_k/(2 S), with the mass per length m.

References
----------
Newton documentation: solvers, joints, conventions; newton_usd_schemas 0.6, NewtonCurvesDeformableMaterialAPI; AOUSD
proposal of deformable bodies, PhysicsCurvesDeformableMaterialAPI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.segments import SegmentedBeam, step_matrix
from ancf_casadi.export.simulators.settings import STEPS, ExportedBeam, SimulatorBeam, write_segments
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file

MIN_AXIAL_INERTIA = 1.2e-10  # moment of inertia of a segment about its axis, kg m^2; Newton changes those below 1e-10
LARGEST_STEP = 3.0  # h^2 S/(m l) for which 20 iterations of VBD converge; 10 leave an error of 1.2 % in frequency


class LinkedBeam(SimulatorBeam):
    """The links in Newton."""

    implicit = False

    @cached_property
    def chain(self) -> SegmentedBeam:
        """The segments, each rigidly joined with its point masses."""
        beam = self.beam
        masses, centres, inertias = (values.copy() for values in (beam.masses, beam.centres, beam.inertias))
        for segment, distance, point_mass in beam.point_masses:
            total, offset = masses[segment] + point_mass.mass, distance - centres[segment]
            inertias[segment] += point_mass.rotary_inertia + masses[segment] * point_mass.mass / total * offset**2
            centres[segment] += point_mass.mass / total * offset
            masses[segment] = total
        return replace(beam, masses=masses, centres=centres, inertias=inertias, point_masses=())

    @property
    def air(self) -> tuple[Array, Array, Array]:
        """Force per velocity, force per velocity squared, and moment per rate of turn, of each link."""
        coefficients, links, beam = self.coefficients, self.chain, self.beam
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
        linear = linear + drag * np.linalg.norm(self.drag_speeds(mode)[:, :2], axis=1)
        at_links = np.column_stack([linear, linear, rotational]).ravel()
        return self.small_motion.damping(at_links, self.coefficients.beta * self.beam.stiffness)


class Cable(SimulatorBeam):
    """A USD curve in Newton: a fixed first segment, whose middle is at the clamp, and the segments that move."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what the curve cannot represent."""
        softening = self.stretch_stiffness / self._beam.axial_stiffness[0]
        return (
            f"a bend damping of {self.beta:.4g} s times E I and the implicit steps, which alone give mode 1 a damping "
            f"ratio of {self._step_ratio:.2g}, together {'meet' if self.beta else 'exceed'} that of mode 1 at a tip "
            f"amplitude of {self.request.amplitude:.4g} m; ratios of higher modes are proportional to frequency",
            f"stretch and shear have {softening:.2g} times the stiffness E A, for 20 iterations of VBD to converge",
        )

    @property
    def _beam(self) -> Beam:
        return self.request.modes.model.beam

    @property
    def _step_ratio(self) -> float:
        return float(self.modes[0][0] * self.step / 2)

    @cached_property
    def chain(self) -> SegmentedBeam:
        """The segments that move; their first joint is half a segment beyond the clamp."""
        beam, count = self._beam, self.beam.count
        (support,) = beam.supports
        curvature = beam.natural_curvature or (0.0,)
        if not isinstance(support, Clamp) or math.isfinite(support.stiffness) or beam.attachments:
            raise InputError("a curve of Newton is a beam with a rigid clamp and without attachments", "model")
        if beam.rotary_sections:
            raise InputError("a curve of Newton has no rotary inertia of sections", "model")
        if any(np.ptp(values) > 0.0 for values in (beam.bending_stiffness, beam.mass_per_length, curvature)):
            raise InputError("a curve of Newton has the same section and natural curvature everywhere", "model")
        length = beam.length / (count + 0.5)
        masses = np.full(count, beam.mass_per_length[0] * length)
        x, y = self.beam.origin
        return replace(
            self.beam,
            origin=(x + length / 2 * math.cos(self.beam.axis), y + length / 2 * math.sin(self.beam.axis)),
            length=length,
            masses=masses,
            centres=np.full(count, length / 2),
            inertias=masses * length**2 / 12,
            stiffness=np.full(count, self.bending_stiffness / length),
            natural_angles=np.full(count, curvature[0] * length),
        )

    @property
    def bending_stiffness(self) -> float:
        """E I, N m^2."""
        return float(self._beam.bending_stiffness[0])

    @property
    def stretch_stiffness(self) -> float:
        """Stretch and shear stiffness, N: at most E A; shear changes mode 3 by half the tolerance."""
        limit = math.sqrt(self.bending_stiffness * self._beam.mass_per_length[0]) / self.request.tolerance
        return float(min(self._beam.axial_stiffness[0], limit * self.modes[0][-1]))

    @property
    def step(self) -> float:
        """The longest step for which the iterations converge, s; in single precision, shorter ones add noise."""
        longest = math.sqrt(LARGEST_STEP * self.chain.masses[0] * self.chain.length / self.stretch_stiffness)
        return next((step for step in STEPS if step <= longest), STEPS[-1])

    @property
    def diameter(self) -> float:
        """Diameter of the curve, m, at least that for ``MIN_AXIAL_INERTIA``."""
        mass = float(self.chain.masses[0])
        area = self.beam.widths[0] * self.beam.thicknesses[0]
        round_diameter = self.beam.diameters[0] or math.sqrt(4 * area / math.pi)
        return max(float(round_diameter), math.sqrt(8 * MIN_AXIAL_INERTIA / mass))

    @property
    def density(self) -> float:
        """Density that gives the curve the mass per length of the beam, kg/m^3."""
        return float(self.chain.masses[0] / self.chain.length / (math.pi * self.diameter**2 / 4))

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Direction of gravity and its size, m/s^2."""
        x, y = self.beam.gravity
        size = math.hypot(x, y)
        return (x / size, y / size, size) if size else (0.0, -1.0, 0.0)

    @property
    def equilibrium_points(self) -> Sequence[tuple[float, float]]:
        """Positions of the ends of all segments in the equilibrium."""
        return self._points(self.small_motion.equilibrium)

    @property
    def unloaded_points(self) -> Sequence[tuple[float, float]]:
        """Positions of the ends of all segments without load."""
        return self._points(self.chain.unloaded_angles)

    def _points(self, angles: Array) -> Sequence[tuple[float, float]]:
        turned = np.array([self.beam.axis, *angles])
        steps = self.chain.length * np.column_stack([np.cos(turned), np.sin(turned)])
        start = np.array(self.chain.origin) - steps[0]
        return [tuple(point) for point in np.vstack([start, start + np.cumsum(steps, axis=0)]).tolist()]

    @cached_property
    def beta(self) -> float:
        """Bend damping over E I, s, that gives mode 1 its damping ratio together with implicit steps."""
        missing = max(float(self.request.ratios[0]) - self._step_ratio, 0.0)
        return missing / self.small_motion.ratio(self._bend_damping, 0)

    @property
    def _bend_damping(self) -> Array:
        """Damping matrix for beta = 1."""
        return self.small_motion.damping(0.0, self.chain.stiffness)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix of the joints."""
        return self.beta * self._bend_damping

    def transition_matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step of implicit Euler, in which a stiffness acts like the damping h K, too."""
        M, K = self.small_motion.mass, self.small_motion.stiffness
        return step_matrix(M, self.damping(mode) + step * K, K, step)


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

    The script needs only Newton.  Its function ``run`` returns time and position of the tip.  If the path ends with
    ``.usda``, the beam is written as a USD curve at rest in the plane of x and z, a cable for IsaacLab.

    Parameters
    ----------
    model, damping, segments, tolerance, amplitude
        See ``write_mujoco``.
    path : str or Path
        File to write, named ``.usda``, or else usually ``.py``; an earlier one of this function is replaced.

    Raises
    ------
    InputError, EquilibriumError
        See ``write_mujoco``.  A curve needs a rigid clamp, and refuses attachments, rotary inertia of the sections, and
        a section or a natural curvature that varies along the beam.

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
    is_curve = check_file(path).suffix.lower() == ".usda"
    kind, template = (Cable, "newton.usda.jinja") if is_curve else (LinkedBeam, "newton.py.jinja")
    return write_segments(kind, template, model, path, damping, segments, tolerance, amplitude)
