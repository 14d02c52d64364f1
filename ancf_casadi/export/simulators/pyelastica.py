"""The beam as a script of PyElastica: a Cosserat rod with point masses at its nodes.

    bending         at the node between two elements, the stiffness k_j of the joint; at the clamp, a torque k_0
    shear, stretch  12 E I/l^2 and 60 E I/l^2: far softer than a thin strip, so that steps can be long
    inertia         masses of the segments at the nodes; m l^2/12 for the rotation of each element
    damping         AnalyticalLinearDamper for alpha, an implicit damper for beta, forces on the nodes for eta1 and eta2

The masses at the nodes, the shear and the rotary inertia lower the frequency of a wave with the wavenumber kappa, each
by a multiple of (kappa l)^2, so this beam needs more segments than rigid bodies.  To the order of h, PositionVerlet
steps with these dampers are

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

from ancf_casadi.damping import DampingLaw
from ancf_casadi.export.simulators.segments import SmallMotion, linearise_at_equilibrium
from ancf_casadi.export.simulators.settings import ExportedBeam, SimulatorBeam, write_segments
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

SHEAR = 12.0  # shear stiffness per E I/l^2
STRETCH = 60.0  # per E I/l^2; less changes the bending of PyElastica's elements, more shortens the step


class CosseratBeam(SimulatorBeam):
    """The rod in PyElastica."""

    early = 0.5

    @cached_property
    def masses(self) -> tuple[Array, Array, Array]:
        """Masses of the nodes but the clamped one, with and without point masses, and inertias of the elements."""
        beam = self.beam
        beam_masses, point_masses = np.zeros(beam.count + 1), np.zeros(beam.count + 1)
        inertias = beam.masses * beam.length**2 / 12 + beam.section_inertias
        end_masses = beam.masses * beam.centres / beam.length
        beam_masses[1:] += end_masses
        beam_masses[:-1] += beam.masses - end_masses
        for segment, distance, point_mass in beam.point_masses:
            fraction = distance / beam.length
            point_masses[segment : segment + 2] += np.array([1.0 - fraction, fraction]) * point_mass.mass
            inertias[segment] += point_mass.rotary_inertia
        return (beam_masses + point_masses)[1:], beam_masses[1:], inertias

    @cached_property
    def stiffness(self) -> tuple[float, float]:
        """Stiffness in shear and stretch, N."""
        segment_stiffness = float(self.beam.stiffness[1:].max() / self.beam.length)
        return SHEAR * segment_stiffness, STRETCH * segment_stiffness

    @cached_property
    def small_motion(self) -> SmallMotion:
        """Small motion of the rod about its equilibrium."""
        beam, n = self.beam, self.beam.count
        q = cs.SX.sym("q", 3, n)
        nodes, theta = cs.horzcat(cs.DM(beam.origin), q[:2, :]), q[2, :].T
        turns = theta - cs.vertcat(beam.axis, theta[:-1])
        c, s = cs.cos(theta).T, cs.sin(theta).T
        dx, dy = cs.vertsplit((nodes[:, 1:] - nodes[:, :-1]) / beam.length)
        shear, stretch = self.stiffness
        elastic = beam.length / 2 * (shear * cs.sumsqr(c * dy - s * dx) + stretch * cs.sumsqr(c * dx + s * dy - 1))
        elastic += cs.dot(cs.DM(beam.stiffness), (turns - cs.DM(beam.natural_angles)) ** 2) / 2
        masses, _, inertias = self.masses
        angles = beam.small_motion().equilibrium
        positions = np.cumsum(np.column_stack([np.cos(angles), np.sin(angles)]) * beam.length, axis=0) + beam.origin
        node_inertias = np.column_stack([masses, masses, inertias]).ravel()
        guess = np.column_stack([positions, angles]).ravel()
        q, tip = cs.vec(q), nodes[:, -1]
        return linearise_at_equilibrium(q, q, node_inertias, turns, elastic, beam.gravity, tip, guess)

    @property
    def angles(self) -> Array:
        """Changes of the angles of the elements in the first modes, per m at the tip."""
        return np.asarray(self.modes[1].T[:, 2::3])

    def damping(self, mode: int) -> Array:
        """Return the damping matrix, with drag linearised at the amplitude of a mode."""
        drag = self.coefficients.drag * np.linalg.norm(self.drag_speeds(mode)[:, :2], axis=1)
        air = (self.coefficients.eta1 + drag) * self.masses[1]
        at_masses = self.coefficients.alpha * self.small_motion.inertias
        at_masses = at_masses + np.column_stack([air, air, 0.0 * air]).ravel()
        return self.small_motion.damping(at_masses, self.coefficients.beta * self.beam.stiffness)


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
    return write_segments(CosseratBeam, "pyelastica.py.jinja", model, path, damping, segments, tolerance, amplitude)
