"""Time integration by Radau IIA collocation of order 5, an implicit Runge-Kutta method of three stages.

The method is stable for all oscillations and damps those that its steps do not resolve: mesh modes that nothing excites
decay, and the steps adapt to the other modes.  ``collocation`` states the equations of a step.  A step is

    predicted       by the collocation polynomial of the last one,
    solved          by Newton's method, whose matrices are kept as long as it converges fast,
    accepted        if the error of positions and slopes is within the tolerance, else repeated,
    sampled         at the instants of the result.

Newton's method.  Each iteration solves a real and a complex system.  With the norm |.| relative to the tolerance and
the contraction theta = |dW_k|/|dW_k-1|, the iteration ends when theta/(1 - theta) |dW_k| is below ``NEWTON_RATIO``.

Step length.  With the error estimate err relative to the tolerance, k iterations and at most k_max of them, the step h
is followed by the smaller of

    SAFETY (2 k_max + 1)/(2 k_max + k) h err^(-1/4),    SAFETY h (h/h_last) (err_last/err^2)^(1/4),

the second of which extrapolates the trend of the error.  If Newton's method converges fast and the new length would
differ little from the old one, the next step keeps both the length and the matrices.

Samples.  The error estimate does not include the velocities.  A sample is taken from the quintic polynomial through
positions, velocities and accelerations at both ends of the step, corrected by one Newton iteration on the equation of
motion, because the polynomial may stretch the beam more than the axial forces do.  The powers lost to damping and
supplied by the base and the tip load are integrated by the quadrature of the stages.

CasADi's ``buffer`` binds a Function to arrays, so that a call copies nothing and costs half a microsecond.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.excitation import ENERGY_STATES, EXCITATION, SAME_TIME, Excitation, Segment, SegmentSolution
from ancf_casadi.dynamics.radau.collocation import RADAU, STAGES, Collocation
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

SAMPLES_PER_CALL = 8  # largest number of samples evaluated in one call
NEWTON_RATIO = 0.001  # relative to the tolerance of the step; with a larger one, the errors of many steps add up
MIDDLE = STAGES // 2  # stage in which the matrices are taken
ERROR_ORDER = 4  # of the error estimate in the step length
NEWTON_ITERATIONS = 10  # k_max
STEADY = 3e-4  # contraction of Newton's method below which matrices may be kept
KEEP = (0.9, 1.2)  # factors of the length in this range are not applied, so that the matrices can be kept
SAFETY = 0.9
GROWTH = (0.2, 5.0)  # smallest and largest factor of the length
AFTER_FAILURE = 1.05  # largest factor of the length after Newton's method has failed
RECOVERY = 1.02  # factor by which each step relaxes the limit set by a failure
LEAST_ERROR, LEAST_TREND = 1e-10, 1e-2  # lower limits of err and err_last


def integrate_by_radau(
    form: Collocation,
    parameters: Array,
    piece: Excitation,
    start: State,
    segments: Sequence[Segment],
    tolerance: float,
    largest_step: float,
) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each of its consecutive segments."""
    stepper = Stepper(form, parameters, piece, start, tolerance, largest_step)
    size, steps, energies = form.equations.model.size, 0, np.zeros(ENERGY_STATES)
    for segment in segments:
        samples: list[tuple[Array, ...]] = [tuple(np.empty((0, width)) for width in (size, size, NODE, ENERGY_STATES))]
        ahead = segment.instants[segment.kept].tolist() if segment.samples else []
        while ahead:
            stepper.reach(ahead[0])
            count = min(max(bisect_right(ahead, stepper.now), 1), SAMPLES_PER_CALL)
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


class Newton:
    """Newton's method for the stage equations of the step being tried, and the arrays that the Functions read in place.

    N is the number of free coordinates.  ``Stepper`` writes ``start`` and ``end``, q, v and a at both ends of the last
    step, and ``nodes``, all coordinates at its start and its stages, when a step is accepted.  For the step being
    tried, it writes ``time``, its start, s, ``length``, s, ``ratio``, relative to that of the last step, and the
    ``excitations`` at the stages, and predicts the ``increments`` Z of the free coordinates.  Here their last
    ``corrections`` dW and the ``turns`` of the stages from the reference of the matrices are written, and, where the
    matrices are taken, all and the free coordinates and the excitation of this ``reference``, and the factors of the
    ``real`` and the complex matrix, the ``pair``.

    ``iterations`` and ``factorisations`` count the work of the run.  ``contraction`` is the last theta that was
    measured, in an earlier step if the last step took a single iteration.
    """

    def __init__(self, form: Collocation, parameters: Array, tolerance: float) -> None:
        model = form.equations.model
        size, free = model.size, form.equations.free
        self.start, self.end, self.nodes = np.zeros((3, free)), np.zeros((3, free)), np.zeros((STAGES + 1, size))
        self.time, self.length, self.ratio = np.zeros(1), np.zeros(1), np.zeros(1)
        self.excitations = np.zeros((STAGES, EXCITATION))
        self.increments, self.corrections = np.zeros((STAGES, free)), np.zeros((STAGES, free))
        self.turns = np.zeros(form.stages.numel_out(2))
        self.reference, self.reference_q, self.reference_excitation = (np.zeros(k) for k in (size, free, EXCITATION))
        self.real, self.pair = (np.zeros(form.factors.numel_out(k)) for k in range(2))
        self.parameters = parameters
        self.iterations = self.factorisations = 0
        self.contraction = 1.0
        self._model = model
        self._weights = 1 / (model.free_scale * tolerance * math.sqrt(free))
        self._stage_weights = np.tile(self._weights / math.sqrt(STAGES), STAGES)
        state = self.reference_q, self.end[1], self.length, self.reference_excitation
        self._stages = Buffered(form.stages, *self.of_stages)
        self._factors = Buffered(form.factors, *state, parameters)

    @property
    def of_stages(self) -> list[Array]:
        """The inputs of ``Collocation.stages``, in order."""
        trial = [self.increments, self.corrections, *self.end[:2], self.length, self.excitations, self.turns]
        return [*trial, self.reference, self.parameters, self.real, self.pair]

    def factorise(self) -> None:
        """Evaluate and factorise the matrices in the predicted configuration of the middle stage."""
        self.factorisations += 1
        self.reference_excitation[:] = self.excitations[MIDDLE]
        self.reference_q[:] = self.end[0] + self.increments[MIDDLE]
        self.reference[:] = self._model.whole(self.reference_q, self.reference_excitation[:NODE])
        self.real[:], self.pair[:] = self._factors()

    def converge(self) -> int:
        """Solve the stage equations, and return the number of iterations; 0 if they do not converge."""
        increments, corrections, turns = self.increments.ravel(), self.corrections.ravel(), self.turns
        corrections[:] = 0.0
        size = math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            self.iterations += 1
            corrections[:], increments[:], turns[:] = self._stages()
            weighted = corrections * self._stage_weights
            before, size = size, math.sqrt(weighted.dot(weighted))
            if iteration == 1:
                contraction = 0.0 if size < NEWTON_RATIO else 1.0
            else:
                contraction = self.contraction = size / before
            if not math.isfinite(size) or contraction > 2.0:  # theta above which the iteration is given up
                return 0
            if contraction < 1.0 and contraction / (1.0 - contraction) * size < NEWTON_RATIO:
                return iteration
        return 0

    def error(self, estimate: Array) -> float:
        """Return the size of an error estimate relative to the tolerance."""
        weighted = estimate * self._weights
        return math.sqrt(weighted.dot(weighted))


@dataclass(frozen=True)
class StepControl:
    """The state on which the next step length depends."""

    proposal: float = 1e-5  # length to try next, s
    keep: bool = False  # whether a step of the same length as the last one keeps its matrices
    largest_growth: float = GROWTH[1]  # largest factor of the length after the next step
    length: float = 0.0  # of the last step, s; 0 before the first step
    error: float = 1.0  # of the last step, relative to the tolerance

    def trial_length(self, left: float, largest_step: float) -> float:
        """Return the length of the step to try, s, given the time ``left``, so that no tiny last step remains."""
        h = min(self.proposal, largest_step)
        return left if h > (1 - SAME_TIME) * left else min(h, left / 2)

    def not_converged(self, h: float, *, kept: bool) -> StepControl:
        """Return the state after Newton's method failed: new matrices if it had kept some, else half the length."""
        if kept:
            return replace(self, proposal=h, keep=False)
        return replace(self, proposal=h / 2, keep=False, largest_growth=AFTER_FAILURE)

    def inaccurate(self, h: float, error: float, iterations: int) -> StepControl:
        """Return the state after a step whose error exceeds the tolerance: repeat it with a smaller length."""
        return replace(self, proposal=h * _growth(error, iterations), keep=False)

    def accepted(self, h: float, error: float, iterations: int, contraction: float, largest_step: float) -> StepControl:
        """Return the state after an accepted step of length h."""
        growth = _growth(error, iterations)
        if self.length:
            trend = h / self.length * (self.error / max(error, LEAST_ERROR) ** 2) ** (1 / ERROR_ORDER)
            growth = min(growth, max(SAFETY * trend, GROWTH[0]), self.largest_growth)
        growth = min(growth, largest_step / h)
        keep = contraction <= STEADY and KEEP[0] <= growth < KEEP[1]
        return StepControl(
            proposal=h if keep else h * growth,
            keep=keep,
            largest_growth=min(self.largest_growth * RECOVERY, GROWTH[1]),
            length=h,
            error=max(error, LEAST_TREND),
        )


def _growth(error: float, iterations: int) -> float:
    """Return the factor of the length that the error of a step allows."""
    effort = (2 * NEWTON_ITERATIONS + 1) / (2 * NEWTON_ITERATIONS + iterations)
    growth = SAFETY * effort * max(error, LEAST_ERROR) ** (-1 / ERROR_ORDER)
    return float(min(max(growth, GROWTH[0]), GROWTH[1]))


@dataclass(frozen=True, eq=False)
class RadauStep:
    """A step that was taken."""

    start: float  # s
    length: float  # s
    q: Array  # free coordinates at the start, (N,)
    v: Array  # their velocities
    a: Array  # their accelerations
    increments: Array  # of the coordinates at the stages, (3, N)
    excitations: Array  # at the stages, (3, 16)


class Stepper:
    """Integration over a smooth piece of the excitation, one step at a time.

    ``now`` is the end of the last step, s; ``steps`` counts the accepted steps.  The parameters are those of the
    equation of motion, in place of the nominal ones of ``form``; ``start`` is the state at the beginning of the piece.
    The tolerance is the local error of the positions relative to the length of the beam, and of the slopes relative to
    1/2.
    """

    def __init__(
        self,
        form: Collocation,
        parameters: Array,
        piece: Excitation,
        start: State,
        tolerance: float,
        largest_step: float = math.inf,
    ) -> None:
        model, first = form.equations.model, piece.at(piece.begin)
        self.now, self.steps = piece.begin, 0
        self._form, self._piece, self._largest_step, self._control = form, piece, largest_step, StepControl()
        # energies at the start of the last step, and coefficients of x, x^2 and x^3 of those added within it
        self._energies, self._added = np.zeros(ENERGY_STATES), np.zeros((STAGES, ENERGY_STATES))

        self.newton = arrays = Newton(form, parameters, tolerance)
        arrays.excitations[:] = first
        q, v, a = arrays.end
        q[:], v[:] = model.of_free(start.coordinates), model.of_free(start.velocities)
        arrays.nodes[:] = model.whole(q, first[:NODE])
        a[:] = form.accelerations(q, v, first, parameters)

        self._finish = Buffered(form.finish, *arrays.of_stages[:-1], a)
        self._predict = Buffered(form.prediction, arrays.nodes, arrays.ratio, arrays.excitations, q)
        self._excite = Buffered(_at_stages(piece.function), arrays.time, arrays.length)
        self._samplers: dict[int, Callable[[Array, Array], list[Array]]] = {}

    @property
    def state(self) -> State:
        """The state at the end of the last step."""
        newton = self.newton
        velocities = self._form.equations.model.whole(newton.end[1], newton.excitations[-1, NODE : 2 * NODE])
        return State(newton.nodes[-1].copy(), velocities, self.now)

    @property
    def last_step(self) -> RadauStep:
        """The last step."""
        newton, h = self.newton, self._control.length
        q, v, a = newton.start.copy()
        stages = self._form.equations.model.of_free(newton.nodes[1:].T).T
        return RadauStep(self.now - h, h, q, v, a, stages - q, newton.excitations.copy())

    def reach(self, instant: float) -> None:
        """Take steps until an instant is passed."""
        before = self.steps
        while self.steps == 0 or self.now < instant - SAME_TIME * self._control.length:
            self.advance()
            if self.steps - before > 200_000:
                raise SimulationError(_failure("took too many steps", self.now, self._control.length), self.now)

    def sample(self, instants: Array) -> tuple[Array, ...]:
        """Return e, e_t (k, 4 n + 4), forces of the base (k, 4), energies (k, 3) at instants (k,) of the last step."""
        count = len(instants)
        if count not in self._samplers:
            self._samplers[count] = _sampler(count, self._form, self.newton, self._piece.function)
        return *self._samplers[count](instants, self._places_of(instants)), self.energies_at(instants)

    def energies_at(self, instants: Array) -> Array:
        """Return the energies since the start of the piece, (k, 3), J, at instants (k,) of the last step."""
        x, (first, second, third) = self._places_of(instants)[:, None], self._added
        return np.asarray(self._energies + x * (first + x * (second + x * third)))

    def advance(self) -> None:
        """Take one step, as long as the tolerance and Newton's method allow."""
        control, newton = self._control, self.newton
        while True:
            h = control.trial_length(self._piece.end - self.now, self._largest_step)
            if not h > 1e-11 * max(1.0, self.now):  # s; after the first second, relative to the time
                raise SimulationError(_failure("could not continue", self.now, h), self.now)
            kept = control.keep and h == control.length
            self._begin(h)
            if not kept:
                newton.factorise()
            iterations = newton.converge()
            if not iterations:
                control = control.not_converged(h, kept=kept)
                continue
            nodes, velocities, accelerations, estimate, powers = self._finish()
            error = newton.error(estimate)
            if error <= 1.0:
                break
            control = control.inaccurate(h, error, iterations)

        self._control = control.accepted(h, error, iterations, newton.contraction, self._largest_step)
        self._energies = self._energies + self._added.sum(axis=0)
        self._added = h * RADAU.integral @ powers.reshape(STAGES, ENERGY_STATES)
        newton.nodes[0], newton.nodes[1:] = newton.nodes[-1], nodes.reshape(STAGES, -1)
        newton.start[:] = newton.end
        last = self._form.equations.model.of_free(newton.nodes[-1])
        newton.end[0], newton.end[1], newton.end[2] = last, velocities, accelerations
        self.now += h
        self.steps += 1

    def _begin(self, h: float) -> None:
        """Set up the trial of a step of length h: evaluate the excitation and predict the increments."""
        newton, (_, v, a) = self.newton, self.newton.end
        newton.length[0], newton.time[0] = h, self.now
        newton.excitations.ravel()[:] = self._excite()[0]
        if self.steps:
            newton.ratio[0] = h / self._control.length
            newton.increments.ravel()[:] = self._predict()[0]
        else:
            times = h * RADAU.nodes[:, None]
            newton.increments[:] = times * v + times**2 / 2 * a

    def _places_of(self, instants: Array) -> Array:
        """Return the places of instants in the last step, 0 to 1."""
        return np.asarray(1.0 - (self.now - instants) / self._control.length)


def _sampler(
    count: int, form: Collocation, newton: Newton, excitation: cs.Function
) -> Callable[[Array, Array], list[Array]]:
    """Return the function (times (k,), s, places in the last step, 0 to 1) -> e, e_t and forces of the base there."""
    instants, places, excitations = np.zeros(count), np.zeros(count), np.zeros((count, EXCITATION))
    step = [newton.length, *newton.start, *newton.end]
    inputs = [places, *step, excitations, newton.reference, newton.parameters, newton.real]
    shared = [k for k in range(len(inputs)) if k not in (0, 1 + len(step))]
    excite = Buffered(excitation.map(count), instants)
    evaluate = Buffered(form.sample.map("samples", "serial", count, shared, []), *inputs)

    def sample(given: Array, own: Array) -> list[Array]:
        instants[:], places[:] = given, own
        excitations.ravel()[:] = excite()[0]
        return [part.reshape(count, -1).copy() for part in evaluate()]

    return sample


def _at_stages(excitation: cs.Function) -> cs.Function:
    """(t, h) -> the excitations at the stages of a step, (16, 3)."""
    t, h = cs.MX.sym("t"), cs.MX.sym("h")
    columns = cs.horzcat(*(excitation(t + c * h) for c in RADAU.nodes.tolist()))
    return cs.Function("stage_excitations", [t, h], [columns])


def _failure(problem: str, now: float, step: float) -> str:
    """Return the message of a run that fails: what went wrong, where, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may have suffered an impact, or "
        "may bend more sharply than its elements can follow; try a larger tolerance, or more elements"
    )
