"""The beam as a script of PyElastica: a Cosserat rod with point masses at its nodes.

    bending         at the node between two elements, the stiffness k_j of the joint; at the clamp, a torque k_0
    shear, stretch  12 E I/l^2 and 60 E I/l^2: far softer than a thin strip, so that steps can be long
    inertia         of segments at their ends; m l^2/12 for the turn of each element
    damping         AnalyticalLinearDamper for alpha, an implicit damper for beta, forces on the nodes for eta1 and eta2

The masses at the nodes, the shear and the inertia of turns lower the frequency of a wave of the number kappa, each by a
multiple of (kappa l)^2, so this beam takes more segments than rigid bodies.  PositionVerlet steps with these dampers
are, to the order of h,

    q1 = q + h v/2,    (M + h D) v' = M v - h K q1,    q' = q1 + h v'/2.

References
----------
M. Gazzola, L. Dudte, A. McCormick, L. Mahadevan, Forward and inverse problems in the mechanics of soft filaments, Royal
Society Open Science 5 (2018).
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import casadi as cs
import numpy as np

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw
from ancf_casadi.export.simulators.result import ExportedBeam
from ancf_casadi.export.simulators.settings import Segmented, header, listed, written
from ancf_casadi.export.simulators.small_motion import Discrete, Energy, drift, kick
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

PYELASTICA_MARK = '"""Written by ancf-casadi'
SHEAR = 12.0  # shear stiffness per E I/l^2
STRETCH = 60.0  # stretching changes the bending of PyElastica's elements; more than this would shorten the step


class CosseratBeam(Segmented):
    """The rod in PyElastica."""

    @cached_property
    def masses(self) -> tuple[Array, Array, Array]:
        """Masses of the nodes from the first on, all and those along the beam, and inertias of the elements."""
        beam = self.beam
        line, carried = np.zeros(beam.count + 1), np.zeros(beam.count + 1)
        turns = beam.masses * beam.length**2 / 12
        far = beam.masses * beam.centres / beam.length
        line[1:] += far
        line[:-1] += beam.masses - far
        for one in beam.carried:
            share = one.distance / beam.length
            carried[one.segment : one.segment + 2] += np.array([1.0 - share, share]) * one.mass
            turns[one.segment] += one.rotary_inertia
        return (line + carried)[1:], line[1:], turns

    @cached_property
    def stiffness(self) -> tuple[float, float]:
        """Stiffness in shear and stretch, N."""
        unit = float(self.beam.stiffness[1:].max() / self.beam.length)
        return SHEAR * unit, STRETCH * unit

    @cached_property
    def discrete(self) -> Discrete:
        """Small motion of the rod."""
        beam, n = self.beam, self.beam.count
        q = cs.SX.sym("q", 3, n)
        nodes, theta = cs.horzcat(cs.DM(beam.origin), q[:2, :]), q[2, :].T
        turns = theta - cs.vertcat(beam.axis, theta[:-1])
        c, s = cs.cos(theta).T, cs.sin(theta).T
        dx, dy = cs.vertsplit((nodes[:, 1:] - nodes[:, :-1]) / beam.length)
        shear, stretch = self.stiffness
        elastic = beam.length / 2 * (shear * cs.sumsqr(c * dy - s * dx) + stretch * cs.sumsqr(c * dx + s * dy - 1))
        elastic += cs.dot(cs.DM(beam.stiffness), (turns - cs.DM(beam.natural)) ** 2) / 2
        all_masses, _, inertias = self.masses
        weights = np.column_stack([np.outer(all_masses, beam.gravity), np.zeros(n)])
        energy = Energy(
            cs.vec(q),
            cs.vec(q),
            np.column_stack([all_masses, all_masses, inertias]).ravel(),
            turns,
            elastic,
            cs.DM(weights.ravel()),
            nodes[:, -1],
        )
        rest = beam.discrete().rest
        places = np.cumsum(np.column_stack([np.cos(rest), np.sin(rest)]) * beam.length, axis=0) + beam.origin
        return energy.about(np.column_stack([places, rest]).ravel())

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""
        drag = DRAG_CONSTANT * self.law.eta2 * np.linalg.norm(self.speeds(mode)[:, :2], axis=1)
        rate = self.law.eta1 + drag
        air = rate * self.masses[1]
        places = self.law.alpha * self.discrete.inertias + np.column_stack([air, air, 0.0 * air]).ravel()
        return self.discrete.damping(places, self.law.beta * self.beam.stiffness)

    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step."""
        mass = self.discrete.mass
        half = drift(len(mass), step / 2)
        return np.asarray(half @ kick(mass + step * self.damping(mode), mass, self.discrete.stiffness, step) @ half)


def write_pyelastica(
    model: Model,
    path: str | Path,
    *,
    damping: DampingLaw | None = None,
    segments: int | None = None,
    tolerance: float = 0.01,
    amplitude: float | None = None,
) -> ExportedBeam:
    """Write a beam as a script of PyElastica: a Cosserat rod in the plane of x and y, released in mode 1.

    The script needs PyElastica alone.  Its function ``run`` returns time and position of the tip.

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
    >>> from ancf_casadi.export import write_pyelastica
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_pyelastica(Model(beam), "beam_pyelastica.py", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> found.segments, found.step
    (45, 1.5e-05)
    """
    options = model, path, damping, segments, tolerance, amplitude
    return written(CosseratBeam, "pyelastica", PYELASTICA_MARK, _script, *options)


PYELASTICA_MAPPING = (
    "Bending: 1/(int ds/(E I)) of the part of the beam about each node; at the clamp, a torque on the first element.",
    "Damping: alpha by AnalyticalLinearDamper, beta by torques between elements, eta1 and eta2 by forces on nodes.",
    "Not represented: motion out of the plane of x and y, and twist (their stiffnesses are not those of the beam);",
    "stretch and shear are softer than those of the beam, so that the step can be long.",
)


def _script(rod: CosseratBeam, found: ExportedBeam) -> str:
    """Return the script."""
    beam, (masses, line, turns), small = rod.beam, rod.masses, rod.discrete
    law = rod.law
    numbers = {
        "REST": small.rest.reshape(-1, 3),
        "MODES": rod.modes[1].T[:, 2::3],
        "MASSES": masses,
        "AIR": law.eta1 * line,
        "DRAG": DRAG_CONSTANT * law.eta2 * line,
        "TURNS": turns,
        "JOINTS": beam.stiffness,
        "NATURAL": beam.natural,
    }
    return f'''{PYELASTICA_MARK}{header(found, PYELASTICA_MAPPING)}
"""

import elastica as ea
import numpy as np

STEP = {found.step!r}  # s
LENGTH = {beam.length!r}  # of an element, m
ORIGIN = np.array([{beam.origin[0]!r}, {beam.origin[1]!r}, 0.0])
AXIS = {beam.axis!r}  # angle of the beam at its beginning, rad
GRAVITY = np.array([{beam.gravity[0]!r}, {beam.gravity[1]!r}, 0.0])
SHEAR, STRETCH = {rod.stiffness[0]!r}, {rod.stiffness[1]!r}  # stiffness, N
ALPHA, BETA = {law.alpha!r}, {law.beta!r}  # 1/s, s
AMPLITUDE = {found.amplitude!r}  # of the tip in mode 1 at the release, m
# REST: x, y of each node from the second on, and angle of the element before it; MODES: of angles, per m at the tip
{listed(numbers)}


class ClampSpring(ea.NoForces):
    """The spring of the clamp, which stands for the bending of half the first element too."""

    def apply_torques(self, system, time=0.0):
        x, y = system.director_collection[2, :2, 0]
        angle = np.arctan2(y, x) - AXIS - NATURAL[0]
        system.external_torques[0, 0] -= JOINTS[0] * (np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


class JointDamper(ea.DamperBase):
    """Dampers BETA times the stiffness of each joint, in implicit steps, which are stable."""

    def __init__(self, **keywords):
        super().__init__(**keywords)
        turns = np.eye(len(TURNS)) - np.eye(len(TURNS), k=-1)
        damping = turns.T @ (BETA * JOINTS[:, None] * turns)
        self.change = np.linalg.inv(np.eye(len(TURNS)) + STEP * damping / TURNS[:, None])

    def dampen_rates(self, system, time):
        system.omega_collection[0] = self.change @ system.omega_collection[0]


class Air(ea.NoForces):
    """Linear and quadratic drag."""

    def apply_forces(self, system, time=0.0):
        velocity = system.velocity_collection[:, 1:]
        system.external_forces[:, 1:] -= (AIR + DRAG * np.sqrt((velocity**2).sum(axis=0))) * velocity


class Held(ea.ConstraintBase):
    """The first node stays in place; its element may turn against the spring of the clamp."""

    def constrain_values(self, system, time):
        system.position_collection[:, 0] = ORIGIN

    def constrain_rates(self, system, time):
        system.velocity_collection[:, 0] = 0.0


class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """A simulator of one rod."""


def build(release=(AMPLITUDE, 0.0, 0.0)):
    """Return a simulator and its rod, deflected in the first modes by some amplitudes of the tip, m."""
    count = len(TURNS)
    rod = ea.CosseratRod.straight_rod(
        count, ORIGIN, np.array([np.cos(AXIS), np.sin(AXIS), 0.0]), np.array([0.0, 0.0, 1.0]), count * LENGTH,
        base_radius=LENGTH, density=1e3, youngs_modulus=1e9, shear_modulus=1e9,  # replaced below
    )
    rod.mass[1:] = MASSES
    rod.mass_second_moment_of_inertia[...] = TURNS * np.eye(3)[:, :, None]
    rod.inv_mass_second_moment_of_inertia[...] = np.eye(3)[:, :, None] / TURNS
    rod.shear_matrix[...] = np.diag([SHEAR, SHEAR, STRETCH])[:, :, None]
    rod.bend_matrix[...] = JOINTS[1:] * LENGTH * np.eye(3)[:, :, None]
    rod.rest_kappa[0] = NATURAL[1:] / LENGTH
    rest = REST[:, 2]
    angle = rest + np.tensordot(release, MODES, axes=1)
    cosine, sine, zero = np.cos(angle), np.sin(angle), 0.0 * angle
    moved = LENGTH * np.cumsum([cosine - np.cos(rest), sine - np.sin(rest)], axis=1)
    rod.position_collection[:2, 1:] = REST[:, :2].T + moved
    rod.director_collection[1] = sine, -cosine, zero
    rod.director_collection[2] = cosine, sine, zero
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(Held)
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=GRAVITY)
    simulator.add_forcing_to(rod).using(ClampSpring)
    if AIR.any() or DRAG.any():
        simulator.add_forcing_to(rod).using(Air)
    if ALPHA:
        simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=ALPHA, time_step=STEP)
    if BETA:
        simulator.dampen(rod).using(JointDamper)
    simulator.finalize()
    return simulator, rod


def run(duration, release=(AMPLITUDE, 0.0, 0.0), every=50):
    """Return time, x and y of the tip, s and m, at each ``every``-th step."""
    simulator, rod = build(release)
    stepper, time, samples = ea.PositionVerlet(), 0.0, []
    for k in range(round(duration / STEP) + 1):
        if k % every == 0:
            samples.append([time, *rod.position_collection[:2, -1]])
        time = stepper.step(simulator, time, STEP)
    return np.array(samples)


if __name__ == "__main__":
    np.savetxt("tip.csv", run(5.0), delimiter=",", header="time_s,tip_x_m,tip_y_m", comments="")
'''
