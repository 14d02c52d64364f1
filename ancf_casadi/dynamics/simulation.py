"""Simulation of the large motion of a beam.

``simulate`` checks its arguments, sets up the motion (``start``) and collects the solution; ``integration`` runs

    radau    implicit Runge-Kutta collocation of order 5, with long steps
    idas     backward differentiation formulas with variable steps, order 2
    auto     Radau, or IDAS if its options are given; the default

If there is a C compiler, the forces of an element are compiled, which does not change any digit of the result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import NoneType
from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.dissipation import warn_of_energy_gain
from ancf_casadi.dynamics.integration import Method, chosen, integrate
from ancf_casadi.dynamics.segments import ENERGY_STATES, SegmentSolution
from ancf_casadi.dynamics.start import MotionSetup, Start, set_up
from ancf_casadi.dynamics.tip_load import LOAD_SIZE, TipLoad
from ancf_casadi.dynamics.trajectory import IntegratorUse, State, Trajectory
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.compilation import compiled
from ancf_casadi.support.inputs import check_instance, choice, flag, physical, positive_or_infinite, whole
from ancf_casadi.support.interrupts import noted_interrupts
from ancf_casadi.vibration.equilibrium import Equilibrium

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
        Force and moment at the tip over time, in the laboratory frame; none if not given.
    sample_rate : float
        Samples per second in the result, 1/s.
    start : {"equilibrium", "straight", "impact"}, Equilibrium or State
        ``equilibrium``: the shape at rest under gravity and the load at time 0.  ``straight``: as manufactured; gravity
        and load then act.  An ``Equilibrium``: released from there; a load applied suddenly to a beam at rest is
        ``start=static_equilibrium(model)``.  All three move with the base, at rest relative to it.  ``impact``: at rest
        as in ``equilibrium`` even if the base starts with a velocity, which is an impact on the clamp.  A ``State``: as
        given, at its own time; ``start=run.state(-1)`` continues another run, from any of its samples.
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
        that stretches the beam by more than 1 %, or whose clamp disagrees with the base motion; or if the base motion
        does not begin with the clamp of a beam at rest, at the origin and along its axis.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails or takes too many steps; its ``partial`` holds the motion up to there.

    Warns
    -----
    UserWarning
        If damping by the tangent stiffness has added energy to the motion.

    Notes
    -----
    Ctrl-C does not raise during the integration.  The run ends with the current time segment, at most a 25th of the
    run, and returns the finished part with ``interrupted`` set.

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
    with noted_interrupts() as interrupts:
        setup = set_up(
            model,
            duration=duration,
            damping=damping,
            base=base,
            load=load,
            sample_rate=sample_rate,
            start=start,
            make=compiled,
        )
        use = chosen(setup, method, tolerance, options or {})
        done, interrupted, length = _Solution(setup, use, began), False, float(setup.times[-1] - setup.times[0])
        with tqdm(total=length, disable=hidden, bar_format=TIME_BAR) as bar:
            try:
                for solution in integrate(setup, use, largest_step, options):
                    done.add(solution, most_steps)
                    if interrupts:
                        interrupted = True
                        break
                    bar.update(min(solution.segment.length, length - bar.n))
            except SimulationError as error:
                error.partial = done.trajectory()
                raise
    run = replace(done.trajectory(), interrupted=interrupted)
    warn_of_energy_gain(run, setup.equations.law)
    return run


@dataclass(frozen=True, eq=False)
class _Solution:
    """The solution of a motion, collected segment by segment.

    Parameters
    ----------
    setup : MotionSetup
        The motion.
    use : IntegratorUse
        The integrator.
    began : float
        Reading of ``time.perf_counter`` at the start of the run, s.
    segments : list of SegmentSolution
        The solution on each segment so far.
    """

    setup: MotionSetup
    use: IntegratorUse
    began: float
    segments: list[SegmentSolution] = field(default_factory=list)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(solution.steps for solution in self.segments)

    def add(self, solution: SegmentSolution, most_steps: int) -> None:
        """Add the solution on a segment.

        Raises
        ------
        SimulationError
            If the run has taken too many steps.
        """
        self.segments.append(solution)
        last, other = solution.segment, "method='radau', " if self.use.method == "idas" else ""
        if self.steps > most_steps:
            raise SimulationError(
                f"the integrator took {self.steps} steps up to {last.end:g} s, more than {most_steps}, the last of "
                f"them {last.length / solution.steps:.1e} s long: undamped vibrations of the mesh may keep them short; "
                f"try {other}a little damping proportional to the strain rate, a larger tolerance, or more most_steps",
                last.end,
            )

    def trajectory(self) -> Trajectory:
        """Return the motion up to the last segment."""
        model, load, done = self.setup.equations.model, self.setup.load, self.segments
        starts = np.cumsum([np.zeros(ENERGY_STATES), *(solution.end_energies for solution in done)], axis=0)
        energies = [start + solution.energies for start, solution in zip(starts, done, strict=False)]
        lost, base_work, load_work = np.vstack([np.empty((0, ENERGY_STATES)), *energies]).T
        none, times = np.empty((0, model.size)), self.setup.times[: len(lost)]
        return Trajectory(
            model=model,
            time=times,
            coordinates=np.vstack([none, *(solution.coordinates for solution in done)]),
            velocities=np.vstack([none, *(solution.velocities for solution in done)]),
            clamp_force=np.vstack([np.empty((0, NODE)), *(solution.forces for solution in done)]),
            tip_load=np.zeros((times.size, LOAD_SIZE)) if load is None else load.values(times),
            dissipated_energy=lost,
            base_work=base_work,
            load_work=load_work,
            steps=self.steps,
            wall_seconds=time.perf_counter() - self.began,
            integrators=(self.use,),
        )
