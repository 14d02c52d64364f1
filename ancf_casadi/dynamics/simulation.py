"""Simulation of the large motion of a beam.

``simulate`` sets up the motion (``motion_setup``), integrates it piece by piece of the excitation and segment by
segment, and collects the solution.  In every motion that was measured, under every law, Radau reaches the wanted
accuracy at a smaller cost than IDAS (``docs/accuracy.md``): it damps the vibrations of the mesh that its steps do not
resolve, while IDAS resolves all of them, however small.  If there is a C compiler, the forces of an element are
compiled, which does not change any digit of the result.

The power lost to damping is e_t . Q_damp.  It is never negative under the laws of the toolkit, with one exception:
damping by the tangent stiffness K loses beta e_t^T K e_t, which is negative if K is indefinite in the direction of
motion: when a beam buckles, or falls from an unstable position, this law drives the motion, and ``simulate`` warns.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import NoneType
from typing import Any, Literal, get_args

import numpy as np
from tqdm import tqdm

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.dense_output import DenseMotion, SegmentSolution
from ancf_casadi.dynamics.idas import integrate_by_idas
from ancf_casadi.dynamics.motion_setup import MotionSetup, set_up
from ancf_casadi.dynamics.radau.stepper import integrate_by_radau
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.dynamics.tolerance import default_tolerance
from ancf_casadi.dynamics.trajectory import IntegratorUse, Trajectory
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.mesh_limits import warn_of_overbent_elements, warn_of_short_elements
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.compilation import compile_together
from ancf_casadi.support.inputs import check_instance, choice, flag, physical, positive_or_infinite, whole
from ancf_casadi.support.interrupts import has_interrupt, noted_interrupts
from ancf_casadi.vibration.equilibrium import Equilibrium

Method = Literal["auto", "idas", "radau"]

TIME_BAR = "{l_bar}{bar}| {n:.2f}/{total:.2f} s [{elapsed}<{remaining}]"


def simulate(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    method: Method = "auto",
    tolerance: float | None = None,
    largest_step: float = math.inf,
    options: Mapping[str, Any] | None = None,
    most_steps: int = 5_000_000,  # of IDAS, these take one or two minutes
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
        Motion of the clamp.  If not given, the clamp is fixed: at its place in a ``State``, else at the origin.
    load : TipLoad, optional
        Force and moment over time at the tip or another point, or a force that travels along the beam; none if not
        given.
    sample_rate : float
        Samples per second in the result, 1/s.
    start : {"equilibrium", "straight", "impact"}, Equilibrium or State
        ``equilibrium``: the shape at rest under gravity, the flow of the law and the load at time 0.  ``straight``: as
        manufactured, moved to its first support; all of them then act.  An ``Equilibrium``: released from there; a load
        or a gust that sets in suddenly is ``start=static_equilibrium(model)``.  All three move with the base, at rest
        relative to it.  ``impact``: at rest as in ``equilibrium`` even if the base starts with a velocity, which is an
        impact on the clamp.  A ``State``: as given, at its own time; ``start=run.state(-1)`` continues another run,
        from any of its samples.
    method : {"auto", "idas", "radau"}
        The integrator.  ``auto`` is Radau, which reaches the same accuracy at a smaller cost (``docs/accuracy.md``), or
        IDAS if ``options`` are given; ``integrators`` of the result tells.
    tolerance : float, optional
        Local error of the positions relative to the length of the beam, and of the slopes relative to 1/2.  The default
        depends on the expected motion (``ancf_casadi.dynamics.tolerance``).
    largest_step : float
        Largest step, s.  Limit the step if the base motion has short events.  Even steps also follow a steady vibration
        better than the tolerance alone.
    options : mapping, optional
        Options of CasADi's IDAS interface; they override the defaults.
    most_steps : int
        Largest number of steps; a run that needs more fails.
    progress : bool
        Whether to show a progress bar in simulated seconds.

    Raises
    ------
    InputError
        If a number is not positive, the method or the start is unknown, the base motion is not finite, the load begins
        after the end of the motion, or IDAS refuses an option; if the start belongs to another model, or is a state
        that stretches the beam by more than 1 %, or whose clamp disagrees with the base motion; if the state or the
        straight beam does not fit displaced or turned supports; or if the base motion does not begin with the clamp of
        a beam at rest, at the origin and along its axis.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails or takes too many steps; its ``partial`` holds the motion up to there.

    Warns
    -----
    UserWarning
        If damping by the tangent stiffness has added energy to the motion, the start is unstable or stretches the beam
        unevenly, or an element bends by more than a cubic element can follow.

    Notes
    -----
    Ctrl-C does not raise during the integration.  The run ends with the current time segment, at most a 25th of the
    run, and returns the finished part with ``interrupted`` set.  Within ``run_all``, a fit or a study, it then raises.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> base = HarmonicBase(amplitude=5e-3, frequency=2.0)
    >>> run = simulate(Model(beam), damping=RayleighDamping(alpha=0.2), base=base, duration=0.25)
    >>> print(f"the tip swings {1e3 * abs(run.tip[:, 0]).max():.0f} mm")
    the tip swings 14 mm
    """
    began = time.perf_counter()
    choice(method, get_args(Method), "method")
    check_instance(options, "options", Mapping, NoneType)
    if options and method == "radau":
        raise InputError("are those of IDAS; method='radau' has none", "options")
    tolerance = None if tolerance is None else physical(tolerance, "tolerance")
    largest_step, most_steps = positive_or_infinite(largest_step, "largest_step"), whole(most_steps, "most_steps", 1)
    hidden = not flag(progress, "progress")
    with noted_interrupts():
        setup = set_up(
            model,
            duration=duration,
            damping=damping,
            base=base,
            load=load,
            sample_rate=sample_rate,
            start=start,
            make=compile_together,
        )
        used = ("idas" if options else "radau") if method == "auto" else method
        if tolerance is None:
            tolerance = default_tolerance(used, setup.travel)
        use = IntegratorUse(float(setup.times[0]), used, tolerance)
        done: list[SegmentSolution] = []
        interrupted, length = False, float(np.ptp(setup.times))
        with tqdm(total=length, disable=hidden, bar_format=TIME_BAR) as bar:
            try:
                for solution in _integrate(setup, use, largest_step, options or {}):
                    done.append(solution)
                    _check_steps(done, most_steps, used)
                    if has_interrupt():
                        interrupted = True
                        break
                    bar.update(min(solution.segment.length, length - bar.n))
            except SimulationError as error:
                error.partial = _trajectory(setup, use, done, began)
                raise
    run = replace(_trajectory(setup, use, done, began), interrupted=interrupted)
    _warn_of_energy_gain(run, setup.equations.law)
    coordinates = np.concatenate([solution.steps.ends[:, 0] for solution in done if solution.steps is not None])
    warn_of_short_elements(model, coordinates)
    warn_of_overbent_elements(model, coordinates)
    return run


def _integrate(
    setup: MotionSetup, use: IntegratorUse, largest_step: float, options: Mapping[str, Any]
) -> Iterator[SegmentSolution]:
    """Integrate a motion, and yield the solution on each time segment."""
    state = setup.start
    for piece in setup.pieces:
        segments = piece.segments(use.start, setup.sample_rate)
        settings = piece, state, segments, use.tolerance, min(largest_step, piece.largest_step)
        if use.method == "idas":
            solutions = integrate_by_idas(setup.equations, *settings, options)
        else:
            solutions = integrate_by_radau(setup.equations, *settings)
        for solution in solutions:
            state = solution.end
            yield solution


def _check_steps(done: Sequence[SegmentSolution], most_steps: int, used: str) -> None:
    """Raise a SimulationError if a run has taken too many steps."""
    steps, last = sum(solution.count for solution in done), done[-1].segment
    if steps > most_steps:
        alternative = "method='radau', " if used == "idas" else ""
        raise SimulationError(
            f"the integrator took {steps} steps up to {last.end:g} s, more than {most_steps}, the last of "
            f"them {last.length / done[-1].count:.1e} s long: undamped vibrations of the mesh may keep them short; "
            f"try {alternative}a little damping proportional to the strain rate, a larger tolerance, or more "
            "most_steps",
            last.end,
        )


def _trajectory(setup: MotionSetup, use: IntegratorUse, done: Sequence[SegmentSolution], began: float) -> Trajectory:
    """Return the motion up to the last segment of a run that began at ``began`` on the clock ``time.perf_counter``."""
    equations, steps = setup.equations, tuple(solution.steps for solution in done if solution.steps is not None)
    samples = sum(len(range(*solution.segment.kept.indices(solution.segment.points + 1))) for solution in done)
    return Trajectory(
        model=equations.model,
        time=setup.times[:samples],
        source=DenseMotion(equations.model, equations.law, setup.base, setup.load, steps),
        steps=sum(solution.count for solution in done),
        wall_seconds=time.perf_counter() - began,
        integrators=(use,),
    )


def _warn_of_energy_gain(run: Trajectory, law: DampingLaw) -> None:
    """Warn if the damping law has added more energy to a motion than the error of the energy balance."""
    if law.dissipative:
        return
    lost = run.dissipated_energy
    gained = np.maximum.accumulate(lost) - lost
    if not gained.any() or gained.max() <= np.abs(run.balance_error).max():
        return
    end = int(gained.argmax())
    begin = int(lost[: end + 1].argmax())
    warnings.warn(
        f"damping added {gained[end]:.2g} J to the motion from {run.time[begin]:g} s to {run.time[end]:g} s: the "
        "tangent stiffness is indefinite there, as in a beam that buckles; use RayleighDamping(..., "
        "stiffness='strain-rate'), which never adds energy",
        stacklevel=3,
    )
