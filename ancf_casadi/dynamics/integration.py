"""Choice of the integrator, and integration of a motion through the smooth pieces of its excitation.

The default is Radau.  In every motion that was measured, under every law, it reaches the wanted accuracy at a smaller
cost than IDAS (``docs/accuracy.md``): its order is 5 instead of 2, and it damps the vibrations of the mesh that its
steps do not resolve, while IDAS resolves all of them, however small.  IDAS integrates if it is asked for, by its name
or by options, which are its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ancf_casadi.dynamics.idas import integrate_by_idas
from ancf_casadi.dynamics.radau.collocation import Collocation, first_equal
from ancf_casadi.dynamics.radau.stepper import integrate_by_radau
from ancf_casadi.dynamics.segments import InitialValueProblem, Segment, SegmentSolution, divide
from ancf_casadi.dynamics.start import MotionSetup, TimedPiece
from ancf_casadi.dynamics.tolerance import idas_tolerance, radau_tolerance
from ancf_casadi.dynamics.trajectory import IntegratorUse
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

Method = Literal["auto", "idas", "radau"]

SEGMENTS = 25  # per piece of the excitation; a restart of IDAS costs about a hundred small steps


def chosen(setup: MotionSetup, method: Method, tolerance: float | None, options: Mapping[str, Any]) -> IntegratorUse:
    """Return the integrator of a motion, and its tolerance.

    Parameters
    ----------
    setup : MotionSetup
        The motion.
    method : {"auto", "idas", "radau"}
        The integrator.
    tolerance : float or None
        Its tolerance; None for the default, which depends on the expected travel.
    options : mapping
        Options of CasADi's IDAS interface.
    """
    used = ("idas" if options else "radau") if method == "auto" else method
    default = idas_tolerance if used == "idas" else radau_tolerance
    return IntegratorUse(setup.pieces[0].begin, used, default(setup.travel) if tolerance is None else tolerance)


def integrate(
    setup: MotionSetup, use: IntegratorUse, largest_step: float = math.inf, options: Mapping[str, Any] | None = None
) -> Iterator[SegmentSolution]:
    """Integrate a motion, and yield the solution on each time segment.

    Parameters
    ----------
    setup : MotionSetup
        The motion.
    use : IntegratorUse
        The integrator.
    largest_step : float
        Largest step, s.
    options : mapping, optional
        Options of CasADi's IDAS interface.

    Raises
    ------
    InputError
        If IDAS refuses an option.
    SimulationError
        If the integrator fails.
    """
    state, form = setup.start, Collocation(setup.equations)
    if use.method == "radau":
        form = first_equal(form)
    for piece, following in zip(setup.pieces, [*setup.pieces[1:], None], strict=True):
        problem = InitialValueProblem(
            equations=setup.equations,
            excitation=piece.excitation,
            start=state,
            segments=_segments(setup, piece),
            tolerance=use.tolerance,
            largest_step=min(largest_step, piece.largest_step),
            options=options or {},
        )
        solutions = integrate_by_idas(problem) if use.method == "idas" else integrate_by_radau(problem, form)
        for solution in solutions:
            state = solution.end
            if following is not None and solution.segment is problem.segments[-1]:
                clamp = following.excitation(following.begin).full().ravel()
                solution = _with_impact(setup.equations.model, solution, clamp)
            yield solution


def _segments(setup: MotionSetup, piece: TimedPiece) -> list[Segment]:
    rate = setup.sample_rate
    points = max(1, math.ceil((piece.end - piece.begin) * rate / SEGMENTS))
    return list(divide(piece.begin, piece.end, setup.pieces[0].begin, rate, min(points, 250)))  # samples per segment


def _with_impact(model: Model, solution: SegmentSolution, clamp: Array) -> SegmentSolution:
    """Add the work of an impact, a velocity jump of the clamped node at the end of a segment."""
    mass = model.mass(model.properties).sparse()
    after = np.concatenate([clamp[NODE : 2 * NODE], solution.end.velocities[NODE:]])
    energies = [float(velocities @ (mass @ velocities) / 2) for velocities in (solution.end.velocities, after)]
    return replace(solution, end_energies=solution.end_energies + np.array([0.0, energies[1] - energies[0], 0.0]))
