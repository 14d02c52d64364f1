"""Time integration of the large motion by IDAS, with exact Jacobians.

The free coordinates q, their rates v and accelerations a form the semi-explicit system

    q_t = v,    v_t = a,    0 = M e_tt + Q_damp(e, e_t) + Q_e(e) - Q_g   (free rows),

in which the clamped node carries the base motion: its position, velocity and acceleration enter e, e_t and e_tt.
With the accelerations as algebraic unknowns the Jacobian stays as sparse as the mesh; a damping force of low rank, F
F^T e_t, is written F w with the further unknowns w = F^T e_t for the same reason.

Scaling.  What IDAS sees are (q - q_straight)/L, v/(L W), a/(L W^2) and w, with the beam's length L and the bending
frequency W of a single element.  One tolerance, relative to L, then serves all unknowns, and the noise that Newton's
method leaves in the positions is not divided by the step into a velocity error that fails every other step.
Accelerations and w stay out of the error test.

Order.  Undamped high modes lie on the imaginary axis, where backward differentiation formulas of order 3 to 5 are
unstable; the order is 2.

Stretches.  Each smooth piece of the base motion is cut into stretches t = start + T s with s from 0 to 1, start and T
being parameters, so that one integrator serves them all; the state is handed on, and progress shown, between them.

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
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray
from tqdm import tqdm

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.equilibrium import Equilibrium, static_equilibrium
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.excitation import BaseMotion, FixedBase, Piece
from ancf_casadi.inputs import positive
from ancf_casadi.model import NODE, Model

Array = NDArray[np.float64]
Start = Literal["equilibrium", "straight", "moving"]

TOLERANCE = 1e-8
STRETCHES = 25  # of a piece of the base motion; a restart costs about a hundred small steps
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


@dataclass(frozen=True)
class Trajectory:
    """A simulated motion, sampled at equal intervals.

    Parameters
    ----------
    model : Model
        The beam.
    time : array (k,)
        Instants, s, from 0.
    coordinates, velocities : array (k, 4 n + 4)
        Nodal coordinates and their rates in the laboratory frame.
    steps : int
        Steps of the integrator.
    wall_seconds : float
        Time it took, s, building the integrator included.
    """

    model: Model
    time: Array
    coordinates: Array
    velocities: Array
    steps: int
    wall_seconds: float

    @property
    def tip(self) -> Array:
        """Position of the tip, (k, 2), m."""
        return self.coordinates[:, -NODE:-2]

    @property
    def base(self) -> Array:
        """Position of the clamp, (k, 2), m."""
        return self.coordinates[:, :2]

    @property
    def relative_coordinates(self) -> Array:
        """Nodal coordinates as seen from the clamp, (k, 4 n + 4)."""
        nodes = self.coordinates.reshape(len(self.time), -1, NODE).copy()
        nodes[:, :, :2] -= self.base[:, None, :]
        return nodes.reshape(self.coordinates.shape)

    def position(self, s: float) -> Array:
        """Return the position of the material point at arc length ``s`` (m), (k, 2), m.

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return np.asarray(self.coordinates @ self.model.interpolation(s).T)

    def velocity(self, s: float) -> Array:
        """Return the velocity of the material point at arc length ``s`` (m), (k, 2), m/s.

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return np.asarray(self.velocities @ self.model.interpolation(s).T)


def simulate(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium = "equilibrium",
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
    start : {"equilibrium", "straight", "moving"} or Equilibrium
        ``equilibrium``: at rest under gravity, also where the base starts with a speed, which is a blow to the clamp.
        ``moving``: the same shape, with the speed of the base.  ``straight``: at rest as manufactured, gravity then
        acts.  An ``Equilibrium``: released from there at rest.
    tolerance : float
        Local error of the positions relative to the length of the beam.
    options : mapping, optional
        Options of CasADi's IDAS interface; they override the defaults.
    progress : bool
        Whether to show a progress bar in simulated seconds.

    Raises
    ------
    InputError
        If a number is not positive, the start is unknown or belongs to another model, or IDAS refuses an option.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the integrator fails.
    """
    began = time.perf_counter()
    duration, sample_rate = positive(duration, "duration"), positive(sample_rate, "sample_rate")
    tolerance = positive(tolerance, "tolerance")
    law = RayleighDamping() if damping is None else damping
    pieces = (FixedBase() if base is None else base).pieces()
    settings = {**DEFAULTS, "abstol": tolerance, **(options or {})}

    samples = math.floor(duration * sample_rate + CLOSE) + 1
    instants = np.arange(samples) / sample_rate
    coordinates, velocities = np.empty((samples, model.size)), np.empty((samples, model.size))
    state, steps, begin = _initial_state(model, pieces[0], start), 0, 0.0
    coordinates[0, model.free], velocities[0, model.free] = np.split(state, 2)
    with tqdm(total=instants[-1], disable=not progress, bar_format=BAR) as bar:
        for piece in pieces:
            end = min(piece.end, instants[-1])
            inside = slice(math.ceil(begin * sample_rate - CLOSE), math.floor(end * sample_rate + CLOSE) + 1)
            clamp = _clamp(model, piece)(instants[None, inside]).full().T
            coordinates[inside, :NODE], velocities[inside, :NODE] = clamp[:, :NODE], clamp[:, NODE : 2 * NODE]
            size = max(1, math.ceil((end - begin) * sample_rate / STRETCHES))
            integrator = _integrator(model, law, piece, settings)
            for stretch in _stretches(begin, end, sample_rate, size):
                path, used = integrator(state, stretch)
                state, steps = path[-1], steps + used
                kept = path[: len(coordinates[stretch.samples])]
                coordinates[stretch.samples, model.free], velocities[stretch.samples, model.free] = np.hsplit(kept, 2)
                bar.update(min(stretch.length, instants[-1] - bar.n))
            if piece.end >= instants[-1]:
                break
            begin = end
    return Trajectory(model, instants, coordinates, velocities, steps, time.perf_counter() - began)


@dataclass(frozen=True)
class _Stretch:
    """A stretch of time between two restarts.

    ``points`` instants at equal intervals end it; the last hands on the state, and those that are samples of the result
    fill its rows ``samples``.
    """

    start: float
    length: float
    points: int
    samples: slice


def _stretches(begin: float, end: float, rate: float, size: int) -> Iterator[_Stretch]:
    """Cut the time from begin to end at samples, ``size`` samples a stretch; the ends may lie between two samples."""
    first, last = math.ceil(begin * rate - CLOSE), math.floor(end * rate + CLOSE)
    if first > last:
        yield _Stretch(begin, end - begin, 1, slice(0, 0))
        return
    if first / rate - begin > CLOSE / rate:
        yield _Stretch(begin, first / rate - begin, 1, slice(first, first + 1))
    for k in range(first, last, size):
        points = min(size, last - k)
        yield _Stretch(k / rate, points / rate, points, slice(k + 1, k + 1 + points))
    if end - last / rate > CLOSE / rate:
        yield _Stretch(last / rate, end - last / rate, 1, slice(0, 0))


def _clamp(model: Model, piece: Piece) -> cs.Function:
    """Position and slope of the clamped node, their rates and their accelerations at time t, (12,)."""
    t = cs.SX.sym("t")
    u = piece.displacement(t)
    rate = cs.jacobian(u, t)
    fixed = cs.SX(2, 1)
    node = [u, cs.SX(cs.DM(model.beam.axis)), rate, fixed, cs.jacobian(rate, t), fixed]
    return cs.Function("clamp", [t], [cs.vertcat(*node)])


def _initial_state(model: Model, piece: Piece, start: Start | Equilibrium) -> Array:
    """Free coordinates and rates at time 0."""
    if isinstance(start, Equilibrium):
        if start.model != model:
            raise InputError("the equilibrium belongs to another model", "start")
        coordinates = start.coordinates
    elif start not in get_args(Start):
        raise InputError(f"must be one of {', '.join(get_args(Start))}, or an Equilibrium, got {start!r}", "start")
    else:
        coordinates = model.straight if start == "straight" else static_equilibrium(model).coordinates
    speed = _clamp(model, piece)(0.0).full().ravel()[NODE : 2 * NODE]
    velocities = np.tile(speed if start == "moving" else np.zeros(NODE), model.beam.elements)
    return np.concatenate([coordinates[model.free], velocities])


def _bending_rate(model: Model) -> float:
    """Return the highest bending frequency of a single pinned element, pi^2 (E I/mu)^1/2/l^2, rad/s."""
    _, thickness, density, elastic_modulus = model.properties
    stiffness = np.sqrt(elastic_modulus / density) * thickness / math.sqrt(12)
    return float(math.pi**2 * stiffness.max() / model.beam.element_length**2)


def _integrator(
    model: Model, law: DampingLaw, piece: Piece, settings: Mapping[str, Any]
) -> Callable[[Array, _Stretch], tuple[Array, int]]:
    """Return what integrates a stretch: (state, stretch) -> states at its points, and the number of steps."""
    length, rate = model.beam.length, _bending_rate(model)
    free = model.size - NODE
    factor = law.factor(model)

    s, start, span = cs.MX.sym("s"), cs.MX.sym("start"), cs.MX.sym("span")
    x, z = cs.MX.sym("x", 2 * free), cs.MX.sym("z", free + factor.shape[1])
    q, v = model.straight[model.free] + length * x[:free], length * rate * x[free:]
    a, w = length * rate**2 * z[:free], z[free:]
    clamp = _clamp(model, piece)(start + span * s)
    node, rates, accelerations = cs.vertsplit(clamp, NODE)
    e, e_t, e_tt = cs.vertcat(node, q), cs.vertcat(rates, v), cs.vertcat(accelerations, a)
    p = model.properties
    damping = law.local_force(model, e, e_t) + cs.DM(factor) @ w
    balance = model.mass(p) @ e_tt + damping + model.elastic_force(e, p) - model.gravity_force(p, model.beam.gravity)
    ode = span * cs.vertcat(v / length, a / (length * rate))
    alg = cs.vertcat(balance[model.free], cs.DM(factor.T) @ e_t - w)

    equations = cs.Function("equations", [s, x, z, cs.vertcat(start, span)], [ode, alg])
    symbols = [cs.SX.sym(name, equations.size1_in(i)) for i, name in enumerate("txzp")]
    ode_sx, alg_sx = equations(*symbols)
    dae = dict(zip("txzp", symbols, strict=True)) | {"ode": ode_sx, "alg": alg_sx}
    linear = cs.Function("linear", symbols, [alg_sx, cs.jacobian(alg_sx, symbols[2])])  # alg is linear in z

    @functools.cache
    def solver(points: int) -> cs.Function:
        grid = np.linspace(0.0, 1.0, points + 1)[1:]
        try:
            with _quiet():
                return cs.integrator("integrator", "idas", dae, 0.0, grid, dict(settings))
        except RuntimeError as error:
            raise InputError(_refusal(str(error)), "options") from None

    def integrate(state: Array, stretch: _Stretch) -> tuple[Array, int]:
        x0 = np.concatenate([(state[:free] - model.straight[model.free]) / length, state[free:] / (length * rate)])
        p0 = [stretch.start, stretch.length]
        constant, slope = linear(0.0, x0, 0.0, p0)
        z0 = -scipy.sparse.linalg.splu(slope.sparse()).solve(constant.full().ravel())
        run = solver(stretch.points)
        try:
            with _quiet():
                path = run(x0=x0, z0=z0, p=p0)["xf"].full().T
        except RuntimeError as error:
            raise SimulationError(_advice(str(error), stretch), stretch.start) from None
        path[:, :free] = model.straight[model.free] + length * path[:, :free]
        path[:, free:] *= length * rate
        return path, int(run.stats()["nsteps"])

    return integrate


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep what CasADi prints off the terminal."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _refusal(message: str) -> str:
    """Say in a line which option CasADi's IDAS interface refuses."""
    said = re.search(
        r"Unknown option: .+|Illegal type for .+|Cannot load shared library \S+'|IDA\w+ returned .\w+.", message
    )
    return f"CasADi's IDAS interface refuses them: {said[0] if said else message.strip().splitlines()[0]}"


def _advice(message: str, stretch: _Stretch) -> str:
    """Say in a line what went wrong in a stretch, and what to try."""
    between = f"between {stretch.start:g} and {stretch.start + stretch.length:g} s"
    cause = "took too many steps" if "TOO_MUCH_WORK" in message else "could not go on"
    return (
        f"the integrator {cause} {between}: try start='moving' if the base starts with a speed, a larger tolerance, "
        "or more elements where the beam bends sharply"
    )
