"""Integration of a motion through the smooth pieces of its base motion, by one integrator or by two.

IDAS follows modes of the mesh that ring with nothing to damp them, however small they are: its steps then shrink to
their periods, and the run crawls.  Radau damps what it does not resolve and passes over them.  An automatic run
therefore counts the steps of IDAS.  It gives it

    SPARE_STEPS + IDAS_WORK / elements  (evenly over the time)

steps; where these do not do, or IDAS fails, Radau goes on from the last good state.  Where the expected motion is so
small that IDAS would need a tolerance below ``IDAS_SMALLEST``, Radau starts.  Steps are counted, not seconds, so that a
run gives the same numbers each time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.idas import integrate_by_idas
from ancf_casadi.dynamics.radau.stepper import integrate_by_radau
from ancf_casadi.dynamics.segments import InitialValueProblem, Segment, SegmentSolution, cut
from ancf_casadi.dynamics.tolerance import IDAS_SMALLEST, idas_tolerance, radau_tolerance
from ancf_casadi.dynamics.trajectory import IntegratorUse, State
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

Method = Literal["auto", "idas", "radau"]

IDAS_WORK = 4_000_000  # steps times elements that an automatic run gives to IDAS; about 4 s
FEWEST_ELEMENTS = 20  # a coarser mesh costs no less a step
SPARE_STEPS = 10_000  # that it may take early
BURST = 4  # steps between two samples, over their even share
RESTART_STEPS = 300  # up to a sample, besides, as a restart takes
SEGMENTS = 25  # of a piece of the base motion; a restart of IDAS costs about a hundred small steps
MOST_POINTS = 250  # samples of a segment


@dataclass(frozen=True, eq=False)
class SmoothPiece:
    """A smooth piece of the base motion.

    Parameters
    ----------
    begin, end : float
        Its first and last instant, s.
    clamp : Function
        (t) -> position, velocity and acceleration of the clamped node, (12,).
    """

    begin: float
    end: float
    clamp: cs.Function


@dataclass(frozen=True, eq=False)
class Integration:
    """A motion to be integrated.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    pieces : sequence of SmoothPiece
        The motion of the clamp.
    start : State
        The state at the start.
    sample_rate : float
        Samples per second, 1/s, from the start on.
    method : {"auto", "idas", "radau"}
        The integrator.
    tolerance : float or None
        Its tolerance; None for one that follows the expected travel.
    travel : float
        The expected travel, relative to the length of the beam; of no account where a tolerance is given.
    largest_step : float
        No step is longer, s.
    options : mapping
        Options of CasADi's IDAS interface.
    """

    equations: Equations
    pieces: Sequence[SmoothPiece]
    start: State
    sample_rate: float
    method: Method
    tolerance: float | None
    travel: float
    largest_step: float = math.inf
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def first(self) -> IntegratorUse:
        """The integrator at the start."""
        origin = self.pieces[0].begin
        if self.method == "radau":
            return self._radau(origin)
        needed = idas_tolerance(self.travel) if self.tolerance is None else self.tolerance
        if self.tolerance is None and needed < IDAS_SMALLEST:
            if self.method == "auto":
                return self._radau(
                    origin,
                    f"the motion expected, {self.travel:.1e} of the length, is so small that IDAS needs a tolerance of "
                    f"{needed:.1e}, below the {IDAS_SMALLEST:.0e} that it can hold",
                )
            needed = IDAS_SMALLEST
        return IntegratorUse(origin, "idas", needed)

    def integrate(self) -> Iterator[tuple[SegmentSolution, IntegratorUse]]:
        """Integrate, and yield the solution on each time segment with the integrator that found it.

        Raises
        ------
        InputError
            If IDAS refuses an option.
        SimulationError
            If the integrator fails.
        """
        use, state, steps = self.first, self.start, 0
        for piece, after in zip(self.pieces, [*self.pieces[1:], None], strict=True):
            left = self._segments(piece)
            found = self._solve(use, piece, state, left)
            while left:
                try:
                    path = next(found)
                except SimulationError as error:
                    if not self._may_change(use):
                        raise
                    use = self._radau(left[0].start, str(error).partition("; try")[0])
                    found = self._solve(use, piece, state, left)
                    continue
                segment = left.pop(0)
                state, steps = path.end, steps + path.steps
                if after is not None and not left:
                    path = _with_blow(self.equations.model, path, after.clamp(after.begin).full().ravel())
                yield path, use
                if self._may_change(use) and steps > self._allowance(segment.end):
                    use = self._radau(segment.end, f"IDAS took {steps} steps up to there")
                    found = self._solve(use, piece, state, left)

    def _may_change(self, use: IntegratorUse) -> bool:
        return self.method == "auto" and use.method == "idas"

    def _radau(self, start: float, reason: str = "") -> IntegratorUse:
        tolerance = radau_tolerance(self.travel) if self.tolerance is None else self.tolerance
        return IntegratorUse(start, "radau", tolerance, reason)

    def _solve(
        self, use: IntegratorUse, piece: SmoothPiece, state: State, segments: Sequence[Segment]
    ) -> Iterator[SegmentSolution]:
        """Integrate over the time segments, a copy of those given."""
        bound = {"max_num_steps": self._most_between_samples} if self.method == "auto" else {}
        problem = InitialValueProblem(
            equations=self.equations,
            clamp=piece.clamp,
            start=state,
            segments=list(segments),
            tolerance=use.tolerance,
            largest_step=self.largest_step,
            options={**bound, **self.options},
        )
        return (integrate_by_radau if use.method == "radau" else integrate_by_idas)(problem)

    def _segments(self, piece: SmoothPiece) -> list[Segment]:
        points = max(1, math.ceil((piece.end - piece.begin) * self.sample_rate / SEGMENTS))
        return list(cut(piece.begin, piece.end, self.pieces[0].begin, self.sample_rate, min(points, MOST_POINTS)))

    @property
    def _rate(self) -> float:
        """Steps per second of simulated time that IDAS is given, 1/s."""
        elements = max(self.equations.model.beam.elements, FEWEST_ELEMENTS)
        return IDAS_WORK / elements / (self.pieces[-1].end - self.pieces[0].begin)

    @property
    def _most_between_samples(self) -> int:
        return RESTART_STEPS + math.ceil(BURST * self._rate / self.sample_rate)

    def _allowance(self, now: float) -> float:
        return SPARE_STEPS + self._rate * (now - self.pieces[0].begin)


def _with_blow(model: Model, path: SegmentSolution, clamp: Array) -> SegmentSolution:
    """Count the work of the blow to the clamped node where its velocity jumps at the end of a time segment."""
    mass = model.mass(model.properties).sparse()
    after = np.concatenate([clamp[NODE : 2 * NODE], path.end.velocities[NODE:]])
    energies = [float(rates @ (mass @ rates) / 2) for rates in (path.end.velocities, after)]
    return replace(path, end_energies=path.end_energies + np.array([0.0, energies[1] - energies[0]]))
