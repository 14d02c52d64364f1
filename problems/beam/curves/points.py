"""Points of a response curve: the steady motion at a frequency that comes closest to a measured point.

At a fixed frequency, the periodic motions (C, l) form a curve in the coefficients C and the level l of the excitation,

    F(C, l) = 0.

Beside a resonance of a beam with large motion it has folds: a level may belong to three motions, and beyond a fold to
none.  The amplitude Y of the response grows along the curve.  With Y as its parameter, the level l(Y) and the phase
phi(Y) are therefore single-valued: the response-controlled form, in which nothing jumps.  From

    [F_C  F_l] [dC]     [0]
    [Y_C  Y_l] [dl]  =  [1] dY

follow l' and phi'.  With the standard deviations of a measured point, m = (Y/s_Y, phi/s_phi, l/s_l), and

    g(Y) = (Y/s_Y, phi(Y)/s_phi, l(Y)/s_l),

the closest point minimises |g(Y) - m|: orthogonal distance regression.  It exists for all values of the unknowns, and
moves smoothly with them, also where a fold has moved past the frequency or the level of the measured point.  Away from
folds, and with a level that is much more certain than the response, the distance is the error of the response.  It also
decides the branch: the one that the measured amplitude is on.

Start.  The linear response at rest, scaled to the measured amplitude, and increased in steps if Newton's method does
not converge from there.  This finds the motions on the curve that begins at rest, and no isola.

References
----------
P. T. Boggs, R. H. Byrd, R. B. Schnabel, A stable and efficient algorithm for nonlinear orthogonal distance regression,
SIAM Journal on Scientific and Statistical Computing 8 (1987).
L. Renson, A. Gonzalez-Buelga, D. A. W. Barton, S. A. Neild, Robust identification of backbone curves using
control-based continuation, Journal of Sound and Vibration 367 (2016), for curves of the level against the response.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.harmonic_balance.fourier import resized
from ancf_casadi.support.arrays import Array
from problems.beam.curves.balance import DrivenBalance, Linearised

POINT_NEWTON_ERROR = 1e-9  # Newton step, relative to the coefficients
POINT_STEP_ERROR = 1e-6  # step along the curve, in standard deviations


class NoMotionError(NumericsError):
    """Raised if no steady motion is found."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured point.

    Parameters
    ----------
    omega : float
        Angular frequency, rad/s.
    values : array (3,)
        Amplitude, phase and level; the phase is nan if it was not measured.
    deviations : array (3,)
        Their standard deviations.
    """

    omega: float
    values: Array
    deviations: Array

    @property
    def has_phase(self) -> bool:
        """True if the phase was measured."""
        return not math.isnan(self.values[1])

    def distance(self, found: Array) -> Array:
        """Return a motion's amplitude, phase and level less those measured, in standard deviations, (3,)."""
        rest = found - self.values
        rest[1] = math.remainder(rest[1], 2 * math.pi) if self.has_phase else 0.0
        return np.asarray(rest / self.deviations)


@dataclass(frozen=True, eq=False)
class PointMotion:
    """A steady motion at the frequency of a measured point.

    Parameters
    ----------
    coefficients : array (d,)
        Fourier coefficients C.
    level : float
        Level l of the excitation.
    at : Linearised
        The balance at this motion.
    """

    coefficients: Array
    level: float
    at: Linearised

    @property
    def values(self) -> Array:
        """Amplitude, phase and level, (3,)."""
        return np.append(self.at.polar, self.level)

    @cached_property
    def tangent(self) -> Array:
        """Derivatives of coefficients and level by the amplitude, (d + 1,)."""
        return np.asarray(_solved(self.at, _along(len(self.coefficients)))[0])

    @property
    def slopes(self) -> Array:
        """Derivatives of amplitude, phase and level by the amplitude, (3,): 1, phi', l'."""
        return _slopes(self.at, self.tangent)

    def padded(self, modes: int, more_modes: int, harmonics: int) -> PointMotion:
        """Return the motion with zeros for modes and harmonics that it does not have, to start from."""
        own = resized(self.coefficients.reshape(-1, modes), harmonics)
        more = np.zeros((len(own), more_modes))
        more[:, :modes] = own
        return PointMotion(more.ravel(), self.level, self.at)

    def sensitivities(self, forces: Array, polar: Array) -> Array:
        """Return the derivatives of amplitude, phase and level by unknowns, at the same amplitude, (3, k).

        Parameters
        ----------
        forces, polar : array (d, k), (2, k)
            Derivatives of the balance and of the reading by the unknowns, at the same coefficients and level.
        """
        if not forces.shape[1]:
            return np.zeros((3, 0))
        change = _solved(self.at, *-np.vstack([forces, polar[:1]]).T).reshape(-1, len(self.coefficients) + 1).T
        phase = polar[1] + self.at.polar_by_coefficients[1] @ change[:-1] + self.at.polar_by_level[1] * change[-1]
        return np.array([np.zeros(len(phase)), phase, change[-1]])


def motion_at(
    balance: DrivenBalance,
    omega: float,
    amplitude: float,
    s: Array,
    near: tuple[Array, float],
    farthest: float = math.inf,
) -> PointMotion:
    """Return the motion with a given amplitude of the reading.

    Parameters
    ----------
    balance : DrivenBalance
        The driven beam.
    omega : float
        Angular frequency, rad/s.
    amplitude : float
        Amplitude of the reading.
    s : array
        Unknowns.
    near : (array, float)
        Coefficients and level to start from.
    farthest : float
        Largest distance of the motion from ``near``, relative; twice this for its level.

    Raises
    ------
    NoMotionError
        If Newton's method does not converge, or moves too far.
    """
    C, level = near
    for _ in range(12):  # Newton steps at a given amplitude
        at = balance.at(C, level, omega, s)
        step = _solved(at, np.append(-at.forces, amplitude - at.polar[0]))[0]
        C, level = C + step[:-1], level + float(step[-1])
        if not np.isfinite(step).all() or not _near(C, level, near, farthest):
            break
        if np.linalg.norm(step[:-1]) <= POINT_NEWTON_ERROR * np.linalg.norm(C):
            return PointMotion(C, level, balance.at(C, level, omega, s))
    raise NoMotionError("Newton's method does not converge to a steady motion")


def motion_from_rest(balance: DrivenBalance, measured: Measured, s: Array) -> PointMotion:
    """Return the motion with the measured amplitude, on the curve that begins at rest.

    Raises
    ------
    NoMotionError
        If the curve cannot be followed, or the sensor does not move.
    """
    goal, omega = float(measured.values[0]), measured.omega
    slight = 1e-9
    rest = balance.at(np.zeros(balance.unknowns), slight, omega, s)
    C = np.asarray(np.linalg.solve(rest.by_coefficients, -rest.forces))
    size = float(balance.at(C, slight, omega, s).polar[0])
    if not size > 0.0:
        raise NoMotionError("the sensor does not move")
    here = (C * 0.0, 0.0, 0.0)  # coefficients, level and amplitude of the last motion
    slope = C / size, slight / size
    step = goal
    while here[2] < goal:
        trial = min(here[2] + step, goal)
        ahead = trial - here[2]
        expected = here[0] + ahead * slope[0], here[1] + ahead * slope[1]
        try:
            # largest change of a motion by Newton's method on the way from rest, relative; twice this for its level
            found = motion_at(balance, omega, trial, s, expected, 0.3)
        except (NoMotionError, np.linalg.LinAlgError):
            step = min(step, ahead) / 2
            # least increase of the amplitude on the way from rest, relative to the measured one
            if step < 1e-4 * goal:
                raise NoMotionError(
                    f"the response cannot be followed beyond the amplitude {here[2]:.3g} of {goal:.3g}"
                ) from None
            continue
        here, step = (found.coefficients, found.level, trial), 2 * step
        slope = found.tangent[:-1], float(found.tangent[-1])
    return found if found.level > 0.0 else _half_period_later(balance, found, omega, s)


def _near(C: Array, level: float, expected: tuple[Array, float], farthest: float) -> bool:
    """Return whether a motion is near the one expected, and not on another curve."""
    moved = float(np.linalg.norm(C - expected[0])) <= farthest * float(np.linalg.norm(C))
    return moved and abs(level - expected[1]) <= 2 * farthest * max(abs(level), abs(expected[1]))


def _half_period_later(balance: DrivenBalance, motion: PointMotion, omega: float, s: Array) -> PointMotion:
    """Return the same motion with a level of the other sign: the time begins half a period later."""
    signs = (-1.0) ** balance.fourier.orders
    C, level = (signs[:, None] * motion.coefficients.reshape(len(signs), -1)).ravel(), -motion.level
    return PointMotion(C, level, balance.at(C, level, omega, s))


def closest(balance: DrivenBalance, measured: Measured, s: Array, near: PointMotion) -> PointMotion:
    """Return the motion closest to a measured point, from one nearby.

    Raises
    ------
    NoMotionError
        If the search does not converge.
    """
    quick = _quickly(balance, measured, s, near)
    return quick or _carefully(balance, measured, s, near)


def _quickly(balance: DrivenBalance, measured: Measured, s: Array, near: PointMotion) -> PointMotion | None:
    """Return the closest motion by Newton's method for motion and amplitude at once; None if steps are not small."""
    C, level, last = near.coefficients, near.level, None
    for _ in range(8):  # steps of the quick search
        at = balance.at(C, level, measured.omega, s)
        correction, tangent = _solved(at, np.append(-at.forces, 0.0), _along(len(C)))
        values, slopes = np.append(at.polar, level), _slopes(at, tangent)
        along, size = _step(measured, values, slopes, last)
        last = values[0], slopes
        moved = float(np.linalg.norm(correction[:-1] + along * tangent[:-1]) / np.linalg.norm(C))
        if not moved <= 0.05:  # relative to the coefficients
            return None
        step = correction + along * tangent
        C, level = C + step[:-1], level + float(step[-1])
        if (
            np.linalg.norm(correction[:-1]) <= POINT_NEWTON_ERROR * np.linalg.norm(C)
            and abs(along) * size <= POINT_STEP_ERROR
        ):
            return PointMotion(C, level, balance.at(C, level, measured.omega, s))
    return None


def _carefully(balance: DrivenBalance, measured: Measured, s: Array, near: PointMotion) -> PointMotion:
    """Return the closest motion by steps along the curve, each of which reduces the distance."""
    here = motion_at(balance, measured.omega, float(near.values[0]), s, (near.coefficients, near.level))
    last: tuple[float, Array] | None = None
    for _ in range(60):  # steps along the curve to the closest point
        values, slopes = here.values, here.slopes
        along, size = _step(measured, values, slopes, last)
        if abs(along) * size <= POINT_STEP_ERROR:
            return here
        last = float(values[0]), slopes
        # longest step along the curve, relative to the amplitude, and as a phase, rad
        farthest = min(0.2 * values[0], 0.3 / max(abs(slopes[1]), np.finfo(float).tiny))
        along = math.copysign(min(abs(along), farthest), along)
        here = _nearer(balance, measured, s, here, along)
    raise NoMotionError("the motion closest to the measured point is not found")


def _nearer(balance: DrivenBalance, measured: Measured, s: Array, here: PointMotion, along: float) -> PointMotion:
    """Return the motion after a step of the amplitude, which is halved until the distance decreases."""
    distance = float(np.sum(measured.distance(here.values) ** 2))
    for _ in range(12):  # halvings of a step along the curve
        near = here.coefficients + along * here.tangent[:-1], here.level + along * float(here.tangent[-1])
        try:
            found = motion_at(balance, measured.omega, float(here.values[0]) + along, s, near)
        except (NoMotionError, np.linalg.LinAlgError):
            found = None
        # relative increase of a squared distance that counts as none
        if found is not None and float(np.sum(measured.distance(found.values) ** 2)) <= distance * (1 + 1e-12):
            return found
        along /= 2
    raise NoMotionError("the curve cannot be followed to the measured point")


def _step(measured: Measured, values: Array, slopes: Array, last: tuple[float, Array] | None) -> tuple[float, float]:
    """Return the step of the amplitude towards the closest point, and the size of a unit step in standard deviations.

    Newton's method with the curvature l'' from the last two points, where this increases the second derivative.
    """
    distance, slope = measured.distance(values), slopes / measured.deviations
    slope[1] = slope[1] if measured.has_phase else 0.0
    gradient, second = float(distance @ slope), float(slope @ slope)
    if last is not None and last[0] != values[0]:
        curvature = (slopes - last[1]) / (values[0] - last[0]) / measured.deviations
        second += max(0.0, float(curvature[2] * distance[2]))
    return -gradient / second, math.sqrt(float(slope @ slope))


def _along(size: int) -> Array:
    return np.append(np.zeros(size), 1.0)


def _solved(at: Linearised, *columns: Array) -> Array:
    """Return the solutions of the bordered system for right sides (d + 1,), as rows."""
    top = np.column_stack([at.by_coefficients, at.by_level])
    bottom = np.append(at.polar_by_coefficients[0], at.polar_by_level[0])
    scale = np.abs(top).max(axis=1)
    sides = np.column_stack(columns) / np.append(scale, 1.0)[:, None]
    return np.asarray(np.linalg.solve(np.vstack([top / scale[:, None], bottom]), sides).T)


def _slopes(at: Linearised, tangent: Array) -> Array:
    phase = at.polar_by_coefficients[1] @ tangent[:-1] + at.polar_by_level[1] * tangent[-1]
    return np.array([1.0, phase, tangent[-1]])
