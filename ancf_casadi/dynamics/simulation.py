"""Simulation of the large motion of a beam.

``simulate`` checks what is asked for, finds the initial state and puts the solution together; ``integration`` goes
through the motion with

    idas     backward differentiation formulas of variable step, order 2
    radau    implicit Runge-Kutta collocation of order 5, with longer steps
    auto     IDAS, and Radau from the time on at which IDAS crawls; the default

Compilation.  The forces of an element are compiled if there is a C compiler, which changes no digit.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import NoneType
from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.dissipation import warn_of_energy_gain
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.integration import Integration, Method, SmoothPiece
from ancf_casadi.dynamics.segments import CLOSE, SegmentSolution
from ancf_casadi.dynamics.start import Start, base_of, initial_state
from ancf_casadi.dynamics.tolerance import expected_travel
from ancf_casadi.dynamics.trajectory import IntegratorUse, State, Trajectory
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import compiled
from ancf_casadi.support.inputs import check_instance, choice, flag, physical, positive, positive_or_infinite
from ancf_casadi.support.interrupts import noted_interrupts
from ancf_casadi.vibration.equilibrium import Equilibrium

MOST_SAMPLES = 1e7  # 13 GB at 20 elements
MOST_STEPS = 5_000_000  # a minute or two
CHECKED = 1001  # instants of a piece of the base motion
BAR = "{l_bar}{bar}| {n:.2f}/{total:.2f} s [{elapsed}<{remaining}]"


def simulate(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    method: Method = "auto",
    tolerance: float | None = None,
    largest_step: float = math.inf,
    options: Mapping[str, Any] | None = None,
    most_steps: int = MOST_STEPS,
    progress: bool = False,
) -> Trajectory:
    """Integrate the motion of a beam.

    Parameters
    ----------
    model : Model
        The beam.
    duration : float
        Simulated time, s.
    damping : DampingLaw, optional
        The damping law; undamped if not given.
    base : BaseMotion, optional
        Motion of the clamp.  If not given, the clamp is fixed: where a ``State`` has it, else at the origin.
    sample_rate : float
        Samples per second in the result, 1/s.
    start : {"equilibrium", "straight", "impact"}, Equilibrium or State
        ``equilibrium``: the shape of rest under gravity.  ``straight``: as manufactured; gravity then acts.  An
        ``Equilibrium``: released from there.  All three move with the base, at rest relative to it.  ``impact``: at
        rest under gravity also where the base starts with a velocity, which is a blow to the clamp.  A ``State``: as
        given, at its own time, so that a run goes on from any sample of another: ``start=run.state(-1)``.
    method : {"auto", "idas", "radau"}
        The integrator.  ``auto``: IDAS, and Radau from the time on at which IDAS takes too many steps; a warning says
        so, and ``integrators`` of the result.  ``idas`` and ``radau`` are strict.
    tolerance : float, optional
        Local error of the positions relative to the length of the beam, and of the slopes relative to 1/2.  If not
        given, it follows the expected motion (``ancf_casadi.dynamics.tolerance``).
    largest_step : float
        No step is longer, s: for a base motion with short events, or for even steps, which follow a steady vibration
        better than the tolerance by itself.
    options : mapping, optional
        Options of CasADi's IDAS interface; they override the defaults.
    most_steps : int
        Steps after which a run is given up.
    progress : bool
        Whether to show a progress bar in simulated seconds.

    Raises
    ------
    InputError
        If a number is not positive, the method or the start is unknown, the base motion is not finite, the start
        belongs to another model, or is a state that stretches the beam by more than 1 % or whose clamp is not where
        the base motion has it, or IDAS refuses an option.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails or takes too many steps; its ``partial`` holds the motion up to there.

    Warns
    -----
    UserWarning
        If ``auto`` uses Radau, or damping by the tangent stiffness has added energy to the motion.

    Notes
    -----
    Ctrl-C does not raise during the integration: the run ends with the current time segment, a 25th of it at most, and
    returns what is done, with ``interrupted`` set.
    """
    began = time.perf_counter()
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(base, "base", BaseMotion, NoneType)
    check_instance(start, "start", str, Equilibrium, State)
    check_instance(options, "options", Mapping, NoneType)
    choice(method, get_args(Method), "method")
    duration, sample_rate = physical(duration, "duration"), physical(sample_rate, "sample_rate")
    if options and method == "radau":
        raise InputError("are those of IDAS; method='radau' has none", "options")
    most_steps = round(positive(most_steps, "most_steps"))
    largest_step, progress = positive_or_infinite(largest_step, "largest_step"), flag(progress, "progress")
    base = base_of(model, base, start)
    equations = Equations(model, RayleighDamping() if damping is None else damping, compiled)
    instants = sample_times(duration, sample_rate, start.time if isinstance(start, State) else 0.0)
    tolerance = None if tolerance is None else positive(tolerance, "tolerance")
    length = float(instants[-1] - instants[0])
    paths: list[SegmentSolution] = []
    uses: list[IntegratorUse] = []
    interrupted = False
    with noted_interrupts() as interrupts:
        pieces = smooth_pieces(equations, base, float(instants[0]), float(instants[-1]))
        nodes = clamped_nodes(pieces)
        state = initial_state(model, pieces[0].clamp, start)
        integration = Integration(
            equations=equations,
            pieces=pieces,
            start=state,
            sample_rate=sample_rate,
            method=method,
            tolerance=tolerance,
            travel=expected_travel(model, nodes, state) if tolerance is None else math.nan,
            largest_step=largest_step,
            options=options or {},
        )
        with tqdm(total=length, disable=not progress, bar_format=BAR) as bar:
            try:
                for path, use in integration.integrate():
                    paths.append(path)
                    if not uses or use != uses[-1]:
                        uses.append(use)
                    _check_steps(paths, most_steps)
                    if interrupts:
                        interrupted = True
                        break
                    bar.update(min(path.segment.length, length - bar.n))
            except SimulationError as error:
                error.partial = _trajectory(model, instants, paths, uses, began)
                raise
    run = replace(_trajectory(model, instants, paths, uses, began), interrupted=interrupted)
    for warning in run.warnings:
        warnings.warn(warning, stacklevel=2)
    warn_of_energy_gain(run, equations.law)
    return run


def smooth_pieces(equations: Equations, base: BaseMotion, begin: float, end: float) -> list[SmoothPiece]:
    """Return the smooth pieces of a base motion between two instants (s)."""
    pieces = []
    for piece in base.pieces_after(begin):
        pieces.append(SmoothPiece(begin, min(piece.end, end), equations.clamp(piece, base)))
        begin = piece.end
        if begin >= end:
            break
    return pieces


def clamped_nodes(pieces: Sequence[SmoothPiece]) -> Array:
    """Return the clamped node at instants all over a base motion, (k, 12).

    Raises
    ------
    InputError
        If its motion is not finite.
    """
    found = []
    for piece in pieces:
        times = np.linspace(piece.begin, piece.end, CHECKED)
        nodes = piece.clamp(times[None, :]).full().T
        finite = np.isfinite(nodes).all(axis=1)
        if not finite.all():
            raise InputError(f"its position, speed or acceleration is not finite at {times[~finite][0]:g} s", "base")
        found.append(nodes)
    return np.vstack(found)


def _check_steps(paths: Sequence[SegmentSolution], most: int) -> None:
    """Give up a run that crawls."""
    steps, last = sum(path.steps for path in paths), paths[-1].segment
    if steps > most:
        raise SimulationError(
            f"the integrator took {steps} steps up to {last.end:g} s, more than {most}, lately of "
            f"{last.length / paths[-1].steps:.1e} s: modes of the mesh may ring with nothing to damp them; try "
            "method='radau', a little damping proportional to the strain rate, a larger tolerance, or more most_steps",
            last.end,
        )


def sample_times(duration: float, sample_rate: float, origin: float = 0.0) -> Array:
    """Return the instants of the samples, s, from ``origin`` on.

    Raises
    ------
    InputError
        If they are too many, or fewer than two.
    """
    if duration * sample_rate > MOST_SAMPLES:
        raise InputError(f"{duration * sample_rate:.3g} samples are more than {MOST_SAMPLES:.0e}", "sample_rate")
    instants = origin + np.arange(math.floor(duration * sample_rate + CLOSE) + 1) / sample_rate
    if len(instants) < 2:
        raise InputError(f"must be one sampling interval at least, {1 / sample_rate:g} s, got {duration:g}", "duration")
    return instants


def _trajectory(
    model: Model, instants: Array, paths: Sequence[SegmentSolution], uses: Sequence[IntegratorUse], began: float
) -> Trajectory:
    """Put the segments together; there may be fewer than asked for."""
    before = np.cumsum([np.zeros(2), *(path.end_energies for path in paths)], axis=0)
    energies = np.vstack(
        [np.empty((0, 2)), *(start + path.energies for start, path in zip(before, paths, strict=False))]
    )
    none = np.empty((0, model.size))
    return Trajectory(
        model=model,
        time=instants[: len(energies)],
        coordinates=np.vstack([none, *(path.coordinates for path in paths)]),
        velocities=np.vstack([none, *(path.velocities for path in paths)]),
        clamp_force=np.vstack([np.empty((0, NODE)), *(path.forces for path in paths)]),
        dissipated_energy=energies[:, 0],
        base_work=energies[:, 1],
        steps=sum(path.steps for path in paths),
        wall_seconds=time.perf_counter() - began,
        integrators=tuple(uses),
    )
