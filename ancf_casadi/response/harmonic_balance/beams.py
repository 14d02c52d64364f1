"""The full beam and the reduced beam as second-order systems (``system``).

Full beam.  The coordinates are the free ones, e = N q + G b (``mechanics.model``), and R = N^T Q is Eq. (6) with
damping.  G^T Q is the force of the base, whose power is supplied to the beam.

Reduced beam.  The coordinates are modal (``reduction``).  Its expressions take all samples at once, so that each
operation is a product of matrices; the derivatives follow column by column, for all samples together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.damping import DampingLaw, Parameter
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.placed_load import LOAD_SIZE, TIP, load_force
from ancf_casadi.dynamics.signals import Signal, parameter_signals
from ancf_casadi.mechanics.attachments import Dashpot, Spring
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.reduction.forces import BASE_SIZE, Expression
from ancf_casadi.reduction.reduced import Reduction, reduced_motion, reduced_parameters
from ancf_casadi.response.harmonic_balance.system import (
    BEAM_EXCITATION,
    CACHED_FUNCTIONS,
    SampledFunctions,
    SecondOrderSystem,
    dense_entries,
    map_samples,
)
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.compilation import compile_together
from ancf_casadi.support.last_calls import keep_last
from ancf_casadi.vibration.statics import static_equilibrium

GRAVITY_SIZE = 2  # first parameters of a beam, which do not vary
CACHED_SYSTEMS = 8  # systems whose Functions are kept
SUPPORT_CORRECTIONS = 3  # iterations that take turned slopes back to the supports
STRETCHING = 0.01  # stretch of a slope by a force, relative to its turn by a moment; 1 and 1e-6 need more iterations
STRAIGHT = 1e-9  # of the length of the beam, or of a direction


@keep_last(CACHED_SYSTEMS)
def full_system(model: Model, law: DampingLaw, place: PointLoad = TIP) -> SecondOrderSystem:
    """Return the full beam under a damping law, with a load at a place, as a second-order system.

    Its parameters are gravity, the properties of each element in turn, and the parameters of the law.
    """
    equilibrium = static_equilibrium(model, loads=law.loads(model.beam)).coordinates
    return SecondOrderSystem(
        functions=partial(_full_functions, model, law, place),
        entries=_one_sample(model, law, place)[0],
        parameters=system_parameters(parameter_signals(Equations(model, law)), law),
        excitation=BEAM_EXCITATION,
        rest=model.of_free(equilibrium),
        scale=model.free_scale,
        mirror=_mirror(model, law, equilibrium),
        corrections=SlopeCorrections.of(model),
    )


def _full_functions(model: Model, law: DampingLaw, place: PointLoad, samples: int) -> SampledFunctions:
    return map_samples(_one_sample(model, law, place)[1], samples)


@keep_last(CACHED_SYSTEMS)
def _one_sample(model: Model, law: DampingLaw, place: PointLoad) -> tuple[tuple[Index, Index], SampledFunctions]:
    """Return rows and columns of the entries of the matrices, and the Functions of one sample."""
    equations = Equations(model, law, compile_together, place)
    *_, u, p = symbols = _symbols(equations)
    forces, powers, (e, e_t, _) = _full_motion(equations, symbols)
    differentiable_forces, *_ = _full_motion(Equations(model, law, place=place), symbols)
    directions = [cs.MX.sym(name, BEAM_EXCITATION) for name in ("u_1", "u_2")]
    balance, load = equations.balance_for(p), u[BASE_SIZE:]
    K, D, M = (model.matrix(entries) for entries in balance.tangents(e, e_t, load))
    B = balance.turned_projection(e)
    if B.shape[1]:
        D += B @ cs.diag(balance.modal_coefficients) @ B.T
    base_columns = [cs.horzcat(model.of_base(matrix.T)[:2, :].T, cs.MX(model.size, 1)) for matrix in (K, D, M)]
    load_jacobian = cs.jacobian(load_force(model, equations.place, e, load), u)
    U = model.of_free(cs.horzcat(*base_columns, cs.MX(model.size, LOAD_SIZE)) - load_jacobian)
    free = [model.of_free(model.of_free(matrix).T).T for matrix in (K, D, M)]
    pattern = free[0].sparsity() + free[1].sparsity()
    outputs = [*(cs.project(matrix, pattern).nz[:] for matrix in free), *(U @ direction for direction in directions)]
    entries = np.array(pattern.row()), np.array(pattern.get_col())
    free_forces = [model.of_free(force) for force in (forces, differentiable_forces)]
    return entries, SampledFunctions.of([*symbols, *directions], free_forces[0], outputs, powers, free_forces[1])


def _symbols(equations: Equations) -> list[cs.MX]:
    """Return symbols of the free coordinates, their velocities and accelerations, the excitation and the parameters."""
    free, parameters = equations.free, len(parameter_signals(equations))
    sizes = {"q": free, "v": free, "a": free, "u": BEAM_EXCITATION, "p": parameters}
    return [cs.MX.sym(name, size) for name, size in sizes.items()]


def _full_motion(equations: Equations, symbols: Sequence[cs.MX]) -> tuple[cs.MX, list[cs.MX], list[cs.MX]]:
    """Return the forces of a beam whose base does not rotate, powers, and coordinates of all nodes with their rates.

    The forces are the left side of the equation of motion at all nodes.  The powers are lost to damping, and supplied
    at the base and the tip, W.
    """
    *coordinates, u, p = symbols
    model, zero = equations.model, cs.MX.zeros(2)
    base = [cs.vertcat(u[3 * k : 3 * k + 2], zero) for k in range(3)]
    base[0][2:] = cs.DM(model.beam.axis)
    e, e_t, e_tt = nodes = [model.whole(*pair) for pair in zip(coordinates, base, strict=True)]
    balance = equations.balance_for(p)
    motion = e, e_t, e_tt, u[BASE_SIZE:]
    dissipated, base_power, load_power = cs.vertsplit(balance.powers(*motion))
    return balance.forces(*motion), [dissipated, base_power + load_power], nodes


def base_force(model: Model, law: DampingLaw, place: PointLoad) -> cs.Function:
    """Return the Function of q, v, a, u and p that gives the force of the base on the beam, (4,)."""
    equations = Equations(model, law, place=place)
    symbols = _symbols(equations)
    return cs.Function("base_force", symbols, [model.of_base(_full_motion(equations, symbols)[0])])


@keep_last(CACHED_SYSTEMS)
def reduced_system(reduced: Reduction, place: PointLoad = TIP, *, tuned: bool = False) -> SecondOrderSystem:
    """Return a reduced model, with a load at a place, as a second-order system with gravity and the law as parameters.

    If it is tuned, its parameters are those of the law, factors c on the natural frequencies w, and a factor E on the
    elastic modulus, with the forces diag((c_k^2 - 1) w_k^2) q + (E - 1) dU/dq.
    """
    m, model, projection = reduced.count, reduced.model, reduced.projection
    equilibrium = reduced.modes.equilibrium.coordinates
    parameters = system_parameters(reduced_parameters(reduced), reduced.law)
    if tuned:
        factors = [
            Parameter(f"frequency_{k}", 1.0, "1", f"factor on the frequency of mode {k}") for k in range(1, m + 1)
        ]
        modulus = Parameter("elastic_modulus", 1.0, "1", "factor on the elastic modulus")
        parameters = (*parameters[GRAVITY_SIZE:], *factors, modulus)
    return SecondOrderSystem(
        functions=partial(_reduced_functions, reduced, place, tuned),
        entries=dense_entries(m),
        parameters=parameters,
        excitation=BEAM_EXCITATION,
        rest=np.zeros(m),
        scale=np.full(m, model.beam.length * np.sqrt(projection.total_mass)),
        mirror=np.full(m, -1.0 if _is_symmetric(model, reduced.law, equilibrium) else 1.0),
    )


@lru_cache(maxsize=CACHED_FUNCTIONS)
def _reduced_functions(reduced: Reduction, place: PointLoad, tuned: bool, samples: int) -> SampledFunctions:
    m, laws = reduced.count, len(reduced.law.parameters)
    _, v, _ = coordinates = [cs.MX.sym(name, m, samples) for name in ("q", "v", "a")]
    u, p = cs.MX.sym("u", BEAM_EXCITATION, samples), cs.MX.sym("p", laws + (m + 1 if tuned else GRAVITY_SIZE))
    directions = [cs.MX.sym(name, BEAM_EXCITATION, samples) for name in ("u_1", "u_2")]
    balance, forces, damping, load_forces = reduced_forces(reduced, place, tuned, *coordinates, u, p)
    velocity = cs.vertcat(v, u[3:5, :])
    supplied_power = cs.sum1(u[3:5, :] * forces[m:, :]) + cs.sum1(velocity * load_forces)
    unit_vectors = [cs.DM.zeros(m, samples) for _ in range(m)]
    for k, unit_vector in enumerate(unit_vectors):
        unit_vector[k, :] = 1.0
    matrices = [cs.vertcat(*(cs.jtimes(balance, x, unit) for unit in unit_vectors)) for x in coordinates]
    excitation_forces = [cs.jtimes(balance, u, direction) for direction in directions]
    powers = [cs.sum1(velocity * damping), supplied_power]
    return SampledFunctions.of([*coordinates, u, p, *directions], balance, [*matrices, *excitation_forces], powers)


def reduced_forces(
    reduced: Reduction, place: PointLoad, tuned: bool, *motion: Expression
) -> tuple[Expression, Expression, Expression, Expression]:
    """Return R (m, N), and all forces, the damping forces and the load forces, (m + 2, N), for q, v, a, u and p.

    The parameters p are gravity and those of the law or, if ``tuned``, those of ``reduced_system``.  The motion is
    numbers or symbols; numbers avoid the time to build Functions that are evaluated only a few times.
    """
    m, law, model = reduced.count, reduced.law, reduced.model
    q, v, a, u, p = motion
    values, laws = cs.vertcat(cs.DM(model.beam.gravity), p) if tuned else p, len(law.parameters)
    gravity, law_parameters, factors = cs.vertsplit(values, [0, GRAVITY_SIZE, GRAVITY_SIZE + laws, values.numel()])
    state = reduced_motion(reduced.projection, q, v, u[:BASE_SIZE, :], gravity)
    point = place.place(model.beam)
    rows = [row[0, ::2] for row in (model.interpolation(point), model.slope_interpolation(point))]
    damping, load_forces = state.damping(law, law_parameters, model), state.load_force(u[BASE_SIZE:, :], *rows)
    forces = state.undamped_forces(a) + damping - load_forces
    balance = forces[:m, :]
    if tuned:
        frequency_factors, modulus_factor = factors[:m], factors[m]
        balance += cs.diag((frequency_factors**2 - 1) * reduced.modes.angular_frequencies**2) @ q
        balance += (modulus_factor - 1) * state.elastic_force
    return balance, forces, damping, load_forces


def _is_symmetric(model: Model, law: DampingLaw, equilibrium: Array) -> bool:
    """Return whether the beam in equilibrium, with loads, supports and attachments, is symmetric about its axis."""
    beam, (ax, ay), (x, y) = model.beam, model.beam.axis, equilibrium.reshape(-1, 2).T
    gx, gy = np.array(beam.gravity) / (np.hypot(*beam.gravity) or 1.0)
    sliding_directions = np.array([item.sliding for item in beam.supports if item.sliding]).reshape(-1, 2).T
    coefficient_pairs = [item.stiffness if isinstance(item, Spring) else item.coefficient
                         for item in beam.attachments if isinstance(item, Spring | Dashpot)]  # fmt: skip
    flow_across = [(ax * load.force[1] - ay * load.force[0]) / math.hypot(*load.force) for load in law.loads(beam)]
    across = [*(ax * y - ay * x), ax * gy - ay * gx, *flow_across]
    sx, sy = sliding_directions
    oblique_slides = (ax * sx + ay * sy) * (ax * sy - ay * sx)
    anisotropy = [(pair[0] - pair[1]) / max(pair) * ax * ay for pair in coefficient_pairs if any(pair)]
    return bool(np.abs([*across, *oblique_slides, *anisotropy]).max() <= STRAIGHT)


def _mirror(model: Model, law: DampingLaw, equilibrium: Array) -> Array:
    """Return the signs of the mirrored free coordinates: -1 across an axis along x or y; ones without symmetry."""
    ax, ay = np.abs(model.beam.axis)
    if min(ax, ay) > STRAIGHT or not _is_symmetric(model, law, equilibrium):
        return np.ones(model.freedoms)
    signs = np.tile([1.0, -1.0] if ax > ay else [-1.0, 1.0], model.size // 2)
    return np.asarray(np.round(model.of_free(signs * model.with_fixed_base(np.ones(model.freedoms)))))


def system_parameters(signals: Sequence[Signal], law: DampingLaw) -> tuple[Parameter, ...]:
    """Return the parameters of an exported model as parameters of a system, with the bounds of the law."""
    bounds = {"gravity_x": (-math.inf, math.inf), "gravity_y": (-math.inf, math.inf)}
    bounds |= {parameter.name: (parameter.lower, parameter.upper) for parameter in law.parameters}
    return tuple(
        Parameter(signal.name, signal.value, signal.unit, signal.description, *bounds.get(signal.name, (0.0, math.inf)))
        for signal in signals
    )


@dataclass(frozen=True, eq=False)
class SlopeCorrections:
    """Newton corrections of the free coordinates that turn the slopes of a beam instead of stretching it.

    The coordinates of the nodes of the beam are equivalent to pairs P e: the slopes r' at the two Gauss points of each
    element, and slope and position of the first node.  A correction turns each slope by the angle (r' x dr')/|r'|^2 and
    multiplies its length by exp(r' . dr'/|r'|^2).

    Supports beyond the beginning require Z^T P (e - G b) = 0, which turned slopes violate.  Forces Z l on the pairs
    restore it, with the flexibility C of a free uniform beam, which turns easily and stretches little.
    """

    matrix: Array  # P N, (4 n + 4, N)
    constant: Array  # P G b with the base at the origin, (4 n + 4,)
    inverse: Array  # N^T P^-1, (N, 4 n + 4)
    translation: Array  # change of the free coordinates per displacement of the whole beam, (N, 2)
    normals: Array  # Z, (4 n + 4, g); g = 0 without supports beyond the beginning
    bending: Array  # turn of each slope per moment on each, relative to a rigid turn, (2 n + 1, 2 n + 1)
    length: float  # of the beam, m

    @staticmethod
    def of(model: Model) -> SlopeCorrections:
        """Return the corrections of a beam."""
        beam, first_coordinate, node = model.beam, NODE * model.root, np.eye(NODE, model.size, NODE * model.root)
        pairs = np.vstack([*(model.slope_interpolation(s) for s in model.all_gauss_points), node[2:], node[:2]])
        zeros, inverse = np.zeros((first_coordinate, len(pairs))), np.linalg.inv(pairs[:, first_coordinate:])
        free_motions, points = model.with_fixed_base(np.eye(model.freedoms)), [*model.all_gauss_points, 0.0]
        normals = np.zeros((len(pairs), 0))
        if (model.weights[first_coordinate + NODE :] != 1.0).any():
            normals = inverse.T @ scipy.linalg.null_space(free_motions[first_coordinate:].T)
        return SlopeCorrections(
            matrix=pairs @ free_motions,
            constant=pairs @ model.whole_of_base @ np.array([0.0, 0.0, *beam.axis]),
            inverse=model.of_free(np.vstack([zeros, inverse])),
            translation=model.of_free(model.unit_velocities),
            normals=normals,
            bending=1.0 + np.minimum.outer(points, points) / beam.length,
            length=beam.length,
        )

    def add_corrections(self, q: Array, change: Array) -> Array:
        """Return coordinates (N, k) after corrections (N, k)."""
        pairs = _turn_pairs(self._pairs(q), _complex(self.matrix @ change))
        for _ in range(SUPPORT_CORRECTIONS if self.normals.size else 0):
            gaps = self.normals.T @ (_real(pairs) - self.constant[:, None])
            pairs = _turn_pairs(pairs, -np.einsum("kig,gk->ik", self._support_motions(pairs), gaps))
        return np.asarray(self.inverse @ (_real(pairs) - self.constant[:, None]))

    def turn_vectors(self, reference: Array, q: Array, vectors: Array, direction: Literal["forth", "back"]) -> Array:
        """Turn each slope of vectors by its angle from the reference to q (forth), or of residuals by the reverse."""
        before, after = self._pairs(reference), self._pairs(q)
        turn, motions = after[:-1] / before[:-1], self._support_motions(after)
        turn /= np.abs(turn)
        if direction == "forth":
            pairs = _complex(self.matrix @ vectors)
            pairs[:-1] *= turn
            pairs -= np.einsum("kig,gk->ik", motions, self.normals.T @ _real(pairs))
            return np.asarray(self.inverse @ _real(pairs))
        pairs = _complex(self.inverse.T @ vectors)
        pairs -= _complex(self.normals @ np.einsum("kig,ik->gk", motions.conj(), pairs).real)
        pairs[:-1] /= turn
        return np.asarray(self.matrix.T @ _real(pairs))

    def _support_motions(self, pairs: ComplexArray) -> ComplexArray:
        """Return C Z (Z^T C Z)^-1, the motion of the pairs that moves the beam by 1 at one support, (k, 2 n + 2, g)."""
        normals, directions = _complex(self.normals), (pairs[:-1] / np.abs(pairs[:-1])).T[:, :, None]
        forces = normals[:-1] * directions.conj()
        turned_slopes = directions * (STRETCHING * forces.real + 1j * (self.bending @ forces.imag))
        first_node = np.broadcast_to(self.length**2 * normals[-1:], (len(forces), 1, normals.shape[1]))
        motions = np.concatenate([turned_slopes, first_node], axis=1)
        return np.asarray(motions @ np.linalg.inv((normals.conj().T @ motions).real))

    def _pairs(self, q: Array) -> ComplexArray:
        """Return the slopes, and the position of the first node, (2 n + 2, k)."""
        return _complex(self.matrix @ q + self.constant[:, None])


def _turn_pairs(pairs: ComplexArray, corrections: ComplexArray) -> ComplexArray:
    """Return slopes turned and stretched by corrections (2 n + 2, k), and the corrected position of the first node."""
    rate = corrections[:-1] / pairs[:-1]
    # 5.0 limits the logarithm of the factor by which a correction stretches a slope
    turn = np.exp(np.clip(rate.real, -5.0, 5.0) + 1j * rate.imag)
    return np.concatenate([pairs[:-1] * turn, (pairs + corrections)[-1:]])


def _complex(vectors: Array) -> ComplexArray:
    """Return pairs of rows (2 k, N) as the real and imaginary parts of one row, (k, N)."""
    return np.asarray(vectors[::2] + 1j * vectors[1::2])


def _real(pairs: ComplexArray) -> Array:
    """Return pairs of rows for complex rows, the inverse of ``_complex``."""
    return np.stack([pairs.real, pairs.imag], axis=1).reshape(-1, pairs.shape[1])
