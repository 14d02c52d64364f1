"""Exact derivatives of a motion by the parameters of its law, its base motion, its elements and its start.

Derivatives are those of the steps of ``radau`` that were taken, their lengths held: exact for the numbers that were
computed, and as close to those of the exact motion as these are.  With the residual R of the stages (``tangent``),
G = dR/dZ, and what is given for a step in u = (q, v, clamped nodes, parameters),

    forward     dZ = -G^-1 R_u du,    dV = A^-1 dZ/h,    da = A^-1 (dV - dv)/h,

of which the last stage starts the next step, and in reverse the same steps backwards with G^T.

Samples are the quintic polynomials through the ends of the steps; what ``simulate`` adds there, to put the axial forces
right, is below the tolerance.  A start at rest depends on the properties P of the elements, and on the load that holds
it, through the static equilibrium (``starts``).

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Section IV.8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.dynamics.base_motion import BaseMotion, Piece
from ancf_casadi.dynamics.derivatives.release_load import START, held_start, start_slopes
from ancf_casadi.dynamics.derivatives.tangent import Tangent
from ancf_casadi.dynamics.equations import Equations, clamped_node
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.stepper import Step, Stepper
from ancf_casadi.dynamics.radau.tableau import QUINTIC, RADAU, STAGES
from ancf_casadi.dynamics.segments import CLOSE
from ancf_casadi.dynamics.start import Start, initial_state, rigid_motion
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import Factors, lapack_storage
from ancf_casadi.support.compilation import Buffered, compiled
from ancf_casadi.support.interrupts import interrupted
from ancf_casadi.vibration.equilibrium import Equilibrium

Moving = Callable[[float], Array]

MOST_STEPS = 100_000  # of a motion; a minute or two, and 0.4 GB at 20 elements


@dataclass(frozen=True, eq=False)
class Passage:
    """A smooth piece of a motion that was computed.

    Parameters
    ----------
    node, slope : callable
        From the time to the clamped node (12,), and to its derivatives by the parameters of the base motion (12, m).
    begin : float
        Its first instant, s.
    acceleration : array (N, ...)
        Derivatives of the first accelerations by q, v, the clamped node and the parameters.
    steps : list of Step
        The steps.
    samples : list of array
        The samples of each step, as indices.
    """

    node: Moving
    slope: Moving
    begin: float
    acceleration: Array
    steps: list[Step]
    samples: list[Index]


@dataclass(frozen=True, eq=False)
class Run:
    """A motion that was computed.

    Parameters
    ----------
    values : array
        The values of theta, b, P and s it belongs to.
    parameters : array
        The parameters of its equation of motion.
    start : array (2 N, ...)
        Derivatives of the first q and v by theta, b, P and s.
    passages : list of Passage
        Its smooth pieces.
    coordinates : array (k, 4 n + 4)
        The nodal coordinates at the samples.
    """

    values: Array
    parameters: Array
    start: Array
    passages: list[Passage]
    coordinates: Array

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(len(passage.steps) for passage in self.passages)


@dataclass(frozen=True, eq=False)
class Problem:
    """A motion that depends on theta, b, P and, if it is let go from an unknown load, on this load and its rate s.

    Parameters
    ----------
    equations : Equations
        The equation of motion, with the nominal parameters.
    base : BaseMotion
        Motion of the clamp.
    start : str, Equilibrium or State
        The start.
    times : array (k,)
        The samples, s.
    tolerance : float
        Tolerance of the steps.
    held : bool
        Whether the load at the start and its rate are parameters, in the order of ``START``.
    most_steps : int
        Steps after which a motion is given up.
    """

    equations: Equations
    base: BaseMotion
    start: Start | Equilibrium | State
    times: Array
    tolerance: float
    held: bool = False
    most_steps: int = MOST_STEPS

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Number of parameters of the law and of the base motion, of properties, and of parameters of the start."""
        law = len(self.equations.law.parameters)
        return law, len(self.base.parameters), self.equations.model.properties.size, len(START) * self.held

    def split(self, values: Array) -> list[Array]:
        """Return theta, b, P and s from one array."""
        return np.split(values, np.cumsum(self.sizes[:3]).tolist())

    def solve(self, values: Array, most_steps: int | None = None) -> Run:
        """Compute the motion for the values of theta, b, P and s, one after the other.

        Raises
        ------
        AncfError
            If there is no equilibrium to start from, the integrator fails or takes more steps than ``most_steps``, or
            there is a Ctrl-C that ``noted_interrupts`` has noted.
        """
        law, _, size, _ = self.sizes
        theta, b, properties, load = self.split(values)
        model = self.equations.model
        parameters = self.equations.parameters.copy()
        parameters[2 : 2 + size], parameters[2 + size : 2 + size + law] = properties, theta
        columns = properties.reshape(model.properties.shape, order="F")
        beam = model.beam.with_(**{name: row.tolist() for name, row in zip(PROPERTIES, columns, strict=True)})
        state, slope = self._start(Model(beam, model.measures), b, load)
        passages, begin, end = [], float(self.times[0]), float(self.times[-1])
        left = self.most_steps if most_steps is None else most_steps
        for piece in self._pieces:
            passage, state = self._pass(piece, begin, min(piece.end, end), state, parameters, b, max(left, 1))
            passages.append(passage)
            left -= len(passage.steps)
            begin = piece.end
            if begin >= end:
                break
        run = Run(values, parameters, slope, passages, np.zeros((self.times.size, model.size)))
        for passage in passages:
            for step, samples in zip(passage.steps, passage.samples, strict=True):
                ends = np.array([step.q, step.v, step.a, *_end(step)])
                for sample in samples:
                    time = float(self.times[sample])
                    run.coordinates[sample, :NODE] = passage.node(time)[:NODE]
                    run.coordinates[sample, NODE:] = _shares(step, time) @ ends
        return run

    def forward(self, run: Run, seeds: Array) -> Array:
        """Return the derivatives of the coordinates, (k, 4 n + 4, d), along directions of the values, (..., d)."""
        free, d = self.equations.free, seeds.shape[1]
        dp, db = self._expand(seeds)
        dq, dv = np.split(run.start @ seeds, [free])
        result = np.zeros((*run.coordinates.shape, d))
        product = self._products[0]
        for passage in run.passages:
            da = passage.acceleration @ np.vstack([dq, dv, passage.slope(passage.begin) @ db, dp])
            for step, samples, factors in self._linearised(run, passage):
                nodes = np.vstack([passage.slope(step.start + c * step.length) @ db for c in RADAU.nodes.tolist()])
                given = np.vstack([dq, dv, nodes, dp])
                right = np.column_stack([product(step, run.parameters, direction) for direction in given.T])
                dz = -factors.solve(right[self._tangent.inverse_order], overwrite=True)[self._tangent.order].reshape(
                    STAGES, free, d
                )
                rates = np.einsum("ij,jkl->ikl", RADAU.inverse, dz) / step.length
                accelerations = np.tensordot(RADAU.inverse[-1], rates - dv, 1) / step.length
                ends = np.array([dq, dv, da, dq + dz[-1], rates[-1], accelerations])
                for sample in samples:
                    time = float(self.times[sample])
                    result[sample, :NODE] = passage.slope(time)[:NODE] @ db
                    result[sample, NODE:] = np.tensordot(_shares(step, time), ends, 1)
                dq, dv, da = ends[3:]
        return result

    def reverse(self, run: Run, seeds: Array) -> Array:
        """Return the derivatives by the values, (..., d), of d sums of the coordinates weighted by (k, 4 n + 4, d)."""
        free, d = self.equations.free, seeds.shape[2]
        own = 2 * free
        product = self._products[1]
        bar_p, bar_b = np.zeros((run.parameters.size, d)), np.zeros((self.sizes[1], d))
        q = v = np.zeros((free, d))
        for passage in reversed(run.passages):
            a = np.zeros((free, d))
            for step, samples, factors in self._linearised(run, passage, backwards=True):
                ends = np.zeros((6, free, d))
                for sample in samples:
                    time = float(self.times[sample])
                    bar_b += passage.slope(time)[:NODE].T @ seeds[sample, :NODE]
                    ends += np.multiply.outer(_shares(step, time), seeds[sample, NODE:])
                q, v, a = ends[3] + q, ends[4] + v, ends[5] + a
                shares = RADAU.inverse[-1] / step.length
                rates = np.multiply.outer(shares, a)
                rates[-1] += v
                increments = np.einsum("ji,jkl->ikl", RADAU.inverse, rates) / step.length
                increments[-1] += q
                right = increments.reshape(-1, d)[self._tangent.inverse_order]
                residual = -factors.solve_transposed(right)[self._tangent.order]
                given = np.column_stack([product(step, run.parameters, direction) for direction in residual.T])
                nodes = given[own : own + STAGES * 3 * NODE].reshape(STAGES, 3 * NODE, d)
                for c, node in zip(RADAU.nodes.tolist(), nodes, strict=True):
                    bar_b += passage.slope(step.start + c * step.length).T @ node
                bar_p += given[own + STAGES * 3 * NODE :]
                q = ends[0] + q + given[:free]
                v = ends[1] - shares.sum() * a + given[free:own]
                a = ends[2]
            given = passage.acceleration.T @ a
            q, v = q + given[:free], v + given[free:own]
            bar_b += passage.slope(passage.begin).T @ given[own : own + 3 * NODE]
            bar_p += given[own + 3 * NODE :]
        law, _, size, start = self.sizes
        direct = np.vstack([bar_p[2 + size : 2 + size + law], bar_b, bar_p[2 : 2 + size], np.zeros((start, d))])
        return np.asarray(direct + run.start.T @ np.vstack([q, v]))

    @cached_property
    def _pieces(self) -> list[Piece]:
        """The pieces of the base motion that end after the start."""
        return self.base.pieces_after(float(self.times[0]))

    @cached_property
    def _form(self) -> Collocation:
        return Collocation(replace(self.equations, make=partial(compiled, derivatives=True)))

    @cached_property
    def _tangent(self) -> Tangent:
        return Tangent(self._form)

    @cached_property
    def _products(self) -> tuple[_Product, _Product]:
        """The products with R_u and its transpose."""
        return _Product(self._tangent.forward), _Product(self._tangent.reverse)

    @cached_property
    def _matrix(self) -> _Product:
        return _Product(self._tangent.matrix)

    @cached_property
    def _rates(self) -> cs.Function:
        p = cs.MX.sym("p", self.equations.parameters.size)
        return cs.Function("rates", [p], [self.equations.balance(p).modal_coefficients])

    @cached_property
    def _force_slopes(self) -> cs.Function:
        """(q, v, a, node, p) -> derivatives of the forces on the free coordinates by (q, v, node, p)."""
        free = self.equations.free
        q, v, a = (cs.MX.sym(name, free) for name in "qva")
        node, p = cs.MX.sym("node", 3 * NODE), cs.MX.sym("p", self.equations.parameters.size)
        motion = [cs.vertcat(part, x) for part, x in zip(cs.vertsplit(node, NODE), (q, v, a), strict=True)]
        forces, _ = Collocation(self.equations).balance(*motion, p)
        jacobians = [cs.jacobian(forces[NODE:], x) for x in (q, v, node, p)]
        return cs.Function("slopes", [q, v, a, node, p], jacobians)

    @cached_property
    def _start_slopes(self) -> cs.Function:
        return start_slopes(self.equations.model)

    def _start(self, model: Model, b: Array, load: Array) -> tuple[State, Array]:
        """Return the first state, and the derivatives of its q and v by the values."""
        free, piece = self.equations.free, self._pieces[0]
        node, slope, clamp = self._clamp(piece, b)
        slopes = np.zeros((2 * free, sum(self.sizes)))
        _, by_b, by_P, by_load = np.split(slopes, np.cumsum(self.sizes[:3]).tolist(), axis=1)
        if isinstance(self.start, State):
            return initial_state(model, clamp, self.start), slopes
        coordinates, velocities = model.straight, np.zeros(model.size)
        if self.start != "straight":
            held = held_start(model, self._start_slopes, self._load(load))
            coordinates, velocities = held.coordinates, held.velocities
            by_P[:] = held.by_properties
            by_load[:] = held.by_load[:, : by_load.shape[1]]
        if self.start == "impact":
            return State(coordinates, velocities), slopes
        e, rates = cs.MX.sym("e", model.size), cs.MX.sym("rates", NODE)
        moved = rigid_motion(model)(e, rates)
        jacobians = [cs.jacobian(moved[NODE:], e)[:, NODE:], cs.jacobian(moved[NODE:], rates)]
        motion = cs.Function("moved", [e, rates], [moved, *jacobians])(coordinates, node(0.0)[NODE : 2 * NODE])
        rigid, by_e, by_rates = (part.full() for part in motion)
        slopes[free:] += by_e @ slopes[:free]
        by_b[free:] += by_rates @ slope(0.0)[NODE : 2 * NODE]
        return State(coordinates, velocities + rigid.ravel()), slopes

    def _load(self, load: Array) -> Array:
        """Return the load at the start and its rate: the unknown one, or that of the equilibrium given."""
        if self.held:
            return load
        if isinstance(self.start, Equilibrium):
            return np.array([*self.start.tip_force, self.start.tip_moment, 0.0, 0.0, 0.0])
        return np.zeros(len(START))

    def _pass(
        self, piece: Piece, begin: float, end: float, state: State, parameters: Array, b: Array, most_steps: int
    ) -> tuple[Passage, State]:
        """Compute a smooth piece of the motion, and the state at its end, in no more than ``most_steps``."""
        node, slope, clamp = self._clamp(piece, b)
        stepper = Stepper(self._form, parameters, clamp, state, begin, end, self.tolerance)
        steps: list[Step] = []
        while not steps or stepper.now < end - CLOSE * steps[-1].length:
            if len(steps) >= most_steps:
                raise SimulationError(
                    f"the motion crawls: too many steps up to {stepper.now:g} s, lately of {steps[-1].length:.1e} s",
                    stepper.now,
                )
            _stop_if_interrupted()
            stepper.advance()
            steps.append(stepper.last)
        first = steps[0]
        slopes = self._force_slopes(first.q, first.v, first.a, node(begin), parameters)
        mass = self._form.mass(parameters)
        acceleration = -scipy.sparse.linalg.splu(mass).solve(np.hstack([part.full() for part in slopes]))
        ends = np.array([step.start + step.length for step in steps])
        inside = (self.times <= end * (1 + CLOSE)) & ((self.times > begin * (1 + CLOSE)) | (begin == self.times[0]))
        owner = np.minimum(np.searchsorted(ends, self.times * (1 - CLOSE)), len(steps) - 1)
        samples = [np.flatnonzero(inside & (owner == k)) for k in range(len(steps))]
        return Passage(node, slope, begin, acceleration, steps, samples), stepper.state

    def _linearised(
        self, run: Run, passage: Passage, *, backwards: bool = False
    ) -> Iterator[tuple[Step, Index, Factors]]:
        """Go through the steps of a piece, with their samples and the factors of G.

        Raises
        ------
        SimulationError
            If there is a Ctrl-C that ``noted_interrupts`` has noted.
        """
        order = -1 if backwards else 1
        rates = self._rates(run.parameters).full().ravel()
        tangent = self._tangent
        for step, samples in zip(passage.steps[::order], passage.samples[::order], strict=True):
            _stop_if_interrupted()
            band = self._matrix(step, run.parameters)
            low_rank = tangent.low_rank(step.clamps, step.length, rates)
            yield step, samples, Factors.of(lapack_storage(band, tangent.bandwidth), tangent.bandwidth, *low_rank)

    def _expand(self, seeds: Array) -> tuple[Array, Array]:
        """Return the directions of all parameters of the equation of motion, and of b, from those of the values."""
        law, _, size, _ = self.sizes
        theta, b, properties, _ = self.split(seeds)
        dp = np.zeros((self.equations.parameters.size, seeds.shape[1]))
        dp[2 : 2 + size], dp[2 + size : 2 + size + law] = properties, theta
        return dp, b

    def _clamp(self, piece: Piece, values: Array) -> tuple[Moving, Moving, cs.Function]:
        """Return what gives the clamped node, and its derivatives by b, at a time; the first as a Function too."""
        t, b = cs.MX.sym("t"), cs.MX.sym("b", self.sizes[1])
        node = clamped_node(self.equations.model, piece, t, b)
        slope = cs.Function("slope", [t, b], [cs.jacobian(node, b)])
        clamp = cs.Function("clamp", [t], [cs.Function("node", [t, b], [node])(t, values)])
        return (lambda time: clamp(time).full().ravel()), (lambda time: slope(time, values).full()), clamp


class _Product:
    """A Function of a step and a vector, bound to arrays."""

    def __init__(self, function: cs.Function) -> None:
        self._inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self._call = Buffered(function, *self._inputs)

    def __call__(self, step: Step, parameters: Array, vector: Array | None = None) -> Array:
        """Evaluate for the motion of a step."""
        self._inputs[0][:] = step.increments.ravel()
        self._inputs[1][:] = step.length
        self._inputs[2][:] = np.concatenate([step.q, step.v, step.clamps.ravel(), parameters])
        if vector is not None:
            self._inputs[3][:] = vector
        return self._call()[0].copy()


def _stop_if_interrupted() -> None:
    if interrupted():
        raise SimulationError("was interrupted")


def _end(step: Step) -> tuple[Array, Array, Array]:
    """Return q, v and a at the end of a step."""
    rates = RADAU.inverse @ step.increments / step.length
    return step.q + step.increments[-1], rates[-1], RADAU.inverse[-1] @ (rates - step.v) / step.length


def _shares(step: Step, time: float) -> Array:
    """Return the shares of q, v, a at the start of a step, and of those at its end, in the coordinates at a time."""
    h = step.length
    units = np.array([1.0, h, h**2, 1.0, h, h**2])
    return np.asarray(units * (QUINTIC @ ((time - step.start) / h) ** np.arange(6)))
