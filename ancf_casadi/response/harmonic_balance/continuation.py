"""Pseudo-arclength continuation of a curve of periodic motions, through folds.

From a point z_0 with the unit tangent t, in scaled unknowns (``family``), the next point fulfils

    t . (z - z_0)/s = h,        guess z_0 + h s t,

which is regular at folds, where the curve turns in frequency.  The step h follows the angle between successive
tangents, or twice that between a tangent and the chord, and is halved where Newton's method fails or the angle is
large: a step across a resonance meets the curve again, with a similar tangent but a long chord.  At each point the
numbers of harmonics and samples are increased until the estimated error (``balance``) is below the tolerance.

References
----------
R. Seydel, Practical Bifurcation and Stability Analysis, Springer (2010), Chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.harmonic_balance.balance import (
    FIRST_HARMONICS,
    MOST_HARMONICS,
    MOST_PERIOD_SAMPLES,
    initial_samples,
    motion_size,
)
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point, solve
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.progress import count_step

SMALLEST_SIZE = 1e-12  # of a motion, relative to the scale of the system
ZERO_TOLERANCE = 1e-9  # of the interval around a zero, relative to the step


@dataclass(frozen=True, eq=False)
class ContinuationStep:
    """A step of the continuation."""

    start: Point
    tangent: Array  # unit tangent at the start
    length: float  # arclength h
    end: Point
    end_tangent: Array


def point_at(family: Family, guess: Array, row: Array, nearby: Point | None = None) -> Point:
    """Return the point with row . (z - guess)/s = 0, with enough harmonics and samples.

    Raise NotFound if Newton's method does not converge, and NumericsError if the motion needs too many harmonics.
    """
    coarser: Point | None = None
    while True:
        count_step()
        z, series = solve(family, guess, row, nearby), family.balance.fourier
        family = replace(family, size=max(motion_size(family.balance, family.split(z)[0]), SMALLEST_SIZE))
        point = family.at(z, row)
        if math.isinf(family.tolerance):
            return point
        errors = point.errors
        if not np.isfinite(errors.largest):
            raise NotFound
        # an error that does not decrease by half is due to rounding
        if coarser and 0.5 * coarser.errors.largest < errors.largest <= family.rounding:
            return coarser
        coarser = point
        if errors.largest <= family.tolerance:
            return coarser
        harmonics, samples = series.harmonics, series.samples
        if errors.harmonics > family.tolerance:
            harmonics += max(2, harmonics // 3)
            samples = max(samples, initial_samples(harmonics))
        if errors.samples > family.tolerance:
            samples *= 2
        if harmonics > MOST_HARMONICS or samples > MOST_PERIOD_SAMPLES:
            raise NumericsError(
                f"the motion needs more than {MOST_HARMONICS} harmonics or {MOST_PERIOD_SAMPLES} samples per period: "
                f"its error is {errors.largest:.1g}; use a larger tolerance, a smoother force, or more damping of the "
                "high modes"
            )
        guess, row, nearby = family.resize(z, harmonics), family.resize(row, harmonics), None
        family = family.with_series(harmonics, samples)


def follow(
    start: Point,
    direction: Array,
    first_step: float,
    longest: Callable[[Point, Array], float] = lambda point, tangent: math.inf,
) -> Iterator[ContinuationStep]:
    """Yield the steps along a curve, at first along the tangent that has a positive product with the direction.

    ``longest`` gives the largest arclength of a step from a point with a tangent.
    """
    point, tangent, length = start, start.tangent(direction), first_step
    while True:
        length = min(length, longest(point, tangent))
        try:
            end = step_along(point, tangent, length)
        except NotFound:
            angle = np.inf
        else:
            old_tangent = transfer_vector(tangent, point, end)
            new_tangent = end.tangent(old_tangent)
            turn = 2 * np.arcsin(min(float(np.linalg.norm(new_tangent - old_tangent)) / 2, 1.0))
            angle = max(turn, 2 * _chord_angle(point, tangent, end))  # equal on a circle
        if angle > 0.6:  # rad; beyond it, a step may have left the curve
            length /= 2
            if length < 1e-7:
                raise NumericsError(
                    f"the curve cannot be followed beyond {describe_setting(point)}: no step is short enough there"
                )
            continue
        yield ContinuationStep(point, tangent, length, end, new_tangent)
        point = _drop_harmonics(end, new_tangent)
        tangent = transfer_vector(new_tangent, end, point)
        # the step aims at an angle of 0.25 rad between successive tangents
        length = min(length * min(2.0, max(0.5, 0.25 / max(angle, 1e-3))), 4.0)


def _chord_angle(start: Point, tangent: Array, end: Point) -> float:
    """Return the angle between the tangent at the start of a step and the chord to its end, rad."""
    step = chord(start, end)
    ahead = tangent @ step
    return float(np.arctan2(np.linalg.norm(step - ahead * tangent), ahead))


def chord(start: Point, end: Point) -> Array:
    """Return the vector from one point to another in the scaled unknowns of the first."""
    family = start.family
    return np.asarray((end.family.resize(end.z, family.balance.fourier.harmonics) - start.z) / family.scale)


def step_along(point: Point, tangent: Array, length: float) -> Point:
    """Return the point at an arclength along the tangent; raise NotFound if Newton's method does not converge."""
    family = point.family
    guess = family.add_change(point.z, length * family.scale * tangent)
    try:
        return point_at(family, guess, tangent, point)
    except NotFound:
        if family.balance.system.corrections is None:
            raise
        return point_at(family, guess, tangent)


def locate_zero(step: ContinuationStep, test: Callable[[Point, Array], float]) -> Point:
    """Return the zero of a test function of point and tangent within a step; its signs at the ends must differ.

    Raise NotFound if Newton's method does not converge.
    """
    start_value, end_value = test(step.start, step.tangent), test(step.end, step.end_tangent)
    value_scale, shortest, retained = max(abs(start_value), abs(end_value)), ZERO_TOLERANCE * step.length, ""
    for _ in range(30):
        length = step.length * start_value / (start_value - end_value)
        zero = step_along(step.start, step.tangent, length)
        tangent = zero.tangent(transfer_vector(step.tangent, step.start, zero))
        value = test(zero, tangent)
        if step.length <= shortest or abs(value) <= ZERO_TOLERANCE * value_scale:
            break
        if (value > 0.0) == (end_value > 0.0):  # the Illinois method halves the value at an end that is kept twice
            start_value, end_value, retained = start_value / (2 if retained == "start" else 1), value, "start"
            step = replace(step, length=length, end=zero, end_tangent=tangent)
        else:
            start_value, end_value, retained = value, end_value / (2 if retained == "end" else 1), "end"
            ahead = float(tangent @ chord(zero, step.end))
            step = ContinuationStep(zero, tangent, ahead, step.end, step.end_tangent)
    return zero


def transfer_vector(vector: Array, old: Point, new: Point) -> Array:
    """Return a vector in the scaled unknowns of the old point in those of the new point, normalised."""
    transferred = old.family.resize(vector * old.family.scale, new.family.balance.fourier.harmonics) / new.family.scale
    return np.asarray(transferred / np.linalg.norm(transferred))


def _drop_harmonics(point: Point, tangent: Array) -> Point:
    """Return the point without its two highest harmonics if they are far below the tolerance."""
    balance, series, tolerance = point.family.balance, point.family.balance.fourier, point.family.tolerance
    highest = float((np.abs(point.coefficients[-4:]) / balance.system.scale).max()) / point.family.size
    # size of the two highest harmonics, relative to the tolerance, at which they are dropped
    if math.isinf(tolerance) or series.harmonics <= FIRST_HARMONICS or highest > 2e-2 * tolerance:
        return point
    harmonics = series.harmonics - 2
    family = point.family.with_series(harmonics, max(initial_samples(harmonics), series.samples // 2))
    z, row = (point.family.resize(vector, harmonics) for vector in (point.z, tangent))
    try:
        return point_at(family, z, row)
    except NotFound:
        return point


def describe_setting(point: Point) -> str:
    """Describe the free entries of the setting for a message."""
    free = ((name, getattr(point.setting, name)) for name in point.family.free)
    return ", ".join(f"{x / (2 * np.pi):.6g} Hz" if name == "omega" else f"{name} = {x:.4g}" for name, x in free)
