"""Radau IIA collocation of order 5 for the equation of motion: its coefficients, and the Functions of a step.

Stages.  With the nodes c and the weights A of the method and a step h, the increments Z_i of the free coordinates at
the stages t + c_i h determine velocities and accelerations there,

    V = A^-1 Z/h,    a = A^-1 (V - v)/h,    0 = R = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g - Q_load   at each stage,

and the last stage is the end of the step.

Newton's method.  T^-1 A^-1 T has one real eigenvalue gamma and one complex pair mu.  If all stages share their
matrices, a real and a complex banded system in N unknowns, with s = gamma/h and s = mu/h,

    (s^2 M + s D + K) dW = T^-1 R,    D = dQ_damp/de_t,    K = d(Q_damp + Q_e - Q_load)/de,

replace one system in 3 N (``elimination``).  As the beam turns, K changes by its axial part, which is thousands of
times stiffer than its bending part; in coordinates that turn with the beam, K hardly changes.  Residuals are therefore
turned back to the configuration in which the matrices were evaluated, and corrections are turned forth from there
(``corotation``).

Prediction.  The collocation polynomial of the last step is extrapolated in the logarithms of the beam's slopes: errors
of the coordinates themselves would stretch the beam.

Error.  The estimate is the embedded formula of order 3 of Hairer and Wanner, filtered by the real system.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.5 and IV.8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.excitation import EXCITATION
from ancf_casadi.dynamics.radau.corotation import Corotation
from ancf_casadi.dynamics.radau.elimination import Elimination, node_blocks, node_places
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array

STAGES = 3


@dataclass(frozen=True, eq=False)
class Tableau:
    """The coefficients of the method."""

    nodes: Array  # c, (3,)
    inverse: Array  # A^-1 of the weights A, (3, 3)
    transform: Array  # T with T^-1 A^-1 T = [[gamma, 0, 0], [0, mu', -mu''], [0, mu'', mu']], (3, 3)
    gamma: float  # real eigenvalue of A^-1
    mu: complex  # complex eigenvalue of A^-1
    embedded: Array  # weights of the increments in the error estimate, in which h f(t) has 1/gamma, (3,)
    integral: Array  # coefficients of x, x^2, x^3 in the integral from 0 to x of a function known at the nodes


def tableau() -> Tableau:
    """Derive the coefficients from the nodes."""
    nodes = np.array(cs.collocation_points(STAGES, "radau"))
    exponents = np.arange(1, STAGES + 1)
    integral = np.linalg.inv(np.vander(nodes, increasing=True)) / exponents[:, None]
    weights: Array = np.asarray(nodes[:, None] ** exponents @ integral, dtype=float)
    inverse = np.asarray(np.linalg.inv(weights), dtype=float)
    values, vectors = np.linalg.eig(inverse)
    real, pair = int(np.argmin(np.abs(values.imag))), int(np.argmax(values.imag))
    transform = np.column_stack([vectors[:, real].real, vectors[:, pair].real, -vectors[:, pair].imag])
    block = np.linalg.solve(transform, inverse @ transform)
    gamma, mu = float(block[0, 0]), complex(block[1, 1], block[2, 1])
    moments = 1 / exponents - np.array([1 / gamma, 0.0, 0.0])
    quadrature = np.linalg.solve(nodes ** (exponents - 1)[:, None], moments)
    embedded = (quadrature - weights[-1]) @ inverse
    return Tableau(nodes, inverse, transform, gamma, mu, embedded, integral)


def powers(x: Any, orders: int) -> list[list[Any]]:
    """Return 1, x, ..., x^5 and their derivatives up to an order, (orders, 6)."""
    return [[math.perm(k, order) * x ** max(k - order, 0) for k in range(6)] for order in range(orders)]


RADAU = tableau()
# (6, 6), each row a polynomial of degree 5 with one of its values and first two derivatives at 0, then at 1, equal to 1
QUINTIC = np.linalg.inv(np.array(powers(0.0, 3) + powers(1.0, 3))).T


@dataclass(frozen=True, eq=False)
class Collocation:
    """The Functions of a step.

    Free coordinates, velocities and accelerations are q, v and a (N,); Z (N, 3) are the increments at the stages.
    The columns of W = Z T^-T (N, 3) are the real part, and the real and the imaginary part of the complex one.
    ``excitations`` (16, 3) are those at the stages.  ``turns`` lead to the stages from ``reference``, all coordinates
    (4 n + 4,) of the configuration in which the matrices were taken (``corotation``).
    """

    equations: Equations

    def __eq__(self, other: object) -> bool:
        """Return whether the Functions are the same: they all follow from the forces, whose parameters are inputs."""
        return isinstance(other, Collocation) and self._forces == other._forces

    def __hash__(self) -> int:
        """Return the hash of the forces."""
        return hash(self._forces)

    @cached_property
    def stages(self) -> cs.Function:
        """(Z, dW, q, v, h, excitations, turns, reference, parameters, real, pair) -> dW, Z, turns.

        Z is corrected by the last dW; the results are the next dW and the turns to the stages.  ``real`` and ``pair``
        are the outputs of ``factors``.
        """
        s = self._symbols
        increments, motion = self._corrected()
        residuals, _ = self.equations.balance(s.parameters).forces(*motion)
        turns = self._corotation.turns(s.reference, motion[0])
        r = self._corotation.back(residuals, turns) @ cs.DM(np.linalg.inv(RADAU.transform)).T
        corrections = cs.horzcat(self._solved(self._real, s.real, r[:, :1]), self._solved(self._pair, s.pair, r[:, 1:]))
        return _function("stages", [*vars(s).values()], [corrections, increments, turns])

    @cached_property
    def finish(self) -> cs.Function:
        """(inputs of ``stages`` but pair, a) -> e (4 n + 4, 3) at the stages, v and a at the end, error, powers.

        ``error`` is the estimate, turned back; ``powers`` (3, 3) are those of ``Balance.forces`` at the stages.
        """
        s = self._symbols
        a, model = cs.MX.sym("a", self.equations.free), self.equations.model
        increments, (e, e_t, e_tt, load) = self._corrected()
        balance, real, embedded = self.equations.balance(s.parameters), RADAU.gamma / s.h, cs.DM(RADAU.embedded)
        _, powers = balance.forces(e, e_t, e_tt, load)
        deviation = s.v / real + increments @ embedded
        velocity_deviation = real * deviation + a / real + (model.of_free(e_t) - cs.repmat(s.v, 1, STAGES)) @ embedded
        deviations = [cs.densify(model.moved(part)) for part in (deviation, velocity_deviation)]
        error = balance.resistance(e[:, -1], e_t[:, -1], *deviations)
        if balance.projection.numel():
            error += balance.of_low_rank(e[:, -1], deviations[0])
        solved = self._solved(self._real, s.real, self._frames(1).back(real * error, s.turns[-NODE:, :]))
        *shared, _ = vars(s).values()
        return _function(
            "finish", [*shared, a], [e, model.of_free(e_t[:, -1]), model.of_free(e_tt[:, -1]), solved, powers]
        )

    @cached_property
    def factors(self) -> cs.Function:
        """(q, v, h, excitation, parameters) -> factors of s^2 M + s D + K, for the real s, and for the complex one."""
        s, excitation = self._symbols, cs.MX.sym("excitation", EXCITATION)
        position, velocity, _, load = cs.vertsplit(excitation, NODE)
        model = self.equations.model
        e, e_t = model.whole(s.q, position), model.whole(s.v, velocity)
        balance = self.equations.balance(s.parameters)
        k, d, m = balance.tangents(e, e_t, load)
        real, a, b = RADAU.gamma / s.h, RADAU.mu.real / s.h, RADAU.mu.imag / s.h
        parts = k + real * d + real**2 * m, k + a * d + (a**2 - b**2) * m, b * d + 2 * a * b * m
        alone, *pair = (node_blocks(model, part, unit) for part, unit in zip(parts, (1.0, 1.0, 0.0), strict=True))
        low_rank = self._placed(model.of_free(balance.turned_projection(e))), balance.modal_coefficients / s.h
        outputs = [
            self._real.factors(alone, *low_rank, complex(RADAU.gamma)),
            self._pair.factors(cs.vertcat(*pair), *low_rank, RADAU.mu),
        ]
        return _function("factors", [s.q, s.v, s.h, excitation, s.parameters], outputs)

    @cached_property
    def prediction(self) -> cs.Function:
        """(nodes, ratio, excitations, q) -> Z.

        ``nodes`` (4 n + 4, 4) are all coordinates at the start and the stages of the last step; ``ratio`` is the length
        of the new step relative to the last one.
        """
        s, ratio = self._symbols, cs.MX.sym("ratio")
        nodes = cs.MX.sym("nodes", self.equations.model.size, STAGES + 1)
        known = np.concatenate([[0.0], RADAU.nodes])
        weights = [cs.vertcat(*_lagrange(known, 1 + c * ratio)[1:]) for c in RADAU.nodes.tolist()]
        q = self._corotation.continued(cs.horzcat(*weights), nodes, s.excitations[:NODE, :])
        return _function("prediction", [nodes, ratio, s.excitations, s.q], [q - cs.repmat(s.q, 1, STAGES)])

    def accelerations(self, q: Array, v: Array, excitation: Array, parameters: Array) -> Array:
        """Return the accelerations a in a state (q, v) under an excitation (16,)."""
        position, velocity, acceleration, load = np.split(excitation, [NODE, 2 * NODE, 3 * NODE])
        model = self.equations.model
        motion = [model.whole(*parts) for parts in ((q, position), (v, velocity), (0 * q, acceleration))]
        forces = model.of_free(self.balance(*motion, load, parameters)[0].full().ravel())
        return np.asarray(scipy.sparse.linalg.spsolve(self.mass(parameters).sparse(), -forces))

    @cached_property
    def mass(self) -> cs.Function:
        """(parameters) -> mass matrix of the free coordinates."""
        parameters = self._symbols.parameters
        return cs.Function("mass", [parameters], [self.equations.balance(parameters).free_mass()])

    @cached_property
    def _forces(self) -> str:
        """The forces as text, with the constants of the mesh and of the law."""
        return str(self.balance.serialize())

    @cached_property
    def _real(self) -> Elimination:
        return self._elimination(1)

    @cached_property
    def _pair(self) -> Elimination:
        return self._elimination(2)

    def _elimination(self, parts: int) -> Elimination:
        equations = self.equations
        places = equations.model.size - NODE
        return Elimination(parts, places, equations.projection.shape[1], equations.make)

    def _placed(self, x: cs.MX) -> cs.MX:
        """Return free coordinates (N, c) at four places per node, zero where a coordinate is held."""
        model = self.equations.model
        return x if model.held_at_base_alone else _selection(model) @ x

    def _solved(self, elimination: Elimination, factors: cs.MX, right: cs.MX) -> cs.MX:
        """Return the solution (N, c) for right-hand sides of the free coordinates."""
        model, found = self.equations.model, elimination.solve(factors, self._placed(right))
        return found if model.held_at_base_alone else _selection(model).T @ found

    def _frames(self, configurations: int) -> Corotation:
        return Corotation(self.equations.model, configurations, self.equations.make)

    @cached_property
    def _corotation(self) -> Corotation:
        return self._frames(STAGES)

    def _corrected(self) -> tuple[cs.MX, tuple[cs.MX, cs.MX, cs.MX, cs.MX]]:
        """Return Z minus T dW, turned forth, and the motion and the load at the stages."""
        s = self._symbols
        z = s.increments - self._corotation.forth(s.corrections @ cs.DM(RADAU.transform).T, s.turns)
        return z, stage_motion(self.equations.model, z, s.q, s.v, s.h, s.excitations)

    @cached_property
    def _symbols(self) -> SimpleNamespace:
        """The inputs of ``stages``, in order, which the other Functions share."""
        free, model = self.equations.free, self.equations.model
        return SimpleNamespace(
            increments=cs.MX.sym("Z", free, STAGES),
            corrections=cs.MX.sym("dW", free, STAGES),
            q=cs.MX.sym("q", free),
            v=cs.MX.sym("v", free),
            h=cs.MX.sym("h"),
            excitations=cs.MX.sym("excitations", EXCITATION, STAGES),
            turns=cs.MX.sym("turns", NODE * STAGES, self._corotation.links),
            reference=cs.MX.sym("reference", model.size),
            parameters=cs.MX.sym("parameters", self.equations.parameters.size),
            real=cs.MX.sym("real", self._real.layout.size),
            pair=cs.MX.sym("pair", self._pair.layout.size),
        )

    @cached_property
    def balance(self) -> cs.Function:
        """(e, e_t, e_tt, load, parameters) -> forces at all nodes, and powers as in ``Balance.forces``."""
        e, e_t, e_tt = (cs.MX.sym(name, self.equations.model.size) for name in ("e", "e_t", "e_tt"))
        load, parameters = cs.MX.sym("load", NODE), self._symbols.parameters
        outputs = self.equations.balance(parameters).forces(e, e_t, e_tt, load)
        return cs.Function("balance", [e, e_t, e_tt, load, parameters], [*outputs])


@lru_cache(8)
def first_equal(form: Collocation) -> Collocation:
    """Return the same Functions of an earlier run, if there are any, which spares the time to derive them again."""
    return form


def stage_motion(
    model: Model, z: cs.MX, q: cs.MX, v: cs.MX, h: cs.MX, excitations: cs.MX
) -> tuple[cs.MX, cs.MX, cs.MX, cs.MX]:
    """Return e, e_t and e_tt, (4 n + 4, 3), and the load, (4, 3), at the stages, from Z and the data of the step."""
    inverse = cs.DM(RADAU.inverse).T
    velocities = z @ inverse / h
    accelerations = (velocities - cs.repmat(v, 1, STAGES)) @ inverse / h
    *nodes, load = cs.vertsplit(excitations, NODE)
    moved = cs.repmat(q, 1, STAGES) + z, velocities, accelerations
    e, e_t, e_tt = (model.whole(free, node) for node, free in zip(nodes, moved, strict=True))
    return e, e_t, e_tt, load


def _selection(model: Model) -> cs.DM:
    """Return the sparse matrix that takes free coordinates to four places per node."""
    places = node_places(model)
    return cs.DM.triplet(
        places.tolist(), list(range(places.size)), cs.DM.ones(places.size), model.size - NODE, places.size
    )


def _lagrange(nodes: Array, x: cs.MX) -> list[cs.MX]:
    """Return the Lagrange polynomials of some nodes at x."""
    factors = [[(x - other) / (node - other) for other in nodes if other != node] for node in nodes]
    return [cs.MX(math.prod(one, start=cs.MX(1))) for one in factors]


def _function(name: str, inputs: list[cs.MX], outputs: list[cs.MX]) -> cs.Function:
    return cs.Function(name, inputs, [cs.densify(x) for x in outputs], {"is_diff_in": [False] * len(inputs)})
