"""The equation of motion as the integrators use it: its terms, its parameters, and the motion of the clamped node.

The free coordinates q, their rates v and accelerations a obey

    q_t = v,    v_t = a,    0 = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g   (free rows),

in which the clamped node carries the base motion: its position, velocity and acceleration enter e, e_t and e_tt.  The
rows of the clamped node give the generalized force of the base on it.

A damping force is a local part, as sparse as the mesh, and a part R B diag(d) B^T R^T e_t of low rank, which turns with
the clamp (``damping.turning``), and which each integrator treats in its own way to keep its matrices sparse.

Gravity, the properties of the elements, the parameters of the law and B are inputs, so that one compiled program serves
all beams of a mesh and all values of a law's parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.turning import turned
from ancf_casadi.excitation import BaseMotion, Piece
from ancf_casadi.model import NODE, Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Equations:
    """The equation of motion of a beam under a damping law.

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
    def parameters(self) -> Array:
        """What the forces depend on besides the motion: gravity, properties, the law's parameters, B."""
        values = [value for _, value in self.law.parameters]
        parts = [self.model.beam.gravity, self.model.properties.T.ravel(), values, self.projection.T.ravel()]
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])

    def balance(self, parameters: cs.MX) -> Balance:
        """Return the terms of the equation of motion for (symbolic) parameters, laid out as ``parameters`` is."""
        model, law = self.model, self.law
        sizes = [2, model.properties.size, len(law.parameters), self.projection.size]
        gravity, properties, own, projection = cs.vertsplit(parameters, np.cumsum([0, *sizes]).tolist())
        return Balance(
            model=model,
            law=law,
            gravity=gravity,
            properties=cs.reshape(properties, *model.properties.shape),
            own=own,
            projection=cs.reshape(projection, *self.projection.shape),
        )

    @cached_property
    def tangents(self) -> cs.Function:
        """(e, e_t, parameters) -> K = d(Q_damp + Q_e)/de, D = dQ_damp/de_t and M of the free coordinates, sparse.

        K and D are without the part R B diag(d) B^T R^T e_t of the damping force.
        """
        e, e_t = cs.MX.sym("e", self.model.size), cs.MX.sym("e_t", self.model.size)
        parameters, free = cs.MX.sym("parameters", self.parameters.size), self.model.free
        balance = self.balance(parameters)
        damping = balance.local_damping(e, e_t)[free]
        k = self.model.tangent_stiffness(e, balance.properties)[free, free] + cs.jacobian(damping, e)[:, free]
        d, m = cs.jacobian(damping, e_t)[:, free], cs.jacobian(balance.inertia(e_t), e_t)[free, free]
        return cs.Function("tangents", [e, e_t, parameters], [k, d, m])

    @cached_property
    def turned_projection(self) -> cs.Function:
        """(clamped node (12,)) -> R B of the free coordinates, (4 n, m)."""
        node = cs.MX.sym("node", 3 * NODE)
        B = turned(cs.MX(cs.DM(self.projection)), self.model.beam.axis, node[2:NODE])
        return cs.Function("turned_projection", [node], [B[self.model.free, :]])

    def clamp(self, piece: Piece, base: BaseMotion) -> cs.Function:
        """(t) -> position, velocity and acceleration of the clamped node, (12,)."""
        t = cs.MX.sym("t")
        node = clamped_node(self.model, piece, t, cs.MX(cs.DM([value for _, value in base.parameters])))
        return cs.Function("clamp", [t], [node])


@dataclass(frozen=True, eq=False)
class Balance:
    """The terms of the equation of motion, as functions of the motion of all nodes.

    Parameters
    ----------
    model, law
        Beam and damping law.
    gravity, properties, own, projection : MX
        Acceleration of gravity (2,), properties P (4, n), the law's parameters, and B (4 n + 4, m) as modelled.
    """

    model: Model
    law: DampingLaw
    gravity: cs.MX
    properties: cs.MX
    own: cs.MX
    projection: cs.MX

    @property
    def rates(self) -> cs.MX:
        """Rates d of the part R B diag(d) B^T R^T e_t of the damping force, 1/s."""
        return self.law.rates(self.own)

    def local_damping(self, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the local part of the damping force."""
        return self.law.local_force(self.model, e, e_t, self.properties, self.own)

    def turned_projection(self, e: cs.MX) -> cs.MX:
        """Return R B, which has turned with the clamp from the beam's axis."""
        return turned(self.projection, self.model.beam.axis, e[2:NODE])

    def modal_rates(self, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return B^T R^T e_t."""
        return self.projection.T @ turned(e_t, e[2:NODE], self.model.beam.axis)

    def modal_damping(self, e: cs.MX, modal_rates: cs.MX) -> cs.MX:
        """Return R B diag(d) w, the part of low rank of the damping force, with the modal rates w."""
        return turned(self.projection @ (self.rates * modal_rates), self.model.beam.axis, e[2:NODE])

    def damping(self, e: cs.MX, e_t: cs.MX) -> cs.MX:
        """Return the damping force."""
        return self.local_damping(e, e_t) + self.modal_damping(e, self.modal_rates(e, e_t))

    def inertia(self, e_tt: cs.MX) -> cs.MX:
        """Return M e_tt."""
        return self.model.inertia_force(e_tt, self.properties)

    def conservative(self, e: cs.MX) -> cs.MX:
        """Return Q_e - Q_g."""
        return self.model.elastic_force(e, self.properties) - self.model.gravity_force(self.properties, self.gravity)


def clamped_node(model: Model, piece: Piece, t: cs.MX, parameters: cs.MX) -> cs.MX:
    """Return position, velocity and acceleration of the clamped node, (12,), in a piece of a base motion at time t."""
    x, y, angle = cs.vertsplit(cs.densify(piece.motion(t, parameters)))
    ax, ay = model.beam.axis
    node = cs.vertcat(x, y, cs.cos(angle) * ax - cs.sin(angle) * ay, cs.sin(angle) * ax + cs.cos(angle) * ay)
    velocity = cs.densify(cs.jacobian(node, t))
    acceleration = cs.densify(cs.jacobian(velocity, t))
    return cs.vertcat(node, velocity, acceleration)
