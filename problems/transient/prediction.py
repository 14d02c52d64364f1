"""Prediction of a record with the estimates of a fit to other records.

The computed readings h have, to first order, the standard errors diag(J C J')^1/2 that the covariance C of the
estimates causes, with J = dh/dx.  The difference to the measured readings also contains their noise and the error of
the model, which a prediction shows and a fit may hide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.exceptions import FitError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.tables import Table
from problems.transient.motion_record import MotionRecord
from problems.transient.problem import TransientProblem
from problems.transient.weights import Weights, first_weights

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEYOND = 3.0  # rms error over noise and standard error above which there is a warning


@dataclass(frozen=True, eq=False)
class MotionPrediction:
    """A record, and the readings that a fit to other records predicts for it.

    Parameters
    ----------
    record : MotionRecord
        The measurements.
    readings : tuple of ndarray
        Predicted readings of each channel, in the unit of the sensor.
    uncertainties : tuple of ndarray
        Standard errors of the predicted readings due to the uncertainty of the estimates.
    noise : tuple of float
        Standard deviation of the noise of each channel: the given one; else that of the same sensor in the fit; else an
        estimate from the third differences of the samples.

    Examples
    --------
    Fit the first half of a record, and predict the whole:

    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, simulate
    >>> from problems import MarkerRecord, fit_transient
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, guess = RayleighDamping(alpha=0.5), RayleighDamping(alpha=0.2)
    >>> run = simulate(model, damping=true, base=base, duration=0.5, sample_rate=50.0)
    >>> first, whole = (MarkerRecord(run.time[:k], run.tip[:k], base=base) for k in (13, 26))
    >>> prediction = fit_transient(model, first, guess).predict(whole)
    >>> {name: error < 1e-3 for name, error in prediction.relative_errors.items()}
    {'position x, tip': True, 'position y, tip': True}
    """

    record: MotionRecord
    readings: tuple[Array, ...]
    uncertainties: tuple[Array, ...]
    noise: tuple[float, ...]

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Predicted less measured readings of each channel."""
        pairs = zip(self.readings, self.record.own_channels, strict=True)
        return tuple(reading - channel.measurement.values for reading, channel in pairs)

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of each channel, in the unit of the sensor."""
        return dict(zip(labels_of([self.record]), map(root_mean_square, self.residuals), strict=True))

    @property
    def relative_errors(self) -> dict[str, float]:
        """``rms_errors`` over the travel, the root mean square of the measured readings about their mean."""
        travels = [float(channel.measurement.values.std()) for channel in self.record.own_channels]
        pairs = zip(self.rms_errors.items(), travels, strict=True)
        return {label: error / travel if travel else math.nan for (label, error), travel in pairs}

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Root mean square of the ``uncertainties`` of each channel."""
        return dict(zip(labels_of([self.record]), map(root_mean_square, self.uncertainties), strict=True))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Channels whose error is beyond noise and uncertainty."""
        notes = []
        for (label, error), expected, noise in zip(
            self.rms_errors.items(), self.standard_errors.values(), self.noise, strict=True
        ):
            if error > BEYOND * math.hypot(expected, noise):
                notes.append(
                    f"{label}: the error {error:.2g} is {error / math.hypot(expected, noise):.2g} times as large as "
                    "noise and the uncertainty of the estimates explain; the model does not hold for this record"
                )
        return tuple(notes)

    def report(self) -> str:
        """Return the result as text."""
        columns = ("channel", "unit", "rms_error", "relative_error", "standard_error", "noise")
        units = [channel.sensor.unit for channel in self.record.own_channels]
        errors = self.rms_errors, self.relative_errors, self.standard_errors
        values = zip(*(one.values() for one in errors), self.noise, strict=True)
        rows = [(label, unit, *own) for label, unit, own in zip(errors[0], units, values, strict=True)]
        table = Table("prediction", "Predicted less measured readings", columns, rows, [])
        return "\n".join([table.text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "channels": [
                {
                    "channel": label,
                    "unit": channel.sensor.unit,
                    "rms_error": error,
                    "relative_error": relative,
                    "standard_error": own,
                }
                for (label, error), channel, relative, own in zip(
                    self.rms_errors.items(),
                    self.record.own_channels,
                    self.relative_errors.values(),
                    self.standard_errors.values(),
                    strict=True,
                )
            ],
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw measured and predicted readings over time, and the residuals below."""
        from problems.transient.figures import motion_figure  # matplotlib is slow to import

        return motion_figure([self.record], self.residuals)


def predicted(fitted: TransientProblem, fit: Fit, record: MotionRecord, tip_mass: float | None) -> MotionPrediction:
    """Return the prediction of a record.

    Parameters
    ----------
    fitted : TransientProblem
        The problem that was fitted.
    fit : Fit
        Its estimates.
    record : MotionRecord
        The record.
    tip_mass : float, optional
        Mass at the tip, kg; that of the fitted beam if not given.

    Raises
    ------
    InputError
        If a sensor is not on the beam, or the mass is not usable.
    FitError
        If the motion cannot be computed.
    """
    model, weights = fitted.model, first_weights([record])
    if tip_mass is not None:
        model = Model(model.beam.with_(tip_mass=tip_mass), model.measures)
    problem = replace(fitted, model=model, records=(record,), load=(), weights=weights, evidence=())
    shared = {*PROPERTIES, *(own.name for own in fitted.damping.parameters)}
    own = np.array([name in shared for name in fit.names])
    names, free = [name for name in fit.names if name in shared], ~fit.active_bounds[own]
    readings, jacobian = _with_jacobian(problem, names, fit.values[own])
    covariance = fit.covariance[np.ix_(own, own)][np.ix_(free, free)]
    variances = np.sum(jacobian[:, free] @ covariance * jacobian[:, free], axis=1)
    errors = np.split(np.sqrt(np.maximum(variances, 0.0)), np.cumsum(weights.lengths.astype(int))[:-1])
    noise = dict(zip((one.sensor for one in fitted.channels), fitted.weights.deviations.tolist(), strict=True))
    own_noise = [
        channel.noise or noise.get(channel.sensor, deviation)
        for channel, deviation in zip(record.own_channels, weights.deviations.tolist(), strict=True)
    ]
    return MotionPrediction(record, _with_origins(record, weights, readings), tuple(errors), tuple(own_noise))


def _with_jacobian(problem: TransientProblem, names: Sequence[str], values: Array) -> tuple[Array, Array]:
    """Return the readings of all channels, (m,), and their Jacobian by the unknowns, (m, n)."""
    x = cs.MX.sym("x", len(names))
    runs = problem.runs()
    given = dict(zip(names, cs.vertsplit(x), strict=True)) if names else {}
    readings = cs.vertcat(*problem.readings([one.function() for one in runs], given))
    jacobian = cs.jtimes(readings, x, cs.DM.eye(len(names))) if names else cs.DM(readings.numel(), 0)
    with delayed_interrupts():
        found, derivatives = cs.Function("readings", [x], [cs.densify(readings), cs.densify(jacobian)])(values)
    failures = [str(one.failure) for one in runs if one.failure]
    if failures:
        raise FitError(f"the motion of the record cannot be computed: {failures[0]}")
    return found.full().ravel(), derivatives.full()


def _with_origins(record: MotionRecord, weights: Weights, readings: Array) -> tuple[Array, ...]:
    """Return the readings of each channel; displacements have the origin of the record."""
    own = []
    parts = np.split(readings, np.cumsum(weights.lengths.astype(int))[:-1])
    for channel, reading in zip(record.own_channels, parts, strict=True):
        moved = channel.sensor.quantity == "displacement"
        own.append(reading + float(np.mean(channel.measurement.values - reading)) if moved else reading)
    return tuple(own)


def labels_of(records: Sequence[MotionRecord]) -> list[str]:
    """Return a distinct label of each channel of records: its name if the measurement has one."""
    labels = []
    for k, record in enumerate(records):
        for channel in record.own_channels:
            label = f"{channel.measurement.name}: {channel.label}" if channel.measurement.name else channel.label
            labels.append(f"record {k + 1}, {label}" if len(records) > 1 else label)
    return [f"{label} ({labels[:k].count(label) + 1})" if labels.count(label) > 1 else label
            for k, label in enumerate(labels)]  # fmt: skip


def root_mean_square(values: Array) -> float:
    """Return the root mean square of values."""
    return math.sqrt(float(np.mean(values**2)))
