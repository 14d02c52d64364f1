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
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.dynamics.segments import CLOSE, InitialValueProblem, SegmentSolution
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import Factors, lapack_storage
from ancf_casadi.support.compilation import Buffered

ORDER = 4  # of the error estimate in the step
NEWTON_ITERATIONS = 10
NEWTON_TOLERANCE = 0.001  # of the tolerance; more of it and the noise of the steps adds up
STEADY = 3e-4  # rate of convergence below which the matrices may be kept
KEEP = (0.9, 1.2)  # change of the step that is not made where the matrices may be kept
SAFETY = 0.9
GROWTH = (0.2, 5.0)  # of a step
AFTER_FAILURE = 1.05  # growth of a step after Newton's method has failed
RECOVERY = 1.02  # of that growth, a step
FIRST_STEP = 1e-5  # s
SMALLEST_STEP = 1e-11  # s
MOST_STEPS = 200_000  # between two samples
LARGEST_CONTRACTION = 2.0  # rate of an iteration that is given up
AT_ONCE = 8  # samples of a step
LEAST_ERROR, LEAST_TREND = 1e-10, 1e-2  # of a step, and as that of the step before


def integrate_by_radau(problem: InitialValueProblem) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the base motion, and yield the solution on each segment.

    Raises
    ------
    SimulationError
        If no step is small enough, or the steps are too many.
    """
    equations, segments = problem.equations, problem.segments
    form, p = Collocation(equations), equations.parameters
    span = segments[0].start, segments[-1].end
    stepper = Stepper(form, p, problem.clamp, problem.start, *span, problem.tolerance, problem.largest_step)
    size, steps, energies = equations.model.size, 0, np.zeros(2)
    for segment in segments:
        samples: list[tuple[Array, ...]] = [tuple(np.empty((0, width)) for width in (size, size, NODE, 2))]
        ahead = segment.instants[segment.kept].tolist() if segment.samples else []
        while ahead:
            stepper.reach(ahead[0])
            count = min(max(bisect_right(ahead, stepper.now), 1), AT_ONCE)
            samples.append(stepper.sample(np.array(ahead[:count])))
            ahead = ahead[count:]
        stepper.reach(segment.end)
        end, end_energies = stepper.state, stepper.energies_at(np.array([segment.end]))[0]
        coordinates, velocities, forces, work = (np.vstack(parts) for parts in zip(*samples, strict=True))
        yield SegmentSolution(
            coordinates=coordinates,
            velocities=velocities,
            forces=forces,
            energies=work - energies,
            end=end,
            end_energies=end_energies - energies,
            segment=segment,
            steps=stepper.steps - steps,
        )
        steps, energies = stepper.steps, end_energies


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
    what a sample of the last one is made from.  It counts its steps, and the iterations of Newton's method and
    factorisations that they and the steps that were repeated took.

    Parameters
    ----------
    form : Collocation
        The Functions of a step.
    parameters : array
        The parameters of the equation of motion.
    clamp, start, tolerance, largest_step
        As of ``InitialValueProblem``.
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
        self.steps = self.iterations = self.factorisations = 0
        self.now, self._end, self._width, self._largest = begin, end, form.bandwidth, largest_step
        weights = 1 / (model.scale[model.free] * tolerance * math.sqrt(free))
        self._weights, self._all_weights = weights, np.concatenate([weights, np.repeat(weights, 2)]) / math.sqrt(STAGES)
        self._rates = cs.evalf(equations.balance(cs.MX(cs.DM(p))).modal_coefficients).full().ravel()

        self._motion = np.zeros((3, free))  # q, v and a at the end of the last step
        self._before = np.zeros((3, free))  # at its start
        self._nodes = np.zeros((STAGES + 1, model.size))  # coordinates at its start and its stages
        self._h, self._time, self._ratio = np.zeros(1), np.array([begin]), np.zeros(1)
        self._clamps, self._reference = np.zeros((STAGES, 3 * NODE)), start.coordinates.copy()
        self._increments, self._corrections = np.zeros((STAGES, free)), np.zeros(STAGES * free)
        self._turns, self._clamp = np.zeros(form.stages.numel_out(2)), np.zeros(3 * NODE)
        q, v, a = self._motion

        inputs = [self._increments, self._corrections, q, v, self._h, self._clamps, self._turns, self._reference, p]
        self._stages, self._finish = Buffered(form.stages, *inputs), Buffered(form.finish, *inputs, a)
        self._projection = Buffered(equations.turned_projection, self._clamp)
        self._matrices = Buffered(form.matrices, self._reference[NODE:], v, self._h, self._clamp, p)
        self._predict = Buffered(form.prediction, self._nodes, self._ratio, self._clamps, q)
        self._ahead = Buffered(_ahead(clamp), self._time, self._h)
        motion = [*self._before, *self._motion]

        def samples(count: int) -> _Samples:
            """Return what evaluates some samples of a step."""
            return _Samples(count, clamp, form.sample, form.observation, [self._h, *motion, self._reference, p])

        self._samples = lru_cache(samples)
        self._clamps[:] = clamp(begin).full().ravel()
        self._nodes[:, :NODE], self._nodes[:, NODE:] = self._clamps[0, :NODE], start.coordinates[model.free]
        q[:], v[:] = start.coordinates[model.free], start.velocities[model.free]
        a[:] = form.accelerations(q, v, self._clamps[0], p)
        self._factors: tuple[Factors, Factors] | None = None
        self._steady, self._contraction = False, 1.0
        self._proposal, self._most, self._error = FIRST_STEP, GROWTH[1], 1.0
        self._energies = np.zeros(2)  # up to the start of the last step
        self._work = np.zeros((STAGES, 2))  # coefficients of its share

    @property
    def state(self) -> State:
        """Where the beam is after the last step."""
        velocities = np.concatenate([self._clamps[-1, NODE : 2 * NODE], self._motion[1]])
        return State(self._nodes[-1].copy(), velocities, self.now)

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

    def sample(self, instants: Array) -> tuple[Array, Array, Array, Array]:
        """Return the motion at some instants (k,) of the last step.

        These are coordinates and rates, (k, 4 n + 4), forces of the base, (k, 4), and the energies since the piece
        began, (k, 2).
        """
        samples = self._samples(len(instants))
        return *samples(instants, self._places_of(instants), self._solve), self.energies_at(instants)

    def energies_at(self, instants: Array) -> Array:
        """Return the energies lost to damping and put in by the base, (k, 2), J, up to instants of the last step."""
        x, (first, second, third) = self._places_of(instants)[:, None], self._work
        return np.asarray(self._energies + x * (first + x * (second + x * third)))

    def advance(self) -> None:
        """Take a step, as long as the tolerance and Newton's method let it be.

        Raises
        ------
        SimulationError
            If no step is small enough.
        """
        last, h = float(self._h[0]), min(self._proposal, self._largest)
        while True:
            left = self._end - self.now
            h = left if h > (1 - CLOSE) * left else min(h, left / 2)
            if not h > SMALLEST_STEP * max(1.0, self.now):
                raise SimulationError(_advice("could not go on", self.now, h), self.now)
            fresh = self._prepare(h, last)
            iterations = self._iterate()
            if iterations:
                coordinates, *rates, residual, powers = self._finish()
                off = self._solve(residual) * self._weights
                error = max(math.sqrt(off.dot(off)), LEAST_ERROR)
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
        self._nodes[0] = self._nodes[-1]
        self._nodes[1:] = coordinates.reshape(STAGES, -1)
        self._before[:] = self._motion
        self._motion[0], self._motion[1], self._motion[2] = self._nodes[-1, NODE:], *rates
        self._energies = self._energies + self._work.sum(axis=0)
        self._work = h * RADAU.integral @ powers.reshape(STAGES, 2)
        self.now += h
        self.steps += 1

    def _prepare(self, h: float, last: float) -> bool:
        """Predict the increments, provide the matrices, and tell whether these are fresh."""
        fresh = not (self._steady and h == self._h[0])
        self._h[0], self._time[0] = h, self.now
        self._clamps.ravel()[:] = self._ahead()[0]
        self._corrections[:] = 0.0
        if self.steps:
            self._ratio[0] = h / last
            self._increments.ravel()[:] = self._predict()[0]
        else:
            times, (_, v, a) = h * RADAU.nodes[:, None], self._motion
            self._increments[:] = times * v + times**2 / 2 * a
        if fresh:
            self.factorisations += 1
            middle = STAGES // 2
            self._clamp[:] = self._clamps[middle]
            self._reference[:NODE] = self._clamp[:NODE]
            self._reference[NODE:] = self._motion[0] + self._increments[middle]
            real, pair = self._matrices()
            right = self._projection()[0].reshape(self._rates.size, self._motion.shape[1]).T
            left = right * (self._rates / h)
            self._factors = (
                Factors.of(lapack_storage(real, self._width), self._width, RADAU.gamma * left, right),
                Factors.of(lapack_storage(pair.view(complex), self._width), self._width, RADAU.mu * left, right),
            )
        return fresh

    def _iterate(self) -> int:
        """Solve the equations of the stages, and return the number of iterations; 0 where they do not converge."""
        assert self._factors is not None
        real, pair = self._factors
        free, increments, size = self._motion.shape[1], self._increments.ravel(), math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            self.iterations += 1
            residuals, increments[:], self._turns[:] = self._stages()
            self._corrections[:free] = real.solve(residuals[:free], overwrite=True)
            self._corrections[free:] = pair.solve(residuals[free:].view(complex), overwrite=True).view(float)
            off = self._corrections * self._all_weights
            before, size = size, math.sqrt(off.dot(off))
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

    def _places_of(self, instants: Array) -> Array:
        """Return where in the last step some instants lie, 0 to 1."""
        return np.asarray(1.0 - (self.now - instants) / self._h[0])

    def _solve(self, right: Array) -> Array:
        """Solve with the real matrix for right-hand sides, which are overwritten."""
        assert self._factors is not None
        return self._factors[0].solve(right, overwrite=True)


class _Samples:
    """Evaluates some samples of a step at once.

    Parameters
    ----------
    count : int
        Their number k.
    clamp, interpolate, observe : Function
        The motion of the clamped node, ``Collocation.sample`` and ``Collocation.observation``.
    step : list of array
        The inputs of ``interpolate`` that are the same for all samples of a step: h, q, v and a at both ends, where the
        matrices were taken, and the parameters.
    """

    def __init__(
        self, count: int, clamp: cs.Function, interpolate: cs.Function, observe: cs.Function, step: list[Array]
    ) -> None:
        self._count, self._instants = count, np.zeros(count)
        self._places, self._clamps = np.zeros(count), np.zeros((count, 3 * NODE))
        *ends, reference, parameters = step
        inputs = [self._places, *ends, self._clamps, reference, parameters]
        shared = [k for k, array in enumerate(inputs) if array is not self._places and array is not self._clamps]
        self._clamp = Buffered(clamp.map(count), self._instants)
        self._interpolate = Buffered(interpolate.map("samples", "serial", count, shared, []), *inputs)
        *motion, self._residual, turns = self._interpolate.outputs
        self._observe = Buffered(
            observe.map("observations", "serial", count, [5], []), *motion, self._residual, turns, parameters
        )

    def __call__(self, instants: Array, places: Array, solve: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
        """Return coordinates and rates (k, 4 n + 4) and forces of the base (k, 4)."""
        self._instants[:], self._places[:] = instants, places
        self._clamps.ravel()[:] = self._clamp()[0]
        _, velocities, _, residual, _ = self._interpolate()
        right = residual.reshape(self._count, -1).T
        right[:] = solve(right)
        coordinates, forces = self._observe()
        one, two, three = (part.reshape(self._count, -1).copy() for part in (coordinates, velocities, forces))
        return one, two, three


def _ahead(clamp: cs.Function) -> cs.Function:
    """(t, h) -> the clamped nodes at the stages of a step, (12, 3)."""
    t, h = cs.MX.sym("t"), cs.MX.sym("h")
    return cs.Function("ahead", [t, h], [cs.horzcat(*(clamp(t + c * h) for c in RADAU.nodes.tolist()))])


def _advice(problem: str, now: float, step: float) -> str:
    """Say in a line what went wrong, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may be struck, or bent more "
        "sharply than its elements can follow; try a larger tolerance, or more elements"
    )
