"""The beam as MJCF, the model file of MuJoCo: a chain of bodies with hinges, stiffness and damping.

    joints          a spring k_j and a damper beta k_j, no armature: the segments have all of the inertia
    bodies          the mass and the inertia of a segment, whose equivalent box is its part of the beam
    viscosity       a rate on mass: 6 pi v r per body, r the mean of the half sides of its box, 8 pi v r^3 for turns
    density         drag: rho/2 per area of the box and speed squared, in each direction of the box by itself
    integrator      implicitfast: steps that are explicit in stiffness and implicit in damping

The viscosity and the density are one number each for the whole model; they are chosen so that mode 1 of the chain loses
the energy that it loses under the law.  MuJoCo's x and z are x and y here.

References
----------
MuJoCo documentation, Computation: numerical integration, fluid forces; XML reference.
"""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path

import numpy as np

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.simulators.result import ExportedBeam
from ancf_casadi.export.simulators.settings import Segmented, header, written
from ancf_casadi.export.simulators.small_motion import implicit_in_velocity
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

MJCF_MARK = "<!-- Written by ancf-casadi"
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
            for one in beam.carried:
                if one.segment == k:
                    masses.append(one.mass)
                    inertias.append((max(one.rotary_inertia, POINT),) * 3)
        return np.array(masses), np.array(inertias)

    @cached_property
    def sides(self) -> Array:
        """Half sides (p, 3) of the equivalent boxes, m."""
        masses, inertias = self.bodies
        others = inertias.sum(axis=1)[:, None] - 2 * inertias
        return np.asarray(np.sqrt(np.maximum(others, 0.0) * 1.5 / masses[:, None]))

    @cached_property
    def viscosity(self) -> float:
        """Viscosity for the rates of the law, kg/(m s)."""
        line = self.discrete.inertias * self._along_beam
        rates = self.discrete.damping(self.law.alpha * self.discrete.inertias + self.law.eta1 * line)
        return self.discrete.ratio(rates, 0) / self.discrete.ratio(self._damping(1.0, 0.0, 0.0, 0), 0)

    @cached_property
    def density(self) -> float:
        """Density for the drag of the law, kg/m^3."""
        speeds = self.speeds(0)
        size = np.repeat(np.hypot(speeds[:, 0], speeds[:, 1]), 3).reshape(-1, 3) * [1.0, 1.0, 0.0]
        line = self.discrete.inertias * self._along_beam
        drag = self.discrete.damping(DRAG_CONSTANT * self.law.eta2 * line * size.ravel())
        return self.discrete.ratio(drag, 0) / self.discrete.ratio(self._damping(0.0, 1.0, 0.0, 0), 0)

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""
        return self._damping(self.viscosity, self.density, self.law.beta, mode)

    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step."""
        return implicit_in_velocity(self.discrete.mass, self.damping(mode), self.discrete.stiffness, step)

    @property
    def _along_beam(self) -> Array:
        """1 for the places of segments, 0 for those of carried masses."""
        flags = []
        for k in range(self.beam.count):
            flags += [1.0] * 3 + [0.0] * 3 * sum(one.segment == k for one in self.beam.carried)
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
    return written(HingedChain, "mujoco", MJCF_MARK, _mjcf, model, path, damping, segments, tolerance, amplitude)


MJCF_MAPPING = (
    "Hinges: stiffness 1/(int ds/(E I)), damping beta times that.  Bodies: mass and inertia of their part of the beam.",
    "viscosity: damping per mass (alpha, eta1).  density: drag (eta2).  Both meet mode 1.  x, z: the plane of motion.",
    "Not represented: motion out of this plane, twist, stretching; contacts are off (contype, conaffinity).",
    "Key frames: 'rest' is the equilibrium, 'release' is deflected in mode 1.  Keep the time step, or a shorter one.",
)


def _mjcf(chain: HingedChain, found: ExportedBeam) -> str:
    """Return the model file."""
    beam, (x, y) = chain.beam, chain.beam.origin
    masses, inertias = chain.bodies
    if min(masses.min(), inertias.min()) < LEAST_INERTIA:
        raise InputError("is so small that its segments have less mass or inertia than mujoco takes, 1e-15", "model")
    lines, ends, place = [], [], 0
    for k in range(beam.count):
        turn = beam.unloaded[0] if k == 0 else beam.natural[k]
        at = _shown(x, 0.0, y) if k == 0 else _shown(beam.length, 0.0, 0.0)
        middle = _shown(beam.length / 2, 0.0, 0.0)
        half = _shown(beam.length / 2, beam.widths[k] / 2, beam.thicknesses[k] / 2)
        stiffness, damping = _shown(beam.stiffness[k]), _shown(chain.law.beta * beam.stiffness[k])
        lines += [
            f'<body name="segment_{k + 1}" pos="{at}" axisangle="0 -1 0 {_shown(turn)}">',
            f'  <joint name="joint_{k + 1}" stiffness="{stiffness}" damping="{damping}"/>',
            f'  <inertial pos="{_shown(beam.centres[k], 0.0, 0.0)}" mass="{_shown(masses[place])}" '
            f'diaginertia="{_shown(*inertias[place])}"/>',
            f'  <geom size="{half}" pos="{middle}"/>',
        ]
        ends.append("</body>")
        place += 1
        for one in (one for one in beam.carried if one.segment == k):
            lines += [
                f'  <body pos="{_shown(one.distance, 0.0, 0.0)}">',
                f'    <inertial pos="0 0 0" mass="{_shown(one.mass)}" diaginertia="{_shown(*inertias[place])}"/>',
                f'    <geom type="sphere" size="{_shown(max(beam.widths[k], beam.thicknesses[k]))}"/>',
                "  </body>",
            ]
            place += 1
    gravity = _shown(beam.gravity[0], 0.0, beam.gravity[1])
    rest, shape = chain.discrete.rest, chain.modes[1][:, 0]
    keys = {"rest": rest, "release": rest + found.amplitude * shape}
    poses = {name: np.diff(angles, prepend=beam.axis) - beam.natural for name, angles in keys.items()}
    frames = [f'    <key name="{name}" qpos="{_shown(*pose)}"/>' for name, pose in poses.items()]
    return "\n".join(
        [
            f"{MJCF_MARK}{header(found, MJCF_MAPPING)}\n-->",
            '<mujoco model="beam">',
            '  <compiler angle="radian"/>',
            f'  <option timestep="{found.step:g}" integrator="implicitfast" gravity="{gravity}"',
            f'          viscosity="{_shown(chain.viscosity)}" density="{_shown(chain.density)}"/>',
            "  <default>",
            '    <joint type="hinge" axis="0 -1 0" armature="0"/>',
            '    <geom type="box" contype="0" conaffinity="0"/>',
            "  </default>",
            "  <worldbody>",
            *(f"    {line}" for line in lines),
            f'    <site name="tip" pos="{_shown(beam.length, 0.0, 0.0)}"/>',
            f"    {''.join(ends)}",
            "  </worldbody>",
            "  <sensor>",
            '    <framepos name="tip" objtype="site" objname="tip"/>',
            "  </sensor>",
            "  <keyframe>",
            *frames,
            "  </keyframe>",
            "</mujoco>",
            "",
        ]
    )


def _shown(*values: float) -> str:
    return " ".join(f"{value:.10g}" for value in values)
