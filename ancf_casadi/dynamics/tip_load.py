"""Force and moment at the tip or another point as functions of time, and forces that travel along the beam.

The load p = (Fx, Fy, m) has a fixed direction in the laboratory frame, or follows the beam (``mechanics.loads``); m is
positive counterclockwise (``placed_load``).  Like a base motion, a load is a sequence of smooth pieces, and the
integrator restarts at the end of each.

An integrator whose steps grow while nothing happens could step over a hammer blow.  Within a piece of a sampled load,
its steps are therefore at most as long as the load, at its fastest in this piece, would take to change by its largest
value; and the blows have pieces of their own, so that the steps are short there alone.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, final

import casadi as cs
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.base_motion import Piece, check_ramp, checked_samples, pieces_between, ramp_up
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.supports import check_point
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import (
    check_fields,
    check_size,
    limited_number,
    limited_vector,
    not_negative,
    physical,
    positive_or_infinite,
)
from ancf_casadi.support.tables import Displayed


class TipLoad(Displayed, ABC):
    """Base class of the loads over time, at the tip or another point.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import HarmonicLoad, SampledLoad, TipLoad
    >>> blow = SampledLoad([0.10, 0.11, 0.12], [[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    >>> isinstance(blow, TipLoad), blow.begin
    (True, 0.1)
    >>> blow.values(np.array([0.05, 0.11]))
    array([[0., 0., 0.],
           [2., 0., 0.]])
    """

    point: float | None
    follower: bool

    @property
    def place(self) -> PointLoad | None:
        """Point and frame of the load, as a load of zero; None if it travels."""
        return PointLoad(point=self.point, follower=self.follower)

    def along(self, beam: Beam) -> TipLoad:
        """Return the load on a beam; one beyond its tip raises an ``InputError``."""
        PointLoad(point=self.point).place(beam)
        return self

    @property
    def begin(self) -> float:
        """Time before which the load is zero, s."""
        return 0.0

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the smooth pieces in order, each with the load (N, N, N m; place, m); the last has no end."""

    @final
    def values(self, times: Array) -> Array:
        """Return the load (k, 3) at instants (k,), s: before a jump there, but after a jump at the first of them."""
        loads = np.zeros((times.size, LOAD_SIZE))
        if times.size:
            pieces, t = pieces_between(self.pieces(), times.min(), times.max()), cs.MX.sym("t")
            owners = np.minimum(np.searchsorted([last for *_, last in pieces], times), len(pieces) - 1)
            for k in np.unique(owners).tolist():
                load = cs.Function("load", [t], [cs.densify(pieces[k][0].at(t, cs.MX(0, 1)))[:LOAD_SIZE]])
                loads[owners == k] = load(times[None, owners == k]).full().T
        return loads


@final
@dataclass(frozen=True)
class HarmonicLoad(TipLoad):
    """A harmonic load, proportional to sin(2 pi frequency t), which may end.

    Parameters
    ----------
    force : (float, float)
        Amplitude of the force in the laboratory frame, N.
    frequency : float
        Frequency, Hz, positive.
    moment : float
        Amplitude of the moment, positive counterclockwise, N m.
    stop : float, optional
        Time from which the load is zero, s, positive; if not given, the load never ends.
    ramp : float
        See ``HarmonicBase``.
    point : float, optional
        Arc length of the point at which the load acts, m; the tip if not given.
    follower : bool
        Whether the force turns with the beam; its components are then along and across the beam.

    Raises
    ------
    InputError
        If a value is not a number in its range.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import HarmonicLoad
    >>> load = HarmonicLoad(force=(0.1, 0.0), frequency=2.0, stop=1.0)
    >>> load.values(np.array([0.125, 2.0])).round(3)
    array([[0.1, 0. , 0. ],
           [0. , 0. , 0. ]])
    """

    force: Annotated[tuple[float, float], Meta(description="N")]
    frequency: Annotated[float, Meta(description="Hz")]
    moment: Annotated[float, Meta(description="N m")] = 0.0
    stop: Annotated[float, Meta(description="s")] = math.inf
    ramp: Annotated[float, Meta(description="cycles")] = 0.0
    point: Annotated[float | None, Meta(description="m")] = None
    follower: bool = False

    def __post_init__(self) -> None:
        """Validate."""
        _ = self.place  # which is checked
        physical(self.frequency, "frequency")
        check_fields(self, force=limited_vector, moment=limited_number)
        positive_or_infinite(self.stop, "stop")
        check_ramp(self.ramp, lambda cycles: cycles / self.frequency, self.stop)

    def pieces(self) -> tuple[Piece, ...]:
        """Return the growing oscillation, the steady one and, if it ends, the time after it."""
        amplitude, omega = cs.DM([*self.force, self.moment]), 2 * math.pi * self.frequency
        steady = Piece(self.stop, lambda t, parameters: amplitude * cs.sin(omega * t))
        pieces = ramp_up(steady, lambda t: omega * t, self.ramp, self.ramp / self.frequency)
        return pieces if self.stop == math.inf else (*pieces, _nothing(math.inf))


@final
@dataclass(frozen=True, eq=False)
class SampledLoad(TipLoad):
    """A measured load, interpolated between its samples, and zero before the first and after the last of them.

    The interpolation is monotone between neighbouring samples (piecewise cubic, PCHIP): a blow or a step does not ring.
    With ten samples per period, it changes the amplitude of a vibration by 0.4 %.  A load that is constant for five
    seconds and then ends is ``SampledLoad([0, 5], [[1, 0], [1, 0]])``.

    Parameters
    ----------
    time : array_like (k,)
        Instants, s, increasing, on the clock of the motion.
    force : array_like (k, 2)
        Force in the laboratory frame, N.
    moment : array_like (k,), optional
        Moment, positive counterclockwise, N m; zero if not given.
    point, follower
        See ``HarmonicLoad``.

    Raises
    ------
    InputError
        If there are fewer than two samples, the shapes differ, a value is not finite or the times do not increase.

    References
    ----------
    Fritsch and Butland 1984, "A method for constructing local monotone piecewise cubic interpolants".

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, SampledLoad, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> blow = SampledLoad([0.0, 0.005, 0.01], [[0.0, 0.0], [0.2, 0.0], [0.0, 0.0]])
    >>> run = simulate(Model(beam), load=blow, duration=0.1, sample_rate=1000.0)
    >>> bool(run.tip[-1, 0] > 0.0)
    True
    """

    time: ArrayLike
    force: ArrayLike
    moment: ArrayLike | None = None
    point: float | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        _ = self.place  # which is checked
        samples = checked_samples(2, self.time, force=self.force, moment=self.moment)
        physical(float(np.diff(samples["time"]).min()), "time")
        for name, values in samples.items():
            check_size(values, name)
            object.__setattr__(self, name, values)

    def __reduce__(self) -> tuple[type[SampledLoad], tuple[Any, ...]]:
        """Pickle the samples without the pieces, which the receiving process derives again."""
        return SampledLoad, (self.time, self.force, np.asarray(self.moment), self.point, self.follower)

    @property
    def begin(self) -> float:
        """Time of the first sample, s."""
        return float(np.asarray(self.time)[0])

    def pieces(self) -> tuple[Piece, ...]:
        """Return the time before the record, the blows in it and the times between them, and the time after it."""
        return self._pieces

    @cached_property
    def _pieces(self) -> tuple[Piece, ...]:
        """The pieces; a fit needs them for each of its motions."""
        time = np.asarray(self.time, dtype=float)
        values = np.column_stack([np.asarray(self.force), np.asarray(self.moment)])
        if not values.any():
            return (_nothing(math.inf),)
        curve, rates = _monotone(time, values), _rates(time, values)
        marks, pieces = _marks(time, rates), [_nothing(self.begin)]
        for begin, end in itertools.pairwise(marks):
            inside = slice(np.searchsorted(time, begin, "right") - 1, np.searchsorted(time, end))
            fastest = float(rates[inside].max())
            pieces.append(Piece(end, lambda t, parameters: curve(t), 1 / fastest if fastest else math.inf))
        return (*pieces, _nothing(math.inf))


@final
@dataclass(frozen=True)
class MovingForce(TipLoad):
    """A constant force that travels along the beam at a constant speed, and leaves it at the tip.

    Parameters
    ----------
    force : (float, float)
        Force in the laboratory frame, N.
    speed : float
        Speed along the arc length, m/s, positive.
    point : float
        Arc length at which the force begins, m.
    begin : float
        Time at which it begins, s.
    end : float, optional
        Arc length at which the force leaves the beam, m; the tip if not given.

    Raises
    ------
    InputError
        If a value is not a number in its range, or the end is not beyond the point.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, MovingForce, Pin, Roller, simulate
    >>> bridge = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                       elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0), supports=[Pin(0.0), Roller(0.5)])
    >>> run = simulate(Model(bridge), load=MovingForce((0.0, -0.01), speed=2.0), duration=0.25)
    >>> print(f"{1e3 * run.position(0.25)[:, 1].min():.2f} mm")
    -3.93 mm
    """

    force: Annotated[tuple[float, float], Meta(description="N")]
    speed: Annotated[float, Meta(description="m/s")]
    point: Annotated[float, Meta(description="m")] = 0.0
    begin: Annotated[float, Meta(description="s")] = 0.0
    end: Annotated[float | None, Meta(description="m")] = None

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, force=limited_vector)
        physical(self.speed, "speed")
        not_negative(self.begin, "begin")
        LineLoad((0.0, 0.0), check_point(self.point), self.end)  # which checks the end

    @property
    def place(self) -> None:
        """None, as the force travels."""

    def along(self, beam: Beam) -> MovingForce:
        """Return the force on a beam; one beyond its tip raises an ``InputError``."""
        return replace(self, end=LineLoad((0.0, 0.0), self.point, self.end).places(beam)[1])

    def pieces(self) -> tuple[Piece, ...]:
        """Return the time before the force, its way along the beam, and the time after it."""
        way = math.inf if self.end is None else self.end - self.point

        def at(t: cs.MX, parameters: cs.MX) -> cs.MX:
            return cs.vertcat(*self.force, 0.0, self.point + self.speed * (t - self.begin))

        none = [_nothing(end, LOAD_SIZE + 1) for end in (self.begin, math.inf)]
        return none[0], Piece(self.begin + way / self.speed, at), none[1]


def _nothing(end: float, size: int = LOAD_SIZE) -> Piece:
    """Return a piece without load."""
    return Piece(end, lambda t, parameters: cs.MX.zeros(size))


def _monotone(time: Array, values: Array) -> cs.Function:
    """Return the monotone cubic interpolation (t) -> values, as a B-spline with double knots."""
    from scipy.interpolate import PchipInterpolator  # slow to import, and used only here

    thirds = np.diff(time)[:, None] / 3
    with np.errstate(over="ignore"):  # harmonic means of slopes next to zero
        slopes = PchipInterpolator(time, values)(time, 1)
    controls = np.empty((2 * time.size, values.shape[1]))
    controls[0], controls[-1] = values[0], values[-1]
    controls[1:-1:2] = values[:-1] + thirds * slopes[:-1]
    controls[2:-1:2] = values[1:] - thirds * slopes[1:]
    knots = np.concatenate([time[[0, 0]], np.repeat(time, 2), time[[-1, -1]]])
    return cs.Function.bspline("curve", [knots.tolist()], controls.ravel().tolist(), [3], values.shape[1])


def _rates(time: Array, values: Array) -> Array:
    """Return the rates of change between samples, (k - 1,), 1/s, relative to the largest force and moment."""
    components = [values[:, :2], values[:, 2:]]
    changes = [np.linalg.norm(np.diff(component, axis=0), axis=1) for component in components]
    largest = [np.linalg.norm(component, axis=1).max() for component in components]
    relative = [change / greatest for change, greatest in zip(changes, largest, strict=True) if greatest]
    return np.asarray(np.max(relative, axis=0) / np.diff(time))


def _marks(time: Array, rates: Array) -> list[float]:
    """Return the first and the last instant, and the beginnings and ends of the blows between them."""
    first, last = float(time[0]), float(time[-1])
    if not rates.any():
        return [first, last]
    # rate of change of a blow, relative to the largest of the record
    fast, margin = rates > 0.1 * rates.max(), 1 / rates.max()
    begins, ends = time[:-1][fast] - margin, time[1:][fast] + margin
    apart = begins[1:] > ends[:-1]
    blows = [begins[np.r_[True, apart]], ends[np.r_[apart, True]]]
    if blows[0].size > 50:  # with more, the whole record is one piece
        return [first, last]
    inner = np.concatenate(blows)
    return [first, *np.sort(inner[(inner > first) & (inner < last)]).tolist(), last]
