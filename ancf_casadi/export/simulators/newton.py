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

from ancf_casadi.damping import DRAG_CONSTANT, DampingLaw
from ancf_casadi.export.simulators.result import ExportedBeam
from ancf_casadi.export.simulators.segments import SegmentedBeam
from ancf_casadi.export.simulators.settings import Segmented, header, listed, written
from ancf_casadi.export.simulators.small_motion import Discrete, drift, kick
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

NEWTON_MARK = '"""Written by ancf-casadi'


class LinkedBeam(Segmented):
    """The links in Newton."""

    @cached_property
    def links(self) -> SegmentedBeam:
        """The segments, each with the point masses that it carries."""
        beam = self.beam
        masses, centres, inertias = (own.copy() for own in (beam.masses, beam.centres, beam.inertias))
        for one in beam.carried:
            k = one.segment
            total, away = masses[k] + one.mass, one.distance - centres[k]
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
        return rates, DRAG_CONSTANT * law.eta2 * self.beam.masses, (law.alpha + law.eta1) * self.links.inertias

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag as for the amplitude of a mode."""
        rates, drag, turns = self.air
        size = rates + drag * np.linalg.norm(self.speeds(mode)[:, :2], axis=1)
        return self.discrete.damping(np.column_stack([size, size, turns]).ravel(), self.law.beta * self.beam.stiffness)

    def matrix(self, mode: int, step: float) -> Array:
        """Return the matrix of one step."""
        mass = self.discrete.mass
        kicked = kick(mass, mass - step * self.damping(mode), self.discrete.stiffness, step)
        return np.asarray(drift(len(mass), step) @ kicked)


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
    options = model, path, damping, segments, tolerance, amplitude
    return written(LinkedBeam, "newton", NEWTON_MARK, _script, *options)


NEWTON_MAPPING = (
    "Hinges: stiffness 1/(int ds/(E I)), damping beta times that.  Links: mass and inertia of their part of the beam.",
    "Forces of the air by a kernel: alpha, eta1, drag (eta2).  SolverFeatherstone, in single precision.",
    "Not represented: motion out of the plane of x and y, twist, stretching; shapes are without contact.",
)


def _script(links: LinkedBeam, found: ExportedBeam) -> str:
    """Return the script."""
    beam, law, (rates, drag, turns) = links.links, links.law, links.air
    rest, shapes = links.discrete.rest, links.modes[1]
    poses = [np.diff(angles, prepend=beam.axis) for angles in (rest, *(rest + shapes.T))]
    numbers = {
        "MASSES": beam.masses,
        "CENTRES": beam.centres,
        "INERTIAS": beam.inertias,
        "WIDTHS": beam.widths,
        "THICKNESSES": beam.thicknesses,
        "STIFFNESS": beam.stiffness,
        "NATURAL": beam.natural,
        "REST": poses[0],
        "MODES": np.array(poses[1:]) - poses[0],
        "RATES": rates,
        "DRAG": drag,
        "TURNS": turns,
    }
    return f'''{NEWTON_MARK}{header(found, NEWTON_MAPPING)}
"""

import newton
import numpy as np
import warp as wp

STEP = {found.step!r}  # s
LENGTH = {beam.length!r}  # of a link, m
ORIGIN = ({beam.origin[0]!r}, {beam.origin[1]!r}, 0.0)
AXIS = {beam.axis!r}  # angle of the beam at its beginning, rad
GRAVITY = ({beam.gravity[0]!r}, {beam.gravity[1]!r}, 0.0)
BETA = {law.beta!r}  # s
AMPLITUDE = {found.amplitude!r}  # of the tip in mode 1 at the release, m
# per link; angles of the hinges at rest (REST) and their changes in the first modes per m at the tip (MODES); forces of
# the air per velocity (RATES), per its square (DRAG), and moments per rate of turn (TURNS)
{listed(numbers)}


@wp.kernel
def air(
    velocities: wp.array(dtype=wp.spatial_vector),
    rates: wp.array(dtype=float),
    drag: wp.array(dtype=float),
    turns: wp.array(dtype=float),
    forces: wp.array(dtype=wp.spatial_vector),
):
    k = wp.tid()
    velocity = wp.spatial_top(velocities[k])
    size = rates[k] + drag[k] * wp.length(velocity)
    forces[k] = wp.spatial_vector(-size * velocity, -turns[k] * wp.spatial_bottom(velocities[k]))


def build(release=(AMPLITUDE, 0.0, 0.0)):
    """Return the model, deflected in the first modes by some amplitudes of the tip, m."""
    builder = newton.ModelBuilder()
    seen = newton.ModelBuilder.ShapeConfig(density=0.0, has_shape_collision=False, has_particle_collision=False)
    joints, parent = [], -1
    for k in range(len(MASSES)):
        m, b, h = MASSES[k], WIDTHS[k], THICKNESSES[k]
        along, across = m * (b**2 + h**2) / 12, INERTIAS[k] + m * (b**2 - h**2) / 12
        inertia = wp.mat33(along, 0.0, 0.0, 0.0, across, 0.0, 0.0, 0.0, INERTIAS[k])
        link = builder.add_link(com=(CENTRES[k], 0.0, 0.0), inertia=inertia, mass=m)
        middle = wp.transform(p=wp.vec3(LENGTH / 2, 0.0, 0.0), q=wp.quat_identity())
        builder.add_shape_box(link, xform=middle, hx=LENGTH / 2, hy=h / 2, hz=b / 2, cfg=seen)
        turn = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), AXIS if k == 0 else 0.0)
        joints.append(builder.add_joint_revolute(
            parent=parent, child=link, axis=wp.vec3(0.0, 0.0, 1.0),
            parent_xform=wp.transform(p=wp.vec3(*ORIGIN) if k == 0 else wp.vec3(LENGTH, 0.0, 0.0), q=turn),
            child_xform=wp.transform_identity(), stiffness=STIFFNESS[k], damping=BETA * STIFFNESS[k],
            rest_q=NATURAL[k], armature=0.0, friction=0.0, target_ke=0.0, target_kd=0.0,
        ))
        parent = link
    builder.add_articulation(joints)
    model = builder.finalize()
    model.set_gravity(GRAVITY)
    model.joint_q.assign(REST + np.tensordot(release, MODES, axes=1))
    return model


def run(duration, release=(AMPLITUDE, 0.0, 0.0), every=10):
    """Return time, x and y of the tip, s and m, at each ``every``-th step."""
    model = build(release)
    solver = newton.solvers.SolverFeatherstone(model, angular_damping=0.0)
    state, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    of_air = [wp.array(values, dtype=float) for values in (RATES, DRAG, TURNS)]
    samples = []
    for k in range(round(duration / STEP) + 1):
        if k % every == 0:
            x, y, _, _, _, sine, cosine = state.body_q.numpy()[-1].astype(float)[[0, 1, 2, 3, 4, 5, 6]]
            angle = 2 * np.arctan2(sine, cosine)
            samples.append([k * STEP, x + LENGTH * np.cos(angle), y + LENGTH * np.sin(angle)])
        state.clear_forces()
        wp.launch(air, dim=len(MASSES), inputs=[state.body_qd, *of_air, state.body_f])
        solver.step(state, after, control, None, STEP)
        state, after = after, state
    return np.array(samples)


if __name__ == "__main__":
    np.savetxt("tip.csv", run(5.0), delimiter=",", header="time_s,tip_x_m,tip_y_m", comments="")
'''
