"""Measured motions of the beam as a block of a fit.

A sensor c (``derivatives.reading``) reads h_c(t_i; theta, P, b, F) in the motion for the parameters theta of the
damping law, the properties P of the beam, the amplitude b of the base motion, and the load F, with its rate of change,
that holds the beam until it is released.  With the zero z_c of the sensor and its standard deviation s_c (``weights``),
the residuals are

    (h_c(t_i) + z_c - y_ci)/s_c

record by record and channel by channel.  ``evaluation`` has these expressions, ``weights`` the accuracy of the
integration.  Only the model is differentiated: records are never integrated.  A trial that takes ``MOST_STEP_RATIO``
times the steps of the first run is abandoned.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.block import Account, Evaluation, Fitted, SeriesBlock, SeriesWeights
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.solve import LARGEST_SHIFT
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.tables import known
from problems.beam.motions.evaluation import MotionEvaluation
from problems.beam.motions.record import Channel, MotionRecord, labels_of
from problems.beam.motions.weights import (
    CHECK_RATIO,
    MODEL_STD,
    TIGHTEST,
    first_tolerance,
    first_weights,
    tighter,
)


@dataclass(frozen=True, eq=False)
class MotionBlock(SeriesBlock):
    """Measured motions of a beam in one configuration."""

    model: Model
    numbered: tuple[tuple[int, MotionRecord], ...]  # from 1, as in the names of unknowns that are their own
    damping: DampingLaw
    first: Mapping[str, float]  # first values of the unknown properties by name, SI units
    load: tuple[str, ...]  # unknown components of the tip load at the start
    tolerance: float  # of the integration
    weights: SeriesWeights  # of the channels
    adaptive: bool = True  # the tolerance may become smaller

    @property
    def records(self) -> Sequence[MotionRecord]:
        """The measurements."""
        return [record for _, record in self.numbered]

    @property
    def sensors(self) -> list[Channel]:
        """The channels of all records."""
        return [channel for record in self.records for channel in record.own_channels]

    @property
    def lengths(self) -> list[list[int]]:
        """Number of samples of each channel of each record."""
        return [[channel.measurement.time.size for channel in record.own_channels] for record in self.records]

    @property
    def times(self) -> Array:
        """Times of the residuals on the clocks of their records, s."""
        return np.concatenate([channel.measurement.time for channel in self.sensors])

    @property
    def systematic(self) -> float:
        """Root mean square of the systematic error of the records."""
        return self.weights.root_mean_square(self.weights.floors)

    @property
    def negligible(self) -> float:
        """Norm of the integration error of all readings."""
        # effect of an undetermined combination of unknowns, in units of the tolerance times the travel
        return 3.0 * self.tolerance * math.sqrt(sum(self.series)) * self.systematic / MODEL_STD

    def evaluation(self, before: Evaluation | None = None) -> MotionEvaluation:
        """Return the motions as differentiable Functions; those of ``before`` serve other weights too."""
        known = before if isinstance(before, MotionEvaluation) else None
        if known and known.block.tolerance == self.tolerance:
            return replace(known, block=self)
        return MotionEvaluation.of(self, known)

    def reweighted(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the standard deviations that residuals show."""
        if not robust and len(self.weights.groups) == 1:
            return None  # one standard deviation for all does not matter
        return super().reweighted(residuals, robust=robust)

    def error(self, values: Mapping[str, float], residuals: Array, evaluation: Any) -> Array:
        """Return the error of residuals, from one integration of each record at a smaller tolerance."""
        tight = replace(self, tolerance=self.tolerance / CHECK_RATIO).evaluation(evaluation)
        found = tight.residuals({name: cs.MX(value) for name, value in values.items()})
        with delayed_interrupts():
            change = np.asarray(cs.evalf(found)).ravel() - residuals
        tight.close()
        return np.asarray(change)

    def refined(self, shift: float) -> Self | None:
        """Return the block with a smaller tolerance."""
        if not self.adaptive or self.tolerance <= TIGHTEST:
            return None
        return replace(self, tolerance=tighter(self.tolerance, shift))

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return measured and computed readings of each channel."""
        parts = [self.weights.split(part) for part in (fitted.residuals, fitted.errors)]
        owners = [number for number, record in self.numbered for _ in record.own_channels]
        titles = [f"record {number}, " if len(self.numbered) > 1 or number > 1 else "" for number in owners]
        return [
            PredictedChannel(label, one.sensor.unit, one.measurement.values, one.measurement.values + rest, error,
                             one.measurement.time, TIME_AXIS, deviation, float(np.std(one.measurement.values)),
                             diagram=f"{title}{one.sensor.quantity}")
            for label, one, rest, error, deviation, title in zip(
                labels_of(self.records), self.sensors, *parts, self.weights.deviations.tolist(), titles, strict=True
            )
        ]  # fmt: skip

    def predicted(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return the readings of the record at the estimates of a fit; the mean error of displacements is zero."""
        found = super().predicted(fit, kind)
        channels = [
            replace(one, predicted=one.predicted - float(np.mean(one.residuals)))
            if channel.sensor.quantity == "displacement"
            else one
            for one, channel in zip(found.channels, self.sensors, strict=True)
        ]
        return replace(found, channels=tuple(channels))

    def account(self, fitted: Fitted) -> Account:
        """Return residuals and noise of each channel, and the effect of the integration error."""
        channels, worst = self.channels(fitted), float(np.abs(fitted.shifts).max())
        lines = [
            f"integrated at the tolerance {self.tolerance:.1e}; the integration error shifts no estimate by more than "
            f"{worst:.2g} standard errors"
        ]
        if len(self.weights.groups) > 1:
            lines += [
                f"{one.name}: root mean square residual {one.rms_error:.3g} {one.unit}".rstrip()
                + f", weighted by 1/{one.noise:.3g}"
                for one in channels
            ]
        lines.append(
            f"the standard errors allow for a systematic error of {MODEL_STD:.0e} of the travel of each channel"
        )
        data = {
            "kind": "motion",
            "channels": [
                {"channel": one.name, "unit": one.unit, "std": one.noise, "rms_error": one.rms_error}
                for one in channels
            ],
            "tolerance": self.tolerance,
            "integration_shifts": [known(shift) for shift in fitted.shifts.tolist()],
        }
        return Account(lines, self._limitations(fitted, worst), data)

    def _limitations(self, fitted: Fitted, worst: float) -> list[str]:
        """Return the warning about the integration error."""
        if math.isnan(worst):
            return [
                f"the integration error at the tolerance {self.tolerance:.1e} could not be checked: its effect on the "
                "estimates is unknown"
            ]
        if worst <= LARGEST_SHIFT:
            return []
        name = fitted.fit.names[int(np.abs(fitted.shifts).argmax())]
        advice = "let the fit select the tolerance" if self.tolerance > TIGHTEST else "shorten the record"
        return [
            f"the integration error at the tolerance {self.tolerance:.1e} shifts {name} by {worst:.2g} standard "
            f"errors; {advice}"
        ]


def motion_block(
    model: Model,
    numbered: Sequence[tuple[int, MotionRecord]],
    damping: DampingLaw,
    first: Mapping[str, float],
    *,
    load: tuple[str, ...] = (),
    tolerance: float | None = None,
    robust: bool = False,
) -> MotionBlock:
    """Return motions as a block with first weights, integrated as accurately as these require."""
    records = [record for _, record in numbered]
    weights = first_weights(records, robust=robust)
    chosen = first_tolerance(records, weights, model.beam.length) if tolerance is None else tolerance
    return MotionBlock(model, tuple(numbered), damping, first, load, chosen, weights, tolerance is None)
