"""A computed motion: its steps, and samples of its coordinates and their time derivatives at given instants.

Within a step of length h, the coordinates are the quintic polynomial through q, v and a at both ends, and its time
derivatives are their velocities, accelerations and so on,

    d^m q/dt^m = sum_k w_k^(m)(x) y_k,    x = (t - t_0)/h,    y = (q, v, a, q_1, v_1, a_1).

The step is of order 5, so that for a smooth motion the error of the coordinates is of order h^5, that of velocities
h^5, of accelerations h^4, and of the third derivative, which only serves the derivative by a shift, h^3.

The clamped node follows the base motion exactly.  Before the first instant of the motion the beam is at rest in its
first shape.  A sample at t + d, with an unknown shift d of its clock, changes with d by its own time derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.dynamics.excitation import EXCITATION, Excitation
from ancf_casadi.dynamics.radau.collocation import QUINTIC, RADAU, powers
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.dynamics.segments import SAME_TIME
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.interrupts import interrupted


@dataclass(frozen=True, eq=False)
class Passage:
    """A smooth piece of a computed motion."""

    excitation: Excitation
    acceleration_jacobian: Array  # of the first a with respect to q, v, the excitation and the parameters, (N, ...)
    steps: list[RadauStep]
    samples: list[Index]  # indices of the samples in each step

    def stage_jacobians(self) -> Array:
        """Return the derivatives of the excitation by the m parameters of the base at the stages, (steps, 3, 16, m)."""
        times = np.array([step.start + RADAU.nodes * step.length for step in self.steps])
        return self.excitation.jacobians(times.ravel()).reshape(*times.shape, EXCITATION, -1)


@dataclass(frozen=True, eq=False)
class MotionRun:
    """A computed motion, sampled at k instants."""

    parameters: Array  # of the equation of motion
    times: Array  # the samples (k,), s, on the clock of the base motion
    rest: Index  # indices of the samples before the motion, at rest
    start_jacobian: Array  # of the first q and v with respect to theta, b, P, m and s, (2 N, ...)
    passages: list[Passage]  # its smooth pieces
    samples: Array  # nodal coordinates and their time derivatives, (k, orders, 4 n + 4)
    rates: Array  # time derivatives of ``samples``, if there are shifts; else (0,)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(len(passage.steps) for passage in self.passages)


def stop_if_interrupted() -> None:
    """Raise a SimulationError if ``noted_interrupts`` has noted a Ctrl-C."""
    if interrupted():
        raise SimulationError("the motion was interrupted")


def sample_weights(step: RadauStep, times: Array, orders: int) -> Array:
    """Return the weights (s, orders, 6) of q, v and a at both ends of a step in the time derivatives at s instants."""
    h = step.length
    parts = np.array(powers((times - step.start) / h, orders)) / h ** np.arange(orders)[:, None, None]
    return np.asarray(np.moveaxis(parts, 2, 0) @ QUINTIC.T * np.array([1.0, h, h**2, 1.0, h, h**2]))


def clamp_jacobians(excitation: Excitation, times: Array, orders: int) -> Array:
    """Return the derivatives (s, orders, 4, m) of samples of the clamped node by the m parameters of the base."""
    return excitation.jacobians(times)[:, : orders * NODE].reshape(times.size, orders, NODE, -1)


def samples_of(times: Array, steps: list[RadauStep], begin: float, end: float, *, first: bool) -> list[Index]:
    """Return the indices of the samples in each step of a piece; the ``first`` piece has its first instant too."""
    ends = np.array([step.start + step.length for step in steps])
    slack = SAME_TIME * (end - begin)
    inside = (times <= end + slack) & (times > (begin - slack if first else begin + slack))
    owner = np.minimum(np.searchsorted(ends, times - slack), len(steps) - 1)
    return [np.flatnonzero(inside & (owner == k)) for k in range(len(steps))]


def whole_samples(model: Model, q: Array, base: Array) -> Array:
    """Return samples of all coordinates, (k, orders, 4 n + 4, ...), from those of the free ones and of the base."""
    return np.moveaxis(model.whole(np.moveaxis(q, 2, 0), np.moveaxis(base, 2, 0)), 0, 2)


def sampled(model: Model, passages: list[Passage], times: Array, rest: Index, orders: int) -> Array:
    """Return the coordinates and their time derivatives, (k, orders, 4 n + 4), at the samples ``times`` (k,)."""
    result = np.zeros((times.size, orders, model.size))
    first = passages[0]
    result[rest, 0] = model.whole(first.steps[0].q, first.excitation.at(first.excitation.begin)[:NODE])
    for passage in passages:
        for step, samples in zip(passage.steps, passage.samples, strict=True):
            if samples.size:
                velocities = RADAU.inverse @ step.increments / step.length
                accelerations = RADAU.inverse[-1] @ (velocities - step.v) / step.length
                last = step.q + step.increments[-1], velocities[-1], accelerations
                ends = np.array([step.q, step.v, step.a, *last])
                nodes = [passage.excitation.derivatives(time) for time in times[samples].tolist()]
                base = np.reshape(nodes, (samples.size, -1, NODE))[:, :orders]
                result[samples] = whole_samples(model, sample_weights(step, times[samples], orders) @ ends, base)
    return result
