"""Time integration by Radau IIA collocation of order 5, an implicit Runge-Kutta method of three stages.

The method is stable for all oscillations, and damps those it does not resolve: modes of the mesh that nothing excites
anew die down, and the steps follow the modes that matter.  ``collocation`` states its equations.

Steps.  An error of the positions and slopes above the tolerance repeats the step; rates do not count.  The matrices of
Newton's method are taken anew at each step, but where it converges so fast that the old ones serve and the step need
not change.  The part B diag(d) B^T of the damping enters them by Woodbury's identity.

Energy.  The powers lost to damping and put in by the base are integrated by the quadrature of the stages.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Section IV.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ancf_casadi.collocation import Collocation
from ancf_casadi.compilation import Buffered
from ancf_casadi.equations import Equations
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.model import NODE
from ancf_casadi.stretches import CLOSE, Path, Stretch
from ancf_casadi.tableau import RADAU, STAGES
from ancf_casadi.trajectory import State

Array = NDArray[np.float64]

ORDER = 4  # of the error estimate in the step
NEWTON_ITERATIONS = 10
NEWTON_TOLERANCE = 0.001  # of the tolerance; more of it and the noise of the steps adds up
STEADY = 1e-3  # rate of convergence below which the matrices may be kept
KEEP = (0.9, 1.2)  # change of the step that is not made where the matrices may be kept
SAFETY = 0.9
GROWTH = (0.2, 5.0)  # of a step
AFTER_FAILURE = 1.05  # growth of a step after Newton's method has failed
RECOVERY = 1.02  # of that growth, a step
FIRST_STEP = 1e-5  # s
SMALLEST_STEP = 1e-11  # s
MOST_STEPS = 200_000  # between two samples
LARGEST_CONTRACTION = 2.0  # rate of an iteration that is given up
LEAST_ERROR, LEAST_TREND = 1e-10, 1e-2  # of a step, and as that of the step before


def integrate_by_radau(
    equations: Equations,
    clamp: cs.Function,
    start: State,
    stretches: Sequence[Stretch],
    tolerance: float,
    largest_step: float = math.inf,
) -> Iterator[Path]:
    """Integrate a smooth piece of the motion, and yield what each stretch of it gives.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    clamp : Function
        (t) -> position, velocity and acceleration of the clamped node, (12,).
    start : State
        Where the beam is at the start of the first stretch.
    stretches : sequence of Stretch
        Stretches of time, one after the other.
    tolerance : float
        Local error of the positions relative to the length of the beam, and of the slopes relative to 1/2.
    largest_step : float
        No step is longer, s.

    Raises
    ------
    SimulationError
        If no step is small enough, or they are too many.
    """
    form, p = Collocation(equations), equations.parameters
    span = stretches[0].start, stretches[-1].end
    stepper = Stepper(form, p, clamp, start, *span, tolerance, largest_step)
    size, steps, energies = equations.model.size, 0, np.zeros(2)
    for stretch in stretches:
        samples = []
        for instant in stretch.instants[stretch.kept].tolist() if stretch.samples else []:
            stepper.reach(instant)
            samples.append(stepper.sample(instant))
        stepper.reach(stretch.end)
        end, end_energies = stepper.state, stepper.energies_at(stretch.end)
        yield Path(
            coordinates=np.array([sample.coordinates for sample in samples]).reshape(-1, size),
            velocities=np.array([sample.velocities for sample in samples]).reshape(-1, size),
            forces=np.array([sample.force for sample in samples]).reshape(-1, NODE),
            energies=np.array([sample.energies for sample in samples]).reshape(-1, 2) - energies,
            end=end,
            end_energies=end_energies - energies,
            steps=stepper.steps - steps,
        )
        steps, energies = stepper.steps, end_energies


@dataclass(frozen=True, eq=False)
class _Sample:
    """Coordinates, rates, force of the base, and energies since the piece began, at an instant."""

    coordinates: Array
    velocities: Array
    force: Array
    energies: Array


@dataclass(frozen=True, eq=False)
class Factors:
    """A factorised matrix A + B C B^T with banded A.

    Parameters
    ----------
    band, pivots : array
        The triangular factors of A, and their pivots.
    width : int
        Number of diagonals of A on either side.
    projection : array (N, m)
        B.
    correction : array (N, m)
        X (1 + B^T X)^-1 with X = A^-1 B C.
    """

    band: NDArray[Any]
    pivots: NDArray[Any]
    width: int
    projection: Array
    correction: NDArray[Any]

    @staticmethod
    def of(band: NDArray[Any], width: int, projection: Array, middle: NDArray[Any]) -> Factors:
        """Factorise; the band, one column of the matrix after the other, is overwritten, ``middle`` is C."""
        factorise, solve = _routines(band)
        factors, pivots, _ = factorise(band.reshape(-1, 3 * width + 1).T, width, width, overwrite_ab=1)
        if not middle.size:
            return Factors(factors, pivots, width, projection, projection)
        x = solve(factors, width, width, projection @ middle, pivots)[0]
        correction = x @ np.linalg.inv(np.eye(len(middle)) + projection.T @ x)
        return Factors(factors, pivots, width, projection, correction)

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Solve for a right-hand side, which is overwritten."""
        solution: NDArray[Any] = _routines(self.band)[1](
            self.band, self.width, self.width, right, self.pivots, overwrite_b=1
        )[0]
        if self.projection.size:
            solution -= self.correction @ (self.projection.T @ solution)
        return solution

    def solve_transposed(self, right: NDArray[Any]) -> NDArray[Any]:
        """Solve with the transposed matrix for right-hand sides, which are kept."""
        if self.projection.size:
            right = right - self.projection @ (self.correction.T @ right)
        solution: NDArray[Any] = _routines(self.band)[1](
            self.band, self.width, self.width, right, self.pivots, trans=1
        )[0]
        return solution


def _routines(band: NDArray[Any]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return LAPACK's routines that factorise a band and solve with its factors."""
    return (lapack.zgbtrf, lapack.zgbtrs) if band.dtype == complex else (lapack.dgbtrf, lapack.dgbtrs)


@dataclass(frozen=True, eq=False)
class Step:
    """A step that was taken.

    Parameters
    ----------
    start, length : float
        Its start and length, s.
    q, v, a : array (N,)
        Free coordinates, rates and accelerations at its start.
    increments : array (3, N)
        Increments of the coordinates at its stages.
    clamps : array (3, 12)
        The clamped nodes there.
    """

    start: float
    length: float
    q: Array
    v: Array
    a: Array
    increments: Array
    clamps: Array


class Stepper:
    """Goes through a smooth piece of the motion.

    Its arrays are the inputs of its Functions: q, v and a where it has come to, what the next step is made from, and
    what a sample of the last one is made from.

    Parameters
    ----------
    form : Collocation
        The Functions of a step.
    parameters : array
        The parameters of the equation of motion.
    clamp, start, tolerance, largest_step
        As of ``integrate_by_radau``.
    begin, end : float
        First and last instant, s.
    """

    def __init__(
        self,
        form: Collocation,
        parameters: Array,
        clamp: cs.Function,
        start: State,
        begin: float,
        end: float,
        tolerance: float,
        largest_step: float = math.inf,
    ) -> None:
        equations, p = form.equations, parameters
        model, free = equations.model, equations.free
        self.steps = 0
        self.now, self._end, self._width, self._largest = begin, end, form.bandwidth, largest_step
        self._weights = 1 / (model.scale[model.free] * tolerance * math.sqrt(free))
        self._projection = equations.projection[model.free]
        self._rates = cs.evalf(equations.balance(cs.MX(cs.DM(p))).rates).full().ravel()

        self._time, self._clamp, self._clamps = np.zeros(1), np.zeros(3 * NODE), np.zeros((STAGES, 3 * NODE))
        self._q, self._v = start.coordinates[model.free].copy(), start.velocities[model.free].copy()
        self._h, self._ratio, self._reference = np.zeros(1), np.zeros(1), self._q.copy()
        self._node, self._nodes_ahead = Buffered(clamp, self._time), Buffered(_ahead(clamp), self._time, self._h)
        self._a = form.accelerations(self._q, self._v, self._node_at(begin), p)
        self._increments, self._real, self._pair = np.zeros((STAGES, free)), np.zeros(free), np.zeros(free, complex)
        self._before, self._place = np.zeros((3, free)), np.zeros(1)  # q, v and a at the start of the last step
        self._nodes = np.zeros((STAGES + 1, model.size))  # coordinates at the start and the stages of the last step
        self._seen, self._off = np.zeros((3, model.size)), np.zeros(free)

        inputs = [self._increments, self._real, self._pair, self._q, self._v, self._h, self._clamps, self._reference, p]
        ends = [*self._before, self._q, self._v, self._a]
        self._stages, self._finish = Buffered(form.stages, *inputs), Buffered(form.finish, *inputs, self._a)
        self._matrices = Buffered(form.matrices, self._reference, self._v, self._h, self._clamp, p)
        self._predict = Buffered(form.prediction, self._nodes, self._ratio, self._clamps, self._q)
        self._interpolate = Buffered(form.sample, self._place, self._h, *ends, self._clamp, self._reference, p)
        self._observe = Buffered(form.observation, *self._seen, self._off, self._reference, p)

        self._nodes[0] = self._all_at(begin, self._q, 0)
        self._factors: tuple[Factors, Factors] | None = None
        self._steady, self._contraction = False, 1.0
        self._proposal, self._most, self._error = FIRST_STEP, GROWTH[1], 1.0
        self._energies = np.zeros(2)  # up to here
        self._work = np.zeros((STAGES, 2))  # coefficients of the share of the last step

    @property
    def state(self) -> State:
        """Where the beam is after the last step."""
        return State(self._all_at(self.now, self._q, 0), self._all_at(self.now, self._v, 1))

    def reach(self, instant: float) -> None:
        """Take steps until an instant is behind.

        Raises
        ------
        SimulationError
            If no step is small enough, or they are too many.
        """
        before = self.steps
        while self.steps == 0 or self.now < instant - CLOSE * self._h[0]:
            self.advance()
            if self.steps - before > MOST_STEPS:
                raise SimulationError(_advice("took too many steps", self.now, self._h[0]), self.now)

    @property
    def last(self) -> Step:
        """The last step."""
        h, (q, v, a) = float(self._h[0]), self._before.copy()
        increments = self._nodes[1:, NODE:] - q
        return Step(self.now - h, h, q, v, a, increments, self._clamps.copy())

    def sample(self, instant: float) -> _Sample:
        """Return the motion at an instant of the last step."""
        self._place[0] = self._place_of(instant)
        self._clamp[:] = self._node_at(instant)
        *motion, residual = self._interpolate()
        self._seen[:] = motion
        self._off[:] = self._solve(0, residual)
        coordinates, force = self._observe()
        return _Sample(coordinates.copy(), self._seen[1].copy(), force.copy(), self.energies_at(instant))

    def energies_at(self, instant: float) -> Array:
        """Return the energies lost to damping and put in by the base, (2,), J, up to an instant of the last step."""
        x = self._place_of(instant)
        return np.asarray(self._energies - (1.0 - np.array((x, x**2, x**3))) @ self._work)

    def advance(self) -> None:
        """Take a step, as long as the tolerance and Newton's method let it be.

        Raises
        ------
        SimulationError
            If no step is small enough.
        """
        last, h = self._h[0], min(self._proposal, self._largest)
        while True:
            left = self._end - self.now
            h = left if h > (1 - CLOSE) * left else min(h, left / 2)
            if not h > SMALLEST_STEP * max(1.0, self.now):
                raise SimulationError(_advice("could not go on", self.now, h), self.now)
            fresh = self._prepare(h, last)
            iterations = self._iterate()
            if iterations:
                *end, residual, increments, powers = self._finish()
                off = self._solve(0, residual) * self._weights
                error = max(math.sqrt(off @ off), LEAST_ERROR)
                effort = (2 * NEWTON_ITERATIONS + 1) / (2 * NEWTON_ITERATIONS + iterations)
                change = min(max(SAFETY * effort * error ** (-1 / ORDER), GROWTH[0]), GROWTH[1])
                if error <= 1.0:
                    break
                h *= change
            elif fresh:
                h, self._most = h / 2, AFTER_FAILURE
            self._steady = False

        if self.steps:
            trend = h / last * (self._error / error**2) ** (1 / ORDER)
            change = min(change, max(SAFETY * trend, GROWTH[0]), self._most)
        change = min(change, self._largest / h)
        self._steady = self._contraction <= STEADY and KEEP[0] <= change < KEEP[1]
        self._proposal = h if self._steady else h * change
        self._most, self._error = min(self._most * RECOVERY, GROWTH[1]), max(error, LEAST_TREND)
        self._nodes[0] = self._all_at(self.now, self._q, 0)
        self._nodes[1:, :NODE] = self._clamps[:, :NODE]
        self._nodes[1:, NODE:] = self._q + increments.reshape(STAGES, -1)
        self._before[:] = self._q, self._v, self._a
        self._q[:], self._v[:], self._a[:] = end
        self._work = h * RADAU.integral @ powers.reshape(STAGES, 2)
        self._energies = self._energies + self._work.sum(axis=0)
        self.now += h
        self.steps += 1

    def _prepare(self, h: float, last: float) -> bool:
        """Predict the increments, provide the matrices, and tell whether these are fresh."""
        fresh = not (self._steady and h == self._h[0])
        self._h[0] = h
        self._time[0] = self.now
        self._clamps.ravel()[:] = self._nodes_ahead()[0]
        self._real[:], self._pair[:] = 0.0, 0.0
        if self.steps:
            self._ratio[0] = h / last
            self._increments.ravel()[:] = self._predict()[0]
        else:
            times = h * RADAU.nodes[:, None]
            self._increments[:] = times * self._v + times**2 / 2 * self._a
        if fresh:
            middle = STAGES // 2
            self._reference[:] = self._q + self._increments[middle]
            self._clamp[:] = self._clamps[middle]
            real, pair = self._matrices()
            rates = np.diag(self._rates / h)
            self._factors = (
                Factors.of(real, self._width, self._projection, RADAU.gamma * rates),
                Factors.of(pair.view(complex), self._width, self._projection, RADAU.mu * rates),
            )
        return fresh

    def _iterate(self) -> int:
        """Solve the equations of the stages, and return the number of iterations; 0 where they do not converge."""
        size = math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            real, pair, increments = self._stages()
            self._increments.ravel()[:] = increments
            self._real[:] = self._solve(0, real)
            self._pair[:] = self._solve(1, pair.view(complex))
            before, size = size, self._size()
            if iteration == 1:
                rate = 0.0 if size < NEWTON_TOLERANCE else 1.0
            else:
                rate = size / before
                self._contraction = rate
            if not math.isfinite(size) or rate > LARGEST_CONTRACTION:
                return 0
            if rate < 1.0 and rate / (1.0 - rate) * size < NEWTON_TOLERANCE:
                return iteration
        return 0

    def _size(self) -> float:
        """Return the size of a correction relative to the tolerance."""
        real, pair = self._real * self._weights, self._pair * self._weights
        return math.sqrt((real @ real + np.vdot(pair, pair).real) / STAGES)

    def _solve(self, which: int, right: NDArray[Any]) -> NDArray[Any]:
        """Solve with the real or the complex matrix."""
        assert self._factors is not None
        return self._factors[which].solve(right)

    def _node_at(self, instant: float) -> Array:
        """Return position, velocity and acceleration of the clamped node, an array that the next call overwrites."""
        self._time[0] = instant
        return self._node()[0]

    def _all_at(self, instant: float, free: Array, order: int) -> Array:
        """Return coordinates or their rates (order 1) of all nodes from those of the free ones."""
        return np.concatenate([self._node_at(instant)[NODE * order : NODE * (order + 1)], free])

    def _place_of(self, instant: float) -> float:
        """Return where in the last step an instant lies, 0 to 1."""
        return float(1.0 - (self.now - instant) / self._h[0])


def _ahead(clamp: cs.Function) -> cs.Function:
    """(t, h) -> the clamped nodes at the stages of a step, (12, 3)."""
    t, h = cs.MX.sym("t"), cs.MX.sym("h")
    return cs.Function("ahead", [t, h], [cs.horzcat(*(clamp(t + c * h) for c in RADAU.nodes.tolist()))])


def _advice(problem: str, now: float, step: float) -> str:
    """Say in a line what went wrong, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may be struck, or bent more "
        "sharply than its elements can follow; try start='moving' if the base starts with a speed, a larger tolerance, "
        "or more elements"
    )
