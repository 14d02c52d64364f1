"""The beam as MJCF, the model file of MuJoCo: a chain of bodies with hinges, stiffness and damping.

    joints          a spring k_j and a damper beta k_j, no armature: the segments have all of the inertia
    bodies          the mass and the inertia of a segment, whose equivalent box is its part of the beam
    viscosity       a rate on mass: 6 pi v r per body, r the mean of the half sides of its box, 8 pi v r^3 for turns
    density         drag: rho/2 per area of the box and speed squared, in each direction of the box by itself
    integrator      implicitfast: steps that are explicit in stiffness and implicit in damping

The viscosity and the density are one number each for the whole model; they are chosen so that mode 1 of the chain loses
the energy that it loses under the law, and, beside point masses, on which the viscosity does not act, the dampers of
the joints so that further modal ratios are met.  MuJoCo's x and z are x and y here.

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
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.settings import COMPARED, ExportedBeam, Segmented, meeting_first, terms_of, written
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

POINT = 1e-12  # kg m^2; inertia of a point mass
LEAST_INERTIA = 1e-15  # kg or kg m^2, that MuJoCo takes


class HingedChain(Segmented):
    """The chain in MuJoCo."""

    @cached_property
    def bodies(self) -> tuple[Array, Array]:
        """Masses (p,) and principal inertias (p, 3) along, out of and across the beam, in the order of the places."""
        beam, masses, inertias = self.beam, [], []
        for k in range(beam.count):
            b, h = beam.widths[k], beam.thicknesses[k]
            turn, m = beam.inertias[k], beam.masses[k]
            masses.append(m)
            inertias.append((m * (b**2 + h**2) / 12, turn, turn + m * (b**2 - h**2) / 12))
            carried = [one for segment, _, one in beam.carried if segment == k]
            masses += [one.mass for one in carried]
            inertias += [(max(one.rotary_inertia, POINT),) * 3 for one in carried]
        if min(*masses, *np.ravel(inertias)) < LEAST_INERTIA:
            message = "is so small that its segments have less mass or inertia than mujoco takes, 1e-15"
            raise InputError(message, "model")
        return np.array(masses), np.array(inertias)

    @property
    def key_frames(self) -> dict[str, Array]:
        """Angles of the hinges at rest, and deflected in mode 1, less those without moment."""
        beam, rest, shapes = self.beam, self.discrete.rest, self.modes[1]
        angles = {"rest": rest, "release": rest + self.given.amplitude * shapes[:, 0]}
        return {name: np.diff(own, prepend=beam.axis) - beam.natural for name, own in angles.items()}

    @cached_property
    def sides(self) -> Array:
        """Half sides (p, 3) of the equivalent boxes, m."""
        masses, inertias = self.bodies
        others = inertias.sum(axis=1)[:, None] - 2 * inertias
        return np.asarray(np.sqrt(np.maximum(others, 0.0) * 1.5 / masses[:, None]))

    @cached_property
    def rates(self) -> tuple[float, float]:
        """Viscosity, kg/(m s), and damping of the joints per stiffness, s, for the rates of the law.

        They meet mode 1.  Viscosity does not act on point masses: beside these, the joints meet further modal ratios.
        """
        line = self.discrete.inertias * self._along_beam
        rates = self.discrete.damping(self.law.alpha * self.discrete.inertias + self.law.eta1 * line)
        viscous = self._damping(1.0, 0.0, 0.0, 0)
        stated = [len(term.ratios) for term in terms_of(self.given.damping) if isinstance(term, ModalDamping)]
        count = min(max(stated, default=1), COMPARED)
        if count == 1 or not self.beam.carried:
            return self.discrete.ratio(rates, 0) / self.discrete.ratio(viscous, 0), self.law.beta
        joints = self._damping(0.0, 0.0, 1.0, 0)
        compared = (rates + self.law.beta * joints, viscous, joints)
        return meeting_first(
            *(np.array([self.discrete.ratio(damping, k) for k in range(count)]) for damping in compared)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what MuJoCo cannot represent."""
        beta = self.rates[1]
        if beta == self.law.beta:
            return self.law.warnings
        return (*self.law.warnings, f"viscosity does not act on point masses; beside it, beta is {beta:.4g} s")

    @cached_property
    def density(self) -> float:
        """Density for the drag of the law, kg/m^3."""
        speeds = self.speeds(0)
        size = np.repeat(np.hypot(speeds[:, 0], speeds[:, 1]), 3).reshape(-1, 3) * [1.0, 1.0, 0.0]
        line = self.discrete.inertias * self._along_beam
        drag = self.discrete.damping(self.law.drag * line * size.ravel())
        return self.discrete.ratio(drag, 0) / self.discrete.ratio(self._damping(0.0, 1.0, 0.0, 0), 0)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""
        viscosity, beta = self.rates
        return self._damping(viscosity, self.density, beta, mode)

    @property
    def _along_beam(self) -> Array:
        """1 for the places of segments, 0 for those of carried masses."""
        flags = []
        for k in range(self.beam.count):
            flags += [1.0] * 3 + [0.0] * 3 * sum(segment == k for segment, *_ in self.beam.carried)
        return np.array(flags)

    def _damping(self, viscosity: float, density: float, beta: float, mode: int) -> Array:
        along, wide, thick = self.sides.T
        radius = self.sides.mean(axis=1)
        viscous = viscosity * math.pi * np.column_stack([6 * radius, 6 * radius, 8 * radius**3])
        turned = wide * (along**4 + thick**4) / 2
        areas = np.column_stack([2 * wide * thick, 2 * along * wide, turned])
        places = viscous + density * areas * self.speeds(mode)
        return self.discrete.damping(places.ravel(), beta * self.beam.stiffness)


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
        Tip amplitude of mode 1 (m) at which laws that depend on it are represented, and from which the beam is
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
    return written(HingedChain, "mujoco.xml.jinja", model, path, damping, segments, tolerance, amplitude)
