"""Radau IIA collocation of order 5 for the equation of motion: the Functions of a step.

Stages.  With the nodes c, the weights A of the method and a step h, the increments Z_i of the free coordinates at the
stages t + c_i h determine rates and accelerations there,

    V = A^-1 Z/h,    a = A^-1 (V - v)/h,    0 = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g   at each stage,

and the last stage is the end of the step.

Newton's method.  T^-1 A^-1 T has one real eigenvalue gamma and one complex pair mu.  With common matrices for all
stages, and s = gamma/h or mu/h, it takes a real and a complex system in N unknowns, banded as the mesh,

    (s^2 M + s D + K) dW = T^-1 R,    D = dQ_damp/de_t,    K = d(Q_damp + Q_e)/de,

instead of one in 3 N.  K changes as the beam turns, by its axial stiffness, thousands of times the bending stiffness;
but it nearly turns along.  Residuals are therefore turned back at each node, by the angle of its slope from where the
matrices are taken, and corrections forth.

Prediction.  The collocation polynomial of the step before is continued, not in coordinates, whose errors would stretch
the beam, but in the logarithms (length and angle) of the slopes and of the chords between the nodes.

Error.  The embedded formula of order 3 of Hairer and Wanner, filtered by the real system.

Samples within a step.  The quintic polynomial through positions, rates and accelerations at both ends, put right by a
Newton step of the equation of motion: the polynomial alone may pull the beam by more than its axial forces do.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.5 and IV.8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from ancf_casadi.equations import Equations
from ancf_casadi.kernels import mapped
from ancf_casadi.model import NODE
from ancf_casadi.nodes import Nodes
from ancf_casadi.tableau import QUINTIC, RADAU, STAGES

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Collocation:
    """The Functions of a step.

    Free coordinates, rates and accelerations are q, v and a (N,); Z (N, 3) are the increments at the stages, W = T^-1 Z
    in a part that is real (N,) and one that is complex (2, N), real above imaginary parts.  ``clamps`` (12, 3) are the
    clamped nodes at the stages, ``reference`` (N,) is q where the matrices were taken.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    """

    equations: Equations

    @cached_property
    def bandwidth(self) -> int:
        """Number of diagonals of the matrices on either side of the main one."""
        return min(2 * NODE - 1, self.equations.free - 1)

    @cached_property
    def nodes(self) -> Nodes:
        """The Functions of a node."""
        return Nodes(self.equations.make)

    @cached_property
    def stages(self) -> cs.Function:
        """(Z, dW real, dW complex, q, v, h, clamps, reference, parameters) -> T^-1 R real and complex, new Z."""
        s = self._symbols
        increments, *motion = self._corrected()
        e, e_t, e_tt = map(self._with_clamps, motion, cs.vertsplit(s.clamps, NODE))
        residuals, _ = self.forces(e, e_t, e_tt, s.parameters)
        given = self._by_nodes(residuals[NODE:, :]), motion[0], _columns(s.reference)
        real, pair = mapped(self.nodes.returned, *given)
        return _function("stages", s.of_stages, [cs.vec(real), cs.reshape(pair, 2, -1), self._by_stages(increments)])

    @cached_property
    def finish(self) -> cs.Function:
        """(Z, dW real, dW complex, q, v, h, clamps, reference, parameters, a) -> q, v, a at the end, error, Z, powers.

        ``error`` is the right-hand side of the error estimate, turned back; ``powers`` (2, 3) are those lost to damping
        and put in by the base at the stages.
        """
        s = self._symbols
        a, still = cs.MX.sym("a", self.equations.free), cs.MX(NODE, 1)
        found = self._corrected()
        increments = self._by_stages(found[0])
        e, e_t, e_tt = map(self._with_clamps, found[1:], cs.vertsplit(s.clamps, NODE))
        _, powers = self.forces(e, e_t, e_tt, s.parameters)
        balance, rate, embedded = self.equations.balance(s.parameters), RADAU.gamma / s.h, cs.DM(RADAU.embedded)
        off = s.v / rate + increments @ embedded
        rates_off = rate * off + a / rate + (e_t[NODE:, :] - s.repeated(s.v)) @ embedded
        off, rates_off = (cs.densify(cs.vertcat(still, part)) for part in (off, rates_off))
        error = balance.resistance(e[:, -1], e_t[:, -1], off, rates_off)
        if balance.projection.numel():
            error += balance.of_low_rank(off)
        turned = self._turned(rate * error[NODE:], e[NODE:, -1], s.reference)
        outputs = [e[NODE:, -1], e_t[NODE:, -1], e_tt[NODE:, -1], turned, increments, powers]
        return _function("finish", [*s.of_stages, a], outputs)

    @cached_property
    def matrices(self) -> cs.Function:
        """(q, v, h, clamp, parameters) -> s^2 M + s D + K, without the part B diag(d) B^T of D, real and complex.

        They are in the band storage of LAPACK, with room for its pivots.
        """
        s, clamp = self._symbols, cs.MX.sym("clamp", 3 * NODE)
        e, e_t = cs.vertcat(clamp[:NODE], s.q), cs.vertcat(clamp[NODE : 2 * NODE], s.v)
        real, a, b = RADAU.gamma / s.h, RADAU.mu.real / s.h, RADAU.mu.imag / s.h
        k, d, m = (self._sums @ part for part in self.equations.balance(s.parameters).tangents(e, e_t))
        pair = cs.vertcat(k + a * d + (a**2 - b**2) * m, b * d + 2 * a * b * m)
        outputs = [self._band(k + real * d + real**2 * m, 1), cs.reshape(self._band(pair, 2), 2, -1)]
        return _function("matrices", [s.q, s.v, s.h, clamp, s.parameters], outputs)

    @cached_property
    def prediction(self) -> cs.Function:
        """(nodes, ratio, clamps, q) -> Z.

        ``nodes`` (4 n + 4, 4) are all coordinates at the start and the stages of the step before; ``ratio`` is that of
        the new step to it.
        """
        s, ratio = self._symbols, cs.MX.sym("ratio")
        model, free = self.equations.model, self.equations.free
        nodes = cs.MX.sym("nodes", model.size, STAGES + 1)
        states, pair = model.size * np.arange(STAGES + 1)[:, None], np.arange(2)
        starts = NODE * np.arange(model.root, model.size // NODE - 1)[:, None, None]
        slopes = NODE * np.arange(1, model.size // NODE)[:, None, None] + 2
        seen = [(part + states + pair).ravel().tolist() for part in (starts, starts + NODE, slopes)]
        here, there, along = (cs.reshape(nodes.nz[places], 2 * (STAGES + 1), -1) for places in seen)
        vectors = cs.horzcat(there - here, along)
        shares = cs.repmat(self.nodes.shares(ratio), 1, vectors.size2())
        found = mapped(self.nodes.extrapolated, vectors, shares)[0]
        places = cs.horzcat(cs.MX.zeros(2 * STAGES, model.root), cs.cumsum(found[:, : len(starts)], 1))
        where = cs.vec(places + cs.repmat(cs.vec(s.clamps[:2, :]), 1, places.size2()))
        stage, coordinate = np.divmod(np.arange(STAGES * free), free)
        node, component = np.divmod(coordinate, NODE)
        order = 2 * STAGES * node + 2 * stage + component % 2 + where.numel() * (component // 2)
        predicted = cs.vertcat(where, cs.vec(found[:, len(starts) :])).nz[order.tolist()]
        return _function(
            "prediction", [nodes, ratio, s.clamps, s.q], [cs.reshape(predicted, free, STAGES) - s.repeated(s.q)]
        )

    @cached_property
    def sample(self) -> cs.Function:
        """(x, h, q, v, a, q_1, v_1, a_1, clamp, reference, parameters) -> e, e_t, e_tt, R.

        The quintic polynomial at the time x h into a step, and the residual of the free rows, turned back.
        """
        s, x, clamp = self._symbols, cs.MX.sym("x"), cs.MX.sym("clamp", 3 * NODE)
        a, q1, v1, a1 = (cs.MX.sym(name, self.equations.free) for name in ("a", "q1", "v1", "a1"))
        data = cs.horzcat(s.q, s.h * s.v, s.h**2 * a, q1, s.h * v1, s.h**2 * a1)
        powers = [cs.vertcat(*(math.perm(k, order) * x ** max(k - order, 0) for k in range(6))) for order in range(3)]
        shares = cs.DM(QUINTIC) @ cs.horzcat(*(part / s.h**order for order, part in enumerate(powers)))
        motion = cs.horzsplit(cs.vertcat(cs.reshape(clamp, NODE, 3), data @ shares))
        e, e_t, e_tt = motion
        residual, _ = self.forces(e, e_t, e_tt, s.parameters)
        turned = self._turned(residual[NODE:], motion[0][NODE:], s.reference)
        inputs = [x, s.h, s.q, s.v, a, q1, v1, a1, clamp, s.reference, s.parameters]
        return _function("sample", inputs, [*motion, turned])

    @cached_property
    def observation(self) -> cs.Function:
        """(e, e_t, e_tt, correction, reference, parameters) -> corrected e, and the force of the base (4,).

        ``correction`` (N,) is turned forth before it is taken off.
        """
        e, e_t, e_tt = (cs.MX.sym(name, self.equations.model.size) for name in ("e", "e_t", "e_tt"))
        s, correction = self._symbols, cs.MX.sym("correction", self.equations.free)
        q = e[NODE:] - self._turned(correction, s.reference, e[NODE:])
        right = cs.vertcat(e[:NODE], q)
        forces, _ = self.forces(right, e_t, e_tt, s.parameters)
        return _function("observation", [e, e_t, e_tt, correction, s.reference, s.parameters], [right, forces[:NODE]])

    def accelerations(self, q: Array, v: Array, clamp: Array, parameters: Array) -> Array:
        """Return the accelerations a of a state (numbers) with a clamped node (12,)."""
        position, velocity, acceleration = np.split(clamp, 3)
        motion = [np.concatenate(parts) for parts in ((position, q), (velocity, v), (acceleration, 0 * q))]
        forces, _ = self.balance(*motion, parameters)
        free = self.equations.model.free
        return np.asarray(scipy.sparse.linalg.spsolve(self.mass(parameters), -forces.full().ravel()[free]))

    def mass(self, parameters: Array) -> scipy.sparse.csc_array:
        """Return the mass matrix of the free coordinates."""
        model = self.equations.model
        properties = parameters[2 : 2 + model.properties.size].reshape(model.properties.shape, order="F")
        return scipy.sparse.csc_array(model.mass(properties).sparse()[model.free, model.free])

    @cached_property
    def _symbols(self) -> _Symbols:
        free = self.equations.free
        return _Symbols(
            increments=cs.MX.sym("Z", free, STAGES),
            real=cs.MX.sym("real", free),
            pair=cs.MX.sym("pair", 2, free),
            q=cs.MX.sym("q", free),
            v=cs.MX.sym("v", free),
            h=cs.MX.sym("h"),
            clamps=cs.MX.sym("clamps", 3 * NODE, STAGES),
            reference=cs.MX.sym("reference", free),
            parameters=cs.MX.sym("parameters", self.equations.parameters.size),
        )

    @cached_property
    def balance(self) -> cs.Function:
        """(e, e_t, e_tt, parameters) -> forces at all nodes, and powers lost to damping and put in by the base."""
        e, e_t, e_tt = (cs.MX.sym(name, self.equations.model.size) for name in ("e", "e_t", "e_tt"))
        parameters = self._symbols.parameters
        return cs.Function("balance", [e, e_t, e_tt, parameters], [*self.forces(e, e_t, e_tt, parameters)])

    def forces(self, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, parameters: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return the forces at all nodes (4 n + 4, s), and the powers lost to damping and put in by the base (2, s)."""
        balance = self.equations.balance(parameters)
        local, lost = balance.local(e, e_t, e_tt)
        if balance.projection.numel():
            further = balance.of_low_rank(e_t)
            local, lost = local + further, lost + cs.sum1(e_t * further)
        return local, cs.vertcat(lost, cs.sum1(e_t[:NODE, :] * local[:NODE, :]))

    def _corrected(self) -> list[cs.MX]:
        """Return the increments with T dW taken off, turned forth, and e, e_t and e_tt at the stages, node by node."""
        s = self._symbols
        given = [self._by_nodes(s.increments), _columns(s.real), cs.reshape(s.pair, 2 * NODE, -1)]
        count = given[0].size2()
        return mapped(
            self.nodes.corrected, *given, _columns(s.q), _columns(s.v), cs.repmat(s.h, 1, count), _columns(s.reference)
        )

    def _by_nodes(self, stages: cs.MX) -> cs.MX:
        """Return what belongs to the stages, (N, 3), node by node, (12, N/4)."""
        return cs.reshape(cs.vec(stages).nz[self._order.tolist()], NODE * STAGES, -1)

    def _by_stages(self, nodes: cs.MX) -> cs.MX:
        """Return what belongs to the nodes, (12, N/4), stage by stage, (N, 3)."""
        return cs.reshape(cs.vec(nodes).nz[np.argsort(self._order).tolist()], -1, STAGES)

    def _with_clamps(self, nodes: cs.MX, clamps: cs.MX) -> cs.MX:
        """Return what belongs to the free nodes, (12, N/4), and to the clamped one, (4, 3), by stages, (4 n + 4, 3)."""
        free, size = self.equations.free, self.equations.model.size
        stage, coordinate = np.divmod(np.arange(STAGES * size), size)
        inner = STAGES * NODE + np.argsort(self._order)[np.clip(free * stage + coordinate - NODE, 0, None)]
        order = np.where(coordinate < NODE, NODE * stage + coordinate, inner)
        return cs.reshape(cs.vertcat(cs.vec(clamps), cs.vec(nodes)).nz[order.tolist()], size, STAGES)

    def _turned(self, vector: cs.MX, first: cs.MX, second: cs.MX) -> cs.MX:
        """Turn a vector (N,) at each node by the angle from its slope in one configuration to that in another."""
        return cs.vec(mapped(self.nodes.turned, *map(_columns, (vector, first, second)))[0])

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """Places of what belongs to the nodes, one after the other, in what belongs to the stages."""
        free = self.equations.free
        return np.arange(STAGES * free).reshape(STAGES, -1, NODE).transpose(1, 0, 2).ravel()

    @cached_property
    def _entries(self) -> tuple[NDArray[np.int64], cs.DM]:
        """Places of the matrices' entries in band storage, and the sums of element matrices that give them."""
        width = self.bandwidth
        rows, columns = (index - NODE for index in self.equations.model.entries)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        all_places = 2 * width + rows[kept] - columns[kept] + (3 * width + 1) * columns[kept]
        places, target = np.unique(all_places, return_inverse=True)
        pattern = cs.Sparsity.triplet(places.size, rows.size, target.ravel().tolist(), kept.tolist())
        return places, cs.DM(pattern, 1.0)

    @property
    def _sums(self) -> cs.DM:
        return self._entries[1]

    def _band(self, values: cs.MX, parts: int) -> cs.MX:
        """Return entries in band storage, a vector; those of a complex matrix have two parts, one after the other."""
        places = parts * self._entries[0] + np.arange(parts)[:, None]
        size = parts * (3 * self.bandwidth + 1) * self.equations.free
        order = np.full(size, values.numel())
        order[places.ravel()] = np.arange(values.numel())
        return cs.vertcat(values, 0.0).nz[order.tolist()]


@dataclass(frozen=True)
class _Symbols:
    """The inputs that the Functions of a step share."""

    increments: cs.MX
    real: cs.MX
    pair: cs.MX
    q: cs.MX
    v: cs.MX
    h: cs.MX
    clamps: cs.MX
    reference: cs.MX
    parameters: cs.MX

    @property
    def of_stages(self) -> list[cs.MX]:
        """All, in their order as inputs of ``Collocation.stages``."""
        return [getattr(self, name) for name in self.__dataclass_fields__]

    def repeated(self, vector: cs.MX) -> cs.MX:
        """Return a vector once a stage."""
        return cs.repmat(vector, 1, STAGES)


def _columns(vector: cs.MX) -> cs.MX:
    """Return a vector as one column for each node."""
    return cs.reshape(vector, NODE, -1)


def _function(name: str, inputs: list[cs.MX], outputs: list[cs.MX]) -> cs.Function:
    return cs.Function(name, inputs, [cs.densify(x) for x in outputs], {"is_diff_in": [False] * len(inputs)})
