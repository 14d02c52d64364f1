"""Time integration by Radau IIA collocation of order 5, an implicit Runge-Kutta method of three stages.

The method is stable for all oscillations and damps those that its steps do not resolve: mesh modes that nothing excites
decay, and the steps adapt to the other modes.  ``collocation`` states the equations of a step.  A step is

    predicted       by the collocation polynomial of the last one,
    solved          by Newton's method (``newton``), whose matrices are kept as long as it converges fast,
    accepted        if the error of positions and slopes is within the tolerance, else repeated,
    kept            as polynomials, which give the motion at all instants (``dense_output``).

The error estimate does not include the velocities.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ancf_casadi.dynamics.dense_output import SegmentSolution, Slopes, Steps
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.excitation import SAME_TIME, Excitation, Segment
from ancf_casadi.dynamics.radau.collocation import Collocation, shared_form
from ancf_casadi.dynamics.radau.newton import Newton, StepControl
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

MOST_STEPS = 200_000  # to the end of a segment; these take a minute


def integrate_by_radau(
    equations: Equations,
    piece: Excitation,
    start: State,
    segments: Iterable[Segment],
    tolerance: float,
    largest_step: float,
) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each of its consecutive segments."""
    form, slopes = shared_form(equations), Slopes(equations.model)
    stepper = Stepper(form, equations.parameters, piece, start, tolerance, largest_step)
    for segment in segments:
        ends = [stepper.end, *(stepper.end for _ in stepper.steps_to(segment.end))]
        count = len(ends) - 1
        steps = _step_polynomials(slopes, ends, first=stepper.steps == count) if count else None
        yield SegmentSolution(segment, steps, stepper.state, count)


StepEnd = tuple[float, Array, Array, Array, Array]  # ``Stepper.end``


def _step_polynomials(slopes: Slopes, step_ends: Sequence[StepEnd], *, first: bool) -> Steps:
    """Return the steps between ends; ``first``: whether the first one begins the piece."""
    instants, free, excitations, nodes, internal = (np.array(values) for values in zip(*step_ends, strict=True))
    bases = excitations[:, -1, : 3 * NODE].reshape(-1, 3, NODE)
    ends = slopes.model.whole(np.moveaxis(free, -1, 0), np.moveaxis(bases, -1, 0))
    return Steps(slopes, instants, np.moveaxis(ends, 0, -1), _stages(nodes), first=first, internal=internal)


def _stages(nodes: Array) -> Array:
    """Return all coordinates at the stages, (s, 3, 4 n + 4), from the nodes of ``Stepper.end`` of s + 1 ends."""
    return np.moveaxis(nodes[1:, :, 1:], 1, 2).reshape(len(nodes) - 1, STAGES, -1)


@dataclass(frozen=True, eq=False)
class RadauSteps:
    """Consecutive steps that were taken, s of them."""

    instants: Array  # their ends, from the first start on, (s + 1,), s
    q: Array  # free coordinates at their starts, (s, N)
    v: Array  # their velocities
    a: Array  # their accelerations
    increments: Array  # of the coordinates at the stages, (s, 3, N)
    excitations: Array  # at the stages, (s, 3, 16)
    internal: Array  # internal strains at their starts, (s, m b n)

    @staticmethod
    def of(model: Model, step_ends: Sequence[StepEnd]) -> RadauSteps:
        """Return the steps between ends."""
        instants, free, excitations, nodes, internal = (np.array(values) for values in zip(*step_ends, strict=True))
        q, v, a = np.moveaxis(free[:-1], 1, 0)
        stages = model.of_free(np.moveaxis(_stages(nodes), -1, 0))
        increments, internal = np.moveaxis(stages, 0, -1) - q[:, None], internal[:-1].reshape(len(q), -1)
        return RadauSteps(instants, q, v, a, increments, excitations[1:], internal)

    @cached_property
    def lengths(self) -> Array:
        """Their lengths, (s,), s."""
        return np.diff(self.instants)


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
        equations, model, first = form.equations, form.equations.model, piece.at(piece.begin)
        self.now, self.steps = piece.begin, 0
        self._unit = min(1.0, 10 * (piece.end - piece.begin))  # s; the shortest step is relative to it, or to the time
        self._form, self._piece, self._largest_step, self._control = form, piece, largest_step, StepControl()
        q, v = model.of_free(start.coordinates), model.of_free(start.velocities)
        internal = equations.internal(start, parameters).reshape(equations.internal_shape[::-1])
        a = form.accelerations(q, v, first, parameters, internal.T)
        trial = form.trial(piece.function)

        self.newton = arrays = Newton(form, parameters, tolerance)
        arrays.end[:], arrays.excitations[:], arrays.internal[:] = (q, v, a), first, internal
        arrays.nodes[:] = model.whole(q, first[:NODE]).reshape(-1, 1, NODE)
        self._finish = Buffered(form.finish, *arrays.of_stages, arrays.end[2])
        trial_inputs = arrays.time, arrays.length, arrays.ratio, arrays.nodes
        self._predict = Buffered(trial, *trial_inputs, outputs=[arrays.excitations, arrays.increments])

    @property
    def state(self) -> State:
        """The state at the end of the last step."""
        newton = self.newton
        velocities = self._form.equations.model.whole(newton.end[1], newton.excitations[-1, NODE : 2 * NODE])
        return State(newton.nodes[:, -1].ravel(), velocities, self.now, newton.internal.ravel())

    @property
    def end(self) -> StepEnd:
        """The last step, as results keep it.

        Its end, s; q, v and a there, (3, N); the excitations at its stages, (3, 16), the coordinates at its start
        and its stages, (nodes, 4, 4), and the internal strains at its end, (n, m b).
        """
        newton = self.newton
        return self.now, newton.end.copy(), newton.excitations.copy(), newton.nodes.copy(), newton.internal.copy()

    def steps_to(self, instant: float) -> Iterator[None]:
        """Take steps until an instant is passed."""
        before = self.steps
        while self.steps == 0 or self.now < instant - SAME_TIME * self._control.length:
            self.advance()
            if self.steps - before > MOST_STEPS:
                raise SimulationError(_failure("took too many steps", self.now, self._control.length), self.now)
            yield

    def advance(self) -> None:
        """Take one step, as long as the tolerance and Newton's method allow."""
        control, newton = self._control, self.newton
        while True:
            h = control.trial_length(self._piece.end - self.now, self._largest_step)
            if not h > 1e-11 * max(self._unit, self.now):
                raise SimulationError(_failure("could not continue", self.now, h), self.now)
            self._begin(h)
            if not control.keeps_matrices(h):
                newton.factorise()
            iterations = newton.converge()
            if not iterations:
                control = control.after_failure(h)
                continue
            stages, end, norm, internal = self._finish()
            error = norm.item()
            if error <= 1.0:
                break
            control = control.after_error(h, error, iterations)

        self._control = control.after_step(h, error, iterations, newton.contraction, self._largest_step)
        newton.nodes[:, 0] = newton.nodes[:, -1]
        newton.nodes[:, 1:], newton.end[:] = stages.reshape(-1, STAGES, NODE), end.reshape(newton.end.shape)
        newton.internal.reshape(-1)[:] = internal.ravel()
        self.now += h
        self.steps += 1

    def _begin(self, h: float) -> None:
        """Set up the trial of a step of length h: evaluate the excitation and predict the increments."""
        newton, (_, v, a) = self.newton, self.newton.end
        newton.length[0], newton.time[0] = h, self.now
        newton.ratio[0] = h / self._control.length if self.steps else 1.0
        self._predict()
        if not self.steps:
            times = h * RADAU.nodes
            moved = self._form.equations.model.with_fixed_base(np.outer(v, times) + np.outer(a, times**2 / 2))
            newton.increments[:] = np.moveaxis(moved[NODE:].reshape(-1, NODE, STAGES), 1, 2)


def _failure(problem: str, now: float, step: float) -> str:
    """Return the message of a run that fails: what went wrong, where, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may have suffered an impact, or "
        "may bend more sharply than its elements can follow; try a larger tolerance, or more elements"
    )
