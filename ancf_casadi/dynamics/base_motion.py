"""Prescribed motion of the clamp.

A base motion is a sequence of smooth pieces.  In each piece, the displacement u(t) and the rotation phi(t) of the
clamp from its rest position move the clamped node to

    r_0 = u,    tau_0 = R(phi) axis.

Velocity and acceleration follow by symbolic differentiation, also for symbolic parameters of the motion.  Integrators
restart at the end of each piece, so that no step crosses a kink.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, final, get_args

import casadi as cs
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from ancf_casadi.damping import Parameter
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import (
    array,
    check_fields,
    check_size,
    choice,
    number,
    physical,
    positive,
    positive_or_infinite,
    unit_vector,
    vector,
)
from ancf_casadi.support.tables import Displayed

StopAt = Literal["rest", "once"]

SPLINE_DEGREE = 5  # the acceleration of the clamp is then twice continuously differentiable
AMPLITUDE_ACCURACY = 0.10  # relative to the amplitude; gives the usual bounds of an estimate
STOP_TOLERANCE = 1e-9  # half periods; if ``stop`` is that close behind an instant of rest, the base stops then


@dataclass(frozen=True)
class Piece:
    """A smooth piece of a base motion or of a load."""

    end: float  # end time, s; infinite for the last piece
    # (time, s, parameters of the motion) -> displacement (m) and rotation (rad), or force (N) and moment (N m), (3,)
    at: Callable[[cs.MX, cs.MX], cs.MX]
    largest_step: float = math.inf  # of an integrator that misses no event in the piece, s


class BaseMotion(Displayed, ABC):
    """Base class of the base motions.

    Examples
    --------
    A motion of your own returns its smooth pieces as CasADi expressions of the time; here the clamp turns to 0.5 rad:

    >>> import math
    >>> import casadi as cs
    >>> from ancf_casadi import BaseMotion
    >>> from ancf_casadi.dynamics.base_motion import Piece
    >>> class Turn(BaseMotion):
    ...     def pieces(self):
    ...         return (Piece(math.inf, lambda t, parameters: cs.vertcat(0, 0, 0.5 * cs.tanh(t**3))),)
    >>> len(Turn().pieces())
    1
    """

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the smooth pieces in order, from time 0; the last has no end."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the motion."""
        return ()


@final
@dataclass(frozen=True)
class FixedBase(BaseMotion):
    """A clamp that does not move.

    Parameters
    ----------
    displacement : (float, float)
        Position of the clamp, m.  A run that starts at rest has its clamp at the origin, along the axis of the beam;
        other values belong to a run that starts from a ``State``.
    rotation : float
        Angle from the axis of the beam to its direction at the clamp, counterclockwise, rad.

    Raises
    ------
    InputError
        If a value is not a finite number.

    Examples
    --------
    Hold the clamp where an earlier run has left it:

    >>> from ancf_casadi import Beam, FixedBase, HarmonicBase, Model, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=2.0, stop=0.1)
    >>> driven = simulate(model, base=base, duration=0.2)
    >>> held = simulate(model, base=FixedBase((5e-3, 0.0)), start=driven.state(-1), duration=0.1)
    >>> held.base[-1].round(4)
    array([0.005, 0.   ])
    """

    displacement: Annotated[tuple[float, float], Meta(description="m")] = (0.0, 0.0)
    rotation: Annotated[float, Meta(description="rad")] = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, displacement=vector, rotation=number)

    @classmethod
    def at(cls, node: Array, axis: tuple[float, float]) -> FixedBase:
        """Return the base that holds the clamped node, the first four coordinates, of a beam with this axis."""
        (ax, ay), (x, y, slope_x, slope_y) = axis, node[:4].tolist()
        return cls((x, y), math.atan2(ax * slope_y - ay * slope_x, ax * slope_x + ay * slope_y))

    def pieces(self) -> tuple[Piece, ...]:
        """Return one piece at rest."""
        place = cs.DM([*self.displacement, self.rotation])
        return (Piece(math.inf, lambda t, parameters: cs.MX(place)),)


class _Oscillation(BaseMotion):
    """u = r amplitude sin(2 pi c), c = f t + f_t t^2/2, along a direction, then a stop; r grows from 0 to 1."""

    amplitude: float
    stop: float
    direction: tuple[float, float]
    stop_at: StopAt
    ramp: float

    @property
    @abstractmethod
    def _frequency(self) -> tuple[float, float]:
        """Frequency f at time 0, Hz, and its constant rate of change f_t, Hz/s."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The amplitude, m."""
        lower, upper = ((1.0 + deviation) * self.amplitude for deviation in (-AMPLITUDE_ACCURACY, AMPLITUDE_ACCURACY))
        return (Parameter("amplitude", self.amplitude, "m", "amplitude of the base motion", lower, upper),)

    @property
    def stop_time(self) -> float:
        """Time of the actual stop, s."""
        if self.stop_at == "once" or self.stop == math.inf:
            return self.stop
        f, f_t = self._frequency
        return self._instant((math.ceil((2 * f + f_t * self.stop) * self.stop - 0.5 - STOP_TOLERANCE) + 0.5) / 2)

    def pieces(self) -> tuple[Piece, ...]:
        """Return the growing oscillation, the steady one and, if it stops, the hold."""
        f, f_t = self._frequency

        def phase(t: cs.MX) -> cs.MX:
            return 2 * math.pi * f * t + math.pi * f_t * t**2

        def oscillation(t: cs.MX, amplitude: cs.MX) -> cs.MX:
            return amplitude * cs.sin(phase(t)) * cs.DM([*self.direction, 0.0])

        return _held(ramp_up(Piece(self.stop_time, oscillation), phase, self.ramp, self._instant(self.ramp)))

    def _instant(self, cycles: float) -> float:
        """Return the time at which the oscillation has made a number of cycles, s, or has the frequency 0."""
        f, f_t = self._frequency
        square = f**2 + f_t * 2 * cycles  # squared frequency at that instant
        return 2 * cycles / (f + math.sqrt(square)) if square > 0.0 else -f / f_t

    def _validate(self) -> None:
        """Check what all oscillations share, and normalise the direction."""
        positive(self.amplitude, "amplitude")
        if positive_or_infinite(self.stop, "stop") != math.inf:
            physical(self.stop, "stop")
        check_ramp(self.ramp, self._instant, self.stop)
        choice(self.stop_at, get_args(StopAt), "stop_at")
        check_fields(self, direction=unit_vector)


@final
@dataclass(frozen=True)
class HarmonicBase(_Oscillation):
    """u = amplitude sin(2 pi frequency t), then a sudden stop.

    A sine starts with a velocity, and that of a fast drive sets a low mode in motion: 0.1 mm at 90 Hz leave 7 mm of a
    first mode of 2 Hz.  Over a ``ramp`` of some cycles, the amplitude grows from 0 as s^3 (10 - 15 s + 6 s^2), with s
    from 0 to 1, so that the acceleration is continuous and hardly any other mode moves.

    Parameters
    ----------
    amplitude : float
        Amplitude, m, positive.
    frequency : float
        Frequency, Hz, positive.
    stop : float, optional
        Requested stop time, s, positive; if not given, the motion never stops.
    direction : (float, float)
        Direction of the motion, of any positive length; kept as a unit vector.
    stop_at : {"rest", "once"}
        ``rest``: stop at the first instant of zero base velocity after ``stop``, and hold.  ``once``: stop at ``stop``
        itself, where the base velocity may jump, which is an impact on the clamp.
    ramp : float
        Cycles over which the amplitude grows, 0 or more, before the stop.

    Raises
    ------
    InputError
        If a value is not a number in its range.

    Examples
    --------
    >>> from ancf_casadi import HarmonicBase
    >>> base = HarmonicBase(amplitude=1e-3, frequency=2.0, stop=4.0)
    >>> base.stop_time  # the first instant of rest after 4 s
    4.125
    """

    amplitude: Annotated[float, Meta(description="m")]
    frequency: Annotated[float, Meta(description="Hz")]
    stop: Annotated[float, Meta(description="s")] = math.inf
    direction: tuple[float, float] = (1.0, 0.0)
    stop_at: StopAt = "rest"
    ramp: Annotated[float, Meta(description="cycles in which the amplitude grows from 0")] = 0.0

    def __post_init__(self) -> None:
        """Validate, and normalise the direction."""
        physical(self.frequency, "frequency")
        self._validate()

    @property
    def _frequency(self) -> tuple[float, float]:
        return self.frequency, 0.0


@final
@dataclass(frozen=True)
class SweepBase(_Oscillation):
    """u = amplitude sin(phase(t)), with the frequency changing linearly in time from one value to another, then a stop.

    Parameters
    ----------
    amplitude : float
        Amplitude, m, positive.
    frequencies : (float, float)
        Frequency at time 0 and at ``stop``, Hz, positive.
    stop : float
        Requested stop time, s, positive.
    direction, stop_at, ramp
        See ``HarmonicBase``.

    Raises
    ------
    InputError
        If a value is not a number in its range.

    Examples
    --------
    >>> from ancf_casadi import SweepBase
    >>> base = SweepBase(amplitude=1e-3, frequencies=(1.0, 12.0), stop=30.0, direction=(3.0, 4.0))
    >>> base.direction
    (0.6, 0.8)
    >>> 30.0 <= base.stop_time < 30.1
    True
    """

    amplitude: Annotated[float, Meta(description="m")]
    frequencies: Annotated[tuple[float, float], Meta(description="[FIRST, LAST], Hz")]
    stop: Annotated[float, Meta(description="s")]
    direction: tuple[float, float] = (1.0, 0.0)
    stop_at: StopAt = "rest"
    ramp: Annotated[float, Meta(description="cycles")] = 0.0

    def __post_init__(self) -> None:
        """Validate, and normalise the direction."""
        first, last = (physical(frequency, "frequencies") for frequency in vector(self.frequencies, "frequencies"))
        object.__setattr__(self, "frequencies", (first, last))
        physical(self.stop, "stop")
        self._validate()

    @property
    def _frequency(self) -> tuple[float, float]:
        first, last = self.frequencies
        return first, (last - first) / self.stop


@final
@dataclass(frozen=True, eq=False)
class SampledBase(BaseMotion):
    """A measured motion of the clamp, interpolated by splines of degree 5, then held.

    Parameters
    ----------
    time : array_like (k,)
        Instants, s, increasing; the motion begins with the first one.
    displacement : array_like (k, 2)
        Displacement, m; its value at the first sample is subtracted.
    rotation : array_like (k,), optional
        Rotation, rad, counterclockwise; its value at the first sample is subtracted.

    Raises
    ------
    InputError
        If there are fewer than 6 samples, the shapes differ, a value is not finite or the times do not increase.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import SampledBase
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> x = 0.05 * (1.0 - np.cos(np.pi * time))
    >>> base = SampledBase(time, np.column_stack([x, np.zeros_like(x)]))
    >>> base.displacement[-1].round(3)
    array([0.1, 0. ])
    """

    time: ArrayLike
    displacement: ArrayLike
    rotation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Validate, and keep arrays relative to the first sample."""
        samples = checked_samples(SPLINE_DEGREE + 1, self.time, displacement=self.displacement, rotation=self.rotation)
        for name, values in samples.items():
            object.__setattr__(self, name, values - values[0])

    def pieces(self) -> tuple[Piece, ...]:
        """Return the measured motion and the hold."""
        from scipy.interpolate import make_interp_spline  # slow to import, and used only here

        time = np.asarray(self.time, dtype=float)
        motion = np.column_stack([np.asarray(self.displacement), np.asarray(self.rotation)])
        spline = make_interp_spline(time, motion, k=SPLINE_DEGREE)
        curve = cs.Function.bspline("curve", [spline.t.tolist()], spline.c.ravel().tolist(), [SPLINE_DEGREE], 3)
        return _held((Piece(float(time[-1]), lambda t, parameters: curve(t)),))


def checked_samples(fewest: int, time: ArrayLike, **samples: Any) -> dict[str, Array]:
    """Return increasing instants (k,), ``fewest`` or more, and two checked samples, (k, 2) and (k,), 0 if not given."""
    instants = array(time, "time")
    if instants.ndim != 1 or instants.size < fewest:
        raise InputError(f"needs at least {fewest} instants", "time")
    check_size(instants, "time")
    if (np.diff(instants) <= 0.0).any():
        raise InputError("must increase", "time")
    physical(float(np.ptp(instants)), "time")
    checked = {"time": instants}
    for (name, values), shape in zip(samples.items(), ((instants.size, 2), instants.shape), strict=True):
        checked[name] = np.zeros(instants.size) if values is None else array(values, name)
        if checked[name].shape != shape:
            raise InputError(f"must have the shape {shape}, got {checked[name].shape}", name)
    return checked


def pieces_between(pieces: Iterable[Piece], begin: float, end: float) -> list[tuple[Piece, float, float]]:
    """Return the pieces between two instants (s), at least one, each with its own first and last instant."""
    between: list[tuple[Piece, float, float]] = []
    for piece in pieces:
        if piece.end > begin and (begin < end or not between):
            between.append((piece, begin, min(piece.end, end)))
            begin = piece.end
    return between


def ramp_up(steady: Piece, phase: Callable[[cs.MX], cs.MX], ramp: float, end: float) -> tuple[Piece, ...]:
    """Return an oscillation whose amplitude grows over ``ramp`` cycles of a phase (t, s) -> rad, until ``end`` (s)."""

    def growing(t: cs.MX, parameters: cs.MX) -> cs.MX:
        s = phase(t) / (2 * math.pi * ramp)
        return s**3 * (10 - 15 * s + 6 * s**2) * steady.at(t, parameters)

    return (Piece(end, growing), steady) if ramp else (steady,)


def check_ramp(ramp: float, instant: Callable[[float], float], stop: float) -> None:
    """Refuse a ramp (cycles) that is negative, or whose end, ``instant(ramp)`` (s), is after the stop (s)."""
    if number(ramp, "ramp") and (end := instant(physical(ramp, "ramp"))) > stop * (1 + STOP_TOLERANCE):
        raise InputError(f"lasts until {end:.6g} s, after the stop at {stop:.6g} s; shorten it, or stop later", "ramp")


def _held(pieces: tuple[Piece, ...]) -> tuple[Piece, ...]:
    """Return a motion and, if it ends, the hold at its last position."""
    last = pieces[-1]
    hold = Piece(math.inf, lambda t, parameters: last.at(cs.MX(last.end), parameters))
    return pieces if last.end == math.inf else (*pieces, hold)
