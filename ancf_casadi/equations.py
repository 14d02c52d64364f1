"""The equations of motion as IDAS sees them: scaled, semi-explicit and sparse.

The free coordinates q, their rates v and accelerations a form the system

    q_t = v,    v_t = a,    0 = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g   (free rows),

in which the clamped node carries the base motion: its position, velocity and acceleration enter e, e_t and e_tt.  With
the accelerations as algebraic unknowns the Jacobian stays as sparse as the mesh; the part B diag(d) B^T e_t of a
damping force is written B (d * w) with the further unknowns w = B^T e_t for the same reason.

Scaling.  The unknowns are x = ((q - q_straight)/L, v/(L W)) and z = (a/(L W^2), w/(L W)), with the beam's length L and
the bending frequency W of a single element.  One tolerance, relative to L, then serves them all, and the noise that
Newton's method leaves in the positions is not divided by the step into a velocity error that fails every other step.
The balance of forces is divided by diag(M) L W^2; a sparse factorisation then finds its pivots on the diagonal, where
they leave the band of the mesh alone.

Time.  A stretch of time is t = start + span s with s from 0 to 1; start and span are parameters, so that one function
serves all stretches.

Energy.  The power of the base, the force on the clamped node times its velocity, and the power lost to damping are
integrated along, so that every motion can be held against its balance of energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.damping import DampingLaw
from ancf_casadi.excitation import BaseMotion, Piece
from ancf_casadi.model import NODE, Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of motion of a beam under a damping law.

    Parameters
    ----------
    model : Model
        The beam.
    law : DampingLaw
        The damping law.
    """

    model: Model
    law: DampingLaw

    @property
    def free(self) -> int:
        """Number of free coordinates."""
        return self.model.size - NODE

    @cached_property
    def projection(self) -> Array:
        """B of the damping law, (4 n + 4, m)."""
        return self.law.projection(self.model)

    @cached_property
    def rate(self) -> float:
        """W, the highest bending frequency of a single pinned element, pi^2 (E I/mu)^1/2/l^2, rad/s."""
        _, thickness, density, elastic_modulus = self.model.properties
        stiffness = np.sqrt(elastic_modulus / density) * thickness / math.sqrt(12)
        return float(math.pi**2 * stiffness.max() / self.model.beam.element_length**2)

    @cached_property
    def weights(self) -> Array:
        """What the force balance is divided by, diag(M) L W^2 of the free coordinates."""
        diagonal = self.model.mass(self.model.properties).sparse().diagonal()[self.model.free]
        return np.asarray(diagonal * self.model.beam.length * self.rate**2)

    @cached_property
    def parameters(self) -> Array:
        """What the equations depend on besides time: W, weights, gravity, properties, the law's parameters, B."""
        values = [value for _, value in self.law.parameters]
        parts = [
            [self.rate],
            self.weights,
            self.model.beam.gravity,
            self.model.properties.T.ravel(),
            values,
            self.projection.T.ravel(),
        ]
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])

    @cached_property
    def residual(self) -> cs.Function:
        """(x, z, clamp, parameters) -> x_t and the residual of z; differentiable in x and z.

        ``clamp`` is the clamped node's position, velocity and acceleration, (12,).
        """
        return self._function("residual", lambda b: [b.x_t, b.remainder], differentiable=True)

    @cached_property
    def energetics(self) -> cs.Function:
        """(x, z, clamp, parameters) -> powers and reaction.

        The powers are those lost to damping and put in by the base, W; the reaction is the generalized force of the
        base on the clamped node, (4,).
        """
        return self._function("energetics", lambda b: [b.powers, b.forces[:NODE]], differentiable=False)

    def _function(self, name: str, outputs: Callable[[_Balance], list[cs.MX]], *, differentiable: bool) -> cs.Function:
        x, z = cs.MX.sym("x", 2 * self.free), cs.MX.sym("z", self.free + self.projection.shape[1])
        clamp, parameters = cs.MX.sym("clamp", 3 * NODE), cs.MX.sym("parameters", self.parameters.size)
        balance = self._balance(x, z, clamp, parameters)
        options = {"is_diff_in": [differentiable, differentiable, False, False]}
        return cs.Function(name, [x, z, clamp, parameters], outputs(balance), options)

    def _balance(self, x: cs.MX, z: cs.MX, clamp: cs.MX, parameters: cs.MX) -> _Balance:
        """Write the equation of motion."""
        model, law, free = self.model, self.law, self.free
        length, m = model.beam.length, self.projection.shape[1]
        sizes = [1, free, 2, model.properties.size, len(law.parameters), model.size * m]
        rate, weights, gravity, properties, own, projection = cs.vertsplit(parameters, np.cumsum([0, *sizes]).tolist())
        p = cs.reshape(properties, *model.properties.shape)
        B = cs.reshape(projection, model.size, m)

        q, v = model.straight[model.free] + length * x[:free], length * rate * x[free:]
        a, w = length * rate**2 * z[:free], length * rate * z[free:]
        position, velocity, acceleration = cs.vertsplit(clamp, NODE)
        e, e_t, e_tt = cs.vertcat(position, q), cs.vertcat(velocity, v), cs.vertcat(acceleration, a)
        damping = law.local_force(model, e, e_t, p, own) + B @ (law.rates(own) * w)
        inner = model.inertia_force(e_tt, p) + model.elastic_force(e, p)
        forces = inner + damping - model.gravity_force(p, gravity)
        return _Balance(
            x_t=cs.vertcat(v / length, a / (length * rate)),
            forces=forces,
            remainder=cs.vertcat(forces[model.free] / weights, (B.T @ e_t - w) / (length * rate)),
            powers=cs.vertcat(cs.dot(e_t, damping), cs.dot(velocity, forces[:NODE])),
        )

    def clamp(self, piece: Piece, base: BaseMotion) -> cs.Function:
        """(t) -> position, velocity and acceleration of the clamped node, (12,)."""
        t = cs.MX.sym("t")
        values = cs.MX(cs.DM([value for _, value in base.parameters]))
        x, y, angle = cs.vertsplit(cs.densify(piece.motion(t, values)))
        ax, ay = self.model.beam.axis
        node = cs.vertcat(x, y, cs.cos(angle) * ax - cs.sin(angle) * ay, cs.sin(angle) * ax + cs.cos(angle) * ay)
        velocity = cs.densify(cs.jacobian(node, t))
        acceleration = cs.densify(cs.jacobian(velocity, t))
        return cs.Function("clamp", [t], [cs.vertcat(node, velocity, acceleration)])

    def scaled(self, coordinates: Array, velocities: Array) -> Array:
        """Return x from the free coordinates and their rates."""
        length = self.model.beam.length
        displacement = (coordinates - self.model.straight[self.model.free]) / length
        return np.concatenate([displacement, velocities / (length * self.rate)])

    def unscaled(self, x: Array) -> tuple[Array, Array]:
        """Return the free coordinates and their rates from x, (2 N,) or (k, 2 N)."""
        length = self.model.beam.length
        displacement, velocities = np.split(x, 2, axis=-1)
        return self.model.straight[self.model.free] + length * displacement, length * self.rate * velocities

    def kinetic_energy(self, x: Array, clamp: Array) -> float:
        """Return T of a state x (2 N,) with a clamped node (12,), J."""
        rates = np.concatenate([clamp[NODE : 2 * NODE], self.unscaled(x)[1]])
        return float(rates @ (self.model.mass(self.model.properties).sparse() @ rates) / 2)


@dataclass(frozen=True)
class _Balance:
    """The symbols of the equation of motion: rates of x, forces at all nodes, residual of z, powers."""

    x_t: cs.MX
    forces: cs.MX
    remainder: cs.MX
    powers: cs.MX
