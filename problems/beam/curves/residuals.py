"""The residuals between measured response curves and the steady motion of the beam, their derivatives, predictions.

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
does not contain it.  The derivatives of F and of the reading by these are central differences at fixed coefficients,
between two models at the relative distances ``DIFFERENCE``; all other derivatives are exact.

Weights.  A record has standard deviations of its amplitudes, phases and levels (``ResponseRecord.stds``).  Those that
were not given are proportions: a first fit takes them as they are, and the root mean square of its residuals gives one
factor c for the amplitudes and levels of all records of one sensor, and one for their phases; a second fit uses these
(iteratively reweighted least squares).  A factor of its own for each record would follow the scatter of a few points,
and make the intervals too narrow.  The fit weighs the residuals, distances in units of c s, by the geometric mean G of
the factors (``ancf_casadi.estimation.solve``).

Prediction.  At the level of the excitation, the amplitude and phase of a point are those of a motion on the branch of
the curve that the measured amplitude is nearest to.  With the derivatives at fixed amplitude, and l' = dl/dY,

    dY/dx = -(dl/dx)/l',    dphi/dx = phi_x + phi' dY/dx        at fixed level.

With the covariance C of the estimates and the rows J of these derivatives, the standard errors of the prediction are
diag(J C J')^1/2, to first order.  Beyond a jump no motion has the level; the motion at the jump takes its place,
without a standard error, and a warning says so.

References
----------
L. Kaufman, A variable projection method for solving separable nonlinear least squares problems, BIT 15 (1975).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import SeriesWeights
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.exceptions import FitError, NumericsError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.callbacks import Differentiable
from problems.beam.curves.driven import Driven
from problems.beam.curves.points import Measured, NoMotionError, PointMotion, closest, motion_from_rest
from problems.beam.curves.record import ResponseRecord

if TYPE_CHECKING:
    from problems.beam.curves.block import CurveBlock

DIFFERENCE = 1e-4  # relative change of a property for its derivative
FREE = (1e4, 1e4, 1.0)  # factors on the standard deviations of a prediction, in which the level decides


def first_weights(records: Sequence[ResponseRecord]) -> SeriesWeights:
    """Return the factors c of the amplitudes and, if they were measured, of the phases of each record before a fit."""
    lengths: list[int] = []
    groups: dict[tuple[object, ...], list[int]] = {}
    known: list[bool] = []
    for record in records:
        measured = record.level_std if record.control == "response" else record.amplitude_std
        given = measured, record.phase_std
        for row in range(1 if record.phases is None else 2):
            kind = (record.sensor, record.control, *(own is None for own in given), row)
            if kind not in groups:
                known.append(given[row] is not None)
            groups.setdefault(kind, []).append(len(lengths))
            lengths.append(record.f.size)
    return SeriesWeights(
        lengths=np.array(lengths),
        deviations=np.ones(len(lengths)),
        floors=np.full(len(lengths), 1e-6),  # below this factor, residuals are those of the computation
        groups=tuple(map(tuple, groups.values())),
        known=tuple(known),
    )


class Responses:
    """The residuals of a block and their Jacobian; the search for every motion starts from its last one."""

    def __init__(self, block: CurveBlock, before: Responses | None = None) -> None:
        """Begin with the last motions of a block with other weights, or fewer modes and harmonics."""
        self.block = block
        self._last: list[list[PointMotion]] = before._last if before else []
        same = before and (block.modes, block.harmonics) == (before.block.modes, before.block.harmonics)
        self._constant: list[Driven] = before._constant if before and same else []

    @property
    def failure(self) -> str:
        """Reason why a motion was not found."""
        return self._differentiable.failure

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name."""
        return self._differentiable(cs.vertcat(*(given[name] for name in self.block.names)))

    def close(self) -> None:
        """Keep the last motions, from which predictions start."""

    @cached_property
    def _differentiable(self) -> Differentiable:
        """The residuals as a CasADi Function of the unknowns, nan where a motion is not found."""
        names = self.block.names

        def respond(x: Array) -> tuple[Array, Array]:
            return self.at(dict(zip(names, x.tolist(), strict=True)))

        return Differentiable(respond, sum(self.block.series), len(names))

    def motions(self, values: Mapping[str, float]) -> list[list[PointMotion]]:
        """Return the motion closest to each point, record by record, for values of the unknowns by name."""
        s, beams, found = self.block.shared(values), self._driven(values), []
        for k, (record, points) in enumerate(zip(self.block.records, self.block.measured(values), strict=True)):
            own: list[PointMotion] = []
            for j, point in enumerate(points):
                try:
                    own.append(_motion(beams[k], point, s, self._last[k][j] if self._last else None))
                except NumericsError as error:
                    raise NoMotionError(f"{record.label}, {record.f[j]:.6g} Hz: {error}") from None
            found.append(own)
        self._last = found
        return found

    def at(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n) by the unknowns of the block, for values by name.

        Those that are not given have their guesses.
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
            ends = [self.block.driven({**values, name: (1 + side * DIFFERENCE) * values[name]}) for side in (1, -1)]
            neighbours.append((self.block.names.index(name), 2 * DIFFERENCE * values[name], ends))
        found = []
        for k, (number, record) in enumerate(self.block.numbered):
            own = [(place, width, [end[k] for end in ends]) for place, width, ends in neighbours]
            changes = [self._change(motion, s, own) for motion in self._last[k]]
            if factor := self.block.excitation(number):
                for change, level in zip(changes, record.a, strict=True):
                    change[2, self.block.names.index(factor)] -= level
            found.append(changes)
        return found

    def predicted(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return the prediction of the only record with the estimates of a fit; its looseness is ``FREE``."""
        (record,), values = self.block.records, fit.estimates
        try:
            motions, changes = self.motions(values)[0], self.sensitivities(values)[0]
        except NumericsError as error:
            raise FitError(f"the response cannot be predicted: {error}") from None
        found = np.array([one.values for one in motions]).T
        places = [fit.names.index(name) for name in self.block.names]
        slopes, errors = fit.coordinates.slopes(fit.values)[places], []
        for motion, change in zip(motions, changes, strict=True):
            by_amplitude = -change[2] / motion.slopes[2]
            jacobian = np.zeros((2, len(fit.names)))
            jacobian[:, places] = slopes * np.array([by_amplitude, change[1] + motion.slopes[1] * by_amplitude])
            errors.append(np.nan_to_num(fit.errors_of(jacobian)))
        levels = record.a * values.get(self.block.excitation(self.block.numbered[0][0]) or "", 1.0)
        beyond = np.abs(found[2] / levels - 1) > 1e-4  # relative difference of levels that are the same
        notes = (
            f"{np.count_nonzero(beyond)} of {len(beyond)} points lie beyond a jump of the predicted curve, the first "
            f"at {record.f[beyond][0]:.5g} Hz; their predictions are those at the jump",
        ) if beyond.any() else ()  # fmt: skip
        channels = response_channels(record, found[:2], np.where(beyond, math.nan, np.array(errors).T))
        return RecordPrediction(kind, tuple(channels), notes=notes)

    def _change(self, motion: PointMotion, s: Array, neighbours: Sequence[tuple[int, float, list[Driven]]]) -> Array:
        """Return the derivatives of amplitude, phase and level of a motion at the same amplitude, (3, n)."""
        z, balance, setting = motion.point.z, motion.point.family.balance, motion.point.setting
        directions = self.block.shared_directions
        forces = balance.by_parameters(motion.point.coefficients, setting, directions)
        polar = motion.reading[2] @ directions
        for place, width, ends in neighbours:
            curves = [end.curve(setting.omega, s) for end in ends]
            above, below = (curve.residual(z) for curve in curves)
            forces[:, place] = (above - below) / width
            above, below = (end.read(curve, z)[0] for end, curve in zip(ends, curves, strict=True))
            polar[:, place] = (above - below) / width
        return motion.sensitivities(forces, polar)

    def _driven(self, values: Mapping[str, float]) -> list[Driven]:
        """Return the driven beams; they are built anew only if properties change."""
        if self.block.of_model:
            return self.block.driven(values)
        self._constant = self._constant or self.block.driven({})
        return self._constant


def response_channels(record: ResponseRecord, values: Array, errors: Array, prefix: str = "") -> list[PredictedChannel]:
    """Return measured and computed amplitudes and phases; the latter are on the turn nearest to the measured ones.

    The computed values and their standard errors are (2, m).
    """
    amplitudes, phases = values
    measured = np.full(phases.shape, math.nan) if record.measured_phases is None else record.measured_phases
    if record.measured_phases is not None:
        phases = measured + np.angle(np.exp(1j * (phases - measured)))
    labels, quantity = tuple(f"{f:.6g} Hz" for f in record.f.tolist()), record.sensor.quantity
    parts: tuple[tuple[str, str, Array, Array, float | Array], ...] = (
        ("amplitude", record.sensor.unit, record.amplitudes, amplitudes, record.amplitudes),
        ("phase", "rad", measured, phases, 1.0),
    )
    return [
        PredictedChannel(prefix + name, unit, own, computed, error, record.f, "frequency, Hz", std, size, labels,
                         f"{quantity} {name}")
        for (name, unit, own, computed, size), error, std in zip(parts, errors, record.stds[:2], strict=True)
    ]  # fmt: skip


def across(slope: Array, response_controlled: bool, has_phase: bool) -> Array:
    """Return the rows of the rotation T that take the plane across a curve to its residuals, (2, 3) or (1, 3).

    The slope (3,) has the derivatives of amplitude, phase and level over their standard deviations.
    """
    rows = (2, 1) if response_controlled else (0, 1)
    e = np.array([1.0, 0.0, 0.0]) if response_controlled else np.array([0.0, 0.0, 1.0])
    u = slope * np.array([1.0, float(has_phase), 1.0])
    u = u / np.linalg.norm(u)
    u = -u if u @ e < -0.5 else u  # u . e below which -u takes the place of u
    rotation = np.eye(3) - np.outer(u + e, u + e) / (1 + u @ e) + 2 * np.outer(e, u)
    return np.asarray(rotation[[row for row in rows if has_phase or row != 1]])


def _motion(driven: Driven, point: Measured, s: Array, last: PointMotion | None) -> PointMotion:
    """Return the motion closest to a point, from the last one or, if there is none or that fails, from rest."""
    if last is not None:
        try:
            return closest(driven, point, s, last)
        except NumericsError:
            pass
    return closest(driven, point, s, motion_from_rest(driven, point, s))
