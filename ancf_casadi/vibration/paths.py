"""Paths of equilibria through limit points and bifurcations, as loads and displacements of supports grow together.

The loads and the displacements and rotations of the supports are multiplied by a factor s; gravity is not.  The
equilibria R(q, s) = 0 form paths, along which s may decrease, as in snap-through.  With coordinates q relative to their
typical sizes, the tangent and the next equilibrium on a path satisfy

    K q' + R_s s' = 0,    |q'| = 1,            R = 0,    q'^T (q_next - q) = step,    R_s = dR/ds.

The step is measured in the coordinates alone (root mean square), which vary smoothly even if s turns sharply.  It is
halved if Newton's method fails, if the tangent or a slope turns too far, if the factor does not follow the tangents at
both ends, or if it passes more than one critical point.  So the path is followed instead of jumping to another one.

The equilibrium is critical if K is singular, so that its determinant changes sign: at a limit point, where the factor
turns, or at a bifurcation, where another path crosses in the direction of the null vector.  With dead loads K is
symmetric, and the equilibrium is stable if no eigenvalue is negative.  With follower forces the sign of the determinant
shows divergence alone; ``critical_load`` finds flutter too.

References
----------
E. Riks, An incremental approach to the solution of snapping and buckling problems, Int. J. Solids Structures 15 (1979).
W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM (2000), Chapters 1 and 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from types import NoneType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import BandedFactors, factorised
from ancf_casadi.support.inputs import check_instance, instances, number, positive, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Displayed, Reported, Table, counted, spread
from ancf_casadi.vibration.assembly import BANDWIDTH, Position, Structure, refined
from ancf_casadi.vibration.eigensolver import shift_of
from ancf_casadi.vibration.equilibrium import LARGEST_ROTATION, Equilibrium, static_equilibrium

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_STEP = 0.05  # change of the factor per step, relative to the largest factor, and first step along a branch
FACTOR_STEP = 1e-4  # of the factor, relative to the largest, for the derivative where supports move
CONVERGED = 1e-11  # last correction of Newton's method relative to the sizes of the unknowns, and shortest step
SMALLEST_COSINE = 0.95  # of the angle between the tangents at both ends of a step
LARGEST_MISMATCH = 0.1  # of the change of the factor and the mean slope, relative to the larger slope


@dataclass(frozen=True, eq=False)
class CriticalPoint(Displayed):
    """An equilibrium at which the stiffness is singular.

    Parameters
    ----------
    factor : float
        Factor on loads and displacements.
    kind : {"limit", "bifurcation"}
        A limit point, where the factor turns, or a bifurcation, where another path crosses.
    equilibrium : Equilibrium
        The equilibrium.
    shape : array (4 n + 4,)
        Null vector of the stiffness in all nodal coordinates; its largest displacement is 1 m.

    Examples
    --------
    See ``equilibrium_path``.
    """

    factor: float
    kind: Literal["limit", "bifurcation"]
    equilibrium: Equilibrium
    shape: Array


@dataclass(frozen=True, eq=False)
class EquilibriumPath(Reported):
    """A path of equilibria.

    Parameters
    ----------
    model : Model
        The beam, its supports displaced as at a factor of 1.
    loads : tuple of PointLoad or LineLoad
        The loads at a factor of 1.
    factors : array (k,)
        Factor of each equilibrium, in the order of the path.
    equilibria : tuple of Equilibrium
        The equilibria; each has the model with its displacements of the supports.
    stable : array (k,)
        True for each stable equilibrium, as far as divergence goes if forces follow the beam.
    critical_points : tuple of CriticalPoint
        Limit points and bifurcations, which are among the equilibria.
    complete : bool
        Whether the path reaches the largest factor.

    Examples
    --------
    See ``equilibrium_path``.
    """

    _drawing = "ancf_casadi.plot.path_figure"

    model: Model
    loads: tuple[Load, ...]
    factors: Array
    equilibria: tuple[Equilibrium, ...]
    stable: NDArray[np.bool_]
    critical_points: tuple[CriticalPoint, ...]
    complete: bool

    def at(self, factor: float) -> tuple[Equilibrium, ...]:
        """Return all equilibria of the path at a factor, in the order of the path."""
        factor, found = number(factor, "factor"), []
        growing = _Growing(self.model, self.loads, float(np.abs(self.factors).max()))
        points = [growing.point(*pair) for pair in zip(self.factors.tolist(), self.equilibria, strict=True)]
        steepest = max(1.0, *(_rate(first.chord(last)) for first, last in pairwise(points)))
        for first, last in pairwise(points):
            if (first.factor - factor) * (last.factor - factor) < 0.0:
                found.append(_at_factor(first, last, factor, steepest).equilibrium)
            elif first.factor == factor:
                found.append(first.equilibrium)
        return (*found, *(one.equilibrium for one in points[-1:] if one.factor == factor))

    def positions(self, point: float | None = None) -> Array:
        """Return the position (x, y) of a point, (k, 2), m.

        Parameters
        ----------
        point : float, optional
            Arc length, m; ``reference_point`` if not given.
        """
        rows = self.model.interpolation(self.reference_point if point is None else point)
        return np.array([rows @ one.coordinates for one in self.equilibria])

    @cached_property
    def reference_point(self) -> float:
        """Arc length of the node that moves most, m."""
        coordinates = np.array([one.coordinates for one in self.equilibria])
        moved = (coordinates - coordinates[0]).reshape(len(coordinates), -1, NODE)[:, self.model.root :, :2]
        return float(self.model.beam.arc[np.linalg.norm(moved, axis=2).max(axis=0).argmax()])

    @property
    def critical_indices(self) -> dict[int, CriticalPoint]:
        """The critical points by their number in the path, from 0."""
        own = {id(one.equilibrium): one for one in self.critical_points}
        return {k: own[id(rest)] for k, rest in enumerate(self.equilibria) if id(rest) in own}

    def table(self) -> Table:
        """Return the factor and the position of the reference point at both ends and at the critical points."""
        kinds = {0: "begin", len(self.factors) - 1: "end"}
        kinds |= {k: one.kind for k, one in self.critical_indices.items()}
        places = self.positions()
        rows = [(kinds[k], float(self.factors[k]), *map(float, places[k])) for k in sorted(kinds)]
        title = f"Path of {len(self.factors)} equilibria, {np.count_nonzero(~self.stable)} of them unstable"
        note = f"x and y of the point at {self.reference_point:.4g} m"
        return Table("path", title, ("", "factor", "x_m", "y_m"), rows, (note,))

    def to_dict(self) -> dict[str, Any]:
        """Return factors, stability, critical points and nodal coordinates as plain data."""
        return {
            "kind": "equilibrium path",
            "factors": self.factors.tolist(),
            "stable": self.stable.tolist(),
            "critical_points": [{"kind": one.kind, "factor": one.factor} for one in self.critical_points],
            "coordinates": [one.coordinates.tolist() for one in self.equilibria],
            "complete": self.complete,
        }

    def figure(self, *others: EquilibriumPath, labels: Sequence[str] = (), point: float | None = None) -> Figure:
        """Draw the factor against the displacement of a point, and other paths; unstable equilibria are dashed.

        Parameters
        ----------
        *others : EquilibriumPath
            Other paths, such as branches.
        labels : sequence of str
            Names of this path and the others in the legend; their numbers, from 1, if not given.
        point : float, optional
            Arc length of the point, m; ``reference_point`` if not given.

        Raises
        ------
        InputError
            If a result is of another kind, or there is not one label for each.
        """
        return self._drawn(others, labels, point=point)

    def _summary(self) -> str:
        critical = counted(len(self.critical_points), "critical point")
        return f"{len(self.factors)} equilibria, factor {spread(self.factors, '')}, {critical}"


@dataclass(frozen=True, eq=False)
class _Growing:
    """A beam with loads and displacements of supports that grow with a factor."""

    model: Model
    loads: tuple[Load, ...]
    largest: float

    @cached_property
    def moves(self) -> bool:
        """Whether a support moves with the factor."""
        return any(any(one.displacement) or one.angle for one in self.model.beam.supports)

    def model_at(self, factor: float) -> Model:
        """Return the model with its supports displaced by a multiple."""
        if not self.moves:
            return self.model
        supports = []
        for one in self.model.beam.supports:
            turned = {"rotation": factor * one.angle} if hasattr(one, "rotation") else {}
            x, y = one.displacement
            own = replace(one, displacement=(factor * x, factor * y), **turned)
            # a clamp of the beginning that is not displaced would take its node from the model
            supports.append(replace(own, displacement=(1e-29, 0.0)) if own == Clamp() != one else own)
        return replace(self.model, beam=replace(self.model.beam, supports=tuple(supports)))

    def point(self, factor: float, equilibrium: Equilibrium) -> _Point:
        """Return an equilibrium as a point."""
        return _Point(self, equilibrium.model.of_free(equilibrium.coordinates), factor, equilibrium.exact.remainder)


@dataclass(frozen=True, eq=False)
class _Point:
    """Free coordinates q and a factor s, and the balance R there.

    Tangents and rows refer to the unknowns x = (q/scale, s/largest), (N + 1,).
    """

    growing: _Growing
    q: Array
    factor: float
    remainder: Array  # of all nodal coordinates

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The point as a result."""
        loads, model = (
            tuple(load.scaled(self.factor) for load in self.growing.loads),
            self.growing.model_at(self.factor),
        )
        coordinates = model.whole(self.q, np.array([0.0, 0.0, *model.beam.axis]))
        return Equilibrium(model, coordinates, remainder=self.remainder, loads=loads)

    @cached_property
    def structure(self) -> Structure:
        """The beam and its loads."""
        return Structure.of(self.equilibrium.model, self.equilibrium.loads)

    @property
    def at(self) -> Position:
        """The nodal coordinates."""
        return self.equilibrium.exact

    @cached_property
    def balance(self) -> tuple[Array, Array, Array]:
        """The balance R, and K, shifted if the supports do not hold the beam, and M, stored by diagonals."""
        force, stiffness, mass = self.structure.linearisation(self.at)
        if not self.growing.model.is_held:
            stiffness = stiffness + shift_of(self.structure.model, stiffness, mass) * mass
        return force, stiffness, mass

    @cached_property
    def factors(self) -> BandedFactors:
        """The factors of K."""
        return factorised(self.balance[1])

    @cached_property
    def determinant(self) -> tuple[float, float]:
        """Sign of the determinant of K, and the logarithm of its size."""
        diagonal, swaps = self.factors.band[2 * BANDWIDTH], self.factors.pivots != np.arange(self.q.size)
        sign = np.prod(np.sign(diagonal)) * (-1.0) ** np.count_nonzero(swaps)
        return float(sign), float(np.log(np.abs(diagonal)).sum())

    @cached_property
    def negative(self) -> int:
        """Number of negative eigenvalues of K, modulo 2 if forces follow the beam."""
        if any(load.follower for load in self.growing.loads):
            return int(self.determinant[0] < 0.0)
        size = np.sqrt(np.abs(self.balance[1][BANDWIDTH]))
        lower = self.balance[1][BANDWIDTH:].copy()
        for k, row in enumerate(lower):
            row[: row.size - k] /= size[k:] * size[: row.size - k]
        return int(np.count_nonzero(scipy.linalg.eig_banded(lower, lower=True, eigvals_only=True) < 0.0))

    @cached_property
    def rate(self) -> Array:
        """The derivative of R with respect to s/largest, (N,)."""
        largest = self.growing.largest
        if self.growing.moves:
            ends = (replace(self, factor=self.factor + sign * FACTOR_STEP * largest) for sign in (1.0, -1.0))
            return np.subtract(*(one.balance[0] for one in ends)) / (2 * FACTOR_STEP)
        model = self.structure.model
        unit = Structure.of(model, [load.scaled(largest) for load in self.growing.loads])
        return replace(unit, parts=unit.parts[len(model.groups) :]).linearisation(self.at)[0]

    def solve(self, row: Array, right: Array) -> Array:
        """Return the solution x of K (scale x_q) + rate x_s = right_q, row x = right_s."""
        scale, product = self.structure.model.free_scale, self.structure.stiffness_product(self.at)
        by_rate = self.factors.solve(self.rate) / scale

        def approximate(right: Array) -> Array:
            x = self.factors.solve(right[:-1]) / scale
            s = (right[-1] - row[:-1] @ x) / (row[-1] - row[:-1] @ by_rate)
            return np.append(x - s * by_rate, s)

        def exact(x: Array) -> Array:
            return np.append(product(scale * x[:-1]) + x[-1] * self.rate, row @ x)

        return refined(approximate, exact, right)

    def tangent(self, row: Array) -> Array:
        """Return the tangent of the path whose product with a row is positive."""
        direction = self.solve(row, np.append(np.zeros(self.q.size), 1.0))
        return np.asarray(direction / _size(direction[:-1]))

    def moved(self, x: Array) -> _Point:
        """Return the point at a distance."""
        q = self.q + self.structure.model.free_scale * x[:-1]
        return replace(
            self, q=q, factor=self.factor + self.growing.largest * float(x[-1]), remainder=0.0 * self.remainder
        )

    def corrected(self, row: Array) -> _Point | None:
        """Return the equilibrium on the plane through the point normal to a row; None if Newton's method fails."""
        at, away, converged = self, np.zeros(self.q.size + 1), False
        for _ in range(12):
            try:
                step = -at.solve(row, np.append(at.balance[0], row @ away))
            except np.linalg.LinAlgError:
                return None
            if not np.isfinite(step).all():
                return None
            if converged:
                model, factor = at.structure.model, at.factor + self.growing.largest * float(step[-1])
                return replace(at, factor=factor, remainder=model.moved(model.free_scale * step[:-1]))
            at, away = at.moved(step), away + step
            converged = bool(np.abs(step).max() < CONVERGED)
        return None

    def determinant_relative_to(self, other: _Point) -> float:
        """Return the determinant of K, relative to its size at another point."""
        (sign, own), (_, reference) = self.determinant, other.determinant
        return sign * float(np.exp(own - reference))

    def critical(self, kind: Literal["limit", "bifurcation"]) -> CriticalPoint:
        """Return the point as a critical one, with the null vector of K by inverse iteration."""
        model, shape = self.structure.model, np.random.default_rng(0).standard_normal(self.q.size)
        for _ in range(3):
            shape = self.factors.solve(shape)
            shape /= np.linalg.norm(shape)
        moved = model.moved(shape)
        places = moved.reshape(-1, NODE)[:, :2]
        return CriticalPoint(self.factor, kind, self.equilibrium, moved / places.flat[np.abs(places).argmax()])

    def chord(self, other: _Point) -> Array:
        """Return the way to another point, (N + 1,)."""
        way = (other.q - self.q) / self.structure.model.free_scale
        return np.append(way, (other.factor - self.factor) / self.growing.largest)


@lasting_interrupts()
def equilibrium_path(
    model: Model,
    *,
    loads: Sequence[Load] = (),
    largest: float = 1.0,
    points: int = 500,
    start: CriticalPoint | None = None,
    side: int = 1,
) -> EquilibriumPath:
    """Return the path of equilibria on which loads and displacements of supports grow with a factor; gravity does not.

    The path begins without loads, or at a bifurcation of another path, and ends where the factor has reached the
    largest one, positive or negative.

    Parameters
    ----------
    model : Model
        The beam, its supports displaced as at a factor of 1.
    loads : sequence of PointLoad or LineLoad
        The loads at a factor of 1.
    largest : float
        Largest factor.
    points : int
        Largest number of equilibria.
    start : CriticalPoint, optional
        A bifurcation of a path of this model and these loads, from which to follow the path that crosses there.
    side : {1, -1}
        Side of the bifurcation: along its shape, or against it.

    Raises
    ------
    InputError
        If an argument is unusable, nothing grows with the factor, or the start is no bifurcation of this model.
    EquilibriumError
        If the path does not begin with an equilibrium, or has no second one.

    Examples
    --------
    A column buckles, and bends to either side:

    >>> from ancf_casadi import Beam, Model, PointLoad, equilibrium_path
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    >>> push = [PointLoad((-0.1, 0.0))]
    >>> straight = equilibrium_path(Model(beam), loads=push, largest=2.0)
    >>> buckled = straight.critical_points[0]
    >>> print(f"{buckled.kind} at {buckled.factor:.3f}")
    bifurcation at 1.080
    >>> bent = equilibrium_path(Model(beam), loads=push, largest=2.0, start=buckled)
    >>> [one.is_stable for one in (*straight.at(1.5), *bent.at(1.5))]
    [False, True]
    """
    check_instance(model, "model", Model)
    check_instance(start, "start", CriticalPoint, NoneType)
    acting = instances(loads, "loads", PointLoad, LineLoad, least=0)
    growing = _Growing(model, acting, positive(largest, "largest"))
    points, side = whole(points, "points", 2), whole(side, "side", -1, 1)
    if not (growing.moves or any(any(load.values) for load in acting)):
        raise InputError("are zero, and no support is displaced, so nothing grows with the factor", "loads")
    if side == 0:
        raise InputError("must be 1 or -1", "side")
    if start is None:
        here = growing.point(0.0, static_equilibrium(growing.model_at(0.0)))
        tangent = here.tangent(np.append(np.zeros(model.freedoms), 1.0))
        step = _longest_step(tangent)
    else:
        here, step = growing.point(start.factor, start.equilibrium), LARGEST_STEP
        known = here.equilibrium
        if start.kind != "bifurcation" or (known.model, known.loads) != (
            start.equilibrium.model,
            start.equilibrium.loads,
        ):
            raise InputError("is no bifurcation of a path of this model under these loads", "start")
        shape = side * known.model.of_free(start.shape) / known.model.free_scale
        tangent = np.append(shape / _size(shape), 0.0)
    path, critical, steepest = [here], [], max(1.0, abs(float(tangent[-1])))
    while abs(here.factor) < growing.largest and len(path) < points and step > CONVERGED:
        following = _next(here, tangent, step, steepest, counts=len(path) > 1 or start is None)
        if following is None:
            step /= 2
            continue
        trial, direction = following
        if abs(trial.factor) > growing.largest:
            trial = _at_factor(here, trial, float(np.copysign(growing.largest, trial.factor)), steepest)
        if (len(path) > 1 or start is None) and trial.negative != here.negative:
            path.append(_root(here, trial, lambda one: one.determinant_relative_to(trial), steepest))
            critical.append(path[-1].critical("limit" if tangent[-1] * direction[-1] < 0.0 else "bifurcation"))
        path.append(trial)
        steepest = max(steepest, abs(float(direction[-1])))
        here, tangent, step = trial, direction, min(2 * step, _longest_step(direction))
    if len(path) == 1:
        raise EquilibriumError(
            f"the path of equilibria cannot be followed from the factor {here.factor:g}; use a smaller largest factor, "
            "or more elements"
        )
    stable = np.array([one.negative == 0 for one in path])
    special = {id(one.equilibrium) for one in critical}
    equilibria = tuple(one.equilibrium for one in path)
    return EquilibriumPath(
        model,
        acting,
        np.array([one.factor for one in path]),
        equilibria,
        stable & ~np.array([id(one) in special for one in equilibria]),
        tuple(critical),
        abs(here.factor) >= growing.largest * (1 - 1e-9),
    )


def _next(here: _Point, tangent: Array, step: float, steepest: float, *, counts: bool) -> tuple[_Point, Array] | None:
    """Return the equilibrium one step along a path, and its tangent; None if the step is too long."""
    row = _row(tangent, steepest)
    trial = here.moved(step * tangent).corrected(row)
    if trial is None:
        return None
    try:
        direction = trial.tangent(row)
        passed = abs(trial.negative - here.negative) if counts else 0
    except np.linalg.LinAlgError:
        return None
    way, slopes = here.chord(trial), np.arange(here.at.coordinates.size).reshape(-1, NODE)[:, 2:]
    rotation = np.linalg.norm((trial.at.coordinates - here.at.coordinates)[slopes], axis=1).max()
    rates = np.array([tangent[-1], direction[-1]])
    mismatch = abs(way[-1] / _size(way[:-1]) - rates.mean())
    follows = (
        rotation <= LARGEST_ROTATION
        and abs(way[-1]) <= 2 * LARGEST_STEP
        and direction[:-1] @ tangent[:-1] >= SMALLEST_COSINE * here.q.size
        and mismatch <= LARGEST_MISMATCH * np.abs(rates).max()
        and (passed == 1 or (passed == 0 and (rates.prod() >= 0.0 or not counts)))
    )
    return (trial, direction) if follows else None


def _longest_step(tangent: Array) -> float:
    """Return the step by which the factor changes by ``LARGEST_STEP``, at most 1."""
    return LARGEST_STEP / max(abs(float(tangent[-1])), LARGEST_STEP)


def _size(x: Array) -> float:
    """Return the root mean square."""
    return float(np.linalg.norm(x) / np.sqrt(x.size))


def _row(direction: Array, steepest: float) -> Array:
    """Return the normal of the planes on which points are sought along a direction.

    The factor counts little where it varies less than at the steepest slope, and nothing where it turns.
    """
    return np.append(direction[:-1] / (direction.size - 1), direction[-1] / steepest**2)


def _rate(way: Array) -> float:
    """Return the size of the change of the factor per change of the coordinates."""
    return abs(float(way[-1])) / _size(way[:-1])


def _at_factor(first: _Point, last: _Point, factor: float, steepest: float) -> _Point:
    """Return the point at a factor between two points of a path."""
    near = _root(first, last, lambda one: one.factor - factor, steepest)
    row = np.append(np.zeros(first.q.size), 1.0)
    return replace(near, factor=factor).corrected(row) or near


def _root(first: _Point, last: _Point, value: Callable[[_Point], float], steepest: float) -> _Point:
    """Return the point between two points of a path at which a value of opposite signs there is zero.

    The Illinois variant of the regula falsi keeps a bracket; its order is 1.44.
    """
    chord = first.chord(last)
    row = _row(chord / _size(chord[:-1]), steepest)
    (a, b), (low, high) = (0.0, 1.0), (value(first), value(last))
    best = last
    for _ in range(60):
        x = b - high * (b - a) / (high - low)
        point = first.moved(x * chord).corrected(row)
        if point is None:
            break
        best, own, change = point, value(point), abs(x - b)
        if own * high < 0.0:
            a, low = b, high
        else:
            low /= 2
        b, high = x, own
        if own == 0.0 or change < CONVERGED:
            break
    return best
