"""A computed motion: its steps, and the other data from which its derivatives are computed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import ExcitationPiece
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.dynamics.radau.tableau import RADAU
from ancf_casadi.exceptions import SimulationError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.interrupts import interrupted


@dataclass(frozen=True, eq=False)
class Excitation:
    """The excitation on a smooth piece, and its Jacobian with respect to b.

    Parameters
    ----------
    model : Model
        The beam.
    piece : ExcitationPiece
        The piece.
    b : array (m,)
        The parameters of the base motion.
    """

    model: Model
    piece: ExcitationPiece
    b: Array

    @cached_property
    def function(self) -> cs.Function:
        """(t) -> the excitation, (15,)."""
        t, b, values = self._symbols
        return cs.Function("excitation", [t], [cs.Function("values", [t, b], [values])(t, self.b)])

    def at(self, time: float) -> Array:
        """Return the excitation, (15,), at a time."""
        return np.asarray(self.function(time).full().ravel())

    def jacobian(self, time: float) -> Array:
        """Return the derivatives of the excitation with respect to b, (15, m), at a time."""
        return np.asarray(self._jacobian(time, self.b).full())

    def derivatives(self, time: float) -> Array:
        """Return the clamped node and the time derivative of its acceleration, (16,), at a time."""
        return np.asarray(self._derivatives(time, self.b).full().ravel())

    @cached_property
    def _jacobian(self) -> cs.Function:
        t, b, values = self._symbols
        return cs.Function("excitation_jacobian", [t, b], [cs.jacobian(values, b)])

    @cached_property
    def _derivatives(self) -> cs.Function:
        t, b, values = self._symbols
        jerk = cs.densify(cs.jacobian(values[2 * NODE : 3 * NODE], t))
        return cs.Function("clamp_derivatives", [t, b], [cs.vertcat(values[: 3 * NODE], jerk)])

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        t, b = cs.MX.sym("t"), cs.MX.sym("b", self.b.size)
        return t, b, self.piece.at(self.model, t, b)


@dataclass(frozen=True, eq=False)
class Passage:
    """A smooth piece of a computed motion.

    Parameters
    ----------
    excitation : Excitation
        Base motion and tip load.
    begin : float
        First instant, s.
    acceleration_jacobian : array (N, ...)
        Derivatives of the first accelerations with respect to q, v, the excitation and the parameters of the equation
        of motion.
    steps : list of RadauStep
        The steps.
    samples : list of array
        Indices of the samples in each step.
    """

    excitation: Excitation
    begin: float
    acceleration_jacobian: Array
    steps: list[RadauStep]
    samples: list[Index]


@dataclass(frozen=True, eq=False)
class MotionRun:
    """A computed motion.

    Parameters
    ----------
    parameters : array
        The parameters of the equation of motion.
    times : array (k,)
        The samples, s, on the clock of the base motion.
    clocks : array (k,) or (0,)
        Index of the unknown shift of each sample; empty if there are none.
    rest : array
        Indices of the samples before the motion, at rest.
    start_jacobian : array (2 N, ...)
        Derivatives of the first q and v with respect to theta, b, P, m and s.
    passages : list of Passage
        Its smooth pieces.
    samples : array (k, orders, 4 n + 4)
        The nodal coordinates and their time derivatives at the samples.
    rates : array, the same shape or (0,)
        Time derivatives of ``samples``, if there are shifts.
    """

    parameters: Array
    times: Array
    clocks: Index
    rest: Index
    start_jacobian: Array
    passages: list[Passage]
    samples: Array
    rates: Array

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(len(passage.steps) for passage in self.passages)


def end_of(step: RadauStep) -> tuple[Array, Array, Array]:
    """Return q, v and a at the end of a step."""
    velocities = RADAU.inverse @ step.increments / step.length
    return step.q + step.increments[-1], velocities[-1], RADAU.inverse[-1] @ (velocities - step.v) / step.length


def stop_if_interrupted() -> None:
    """Raise a SimulationError if ``noted_interrupts`` has noted a Ctrl-C."""
    if interrupted():
        raise SimulationError("the motion was interrupted")
