"""Measured response curves as a block of a fit, of a beam or of one mode: weights, points, predictions, warnings.

``residuals`` has the distance of the points to the curves, and their standard deviations.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ancf_casadi.estimation.block import Account, Evaluation, Fitted, SeriesBlock, SeriesWeights
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.support.arrays import Array, root_mean_square
from problems.beam.curves.points import CurvePoints, Measured
from problems.beam.curves.record import ResponseRecord
from problems.beam.curves.residuals import FREE, CurveResiduals, response_channels


@dataclass(frozen=True, eq=False)
class ResponseBlock(SeriesBlock):
    """Measured response curves."""

    numbered: tuple[tuple[int, ResponseRecord], ...]  # with the numbers, from 1, in the names of factors on levels
    names: tuple[str, ...]  # of the unknowns of the fit
    weights: SeriesWeights  # factors on the standard deviations of amplitudes and levels, and of phases
    looseness: tuple[float, float, float] = (1.0, 1.0, 1.0)  # further factors for amplitudes, phases and levels

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
    def evaluation(self, before: Evaluation | None = None) -> CurveResiduals:
        """Return the residuals; the search for each motion may start from the last one."""

    def reweighted(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the factors of the root mean square of residuals, also in a robust fit."""
        return super().reweighted(residuals, robust=False)

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return computed amplitudes, and phases if they were measured, without standard errors."""
        found = []
        for record, own in zip(self.records, fitted.evaluation.motions(fitted.values), strict=True):
            values = own.values[:, :2].T
            prefix = f"{record.label}: " if len(self.records) > 1 else ""
            own_channels = response_channels(record, values, np.full(values.shape, math.nan), prefix)
            found += own_channels if record.measured_phases is not None else own_channels[:1]
        return found

    def predicted(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return amplitudes and phases at the levels of the record."""
        return replace(self, looseness=FREE).evaluation().predicted(fit, kind)

    def unexplained(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the share of the response per level, root mean square, that the curves of each record leave."""
        found, values = [], fitted.values
        for record, own, points in zip(
            self.records, fitted.evaluation.motions(values), self.measured(values), strict=True
        ):
            phases = (own.values[:, 1], points.values[:, 1]) if points.has_phase else (0.0, 0.0)
            computed, measured = (
                part[:, 0] / part[:, 2] * np.exp(1j * phase)
                for part, phase in zip((own.values, points.values), phases, strict=True)
            )
            found.append(
                (record.label, root_mean_square(np.abs(computed - measured)) / root_mean_square(np.abs(measured)))
            )
        return found

    def errors(self, motions: Sequence[CurvePoints]) -> list[tuple[str, float]]:
        """Return the quantity that each record measured, level or amplitude, and its relative error, rms."""
        found = []
        for record, own in zip(self.records, motions, strict=True):
            if record.control == "response":
                # the level that the measured amplitude needs, to first order
                level = own.values[:, 2] + own.slopes[:, 2] / own.slopes[:, 0] * (record.amplitudes - own.values[:, 0])
                found.append(("level", root_mean_square(level / record.a - 1)))
            else:
                found.append(("amplitude", root_mean_square(own.values[:, 0] / record.amplitudes - 1)))
        return found

    def account(self, fitted: Fitted) -> Account:
        """Return range and error of each record, and points without a stable motion."""
        motions = fitted.evaluation.motions(fitted.values)
        lines, records = [], []
        for record, (name, error) in zip(self.records, self.errors(motions), strict=True):
            size = record.f.size
            lines.append(
                f"{record.label}: {size} points, {record.f.min():.5g} to {record.f.max():.5g} Hz, "
                f"root mean square error of the {name} {100 * error:.2g} %"
            )
            records.append({"record": record.label, "points": size, "quantity": name, "relative_error": error})
        data = {"kind": "response", "records": records}
        return Account(lines, self._branch_warnings(fitted.values, motions), data)

    def _branch_warnings(self, values: Mapping[str, float], motions: Sequence[CurvePoints]) -> list[str]:
        """Return warnings about points without a stable motion at their level."""
        notes = []
        for record, own, points in zip(self.records, motions, self.measured(values), strict=True):
            if record.control == "response":
                continue
            # standard deviations of a level beyond which the level of a point has no motion
            away = np.abs(points.distance(own.values)[:, 2]) > 5.0
            between = (own.slopes[:, 2] < 0.0) & ~away
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

    def excitation(self, number: int) -> str | None:
        """Return the name of the factor on the levels of a record; None if it is known."""
        return next((name for name in (f"excitation_{number}", "excitation") if name in self.names), None)

    def measured(self, values: Mapping[str, float]) -> list[Measured]:
        """Return the points of each record, with the levels that belong to values of the unknowns by name."""
        found = []
        factors = iter(self.weights.deviations.tolist())
        for number, record in self.numbered:
            amplitude = next(factors)
            phase = 1.0 if record.phases is None else next(factors)
            deviations = record.stds.T * (np.array([amplitude, phase, amplitude]) * self.looseness)
            factor = values.get(self.excitation(number) or "", 1.0)
            phases = np.full(record.f.size, math.nan) if record.measured_phases is None else record.measured_phases
            rows = np.array([record.amplitudes, phases, factor * record.a]).T
            found.append(Measured(2 * math.pi * record.f, rows, deviations))
        return found
