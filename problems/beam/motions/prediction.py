"""Prediction of a record with the estimates of a fit to other records.

The computed readings h have, to first order, the standard errors diag(J C J')^1/2 that the covariance C of the
estimates causes, with J = dh/dx.  The difference to the measured readings also contains their noise and the error of
the model, which a prediction shows and a fit may hide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.exceptions import FitError
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.tables import Displayed, Table
from problems.beam.motions.block import MotionBlock
from problems.beam.motions.record import MotionRecord, labels_of
from problems.beam.motions.weights import Weights

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class MotionPrediction(Displayed):
    """A record, and the readings that a fit to other records predicts for it.

    Parameters
    ----------
    record : MotionRecord
        The measurements.
    readings : tuple of ndarray
        Predicted readings of each channel, in the unit of the sensor.
    reading_errors : tuple of ndarray
        Standard errors of the predicted readings due to the uncertainty of the estimates.
    std : tuple of float
        Standard deviation of the noise of each channel: the given one; else that of the same sensor in the fit; else an
        estimate from the third differences of the samples.

    Examples
    --------
    Fit the first half of a record, and predict the whole:

    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import MarkerRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.5, sample_rate=50.0)
    >>> first, whole = (MarkerRecord(run.time[:k], run.tip[:k], base=base) for k in (13, 26))
    >>> prediction = fit_beam(model, first, guess).predict(whole)
    >>> {name: error < 1e-3 for name, error in prediction.relative_errors.items()}
    {'position x, tip': True, 'position y, tip': True}
    """

    record: MotionRecord
    readings: tuple[Array, ...]
    reading_errors: tuple[Array, ...]
    std: tuple[float, ...]

    @property
    def channels(self) -> tuple[PredictedChannel, ...]:
        """Measured and predicted readings of each channel."""
        labels, channels = labels_of([self.record]), self.record.own_channels
        predicted = zip(self.readings, self.reading_errors, self.std, strict=True)
        return tuple(
            PredictedChannel(label, channel.sensor.unit, channel.measurement.values, *own)
            for label, channel, own in zip(labels, channels, predicted, strict=True)
        )

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Predicted less measured readings of each channel."""
        return tuple(np.real(one.residuals) for one in self.channels)

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of each channel, in the unit of the sensor."""
        return {one.name: one.rms_error for one in self.channels}

    @property
    def relative_errors(self) -> dict[str, float]:
        """``rms_errors`` over the travel, the root mean square of the measured readings about their mean."""
        travels = [float(np.std(one.measured)) for one in self.channels]
        pairs = zip(self.rms_errors.items(), travels, strict=True)
        return {label: error / travel if travel else math.nan for (label, error), travel in pairs}

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Root mean square of the ``reading_errors`` of each channel."""
        return {one.name: one.standard_error for one in self.channels}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Channels whose error is beyond noise and uncertainty."""
        return tuple(note for one in self.channels for note in one.warnings)

    def report(self) -> str:
        """Return the result as text."""
        columns = ("channel", "unit", "rms_error", "relative_error", "standard_error", "noise")
        relative = self.relative_errors
        rows = [
            (one.name, one.unit, one.rms_error, relative[one.name], one.standard_error, one.noise)
            for one in self.channels
        ]
        table = Table("prediction", "Predicted less measured readings", columns, rows, [])
        return "\n".join([table.text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        relative = self.relative_errors
        return {
            "channels": [
                {
                    "channel": one.name,
                    "unit": one.unit,
                    "rms_error": one.rms_error,
                    "relative_error": relative[one.name],
                    "standard_error": one.standard_error,
                }
                for one in self.channels
            ],
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw measured and predicted readings over time, and the residuals below."""
        from problems.beam.motions.figures import motion_figure  # matplotlib is slow to import

        return motion_figure([self.record], self.residuals)


def predicted(block: MotionBlock, fit: Fit, noise: Mapping[Sensor, float]) -> MotionPrediction:
    """Return the prediction of a record with the estimates of a fit.

    Parameters
    ----------
    block : MotionBlock
        The record alone.
    fit : Fit
        The estimates.
    noise : mapping
        Standard deviation of the sensors in the fit.

    Raises
    ------
    InputError
        If a sensor is not on the beam.
    FitError
        If the motion cannot be computed.
    """
    (record,), weights = block.records, block.weights
    y, evaluation = cs.MX.sym("y", len(fit.names)), block.evaluation()
    given = dict(zip(fit.names, fit.coordinates.symbols(cs.vertsplit(y)), strict=True))
    computed = cs.vertcat(*block.readings(evaluation.motions, given))
    jacobian = cs.jtimes(computed, y, cs.DM.eye(len(fit.names)))
    with delayed_interrupts():
        found, derivatives = cs.Function("readings", [y], [cs.densify(computed), cs.densify(jacobian)])(fit.values)
    if evaluation.failure:
        raise FitError(f"the motion of the record cannot be computed: {evaluation.failure}")
    ends = np.cumsum(weights.lengths.astype(int))[:-1]
    errors = np.split(np.nan_to_num(fit.errors_of(derivatives.full())), ends)
    own_noise = [
        channel.std or noise.get(channel.sensor, deviation)
        for channel, deviation in zip(record.own_channels, weights.deviations.tolist(), strict=True)
    ]
    return MotionPrediction(
        record, _with_origins(record, weights, found.full().ravel()), tuple(errors), tuple(own_noise)
    )


def _with_origins(record: MotionRecord, weights: Weights, readings: Array) -> tuple[Array, ...]:
    """Return the readings of each channel; displacements have the origin of the record."""
    own = []
    parts = np.split(readings, np.cumsum(weights.lengths.astype(int))[:-1])
    for channel, reading in zip(record.own_channels, parts, strict=True):
        moved = channel.sensor.quantity == "displacement"
        own.append(reading + float(np.mean(channel.measurement.values - reading)) if moved else reading)
    return tuple(own)
