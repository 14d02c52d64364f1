"""Motion of the reduced model in time, by its own steps.

Steps are equal between one sample, or end of a piece of the base motion, and the next, and so small that the period of
the highest mode has ``steps_a_period`` of them at least.

A state of the full beam is projected: the modal coordinates make the reduced shape e(q) that is nearest to it in the
norm of the mass matrix, and their rates the nearest velocities.  The second is also what an impulse leaves where the
speed of the base jumps: the impulsive forces of the clamp do no work on the motions it allows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import NoneType

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.dynamics.base_motion import BaseMotion, Piece
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.segments import CLOSE
from ancf_casadi.dynamics.start import Start, base_of, initial_state, sample_times
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.reduction.projection import BASE
from ancf_casadi.reduction.reduced import STAGES, ReducedModel
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import compiled, interpreted
from ancf_casadi.support.inputs import check_instance, physical, positive, whole
from ancf_casadi.vibration.equilibrium import Equilibrium

STEPS_A_PERIOD = 20
CHUNK = 1000  # steps in one call
COMPILED_FROM = 0.25  # s of simulated time
COMPILED_UP_TO = 20_000  # operations in the right-hand side; more take a compiler minutes
MOST_STEPS = 100_000_000
ITERATIONS = 30  # of the projection of a shape
NEAREST = 1e-12  # of the largest modal coordinate: the last change of a projected shape


@dataclass(frozen=True, eq=False)
class ReducedTrajectory:
    """A motion of the reduced model, sampled at equal intervals.

    Parameters
    ----------
    reduced : ReducedModel
        The reduced model.
    time : array (k,)
        Instants, s, from 0.
    q, v : array (k, m)
        Modal coordinates and their rates.
    base : array (k, 9)
        Motion of the clamp.
    steps : int
        Steps of time.
    wall_seconds : float
        Time it took, s, compilation included.
    """

    reduced: ReducedModel
    time: Array
    q: Array
    v: Array
    base: Array
    steps: int
    wall_seconds: float

    @cached_property
    def coordinates(self) -> Array:
        """Nodal coordinates of the full model, (k, 4 n + 4)."""
        return np.asarray(self.reduced.coordinates(self.q.T, self.v.T, self.base.T)[0].full().T)

    @cached_property
    def velocities(self) -> Array:
        """Rates of the nodal coordinates of the full model, (k, 4 n + 4)."""
        return np.asarray(self.reduced.coordinates(self.q.T, self.v.T, self.base.T)[1].full().T)

    @property
    def tip(self) -> Array:
        """Position of the tip, (k, 2), m."""
        return np.asarray(self.reduced.tip(self.q.T, self.base.T).full().T)

    def position(self, s: float) -> Array:
        """Return the position of the material point at arc length ``s`` (m), (k, 2), m.

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return np.asarray(self.coordinates @ self.reduced.model.interpolation(s).T)

    @cached_property
    def energy(self) -> Array:
        """Kinetic energy, strain energy and potential of gravity, (k, 3), J."""
        values = np.tile(self.reduced.values[:, None], len(self.time))
        return np.vstack([part.full() for part in self.reduced.energies(self.q.T, self.v.T, self.base.T, values)]).T

    def state(self, index: int) -> State:
        """Return the state of the full model at a sample, a start for ``simulate``.

        Raises
        ------
        InputError
            If there is no such sample.
        """
        index = whole(index, "index", -len(self.time), len(self.time) - 1)
        e, e_t = self.reduced.coordinates(self.q[index], self.v[index], self.base[index])
        return State(e.full().ravel(), e_t.full().ravel(), float(self.time[index]))


def simulate_reduced(
    reduced: ReducedModel,
    *,
    duration: float,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    steps_a_period: float = STEPS_A_PERIOD,
) -> ReducedTrajectory:
    """Step the reduced model through a motion.

    Parameters
    ----------
    reduced : ReducedModel
        The reduced model.
    duration : float
        Simulated time, s.
    base : BaseMotion, optional
        Motion of the clamp; fixed if not given.
    sample_rate : float
        Samples a second in the result, 1/s.
    start : {"equilibrium", "straight", "impact"}, Equilibrium or State
        As for ``simulate``; projected on the modes.
    steps_a_period : float
        Steps in a period of the highest mode kept, at least.

    Raises
    ------
    InputError
        If a number is not positive or makes too many steps, the base motion is not finite, or the start is none of
        those, belongs to another model or cannot be projected.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the motion does not stay finite: the steps are too long for it.
    """
    began = time.perf_counter()
    check_instance(reduced, "reduced", ReducedModel)
    check_instance(base, "base", BaseMotion, NoneType)
    check_instance(start, "start", str, Equilibrium, State)
    origin = start.time if isinstance(start, State) else 0.0
    instants = sample_times(physical(duration, "duration"), physical(sample_rate, "sample_rate"), origin)
    finish, base = float(instants[-1]), base_of(reduced.model, base, start)
    per_second = float(reduced.modes.frequencies[-1]) * positive(steps_a_period, "steps_a_period")
    if (finish - origin) * per_second > MOST_STEPS:
        raise InputError(
            f"makes {(finish - origin) * per_second:.1e} steps, more than {MOST_STEPS:.0e}", "steps_a_period"
        )
    longest = 1 / per_second
    pieces = base.pieces_after(origin)
    state = initial_state(reduced.model, Equations(reduced.model, reduced.law).clamp(pieces[0], base), start)
    small = reduced.rhs.n_instructions() <= COMPILED_UP_TO
    advance = _advance(reduced, compile_it=small and finish - origin >= COMPILED_FROM)

    found: list[Array] = []
    moved: list[Array] = []
    steps, now = 0, origin
    for piece in pieces:
        curve, end = _curve(piece, base), min(piece.end, finish)
        x = project(reduced, state, curve(now).full().ravel())
        if not found:
            found, moved = [x[None]], [curve(now).full().T]
        inside = instants[(instants > now) & (instants <= end)]
        begins, h, last = _steps(now, inside, end, longest)
        base_at = curve((begins[:, None] + h[:, None] * np.linspace(0.0, 1.0, STAGES)).reshape(1, -1)).full()
        if not np.isfinite(base_at).all():
            raise InputError(f"its position, speed or acceleration is not finite before {end:g} s", "base")
        path = advance(x, base_at, h)
        lost = ~np.isfinite(path).all(axis=1)
        if lost.any():
            message = "the motion does not stay finite: the steps are too long for it; try more steps_a_period"
            raise SimulationError(message, float(begins[lost][0]))
        found.append(path[last])
        moved.append(curve(inside[None]).full().T)
        now, steps = end, steps + len(h)
        state = State(*(part.full().ravel() for part in reduced.coordinates(*np.split(path[-1], 2), curve(end))))
        if end >= finish:
            break
    q, v = np.split(np.vstack(found), 2, axis=1)
    return ReducedTrajectory(reduced, instants, q, v, np.vstack(moved), steps, time.perf_counter() - began)


def project(reduced: ReducedModel, state: State, base: Array) -> Array:
    """Return the modal coordinates and their rates nearest to a state of the full model, (2 m,).

    Parameters
    ----------
    reduced : ReducedModel
        The reduced model.
    state : State
        Of the full model.
    base : array (9,)
        Motion of the clamp.

    Raises
    ------
    InputError
        If no shape near the state is found.
    """
    m, mass = reduced.count, reduced.model.mass(reduced.model.properties).sparse()
    shape, jacobian = reduced.coordinates, reduced.coordinates.jacobian()
    q, size = np.zeros(m), float(np.sqrt(mass.diagonal().sum())) * reduced.model.beam.length
    for _ in range(ITERATIONS):
        e, e_t = shape(q, np.zeros(m), base)
        J = jacobian(q, np.zeros(m), base, e, e_t)[0].full()
        change = np.linalg.solve(J.T @ mass @ J, J.T @ (mass @ (state.coordinates - e.full().ravel())))
        q += change
        if not np.abs(change).max() > NEAREST * size:
            rates = J.T @ (mass @ (state.velocities - e_t.full().ravel()))
            return np.concatenate([q, np.linalg.solve(J.T @ mass @ J, rates)])
    raise InputError("is too far from what the modes kept can make; keep more modes, or bend it less", "start")


def _steps(now: float, inside: Array, end: float, longest: float) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return begin and length of the steps over instants to an end, and which step ends at each instant."""
    marks = np.unique(np.concatenate([[now], inside, [end]]))
    counts = np.maximum(np.ceil(np.diff(marks) / longest - CLOSE), 1).astype(int)
    h = np.repeat(np.diff(marks) / counts, counts)
    return now + np.cumsum(h) - h, h, np.cumsum(counts)[: len(inside)] - 1


def _curve(piece: Piece, base: BaseMotion) -> cs.Function:
    """(t) -> motion of the clamp, (9,)."""
    t = cs.MX.sym("t")
    where = cs.densify(piece.motion(t, cs.MX(cs.DM([own.value for own in base.parameters]))))
    rate = cs.densify(cs.jacobian(where, t))
    return cs.Function("curve", [t], [cs.vertcat(where, rate, cs.densify(cs.jacobian(rate, t)))])


def _advance(reduced: ReducedModel, *, compile_it: bool) -> Callable[[Array, Array, Array], Array]:
    """Return the function from state, base motion (9, 3 k) and steps (k,) to the states after each step, (k, 2 m)."""
    m, names = reduced.count, ("q", "v", "base", "p", "h")
    symbols = [cs.MX.sym(name, *reduced.step.size_in(name)) for name in names]
    fixed = {"is_diff_in": [False] * len(names), "is_diff_out": [False, False]}
    step = cs.Function("reduced_advance", symbols, [*reduced.step(*symbols)], fixed)
    step = compiled(step) if compile_it else interpreted(step)
    x, base, h = cs.MX.sym("x", 2 * m), cs.MX.sym("base", BASE, STAGES), cs.MX.sym("h")
    one = cs.Function("one", [x, base, h], [cs.vertcat(*step(x[:m], x[m:], base, reduced.values, h))])
    many = one.mapaccum("many", CHUNK)

    def advance(x: Array, base: Array, h: Array) -> Array:
        path = [np.empty((0, 2 * m))]
        for begin in range(0, len(h), CHUNK):
            some = h[begin : begin + CHUNK]
            padding = CHUNK - len(some)  # steps of no length, which change nothing
            part = np.pad(base[:, STAGES * begin : STAGES * (begin + CHUNK)], ((0, 0), (0, STAGES * padding)))
            path.append(many(x, part, np.pad(some, (0, padding))[None]).full().T[: len(some)])
            x = path[-1][-1]
        return np.vstack(path)

    return advance
