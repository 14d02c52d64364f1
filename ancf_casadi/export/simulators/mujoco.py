"""The beam as MJCF, the model file of MuJoCo: a chain of bodies with hinges, stiffness and damping.

    joints          a spring k_j and a damper beta k_j, no armature: the segments have all of the inertia
    bodies          the mass and the inertia of a segment, whose equivalent box is its part of the beam; round ones are
                    shown as cylinders, and the air acts on the box with the same inertia
    viscosity       damping of mass: 6 pi v r per body, r the mean of the half sides of its box, 8 pi v r^3 for turns
    density         drag: rho/2 per area of the box and speed squared, separately for each direction of the box
    integrator      implicitfast: steps that are explicit in stiffness and implicit in damping

The viscosity and the density are one number each for the whole model.  They are chosen so that mode 1 of the chain
dissipates as much energy as under the law.  The viscosity does not act on point masses; if there are any, the dampers
of the joints are chosen so that further modal ratios are met.  MuJoCo's x and z are x and y here.

References
----------
MuJoCo documentation, Computation: numerical integration, fluid forces; XML reference.
"""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path

import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping
from ancf_casadi.damping.law import law_terms
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.settings import (
    COMPARED_MODES,
    ExportedBeam,
    SimulatorBeam,
    match_first_ratio,
    write_segments,
)
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

MIN_POINT_INERTIA = 1e-12  # of a point mass, kg m^2
MIN_INERTIA = 1e-15  # of a body in MuJoCo, kg or kg m^2


class HingedChain(SimulatorBeam):
    """The chain in MuJoCo."""

    @cached_property
    def bodies(self) -> tuple[Array, Array]:
        """Masses (p,) and principal inertias (p, 3) about the axes along, out of and across the beam."""
        beam, masses, inertias = self.beam, [], []
        for k in range(beam.count):
            width, thickness = beam.widths[k], beam.thicknesses[k]
            inertia, mass = beam.inertias[k], beam.masses[k]
            masses.append(mass)
            across, through = mass * width**2 / 12, mass * thickness**2 / 12
            inertias.append((across + through, inertia, inertia + across - through))
            point_masses = [point_mass for segment, _, point_mass in beam.point_masses if segment == k]
            masses += [point_mass.mass for point_mass in point_masses]
            inertias += [(max(point_mass.rotary_inertia, MIN_POINT_INERTIA),) * 3 for point_mass in point_masses]
        if min(*masses, *np.ravel(inertias)) < MIN_INERTIA:
            message = "is so small that its segments have less mass or inertia than mujoco takes, 1e-15"
            raise InputError(message, "model")
        return np.array(masses), np.array(inertias)

    @property
    def key_frames(self) -> dict[str, Array]:
        """Joint positions in equilibrium and deflected in mode 1; they are 0 without moment."""
        beam, equilibrium, shapes = self.beam, self.small_motion.equilibrium, self.modes[1]
        frames = {"rest": equilibrium, "release": equilibrium + self.request.amplitude * shapes[:, 0]}
        return {name: np.diff(angles, prepend=beam.axis) - beam.natural_angles for name, angles in frames.items()}

    @cached_property
    def sides(self) -> Array:
        """Half sides (p, 3) of the equivalent boxes, m."""
        masses, inertias = self.bodies
        squares = inertias.sum(axis=1)[:, None] - 2 * inertias
        return np.asarray(np.sqrt(np.maximum(squares, 0.0) * 1.5 / masses[:, None]))

    @cached_property
    def rates(self) -> tuple[float, float]:
        """Viscosity, kg/(m s), and damping of the joints per stiffness, s, with the linear damping of mode 1.

        If there are point masses, on which viscosity does not act, the joints meet further modal ratios.
        """
        motion, coefficients = self.small_motion, self.coefficients
        eta1 = coefficients.eta1 * self._along_beam
        law_damping = motion.damping((coefficients.alpha + eta1) * motion.inertias)
        viscous_damping = self._damping(1.0, 0.0, 0.0, 0)
        ratio_counts = [len(term.ratios) for term in law_terms(self.request.damping) if isinstance(term, ModalDamping)]
        count = min(max(ratio_counts, default=1), COMPARED_MODES)
        if count == 1 or not self.beam.point_masses:
            return motion.ratio(law_damping, 0) / motion.ratio(viscous_damping, 0), coefficients.beta
        joint_damping = self._damping(0.0, 0.0, 1.0, 0)
        dampings = law_damping + coefficients.beta * joint_damping, viscous_damping, joint_damping
        return match_first_ratio(*(np.array([motion.ratio(D, k) for k in range(count)]) for D in dampings))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what MuJoCo cannot represent."""
        beta = self.rates[1]
        if beta == self.coefficients.beta:
            return self.coefficients.warnings
        return (*self.coefficients.warnings, f"viscosity does not act on point masses; beside it, beta is {beta:.4g} s")

    @cached_property
    def density(self) -> float:
        """Density with the drag of the law in mode 1, kg/m^3."""
        speed = np.hypot(*self.drag_speeds(0)[:, :2].T)
        mass_speeds = np.column_stack([speed, speed, 0.0 * speed]).ravel()
        beam_inertias = self.small_motion.inertias * self._along_beam
        drag = self.small_motion.damping(self.coefficients.drag * beam_inertias * mass_speeds)
        return self.small_motion.ratio(drag, 0) / self.small_motion.ratio(self._damping(0.0, 1.0, 0.0, 0), 0)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag linearised at the amplitude of a mode."""
        viscosity, beta = self.rates
        return self._damping(viscosity, self.density, beta, mode)

    @property
    def _along_beam(self) -> Array:
        """1 for the coordinates of segments, 0 for those of point masses."""
        flags = []
        for k in range(self.beam.count):
            flags += [1.0] * 3 + [0.0] * 3 * sum(segment == k for segment, *_ in self.beam.point_masses)
        return np.array(flags)

    def _damping(self, viscosity: float, density: float, beta: float, mode: int) -> Array:
        """Return the damping matrix for a viscosity, a density and damping of the joints per stiffness."""
        along, wide, thick = self.sides.T
        radius = self.sides.mean(axis=1)
        viscous_coefficients = viscosity * math.pi * np.column_stack([6 * radius, 6 * radius, 8 * radius**3])
        turn_areas = wide * (along**4 + thick**4) / 2
        areas = np.column_stack([2 * wide * thick, 2 * along * wide, turn_areas])
        at_masses = viscous_coefficients + density * areas * self.drag_speeds(mode)
        return self.small_motion.damping(at_masses.ravel(), beta * self.beam.stiffness)


def write_mujoco(
    model: Model,
    path: str | Path,
    *,
    damping: DampingLaw | None = None,
    segments: int | None = None,
    tolerance: float = 0.01,
    amplitude: float | None = None,
) -> ExportedBeam:
    """Write a beam as a model file of MuJoCo (MJCF): a chain of bodies with hinges, in the plane of x and z.

    The file has the key frames ``rest``, the equilibrium, and ``release``, deflected in mode 1, and a sensor ``tip``.

    Parameters
    ----------
    model : Model
        The beam; a clamp or a pin at its beginning holds it alone.
    path : str or Path
        File to write, usually named ``.xml``; an earlier one of this function is replaced.
    damping : DampingLaw, optional
        The damping law; none if not given.
    segments : int, optional
        Number of segments, 4 to 64; the fewest within the tolerance if not given.
    tolerance : float
        Largest relative error of the first three natural frequencies, by which segments and step are chosen.
    amplitude : float, optional
        Tip amplitude of mode 1 (m) at which amplitude-dependent laws are represented, and from which the beam is
        released; 2 % of the length if not given.

    Raises
    ------
    InputError
        If the beam has other supports, or springs or dashpots, an argument is unusable, the tolerance cannot be met, or
        the path cannot be written or holds another file.
    EquilibriumError
        If the beam has no stable equilibrium.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import write_mujoco
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_mujoco(Model(beam), "beam.xml", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> found.segments, found.step
    (12, 0.0005)
    """
    return write_segments(HingedChain, "mujoco.xml.jinja", model, path, damping, segments, tolerance, amplitude)
