"""A record, and what the estimates of a fit to other records predict for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray, root_mean_square
from ancf_casadi.support.tables import Reported, Table, known

LARGEST_PREDICTION_ERROR = 3.0  # rms error over noise and standard error above which there is a warning


@dataclass(frozen=True, eq=False)
class PredictedChannel:
    """Measured and predicted values of one kind.

    Parameters
    ----------
    name, unit : str
        What was measured.
    measured, predicted : ndarray
        Values (m,), real or complex.
    errors : ndarray
        Standard errors (m,) of the predicted values due to the uncertainty of the estimates.
    noise : float
        Standard deviation of the measured values; nan if unknown.
    """

    name: str
    unit: str
    measured: Array | ComplexArray
    predicted: Array | ComplexArray
    errors: Array
    noise: float = math.nan

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
        """``rms_error`` over the root mean square of the measured values."""
        size = root_mean_square(np.abs(self.measured))
        return self.rms_error / size if size else math.nan

    @property
    def standard_error(self) -> float:
        """Root mean square of the standard errors."""
        return root_mean_square(self.errors)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence if the error is beyond noise and uncertainty; else nothing."""
        expected = math.hypot(self.standard_error, self.noise)
        if not self.rms_error > LARGEST_PREDICTION_ERROR * expected:
            return ()
        return (
            f"{self.name}: the error {self.rms_error:.2g} is {self.rms_error / expected:.2g} times as large as "
            "noise and the uncertainty of the estimates explain; the model does not hold for this record",
        )


@dataclass(frozen=True, eq=False)
class RecordPrediction(Reported):
    """A record, and what a fit to other records predicts for it.

    Parameters
    ----------
    kind : str
        Kind of the fit.
    channels : tuple of PredictedChannel
        Measured and predicted values.
    places : ndarray
        Times, frequencies or numbers (m,) of the values.
    label : str
        What these are, with their unit.

    Examples
    --------
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> prediction = fit.predict(([57.0], [0.005]))
    >>> print(f"{prediction.channels[0].predicted[0]:.4f}")
    0.0051
    """

    _drawing = "ancf_casadi.estimation.figures.prediction_figure"

    kind: str
    channels: tuple[PredictedChannel, ...]
    places: Array
    label: str

    @property
    def residuals(self) -> tuple[Array | ComplexArray, ...]:
        """Predicted less measured values of each channel."""
        return tuple(one.residuals for one in self.channels)

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square of the residuals of each channel."""
        return {one.name: one.rms_error for one in self.channels}

    @property
    def relative_errors(self) -> dict[str, float]:
        """``rms_errors`` over the root mean square of the measured values."""
        return {one.name: one.relative_error for one in self.channels}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Root mean square of the standard errors of the predicted values of each channel."""
        return {one.name: one.standard_error for one in self.channels}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Channels whose error is beyond noise and uncertainty."""
        return tuple(note for one in self.channels for note in one.warnings)

    def table(self) -> Table:
        """Return the errors of each channel."""
        columns = ("channel", "unit", "rms_error", "relative_error", "standard_error", "noise")
        rows = [
            (one.name, one.unit, one.rms_error, known(one.relative_error), known(one.standard_error), known(one.noise))
            for one in self.channels
        ]
        return Table("prediction", f"Predicted less measured values, {self.kind}", columns, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the errors for JSON."""
        table = self.table()
        return {
            "kind": f"prediction of {self.kind}",
            "channels": [dict(zip(table.columns, row, strict=True)) for row in table.rows],
            "warnings": list(self.warnings),
        }

    def _summary(self) -> str:
        shown = [f"{one.name}, rms error {one.rms_error:.3g} {one.unit}".rstrip() for one in self.channels]
        return f"{self.kind}: {'; '.join(shown)}"
