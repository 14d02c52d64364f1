"""Time integration of the large motion by IDAS, with exact Jacobians.

Order.  Undamped high modes lie on the imaginary axis, where backward differentiation formulas of order 3 to 5 are
unstable; the order is 2.

Stretches.  Each smooth piece of the base motion is cut into stretches, and IDAS restarted on each with consistent
accelerations; the state is handed on, and progress shown, between them.  A run that is interrupted or fails keeps what
the stretches before have found.

Compilation.  Where the simulated time is ``COMPILED_FROM`` or more and there is a C compiler, the equations are
compiled.  The choice depends on nothing else, so that a run gives the same numbers each time.

References
----------
Hindmarsh et al. 2005, "SUNDIALS: Suite of nonlinear and differential/algebraic equation solvers".
"""

from __future__ import annotations

import contextlib
import functools
import io
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray
from tqdm import tqdm

from ancf_casadi.compilation import compiled, interpreted
from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.element import axial_strain
from ancf_casadi.equations import Equations
from ancf_casadi.equilibrium import Equilibrium, static_equilibrium
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.excitation import BaseMotion, FixedBase
from ancf_casadi.inputs import positive
from ancf_casadi.interrupts import noted_interrupts
from ancf_casadi.model import NODE, Model
from ancf_casadi.trajectory import State, Trajectory

Array = NDArray[np.float64]
Start = Literal["equilibrium", "straight", "moving"]

TOLERANCE = 1e-8
COMPILED_FROM = 0.25  # s of simulated time
MOST_SAMPLES = 1e7  # 13 GB at 20 elements
STRETCHES = 25  # of a piece of the base motion; a restart costs about a hundred small steps
LARGEST_STRETCH = 0.01  # axial strain of a given state; that of an equilibrium is balanced
BAR = "{l_bar}{bar}| {n:.2f}/{total:.2f} s [{elapsed}<{remaining}]"
DEFAULTS = {
    "reltol": 1e-12,
    "max_multistep_order": 2,
    "linear_solver": "csparse",
    "cj_scaling": True,
    "suppress_algebraic": True,
    "calc_ic": False,
    "max_num_steps": 200_000,  # between two samples
}
CLOSE = 1e-9  # of a sampling interval; instants nearer than that are the same


def simulate(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    tolerance: float = TOLERANCE,
    options: Mapping[str, Any] | None = None,
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
    tolerance : float
        Local error of the positions relative to the length of the beam.
    options : mapping, optional
        Options of CasADi's IDAS interface; they override the defaults.
    progress : bool
        Whether to show a progress bar in simulated seconds.

    Raises
    ------
    InputError
        If a number is not positive, the start is unknown, belongs to another model, or is a state that stretches the
        beam by more than 1 %, or IDAS refuses an option.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails; its ``partial`` holds the motion up to there.

    Notes
    -----
    Ctrl-C does not raise during the integration: the run ends with the current stretch, a 25th of it at most, and
    returns what is done, with ``interrupted`` set.
    """
    began = time.perf_counter()
    duration, sample_rate = positive(duration, "duration"), positive(sample_rate, "sample_rate")
    tolerance = positive(tolerance, "tolerance")
    law = RayleighDamping() if damping is None else damping
    base = FixedBase() if base is None else base
    equations = Equations(model, law)
    settings = {**DEFAULTS, "abstol": tolerance, **(options or {})}
    if duration * sample_rate > MOST_SAMPLES:
        raise InputError(f"{duration * sample_rate:.3g} samples are more than {MOST_SAMPLES:.0e}", "sample_rate")
    instants = np.arange(math.floor(duration * sample_rate + CLOSE) + 1) / sample_rate
    if len(instants) < 2:
        raise InputError(f"must be one sampling interval at least, {1 / sample_rate:g} s, got {duration:g}", "duration")
    finish, now = float(instants[-1]), 0.0
    make = compiled if finish >= COMPILED_FROM else interpreted
    residual, energetics = make(equations.residual), make(equations.energetics)
    pieces = base.pieces()
    state = _initial_state(equations, equations.clamp(pieces[0], base), start)
    paths: list[_Path] = []

    with tqdm(total=finish, disable=not progress, bar_format=BAR) as bar:
        for piece in pieces:
            end = min(piece.end, finish)
            size = max(1, math.ceil((end - now) * sample_rate / STRETCHES))
            clamp = equations.clamp(piece, base)
            if paths:
                paths[-1] = _with_blow(equations, paths[-1], clamp(now).full().ravel())
            integrate = _integrator(equations, residual, energetics, clamp, settings)
            for stretch in _stretches(now, end, sample_rate, size):
                try:
                    with noted_interrupts() as interrupts:
                        paths.append(integrate(state, stretch))
                except SimulationError as error:
                    error.partial = _trajectory(equations, instants, paths, began)
                    raise
                if interrupts:
                    return replace(_trajectory(equations, instants, paths, began), interrupted=True)
                state = paths[-1].last
                bar.update(min(stretch.length, finish - bar.n))
            now = end
            if end >= finish:
                break
    return _trajectory(equations, instants, paths, began)


@dataclass(frozen=True)
class _Stretch:
    """A stretch of time between two restarts.

    ``points`` instants at equal intervals, the start not among them, end it; the last hands on the state.  The first of
    them, ``samples`` in number, are instants of the result; at time 0 the start is one too.
    """

    start: float
    length: float
    points: int
    samples: int


@dataclass(frozen=True, eq=False)
class _Path:
    """What a stretch gives.

    Scaled states x (k, 2 N), clamped nodes (k, 12), forces on them (k, 4) and energies (k, 2) at its samples, the same
    at its end, and the number of steps.
    """

    states: Array
    clamps: Array
    forces: Array
    energies: Array
    last: Array
    last_clamp: Array
    last_energies: Array
    steps: int


def _stretches(begin: float, end: float, rate: float, size: int) -> Iterator[_Stretch]:
    """Cut the time from begin to end at samples, ``size`` samples a stretch; the ends may lie between two samples."""
    first, last = math.ceil(begin * rate - CLOSE), math.floor(end * rate + CLOSE)
    if first > last:
        yield _Stretch(begin, end - begin, 1, 0)
        return
    if first / rate - begin > CLOSE / rate:
        yield _Stretch(begin, first / rate - begin, 1, 1)
    for k in range(first, last, size):
        points = min(size, last - k)
        yield _Stretch(k / rate, points / rate, points, points)
    if end - last / rate > CLOSE / rate:
        yield _Stretch(last / rate, end - last / rate, 1, 0)


def _initial_state(equations: Equations, clamp: cs.Function, start: Start | Equilibrium | State) -> Array:
    """Scaled state x at time 0."""
    model = equations.model
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
        velocities = _rigid_motion(coordinates, rates) if start == "moving" else np.zeros(model.size)
    return equations.scaled(coordinates[model.free], velocities[model.free])


def _rigid_motion(coordinates: Array, rates: Array) -> Array:
    """Rates of a beam that moves as one with the clamped node, whose rates are given."""
    nodes = coordinates.reshape(-1, NODE)
    x, y = nodes[0, 2:]
    turn = (x * rates[3] - y * rates[2]) / (x * x + y * y)
    arms = np.column_stack([nodes[:, :2] - nodes[0, :2], nodes[:, 2:]])
    velocities = turn * np.column_stack([-arms[:, 1], arms[:, 0], -arms[:, 3], arms[:, 2]])
    velocities[:, :2] += rates[:2]
    return np.asarray(velocities.ravel())


def _integrator(
    equations: Equations,
    residual: cs.Function,
    energetics: cs.Function,
    clamp: cs.Function,
    settings: Mapping[str, Any],
) -> Callable[[Array, _Stretch], _Path]:
    """Return what integrates a stretch from a state."""
    parameters = equations.parameters
    s, time_span = cs.MX.sym("s"), cs.MX.sym("time", 2)
    x, z = cs.MX.sym("x", residual.size1_in(0)), cs.MX.sym("z", residual.size1_in(1))
    start, span = cs.vertsplit(time_span)
    x_t, alg = residual(x, z, clamp(start + span * s), parameters)
    powers, reaction = energetics(x, z, clamp(start + span * s), parameters)
    dae = {"t": s, "x": x, "z": z, "p": time_span, "ode": span * x_t, "alg": alg, "quad": span * powers}
    slope = cs.jacobian(alg, z)
    linear = cs.Function("linear", [s, x, z, time_span], [alg, slope])  # alg is linear in z
    forces = cs.Function("forces", [x, z, s, time_span], [reaction])

    @functools.cache
    def solver(points: int) -> cs.Function:
        grid = np.linspace(0.0, 1.0, points + 1)[1:]
        try:
            with _quiet():
                return cs.integrator("integrator", "idas", dae, 0.0, grid, dict(settings))
        except RuntimeError as error:
            raise InputError(_refusal(str(error)), "options") from None

    def integrate(state: Array, stretch: _Stretch) -> _Path:
        p = [stretch.start, stretch.length]
        constant, matrix = linear(0.0, state, 0.0, p)
        z0 = -scipy.sparse.linalg.splu(matrix.sparse()).solve(constant.full().ravel())
        run = solver(stretch.points)
        try:
            with _quiet():
                result = run(x0=state, z0=z0, p=p)
        except RuntimeError as error:
            raise SimulationError(_advice(str(error), stretch), stretch.start) from None
        instants = np.arange(stretch.points + 1) / stretch.points
        states = np.vstack([state, result["xf"].full().T])
        unknowns = np.vstack([z0, result["zf"].full().T])
        energies = np.vstack([np.zeros(2), result["qf"].full().T])
        kept = slice(0 if stretch.start == 0.0 else 1, stretch.samples + 1)
        clamps = clamp((stretch.start + stretch.length * instants)[None, :]).full().T
        return _Path(
            states=states[kept],
            clamps=clamps[kept],
            forces=forces(states.T, unknowns.T, instants[None, :], p).full().T[kept],
            energies=energies[kept],
            last=states[-1],
            last_clamp=clamps[-1],
            last_energies=energies[-1],
            steps=int(run.stats()["nsteps"]),
        )

    return integrate


def _with_blow(equations: Equations, path: _Path, clamp: Array) -> _Path:
    """Count the work of the blow to the clamped node where its speed jumps at the end of a stretch."""
    before, after = (equations.kinetic_energy(path.last, node) for node in (path.last_clamp, clamp))
    return replace(path, last_energies=path.last_energies + np.array([0.0, after - before]))


def _trajectory(equations: Equations, instants: Array, paths: Sequence[_Path], began: float) -> Trajectory:
    """Put the stretches together; there may be fewer than asked for."""
    before = np.cumsum([np.zeros(2), *(path.last_energies for path in paths)], axis=0)
    energies = np.vstack(
        [start + path.energies for start, path in zip(before, paths, strict=False)] or [np.empty((0, 2))]
    )
    q, v = equations.unscaled(np.vstack([path.states for path in paths] or [np.empty((0, 2 * equations.free))]))
    clamps = np.vstack([path.clamps for path in paths] or [np.empty((0, 3 * NODE))])
    return Trajectory(
        model=equations.model,
        time=instants[: len(q)],
        coordinates=np.hstack([clamps[:, :NODE], q]),
        velocities=np.hstack([clamps[:, NODE : 2 * NODE], v]),
        clamp_force=np.vstack([path.forces for path in paths] or [np.empty((0, NODE))]),
        dissipated_energy=energies[:, 0],
        base_work=energies[:, 1],
        steps=sum(path.steps for path in paths),
        wall_seconds=time.perf_counter() - began,
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep what CasADi prints off the terminal."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _refusal(message: str) -> str:
    """Say in a line which option CasADi's IDAS interface refuses."""
    reasons = r"Unknown option: .+|Illegal type for .+|Cannot load shared library \S+'|IDA\w+ returned .\w+."
    said = re.search(reasons, message)
    return f"CasADi's IDAS interface refuses them: {said[0] if said else message.strip().splitlines()[0]}"


def _advice(message: str, stretch: _Stretch) -> str:
    """Say in a line what went wrong in a stretch, and what to try."""
    between = f"between {stretch.start:g} and {stretch.start + stretch.length:g} s"
    cause = "took too many steps" if "TOO_MUCH_WORK" in message else "could not go on"
    return (
        f"the integrator {cause} {between}: try start='moving' if the base starts with a speed, a larger tolerance, "
        "or more elements where the beam bends sharply"
    )
