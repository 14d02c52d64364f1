"""A computed motion, the linearised equations of its Radau steps, and its derivatives through them.

Let R(Z, u) be the residual of the stages, as in ``collocation`` but in the laboratory frame, and u = (q, v,
excitations, parameters) the data of the step.  With G = dR/dZ, its derivatives obey G dZ + R_u du = 0.

G is banded if the unknowns are ordered by nodes, with the stages of a node side by side.  Its low-rank part is handled
by Woodbury's identity.  With B_i turned with the clamp at stage i, and U = diag(B_i diag(d)), this part is

    (A^-1)_ij/h B_i diag(d) B_i^T = (U V^T)_ij,    V_ji = (A^-1)_ij/h B_i.

Relaxation.  If the law has Maxwell branches, u also holds the internal strains z_0 at the start of the step.  The
overstrains at stage i depend on the strains at all stages j (``collocation``); with the Jacobian J_i of the scaled
strains at stage i, this adds to the blocks of G

    sum_b g_b W^b_ij J_i^T J_j.

The internal strains at the end are functions of Z and u, and start the next step with q and v.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import casadi as cs
import numpy as np
import scipy.sparse

from ancf_casadi.dynamics.equations import Balance, Equations, as_they_are
from ancf_casadi.dynamics.excitation import EXCITATION, SAME_TIME, Excitation
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.stepper import RadauSteps
from ancf_casadi.dynamics.radau.tableau import QUINTIC, RADAU, STAGES, powers
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array, Index, Layout
from ancf_casadi.support.banded import BandedFactors, lapack_place, lapack_storage
from ancf_casadi.support.compilation import Buffered, compile_together
from ancf_casadi.support.interrupts import has_interrupt


@dataclass(frozen=True, eq=False)
class Passage:
    """A smooth piece of a computed motion."""

    excitation: Excitation
    acceleration_jacobian: Array  # of the first a with respect to q, v, the excitation and the parameters, (N, ...)
    steps: RadauSteps
    samples: list[Index]  # indices of the samples in each step

    @cached_property
    def owned(self) -> tuple[Index, Index]:
        """Indices of all samples in the piece, and those of their steps."""
        owner = np.repeat(np.arange(len(self.samples)), [samples.size for samples in self.samples])
        return np.concatenate(self.samples), owner

    def stage_jacobians(self) -> Array:
        """Return the derivatives of the excitation by the m parameters of the base at the stages, (steps, 3, 16, m)."""
        times = self.steps.instants[:-1, None] + RADAU.nodes * self.steps.lengths[:, None]
        return self.excitation.jacobians(times.ravel()).reshape(*times.shape, EXCITATION, -1)


@dataclass(frozen=True, eq=False)
class MotionRun:
    """A computed motion, sampled at k instants."""

    parameters: Array  # of the equation of motion
    times: Array  # the samples (k,), s, on the clock of the base motion
    rest: Index  # indices of the samples before the motion, at rest
    start_jacobian: Array  # of the first q and v with respect to theta, b, P, m and s, (2 N, ...)
    relaxed_jacobian: Array  # of the initial internal strains with respect to q and ``parameters``, (m b n, ...)
    passages: list[Passage]  # its smooth pieces
    samples: Array  # nodal coordinates and their time derivatives, (k, orders, rows)
    maps: tuple[Array, Array]  # from the free coordinates and the base to the rows, (rows, N) and (rows, 4)
    weights: Array  # of q, v and a at both ends of its step in each sample, (k, orders, 6)
    rates: Array  # time derivatives of ``samples``, if there are shifts; else (0,)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(passage.steps.lengths.size for passage in self.passages)


def stop_if_interrupted() -> None:
    """Raise a SimulationError if ``noted_interrupts`` has noted a Ctrl-C."""
    if has_interrupt():
        raise SimulationError("the motion was interrupted")


def stage_motion(z: cs.MX, q: cs.MX, v: cs.MX, h: cs.MX, excitations: cs.MX) -> tuple[list[tuple[cs.MX, cs.MX]], cs.MX]:
    """Return q, v and a at the stages, (N, 3), each with that of the base, (4, 3), and the load (4, 3)."""
    inverse = cs.DM(RADAU.inverse).T
    velocities = z @ inverse / h
    accelerations = (velocities - cs.repmat(v, 1, STAGES)) @ inverse / h
    *nodes, load = cs.vertsplit(excitations, NODE)
    return list(zip((cs.repmat(q, 1, STAGES) + z, velocities, accelerations), nodes, strict=True)), load


def sample_weights(passages: Sequence[Passage], times: Array, orders: int) -> Array:
    """Return the weights (k, orders, 6) of q, v and a at both ends of its step in each sample and its derivatives."""
    result = np.zeros((times.size, orders, 6))
    for passage in passages:
        inside, owner = passage.owned
        h = passage.steps.lengths[owner]
        x = (times[inside] - passage.steps.instants[owner]) / h
        values = np.array(powers(x, orders))
        scaled = np.array([h**0, h, h**2]) / h ** np.arange(orders)[:, None, None]
        result[inside] = np.einsum("omk,em,oek->koe", values, QUINTIC, np.tile(scaled, (1, 2, 1)))
    return result


def clamp_jacobians(excitation: Excitation, times: Array, orders: int) -> Array:
    """Return the derivatives (s, orders, 4, m) of samples of the clamped node by the m parameters of the base."""
    return excitation.jacobians(times)[:, : orders * NODE].reshape(times.size, orders, NODE, -1)


def samples_by_step(times: Array, instants: Array, *, first: bool) -> list[Index]:
    """Return the indices of the samples in each step of a piece, whose steps are those between instants.

    The ``first`` piece has its first instant too.
    """
    begin, ends = instants[0], instants[1:]
    slack = SAME_TIME * (ends[-1] - begin)
    inside = np.flatnonzero((times <= ends[-1] + slack) & (times > (begin - slack if first else begin + slack)))
    owner = np.minimum(np.searchsorted(ends, times[inside] - slack), len(ends) - 1)
    order = np.argsort(owner, kind="stable")
    return np.split(inside[order], np.searchsorted(owner[order], np.arange(1, len(ends))))


def sample_motion(
    maps: tuple[Array, Array], passages: Sequence[Passage], weights: Array, times: Array, before_start: Index
) -> Array:
    """Return the samples at ``times`` (k,) and their time derivatives, (k, orders, rows)."""
    (of_free, of_base), begin = maps, passages[0].excitation.begin
    result = np.zeros((*weights.shape[:2], len(of_free)))
    node = passages[0].excitation.at(begin)[:NODE]
    result[before_start, 0] = of_free @ passages[0].steps.q[0] + of_base @ node
    for passage in passages:
        inside, owner = passage.owned
        used, owner = np.unique(owner, return_inverse=True)
        steps = passage.steps
        first = np.stack([steps.q[used], steps.v[used], steps.a[used]], axis=1)
        last = end_maps(steps.lengths[used]) @ np.concatenate([first[:, :2], steps.increments[used]], axis=1)
        ends = np.concatenate([first, last], axis=1) @ of_free.T
        node = passage.excitation.derivatives(times[inside]).reshape(-1, 4, NODE)  # a piece may hold no sample
        base = node[:, : weights.shape[1]]
        result[inside] = weights[inside] @ ends[owner] + base @ of_base.T
    return result


def end_maps(lengths: Array) -> Array:
    """Return the maps (s, 3, 5) from q, v and the three increments of steps to q, v and a at their ends."""
    last, h = RADAU.inverse[-1], lengths[:, None]
    maps = np.zeros((lengths.size, 3, 2 + STAGES))
    maps[:, 0, [0, -1]] = 1.0
    maps[:, 1, 2:] = last / h
    maps[:, 2, 1:2] = -last.sum() / h
    maps[:, 2, 2:] = last @ RADAU.inverse / h**2
    return maps


class BoundStep:
    """A Function (Z, h, u, vectors) bound to arrays; a call returns its outputs, the same arrays each time."""

    def __init__(self, function: cs.Function) -> None:
        self._inputs = [np.zeros(function.numel_in(k)) for k in range(4)]
        self._call = Buffered(function, *self._inputs)
        self.vectors = self._inputs[-1].reshape(function.size_in(3), order="F").T  # (d, ...)

    def at(self, steps: RadauSteps, k: int, parameters: Array) -> BoundStep:
        """Set Z, h and u to those of the k-th step."""
        z, h, u, _ = self._inputs
        z[:], h[0] = steps.increments[k].ravel(), steps.lengths[k]
        data = steps.q[k], steps.v[k], steps.excitations[k].ravel(), parameters, steps.internal[k]
        np.concatenate(data, out=u)
        return self

    def __call__(self) -> list[Array]:
        """Evaluate."""
        return self._call()


@dataclass(frozen=True, eq=False)
class Tangent:
    """The Functions of a linearised step, of Z (N, 3), the step h, and u.

    u = (q, v, excitations by stage, parameters, z_0).
    """

    form: Collocation

    @cached_property
    def layout(self) -> Layout:
        """Layout of u."""
        equations, free = self.form.equations, self._free
        sizes = {"parameters": equations.layout.size, "internal": equations.internal_size}
        return Layout.of(q=free, v=free, excitations=STAGES * EXCITATION, **sizes)

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
        """(q, v, a, excitation, parameters, z) -> Jacobian of the forces on the free coordinates for all but a."""
        q, v, a = (cs.MX.sym(name, self._free) for name in "qva")
        excitation, p = cs.MX.sym("excitation", EXCITATION), cs.MX.sym("p", self.form.equations.layout.size)
        balance = Collocation(replace(self.form.equations, make=as_they_are)).balance
        internal = cs.MX.sym("internal", *self.form.equations.internal_shape)
        forces = balance(q, v, a, excitation, p, internal)
        jacobian = cs.horzcat(*(cs.jacobian(forces, x) for x in (q, v, excitation, p, internal)))
        return cs.Function("force_jacobian", [q, v, a, excitation, p, internal], [jacobian])

    @cached_property
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
    def assembly(self) -> scipy.sparse.csr_array:
        """The matrix that sums the entries of K, D/h and M/h^2 of all elements to G, without its low-rank part.

        G is in the band storage of LAPACK, column by column.  The entries that Maxwell branches add to the blocks
        (i, j) follow, block by block.
        """
        first, equations = RADAU.inverse, self.form.equations
        bands = [self._band(w) for w in (np.eye(STAGES), first, first @ first)]
        if equations.branches:
            size = (2 * NODE) ** 2 * equations.model.beam.elements
            units = np.eye(STAGES**2).reshape(-1, STAGES, STAGES)
            # entries of the element matrices of stage i, of the beam elements only
            bands += [self._band(unit)[:, int(unit.argmax()) // STAGES * self._entries :][:, :size] for unit in units]
        return scipy.sparse.csr_array(scipy.sparse.hstack(bands))

    @property
    def _entries(self) -> int:
        """Number of entries of all element matrices."""
        return int(self.form.equations.model.entries[0].size)

    def _all_entries(self, entries: Array) -> Array:
        """Return the entries for ``assembly`` from those of ``_linearisation``, which end with W and all J."""
        if not self.form.equations.branches:
            return entries
        count = 3 * STAGES * self._entries
        weights, gradients = np.split(entries[count:], [STAGES**2])
        J = gradients.reshape(STAGES, self.form.equations.model.beam.elements, 2 * NODE, -1)
        blocks = np.einsum("ij,ieam,jebm->ijeba", weights.reshape(STAGES, STAGES, order="F"), J, J)
        return np.concatenate([entries[:count], blocks.ravel()])

    def _linearisation(self, d: int) -> cs.Function:
        """(Z, h, u, du) -> entries of K, D/h and M/h^2 of all elements at the stages, and R_u du for d directions."""
        z, h, u = self._symbols
        du = cs.MX.sym("du", u.numel(), d)
        motion, load = self._motion(z, h, u)
        all_nodes = [self.form.equations.model.whole(*pair) for pair in motion]
        (e, e_t, _), balance, form = all_nodes, self._balance(u), self.form
        (overstrains, _), by_stage, further = self._relaxation(motion, balance, h, u), None, []
        if overstrains is not None:
            model = form.equations.model
            places = np.arange(STAGES * model.beam.elements).reshape(-1, STAGES).T.ravel().tolist()
            by_stage = overstrains[:, places]
            (J,), _ = form.equations.map_elements("gradients", balance, e, groups={0: model.groups[0]})
            moduli, _ = form.equations.law.branches(balance.coefficients)
            weights = [g * w[0] for g, w in zip(cs.vertsplit(moduli), form.branch_weights(h, balance), strict=True)]
            further = [cs.vec(sum(weights[1:], weights[0])), cs.vec(J)]
        k, damping, m = balance.tangents(e, e_t, load, by_stage)
        entries = cs.vertcat(cs.vec(k), cs.vec(damping) / h, cs.vec(m) / h**2, *further)
        residual = self._residual(motion, all_nodes, balance, u, overstrains)
        product = cs.densify(cs.jtimes(residual, u, du)) if d else cs.MX(0, 1)
        return cs.Function("linearised", [z, h, u, du], [cs.densify(entries), product], {"is_diff_in": [False] * 4})

    def _residual(
        self,
        motion: Sequence[tuple[cs.MX, cs.MX]],
        all_nodes: Sequence[cs.MX],
        balance: Balance,
        u: cs.MX,
        overstrains: cs.MX | None,
    ) -> cs.MX:
        """Return R (3 N,), stage by stage, from the motion as of ``stage_motion``, and that of all nodes."""
        form, excitations = self.form, cs.reshape(u[self.layout["excitations"]], EXCITATION, STAGES)
        of_links = [form.links.ends(node, free) for free, node in motion]
        columns = form.element_columns(balance)
        on_links, further = form.forces(of_links, all_nodes, excitations, balance, columns, overstrains)
        further += balance.of_low_rank(excitations[2:NODE, :], all_nodes[1])
        return cs.vec(form.equations.model.of_free(further + form.links.sum_at_nodes(on_links)))

    def _relaxation(
        self, motion: Sequence[tuple[cs.MX, cs.MX]], balance: Balance, h: cs.MX, u: cs.MX
    ) -> tuple[cs.MX | None, cs.MX]:
        """Return the results of ``Collocation.relaxation``."""
        form, (free, node) = self.form, motion[0]
        internal = cs.reshape(u[self.layout["internal"]], form.equations.internal_shape)
        return form.relaxation(form.links.ends(node, free), form.element_columns(balance), internal, h, balance)

    def relaxation(self, d: int, *, transposed: bool = False) -> BoundStep:
        """(Z, h, u, (dZ, du)) -> derivatives of the internal strains at the end, for d directions.

        If ``transposed``, the vectors are weights of these internal strains, and the results are weights of (Z, u).
        """
        if (d, transposed) not in self._bound:
            z, h, u = self._symbols
            internal = cs.vec(self._relaxation(self._motion(z, h, u)[0], self._balance(u), h, u)[1])
            vectors = cs.MX.sym("vectors", internal.numel() if transposed else z.numel() + u.numel(), d)
            if transposed:
                products = [cs.jtimes(internal, x, vectors, True) for x in (z, u)]
                product = cs.vertcat(*(cs.reshape(x, -1, d) for x in products))
            else:
                dz, du = cs.vertsplit(vectors, [0, z.numel(), z.numel() + u.numel()])
                product = cs.jtimes(internal, z, cs.reshape(dz, z.size1(), -1)) + cs.jtimes(internal, u, du)
            function = cs.Function("relaxation", [z, h, u, vectors], [cs.densify(product)], {"is_diff_in": [False] * 4})
            self._bound[d, transposed] = BoundStep(function)
        return self._bound[d, transposed]

    def factors(self, entries: Array, steps: RadauSteps, k: int, modal_coefficients: Array) -> BandedFactors:
        """Return the factors of G for the entries that ``_linearisation`` returns for the k-th step."""
        storage, h = lapack_storage(self.assembly @ self._all_entries(entries), self.bandwidth), float(steps.lengths[k])
        return BandedFactors.of(storage, self.bandwidth, *self.low_rank(steps.excitations[k], h, modal_coefficients))

    def modal_coefficients(self, parameters: Array) -> Array:
        """Return the coefficients of the low-rank part of the damping force."""
        return np.asarray(self._modal_coefficients(parameters).full().ravel())

    @cached_property
    def _modal_coefficients(self) -> cs.Function:
        parameters = cs.MX.sym("parameters", self.form.equations.layout.size)
        coefficients = self.form.equations.balance(parameters).modal_coefficients
        return cs.Function("modal_coefficients", [parameters], [cs.densify(coefficients)])

    def bound(self, directions: int) -> BoundStep:
        """Return ``_linearisation``, bound to arrays."""
        if directions not in self._bound:
            self._bound[directions] = BoundStep(self._linearisation(directions))
        return self._bound[directions]

    @cached_property
    def _bound(self) -> dict[int | tuple[int, bool], BoundStep]:
        """The Functions of ``bound`` and ``relaxation`` by their arguments, as far as used."""
        return {}

    def adjoint_product(self, bound: BoundStep, factors: BandedFactors, weights: Array) -> Array:
        """Return -R_u^T G^-T w for weights w of the increments, (3 N, d); ``bound`` is ``transposed`` at the step."""
        residuals, columns = -factors.solve_transpose(weights[self.inverse_order])[self.order], []
        for column in residuals.T:
            bound.vectors[0] = column
            columns.append(bound()[0].copy())
        return np.column_stack(columns)

    @cached_property
    def transposed(self) -> BoundStep:
        """(Z, h, u, w) -> R_u^T w."""
        z, h, u = self._symbols
        w = cs.MX.sym("w", len(self.order))
        motion, _ = self._motion(z, h, u)
        all_nodes = [self.form.equations.model.whole(*pair) for pair in motion]
        balance = self._balance(u)
        residual = self._residual(motion, all_nodes, balance, u, self._relaxation(motion, balance, h, u)[0])
        product = cs.densify(cs.jtimes(residual, u, w, True))
        return BoundStep(cs.Function("tangent_product", [z, h, u, w], [product], {"is_diff_in": [False] * 4}))

    def _band(self, weights: Array) -> scipy.sparse.csc_array:
        """Return the matrix that sums weighted element matrices of the stages into band storage.

        Weight (i, j) belongs to the derivative of the residual at stage i with respect to the increments at stage j.
        """
        model = self.form.equations.model
        indices, rows, columns, products = model.free_entries
        count = model.entries[0].size
        width, shape = self.bandwidth, (STAGES * self._free, count * STAGES)
        places, entries, values = [], [], []
        for i, j in np.argwhere(weights):
            row, column = self.order[rows + i * self._free], self.order[columns + j * self._free]
            places.append(lapack_place(row, column, width))
            entries.append(indices + i * count)
            values.append(weights[i, j] * products)
        return scipy.sparse.csc_array(
            (np.concatenate(values), (np.concatenate(places), np.concatenate(entries))),
            shape=((3 * width + 1) * shape[0], shape[1]),
        )

    def relaxed_jacobian(self, state: State, parameters: Array) -> Array:
        """Return the derivatives of the internal strains of a state with respect to q and parameters, (m b n, ...)."""
        equations = self.form.equations
        if state.internal is not None or not equations.branches:
            return np.zeros((equations.internal_size, self._free + parameters.size))
        return np.asarray(self._relaxed_jacobian(state.coordinates, parameters).full())

    @cached_property
    def _relaxed_jacobian(self) -> cs.Function:
        equations = replace(self.form.equations, make=as_they_are)
        e, p = cs.MX.sym("e", equations.model.size), cs.MX.sym("p", equations.layout.size)
        relaxed = equations.relaxed(e, p)
        by_q = cs.jacobian(relaxed, e) @ equations.model.whole_of_free
        return cs.Function("relaxed_jacobian", [e, p], [cs.horzcat(by_q, cs.jacobian(relaxed, p))])

    @property
    def _free(self) -> int:
        return self.form.equations.free

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        return cs.MX.sym("Z", self._free, STAGES), cs.MX.sym("h"), cs.MX.sym("u", self.layout.size)

    def _balance(self, u: cs.MX) -> Balance:
        return self.form.equations.balance(u[self.layout["parameters"]])

    def _motion(self, z: cs.MX, h: cs.MX, u: cs.MX) -> tuple[list[tuple[cs.MX, cs.MX]], cs.MX]:
        """Return the outputs of ``stage_motion``."""
        q, v, excitations, *_ = cs.vertsplit(u, self.layout.offsets)
        return stage_motion(z, q, v, h, cs.reshape(excitations, EXCITATION, STAGES))


@lru_cache(8)
def shared_tangent(equations: Equations) -> Tangent:
    """Return the Functions of the linearised steps under some equations; all motions under them share these."""
    return Tangent(Collocation(replace(equations, make=partial(compile_together, derivatives=True))))


def forward(tangent: Tangent, run: MotionRun, start: Array, b: Array, parameters: Array) -> Array:
    """Return the derivatives of the samples along d directions, (k, orders, rows, d), at fixed instants.

    The directions (..., d) are those of the first q and v, of b, and of the parameters of the equation of motion.
    """
    free, d = len(start) // 2, start.shape[1]
    (of_free, of_base), orders = run.maps, run.samples.shape[1]
    result = np.zeros((*run.samples.shape, d))
    first, layout = run.passages[0], tangent.layout
    by_clamp = first.excitation.jacobian(first.excitation.begin)[:NODE]
    result[run.rest, 0] = of_free @ start[:free] + of_base @ (by_clamp @ b)
    bound, order = tangent.bound(d), tangent.inverse_order
    du = bound.vectors
    du[:, layout["parameters"]] = parameters.T
    motion = np.zeros((d, 2 + STAGES, free))  # derivatives of q, v and Z
    motion[:, :2] = start.T.reshape(d, 2, free)
    dZ = motion[:, 2:].reshape(d, -1)
    dz = (run.relaxed_jacobian @ np.vstack([start[:free], parameters])).T
    modal_coefficients = tangent.modal_coefficients(run.parameters)
    for passage in run.passages:
        excitation, steps = passage.excitation, passage.steps
        q_v = motion[:, :2].reshape(d, -1)
        by_first = np.vstack([q_v.T, excitation.jacobian(excitation.begin) @ b, parameters, dz.T])
        da = (passage.acceleration_jacobian @ by_first).T[:, None]
        stages = (passage.stage_jacobians() @ b).reshape(-1, STAGES * EXCITATION, d)
        rows = np.empty((len(stages) + 1, d, 3, len(of_free)))  # derivatives of q, v and a at the ends of the steps
        rows[0] = np.concatenate([motion[:, :2], da], axis=1) @ of_free.T
        for k, (by_stage, end_map) in enumerate(zip(stages, end_maps(steps.lengths), strict=True)):
            stop_if_interrupted()
            du[:, : 2 * free], du[:, layout["excitations"]] = motion[:, :2].reshape(d, -1), by_stage.T
            du[:, layout["internal"]] = dz
            entries, product = bound.at(steps, k, run.parameters)()
            factors = tangent.factors(entries, steps, k, modal_coefficients)
            dZ[:, order] = -factors.solve(product.reshape(d, -1)[:, order].T, overwrite=True).T
            if dz.size:
                relaxation = tangent.relaxation(d)
                relaxation.vectors[:, : dZ.shape[1]], relaxation.vectors[:, dZ.shape[1] :] = dZ, du
                dz = relaxation.at(steps, k, run.parameters)()[0].reshape(d, -1).copy()
            end = end_map @ motion
            motion[:, :2] = end[:, :2]
            rows[k + 1] = end @ of_free.T
        inside, owner = passage.owned
        weights = run.weights[inside]
        for j, of_direction in enumerate(np.moveaxis(rows, 1, 0)):
            result[inside, ..., j] = weights[..., :3] @ of_direction[owner] + weights[..., 3:] @ of_direction[owner + 1]
        if b.size:
            result[inside] += of_base @ (clamp_jacobians(excitation, run.times[inside], orders) @ b)
    return result


def reverse(tangent: Tangent, run: MotionRun, weights: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives (..., d) of d weighted sums of the samples by the first q and v, b, and the parameters.

    The weights are an array (k, orders, rows, d); the instants of the samples are fixed.
    """
    d, step_layout, (of_free, of_base) = weights.shape[3], tangent.layout, run.maps
    bound, modal_coefficients = tangent.bound(0), tangent.modal_coefficients(run.parameters)
    free = step_layout["q"].stop
    internal_size = tangent.form.equations.internal_size
    sizes = {"excitation": EXCITATION, "parameters": run.parameters.size, "internal": internal_size}
    first_layout, z = Layout.of(q=free, v=free, **sizes), np.zeros((internal_size, d))
    p, b = np.zeros((run.parameters.size, d)), np.zeros((run.passages[0].excitation.parameters.size, d))
    q = v = np.zeros((free, d))
    for passage in reversed(run.passages):
        excitation, a = passage.excitation, np.zeros((free, d))
        steps, stages = passage.steps, passage.stage_jacobians()
        maps = end_maps(steps.lengths)
        for k in reversed(range(steps.lengths.size)):
            stop_if_interrupted()
            entries, _ = bound.at(steps, k, run.parameters)()
            factors = tangent.factors(entries, steps, k, modal_coefficients)
            ends = _sample_adjoint(run, passage, passage.samples[k], weights, b)
            at_end = ends[3:] + np.array([q, v, a])
            by_start, weights_of_z = np.split(np.tensordot(maps[k].T, at_end, 1), [2])
            weights_of_z = weights_of_z.reshape(-1, d)
            by_relaxation = np.zeros((weights_of_z.shape[0] + step_layout.size, d))
            if internal_size:
                relaxation = tangent.relaxation(d, transposed=True)
                relaxation.vectors[:] = z.T
                by_relaxation = relaxation.at(steps, k, run.parameters)()[0].reshape(d, -1).T
            transposed = tangent.transposed.at(steps, k, run.parameters)
            by_increments, direct = np.split(by_relaxation, [weights_of_z.shape[0]])
            adjoint = tangent.adjoint_product(transposed, factors, weights_of_z + by_increments) + direct
            by_q, by_v, by_excitation, parameters, z = step_layout.split(adjoint)
            b += np.einsum("sem,sed->md", stages[k], by_excitation.reshape(STAGES, EXCITATION, d))
            p += parameters
            q, v, a = ends[0] + by_start[0] + by_q, ends[1] + by_start[1] + by_v, ends[2]
        by_q, by_v, by_excitation, parameters, by_internal = first_layout.split(passage.acceleration_jacobian.T @ a)
        q, v, z = q + by_q, v + by_v, z + by_internal
        b += excitation.jacobian(excitation.begin).T @ by_excitation
        p += parameters
    by_q, parameters = np.split(run.relaxed_jacobian.T @ z, [free])
    q, p = q + by_q, p + parameters
    first, still = run.passages[0], weights[run.rest, 0].sum(axis=0)
    b += first.excitation.jacobian(first.excitation.begin)[:NODE].T @ (of_base.T @ still)
    return np.vstack([q + of_free.T @ still, v]), b, p


def _sample_adjoint(run: MotionRun, passage: Passage, samples: Index, weights: Array, b: Array) -> Array:
    """Return the weights (6, N, d) of q, v and a at both ends of a step from its samples; add those of b to ``b``."""
    of_free, of_base = run.maps
    if not samples.size:
        return np.zeros((6, of_free.shape[1], weights.shape[3]))
    step_weights = weights[samples]  # (s, orders, rows, d)
    jacobians = clamp_jacobians(passage.excitation, run.times[samples], weights.shape[1])
    b += np.einsum("soim,isod->md", jacobians, np.tensordot(of_base.T, step_weights, (1, 2)))
    return np.asarray(np.einsum("soe,isod->eid", run.weights[samples], np.tensordot(of_free.T, step_weights, (1, 2))))
