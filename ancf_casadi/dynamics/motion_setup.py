"""Set-up of a motion: checks of the arguments that ``simulate`` and ``motion`` share, excitation, samples and start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import NoneType

import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.equations import Equations, Make, as_they_are, shared_equations
from ancf_casadi.dynamics.excitation import SAME_TIME, Excitation, excitation_pieces, sample_excitation
from ancf_casadi.dynamics.limits import check_excitation, check_start
from ancf_casadi.dynamics.placed_load import TIP
from ancf_casadi.dynamics.start import AT_REST, Start, initial_state
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.dynamics.tolerance import expected_travel
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, physical
from ancf_casadi.vibration.equilibrium import Equilibrium

MOST_TRAJECTORY_SAMPLES = 2e6  # coordinates and velocities take 2.7 GB at 20 elements


@dataclass(frozen=True, eq=False)
class MotionSetup:
    """Setup of a motion."""

    equations: Equations
    base: BaseMotion
    load: TipLoad | None
    pieces: Sequence[Excitation]  # smooth pieces of base and load, from the first to the last sample
    excitation: tuple[Array, Array]  # instants throughout the motion (k,), s, and the excitation there (k, 16)
    start: State  # the initial state
    from_rest: bool  # whether this is an equilibrium under gravity, a flow and the first load
    sample_rate: float  # 1/s
    times: Array  # the samples (k,), s

    @cached_property
    def travel(self) -> float:
        """The expected travel, relative to the length of the beam."""
        model, place, flow = self.equations.model, self.equations.place, self.equations.flow
        return expected_travel(model, *self.excitation, self.start, place, flow, from_rest=self.from_rest)


def set_up(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None,
    base: BaseMotion | None,
    load: TipLoad | None,
    sample_rate: float,
    start: Start | Equilibrium | State,
    make: Make = as_they_are,
) -> MotionSetup:
    """Check arguments of ``simulate``, and return the setup of the motion; ``make`` is an argument of ``Equations``."""
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(base, "base", BaseMotion, NoneType)
    check_instance(load, "load", TipLoad, NoneType)
    check_instance(start, "start", str, Equilibrium, State)
    duration, sample_rate = physical(duration, "duration"), physical(sample_rate, "sample_rate")
    if base is None and isinstance(start, State) and start.coordinates.shape == (model.size,):
        base = FixedBase.at(start.coordinates, model.beam.axis)
    base = FixedBase() if base is None else base
    load = None if load is None else load.along(model.beam)
    law, place = RayleighDamping() if damping is None else damping, TIP if load is None else load.place
    equations = shared_equations(model, law, make, place)
    times = _sample_times(duration, sample_rate, start.time if isinstance(start, State) else 0.0)
    begin, end = float(times[0]), float(times[-1])
    if load is not None and load.begin >= end:
        raise InputError(
            f"begins at {load.begin:g} s, after the end of the motion at {end:g} s; its times are those of the motion",
            "load",
        )
    pieces = excitation_pieces(model, base, load, begin, end)
    excitation = sample_excitation(pieces)
    check_excitation(model, *excitation)
    check_start(model, pieces[0], start)
    return MotionSetup(
        equations=equations,
        base=base,
        load=load,
        pieces=pieces,
        excitation=excitation,
        start=initial_state(equations, pieces[0], start),
        from_rest=start in AT_REST,
        sample_rate=sample_rate,
        times=times,
    )


def _sample_times(duration: float, sample_rate: float, origin: float) -> Array:
    """Return the instants of the samples, s, from ``origin`` on."""
    if duration * sample_rate > MOST_TRAJECTORY_SAMPLES:
        raise InputError(
            f"{duration * sample_rate:.3g} samples are more than {MOST_TRAJECTORY_SAMPLES:.0e}", "sample_rate"
        )
    times = origin + np.arange(math.floor(duration * sample_rate + SAME_TIME) + 1) / sample_rate
    if len(times) < 2:
        raise InputError(f"must be at least one sampling interval, {1 / sample_rate:g} s, got {duration:g}", "duration")
    return times
