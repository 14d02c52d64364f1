"""Time integration by Radau IIA collocation of order 5, an implicit Runge-Kutta method of three stages.

The method is stable for all oscillations and damps those that its steps do not resolve: mesh modes that nothing excites
decay, and the steps adapt to the other modes.  ``collocation`` states the equations of a step.  A step is

    predicted       by the collocation polynomial of the last one,
    solved          by Newton's method (``newton``), whose matrices are kept as long as it converges fast,
    accepted        if the error of positions and slopes is within the tolerance (``step_control``), else repeated,
    sampled         at the instants of the result (``samples``).

The error estimate does not include the velocities.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Section IV.8.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.radau.buffers import Buffers
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.newton import Newton
from ancf_casadi.dynamics.radau.samples import Samples, StepEnergies
from ancf_casadi.dynamics.radau.step_control import StepControl
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.dynamics.segments import ENERGY_STATES, SAME_TIME, InitialValueProblem, SegmentSolution
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

SAMPLES_PER_CALL = 8  # largest number of samples evaluated in one call


def integrate_by_radau(problem: InitialValueProblem, form: Collocation) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each segment.

    Parameters
    ----------
    problem : InitialValueProblem
        The motion to compute.
    form : Collocation
        The Functions of a step, which all pieces of a motion share.

    Raises
    ------
    SimulationError
        If no step is small enough, or the steps are too many.
    """
    stepper = Stepper(form, problem.equations.parameters, problem)
    size, steps, energies = problem.equations.model.size, 0, np.zeros(ENERGY_STATES)
    for segment in problem.segments:
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


@dataclass(frozen=True, eq=False)
class RadauStep:
    """A step that was taken.

    Parameters
    ----------
    start, length : float
        Start and length, s.
    q, v, a : array (N,)
        Free coordinates, velocities and accelerations at the start.
    increments : array (3, N)
        Increments of the coordinates at the stages.
    excitations : array (3, 15)
        The excitation at each stage.
    """

    start: float
    length: float
    q: Array
    v: Array
    a: Array
    increments: Array
    excitations: Array


class Stepper:
    """Integration over a smooth piece of the excitation, one step at a time.

    ``now`` is the end of the last step, s; ``steps`` counts the accepted steps.

    Parameters
    ----------
    form : Collocation
        The Functions of a step.
    parameters : array
        The parameters of the equation of motion.
    problem : InitialValueProblem
        The motion to compute; its equations and their nominal parameters are not used.
    """

    def __init__(self, form: Collocation, parameters: Array, problem: InitialValueProblem) -> None:
        free, excitation, start = form.equations.model.free, problem.excitation, problem.start
        self.now, self.steps = problem.segments[0].start, 0
        self._end, self._largest_step = problem.segments[-1].end, problem.largest_step
        self._control, self._energies = (
            StepControl(),
            StepEnergies(np.zeros(ENERGY_STATES), np.zeros((STAGES, ENERGY_STATES))),
        )

        self._buffers = buffers = Buffers.of(form, parameters)
        last, trial = buffers.last, buffers.trial
        first = excitation(self.now).full().ravel()
        trial.excitations[:] = first
        last.nodes[:, :NODE], last.nodes[:, NODE:] = first[:NODE], start.coordinates[free]
        q, v, a = last.end
        q[:], v[:] = start.coordinates[free], start.velocities[free]
        a[:] = form.accelerations(q, v, first, parameters)

        self.newton = Newton(form, buffers, problem.tolerance)
        self._finish = Buffered(form.finish, *buffers.of_stages[:-1], a)
        self._predict = Buffered(form.prediction, last.nodes, trial.ratio, trial.excitations, q)
        self._excite = Buffered(_at_stages(excitation), trial.time, trial.length)
        self._samples = lru_cache(lambda count: Samples(count, form, buffers, excitation))

    @property
    def state(self) -> State:
        """The state at the end of the last step."""
        last, clamp_velocity = self._buffers.last, self._buffers.trial.excitations[-1, NODE : 2 * NODE]
        return State(last.nodes[-1].copy(), np.concatenate([clamp_velocity, last.end[1]]), self.now)

    @property
    def last_step(self) -> RadauStep:
        """The last step."""
        last, h = self._buffers.last, self._control.length
        q, v, a = last.start.copy()
        return RadauStep(self.now - h, h, q, v, a, last.nodes[1:, NODE:] - q, self._buffers.trial.excitations.copy())

    def reach(self, instant: float) -> None:
        """Take steps until an instant is passed.

        Raises
        ------
        SimulationError
            If no step is small enough, or the steps are too many.
        """
        before = self.steps
        while self.steps == 0 or self.now < instant - SAME_TIME * self._control.length:
            self.advance()
            if self.steps - before > 200_000:
                raise SimulationError(_failure("took too many steps", self.now, self._control.length), self.now)

    def sample(self, instants: Array) -> tuple[Array, Array, Array, Array]:
        """Return the motion at some instants (k,) of the last step.

        These are coordinates and velocities, (k, 4 n + 4), forces of the base, (k, 4), and the energies since the start
        of the piece, (k, 3).
        """
        samples = self._samples(len(instants))
        return *samples(instants, self._places_of(instants)), self.energies_at(instants)

    def energies_at(self, instants: Array) -> Array:
        """Return the energies since the start of the piece, (k, 3), J, at instants (k,) of the last step."""
        return self._energies.at(self._places_of(instants))

    def advance(self) -> None:
        """Take one step, as long as the tolerance and Newton's method allow.

        Raises
        ------
        SimulationError
            If no step is small enough.
        """
        control, newton, buffers = self._control, self.newton, self._buffers
        while True:
            h = control.trial_length(self._end - self.now, self._largest_step)
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
        self._energies = self._energies.followed_by(h, powers.reshape(STAGES, ENERGY_STATES))
        last = buffers.last
        last.nodes[0], last.nodes[1:] = last.nodes[-1], nodes.reshape(STAGES, -1)
        last.start[:] = last.end
        last.end[0], last.end[1], last.end[2] = last.nodes[-1, NODE:], velocities, accelerations
        self.now += h
        self.steps += 1

    def _begin(self, h: float) -> None:
        """Set up the trial of a step of length h: evaluate the excitation and predict the increments."""
        trial, (_, v, a) = self._buffers.trial, self._buffers.last.end
        trial.length[0], trial.time[0] = h, self.now
        trial.excitations.ravel()[:] = self._excite()[0]
        if self.steps:
            trial.ratio[0] = h / self._control.length
            trial.increments.ravel()[:] = self._predict()[0]
        else:
            times = h * RADAU.nodes[:, None]
            trial.increments[:] = times * v + times**2 / 2 * a

    def _places_of(self, instants: Array) -> Array:
        """Return the places of instants in the last step, 0 to 1."""
        return np.asarray(1.0 - (self.now - instants) / self._control.length)


def _at_stages(excitation: cs.Function) -> cs.Function:
    """(t, h) -> the excitations at the stages of a step, (15, 3)."""
    t, h = cs.MX.sym("t"), cs.MX.sym("h")
    columns = cs.horzcat(*(excitation(t + c * h) for c in RADAU.nodes.tolist()))
    return cs.Function("stage_excitations", [t, h], [columns])


def _failure(problem: str, now: float, step: float) -> str:
    """Return the message of a run that fails: what went wrong, where, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may have suffered an impact, or "
        "may bend more sharply than its elements can follow; try a larger tolerance, or more elements"
    )
