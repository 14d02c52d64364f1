"""Prescribed motion of the clamp.

A base motion is a sequence of smooth pieces; in each, displacement u(t) and rotation phi(t) of the clamp, counted from
where the beam was at rest, move the clamped node to

    r_0 = u,    tau_0 = R(phi) axis,

and symbolic differentiation gives its velocity and acceleration.  The integrator restarts where a piece ends, so that
no step straddles a kink.  Motions are symbolic in their parameters too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, final, get_args

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import array, choice, number, physical, positive, positive_or_infinite, vector

StopAt = Literal["rest", "once"]

SPLINE_DEGREE = 5  # the acceleration of the clamp is then twice continuously differentiable


@dataclass(frozen=True)
class Piece:
    """A smooth part of a base motion.

    Parameters
    ----------
    end : float
        Time at which it ends, s; infinite for the last.
    motion : callable
        From the time (s) and the parameters of the motion to displacement (m, two components) and rotation (rad).
    """

    end: float
    motion: Callable[[cs.MX, cs.MX], cs.MX]


class BaseMotion(ABC):
    """What every base motion can do."""

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Name and value of each parameter."""
        return ()

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the smooth parts in order, from time 0; the last has no end."""

    @final
    def pieces_after(self, time: float) -> list[Piece]:
        """Return the smooth parts that end after a time (s)."""
        return [piece for piece in self.pieces() if piece.end > time]


@final
@dataclass(frozen=True)
class FixedBase(BaseMotion):
    """A clamp that does not move.

    Parameters
    ----------
    displacement : (float, float)
        Where it is held, m from the origin.
    rotation : float
        Angle by which it is turned from the axis of the beam, counterclockwise, rad.

    Raises
    ------
    InputError
        If a value is not a finite number.
    """

    displacement: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        object.__setattr__(self, "displacement", vector(self.displacement, "displacement"))
        object.__setattr__(self, "rotation", number(self.rotation, "rotation"))

    def pieces(self) -> tuple[Piece, ...]:
        """Return one piece at rest."""
        place = cs.DM([*self.displacement, self.rotation])
        return (Piece(math.inf, lambda t, parameters: cs.MX(place)),)


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
        physical(self.frequency, "frequency")
        if positive_or_infinite(self.stop, "stop") != math.inf:
            physical(self.stop, "stop")
        choice(self.stop_at, get_args(StopAt), "stop_at")
        object.__setattr__(self, "direction", _unit(self.direction))

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """The amplitude, m."""
        return (("amplitude", self.amplitude),)

    @property
    def stop_time(self) -> float:
        """Time at which the base does stop, s."""
        if self.stop_at == "once" or self.stop == math.inf:
            return self.stop
        half_periods = math.ceil(2 * self.frequency * self.stop - 0.5 - 1e-9)
        return (half_periods + 0.5) / (2 * self.frequency)

    def pieces(self) -> tuple[Piece, ...]:
        """Return the harmonic motion and, if it stops, the hold."""
        omega = 2 * math.pi * self.frequency
        return _until(self.stop_time, _along(self.direction, lambda t, amplitude: amplitude * cs.sin(omega * t)))


@final
@dataclass(frozen=True)
class SweepBase(BaseMotion):
    """u = amplitude sin(phase(t)), the frequency growing or falling evenly from one value to another, then a stop.

    Parameters
    ----------
    amplitude : float
        Amplitude, m, above 0.
    frequencies : (float, float)
        Frequency at time 0 and at the stop, Hz, above 0.
    stop : float
        Time asked for the stop, s, above 0.
    direction : (float, float)
        Direction of the motion, any length above 0; kept as a unit vector.
    stop_at : {"rest", "once"}
        ``rest``: sweep on to the first instant of zero base velocity after ``stop``, and hold.  ``once``: stop at
        ``stop`` itself, where the base velocity may jump: a blow to the clamp.

    Raises
    ------
    InputError
        If a value is not a number in its range.
    """

    amplitude: float
    frequencies: tuple[float, float]
    stop: float
    direction: tuple[float, float] = (1.0, 0.0)
    stop_at: StopAt = "rest"

    def __post_init__(self) -> None:
        """Validate, and normalise the direction."""
        positive(self.amplitude, "amplitude")
        for frequency in vector(self.frequencies, "frequencies"):
            physical(frequency, "frequencies")
        physical(self.stop, "stop")
        choice(self.stop_at, get_args(StopAt), "stop_at")
        object.__setattr__(self, "direction", _unit(self.direction))

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """The amplitude, m."""
        return (("amplitude", self.amplitude),)

    @property
    def stop_time(self) -> float:
        """Time at which the base does stop, s."""
        if self.stop_at == "once":
            return self.stop
        first, rate = self.frequencies[0], self._rate
        cycles = (math.ceil((sum(self.frequencies) * self.stop) - 0.5 - 1e-9) + 0.5) / 2
        square = first**2 + 2 * rate * cycles
        return 2 * cycles / (first + math.sqrt(square)) if square > 0.0 else -first / rate  # where the frequency is 0

    @property
    def _rate(self) -> float:
        """Rate of the frequency, Hz/s."""
        return (self.frequencies[1] - self.frequencies[0]) / self.stop

    def pieces(self) -> tuple[Piece, ...]:
        """Return the sweep and the hold."""
        first, rate = self.frequencies[0], self._rate

        def sweep(t: cs.MX, amplitude: cs.MX) -> cs.MX:
            return amplitude * cs.sin(2 * math.pi * (first * t + rate * t**2 / 2))

        return _until(self.stop_time, _along(self.direction, sweep))


@final
@dataclass(frozen=True, eq=False)
class SampledBase(BaseMotion):
    """A measured motion of the clamp, interpolated by splines of degree 5, then held.

    Parameters
    ----------
    time : array_like (k,)
        Instants, s, increasing; the motion begins with the first.
    displacement : array_like (k, 2)
        Displacement, m, counted from the first sample.
    rotation : array_like (k,), optional
        Rotation, rad, counterclockwise, counted from the first sample.

    Raises
    ------
    InputError
        If there are fewer than 6 samples, the shapes differ, a value is not finite or the times do not increase.
    """

    time: ArrayLike
    displacement: ArrayLike
    rotation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Validate, and keep arrays counted from the first sample."""
        time = array(self.time, "time")
        if time.ndim != 1 or time.size <= SPLINE_DEGREE:
            raise InputError(f"needs at least {SPLINE_DEGREE + 1} instants", "time")
        if (np.diff(time) <= 0.0).any():
            raise InputError("must increase", "time")
        physical(time[-1] - time[0], "time")
        displacement = array(self.displacement, "displacement")
        rotation = np.zeros(time.size) if self.rotation is None else array(self.rotation, "rotation")
        if displacement.shape != (time.size, 2):
            raise InputError(f"must have the shape ({time.size}, 2), got {displacement.shape}", "displacement")
        if rotation.shape != time.shape:
            raise InputError(f"must have the shape ({time.size},), got {rotation.shape}", "rotation")
        for name, values in (("time", time), ("displacement", displacement), ("rotation", rotation)):
            object.__setattr__(self, name, values - values[0])

    def pieces(self) -> tuple[Piece, ...]:
        """Return the measured motion and the hold."""
        from scipy.interpolate import make_interp_spline  # slow to import, and needed here alone

        time = np.asarray(self.time, dtype=float)
        motion = np.column_stack([np.asarray(self.displacement), np.asarray(self.rotation)])
        spline = make_interp_spline(time, motion, k=SPLINE_DEGREE)
        curve = cs.Function.bspline("curve", [spline.t.tolist()], spline.c.ravel().tolist(), [SPLINE_DEGREE], 3)
        return _until(float(time[-1]), lambda t, parameters: curve(t))


def _until(stop: float, motion: Callable[[cs.MX, cs.MX], cs.MX]) -> tuple[Piece, ...]:
    """Return a motion and, if it ends, the hold of where it has come to."""
    if stop == math.inf:
        return (Piece(math.inf, motion),)
    return Piece(stop, motion), Piece(math.inf, lambda t, parameters: motion(cs.MX(stop), parameters))


def _along(direction: tuple[float, float], size: Callable[[cs.MX, cs.MX], cs.MX]) -> Callable[[cs.MX, cs.MX], cs.MX]:
    return lambda t, parameters: size(t, parameters) * cs.DM([*direction, 0.0])


def _unit(direction: tuple[float, float]) -> tuple[float, float]:
    x, y = vector(direction, "direction")
    if math.hypot(x, y) == 0.0:
        raise InputError("must not be the zero vector", "direction")
    return x / math.hypot(x, y), y / math.hypot(x, y)
