"""A record, and what the estimates of a fit to other records predict for it.

The predicted values h have, to first order, the standard errors diag(J C J')^1/2 that the covariance C of the estimates
causes, with J = dh/dx.  The difference to the measured values also contains their noise and the error of the model,
which a prediction shows and a fit may hide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray, root_mean_square
from ancf_casadi.support.tables import Reported, Table, finite_or_none

TIME_AXIS = "time, s"  # axis of a motion
LARGEST_PREDICTION_ERROR = 3.0  # rms error over noise and standard error above which there is a warning


@dataclass(frozen=True, eq=False)
class PredictedChannel:
    """Measured and predicted values of one kind."""

    name: str  # what was measured
    unit: str
    measured: Array | ComplexArray  # values (m,), real or complex
    predicted: Array | ComplexArray
    errors: Array  # standard errors (m,) of the predicted values due to those of the estimates; nan if unknown
    places: Array  # times, frequencies or numbers (m,) of the values
    axis: str  # meaning of the places, with their unit
    noise: float | Array = math.nan  # standard deviation of the measured values, one or (m,); nan if unknown
    size: float | Array | None = None  # to which ``relative_error`` refers, one or (m,); rms of the values if None
    labels: tuple[str, ...] = ()  # name of each value, if they are single ones, which the table lists; none in a series
    diagram: str = ""  # title of the diagram that channels share in a figure; each has its own if empty

    @property
    def residuals(self) -> Array | ComplexArray:
        """Predicted less measured values (m,)."""
        return self.predicted - self.measured

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals."""
        return root_mean_square(np.abs(self.residuals))

    @property
    def relative_error(self) -> float:
        """Root mean square of the residuals over ``size``."""
        size = root_mean_square(np.abs(self.measured)) if self.size is None else self.size
        with np.errstate(divide="ignore", invalid="ignore"):
            return root_mean_square(np.abs(self.residuals) / size) if np.any(size) else math.nan

    @property
    def standard_error(self) -> float:
        """Root mean square of the standard errors."""
        return root_mean_square(self.errors)

    @property
    def warning(self) -> str | None:
        """Warning if the error is beyond noise and uncertainty; None if not."""
        scatter = np.hypot(self.errors if np.ndim(self.noise) else self.standard_error, self.noise)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = root_mean_square(np.abs(self.residuals) / scatter)
        if not ratio > LARGEST_PREDICTION_ERROR:
            return None
        return (
            f"{self.name}: the error {self.rms_error:.2g} is {ratio:.2g} times as large as "
            "noise and the uncertainty of the estimates explain; the model does not hold for this record"
        )

    def lines(self) -> list[str]:
        """Return single values as text."""
        lines = []
        columns = (self.measured, self.predicted, self.errors)
        for label, measured, value, error in zip(self.labels, *(column.tolist() for column in columns), strict=False):
            measured_text = f"measured {measured:.6g}, " * math.isfinite(measured)
            text = f"{self.name}, {label}: {measured_text}predicted {value:.6g} {self.unit}".rstrip()
            lines.append(f"{text}, standard error {error:.2g}" if math.isfinite(error) else text)
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return the errors, and the single values, for JSON."""
        data = {
            "channel": self.name,
            "unit": self.unit,
            "rms_error": finite_or_none(self.rms_error),
            "relative_error": finite_or_none(self.relative_error),
            "standard_error": finite_or_none(self.standard_error),
            "noise": finite_or_none(root_mean_square(np.atleast_1d(self.noise))),
        }
        columns = {"place": self.places, "measured": self.measured, "predicted": self.predicted, "error": self.errors}
        rows = zip(self.labels, *(column.tolist() for column in columns.values()), strict=False)
        values = [{"label": label, **dict(zip(columns, map(finite_or_none, row), strict=True))} for label, *row in rows]
        return {**data, "values": values} if values else data


@dataclass(frozen=True, eq=False)
class RecordPrediction(Reported):
    """A record, and what a fit to other records predicts for it.

    Parameters
    ----------
    kind : str
        Kind of the fit.
    channels : tuple of PredictedChannel
        Measured and predicted values.
    notes : tuple of str
        Limitations of the prediction, one sentence each.

    Examples
    --------
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> prediction = fit.predict(([57.0], [0.005]))
    >>> print(f"{prediction.channels[0].predicted[0]:.4f}")
    0.0051

    Fit the first half of a motion, and predict the whole:

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

    _drawing = "ancf_casadi.figures.fits.channels_figure"

    kind: str
    channels: tuple[PredictedChannel, ...]
    notes: tuple[str, ...] = ()

    @property
    def residuals(self) -> tuple[Array | ComplexArray, ...]:
        """Predicted less measured values of each channel."""
        return tuple(channel.residuals for channel in self.channels)

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of each channel."""
        return {channel.name: channel.rms_error for channel in self.channels}

    @property
    def relative_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of each channel over the size of its values.

        The size is the travel of a motion, the root mean square about its mean; each value itself of amplitudes of a
        response, static tests and frequencies; 1 rad of phases; the root mean square of the values of any other record.
        """
        return {channel.name: channel.relative_error for channel in self.channels}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Root mean square of the standard errors of the predicted values of each channel."""
        return {channel.name: channel.standard_error for channel in self.channels}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the prediction, and channels whose error is beyond noise and uncertainty."""
        return (*self.notes, *(channel.warning for channel in self.channels if channel.warning))

    def table(self) -> Table:
        """Return the errors of each channel; notes list single values."""
        columns = ("channel", "unit", "rms_error", "relative_error", "standard_error", "noise")
        rows = [tuple(channel.to_dict()[column] for column in columns) for channel in self.channels]
        lines = [line for channel in self.channels for line in channel.lines()]
        return Table("prediction", f"Predicted less measured values, {self.kind}", columns, rows, lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the errors of each channel, and single values, for JSON."""
        return {
            "kind": f"prediction of {self.kind}",
            "channels": [channel.to_dict() for channel in self.channels],
            "warnings": list(self.warnings),
        }

    def _summary(self) -> str:
        shown = [
            f"{channel.name}, rms error {channel.rms_error:.3g} {channel.unit}".rstrip() for channel in self.channels
        ]
        return f"{self.kind}: {'; '.join(shown)}"
