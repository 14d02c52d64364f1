"""Integration of a motion through the smooth pieces of its excitation, by one integrator or two.

IDAS resolves every undamped vibration of the mesh, however small: its steps then shrink to a fraction of the periods of
these vibrations, and the run becomes very slow.  Radau damps the vibrations that its steps do not resolve.  Up to the
time t of a motion from t_0 to t_1, an automatic run therefore grants IDAS the number of steps

    SPARE_STEPS + IDAS_WORK / elements (t - t_0)/(t_1 - t_0),    elements at least ``FEWEST_ELEMENTS``.

If IDAS exceeds this number or fails, Radau continues from the last good state.  If no tolerance is given, and the
expected motion is so small that IDAS would need one below ``IDAS_SMALLEST``, Radau integrates from the start.  The
limit counts steps, not seconds, so that a run gives the same numbers every time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ancf_casadi.dynamics.idas import integrate_by_idas
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.stepper import integrate_by_radau
from ancf_casadi.dynamics.segments import InitialValueProblem, Segment, SegmentSolution, divide
from ancf_casadi.dynamics.start import MotionSetup, TimedPiece
from ancf_casadi.dynamics.tolerance import IDAS_SMALLEST, idas_tolerance, radau_tolerance
from ancf_casadi.dynamics.trajectory import IntegratorUse, State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

Method = Literal["auto", "idas", "radau"]

IDAS_WORK = 4_000_000  # steps of IDAS times elements in an automatic run; they take about 4 s
FEWEST_ELEMENTS = 20  # a step on a coarser mesh takes as long
SPARE_STEPS = 10_000  # steps granted at the start
BURST = 4  # largest number of steps between two samples, relative to their even distribution over the time
RESTART_STEPS = 300  # granted in addition between two samples, because a restart needs small steps
SEGMENTS = 25  # per piece of the excitation; a restart of IDAS costs about a hundred small steps
MOST_POINTS = 250  # samples per segment


@dataclass(frozen=True, eq=False)
class Integration:
    """The integration of a motion.

    Parameters
    ----------
    setup : MotionSetup
        The motion.
    method : {"auto", "idas", "radau"}
        The integrator.
    tolerance : float or None
        Its tolerance; None for the default, which depends on the expected travel.
    largest_step : float
        Largest step, s.
    options : mapping
        Options of CasADi's IDAS interface.
    """

    setup: MotionSetup
    method: Method
    tolerance: float | None
    largest_step: float = math.inf
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def first(self) -> IntegratorUse:
        """The integrator at the start."""
        if self.method == "radau":
            return self._radau(self._begin)
        if self.tolerance is not None:
            return IntegratorUse(self._begin, "idas", self.tolerance)
        travel = self.setup.travel
        needed = idas_tolerance(travel)
        if self.method == "auto" and needed < IDAS_SMALLEST:
            return self._radau(
                self._begin,
                f"the expected motion, {travel:.1e} of the length, is so small that IDAS would need a tolerance of "
                f"{needed:.1e}, below its limit of {IDAS_SMALLEST:.0e}",
            )
        return IntegratorUse(self._begin, "idas", max(needed, IDAS_SMALLEST))

    def integrate(self) -> Iterator[tuple[SegmentSolution, IntegratorUse]]:
        """Integrate, and yield the solution on each time segment with the integrator that found it.

        Raises
        ------
        InputError
            If IDAS refuses an option.
        SimulationError
            If the integrator fails.
        """
        use, state, steps = self.first, self.setup.start, 0
        for piece, following in zip(self.setup.pieces, [*self.setup.pieces[1:], None], strict=True):
            left = self._segments(piece)
            solutions = self._solve(use, piece, state, left)
            while left:
                try:
                    solution = next(solutions)
                except SimulationError as error:
                    if not self._may_change(use):
                        raise
                    use = self._radau(left[0].start, str(error).partition("; try")[0])
                    solutions = self._solve(use, piece, state, left)
                    continue
                segment = left.pop(0)
                state, steps = solution.end, steps + solution.steps
                if following is not None and not left:
                    clamp = following.excitation(following.begin).full().ravel()
                    solution = _with_impact(self.setup.equations.model, solution, clamp)
                yield solution, use
                if self._may_change(use) and steps > self._allowance(segment.end):
                    use = self._radau(segment.end, f"IDAS took {steps} steps up to there")
                    solutions = self._solve(use, piece, state, left)

    @property
    def _begin(self) -> float:
        return self.setup.pieces[0].begin

    def _may_change(self, use: IntegratorUse) -> bool:
        return self.method == "auto" and use.method == "idas"

    def _radau(self, start: float, reason: str = "") -> IntegratorUse:
        tolerance = radau_tolerance(self.setup.travel) if self.tolerance is None else self.tolerance
        return IntegratorUse(start, "radau", tolerance, reason)

    def _solve(
        self, use: IntegratorUse, piece: TimedPiece, state: State, segments: Sequence[Segment]
    ) -> Iterator[SegmentSolution]:
        """Integrate over a copy of the segments."""
        bound = {"max_num_steps": self._most_between_samples} if self.method == "auto" else {}
        problem = InitialValueProblem(
            equations=self.setup.equations,
            excitation=piece.excitation,
            start=state,
            segments=list(segments),
            tolerance=use.tolerance,
            largest_step=min(self.largest_step, piece.largest_step),
            options={**bound, **self.options},
        )
        return integrate_by_radau(problem, self._form) if use.method == "radau" else integrate_by_idas(problem)

    @cached_property
    def _form(self) -> Collocation:
        """The Functions of a Radau step."""
        return Collocation(self.setup.equations)

    def _segments(self, piece: TimedPiece) -> list[Segment]:
        rate = self.setup.sample_rate
        points = max(1, math.ceil((piece.end - piece.begin) * rate / SEGMENTS))
        return list(divide(piece.begin, piece.end, self._begin, rate, min(points, MOST_POINTS)))

    @property
    def _steps_per_second(self) -> float:
        """Steps of IDAS granted per second of simulated time, 1/s."""
        elements = max(self.setup.equations.model.beam.elements, FEWEST_ELEMENTS)
        return IDAS_WORK / elements / (self.setup.pieces[-1].end - self._begin)

    @property
    def _most_between_samples(self) -> int:
        return RESTART_STEPS + math.ceil(BURST * self._steps_per_second / self.setup.sample_rate)

    def _allowance(self, now: float) -> float:
        """Return the number of steps granted to IDAS up to a time."""
        return SPARE_STEPS + self._steps_per_second * (now - self._begin)


def _with_impact(model: Model, solution: SegmentSolution, clamp: Array) -> SegmentSolution:
    """Add the work of an impact, a velocity jump of the clamped node at the end of a segment."""
    mass = model.mass(model.properties).sparse()
    after = np.concatenate([clamp[NODE : 2 * NODE], solution.end.velocities[NODE:]])
    energies = [float(velocities @ (mass @ velocities) / 2) for velocities in (solution.end.velocities, after)]
    return replace(solution, end_energies=solution.end_energies + np.array([0.0, energies[1] - energies[0], 0.0]))
