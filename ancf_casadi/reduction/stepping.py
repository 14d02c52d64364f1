"""Motion of the reduced model in time, by Lawson's method with fixed steps (``reduced``).

The samples of the result and the ends of the pieces of the base motion divide the time into intervals.  Each interval
has equal steps, at least ``steps_per_period`` of them in the period of the highest mode.

Projection.  A state (e, e_t) of the full beam becomes a state (q, v) of the reduced model: in the norm of the mass
matrix, q gives the reduced shape e(q) nearest to e, and v gives the velocity nearest to e_t.  The projected
velocity is also the state after an impact, where the velocity of the clamp jumps: the impulse of the clamp does no work
on the motions that the clamp allows.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.excitation import SAME_TIME
from ancf_casadi.dynamics.motion_setup import set_up
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.trajectory import Motion
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.mechanics.supports import can_slide
from ancf_casadi.reduction.forces import BASE_SIZE
from ancf_casadi.reduction.reduced import BASE_INSTANTS, ReducedModel
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.compilation import compile_function, expand_function
from ancf_casadi.support.inputs import check_instance, positive, whole
from ancf_casadi.support.interrupts import delayed_interrupts, lasting_interrupts
from ancf_casadi.support.tables import plural
from ancf_casadi.vibration.equilibrium import Equilibrium

STEPS_PER_PERIOD = 20
STEPS_PER_CALL = 1000  # steps per call of a CasADi Function, which nothing interrupts
MAX_REDUCED_STEPS = 100_000_000


@dataclass(frozen=True, eq=False)
class ReducedTrajectory(Motion):
    """A motion of the reduced model, sampled at equal intervals.

    Parameters
    ----------
    reduced : ReducedModel
        The reduced model.
    time : array (k,)
        Instants, s, from 0, or from the time of the ``State`` at the start.
    q : array (k, m)
        Modal coordinates, m kg^1/2.
    v : array (k, m)
        Velocities of the modal coordinates, m kg^1/2/s.
    base : array (k, 9)
        Motion of the clamp.
    steps : int
        Number of time steps.
    wall_seconds : float
        Computing time including compilation, s.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, reduce_model, simulate_reduced
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2)
    >>> base = HarmonicBase(amplitude=5e-3, frequency=2.0)
    >>> run = simulate_reduced(reduced, base=base, duration=0.5, sample_rate=100.0)
    >>> run.q.shape, run.tip.shape, run.energy.shape
    ((51, 2), (51, 2), (51, 3))
    """

    reduced: ReducedModel
    time: Array
    q: Array
    v: Array
    base: Array
    steps: int
    wall_seconds: float

    @cached_property
    def model(self) -> Model:  # type: ignore[override]
        """The model of the beam."""
        return self.reduced.model

    @property
    def _methods(self) -> tuple[str, ...]:
        """The modes of the reduced model."""
        return (plural(self.reduced.count, "mode"),)

    @cached_property
    def coordinates(self) -> Array:  # type: ignore[override]
        """Nodal coordinates of the full model, (k, 4 n + 4)."""
        return np.asarray(self.reduced.coordinates(self.q.T, self.v.T, self.base.T)[0].full().T)

    @cached_property
    def velocities(self) -> Array:
        """Nodal velocities of the full model, (k, 4 n + 4)."""
        return np.asarray(self.reduced.coordinates(self.q.T, self.v.T, self.base.T)[1].full().T)

    @property
    def tip(self) -> Array:
        """Position of the tip, (k, 2), m."""
        return np.asarray(self.reduced.tip(self.q.T, self.base.T).full().T)

    @cached_property
    def energy(self) -> Array:
        """Kinetic energy, strain energy and potential of gravity, (k, 3), J."""
        values = np.tile(self.reduced.values[:, None], len(self.time))
        return np.vstack([energy.full() for energy in self.reduced.energies(self.q.T, self.v.T, self.base.T, values)]).T

    def state(self, index: int) -> State:
        """Return the state of the full model at a sample, as a start for a simulation; see ``Trajectory.state``."""
        index = whole(index, "index", -len(self.time), len(self.time) - 1)
        return _full_state(self.reduced, self.q[index], self.v[index], self.base[index], float(self.time[index]))

    def to_dict(self) -> dict[str, Any]:
        """Return positions of clamp and tip, and modal coordinates over time as plain data."""
        return {"kind": "reduced motion", **super().to_dict(), "modal_coordinates": self.q.tolist()}


@lasting_interrupts()
def simulate_reduced(
    reduced: ReducedModel,
    *,
    duration: float,
    base: BaseMotion | None = None,
    sample_rate: float = 1000.0,
    start: Start | Equilibrium | State = "equilibrium",
    steps_per_period: float = STEPS_PER_PERIOD,
) -> ReducedTrajectory:
    """Simulate a motion of the reduced model.

    Parameters
    ----------
    reduced : ReducedModel
        The reduced model.
    duration, base, sample_rate, start
        As in ``simulate``; the state of the full model at the start is projected on the modes.
    steps_per_period : float
        Smallest number of steps per period of the highest mode.

    Raises
    ------
    InputError
        If a number is not positive or leads to too many steps, the base motion is not finite or turns a beam on rollers
        or guides, or the start is unknown,
        belongs to another model or cannot be projected.
    EquilibriumError
        If there is no equilibrium to start from.
    SimulationError
        If the motion does not stay finite because the steps are too long.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, reduce_model, simulate_reduced
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2)
    >>> base = HarmonicBase(amplitude=5e-3, frequency=2.0)
    >>> run = simulate_reduced(reduced, base=base, duration=0.5)
    >>> print(f"the tip swings {1e3 * abs(run.tip[:, 0]).max():.0f} mm")
    the tip swings 26 mm
    """
    began = time.perf_counter()
    check_instance(reduced, "reduced", ReducedModel)
    setup = set_up(
        reduced.model,
        duration=duration,
        damping=reduced.law,
        base=base,
        load=None,
        sample_rate=sample_rate,
        start=start,
    )
    state, instants, length = setup.start, setup.times, float(np.ptp(setup.times))
    per_second = float(reduced.modes.frequencies[-1]) * positive(steps_per_period, "steps_per_period")
    if length * per_second > MAX_REDUCED_STEPS:
        raise InputError(
            f"makes {length * per_second:.1e} steps, more than {MAX_REDUCED_STEPS:.0e}", "steps_per_period"
        )
    advance = _stepper(reduced, length)
    keeps_direction = can_slide(reduced.model.beam.supports)

    samples: list[Array] = []  # of (q, v)
    clamp_motions: list[Array] = []  # motion of the clamp at these samples
    steps, sampled_count = 0, 0
    for piece in setup.pieces:
        clamp = piece.clamp
        count = int(np.searchsorted(instants, piece.end, side="right"))
        x = project(reduced, state, clamp(piece.begin).full().ravel())
        for starts, h, sampled_states in _batches(
            piece.begin, instants[sampled_count:count], piece.end, 1 / per_second
        ):
            with delayed_interrupts():
                stage_times = starts[:, None] + h[:, None] * np.linspace(0.0, 1.0, BASE_INSTANTS)
                stages = clamp(stage_times.reshape(1, -1)).full()
                if not np.isfinite(stages).all():
                    message = f"its position, velocity or acceleration is not finite before {piece.end:g} s"
                    raise InputError(message, "base")
                if keeps_direction and stages[[2, 5]].any():
                    message = "turns, while a roller or guide keeps its direction; use the full model"
                    raise InputError(message, "base")
                path = advance(x, stages, h)
            is_infinite = ~np.isfinite(path[1:]).all(axis=1)
            if is_infinite.any():
                message = "the motion does not stay finite because the steps are too long; increase steps_per_period"
                raise SimulationError(message, float(starts[is_infinite][0]))
            samples.append(path[sampled_states])
            x, steps = path[-1], steps + len(h)
        samples_of_clamp = clamp(instants[None, sampled_count:count]).full().T
        clamp_motions.append(samples_of_clamp[: count - sampled_count])  # CasADi returns one for no instant
        q, v = np.split(x, 2)
        state = _full_state(reduced, q, v, clamp(piece.end).full().ravel(), piece.end)
        sampled_count = count
    q, v = np.split(np.vstack(samples), 2, axis=1)
    return ReducedTrajectory(reduced, instants, q, v, np.vstack(clamp_motions), steps, time.perf_counter() - began)


def project(reduced: ReducedModel, state: State, base: Array) -> Array:
    """Return the modal coordinates and velocities (2 m,) nearest to a state whose clamp moves as ``base`` (9,)."""
    m, mass = reduced.count, reduced.model.mass(reduced.model.properties).sparse()
    shape, shape_jacobian = reduced.coordinates, reduced.coordinates.jacobian()
    q, size = np.zeros(m), float(np.sqrt(mass.diagonal().sum())) * reduced.model.beam.length
    for _ in range(30):
        e, e_t = shape(q, np.zeros(m), base)
        J = shape_jacobian(q, np.zeros(m), base, e, e_t)[0].full()
        change = np.linalg.solve(J.T @ mass @ J, J.T @ (mass @ (state.coordinates - e.full().ravel())))
        q += change
        # largest last change of q, relative to the root of the mass times the length
        if not np.abs(change).max() > 1e-12 * size:
            momenta = J.T @ (mass @ (state.velocities - e_t.full().ravel()))
            return np.concatenate([q, np.linalg.solve(J.T @ mass @ J, momenta)])
    raise InputError("is too far from any shape of the modes kept; keep more modes, or bend the beam less", "start")


def _full_state(reduced: ReducedModel, q: Array, v: Array, base: Array, time: float) -> State:
    """Return the state of the full model at a time (s)."""
    e, e_t = reduced.coordinates(q, v, base)
    return State(e.full().ravel(), e_t.full().ravel(), time)


def _batches(begin: float, instants: Array, end: float, max_step: float) -> Iterator[tuple[Array, Array, Index]]:
    """Yield the steps from ``begin`` to ``end`` in batches of at most ``STEPS_PER_CALL``; some end at each instant.

    A batch of k steps has their starts and lengths (k,), s, and the indices, among its k + 1 states, of those at the
    instants that no earlier batch has reached.
    """
    breakpoints = np.unique(np.concatenate([[begin], instants, [end]]))
    counts = np.maximum(np.ceil(np.diff(breakpoints) / max_step - SAME_TIME), 1).astype(int)
    lengths, steps_before = np.diff(breakpoints) / counts, np.concatenate([[0], np.cumsum(counts)])
    sampled_states, sampled_count = steps_before[np.searchsorted(breakpoints, instants)], 0
    for first in range(0, steps_before[-1], STEPS_PER_CALL):
        steps = np.arange(first, min(first + STEPS_PER_CALL, steps_before[-1]))
        interval = np.searchsorted(steps_before, steps, side="right") - 1  # of two breakpoints, for each step
        count = int(np.searchsorted(sampled_states, steps[-1] + 1, side="right"))
        starts = breakpoints[interval] + (steps - steps_before[interval]) * lengths[interval]
        yield starts, lengths[interval], sampled_states[sampled_count:count] - first
        sampled_count = count


def _stepper(reduced: ReducedModel, duration: float) -> Callable[[Array, Array, Array], Array]:
    """Return the function that makes many steps, compiled if the motion is long and the model small.

    It takes the state (2 m,), the base motion at the stages (9, 3 k) and the lengths of the steps (k,), and returns the
    states before and after each step, (k + 1, 2 m).  Nothing interrupts it.
    """
    m, names = reduced.count, ("q", "v", "base", "p", "h")
    symbols = [cs.MX.sym(name, *reduced.step.size_in(name)) for name in names]
    fixed = {"is_diff_in": [False] * len(names), "is_diff_out": [False, False]}
    step = cs.Function("reduced_advance", symbols, [*reduced.step(*symbols)], fixed)
    # a run of a shorter time (s) would end before the compiler does, which takes minutes for more operations
    worth_compiling = duration >= 0.25 and reduced.rhs.n_instructions() <= 20_000
    step = compile_function(step) if worth_compiling else expand_function(step)
    x, base, h = cs.MX.sym("x", 2 * m), cs.MX.sym("base", BASE_SIZE, BASE_INSTANTS), cs.MX.sym("h")
    single_step = cs.Function("one", [x, base, h], [cs.vertcat(*step(x[:m], x[m:], base, reduced.values, h))])

    @functools.cache
    def many_steps(steps: int) -> cs.Function:
        return single_step.mapaccum("many", steps)

    def advance(x: Array, base: Array, h: Array) -> Array:
        return np.vstack([x, many_steps(len(h))(x, base, h[None]).full().T])

    return advance
