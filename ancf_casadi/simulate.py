"""Simulation of the large motion of a beam.

A run goes through the smooth pieces of the base motion one after the other; the integrator restarts where a piece ends.

    idas     backward differentiation formulas of variable step; the default
    radau    implicit Runge-Kutta collocation of order 5, with longer steps

Compilation.  The forces of an element are compiled if there is a C compiler, which changes no digit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ancf_casadi.compilation import compiled
from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.element import axial_strain
from ancf_casadi.equations import Equations
from ancf_casadi.equilibrium import Equilibrium, static_equilibrium
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.excitation import BaseMotion, FixedBase
from ancf_casadi.idas import integrate_by_idas
from ancf_casadi.inputs import positive
from ancf_casadi.interrupts import noted_interrupts
from ancf_casadi.model import NODE, Model
from ancf_casadi.radau import integrate_by_radau
from ancf_casadi.stretches import CLOSE, Path, Stretch, cut
from ancf_casadi.trajectory import State, Trajectory

Array = NDArray[np.float64]
Start = Literal["equilibrium", "straight", "moving"]
Method = Literal["idas", "radau"]

TOLERANCES: Mapping[Method, float] = {"idas": 1e-8, "radau": 1e-7}
MOST_SAMPLES = 1e7  # 13 GB at 20 elements
MOST_STEPS = 5_000_000  # a minute or two
CHECKED = 1001  # instants of a piece of the base motion
STRETCHES = 25  # of a piece of the base motion; a restart of IDAS costs about a hundred small steps
LARGEST_STRETCH = 0.01  # axial strain of a given state; that of an equilibrium is balanced
BAR = "{l_bar}{bar}| {n:.2f}/{total:.2f} s [{elapsed}<{remaining}]"


def simulate(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    method: Method = "idas",
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
        Motion of the clamp; fixed if not given.
    sample_rate : float
        Samples a second in the result, 1/s.
    start : {"equilibrium", "straight", "moving"}, Equilibrium or State
        ``equilibrium``: at rest under gravity, also where the base starts with a speed, which is a blow to the clamp.
        ``moving``: the same shape, with the speed of the base.  ``straight``: at rest as manufactured, gravity then
        acts.  An ``Equilibrium``: released from there at rest.  A ``State``: as given.
    method : {"idas", "radau"}
        The integrator.  ``radau`` takes longer steps and lets the modes of the mesh die down by itself where nothing
        else damps them.
    tolerance : float, optional
        Local error of the positions relative to the length of the beam, and of the slopes relative to 1/2; 1e-8 for
        ``idas`` and 1e-7 for ``radau`` if not given.
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
        belongs to another model, or is a state that stretches the beam by more than 1 %, or IDAS refuses an option.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails or takes too many steps; its ``partial`` holds the motion up to there.

    Notes
    -----
    Ctrl-C does not raise during the integration: the run ends with the current stretch, a 25th of it at most, and
    returns what is done, with ``interrupted`` set.
    """
    began = time.perf_counter()
    duration, sample_rate = positive(duration, "duration"), positive(sample_rate, "sample_rate")
    if method not in get_args(Method):
        raise InputError(f"must be one of {', '.join(get_args(Method))}, got {method!r}", "method")
    if options and method != "idas":
        raise InputError("are those of IDAS; method='radau' has none", "options")
    most_steps = round(positive(most_steps, "most_steps"))
    local_error = positive(TOLERANCES[method] if tolerance is None else tolerance, "tolerance")
    if largest_step != math.inf:
        positive(largest_step, "largest_step")
    base = FixedBase() if base is None else base
    equations = Equations(model, RayleighDamping() if damping is None else damping, compiled)
    instants = sample_times(duration, sample_rate)
    finish, now = float(instants[-1]), 0.0
    pieces = base.pieces()
    state = initial_state(model, equations.clamp(pieces[0], base), start)
    paths: list[Path] = []

    def integrate(clamp: cs.Function, stretches: Sequence[Stretch]) -> Iterator[Path]:
        given = equations, clamp, state, stretches, local_error, largest_step
        return integrate_by_radau(*given) if method == "radau" else integrate_by_idas(*given, options or {})

    with noted_interrupts() as interrupts, tqdm(total=finish, disable=not progress, bar_format=BAR) as bar:
        for piece in pieces:
            end = min(piece.end, finish)
            size = max(1, math.ceil((end - now) * sample_rate / STRETCHES))
            clamp = equations.clamp(piece, base)
            _check_base(clamp, now, end)
            if paths:
                paths[-1] = _with_blow(model, paths[-1], clamp(now).full().ravel())
            stretches = list(cut(now, end, sample_rate, size))
            found = integrate(clamp, stretches)
            for stretch in stretches:
                try:
                    paths.append(next(found))
                    _check_steps(paths, stretch, most_steps)
                except SimulationError as error:
                    error.partial = _trajectory(model, instants, paths, began)
                    raise
                if interrupts:
                    return replace(_trajectory(model, instants, paths, began), interrupted=True)
                bar.update(min(stretch.length, finish - bar.n))
            now, state = end, paths[-1].end
            if end >= finish:
                break
    return _trajectory(model, instants, paths, began)


def _check_base(clamp: cs.Function, begin: float, end: float) -> None:
    """Refuse a base motion that is not finite."""
    times = np.linspace(begin, end, CHECKED)
    finite = np.isfinite(clamp(times[None, :]).full()).all(axis=0)
    if not finite.all():
        raise InputError(f"its position, speed or acceleration is not finite at {times[~finite][0]:g} s", "base")


def _check_steps(paths: Sequence[Path], stretch: Stretch, most: int) -> None:
    """Give up a run that crawls."""
    steps = sum(path.steps for path in paths)
    if steps > most:
        raise SimulationError(
            f"the integrator took {steps} steps up to {stretch.end:g} s, more than {most}, lately of "
            f"{stretch.length / paths[-1].steps:.1e} s: modes of the mesh may ring with nothing to damp them; try "
            "method='radau', a little damping proportional to the strain rate, a larger tolerance, or more most_steps",
            stretch.end,
        )


def sample_times(duration: float, sample_rate: float) -> Array:
    """Return the instants of the samples.

    Raises
    ------
    InputError
        If they are too many, or fewer than two.
    """
    if duration * sample_rate > MOST_SAMPLES:
        raise InputError(f"{duration * sample_rate:.3g} samples are more than {MOST_SAMPLES:.0e}", "sample_rate")
    instants = np.arange(math.floor(duration * sample_rate + CLOSE) + 1) / sample_rate
    if len(instants) < 2:
        raise InputError(f"must be one sampling interval at least, {1 / sample_rate:g} s, got {duration:g}", "duration")
    return instants


def initial_state(model: Model, clamp: cs.Function, start: Start | Equilibrium | State) -> State:
    """Return the state at time 0.

    Raises
    ------
    InputError
        If the start is not one of those that ``simulate`` knows.
    EquilibriumError
        If there is no equilibrium to start from.
    """
    rates = clamp(0.0).full().ravel()[NODE : 2 * NODE]
    if isinstance(start, State):
        for name, given in (("coordinates", start.coordinates), ("velocities", start.velocities)):
            if given.shape != (model.size,) or not np.isfinite(given).all():
                raise InputError(f"the {name} must be {model.size} finite numbers", "start")
        stretch = np.abs(axial_strain(model.gauss_slopes(start.coordinates), "engineering")).max()
        if stretch > LARGEST_STRETCH:
            raise InputError(
                f"stretches the beam by {100 * stretch:.1f} %, which sets off axial waves; bend it without stretching, "
                "as static_equilibrium with a tip load does",
                "start",
            )
        coordinates, velocities = start.coordinates, start.velocities
    else:
        if isinstance(start, Equilibrium):
            if start.model != model:
                raise InputError("the equilibrium belongs to another model", "start")
            coordinates = start.coordinates
        elif start in get_args(Start):
            coordinates = model.straight if start == "straight" else static_equilibrium(model).coordinates
        else:
            known = ", ".join(get_args(Start))
            raise InputError(f"must be one of {known}, an Equilibrium or a State, got {start!r}", "start")
        moving = start == "moving"
        velocities = rigid_motion(model)(coordinates, rates).full().ravel() if moving else np.zeros(model.size)
    return State(coordinates, velocities)


def rigid_motion(model: Model) -> cs.Function:
    """(coordinates, rates of the clamped node) -> rates of a beam that moves as one with the clamped node."""
    e, rates = cs.MX.sym("e", model.size), cs.MX.sym("rates", NODE)
    nodes = cs.reshape(e, NODE, -1)
    x, y = nodes[2, 0], nodes[3, 0]
    turn = (x * rates[3] - y * rates[2]) / (x * x + y * y)
    arms = nodes - cs.vertcat(nodes[:2, 0], 0.0, 0.0)
    turning = cs.vertcat(-arms[1, :], arms[0, :], -arms[3, :], arms[2, :])
    moved = turn * turning + cs.vertcat(rates[:2], 0.0, 0.0)
    return cs.Function("rigid_motion", [e, rates], [cs.vec(moved)])


def _with_blow(model: Model, path: Path, clamp: Array) -> Path:
    """Count the work of the blow to the clamped node where its speed jumps at the end of a stretch."""
    mass = model.mass(model.properties).sparse()
    after = np.concatenate([clamp[NODE : 2 * NODE], path.end.velocities[NODE:]])
    energies = [float(rates @ (mass @ rates) / 2) for rates in (path.end.velocities, after)]
    return replace(path, end_energies=path.end_energies + np.array([0.0, energies[1] - energies[0]]))


def _trajectory(model: Model, instants: Array, paths: Sequence[Path], began: float) -> Trajectory:
    """Put the stretches together; there may be fewer than asked for."""
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
    )
