"""The residuals between measured response curves and computed steady motions, their derivatives, predictions.

The residuals of a point are its distance to the curve of motions at its frequency (``points``), in the plane across the
curve.  With the unit vector u along g'(Y), and the unit vector e along the controlled quantity, the rotation that takes
u to e by the shortest way,

    T = I - (u + e)(u + e)^T/(1 + u . e) + 2 e u^T,

takes this plane to that of the other two quantities.  The residuals are these two components of T (g - m): away from
folds, where the controlled quantity is certain, the errors of amplitude and phase.  Without a phase there is only one.

At the closest point g - m has no component along u, and a step along the curve moves g along u.  The derivatives of the
residuals by the unknowns therefore are the components of T dg/dx at a fixed parameter of the curve (variable
projection); the gradient of the sum of squares is exact.  The parameter Y is the amplitude: that of the reading for a
beam, that of the motion for an oscillator (``problems.mode``).

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
from abc import ABC, abstractmethod
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
from problems.beam.curves.points import CurvePoints
from problems.beam.curves.record import ResponseRecord

if TYPE_CHECKING:
    from problems.beam.curves.response_block import ResponseBlock

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


class CurveResiduals(ABC):
    """The residuals of response curves and their Jacobian."""

    block: ResponseBlock

    @abstractmethod
    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""

    @abstractmethod
    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each.

        They belong to the last motions.  The parameter of the curve is held; the excess of the level is l less the
        level of the point.
        """

    @abstractmethod
    def close(self) -> None:
        """Forget what is no longer needed once the fit has ended."""

    @property
    def failure(self) -> str:
        """Reason why a motion was not found."""
        return self._differentiable.failure

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name."""
        return self._differentiable(cs.vertcat(*(given[name] for name in self.block.names)))

    @cached_property
    def _differentiable(self) -> Differentiable:
        """The residuals as a CasADi Function of the unknowns, nan where a motion is not found."""
        names = self.block.names

        def respond(x: Array) -> tuple[Array, Array]:
            return self.at(dict(zip(names, x.tolist(), strict=True)))

        return Differentiable(respond, sum(self.block.series), len(names))

    def at(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n) by the unknowns of the block, for values by name."""
        motions, points = self.motions(values), self.block.measured(values)
        residuals, jacobians = [], []
        for record, motion, point, change in zip(
            self.block.records, motions, points, self.sensitivities(values), strict=True
        ):
            kept = across(motion.slopes / point.deviations, record.control == "response", point.has_phase)
            residuals.append(np.einsum("mij,mj->im", kept, point.distance(motion.values)).ravel())
            slopes = np.einsum("mij,mjn->imn", kept, change / point.deviations[:, :, None])
            jacobians.append(slopes.reshape(-1, len(self.block.names)))
        return np.concatenate(residuals), np.concatenate(jacobians)

    def predicted(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return the prediction of the only record with the estimates of a fit; its looseness is ``FREE``."""
        (record,), values = self.block.records, fit.estimates
        try:
            motions, changes = self.motions(values)[0], self.sensitivities(values)[0]
        except NumericsError as error:
            raise FitError(f"the response cannot be predicted: {error}") from None
        places = [fit.names.index(name) for name in self.block.names]
        along = -changes[:, 2] / motions.slopes[:, [2]]  # change of the parameter of the curve at the same level
        jacobian = np.zeros((2, len(along), len(fit.names)))
        for k in range(2):
            own = changes[:, k] + motions.slopes[:, [k]] * along
            jacobian[k][:, places] = own * fit.coordinates.slopes(fit.values)[places]
        errors = np.nan_to_num([fit.errors_of(own) for own in jacobian])
        (point,) = self.block.measured(values)
        beyond = np.abs(motions.values[:, 2] / point.values[:, 2] - 1) > 1e-4  # relative, of levels that are the same
        notes = (
            f"{np.count_nonzero(beyond)} of {len(beyond)} points lie beyond a jump of the predicted curve, the first "
            f"at {record.f[beyond][0]:.5g} Hz; their predictions are those at the jump",
        ) if beyond.any() else ()  # fmt: skip
        channels = response_channels(record, motions.values[:, :2].T, np.where(beyond, math.nan, errors))
        return RecordPrediction(kind, tuple(channels), notes=notes)


def response_channels(record: ResponseRecord, values: Array, errors: Array, prefix: str = "") -> list[PredictedChannel]:
    """Return measured and computed amplitudes and phases; the latter are on the turn nearest to the measured ones."""
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


def across(slopes: Array, response_controlled: bool, has_phase: bool) -> Array:
    """Return the rows of the rotations T that take the planes across curves to residuals, (m, 2, 3) or (m, 1, 3)."""
    rows = (2, 1) if response_controlled else (0, 1)
    e = np.array([1.0, 0.0, 0.0]) if response_controlled else np.array([0.0, 0.0, 1.0])
    u = slopes * np.array([1.0, float(has_phase), 1.0])
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    u = np.where((u @ e < -0.5)[:, None], -u, u)  # u . e below which -u takes the place of u
    both = u + e
    rotations = (
        np.eye(3) - both[:, :, None] * both[:, None, :] / (1 + u @ e)[:, None, None] + 2 * e[:, None] * u[:, None]
    )
    return np.asarray(rotations[:, [row for row in rows if has_phase or row != 1]])
