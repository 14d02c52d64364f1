"""Continuation of equilibria as loads and displacements of supports grow together with a factor.

The equilibria R(q, s) = 0 under the factor s form paths, along which s may decrease, as in snap-through.  With free
coordinates q relative to their typical sizes, the tangent (q', s') of a path and the next equilibrium satisfy

    K q' + R_s s' = 0,    |q'| = 1,    R = 0,    q'.(dq - step q') = 0,    R_s = dR/ds.

Lengths are measured in the coordinates alone (root mean square), which vary smoothly where s turns.  Where s varies
much more than they do, as in a column before it buckles, ds = step s' replaces the last equation.  A step is halved if
Newton's method fails, if a slope turns too far, if the factor does not follow its slopes at both ends, or if the step
passes more than one critical point.  So the path is followed instead of jumping to another one.

The bordered systems are solved with the banded factors of K and refined with exact products
(``ancf_casadi.vibration.assembly``).

References
----------
E. Riks, An incremental approach to the solution of snapping and buckling problems, Int. J. Solids Structures 15 (1979).
H. B. Keller, Lectures on Numerical Methods in Bifurcation Problems, Springer (1987), Chapters 4 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg

from ancf_casadi.mechanics.loads import Load
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import BandedFactors, factorise
from ancf_casadi.vibration.assembly import BANDWIDTH, Position, Structure, solve_refined
from ancf_casadi.vibration.equilibrium import Equilibrium

MAX_STEP = 0.05  # change of the factor per step, relative to the largest factor, and first step along a branch
FACTOR_STEP = 1e-4  # of the factor, relative to the largest, for the derivative of the places of the supports
TOLERANCE = 1e-11  # last correction of Newton's method relative to the sizes of the unknowns, and shortest step
STEEP = 1e3  # slope above which points are sought at given factors, which rounding of q would change by 1e-13 or more
MAX_ROTATION = 0.25  # norm of the change of a slope vector in one step; about the angle, rad
MAX_MISMATCH = 0.1  # of the change of the factor and the mean slope, relative to the larger slope


@dataclass(frozen=True, eq=False)
class ProportionalLoading:
    """A beam whose loads and displacements of supports grow in proportion to a factor."""

    model: Model
    loads: tuple[Load, ...]
    largest: float = 1.0
    with_weight: bool = False  # whether the forces on the straight beam, such as gravity, grow with the factor too

    @cached_property
    def weight(self) -> Array | float:
        """The forces that grow with the factor, whatever the shape of the beam, (N,), N."""
        if not self.with_weight:
            return 0.0
        return -Structure.of(self.model_at(0.0)).linearisation(Position.of(self.model.straight))[0]

    @cached_property
    def moves(self) -> bool:
        """True if a support moves with the factor."""
        return any(any(support.displacement) or support.angle for support in self.model.beam.supports)

    def model_at(self, factor: float) -> Model:
        """Return the model with the displacements of its supports multiplied by a factor."""
        if not self.moves:
            return self.model
        supports = []
        for support in self.model.beam.supports:
            rotation = {"rotation": factor * support.angle} if hasattr(support, "rotation") else {}
            x, y = support.displacement
            displaced = replace(support, displacement=(factor * x, factor * y), **rotation)
            if displaced == Clamp() and support != Clamp():  # without a displacement, the model would lose its node
                displaced = replace(displaced, displacement=(1e-29, 0.0))
            supports.append(displaced)
        return replace(self.model, beam=replace(self.model.beam, supports=tuple(supports)))

    def point(self, factor: float, equilibrium: Equilibrium) -> PathPoint:
        """Return an equilibrium as a point."""
        return PathPoint(self, equilibrium.model.of_free(equilibrium.coordinates), factor, equilibrium.exact.remainder)


@dataclass(frozen=True, eq=False)
class PathPoint:
    """Free coordinates q, a factor s, and the balance R; tangents refer to x = (q/scale, s/largest), (N + 1,)."""

    loading: ProportionalLoading
    q: Array
    factor: float
    remainder: Array  # of all nodal coordinates

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The point as a result."""
        loads = tuple(load.scaled(self.factor) for load in self.loading.loads)
        model = self.loading.model_at(self.factor)
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
    def balance(self) -> tuple[Array, Array]:
        """The balance R, and K, shifted if the supports do not hold the beam, stored by diagonals."""
        force, *matrices = self.structure.linearisation(self.at)
        relief = (1.0 - self.factor / self.loading.largest) * self.loading.weight
        return force + relief, self.structure.regular_stiffness(*matrices)

    @cached_property
    def factors(self) -> BandedFactors:
        """The factors of K."""
        return factorise(self.balance[1])

    @cached_property
    def determinant(self) -> tuple[float, float]:
        """Sign of the determinant of K, and the logarithm of its size."""
        return self.factors.determinant

    @cached_property
    def negative(self) -> int:
        """Number of negative eigenvalues of K, modulo 2 if forces follow the beam."""
        if any(load.follower for load in self.loading.loads):
            return int(self.determinant[0] < 0.0)
        size = np.sqrt(np.abs(self.balance[1][BANDWIDTH]))
        lower = self.balance[1][BANDWIDTH:].copy()
        for k, row in enumerate(lower):
            row[: row.size - k] /= size[k:] * size[: row.size - k]
        return int(np.count_nonzero(scipy.linalg.eig_banded(lower, lower=True, eigvals_only=True) < 0.0))

    @cached_property
    def rate(self) -> Array:
        """The derivative of R with respect to s/largest, (N,)."""
        largest, model = self.loading.largest, self.structure.model
        structure = Structure.of(model, [load.scaled(largest) for load in self.loading.loads])
        loaded_elements = replace(structure, groups=structure.groups[len(model.groups) :])
        rate = loaded_elements.linearisation(self.at)[0] - self.loading.weight
        if self.loading.moves:
            neighbours = [replace(self, factor=self.factor + sign * FACTOR_STEP * largest) for sign in (1.0, -1.0)]
            if any(getattr(support, "rotation", 0.0) for support in model.beam.supports):  # the free directions turn
                return np.subtract(*(end.balance[0] for end in neighbours)) / (2 * FACTOR_STEP)
            support_motion = np.subtract(*(end.at.coordinates for end in neighbours)) / (2 * FACTOR_STEP)
            rate = rate + self.structure.whole_product(self.at)(support_motion)
        return np.asarray(rate)

    def solve(self, rows: Array, columns: Array, right_side: Array) -> Array:
        """Return the solution (x, y) of K (scale x) + columns y = right_side[:N], rows (x, y) = right_side[N:]."""
        scale, product, N = self.structure.model.free_scale, self.structure.stiffness_product(self.at), self.q.size
        by_columns = self.factors.solve(columns) / scale[:, None]
        complement = rows[:, N:] - rows[:, :N] @ by_columns

        def approximate(right_side: Array) -> Array:
            x = self.factors.solve(right_side[:N]) / scale
            y = np.linalg.solve(complement, right_side[N:] - rows[:, :N] @ x)
            return np.append(x - by_columns @ y, y)

        def exact(x: Array) -> Array:
            return np.append(product(scale * x[:N]) + columns @ x[N:], rows @ x)

        return solve_refined(approximate, exact, right_side)

    def tangent(self, row: Array) -> Array:
        """Return the tangent of the path whose product with a row is positive."""
        direction = self.solve(row[None], self.rate[:, None], np.append(np.zeros(self.q.size), 1.0))
        return np.asarray(direction / rms(direction[:-1]))

    def at_offset(self, x: Array) -> PathPoint:
        """Return the point at an offset x, (N + 1,)."""
        q = self.q + self.structure.model.free_scale * x[:-1]
        return replace(
            self, q=q, factor=self.factor + self.loading.largest * float(x[-1]), remainder=0.0 * self.remainder
        )

    def correct(self, row: Array, null: Array | None = None) -> PathPoint | None:
        """Return the equilibrium on the plane through the point normal to a row; None if Newton's method fails.

        Next to a bifurcation, rounding would move the point along the null vector of K, (N,).  If ``null`` is given,
        the point does not move along it; a force in its direction, zero on a path that the other one crosses
        symmetrically, replaces this unknown.
        """
        nulls = np.zeros((0, self.q.size)) if null is None else null[None]
        m, scale = 1 + len(nulls), self.structure.model.free_scale
        rows = np.zeros((m, self.q.size + m))
        rows[0, : row.size], rows[1:, : self.q.size] = row, nulls * scale
        point, offset, converged = self, np.zeros(self.q.size + m), False
        for _ in range(12):
            try:
                columns = np.column_stack([point.rate, *nulls])
                force = nulls.T @ offset[row.size :]
                step = -point.solve(rows, columns, np.append(point.balance[0] + force, rows @ offset))
            except np.linalg.LinAlgError:
                return None
            if not np.isfinite(step).all():
                return None
            change, offset = step[: row.size], offset + step
            if converged:
                factor = point.factor + self.loading.largest * float(change[-1])
                return replace(
                    point, factor=factor, remainder=point.structure.model.with_fixed_base(scale * change[:-1])
                )
            point = point.at_offset(change)
            converged = bool(np.abs(change).max() < TOLERANCE)
        return None

    def null_vector(self) -> Array:
        """Return the eigenvector of K next to zero, of unit length, by inverse iteration."""
        vector = np.random.default_rng(0).standard_normal(self.q.size)
        for _ in range(3):
            vector = self.factors.solve(vector)
            vector /= np.linalg.norm(vector)
        return vector

    def determinant_relative_to(self, other: PathPoint) -> float:
        """Return the determinant of K, relative to its size at another point."""
        (sign, logarithm), (_, reference) = self.determinant, other.determinant
        return sign * float(np.exp(logarithm - reference))

    def chord(self, other: PathPoint) -> Array:
        """Return the difference to another point, (N + 1,)."""
        difference = (other.q - self.q) / self.structure.model.free_scale
        return np.append(difference, (other.factor - self.factor) / self.loading.largest)


@dataclass(frozen=True, eq=False)
class PathStep:
    """One step along a path."""

    end: PathPoint
    critical: PathPoint | None = None  # the critical point on the way, if any
    kind: Literal["limit", "bifurcation"] | None = None  # its kind


def follow_path(point: PathPoint, tangent: Array, step: float, *, regular: bool = True) -> Iterator[PathStep]:
    """Follow a path up to the largest factor, or until no step is short enough; ``regular`` as of ``next_point``."""
    while abs(point.factor) < point.loading.largest and step > TOLERANCE:
        next_step = next_point(point, tangent, step, regular=regular)
        if next_step is None:
            step /= 2
            continue
        points, direction = next_step
        if len(points) == 2:
            yield PathStep(points[1], points[0], "limit" if tangent[-1] * direction[-1] < 0.0 else "bifurcation")
        else:
            yield PathStep(points[0])
        point, tangent, step, regular = points[-1], direction, min(2 * step, longest_step(direction)), True


def null_shape(critical: PathPoint) -> Array:
    """Return the null vector of K at a critical point in all coordinates, (size,); its largest displacement is 1 m."""
    shape = critical.structure.model.with_fixed_base(critical.null_vector())
    places = shape.reshape(-1, NODE)[:, :2]
    return np.asarray(shape / places.flat[np.abs(places).argmax()])


def branch_tangent(bifurcation: PathPoint, shape: Array, side: int) -> Array:
    """Return the tangent at a bifurcation of the path that crosses there, along its null vector (size,) or against."""
    model = bifurcation.structure.model
    direction = side * model.of_free(shape) / model.free_scale
    return np.append(direction / rms(direction), 0.0)


def next_point(point: PathPoint, tangent: Array, step: float, *, regular: bool) -> tuple[list[PathPoint], Array] | None:
    """Return the critical point, if any, and the equilibrium one step along a path, and the tangent at the latter.

    None if the step is too long.  The step ends at the largest factor.  ``regular`` is False at a bifurcation.
    """
    row = _normal(tangent)
    trial = point.at_offset(step * tangent).correct(row)
    if trial is None:
        return None
    try:
        direction = trial.tangent(row)
        critical_count = abs(trial.negative - point.negative) if regular else 0
    except np.linalg.LinAlgError:
        return None
    chord, slopes = point.chord(trial), np.arange(point.at.coordinates.size).reshape(-1, NODE)[:, 2:]
    rotation = np.linalg.norm((trial.at.coordinates - point.at.coordinates)[slopes], axis=1).max()
    rates = np.array([tangent[-1], direction[-1]])
    mismatch = abs(chord[-1] / rms(chord[:-1]) - rates.mean())
    is_smooth = (
        rotation <= MAX_ROTATION
        and abs(chord[-1]) <= 2 * MAX_STEP
        and mismatch <= MAX_MISMATCH * np.abs(rates).max()
        and (critical_count == 1 or (critical_count == 0 and (rates.prod() >= 0.0 or not regular)))
    )
    if is_smooth and abs(trial.factor) > point.loading.largest:
        trial = at_factor(point, trial, math.copysign(point.loading.largest, trial.factor))
    if not is_smooth or trial is None:
        return None
    if not regular or trial.negative == point.negative:
        return [trial], direction
    critical = _critical_between(point, trial, limit=bool(rates.prod() < 0.0))
    return None if critical is None else ([critical, trial], direction)


def longest_step(tangent: Array) -> float:
    """Return the step by which the factor changes by ``LARGEST_STEP``, at most 1."""
    return MAX_STEP / max(abs(float(tangent[-1])), MAX_STEP)


def rms(x: Array) -> float:
    """Return the root mean square."""
    return float(np.linalg.norm(x) / np.sqrt(x.size))


def _normal(direction: Array) -> Array:
    """Return the normal of the planes on which points are sought along a direction."""
    if abs(direction[-1]) > STEEP * rms(direction[:-1]):
        return np.append(np.zeros(direction.size - 1), 1.0)
    return np.append(direction[:-1], 0.0)


def at_factor(first: PathPoint, last: PathPoint, factor: float) -> PathPoint | None:
    """Return the point at a factor between two points of a path; None if Newton's method fails."""
    estimate = _root(first, last, lambda point: point.factor - factor, _normal(first.chord(last)))
    row = np.append(np.zeros(first.q.size), 1.0)
    return estimate and replace(estimate, factor=factor).correct(row)


def _critical_between(first: PathPoint, last: PathPoint, *, limit: bool) -> PathPoint | None:
    """Return the limit point or bifurcation between two points of a path, whose determinants have opposite signs."""
    chord = first.chord(last)
    row = np.append(chord[:-1], 0.0) if limit else _normal(chord)
    return _root(first, last, lambda point: point.determinant_relative_to(last), row, deflate=not limit)


def _root(
    first: PathPoint, last: PathPoint, value: Callable[[PathPoint], float], row: Array, *, deflate: bool = False
) -> PathPoint | None:
    """Return the point between two points of a path at which a value of opposite signs there is zero."""
    chord, point = first.chord(last), last
    (a, b), (low_value, high_value) = (0.0, 1.0), (value(first), value(last))
    for _ in range(60):
        x = b - high_value * (b - a) / (high_value - low_value)
        trial = first.at_offset(x * chord).correct(row, point.null_vector() if deflate else None)
        if trial is None:
            return None
        point, trial_value, change = trial, value(trial), abs(x - b)
        if trial_value * high_value < 0.0:
            a, low_value = b, high_value
        else:
            low_value /= 2
        b, high_value = x, trial_value
        if trial_value == 0.0 or change < TOLERANCE:
            break
    return point
