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
    KEPT_FUNCTIONS,
    SampledFunctions,
    SecondOrderSystem,
    dense_entries,
    several,
)
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.compilation import compiled_together
from ancf_casadi.vibration.statics import static_equilibrium

GRAVITY_SIZE = 2  # first parameters of a beam, which do not vary
KEPT = 8  # systems whose Functions are kept
STRAIGHT = 1e-9  # of the length of the beam, or of a direction


@lru_cache(maxsize=KEPT)
def full_system(model: Model, law: DampingLaw, place: PointLoad = TIP) -> SecondOrderSystem:
    """Return the full beam under a damping law, with a load at a place, as a second-order system.

    Its parameters are gravity, the properties of each element in turn, and the parameters of the law.
    """
    rest = static_equilibrium(model, loads=law.loads(model.beam)).coordinates
    return SecondOrderSystem(
        functions=partial(_full_functions, model, law, place),
        entries=_one_sample(model, law, place)[0],
        parameters=parameters_of(parameter_signals(Equations(model, law)), law),
        excitation=BEAM_EXCITATION,
        rest=model.of_free(rest),
        scale=model.free_scale,
        mirror=_mirror(model, law, rest),
        corrections=Turning.of(model),
    )


def _full_functions(model: Model, law: DampingLaw, place: PointLoad, samples: int) -> SampledFunctions:
    return several(_one_sample(model, law, place)[1], samples)


@lru_cache(maxsize=KEPT)
def _one_sample(model: Model, law: DampingLaw, place: PointLoad) -> tuple[tuple[Index, Index], SampledFunctions]:
    """Return rows and columns of the entries of the matrices, and the Functions of one sample."""
    equations = Equations(model, law, compiled_together, place)
    *_, u, p = symbols = _symbols(equations)
    forces, powers, (e, e_t, _) = _full_motion(equations, symbols)
    plain, *_ = _full_motion(Equations(model, law, place=place), symbols)
    directions = [cs.MX.sym(name, BEAM_EXCITATION) for name in ("u_1", "u_2")]
    terms, load = equations.balance_for(p), u[BASE_SIZE:]
    K, D, M = (model.matrix(entries) for entries in terms.tangents(e, e_t, load))
    B = terms.turned_projection(e)
    if B.shape[1]:
        D += B @ cs.diag(terms.modal_coefficients) @ B.T
    by_base = [cs.horzcat(model.of_base(matrix.T)[:2, :].T, cs.MX(model.size, 1)) for matrix in (K, D, M)]
    at_tip = cs.jacobian(load_force(model, equations.place, e, load), u)
    U = model.of_free(cs.horzcat(*by_base, cs.MX(model.size, LOAD_SIZE)) - at_tip)
    free = [model.of_free(model.of_free(matrix).T).T for matrix in (K, D, M)]
    pattern = free[0].sparsity() + free[1].sparsity()
    outputs = [*(cs.project(matrix, pattern).nz[:] for matrix in free), *(U @ direction for direction in directions)]
    entries = np.array(pattern.row()), np.array(pattern.get_col())
    balance = [model.of_free(own) for own in (forces, plain)]
    return entries, SampledFunctions.of([*symbols, *directions], balance[0], outputs, powers, balance[1])


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
    *free, u, p = symbols
    model, still = equations.model, cs.MX.zeros(2)
    base = [cs.vertcat(u[3 * k : 3 * k + 2], still) for k in range(3)]
    base[0][2:] = cs.DM(model.beam.axis)
    e, e_t, e_tt = nodes = [model.whole(*pair) for pair in zip(free, base, strict=True)]
    terms = equations.balance_for(p)
    motion = e, e_t, e_tt, u[BASE_SIZE:]
    lost, by_base, by_load = cs.vertsplit(terms.powers(*motion))
    return terms.forces(*motion), [lost, by_base + by_load], nodes


def base_force(model: Model, law: DampingLaw, place: PointLoad) -> cs.Function:
    """Return the Function of q, v, a, u and p that gives the force of the base on the beam, (4,)."""
    equations = Equations(model, law, place=place)
    symbols = _symbols(equations)
    return cs.Function("base_force", symbols, [model.of_base(_full_motion(equations, symbols)[0])])


@lru_cache(maxsize=KEPT)
def reduced_system(reduced: Reduction, place: PointLoad = TIP, *, tuned: bool = False) -> SecondOrderSystem:
    """Return a reduced model, with a load at a place, as a second-order system of gravity and the law as parameters.

    If it is tuned, they are those of the law, factors c on the natural frequencies w, and a factor E on the elastic
    modulus, with the forces diag((c_k^2 - 1) w_k^2) q + (E - 1) dU/dq.
    """
    m, model, projection = reduced.count, reduced.model, reduced.projection
    rest, parameters = reduced.modes.equilibrium.coordinates, parameters_of(reduced_parameters(reduced), reduced.law)
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
        mirror=np.full(m, -1.0 if _is_symmetric(model, reduced.law, rest) else 1.0),
    )


@lru_cache(maxsize=KEPT_FUNCTIONS)
def _reduced_functions(reduced: Reduction, place: PointLoad, tuned: bool, samples: int) -> SampledFunctions:
    m, laws = reduced.count, len(reduced.law.parameters)
    _, v, _ = coordinates = [cs.MX.sym(name, m, samples) for name in ("q", "v", "a")]
    u, p = cs.MX.sym("u", BEAM_EXCITATION, samples), cs.MX.sym("p", laws + (m + 1 if tuned else GRAVITY_SIZE))
    directions = [cs.MX.sym(name, BEAM_EXCITATION, samples) for name in ("u_1", "u_2")]
    balance, forces, damping, loaded = reduced_forces(reduced, place, tuned, *coordinates, u, p)
    velocity = cs.vertcat(v, u[3:5, :])
    supplied = cs.sum1(u[3:5, :] * forces[m:, :]) + cs.sum1(velocity * loaded)
    units = [cs.DM.zeros(m, samples) for _ in range(m)]
    for k, unit in enumerate(units):
        unit[k, :] = 1.0
    matrices = [cs.vertcat(*(cs.jtimes(balance, own, unit) for unit in units)) for own in coordinates]
    driven = [cs.jtimes(balance, u, direction) for direction in directions]
    powers = [cs.sum1(velocity * damping), supplied]
    return SampledFunctions.of([*coordinates, u, p, *directions], balance, [*matrices, *driven], powers)


def reduced_forces(
    reduced: Reduction, place: PointLoad, tuned: bool, *motion: Expression
) -> tuple[Expression, Expression, Expression, Expression]:
    """Return R (m, N), and all forces, those of damping and those of the load, (m + 2, N), of q, v, a, u and p.

    These are numbers or symbols; numbers need no Functions, which take longer to make than to evaluate a few times.
    """
    m, law, model = reduced.count, reduced.law, reduced.model
    q, v, a, u, p = motion
    values, laws = cs.vertcat(cs.DM(model.beam.gravity), p) if tuned else p, len(law.parameters)
    gravity, of_law, factors = cs.vertsplit(values, [0, GRAVITY_SIZE, GRAVITY_SIZE + laws, values.numel()])
    own = reduced_motion(reduced.projection, q, v, u[:BASE_SIZE, :], gravity)
    point = place.place(model.beam)
    rows = [row[0, ::2] for row in (model.interpolation(point), model.slope_interpolation(point))]
    damping, loaded = own.damping(law, of_law, model), own.load_force(u[BASE_SIZE:, :], *rows)
    forces = own.undamped_forces(a) + damping - loaded
    balance = forces[:m, :]
    if tuned:
        balance += cs.diag((factors[:-1] ** 2 - 1) * reduced.modes.angular_frequencies**2) @ q
        balance += (factors[-1] - 1) * own.elastic_force
    return balance, forces, damping, loaded


def _is_symmetric(model: Model, law: DampingLaw, rest: Array) -> bool:
    """Return whether the beam at rest, with all that acts and holds it, is its own mirror image in the axis."""
    beam, (ax, ay), (x, y) = model.beam, model.beam.axis, rest.reshape(-1, 2).T
    gx, gy = np.array(beam.gravity) / (np.hypot(*beam.gravity) or 1.0)
    slides = np.array([one.sliding for one in beam.supports if one.sliding]).reshape(-1, 2).T
    pairs = [one.stiffness if isinstance(one, Spring) else one.coefficient
             for one in beam.attachments if isinstance(one, Spring | Dashpot)]  # fmt: skip
    flow = [(ax * load.force[1] - ay * load.force[0]) / math.hypot(*load.force) for load in law.loads(beam)]
    across = [*(ax * y - ay * x), ax * gy - ay * gx, *flow]
    oblique = (ax * slides[0] + ay * slides[1]) * (ax * slides[1] - ay * slides[0])
    mixed = [(own[0] - own[1]) / max(own) * ax * ay for own in pairs if any(own)]
    return bool(np.abs([*across, *oblique, *mixed]).max() <= STRAIGHT)


def _mirror(model: Model, law: DampingLaw, rest: Array) -> Array:
    """Return the signs of free coordinates mirrored in the axis: -1 across it, if it is x or y; else ones."""
    ax, ay = np.abs(model.beam.axis)
    if min(ax, ay) > STRAIGHT or not _is_symmetric(model, law, rest):
        return np.ones(model.freedoms)
    signs = np.tile([1.0, -1.0] if ax > ay else [-1.0, 1.0], model.size // 2)
    return np.asarray(np.round(model.of_free(signs * model.moved(np.ones(model.freedoms)))))


def parameters_of(signals: Sequence[Signal], law: DampingLaw) -> tuple[Parameter, ...]:
    """Return the parameters of an exported model as parameters of a system, with the bounds of the law."""
    bounds = {"gravity_x": (-math.inf, math.inf), "gravity_y": (-math.inf, math.inf)}
    bounds |= {own.name: (own.lower, own.upper) for own in law.parameters}
    return tuple(
        Parameter(own.name, own.value, own.unit, own.description, *bounds.get(own.name, (0.0, math.inf)))
        for own in signals
    )


@dataclass(frozen=True, eq=False)
class Turning:
    """Corrections of the free coordinates that turn the slopes of a beam; a sum would stretch it.

    The coordinates of the nodes of the beam are equivalent to pairs P e: the slopes r' at the two Gauss points of each
    element, and slope and position of the first node.  A correction turns each slope by the angle (r' x dr')/|r'|^2 and
    multiplies its length by exp(r' . dr'/|r'|^2).
    """

    matrix: Array  # P N, (4 n + 4, N)
    constant: Array  # P G b with the base at the origin, (4 n + 4,)
    inverse: Array  # N^T P^-1, (N, 4 n + 4)
    translation: Array  # change of the free coordinates per displacement of the whole beam, (N, 2)

    @staticmethod
    def of(model: Model) -> Turning | None:
        """Return the corrections of a beam; none if supports hold it beyond its beginning, where it would not end."""
        beam, first, node = model.beam, NODE * model.root, np.eye(NODE, model.size, NODE * model.root)
        if (model.weights[first + NODE :] != 1.0).any():
            return None
        points = [s for index in range(beam.elements) for s in model.gauss_points(index)]
        pairs = np.vstack([*(model.slope_interpolation(s) for s in points), node[2:], node[:2]])
        none, own = np.zeros((first, len(pairs))), np.linalg.inv(pairs[:, first:])
        return Turning(
            matrix=pairs @ model.moved(np.eye(model.freedoms)),
            constant=pairs @ model.whole_of_base @ np.array([0.0, 0.0, *beam.axis]),
            inverse=model.of_free(np.vstack([none, own])),
            translation=model.of_free(model.unit_velocities),
        )

    def moved(self, q: Array, change: Array) -> Array:
        """Return coordinates (N, k) after corrections (N, k)."""
        pairs, corrections = self._pairs(q), _complex(self.matrix @ change)
        rate = corrections[:-1] / pairs[:-1]
        # logarithm of the factor by which a correction stretches a slope at most
        turn = np.exp(np.minimum(rate.real, 5.0) + 1j * rate.imag)
        moved = np.concatenate([pairs[:-1] * turn, (pairs + corrections)[-1:]])
        return np.asarray(self.inverse @ (_real(moved) - self.constant[:, None]))

    def turned(self, reference: Array, q: Array, vectors: Array, way: Literal["forth", "back"]) -> Array:
        """Return corrections with each slope turned by its angle from the reference to q (forth)."""
        before, after = (self._pairs(own)[:-1] for own in (reference, q))
        turn = after / before if way == "forth" else before / after
        into, out = (self.matrix, self.inverse) if way == "forth" else (self.inverse.T, self.matrix.T)
        pairs = _complex(into @ vectors)
        pairs[:-1] *= turn / np.abs(turn)
        return np.asarray(out @ _real(pairs))

    def _pairs(self, q: Array) -> ComplexArray:
        """Return the slopes, and the position of the first node, (2 n + 2, k)."""
        return _complex(self.matrix @ q + self.constant[:, None])


def _complex(vectors: Array) -> ComplexArray:
    """Return pairs of rows (2 k, N) as the real and imaginary parts of one row, (k, N)."""
    return np.asarray(vectors[::2] + 1j * vectors[1::2])


def _real(pairs: ComplexArray) -> Array:
    """Return the reverse of ``_complex``."""
    return np.stack([pairs.real, pairs.imag], axis=1).reshape(-1, pairs.shape[1])
