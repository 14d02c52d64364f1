"""Force and moment at the tip, or at another point, as functions of time.

The load p = (Fx, Fy, m) has a fixed direction in the laboratory frame, or follows the beam (``mechanics.loads``); m is
positive counterclockwise.  With position r = S e and slope tau = S' e at the point, its virtual work F.dr + m dtheta,
theta = atan2(tau_y, tau_x), gives the generalized force

    Q = S^T F + S'^T h,    h = m (-tau_y, tau_x)/|tau|^2,

and the power F.r_t + h.tau_t.  Like a base motion, a load is a sequence of smooth pieces, and the integrator restarts
at the end of each.

An integrator whose steps grow while nothing happens could step over a hammer blow.  Within a piece of a sampled load,
its steps are therefore at most as long as the load, at its fastest in this piece, would take to change by its largest
value; and the blows have pieces of their own, so that the steps are short there alone.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar, final

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.base_motion import Piece, check_ramp, checked_samples, pieces_between, ramped
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_size, number, physical, positive_or_infinite, vector
from ancf_casadi.support.tables import Displayed
from ancf_casadi.vibration.equilibrium import Equilibrium, static_equilibrium

S = TypeVar("S", cs.SX, cs.MX)
LOAD_SIZE = 3  # components of a load: force x and y, N, and moment, N m


TIP = PointLoad()  # point and frame of a load at the tip


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
    def place(self) -> PointLoad:
        """Point and frame of the load, as a load of zero."""
        return PointLoad(point=self.point, follower=self.follower)

    @property
    def begin(self) -> float:
        """Time before which the load is zero, s."""
        return 0.0

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the smooth pieces in order, each with the load (N, N, N m); the last has no end."""

    @final
    def values(self, times: Array) -> Array:
        """Return the load (k, 3) at instants (k,), s: before a jump there, but after a jump at the first of them."""
        found = np.zeros((times.size, LOAD_SIZE))
        if times.size:
            pieces, t = pieces_between(self.pieces(), times.min(), times.max()), cs.MX.sym("t")
            owners = np.minimum(np.searchsorted([last for *_, last in pieces], times), len(pieces) - 1)
            for k in np.unique(owners).tolist():
                load = cs.Function("load", [t], [cs.densify(pieces[k][0].at(t, cs.MX(0, 1)))])
                found[owners == k] = load(times[None, owners == k]).full().T
        return found


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

    force: tuple[float, float]
    frequency: float
    moment: float = 0.0
    stop: float = math.inf
    ramp: float = 0.0
    point: float | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        """Validate."""
        object.__setattr__(self, "force", vector(self.force, "force"))
        _ = self.place  # which is checked
        physical(self.frequency, "frequency")
        object.__setattr__(self, "moment", number(self.moment, "moment"))
        for name in ("force", "moment"):
            check_size(getattr(self, name), name)
        positive_or_infinite(self.stop, "stop")
        check_ramp(self.ramp, lambda cycles: cycles / self.frequency, self.stop)

    def pieces(self) -> tuple[Piece, ...]:
        """Return the growing oscillation, the steady one and, if it ends, the time after it."""
        amplitude, omega = cs.DM([*self.force, self.moment]), 2 * math.pi * self.frequency
        steady = Piece(self.stop, lambda t, parameters: amplitude * cs.sin(omega * t))
        pieces = ramped(steady, lambda t: omega * t, self.ramp, self.ramp / self.frequency)
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
        marks, found = _marks(time, rates), [_nothing(self.begin)]
        for begin, end in itertools.pairwise(marks):
            inside = slice(np.searchsorted(time, begin, "right") - 1, np.searchsorted(time, end))
            fastest = float(rates[inside].max())
            found.append(Piece(end, lambda t, parameters: curve(t), 1 / fastest if fastest else math.inf))
        return (*found, _nothing(math.inf))


def point_force(slope: S, load: S, *, follower: bool) -> tuple[S, S]:
    """Return F and h, (2, s), of loads (3, s) at a point with slopes (2, s)."""
    x, y = slope[0, :], slope[1, :]
    turn = load[2, :] / (x * x + y * y)
    h = cs.vertcat(-y * turn, x * turn)
    if not follower:
        return load[:2, :], h
    length = cs.sqrt(x * x + y * y)
    along, across = load[0, :] / length, load[1, :] / length
    return cs.vertcat(along * x - across * y, along * y + across * x), h


@dataclass(frozen=True, eq=False)
class PlacedLoad:
    """A load at a point of a model: its generalized force, power and stiffness."""

    model: Model
    place: PointLoad  # point and frame of the load

    def force(self, e: cs.MX, load: cs.MX) -> cs.MX:
        """Return Q of loads (3, s) on the nodes, (4 n + 4, s), for coordinates e of s states."""
        F, h = self._pair(e, load)
        return self._shape.T @ F + self._slope.T @ h

    def power(self, e: cs.MX, e_t: cs.MX, load: cs.MX) -> cs.MX:
        """Return the power F.r_t + h.tau_t, (1, s)."""
        F, h = self._pair(e, load)
        return cs.sum1((self._shape @ e_t) * F) + cs.sum1((self._slope @ e_t) * h)

    @cached_property
    def stiffness(self) -> tuple[list[int], Callable[[cs.MX, cs.MX], cs.MX]]:
        """Places in ``Model.entries`` of the entries of dQ/de that are not zero, and (e, loads) -> them, (k, s)."""
        index, _ = self.model.place_at(self.place.place(self.model.beam))
        own = self.model.groups[0].coordinates[index]
        slope, shape = (part.full()[:, own] for part in (self._slope, self._shape))
        weights = np.hstack([np.kron(slope.T, slope.T), np.kron(slope.T, shape.T)][: 1 + self.place.follower])
        used = np.flatnonzero(weights.any(axis=1))
        places = own.size**2 * index + used  # ``entries`` start with those of one element of the beam after another
        W = cs.sparsify(cs.DM(weights[used]))
        return places.tolist(), lambda e, load: W @ self._derivatives(e, load)

    def _derivatives(self, e: cs.MX, load: cs.MX) -> cs.MX:
        """Return dh/dtau and, of a follower, dF/dtau, column by column, one below the other, (4, s) each."""
        tau = cs.SX.sym("tau", 2)
        p = cs.SX.sym("p", LOAD_SIZE)
        F, h = point_force(tau, p, follower=self.place.follower)
        parts = [h, F][: 1 + self.place.follower]
        outputs = [cs.densify(cs.vertcat(*(cs.vec(cs.jacobian(part, tau)) for part in parts)))]
        return cs.Function("of_slope", [tau, p], outputs).map(e.shape[1])(self._slope @ e, load)

    def _pair(self, e: cs.MX, load: cs.MX) -> tuple[cs.MX, cs.MX]:
        return point_force(self._slope @ e, load, follower=self.place.follower)

    @cached_property
    def _shape(self) -> cs.DM:
        """S, sparse."""
        return cs.sparsify(cs.DM(self.model.interpolation(self.place.place(self.model.beam))))

    @cached_property
    def _slope(self) -> cs.DM:
        """S', sparse."""
        return cs.sparsify(cs.DM(self.model.slope_interpolation(self.place.place(self.model.beam))))


def equilibrium_under(model: Model, load: Array, place: PointLoad = TIP) -> Equilibrium:
    """Return the static equilibrium under gravity and a load (3,)."""
    force_x, force_y, moment = load.tolist()
    if place == TIP:
        return static_equilibrium(model, tip_force=(force_x, force_y), tip_moment=moment)
    return static_equilibrium(model, loads=[PointLoad((force_x, force_y), moment, place.point, place.follower)])


def _nothing(end: float) -> Piece:
    """Return a piece without load."""
    return Piece(end, lambda t, parameters: cs.MX.zeros(LOAD_SIZE))


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
    parts = [values[:, :2], values[:, 2:]]
    changes = [np.linalg.norm(np.diff(part, axis=0), axis=1) for part in parts]
    largest = [np.linalg.norm(part, axis=1).max() for part in parts]
    relative = [change / most for change, most in zip(changes, largest, strict=True) if most]
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
