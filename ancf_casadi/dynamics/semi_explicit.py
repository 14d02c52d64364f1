"""Scaled equation of motion for IDAS: a semi-explicit differential-algebraic equation with its exact Jacobian.

Form.  With the accelerations as algebraic unknowns, the Jacobian is as sparse as the mesh.  For the same reason, the
low-rank part R B diag(d) B^T R^T e_t of the damping force is written R B (d * w) with the further unknowns
w = B^T R^T e_t.

Scaling.  The unknowns are x = (displacement/S, v/(S W)) and z = (a/(S W^2), w/(L W)), with S the length L of the beam
for positions and 1/2 for slopes, and W the bending frequency of a single element.  One tolerance, relative to L, then
serves all unknowns.  Without the scaling, the noise that Newton's method leaves in the positions, divided by the step,
would become a velocity error that makes every other step fail.  The force balance is divided by diag(M) S W^2, so that
a sparse factorisation finds its pivots on the diagonal and stays within the band of the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import EXCITATION, Equations
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array


@dataclass(frozen=True, eq=False)
class SemiExplicit:
    """The scaled equation of motion with the accelerations as algebraic unknowns.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    """

    equations: Equations

    @cached_property
    def element_frequency(self) -> float:
        """W, the highest bending frequency of a single pinned element, pi^2 (E I/mu)^1/2/l^2, rad/s."""
        model = self.equations.model
        _, thickness, density, elastic_modulus = model.properties
        stiffness = np.sqrt(elastic_modulus / density) * thickness / math.sqrt(12)
        return float(math.pi**2 * stiffness.max() / model.beam.element_length**2)

    @cached_property
    def parameters(self) -> Array:
        """W, the divisors of the force balance diag(M) S W^2, and the parameters of the forces."""
        model = self.equations.model
        diagonal = model.mass(model.properties).sparse().diagonal()[model.free]
        divisors = diagonal * model.scale[model.free] * self.element_frequency**2
        return np.concatenate([[self.element_frequency], divisors, self.equations.parameters])

    @cached_property
    def residual(self) -> cs.Function:
        """(x, z, excitation, parameters) -> x_t, residual of the algebraic equations; differentiable in x and z."""
        inputs = self._symbols
        outputs = self._outputs(*inputs)
        names = ["x", "z", "excitation", "parameters"], ["x_t", "alg"]
        options: Any = {"is_diff_in": [True, True, False, False], "custom_jacobian": self._jacobian}
        options |= {"enable_forward": False, "enable_reverse": False}  # all derivatives come from the Jacobian
        return cs.Function("residual", list(inputs), [outputs.x_t, outputs.residual], *names, options)

    @cached_property
    def energetics(self) -> cs.Function:
        """(x, z, excitation, parameters) -> powers and reaction.

        The powers are those lost to damping, supplied by the base and supplied by the tip load, in watts; the reaction
        is the generalized force of the base on the clamped node, (4,).
        """
        inputs = self._symbols
        outputs = self._outputs(*inputs)
        options = {"is_diff_in": [False] * 4}
        return cs.Function("energetics", list(inputs), [outputs.powers, outputs.forces[:NODE]], options)

    def scaled(self, state: State) -> Array:
        """Return x of a state."""
        model = self.equations.model
        displacement = (state.coordinates - model.straight) / model.scale
        velocity = state.velocities / (model.scale * self.element_frequency)
        return np.concatenate([displacement[model.free], velocity[model.free]])

    def unscaled(self, x: Array, excitations: Array) -> tuple[Array, Array]:
        """Return all coordinates and velocities from x, (k, 2 N), and the excitations, (k, 15)."""
        model = self.equations.model
        displacement, velocities = np.split(x, 2, axis=-1)
        scale = model.scale[model.free]
        coordinates = model.straight[model.free] + scale * displacement
        position, velocity = excitations[..., :NODE], excitations[..., NODE : 2 * NODE]
        return np.hstack([position, coordinates]), np.hstack([velocity, scale * self.element_frequency * velocities])

    @cached_property
    def _jacobian(self) -> cs.Function:
        """The Jacobian of ``residual``, assembled block by block.

        Because of the dense rows and columns of B, CasADi alone would compute all other columns one at a time.
        """
        x, z, excitation, parameters = self._symbols
        model, free, m = self.equations.model, self.equations.free, self.equations.projection.shape[1]
        W, divisors, rest = cs.vertsplit(parameters, [0, 1, 1 + free, parameters.numel()])
        balance, scale = self.equations.balance(rest), cs.MX(cs.DM(model.scale[model.free]))
        e, e_t = self._coordinates(x, W, excitation)
        tangents = balance.tangents(e, e_t, excitation[3 * NODE :])
        k, d, mass = (model.matrix(values, NODE) for values in tangents)
        length, B, identity = model.beam.length, balance.turned_projection(e)[NODE:, :], cs.DM.eye(free)
        none = cs.DM(free, free)
        w_by_v, by_w = _scaled(B.T, cs.MX.ones(m) / length, scale), balance.modal_coefficients * length * W
        jacobians = [
            cs.horzcat(cs.DM(2 * free, free), cs.vertcat(W * identity, none)),
            cs.horzcat(cs.vertcat(none, W * identity), cs.DM(2 * free, m)),
            cs.MX(2 * free, excitation.numel()),
            cs.MX(2 * free, parameters.numel()),
            cs.vertcat(
                cs.horzcat(_scaled(k, 1 / divisors, scale), _scaled(d, 1 / divisors, scale * W)),
                cs.horzcat(cs.MX(m, free), w_by_v),
            ),
            cs.vertcat(
                cs.horzcat(_scaled(mass, 1 / divisors, scale * W**2), _scaled(B, 1 / divisors, by_w)),
                cs.horzcat(cs.MX(m, free), -cs.DM.eye(m)),
            ),
            cs.MX(free + m, excitation.numel()),
            cs.MX(free + m, parameters.numel()),
        ]
        unused = [cs.MX.sym("out_x_t", cs.Sparsity(2 * free, 1)), cs.MX.sym("out_alg", cs.Sparsity(free + m, 1))]
        ins = ["x", "z", "excitation", "parameters", "out_x_t", "out_alg"]
        outs = [f"jac_{of}_{by}" for of in ("x_t", "alg") for by in ins[:4]]
        return cs.Function("jac_residual", [x, z, excitation, parameters, *unused], jacobians, ins, outs)

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX, cs.MX]:
        free, m = self.equations.free, self.equations.projection.shape[1]
        sizes = {"x": 2 * free, "z": free + m, "excitation": EXCITATION, "parameters": self.parameters.size}
        x, z, excitation, parameters = (cs.MX.sym(name, size) for name, size in sizes.items())
        return x, z, excitation, parameters

    def _coordinates(self, x: cs.MX, W: cs.MX, excitation: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return e and e_t."""
        model, free = self.equations.model, self.equations.free
        scale = model.scale[model.free]
        q, v = model.straight[model.free] + scale * x[:free], scale * W * x[free:]
        return cs.vertcat(excitation[:NODE], q), cs.vertcat(excitation[NODE : 2 * NODE], v)

    def _outputs(self, x: cs.MX, z: cs.MX, excitation: cs.MX, parameters: cs.MX) -> _Expressions:
        """Write the equation of motion in the scaled unknowns."""
        model, free = self.equations.model, self.equations.free
        W, divisors, rest = cs.vertsplit(parameters, [0, 1, 1 + free, parameters.numel()])
        balance, scale = self.equations.balance(rest), model.scale[model.free]
        e, e_t = self._coordinates(x, W, excitation)
        a, w = scale * W**2 * z[:free], model.beam.length * W * z[free:]
        _, velocity, acceleration, load = cs.vertsplit(excitation, NODE)
        forces, lost, supplied = balance.local(e, e_t, cs.vertcat(acceleration, a), load)
        if w.numel():
            modal = balance.modal_damping(e, w)
            forces, lost = forces + modal, lost + cs.dot(e_t, modal)
        modal_residual = (balance.modal_velocities(e, e_t) - w) / (model.beam.length * W)
        return _Expressions(
            x_t=cs.vertcat(W * x[free:], W * z[:free]),
            forces=forces,
            residual=cs.vertcat(forces[model.free] / divisors, modal_residual),
            powers=cs.vertcat(lost, cs.dot(velocity, forces[:NODE]), supplied),
        )


@dataclass(frozen=True)
class _Expressions:
    """The equation of motion: x_t, forces at all nodes, residual of the algebraic equations, powers."""

    x_t: cs.MX
    forces: cs.MX
    residual: cs.MX
    powers: cs.MX


def _scaled(matrix: cs.MX, left: cs.MX, right: cs.MX) -> cs.MX:
    """Return diag(left) matrix diag(right)."""
    rows, columns = matrix.sparsity().get_triplet()
    factors = cs.vec(cs.MX(left)[rows]) * cs.vec(cs.MX(right)[columns])
    return cs.MX(matrix.sparsity(), cs.vec(matrix.nz[:]) * factors)
