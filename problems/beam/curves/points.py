"""Points of a response curve: the steady motion at a frequency that comes closest to a measured point.

At a fixed frequency, the periodic motions (C, l) form a curve in the coefficients C and the level l of the excitation,

    F(C, l) = 0.

Beside a resonance of a beam with large motion it has folds: a level may belong to three motions, and beyond a fold to
none.  The amplitude Y of the response grows along the curve.  With Y as its parameter, the level l(Y) and the phase
phi(Y) are therefore single-valued: the response-controlled form, in which nothing jumps.  From

    [F_C  F_l] [dC]     [0]
    [Y_C  Y_l] [dl]  =  [1] dY

follow l' and phi'; the second equation is also the row of Newton's method (``harmonic_balance.family``).  With the
standard deviations of a measured point, m = (Y/s_Y, phi/s_phi, l/s_l), and

    g(Y) = (Y/s_Y, phi(Y)/s_phi, l(Y)/s_l),

the closest point minimises |g(Y) - m|: orthogonal distance regression.  It exists for all values of the unknowns, and
moves smoothly with them, also where a fold has moved past the frequency or the level of the measured point.  Away from
folds, and with a level that is much more certain than the response, the distance is the error of the response.  It also
decides the branch: the one that the measured amplitude is on.

Start.  The curve is followed from the linear response at rest to the measured amplitude, by the continuation of
``ancf_casadi.response``.  This finds the motions on the curve that begins at rest, and no isola.

References
----------
P. T. Boggs, R. H. Byrd, R. B. Schnabel, A stable and efficient algorithm for nonlinear orthogonal distance regression,
SIAM Journal on Scientific and Statistical Computing 8 (1987).
L. Renson, A. Gonzalez-Buelga, D. A. W. Barton, S. A. Neild, Robust identification of backbone curves using
control-based continuation, Journal of Sound and Vibration 367 (2016), for curves of the level against the response.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.harmonic_balance.continuation import point_at
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.onset import crossing, linear_response, small_motion_at
from ancf_casadi.support.arrays import Array
from problems.beam.curves.driven import Driven

MOST_STEPS = 60  # of the search for the closest points
POINTS_CLOSE = 1e-6  # step along a curve, in standard deviations, at which the search ends
# shares of the measured amplitude at which the continuation from rest begins: the first where the response is nearly
# linear; with friction, which holds a small motion, only the smaller ones are (test_laws_are_told_apart)
FIRST_SHARES = (0.1, 1e-2, 1e-3, 1e-4, 1e-6)

# amplitude, phase and level of the computed points of a record, and their derivatives by the parameter of the curve
CurvePoints = tuple[Array, Array]  # (m, 3) each


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured point, or the m points of a record, whose arrays then begin with m."""

    omega: Any  # rad/s, one or (m,)
    values: Array  # amplitude, phase and level, (..., 3); the phase is nan if it was not measured
    deviations: Array  # standard deviations of the values, (..., 3)

    @property
    def has_phase(self) -> bool:
        """True if the phase was measured."""
        return not np.isnan(self.values[..., 1]).any()

    def distance(self, values: Array) -> Array:
        """Return amplitude, phase and level of motions less those measured, in standard deviations, (..., 3)."""
        difference, turn = values - self.values, 2 * math.pi
        difference[..., 1] = difference[..., 1] - turn * np.round(difference[..., 1] / turn) if self.has_phase else 0.0
        return np.asarray(difference / self.deviations)

    def step(self, values: Array, slopes: Array, bends: Array, least_share: float) -> tuple[Array, Array]:
        """Return Newton's steps of the parameter of a curve to the closest motions, and their sizes in deviations.

        The motions have the values and their first and second derivatives, (..., 3).  The second derivative of half the
        squared distance counts as no less than ``least_share`` times that of a straight curve.
        """
        difference, slope = self.distance(values), slopes / self.deviations
        if not self.has_phase:
            slope[..., 1] = 0.0
        square = np.sum(slope**2, axis=-1)
        second = np.maximum(square + np.sum(bends / self.deviations * difference, axis=-1), least_share * square)
        step = -np.sum(slope * difference, axis=-1) / second
        return step, np.abs(step) * np.sqrt(square)

    def each(self) -> list[Measured]:
        """Return the points of a record."""
        return [Measured(*point) for point in zip(np.atleast_1d(self.omega), self.values, self.deviations, strict=True)]


@dataclass(frozen=True, eq=False)
class PointMotion:
    """A steady motion at the frequency of a measured point."""

    driven: Driven
    point: Point  # of the curve at the frequency

    @cached_property
    def values(self) -> Array:
        """Amplitude, phase and level, (3,)."""
        return np.append(self.reading[0], self.point.z[-1] / self.driven.drive.amplitude)

    @property
    def level(self) -> float:
        """Level l of the excitation."""
        return float(self.values[2])

    @cached_property
    def reading(self) -> tuple[Array, Array, Array]:
        """Amplitude and phase, (2,), and their derivatives by the unknowns z and s."""
        return self.driven.read(self.point.family, self.point.z)

    @cached_property
    def bordered(self) -> Point:
        """The point with the direction of increasing amplitude as its row."""
        row = self.reading[1][0] * self.point.family.scale
        return replace(self.point, row=row / np.linalg.norm(row))

    @cached_property
    def tangent(self) -> Array:
        """Derivatives of the unknowns z by the amplitude, (d + 1,)."""
        return self._solve(np.zeros((len(self.point.z) - 1, 1)), np.ones(1))[:, 0]

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of amplitude, phase and level by the amplitude, (3,): 1, phi', l'."""
        return np.array([1.0, self.reading[1][1] @ self.tangent, self.tangent[-1] / self.driven.drive.amplitude])

    def sensitivities(self, forces: Array, polar: Array) -> Array:
        """Return the derivatives of amplitude, phase and level by unknowns, at the same amplitude, (3, k)."""
        change = self._solve(-forces, -polar[0])
        phase = polar[1] + self.reading[1][1] @ change
        return np.array([np.zeros(len(phase)), phase, change[-1] / self.driven.drive.amplitude])

    def advance(self, along: float) -> PointMotion:
        """Return the motion on the curve whose amplitude is larger by about a step; raise NotFound if there is none."""
        bordered = self.bordered
        return PointMotion(
            self.driven, point_at(bordered.family, bordered.z + along * self.tangent, bordered.row, bordered)
        )

    def _solve(self, forces: Array, amplitudes: Array) -> Array:
        """Return the changes (d + 1, k) of z that change the balance (d, k) and the amplitude (k,)."""
        scale = self.point.family.scale
        along = amplitudes / np.linalg.norm(self.reading[1][0] * scale)
        return np.asarray(scale[:, None] * self.bordered.solve(np.vstack([forces, along])))


def motion_from_rest(driven: Driven, measured: Measured, s: Array) -> PointMotion:
    """Return a motion with nearly the measured amplitude, on the curve that begins at rest."""
    goal, curve, size = float(measured.values[0]), driven.curve(measured.omega, s), driven.drive.amplitude
    response, slight = linear_response(curve.balance, measured.omega), 1e-9 * size
    z = curve.join(response[0] + slight * response[1], replace(curve.setting, amplitude=slight))
    amplitude = float(driven.read(curve, z)[0][0]) / slight
    if not amplitude > 0.0:
        raise NumericsError("the sensor does not move")

    def amplitude_at(point: Point) -> float:
        return float(driven.read(point.family, point.z)[0][0])

    for share in FIRST_SHARES:
        level = share * goal / amplitude
        try:
            first = small_motion_at(curve.balance, measured.omega, response, level, size, math.inf)
        except NumericsError:
            continue
        if abs(amplitude_at(first) / (share * goal) - 1) <= 0.1:
            break
    else:
        raise NumericsError("no small motion near rest is found")

    def longest(point: Point, tangent: Array) -> float:
        (amplitude_there, _), by_z, _ = driven.read(point.family, point.z)
        rate = float(by_z[0] @ (tangent * point.family.scale))
        return (goal - amplitude_there) / rate if rate > 0.0 else math.inf

    # the search for the closest point needs the amplitude to a few per cent
    step = crossing(first, first.row, lambda point: amplitude_at(point) / goal - 0.98, math.inf, longest)
    if step is None:
        raise NumericsError(f"the response cannot be followed to the amplitude {goal:.3g}")
    motion = PointMotion(driven, step.end)
    return motion if motion.level > 0.0 else _half_period_later(motion)


def _half_period_later(motion: PointMotion) -> PointMotion:
    """Return the same motion with a level of the other sign: the time begins half a period later."""
    family, setting = motion.point.family, motion.point.setting
    C = (-1.0) ** family.balance.fourier.orders[:, None] * motion.point.coefficients
    z = family.join(C, replace(setting, amplitude=-setting.amplitude))
    return PointMotion(motion.driven, family.at(z, motion.point.row))


def closest(driven: Driven, measured: Measured, s: Array, start: PointMotion) -> PointMotion:
    """Return the motion closest to a measured point, from one nearby, by steps that each reduce the distance.

    ``values`` are amplitude, phase and level l, ``slopes`` their derivatives by the amplitude.  The curvature l'' is
    that of the last two points, and counts where it increases the second derivative.
    """
    try:
        motion = _transfer_motion(driven, driven.curve(measured.omega, s), start)
    except NotFound:
        raise NumericsError("Newton's method does not converge to a steady motion") from None
    bends = np.zeros(3)
    for _ in range(MOST_STEPS):
        values, slopes = motion.values, motion.slopes
        along, size = map(float, measured.step(values, slopes, bends, 1.0))
        if size <= POINTS_CLOSE:
            return motion
        # longest step along the curve, relative to the amplitude, and as a phase, rad
        farthest = min(0.2 * values[0], 0.3 / max(abs(slopes[1]), np.finfo(float).tiny))
        motion = _nearer(measured, motion, math.copysign(min(abs(along), farthest), along))
        moved = float(motion.values[0] - values[0])
        bends[2] = (motion.slopes[2] - slopes[2]) / moved if moved else 0.0
    raise NumericsError("the motion closest to the measured point is not found")


def _transfer_motion(driven: Driven, curve: Family, start: PointMotion) -> PointMotion:
    """Return the motion on a curve near one on another, which may have fewer modes and harmonics."""

    def pad(vector: Array) -> Array:
        coefficients, setting = start.point.family.split(vector)
        C = np.zeros((curve.balance.fourier.size, curve.balance.system.size))
        C[: len(coefficients), : coefficients.shape[1]] = coefficients
        return curve.join(C, setting)

    z, row = pad(start.point.z), pad(start.bordered.row)
    curve = replace(curve, size=start.point.family.size)
    return PointMotion(driven, point_at(curve, z, row, start.point if len(z) == len(start.point.z) else None))


def _nearer(measured: Measured, motion: PointMotion, along: float) -> PointMotion:
    """Return the motion after a step of the amplitude, which is halved until the distance decreases."""
    distance = float(np.sum(measured.distance(motion.values) ** 2))
    for _ in range(12):  # halvings of a step along the curve
        try:
            trial = motion.advance(along)
        except NotFound:
            trial = None
        # relative increase of a squared distance that counts as none
        if trial is not None and float(np.sum(measured.distance(trial.values) ** 2)) <= distance * (1 + 1e-9):
            return trial
        along /= 2
    raise NumericsError("the curve cannot be followed to the measured point")
