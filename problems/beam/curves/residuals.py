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
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import Differentiable
from problems.beam.curves.balance import DrivenBalance
from problems.beam.curves.points import Measured, NoMotionError, PointMotion, closest, motion_from_rest

if TYPE_CHECKING:
    from problems.beam.curves.block import CurveBlock

DIFFERENCE = 1e-4  # relative change of a property for its derivative
FAILURES = (NumericsError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class Neighbours:
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
    """The residuals of a block and their Jacobian; the search for every motion starts from its last one.

    Parameters
    ----------
    block : CurveBlock
        The block.
    """

    def __init__(self, block: CurveBlock) -> None:
        self.block = block
        self.failure = ""
        self._last: list[list[PointMotion]] = []
        self._constant: list[DrivenBalance] = []

    def continued(self, before: Responses) -> Responses:
        """Return the residuals, from the last motions of a block with other weights, or fewer modes and harmonics."""
        old, new = before.block, self.block
        if (new.modes, new.harmonics) == (old.modes, old.harmonics):
            self._constant = before._constant
        self._last = [[one.padded(old.modes, new.modes, new.harmonics) for one in own] for own in before._last]
        return self

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name."""
        return self._differentiable(cs.vertcat(*(given[name] for name in self.block.names)))

    def close(self) -> None:
        """Keep the last motions, from which predictions start."""

    @cached_property
    def _differentiable(self) -> Differentiable:
        """The residuals as a CasADi Function of the unknowns, nan where a motion is not found."""
        return Differentiable(self._or_nan, sum(self.block.weights.lengths), len(self.block.names))

    def motions(self, values: Mapping[str, float]) -> list[list[PointMotion]]:
        """Return the motion closest to each point, record by record, for values of the unknowns by name.

        Raises
        ------
        NoMotionError
            If one is not found; the message names it.
        """
        s, balances, found = self.block.shared(values), self._balances(values), []
        for k, (record, points) in enumerate(zip(self.block.records, self.block.measured(values), strict=True)):
            own: list[PointMotion] = []
            for j, point in enumerate(points):
                try:
                    own.append(_motion(balances[k], point, s, self._last[k][j] if self._last else None))
                except FAILURES as error:
                    raise NoMotionError(f"{record.label}, {record.f[j]:.6g} Hz: {error}") from None
            found.append(own)
        self._last = found
        return found

    def at(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n) by the unknowns of the block, for values by name.

        Those that are not given have their guesses.

        Raises
        ------
        NoMotionError
            If a motion is not found.
        """
        motions, points = self.motions(values), self.block.measured(values)
        residuals, jacobians = [], []
        for k, (record, changes) in enumerate(zip(self.block.records, self.sensitivities(values), strict=True)):
            rest, slopes = [], []
            for motion, point, change in zip(motions[k], points[k], changes, strict=True):
                kept = across(motion.slopes / point.deviations, record.control == "response", point.has_phase)
                rest.append(kept @ point.distance(motion.values))
                slopes.append(kept @ (change / point.deviations[:, None]))
            residuals.append(np.array(rest).T.ravel())
            jacobians.append(np.array(slopes).transpose(1, 0, 2).reshape(-1, len(self.block.names)))
        return np.concatenate(residuals), np.concatenate(jacobians)

    def sensitivities(self, values: Mapping[str, float]) -> list[list[Array]]:
        """Return the derivatives of amplitude, phase and excess of the level by the unknowns, (3, n), of last motions.

        The amplitude is held; the excess of the level is l less the level of the point.
        """
        s, neighbours = self.block.shared(values), []
        for name in self.block.of_model:
            above, below = (
                self.block.balances({**values, name: (1 + side * DIFFERENCE) * values[name]}) for side in (1, -1)
            )
            neighbours.append(Neighbours(self.block.names.index(name), 2 * DIFFERENCE * values[name], above, below))
        found = []
        for k, (number, record) in enumerate(self.block.numbered):
            factor = self.block.excitation(number)
            own = zip(self._last[k], 2 * math.pi * record.f, strict=True)
            changes = [self._change(motion, omega, s, [one.of(k) for one in neighbours]) for motion, omega in own]
            if factor:
                for change, level in zip(changes, record.a, strict=True):
                    change[2, self.block.names.index(factor)] -= level
            found.append(changes)
        return found

    def _change(
        self,
        motion: PointMotion,
        omega: float,
        s: Array,
        neighbours: Sequence[tuple[int, float, DrivenBalance, DrivenBalance]],
    ) -> Array:
        """Return the derivatives of amplitude, phase and level of a motion at the same amplitude, (3, n)."""
        forces, polar = np.zeros((len(motion.at.forces), len(self.block.names))), np.zeros((2, len(self.block.names)))
        for own, place, slope in self.block.shared_columns():
            forces[:, place] = slope * motion.at.by_unknowns[:, own]
            polar[:, place] = slope * motion.at.polar_by_unknowns[:, own]
        for place, width, *ends in neighbours:
            above, below = (balance.at(motion.coefficients, motion.level, omega, s) for balance in ends)
            forces[:, place] = (above.forces - below.forces) / width
            polar[:, place] = (above.polar - below.polar) / width
        return motion.sensitivities(forces, polar)

    def _balances(self, values: Mapping[str, float]) -> list[DrivenBalance]:
        """Return the driven beams; they are built anew only if properties change."""
        if self.block.of_model:
            return self.block.balances(values)
        self._constant = self._constant or self.block.balances({})
        return self._constant

    def _or_nan(self, x: Array) -> tuple[Array, Array]:
        """Return residuals and Jacobian; nan where a motion is not found, and keep the reason."""
        try:
            return self.at(dict(zip(self.block.names, x.tolist(), strict=True)))
        except FAILURES as error:
            self.failure = self.failure or str(error)
            m = sum(self.block.weights.lengths)
            return np.full(m, math.nan), np.full((m, len(self.block.names)), math.nan)


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
    u = -u if u @ e < -0.5 else u  # u . e below which -u takes the place of u
    rotation = np.eye(3) - np.outer(u + e, u + e) / (1 + u @ e) + 2 * np.outer(e, u)
    return np.asarray(rotation[[row for row in rows if has_phase or row != 1]])


def _motion(balance: DrivenBalance, point: Measured, s: Array, last: PointMotion | None) -> PointMotion:
    """Return the motion closest to a point, from the last one or, if there is none or that fails, from rest."""
    if last is not None:
        try:
            return closest(balance, point, s, last)
        except FAILURES:
            pass
    return closest(balance, point, s, motion_from_rest(balance, point, s))
