"""A computed motion, the linearised equations of its Radau steps, and its derivatives through them.

Let R(Z, u) be the residual of the stages, as in ``collocation`` but in the laboratory frame, and u = (q, v,
excitations, parameters) the data of the step.  With G = dR/dZ, its derivatives obey G dZ + R_u du = 0.

G is banded if the unknowns are ordered by nodes, with the stages of a node side by side.  Its low-rank part is handled
by Woodbury's identity.  With B_i turned with the clamp at stage i, and U = diag(B_i diag(d)), this part is

    (A^-1)_ij/h B_i diag(d) B_i^T = (U V^T)_ij,    V_ji = (A^-1)_ij/h B_i.

Forward, along a direction du, the last stage of a step starts the next one,

    dZ = -G^-1 R_u du,    dV = A^-1 dZ/h,    da = A^-1 (dV - dv)/h.

In reverse, the steps are taken backwards, each transposed: the weights of q, v and a at the end of a step give the
weights w of its increments Z; -R_u^T G^-T w are then weights of u, and give those of q, v and a at the start.

Samples.  Within a step of length h, the coordinates are the quintic polynomial through q, v and a at both ends, and its
time derivatives are their velocities, accelerations and so on,

    d^m q/dt^m = sum_k w_k^(m)(x) y_k,    x = (t - t_0)/h,    y = (q, v, a, q_1, v_1, a_1).

The step is of order 5, so that for a smooth motion the error of the coordinates is of order h^5, that of velocities
h^5, of accelerations h^4, and of the third derivative, which only serves the derivative by a shift, h^3.

The clamped node follows the base motion exactly.  Before the first instant of the motion the beam is at rest in its
first shape.  A sample at t + d, with an unknown shift d of its clock, changes with d by its own time derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import casadi as cs
import numpy as np
import scipy.sparse

from ancf_casadi.dynamics.equations import Balance, Equations, as_it_is
from ancf_casadi.dynamics.excitation import EXCITATION, SAME_TIME, Excitation
from ancf_casadi.dynamics.radau.collocation import QUINTIC, RADAU, STAGES, Collocation, powers, stage_motion
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array, Index, Layout
from ancf_casadi.support.banded import BandedFactors, lapack_place, lapack_storage
from ancf_casadi.support.compilation import Buffered, compiled
from ancf_casadi.support.interrupts import interrupted

StepFunction = Callable[..., Array]  # (step, parameters, [vectors]) -> values of a Function (Z, h, u, [vector]), (k, d)
NO_VECTOR = np.empty((0, 1))  # for a Function without one


@dataclass(frozen=True, eq=False)
class Passage:
    """A smooth piece of a computed motion."""

    excitation: Excitation
    acceleration_jacobian: Array  # of the first a with respect to q, v, the excitation and the parameters, (N, ...)
    steps: list[RadauStep]
    samples: list[Index]  # indices of the samples in each step

    def stage_jacobians(self) -> Array:
        """Return the derivatives of the excitation by the m parameters of the base at the stages, (steps, 3, 16, m)."""
        times = np.array([step.start + RADAU.nodes * step.length for step in self.steps])
        return self.excitation.jacobians(times.ravel()).reshape(*times.shape, EXCITATION, -1)


@dataclass(frozen=True, eq=False)
class MotionRun:
    """A computed motion, sampled at k instants."""

    parameters: Array  # of the equation of motion
    times: Array  # the samples (k,), s, on the clock of the base motion
    rest: Index  # indices of the samples before the motion, at rest
    start_jacobian: Array  # of the first q and v with respect to theta, b, P, m and s, (2 N, ...)
    passages: list[Passage]  # its smooth pieces
    samples: Array  # nodal coordinates and their time derivatives, (k, orders, 4 n + 4)
    rates: Array  # time derivatives of ``samples``, if there are shifts; else (0,)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(len(passage.steps) for passage in self.passages)


def stop_if_interrupted() -> None:
    """Raise a SimulationError if ``noted_interrupts`` has noted a Ctrl-C."""
    if interrupted():
        raise SimulationError("the motion was interrupted")


def sample_weights(step: RadauStep, times: Array, orders: int) -> Array:
    """Return the weights (s, orders, 6) of q, v and a at both ends of a step in the time derivatives at s instants."""
    h = step.length
    parts = np.array(powers((times - step.start) / h, orders)) / h ** np.arange(orders)[:, None, None]
    return np.asarray(np.moveaxis(parts, 2, 0) @ QUINTIC.T * np.array([1.0, h, h**2, 1.0, h, h**2]))


def clamp_jacobians(excitation: Excitation, times: Array, orders: int) -> Array:
    """Return the derivatives (s, orders, 4, m) of samples of the clamped node by the m parameters of the base."""
    return excitation.jacobians(times)[:, : orders * NODE].reshape(times.size, orders, NODE, -1)


def samples_of(times: Array, steps: list[RadauStep], begin: float, end: float, *, first: bool) -> list[Index]:
    """Return the indices of the samples in each step of a piece; the ``first`` piece has its first instant too."""
    ends = np.array([step.start + step.length for step in steps])
    slack = SAME_TIME * (end - begin)
    inside = (times <= end + slack) & (times > (begin - slack if first else begin + slack))
    owner = np.minimum(np.searchsorted(ends, times - slack), len(steps) - 1)
    return [np.flatnonzero(inside & (owner == k)) for k in range(len(steps))]


def whole_samples(model: Model, q: Array, base: Array) -> Array:
    """Return samples of all coordinates, (k, orders, 4 n + 4, ...), from those of the free ones and of the base."""
    return np.moveaxis(model.whole(np.moveaxis(q, 2, 0), np.moveaxis(base, 2, 0)), 0, 2)


def sampled(model: Model, passages: list[Passage], times: Array, rest: Index, orders: int) -> Array:
    """Return the coordinates and their time derivatives, (k, orders, 4 n + 4), at the samples ``times`` (k,)."""
    result = np.zeros((times.size, orders, model.size))
    first = passages[0]
    result[rest, 0] = model.whole(first.steps[0].q, first.excitation.at(first.excitation.begin)[:NODE])
    for passage in passages:
        for step, samples in zip(passage.steps, passage.samples, strict=True):
            if samples.size:
                velocities = RADAU.inverse @ step.increments / step.length
                accelerations = RADAU.inverse[-1] @ (velocities - step.v) / step.length
                last = step.q + step.increments[-1], velocities[-1], accelerations
                ends = np.array([step.q, step.v, step.a, *last])
                nodes = [passage.excitation.derivatives(time) for time in times[samples].tolist()]
                base = np.reshape(nodes, (samples.size, -1, NODE))[:, :orders]
                result[samples] = whole_samples(model, sample_weights(step, times[samples], orders) @ ends, base)
    return result


@dataclass(frozen=True, eq=False)
class Tangent:
    """The Functions of a linearised step, of Z (N, 3), the step h, and u = (q, v, excitations by stage, parameters)."""

    form: Collocation

    @cached_property
    def layout(self) -> Layout:
        """Layout of u."""
        parameters = self.form.equations.layout.size
        return Layout.of(q=self._free, v=self._free, excitations=STAGES * EXCITATION, parameters=parameters)

    @cached_property
    def order(self) -> Index:
        """Places in G of the unknowns listed stage by stage, (3 N,)."""
        node = self.form.equations.model.first_moved // NODE
        stage, coordinate = np.divmod(np.arange(STAGES * self._free), self._free)
        return np.argsort(np.lexsort((coordinate, stage, node[coordinate])))

    @cached_property
    def inverse_order(self) -> Index:
        """Indices of the unknowns, listed stage by stage, in the order of G, (3 N,)."""
        return np.argsort(self.order)

    @cached_property
    def force_jacobian(self) -> cs.Function:
        """(q, v, a, excitation, parameters) -> Jacobian of the forces on the free coordinates, for all inputs but a."""
        q, v, a = (cs.MX.sym(name, self._free) for name in "qva")
        excitation, p = cs.MX.sym("excitation", EXCITATION), cs.MX.sym("p", self.form.equations.layout.size)
        *node, load = cs.vertsplit(excitation, NODE)
        equations = replace(self.form.equations, make=as_it_is)
        motion = [equations.model.whole(x, part) for part, x in zip(node, (q, v, a), strict=True)]
        forces = equations.model.of_free(Collocation(equations).balance(*motion, load, p)[0])
        jacobian = cs.horzcat(*(cs.jacobian(forces, x) for x in (q, v, excitation, p)))
        return cs.Function("force_jacobian", [q, v, a, excitation, p], [jacobian])

    @property
    def bandwidth(self) -> int:
        """Number of diagonals of G on either side of the main one."""
        return min(2 * STAGES * NODE - 1, STAGES * self._free - 1)

    def low_rank(self, excitations: Array, h: float, modal_coefficients: Array) -> tuple[Array, Array]:
        """Return U and V (3 N, 3 m) of the low-rank part U V^T of G, in the order of G, for excitations (3, 16), d."""
        if not modal_coefficients.size:
            return (np.zeros((len(self.order), 0)),) * 2
        B = np.tensordot(excitations[:, 2:NODE], self.form.equations.turned_projections, 1)
        U = np.einsum("ij,inm->jnim", np.eye(STAGES), B * modal_coefficients)
        V = np.einsum("ij,inm->jnim", RADAU.inverse / h, B)
        size = len(self.order)
        return U.reshape(size, -1)[self.inverse_order], V.reshape(size, -1)[self.inverse_order]

    @cached_property
    def matrix(self) -> cs.Function:
        """(Z, h, u) -> G without its low-rank part, in the band storage of LAPACK."""
        z, h, u = self._symbols
        all_e, all_e_t, _, load = self._motion(z, h, u)
        k, d, m = self._balance(u).tangents(all_e, all_e_t, load)
        first, second = RADAU.inverse, RADAU.inverse @ RADAU.inverse
        band = self._band(np.eye(STAGES)) @ cs.vec(k)
        band += (self._band(first) @ cs.vec(d)) / h + (self._band(second) @ cs.vec(m)) / h**2
        return cs.Function("tangent_matrix", [z, h, u], [cs.densify(band)], {"is_diff_in": [False] * 3})

    def steps(
        self, run: MotionRun, passage: Passage, *, backwards: bool = False
    ) -> Iterator[tuple[RadauStep, Index, BandedFactors]]:
        """Go through the steps of a piece, each with the indices of the samples in it, and with the factors of G."""
        order = -1 if backwards else 1
        d = cs.evalf(self.form.equations.balance(cs.MX(cs.DM(run.parameters))).modal_coefficients).full().ravel()
        for step, samples in zip(passage.steps[::order], passage.samples[::order], strict=True):
            stop_if_interrupted()
            band = lapack_storage(self._bound_matrix(step, run.parameters).ravel(), self.bandwidth)
            low_rank = self.low_rank(step.excitations, step.length, d)
            yield step, samples, BandedFactors.of(band, self.bandwidth, *low_rank)

    def increments(self, step: RadauStep, factors: BandedFactors, parameters: Array, du: Array) -> Array:
        """Return dZ = -G^-1 R_u du for d directions side by side, (3 N, d)."""
        right = self._forward(step, parameters, du)
        return -factors.solve(right[self.inverse_order], overwrite=True)[self.order]

    def given(self, step: RadauStep, factors: BandedFactors, parameters: Array, weights: Array) -> Array:
        """Return -R_u^T G^-T w for weights w of the increments, (3 N, d)."""
        residuals = -factors.solve_transposed(weights[self.inverse_order])[self.order]
        return self._reverse(step, parameters, residuals)

    @cached_property
    def _forward(self) -> StepFunction:
        return self._product(transposed=False)

    @cached_property
    def _bound_matrix(self) -> StepFunction:
        return _bound(self.matrix)

    @cached_property
    def _reverse(self) -> StepFunction:
        return self._product(transposed=True)

    def _product(self, *, transposed: bool) -> StepFunction:
        """Return the product of R_u, or of its transpose, and a vector."""
        z, h, u = self._symbols
        forces, _ = self._balance(u).forces(*self._motion(z, h, u))
        seed = cs.MX.sym("seed", len(self.order) if transposed else u.numel())
        own = self.form.equations.model.of_free(forces)
        product = cs.densify(cs.jtimes(cs.vec(own), u, seed, transposed))
        return _bound(cs.Function("tangent_product", [z, h, u, seed], [product], {"is_diff_in": [False] * 4}))

    def _band(self, weights: Array) -> cs.DM:
        """Return the matrix that sums weighted element matrices of the stages into band storage.

        Weight (i, j) belongs to the derivative of the residual at stage i with respect to the increments at stage j.
        """
        model = self.form.equations.model
        kept, rows, columns, products = model.free_entries
        count = model.entries[0].size
        width, shape = self.bandwidth, (STAGES * self._free, count * STAGES)
        places, entries, values = [], [], []
        for i, j in np.argwhere(weights):
            row, column = self.order[rows + i * self._free], self.order[columns + j * self._free]
            places.append(lapack_place(row, column, width))
            entries.append(kept + i * count)
            values.append(weights[i, j] * products)
        whole = scipy.sparse.csc_array(
            (np.concatenate(values), (np.concatenate(places), np.concatenate(entries))),
            shape=((3 * width + 1) * shape[0], shape[1]),
        )
        return cs.DM(whole)

    @property
    def _free(self) -> int:
        return self.form.equations.free

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        return cs.MX.sym("Z", self._free, STAGES), cs.MX.sym("h"), cs.MX.sym("u", self.layout.size)

    def _motion(self, z: cs.MX, h: cs.MX, u: cs.MX) -> tuple[cs.MX, cs.MX, cs.MX, cs.MX]:
        """Return e, e_t and e_tt, (4 n + 4, 3), and the load, (4, 3), at the stages."""
        q, v, excitations, _ = cs.vertsplit(u, self.layout.offsets)
        return stage_motion(self.form.equations.model, z, q, v, h, cs.reshape(excitations, EXCITATION, STAGES))

    def _balance(self, u: cs.MX) -> Balance:
        return self.form.equations.balance(u[self.layout["parameters"]])


@lru_cache(8)
def tangent_of(equations: Equations) -> Tangent:
    """Return the Functions of the linearised steps under some equations; all motions under them share these."""
    return Tangent(Collocation(replace(equations, make=partial(compiled, derivatives=True))))


def forward(tangent: Tangent, run: MotionRun, start: Array, b: Array, parameters: Array) -> Array:
    """Return the derivatives of the samples along d directions, (k, orders, 4 n + 4, d), at fixed instants.

    The directions (..., d) are those of the first q and v, of b, and of the parameters of the equation of motion.
    """
    free, d = len(start) // 2, start.shape[1]
    dq, dv = start[:free], start[free:]
    orders = run.samples.shape[1]
    result = np.zeros((*run.samples.shape, d))
    first = run.passages[0]
    model = tangent.form.equations.model
    result[run.rest, 0] = model.whole(dq, first.excitation.jacobian(first.excitation.begin)[:NODE] @ b)
    for passage in run.passages:
        excitation = passage.excitation
        da = passage.acceleration_jacobian @ np.vstack([dq, dv, excitation.jacobian(excitation.begin) @ b, parameters])
        stages = (passage.stage_jacobians() @ b).reshape(-1, STAGES * EXCITATION, d)
        for (step, samples, factors), given in zip(tangent.steps(run, passage), stages, strict=True):
            du = np.vstack([dq, dv, given, parameters])
            dZ = tangent.increments(step, factors, run.parameters, du).reshape(STAGES, free, d)
            dV = np.einsum("ij,jkl->ikl", RADAU.inverse, dZ) / step.length
            accelerations = np.tensordot(RADAU.inverse[-1], dV - dv, 1) / step.length
            ends = np.array([dq, dv, da, dq + dZ[-1], dV[-1], accelerations])
            if samples.size:
                times = run.times[samples]
                moved = np.tensordot(sample_weights(step, times, orders), ends, 1)
                result[samples] = whole_samples(model, moved, clamp_jacobians(excitation, times, orders) @ b)
            dq, dv, da = ends[3:]
    return result


def reverse(tangent: Tangent, run: MotionRun, weights: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives (..., d) of d weighted sums of the samples by the first q and v, b, and the parameters.

    The weights are an array (k, orders, 4 n + 4, d); the instants of the samples are fixed.
    """
    d, given_layout, model = weights.shape[3], tangent.layout, tangent.form.equations.model
    free = given_layout["q"].stop
    first_layout = Layout.of(q=free, v=free, excitation=EXCITATION, parameters=run.parameters.size)
    p, b = np.zeros((run.parameters.size, d)), np.zeros((run.passages[0].excitation.parameters.size, d))
    q = v = np.zeros((free, d))
    for passage in reversed(run.passages):
        excitation, a = passage.excitation, np.zeros((free, d))
        stages = passage.stage_jacobians()[::-1]
        for (step, samples, factors), jacobians in zip(
            tangent.steps(run, passage, backwards=True), stages, strict=True
        ):
            ends = _sampled(model, run, passage, step, samples, weights, b)
            q, v, a = ends[3] + q, ends[4] + v, ends[5] + a
            by_velocities = RADAU.inverse[-1] / step.length
            velocities = np.multiply.outer(by_velocities, a)
            velocities[-1] += v
            increments = np.einsum("ji,jkl->ikl", RADAU.inverse, velocities) / step.length
            increments[-1] += q
            found = tangent.given(step, factors, run.parameters, increments.reshape(-1, d))
            by_q, by_v, given, parameters = given_layout.split(found)
            b += np.einsum("sem,sed->md", jacobians, given.reshape(STAGES, EXCITATION, d))
            p += parameters
            q = ends[0] + q + by_q
            v = ends[1] - by_velocities.sum() * a + by_v
            a = ends[2]
        by_q, by_v, given, parameters = first_layout.split(passage.acceleration_jacobian.T @ a)
        q, v = q + by_q, v + by_v
        b += excitation.jacobian(excitation.begin).T @ given
        p += parameters
    first, still = run.passages[0], weights[run.rest, 0].sum(axis=0)
    b += first.excitation.jacobian(first.excitation.begin)[:NODE].T @ model.of_base(still)
    return np.vstack([q + model.of_free(still), v]), b, p


def _sampled(
    model: Model, run: MotionRun, passage: Passage, step: RadauStep, samples: Index, weights: Array, b: Array
) -> Array:
    """Return the weights (6, N, d) of q, v and a at both ends of a step from its samples; add those of b to ``b``."""
    if not samples.size:
        return np.zeros((6, model.freedoms, weights.shape[3]))
    times, orders = run.times[samples], weights.shape[1]
    own = np.moveaxis(weights[samples], 2, 0)
    b += np.einsum("soim,isod->md", clamp_jacobians(passage.excitation, times, orders), model.of_base(own))
    return np.asarray(np.einsum("soe,isod->eid", sample_weights(step, times, orders), model.of_free(own)))


def _bound(function: cs.Function) -> StepFunction:
    """Return a Function (Z, h, u, [vector]) that is evaluated for a step and each column of vectors."""
    inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
    call = Buffered(function, *inputs)

    def evaluate(step: RadauStep, parameters: Array, vectors: Array = NO_VECTOR) -> Array:
        u = np.concatenate([step.q, step.v, step.excitations.ravel(), parameters])
        for array, given in zip(inputs, (step.increments.ravel(), np.array(step.length), u), strict=False):
            array[:] = given
        columns = []
        for column in vectors.T:
            inputs[-1][: len(column)] = column
            columns.append(call()[0].copy())
        return np.column_stack(columns)

    return evaluate
