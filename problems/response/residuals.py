"""The residuals between measured response curves and the steady motion of the beam, with their derivatives.

The residuals of a point are its distance to the curve of motions at its frequency (``points``), in the plane across the
curve.  With the unit vector u along g'(Y), and the unit vector e along the controlled quantity, the rotation that takes
u to e by the shortest way,

    T = I - (u + e)(u + e)^T/(1 + u . e) + 2 e u^T,

takes this plane to that of the other two quantities.  The residuals are these two components of T (g - m): away from
folds, where the controlled quantity is certain, the errors of amplitude and phase.  Without a phase there is only one.

At the closest point g - m has no component along u, and a change of Y moves g along u.  The derivatives of the
residuals by the unknowns therefore are the components of T dg/dx at fixed Y (variable projection); the gradient of the
sum of squares is exact.

Properties, tip mass and clamp enter the constants of the reduced model, except for the elastic modulus if the damping
does not contain it.  The derivatives of F and of the reading by
these are central differences at fixed coefficients, between two models at the relative distances ``DIFFERENCE``; all
other derivatives are exact.

References
----------
L. Kaufman, A variable projection method for solving separable nonlinear least squares problems, BIT 15 (1975).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import Differentiable
from problems.response.balance import DrivenBalance
from problems.response.points import Measured, Motion, NoMotionError, closest, motion_from_rest
from problems.response.problem import ResponseProblem
from problems.response.unknowns import excitation_name

DIFFERENCE = 1e-4  # relative change of a property for its derivative
OPPOSITE = -0.5  # u . e below which -u takes the place of u
FAILURES = (NumericsError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class Beside:
    """The driven beam of each record with a property a little larger and a little smaller.

    Parameters
    ----------
    place : int
        Place of the property among the unknowns.
    width : float
        Difference of the two values.
    above, below : list of DrivenBalance
        The driven beams.
    """

    place: int
    width: float
    above: list[DrivenBalance]
    below: list[DrivenBalance]

    def of(self, record: int) -> tuple[int, float, DrivenBalance, DrivenBalance]:
        """Return place, difference, and the two driven beams of a record."""
        return self.place, self.width, self.above[record], self.below[record]


class Responses:
    """The weighted residuals of a problem and their Jacobian; the search for every motion starts from its last one.

    Parameters
    ----------
    problem : ResponseProblem
        The problem.
    names : sequence of str
        The unknowns.
    """

    def __init__(self, problem: ResponseProblem, names: Sequence[str]) -> None:
        self.problem, self.names = problem, tuple(names)
        self.failure = ""
        self._last: list[list[Motion]] = []
        self._constant: list[DrivenBalance] = []

    def continued(self, problem: ResponseProblem, names: Sequence[str]) -> Responses:
        """Return the residuals of a problem with other weights or more modes and harmonics, from the last motions."""
        other = Responses(problem, names)
        if (problem.modes, problem.harmonics) == (self.problem.modes, self.problem.harmonics):
            other._constant = self._constant
        other._last = [
            [one.padded(self.problem.modes, problem.modes, problem.harmonics) for one in own] for own in self._last
        ]
        return other

    @cached_property
    def differentiable(self) -> Differentiable:
        """The residuals as a CasADi Function of the unknowns, nan where a motion is not found; keep a reference."""
        return Differentiable(self._or_nan, sum(self.problem.weights.lengths), len(self.names))

    @cached_property
    def properties(self) -> tuple[str, ...]:
        """The unknowns that change the constants of the reduced model."""
        return tuple(name for name in self.names if name in self.problem.of_model)

    def motions(self, values: Mapping[str, float]) -> list[list[Motion]]:
        """Return the motion closest to each point, record by record, for values of the unknowns by name.

        Raises
        ------
        NoMotionError
            If one is not found; the message names it.
        """
        s, balances, found = self.problem.shared(values), self._balances(values), []
        for k, (record, points) in enumerate(zip(self.problem.records, self.problem.measured(values), strict=True)):
            own: list[Motion] = []
            for j, point in enumerate(points):
                try:
                    own.append(_motion(balances[k], point, s, self._last[k][j] if self._last else None))
                except FAILURES as error:
                    raise NoMotionError(f"{record.label}, {record.f[j]:.6g} Hz: {error}") from None
            found.append(own)
        self._last = found
        return found

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n), at values of the unknowns (n,).

        Raises
        ------
        NoMotionError
            If a motion is not found.
        """
        return self.at(dict(zip(self.names, x.tolist(), strict=True)))

    def at(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n) by the unknowns of ``names``, for values by name.

        Those that are not given have their guesses.

        Raises
        ------
        NoMotionError
            If a motion is not found.
        """
        motions, points = self.motions(values), self.problem.measured(values)
        residuals, jacobians = [], []
        for k, (record, changes) in enumerate(zip(self.problem.records, self.sensitivities(values), strict=True)):
            rest, slopes = [], []
            for motion, point, change in zip(motions[k], points[k], changes, strict=True):
                kept = across(motion.slopes / point.deviations, record.control == "response", point.has_phase)
                rest.append(kept @ point.distance(motion.values))
                slopes.append(kept @ (change / point.deviations[:, None]))
            residuals.append(np.array(rest).T.ravel())
            jacobians.append(np.array(slopes).transpose(1, 0, 2).reshape(-1, len(self.names)))
        scale = self.problem.weights.scale
        return scale * np.concatenate(residuals), scale * np.concatenate(jacobians)

    def sensitivities(self, values: Mapping[str, float]) -> list[list[Array]]:
        """Return the derivatives of amplitude, phase and excess of the level by ``names``, (3, n), of the last motions.

        The amplitude is held; the excess of the level is l less the level of the point.
        """
        s, beside = self.problem.shared(values), []
        for name in self.properties:
            above, below = (
                self.problem.balances({**values, name: (1 + side * DIFFERENCE) * values[name]}) for side in (1, -1)
            )
            beside.append(Beside(self.names.index(name), 2 * DIFFERENCE * values[name], above, below))
        found = []
        for k, record in enumerate(self.problem.records):
            factor = excitation_name(k, self.problem.excitation)
            own = zip(self._last[k], 2 * math.pi * record.f, strict=True)
            changes = [self._change(motion, omega, s, [one.of(k) for one in beside]) for motion, omega in own]
            if factor in self.names:
                for change, level in zip(changes, record.a, strict=True):
                    change[2, self.names.index(factor)] -= level
            found.append(changes)
        return found

    def _change(
        self,
        motion: Motion,
        omega: float,
        s: Array,
        beside: Sequence[tuple[int, float, DrivenBalance, DrivenBalance]],
    ) -> Array:
        """Return the derivatives of amplitude, phase and level of a motion at the same amplitude, (3, n)."""
        forces, polar = np.zeros((len(motion.at.forces), len(self.names))), np.zeros((2, len(self.names)))
        for own, place in self.problem.shared_columns(self.names):
            forces[:, place], polar[:, place] = motion.at.by_unknowns[:, own], motion.at.polar_by_unknowns[:, own]
        for place, width, *ends in beside:
            above, below = (balance.at(motion.coefficients, motion.level, omega, s) for balance in ends)
            forces[:, place] = (above.forces - below.forces) / width
            polar[:, place] = (above.polar - below.polar) / width
        return motion.sensitivities(forces, polar)

    def _balances(self, values: Mapping[str, float]) -> list[DrivenBalance]:
        """Return the driven beams; they are built anew only if properties change."""
        if self.properties:
            return self.problem.balances(values)
        self._constant = self._constant or self.problem.balances({})
        return self._constant

    def _or_nan(self, x: Array) -> tuple[Array, Array]:
        """Return residuals and Jacobian; nan where a motion is not found, and keep the reason."""
        try:
            return self(x)
        except FAILURES as error:
            self.failure = self.failure or str(error)
            m = sum(self.problem.weights.lengths)
            return np.full(m, math.nan), np.full((m, len(self.names)), math.nan)


def across(slope: Array, response_controlled: bool, has_phase: bool) -> Array:
    """Return the rows of the rotation T that take the plane across a curve to its residuals, (2, 3) or (1, 3).

    Parameters
    ----------
    slope : array (3,)
        Direction of the curve: derivatives of amplitude, phase and level over their standard deviations.
    response_controlled : bool
        Whether the amplitude, and not the level, was controlled.
    has_phase : bool
        Whether the phase was measured.
    """
    rows = (2, 1) if response_controlled else (0, 1)
    e = np.array([1.0, 0.0, 0.0]) if response_controlled else np.array([0.0, 0.0, 1.0])
    u = slope * np.array([1.0, float(has_phase), 1.0])
    u = u / np.linalg.norm(u)
    u = -u if u @ e < OPPOSITE else u
    rotation = np.eye(3) - np.outer(u + e, u + e) / (1 + u @ e) + 2 * np.outer(e, u)
    return np.asarray(rotation[[row for row in rows if has_phase or row != 1]])


def _motion(balance: DrivenBalance, point: Measured, s: Array, last: Motion | None) -> Motion:
    """Return the motion closest to a point, from the last one or, if there is none or that fails, from rest."""
    if last is not None:
        try:
            return closest(balance, point, s, last)
        except FAILURES:
            pass
    return closest(balance, point, s, motion_from_rest(balance, point, s))
