"""The full beam and the reduced beam as second-order systems (``system``).

Full beam.  The coordinates are those of the free nodes, and R is Eq. (6) with damping in their rows.  The rows of the
clamped node give the force of the base, whose power is supplied to the beam.

Reduced beam.  The coordinates are modal (``reduction``).  Its expressions take all samples at once, so that each
operation is a product of matrices; the derivatives follow column by column, for all samples together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, Parameter
from ancf_casadi.dynamics.equations import Balance, Equations
from ancf_casadi.dynamics.signals import Signal, parameter_signals
from ancf_casadi.dynamics.tip_load import tip_force
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.reduction.forces import BASE_SIZE, ReducedMotion
from ancf_casadi.reduction.reduced import ReducedModel
from ancf_casadi.response.systems.drive import BEAM_EXCITATION
from ancf_casadi.response.systems.system import (
    KEPT_FUNCTIONS,
    SampledFunctions,
    SecondOrderSystem,
    dense_entries,
    several,
)
from ancf_casadi.response.systems.turning import Turning
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.compilation import compiled
from ancf_casadi.vibration.equilibrium import static_equilibrium

KEPT = 8  # systems whose Functions are kept
STRAIGHT = 1e-9  # of the length of the beam, or of a direction


@lru_cache(maxsize=KEPT)
def full_system(model: Model, law: DampingLaw) -> SecondOrderSystem:
    """Return the full beam under a damping law as a second-order system.

    Its parameters are gravity, the properties of each element in turn, and the parameters of the law.

    Raises
    ------
    EquilibriumError
        If there is no equilibrium under gravity.
    """
    rest = static_equilibrium(model).coordinates[NODE:]
    return SecondOrderSystem(
        functions=partial(_full_functions, model, law),
        entries=_one_sample(model, law)[0],
        parameters=parameters_of(parameter_signals(Equations(model, law)), law),
        excitation=BEAM_EXCITATION,
        rest=rest,
        scale=model.scale[NODE:],
        mirror=_mirror(model, rest),
        corrections=Turning.of(model),
    )


@lru_cache(maxsize=KEPT_FUNCTIONS)
def _full_functions(model: Model, law: DampingLaw, samples: int) -> SampledFunctions:
    return several(samples, *_one_sample(model, law)[1])


@lru_cache(maxsize=KEPT)
def _one_sample(model: Model, law: DampingLaw) -> tuple[tuple[Index, Index], SampledFunctions]:
    """Return rows and columns of the entries of the matrices, and the Functions of one sample."""
    motion = FullMotion.of(Equations(model, law, compiled))
    symbols, names = motion.symbols, ["q", "v", "a", "u", "p"]
    plain = FullMotion(Equations(model, law), *symbols)
    directions = [cs.MX.sym(name, BEAM_EXCITATION) for name in ("u_1", "u_2")]
    entries, matrices, by_excitation = motion.tangents
    driven = [by_excitation @ direction for direction in directions]
    balance, differentiable = (
        cs.Function("balance", symbols, [one.forces[NODE:]], names, ["R"]) for one in (motion, plain)
    )
    tangents = cs.Function("tangents", [*symbols, *directions], [cs.densify(part) for part in (*matrices, *driven)],
                           [*names, "u_1", "u_2"], ["K", "D", "M", "R_1", "R_2"])  # fmt: skip
    powers = cs.Function("powers", symbols, [*motion.powers], names, ["lost", "supplied"])
    return entries, SampledFunctions(balance, tangents, powers, differentiable)


def base_force(model: Model, law: DampingLaw) -> cs.Function:
    """Return the Function of q, v, a, u and p that gives the force of the base on the clamped node, (4,)."""
    motion = FullMotion.of(Equations(model, law))
    return cs.Function("base_force", motion.symbols, [motion.forces[:NODE]])


@lru_cache(maxsize=KEPT)
def reduced_system(reduced: ReducedModel) -> SecondOrderSystem:
    """Return a reduced model as a second-order system.

    Its parameters are gravity and the parameters of the law.  The clamp may move but not rotate.
    """
    m, model, projection = reduced.count, reduced.model, reduced.projection
    rest = reduced.modes.equilibrium.coordinates[NODE:]
    return SecondOrderSystem(
        functions=partial(_reduced_functions, reduced),
        entries=dense_entries(m),
        parameters=parameters_of(reduced.parameters, reduced.law),
        excitation=BEAM_EXCITATION,
        rest=np.zeros(m),
        scale=np.full(m, model.beam.length * np.sqrt(projection.total_mass)),
        mirror=np.full(m, -1.0 if _across(model, rest).max() <= STRAIGHT else 1.0),
    )


@lru_cache(maxsize=KEPT_FUNCTIONS)
def _reduced_functions(reduced: ReducedModel, samples: int) -> SampledFunctions:
    m, law, model, projection = reduced.count, reduced.law, reduced.model, reduced.projection
    q, v, a = coordinates = [cs.MX.sym(name, m, samples) for name in ("q", "v", "a")]
    u, p = cs.MX.sym("u", BEAM_EXCITATION, samples), cs.MX.sym("p", len(reduced.parameters))
    directions = [cs.MX.sym(name, BEAM_EXCITATION, samples) for name in ("u_1", "u_2")]
    motion = ReducedMotion(projection, q, v, u[:BASE_SIZE, :], gravity=p[:2])
    damping, tip = motion.damping(law, p[2:], model), motion.tip_force(u[BASE_SIZE:, :])
    forces = motion.undamped_forces(a) + damping - tip
    velocity, balance = cs.vertcat(v, u[3:5, :]), forces[:m, :]
    supplied = cs.sum1(u[3:5, :] * forces[m:, :]) + cs.sum1(velocity * tip)
    rows = [cs.DM.zeros(m, samples) for _ in range(m)]
    for k, row in enumerate(rows):
        row[k, :] = 1.0
    matrices = [cs.vertcat(*(cs.jtimes(balance, own, row) for row in rows)) for own in coordinates]
    driven = [cs.jtimes(balance, u, direction) for direction in directions]
    symbols, names = [*coordinates, u, p], ["q", "v", "a", "u", "p"]
    plain = cs.Function("balance", symbols, [balance], names, ["R"], {"cse": True})
    return SampledFunctions(
        plain,
        cs.Function("tangents", [*symbols, *directions], [*matrices, *driven], [*names, "u_1", "u_2"],
                    ["K", "D", "M", "R_1", "R_2"], {"cse": True}),
        cs.Function("powers", symbols, [cs.sum1(velocity * damping), supplied], names, ["lost", "supplied"]),
        plain,
    )  # fmt: skip


def _across(model: Model, rest: Array) -> Array:
    """Return the distances of the nodes at rest from the axis, m, and the sine of the angle from it to gravity."""
    ax, ay = model.beam.axis
    x, y = rest.reshape(-1, 2).T
    gravity = model.beam.gravity
    size = np.hypot(*gravity) or 1.0
    return np.append(np.abs(ax * y - ay * x), abs(ax * gravity[1] - ay * gravity[0]) / size)


def _mirror(model: Model, rest: Array) -> Array:
    """Return the signs of free nodal coordinates mirrored in the axis: -1 across it, if it is x or y; else ones."""
    ax, ay = np.abs(model.beam.axis)
    if min(ax, ay) > STRAIGHT or _across(model, rest).max() > STRAIGHT:
        return np.ones(len(rest))
    return np.tile([1.0, -1.0] if ax > ay else [-1.0, 1.0], len(rest) // 2)


def parameters_of(signals: Sequence[Signal], law: DampingLaw) -> tuple[Parameter, ...]:
    """Return the parameters of an exported model as parameters of a system, with the bounds of the law."""
    bounds = {"gravity_x": (-math.inf, math.inf), "gravity_y": (-math.inf, math.inf)}
    bounds |= {own.name: (own.lower, own.upper) for own in law.parameters}
    return tuple(
        Parameter(own.name, own.value, own.unit, own.description, *bounds.get(own.name, (0.0, math.inf)))
        for own in signals
    )


@dataclass(frozen=True, eq=False)
class FullMotion:
    """A motion of the full beam, and its forces.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    q, v, a : MX
        Free coordinates, their velocities and accelerations.
    u : MX
        Excitation, (12,).
    p : MX
        Gravity, properties of the elements and parameters of the law.
    """

    equations: Equations
    q: cs.MX
    v: cs.MX
    a: cs.MX
    u: cs.MX
    p: cs.MX

    @staticmethod
    def of(equations: Equations) -> FullMotion:
        """Return a motion of symbols."""
        free, parameters = equations.free, len(parameter_signals(equations))
        sizes = {"q": free, "v": free, "a": free, "u": BEAM_EXCITATION, "p": parameters}
        return FullMotion(equations, *(cs.MX.sym(name, size) for name, size in sizes.items()))

    @property
    def symbols(self) -> list[cs.MX]:
        """Coordinates, velocities, accelerations, excitation and parameters."""
        return [self.q, self.v, self.a, self.u, self.p]

    @cached_property
    def balance(self) -> Balance:
        """The terms of the equation of motion."""
        return self.equations.balance_for(self.p)

    @cached_property
    def clamped(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        """Position, velocity and acceleration of the clamped node, each (4,)."""
        ax, ay = self.equations.model.beam.axis
        angle, rate, acceleration = self.u[2], self.u[5], self.u[8]
        slope = cs.vertcat(cs.cos(angle) * ax - cs.sin(angle) * ay, cs.sin(angle) * ax + cs.cos(angle) * ay)
        turned = cs.vertcat(-slope[1], slope[0])
        return (
            cs.vertcat(self.u[:2], slope),
            cs.vertcat(self.u[3:5], rate * turned),
            cs.vertcat(self.u[6:8], acceleration * turned - rate**2 * slope),
        )

    @cached_property
    def nodes(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        """Coordinates e, velocities e_t and accelerations e_tt of all nodes, each (4 n + 4,)."""
        e, e_t, e_tt = (cs.vertcat(*pair) for pair in zip(self.clamped, (self.q, self.v, self.a), strict=True))
        return e, e_t, e_tt

    @cached_property
    def low_rank(self) -> cs.MX:
        """The low-rank part of the damping force, (4 n + 4,)."""
        return self.balance.of_low_rank(*self.nodes[:2])

    @cached_property
    def local(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        """All other forces, (4 n + 4,), and the powers lost to local damping and supplied at the tip."""
        return self.balance.local(*self.nodes, self.u[BASE_SIZE:])

    @property
    def forces(self) -> cs.MX:
        """The left side of the equation of motion, (4 n + 4,); its first four rows are the force of the base."""
        return self.local[0] + self.low_rank

    @property
    def powers(self) -> tuple[cs.MX, cs.MX]:
        """The power lost to damping, and the power supplied at the base and the tip, W."""
        _, lost, supplied = self.local
        base = cs.dot(self.clamped[1], self.forces[:NODE])
        return lost + cs.dot(self.nodes[1], self.low_rank), supplied + base

    @property
    def tangents(self) -> tuple[tuple[Index, Index], list[cs.MX], cs.MX]:
        """Rows and columns of the entries of K, D and M; these entries; and U."""
        model, (e, e_t, _), load = self.equations.model, self.nodes, self.u[BASE_SIZE:]
        K, D, M = (model.matrix(entries) for entries in self.balance.tangents(e, e_t, load))
        B = self.balance.turned_projection(e)
        if B.shape[1]:
            D += B @ cs.diag(self.balance.modal_coefficients) @ B.T
        by_clamped = cs.MX.zeros(model.size - NODE, BEAM_EXCITATION)
        for matrix, part in zip((K, D, M), self.clamped, strict=True):
            by_clamped += matrix[NODE:, :NODE] @ cs.jacobian(part, self.u)
        at_tip = cs.vertcat(
            cs.MX.zeros(model.size - 2 * NODE, BEAM_EXCITATION), cs.jacobian(tip_force(e, load), self.u)
        )
        free = [matrix[NODE:, NODE:] for matrix in (K, D, M)]
        pattern = free[0].sparsity() + free[1].sparsity()
        entries = [cs.project(matrix, pattern).nz[:] for matrix in free]
        return (np.array(pattern.row()), np.array(pattern.get_col())), entries, by_clamped - at_tip
