"""Measured response curves as a block of a fit, of a beam or of one mode: residuals, weights, predictions, warnings.

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
the factors (``ancf_casadi.estimation.problem``).

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
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Self

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import Account, Block, Computed, Fitted, SeriesWeights, alike
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.exceptions import FitError, NumericsError
from ancf_casadi.support.arrays import Array, Mask, root_mean_square
from ancf_casadi.support.callbacks import Differentiable
from problems.beam.curves.points import CurvePoints, Measured
from problems.beam.curves.record import ResponseRecord

FREE = (1e4, 1e4, 1.0)  # factors on the standard deviations of a prediction, in which the level decides


def first_weights(records: Sequence[ResponseRecord]) -> SeriesWeights:
    """Return the factors c of the amplitudes and, if they were measured, of the phases of each record before a fit."""
    lengths, kinds = list[int](), list[tuple[Any, ...]]()
    for record in records:
        measured = record.level_std if record.control == "response" else record.amplitude_std
        is_stated = measured is not None, record.phase_std is not None
        for row in range(1 if record.phases is None else 2):
            kinds.append((is_stated[row], record.sensor, record.control, is_stated, row))
            lengths.append(record.f.size)
    groups = alike(kinds)  # a kind begins with whether its standard deviations are stated
    return SeriesWeights(
        lengths=np.array(lengths),
        deviations=np.ones(len(lengths)),
        floors=np.full(len(lengths), 1e-6),  # below this factor, residuals are those of the computation
        groups=groups,
        known=tuple(kinds[group[0]][0] for group in groups),
    )


@dataclass(frozen=True, eq=False)
class ResponseBlock(Block):
    """Measured response curves."""

    numbered: tuple[tuple[int, ResponseRecord], ...]  # with the numbers, from 1, in the names of factors on levels
    names: tuple[str, ...]  # of the unknowns of the fit
    looseness: tuple[float, float, float] = (1.0, 1.0, 1.0)  # further factors for amplitudes, phases and levels
    weights: SeriesWeights = field(kw_only=True)  # factors on standard deviations of amplitudes and levels, and phases

    @property
    def records(self) -> Sequence[ResponseRecord]:
        """The measurements."""
        return [record for _, record in self.numbered]

    @property
    def lengths(self) -> list[list[int]]:
        """Number of amplitudes and, if they were measured, of phases of each record."""
        return [[record.f.size] * (1 if record.phases is None else 2) for record in self.records]

    @property
    def negligible(self) -> float:
        """Norm of the error of the computation."""
        return 1e-6 * math.sqrt(sum(self.series))  # accuracy of the computed points, in standard deviations

    @abstractmethod
    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""

    @abstractmethod
    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each.

        They belong to the last motions.  The parameter of the curve is held; the excess of the level is l less the
        level of the point.
        """

    @property
    def failure(self) -> str:
        """Reason why a motion was not found."""
        return self._differentiable.failure

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name."""
        return self._differentiable(cs.vertcat(*(unknowns[name] for name in self.names)))

    @cached_property
    def _differentiable(self) -> Differentiable:
        """The residuals as a CasADi Function of the unknowns, nan where a motion is not found."""
        names = self.names

        def respond(x: Array) -> tuple[Array, Array]:
            return self.at(dict(zip(names, x.tolist(), strict=True)))

        return Differentiable(respond, sum(self.series), len(names))

    def at(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the residuals (m,), and their Jacobian (m, n) by the unknowns of the block, for values by name."""
        motions, points = self.motions(values), self.measured_points(values)
        residuals, jacobians = [], []
        for record, (values_of_motions, by_parameter), point, change in zip(
            self.records, motions, points, self.sensitivities(values), strict=True
        ):
            projections = across(by_parameter / point.deviations, record.control == "response", point.has_phase)
            residuals.append(np.einsum("mij,mj->im", projections, point.distance(values_of_motions)).ravel())
            slopes = np.einsum("mij,mjn->imn", projections, change / point.deviations[:, :, None])
            jacobians.append(slopes.reshape(-1, len(self.names)))
        return np.concatenate(residuals), np.concatenate(jacobians)

    def reweight(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the factors of the root mean square of residuals, also in a robust fit."""
        return super().reweight(residuals, robust=False)

    def channels(self, fitted: Fitted | Computed) -> list[PredictedChannel]:
        """Return computed amplitudes, and phases if they were measured, without standard errors."""
        channels = []
        for record, (motion_values, _) in zip(self.records, self.motions(fitted.values), strict=True):
            values = motion_values[:, :2].T
            prefix = f"{record.label}: " if len(self.records) > 1 else ""
            own_channels = response_channels(record, values, np.full(values.shape, math.nan), prefix)
            channels += own_channels if record.measured_phases is not None else own_channels[:1]
        return channels

    def predict_record(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return amplitudes and phases at the levels of the only record, which decide (``FREE``)."""
        free, (record,), values = replace(self, looseness=FREE), self.records, fit.estimates
        try:
            (motion_values, by_parameter), changes = free.motions(values)[0], free.sensitivities(values)[0]
        except NumericsError as error:
            raise FitError(f"the response cannot be predicted: {error}") from None
        places = [fit.names.index(name) for name in self.names]
        along = -changes[:, 2] / by_parameter[:, [2]]  # change of the parameter of the curve at the same level
        jacobian = np.zeros((2, len(along), len(fit.names)))
        for k in range(2):
            at_level = changes[:, k] + by_parameter[:, [k]] * along
            jacobian[k][:, places] = at_level * fit.coordinates.slopes(fit.values)[places]
        errors = np.nan_to_num([fit.errors_of(rows) for rows in jacobian])
        (point,) = free.measured_points(values)
        beyond = np.abs(motion_values[:, 2] / point.values[:, 2] - 1) > 1e-4  # relative, of levels that are the same
        notes = (
            f"{np.count_nonzero(beyond)} of {len(beyond)} points lie beyond a jump of the predicted curve, the first "
            f"at {record.f[beyond][0]:.5g} Hz; their predictions are those at the jump",
        ) if beyond.any() else ()  # fmt: skip
        channels = response_channels(record, motion_values[:, :2].T, np.where(beyond, math.nan, errors))
        return RecordPrediction(kind, tuple(channels), notes=notes)

    def unexplained_shares(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the share of the response per level, root mean square, that the curves of each record leave."""
        shares, values = [], fitted.values
        for record, (motion_values, _), points in zip(
            self.records, self.motions(values), self.measured_points(values), strict=True
        ):
            computed, measured = (
                amplitudes / levels * np.exp(1j * phases * points.has_phase)
                for amplitudes, phases, levels in (motion_values.T, np.nan_to_num(points.values).T)
            )
            size = root_mean_square(np.abs(measured))
            shares.append((record.label, root_mean_square(np.abs(computed - measured)) / size))
        return shares

    def account(self, fitted: Fitted) -> Account:
        """Return range and error of each record, and points without a stable motion."""
        lines, notes, records, values = [], list[str](), [], fitted.values
        for record, (motion_values, slopes), points in zip(
            self.records, self.motions(values), self.measured_points(values), strict=True
        ):
            if record.control == "response":
                # the level that the measured amplitude needs, to first order
                level = motion_values[:, 2] + slopes[:, 2] / slopes[:, 0] * (record.amplitudes - motion_values[:, 0])
                name, error = "level", root_mean_square(level / record.a - 1)
            else:
                name, error = "amplitude", root_mean_square(motion_values[:, 0] / record.amplitudes - 1)
                # standard deviations of a level beyond which the level of a point has no motion
                away = np.abs(points.distance(motion_values)[:, 2]) > 5.0
                notes += _branch_warnings(record, away, (slopes[:, 2] < 0.0) & ~away)
            size = record.f.size
            lines.append(
                f"{record.label}: {size} points, {record.f.min():.5g} to {record.f.max():.5g} Hz, "
                f"root mean square error of the {name} {100 * error:.2g} %"
            )
            records.append({"record": record.label, "points": size, "quantity": name, "relative_error": error})
        return Account(lines, notes, {"kind": "response", "records": records})

    def excitation(self, number: int) -> str | None:
        """Return the name of the factor on the levels of a record; None if it is known."""
        return next((name for name in (f"excitation_{number}", "excitation") if name in self.names), None)

    def measured_points(self, values: Mapping[str, float]) -> list[Measured]:
        """Return the points of each record, with the levels that belong to values of the unknowns by name."""
        points = []
        factors = iter(self.weights.deviations.tolist())
        for number, record in self.numbered:
            amplitude = next(factors)
            phase = 1.0 if record.phases is None else next(factors)
            deviations = record.stds.T * (np.array([amplitude, phase, amplitude]) * self.looseness)
            factor = values.get(self.excitation(number) or "", 1.0)
            phases = np.full(record.f.size, math.nan) if record.measured_phases is None else record.measured_phases
            rows = np.array([record.amplitudes, phases, factor * record.a]).T
            points.append(Measured(2 * math.pi * record.f, rows, deviations))
        return points


def response_channels(record: ResponseRecord, values: Array, errors: Array, prefix: str = "") -> list[PredictedChannel]:
    """Return measured and computed amplitudes and phases; the latter are on the turn nearest to the measured ones."""
    amplitudes, phases = values
    measured = np.full(phases.shape, math.nan) if record.measured_phases is None else record.measured_phases
    if record.measured_phases is not None:
        phases = measured + np.angle(np.exp(1j * (phases - measured)))
    labels, quantity = tuple(f"{f:.6g} Hz" for f in record.f.tolist()), record.sensor.quantity
    size, unit, (amplitude_std, phase_std, _) = record.amplitudes, record.sensor.unit, record.stds
    channel = partial(PredictedChannel, places=record.f, axis="frequency, Hz", labels=labels)
    return [
        channel(f"{prefix}amplitude", unit, size, amplitudes, errors[0], noise=amplitude_std, size=size,
                diagram=f"{quantity} amplitude"),
        channel(f"{prefix}phase", "rad", measured, phases, errors[1], noise=phase_std, size=1.0,
                diagram=f"{quantity} phase"),
    ]  # fmt: skip


def across(slopes: Array, response_controlled: bool, has_phase: bool) -> Array:
    """Return the rows of the rotations T that take the planes across curves to residuals, (m, 2, 3) or (m, 1, 3)."""
    rows = (2, 1) if response_controlled else (0, 1)
    e = np.array([1.0, 0.0, 0.0]) if response_controlled else np.array([0.0, 0.0, 1.0])
    u = slopes * np.array([1.0, float(has_phase), 1.0])
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    u = np.where((u @ e < -0.5)[:, None], -u, u)  # u . e below which -u takes the place of u
    bisector = u + e
    rotations = (
        np.eye(3)
        - bisector[:, :, None] * bisector[:, None, :] / (1 + u @ e)[:, None, None]
        + 2 * e[:, None] * u[:, None]
    )
    return np.asarray(rotations[:, [row for row in rows if has_phase or row != 1]])


def _branch_warnings(record: ResponseRecord, away: Mask, between: Mask) -> list[str]:
    """Return warnings about points (m,) without a stable motion at their level: beyond or between the jumps."""
    notes = []
    if away.any():
        notes.append(
            f"{record.label}: {away.sum()} of {len(away)} points lie beyond a jump of the fitted curve, the "
            f"first at {record.f[away][0]:.5g} Hz; the law, or the level, does not hold there"
        )
    if between.any():
        notes.append(
            f"{record.label}: {between.sum()} of {len(between)} points lie between the jumps of the fitted "
            f"curve, the first at {record.f[between][0]:.5g} Hz, where no motion is stable if the "
            "level is controlled; if the response was controlled, give control='response'"
        )
    return notes
