"""Time integration by Radau IIA collocation of order 5, an implicit Runge-Kutta method of three stages.

The method is stable for all oscillations and damps those that its steps do not resolve: mesh modes that nothing excites
decay, and the steps adapt to the other modes.  ``collocation`` states the equations of a step.  A step is

    predicted       by the collocation polynomial of the last one,
    solved          by Newton's method (``newton``), whose matrices are kept as long as it converges fast,
    accepted        if the error of positions and slopes is within the tolerance, else repeated,
    kept            as polynomials, which give the motion at all instants (``dense_output``).

The error estimate does not include the velocities.  The powers lost to damping and supplied by the base and the tip
load are integrated by the quadrature of the stages.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.dense_output import SegmentSolution, Slopes, Steps
from ancf_casadi.dynamics.excitation import ENERGY_STATES, SAME_TIME, Excitation, Segment
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.newton import Newton, StepControl
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

MOST_STEPS = 200_000  # to the end of a segment; these take a minute


def integrate_by_radau(
    form: Collocation,
    parameters: Array,
    piece: Excitation,
    start: State,
    work: Array,
    segments: Sequence[Segment],
    tolerance: float,
    largest_step: float,
) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each of its consecutive segments."""
    stepper = Stepper(form, parameters, piece, start, tolerance, largest_step, work)
    slopes = Slopes(form.equations.model)
    for segment in segments:
        ends = [stepper.end, *(stepper.end for _ in stepper.steps_to(segment.end))]
        count = len(ends) - 1
        steps = _step_polynomials(slopes, ends, first=stepper.steps == count) if count else None
        yield SegmentSolution(segment, steps, stepper.state, stepper.work, count)


def _step_polynomials(
    slopes: Slopes, step_ends: Sequence[tuple[float, Array, Array, Array, Array, Array]], *, first: bool
) -> Steps:
    """Return the steps between ends as of ``Stepper.end``; ``first``: whether the first one begins the piece."""
    instants, free, bases, nodes, energies, added = (np.array(values) for values in zip(*step_ends, strict=True))
    ends = slopes.model.whole(np.moveaxis(free, -1, 0), np.moveaxis(bases.reshape(-1, 3, NODE), -1, 0))
    energies = np.concatenate([energies[1:, None], added[1:]], axis=1)
    stages = np.moveaxis(nodes[1 + first :, :, 1:], 1, 2)
    return Steps(slopes, instants, np.moveaxis(ends, 0, -1), energies, stages.reshape(*stages.shape[:2], -1))


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
    equation of motion, in place of the nominal ones of ``form``; ``start`` is the state at the beginning of the piece,
    and ``work`` are the energies there.
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
        work: Array | None = None,
    ) -> None:
        model, first = form.equations.model, piece.at(piece.begin)
        self.now, self.steps = piece.begin, 0
        self._form, self._piece, self._largest_step, self._control = form, piece, largest_step, StepControl()
        # energies at the start of the last step; coefficients of x, x^2 and x^3 in those added within it, and their sum
        self._energies = np.zeros(ENERGY_STATES) if work is None else work
        self._added = np.zeros((STAGES + 1, ENERGY_STATES))

        self.newton = arrays = Newton(form, parameters, tolerance)
        arrays.excitations[:] = first
        q, v, a = arrays.end
        q[:], v[:] = model.of_free(start.coordinates), model.of_free(start.velocities)
        arrays.nodes[:] = model.whole(q, first[:NODE]).reshape(-1, 1, NODE)
        a[:] = form.accelerations(q, v, first, parameters)

        self._finish = Buffered(form.finish, *arrays.of_stages, a, arrays.nodes)
        trial_inputs = arrays.time, arrays.length, arrays.ratio, arrays.nodes
        self._predict = Buffered(
            _trial(form.prediction, piece.function), *trial_inputs, outputs=[arrays.excitations, arrays.increments]
        )

    @property
    def state(self) -> State:
        """The state at the end of the last step."""
        newton = self.newton
        velocities = self._form.equations.model.whole(newton.end[1], newton.excitations[-1, NODE : 2 * NODE])
        return State(newton.nodes[:, -1].ravel(), velocities, self.now)

    @property
    def last_step(self) -> RadauStep:
        """The last step."""
        newton, model, h = self.newton, self._form.equations.model, self._control.length
        q, v, a = newton.start.copy()
        stages = newton.nodes[:, 1:].transpose(1, 0, 2).reshape(STAGES, -1)
        free = stages[:, NODE:] if model.held_at_base_alone else model.of_free(stages.T).T
        return RadauStep(self.now - h, h, q, v, a, free - q, newton.excitations.copy())

    @property
    def end(self) -> tuple[float, Array, Array, Array, Array, Array]:
        """State, stages and energies of the last step, as a result keeps them.

        Its end, s; q, v and a there, (3, N), and the motion of the base, (12,); the coordinates at its start and its
        stages, (nodes, 4, 4); the energies at its start, (3,), J, and the coefficients of x, x^2 and x^3 in those that
        it adds.
        """
        newton = self.newton
        copies = newton.end.copy(), newton.excitations[-1, : 3 * NODE].copy(), newton.nodes.copy()
        return self.now, *copies, self._energies, self._added[:-1]

    @property
    def work(self) -> Array:
        """The energies at the end of the last step, (3,), J."""
        return np.asarray(self._energies + self._added[-1])

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
            if not h > 1e-11 * max(1.0, self.now):  # s; after the first second, relative to the time
                raise SimulationError(_failure("could not continue", self.now, h), self.now)
            keeps_matrices = control.keep and h == control.length
            self._begin(h)
            if not keeps_matrices:
                newton.factorise()
            iterations = newton.converge()
            if not iterations:
                control = control.after_failure(h, old_matrices=keeps_matrices)
                continue
            nodes, end, norm, added = self._finish()
            error = norm.item()
            if error <= 1.0:
                break
            control = control.after_error(h, error, iterations)

        self._control = control.after_step(h, error, iterations, newton.contraction, self._largest_step)
        self._energies, self._added = self.work, added.reshape(self._added.shape).copy()
        newton.start[:] = newton.end
        newton.end[:], newton.nodes[:] = end.reshape(newton.end.shape), nodes.reshape(newton.nodes.shape)
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


def _trial(prediction: cs.Function, excitation: cs.Function) -> cs.Function:
    """(t, h, ratio, nodes) -> the excitations at the stages of a step, (16, 3), and its predicted increments."""
    t, h, ratio = (cs.MX.sym(name) for name in ("t", "h", "ratio"))
    nodes = cs.MX.sym("nodes", *prediction.size_in(0))
    columns = cs.horzcat(*(excitation(t + c * h) for c in RADAU.nodes.tolist()))
    return cs.Function("trial", [t, h, ratio, nodes], [columns, prediction(nodes, ratio, columns)])


def _failure(problem: str, now: float, step: float) -> str:
    """Return the message of a run that fails: what went wrong, where, and what to try."""
    return (
        f"the integrator {problem} at {now:g} s with a step of {step:.1e} s: the beam may have suffered an impact, or "
        "may bend more sharply than its elements can follow; try a larger tolerance, or more elements"
    )
