"""Prescribed motion of the clamp.

A base motion is a sequence of smooth pieces u(t), the displacement of the clamp from where the beam was at rest.  The
integrator restarts where one piece ends, so that no step straddles a kink; velocity and acceleration of the clamp
come from u by symbolic differentiation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, final, get_args

import casadi as cs

from ancf_casadi.exceptions import InputError
from ancf_casadi.inputs import number, positive, vector

StopAt = Literal["rest", "once"]


@dataclass(frozen=True)
class Piece:
    """A smooth part of a base motion.

    Parameters
    ----------
    end : float
        Time at which it ends, s; infinite for the last.
    displacement : callable
        u(t), m: from a symbolic time (s) to the two components.
    """

    end: float
    displacement: Callable[[cs.SX], cs.SX]


class BaseMotion(ABC):
    """What every base motion can do."""

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the smooth parts in order, from time 0; the last has no end."""


@final
@dataclass(frozen=True)
class FixedBase(BaseMotion):
    """A clamp that does not move."""

    def pieces(self) -> tuple[Piece, ...]:
        """Return one piece without displacement."""
        return (_held(0.0, 0.0),)


@final
@dataclass(frozen=True)
class HarmonicBase(BaseMotion):
    """u = amplitude sin(2 pi frequency t), then a sudden stop.

    Parameters
    ----------
    amplitude : float
        Amplitude, m, above 0.
    frequency : float
        Frequency, Hz, above 0.
    stop : float, optional
        Time asked for the stop, s, above 0; never if not given.
    direction : (float, float)
        Direction of the motion, any length above 0; kept as a unit vector.
    stop_at : {"rest", "once"}
        ``rest``: stop at the first instant of zero base speed after ``stop``, and hold.  ``once``: stop at ``stop``
        itself, where the base speed may jump: a blow to the clamp.

    Raises
    ------
    InputError
        If a value is not a number in its range.
    """

    amplitude: float
    frequency: float
    stop: float = math.inf
    direction: tuple[float, float] = (1.0, 0.0)
    stop_at: StopAt = "rest"

    def __post_init__(self) -> None:
        """Validate, and normalise the direction."""
        positive(self.amplitude, "amplitude")
        positive(self.frequency, "frequency")
        if self.stop != math.inf:
            positive(self.stop, "stop")
        if self.stop_at not in get_args(StopAt):
            raise InputError(f"must be one of {', '.join(get_args(StopAt))}, got {self.stop_at!r}", "stop_at")
        x, y = vector(self.direction, "direction")
        if math.hypot(x, y) == 0.0:
            raise InputError("must not be the zero vector", "direction")
        object.__setattr__(self, "direction", (x / math.hypot(x, y), y / math.hypot(x, y)))

    @property
    def stop_time(self) -> float:
        """Time at which the base does stop, s."""
        if self.stop_at == "once" or self.stop == math.inf:
            return self.stop
        half_periods = math.ceil(2 * self.frequency * number(self.stop, "stop") - 0.5 - 1e-9)
        return (half_periods + 0.5) / (2 * self.frequency)

    def pieces(self) -> tuple[Piece, ...]:
        """Return the harmonic motion and, if it stops, the hold."""
        omega = 2 * math.pi * self.frequency

        def moving(t: cs.SX) -> cs.SX:
            return self.amplitude * cs.sin(omega * t) * cs.SX(cs.DM(self.direction))

        if self.stop_time == math.inf:
            return (Piece(math.inf, moving),)
        reached = self.amplitude * math.sin(omega * self.stop_time)
        return Piece(self.stop_time, moving), _held(reached * self.direction[0], reached * self.direction[1])


def _held(x: float, y: float) -> Piece:
    return Piece(math.inf, lambda t: cs.SX(cs.DM([x, y])))
