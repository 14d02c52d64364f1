"""Prediction of a decay with the modes of another one.

Frequency and damping of the modes are held.  The release and the equilibrium belong to the record: they are fitted, to
residuals r with the Jacobian B by these unknowns.  With the Jacobian A by the unknowns of the modes, the predicted
readings change by

    (I - B (B' B)^-1 B') A

per change of the modes, to first order, which gives their standard errors from the covariance of the modes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.least_squares import least_squares
from ancf_casadi.estimation.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import Reported, Table, known
from problems.decay.laws import LAWS, DecayModel
from problems.decay.start import of_motion

BEYOND = 3.0  # rms error over noise and standard error above which there is a warning


@dataclass(frozen=True, eq=False)
class DecayPrediction(Reported):
    """A decay, and what the modes of another one predict for it.

    Parameters
    ----------
    record : Measurement
        The record from the release on.
    readings : ndarray
        Predicted readings (m,), in the unit of the sensor.
    uncertainties : ndarray
        Their standard errors (m,) due to the uncertainty of the modes.
    noise : float
        Root mean square of the residuals of the fit.
    """

    _drawing = "problems.decay.figure.prediction_figure"

    record: Measurement
    readings: Array
    uncertainties: Array
    noise: float

    @property
    def residuals(self) -> Array:
        """Predicted less measured readings (m,)."""
        return np.asarray(self.readings - self.record.values)

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals, in the unit of the sensor."""
        return root_mean_square(self.residuals)

    @property
    def relative_error(self) -> float:
        """``rms_error`` over the root mean square of the readings about their mean."""
        return self.rms_error / float(self.record.values.std())

    @property
    def standard_error(self) -> float:
        """Root mean square of the ``uncertainties``."""
        return root_mean_square(self.uncertainties)

    @property
    def warnings(self) -> tuple[str, ...]:
        """An error beyond noise and uncertainty."""
        expected = math.hypot(self.standard_error, self.noise)
        if self.rms_error <= BEYOND * expected:
            return ()
        return (
            f"the error {self.rms_error:.2g} is {self.rms_error / expected:.2g} times as large as noise and the "
            "uncertainty of the estimates explain; the law does not hold for this record",
        )

    def table(self) -> Table:
        """Return the errors."""
        columns = ("unit", "rms_error", "relative_error", "standard_error", "noise")
        row = (self.record.sensor.unit, self.rms_error, self.relative_error, self.standard_error, self.noise)
        return Table("prediction", "Predicted less measured readings", columns, [row])

    def to_dict(self) -> dict[str, Any]:
        """Return the errors for JSON."""
        return {
            "kind": "decay prediction",
            "unit": self.record.sensor.unit,
            "rms_error": self.rms_error,
            "relative_error": known(self.relative_error),
            "standard_error": self.standard_error,
            "noise": self.noise,
            "warnings": list(self.warnings),
        }

    def _summary(self) -> str:
        return f"rms error {self.rms_error:.3g} {self.record.sensor.unit}, relative {self.relative_error:.2g}"


def predicted(fit: Fit, modes: Sequence[tuple[DecayModel, Sequence[int]]], record: Any) -> DecayPrediction:
    """Return the prediction of a decay with modes, each a model with the positions of its unknowns in a fit.

    Raises
    ------
    InputError
        If the record is not usable, has another sensor, or nothing in it oscillates.
    FitError
        If the release cannot be fitted.
    """
    check_instance(record, "record", Measurement)
    sensor = modes[0][0].sensor
    if record.sensor != sensor:
        raise InputError(f"must be of {sensor.quantity} as in the fit, got {record.sensor.quantity}", "record")
    offset, drift = (any(getattr(model, name) for model, _ in modes) for name in ("offset", "drift"))
    guess = of_motion(first_guess(record, offset=offset, drift=drift), sensor.derivatives)
    time, measured = record.time[guess.release :], record.values[guess.release :]
    after = time - time[0]
    unknowns: list[Unknown] = []
    columns = []
    for position, (model, indices) in enumerate(modes):
        own = model.own(guess)
        columns.append((indices[: -len(own)], slice(len(unknowns), len(unknowns) + len(own))))
        unknowns += [Unknown(f"{u.name}_{position}", u.guess, u.scale, u.lower, u.upper, u.unit) for u in own]

    def curve(mode: cs.MX, release: cs.MX) -> cs.MX:
        parts = zip((model for model, _ in modes), columns, strict=True)
        return sum(
            (
                model.curve(after, *(mode[k] for k in shared), *cs.vertsplit(release[own]))
                for model, (shared, own) in parts
            ),
            cs.MX(0),
        )

    found = least_squares(
        lambda *x: curve(cs.MX(fit.values), cs.vertcat(*x)) - cs.DM(measured),
        unknowns,
        gauss_newton=any(LAWS[model.law].integrated for model, _ in modes),
        advice="check the record",
    )
    mode = cs.MX.sym("mode", len(fit.names))
    readings = cs.densify(curve(mode, cs.MX(found.values)))
    tangents = cs.densify(cs.jtimes(readings, mode, cs.DM.eye(mode.numel())))
    A = cs.Function("tangents", [mode], [tangents])(fit.values).full()
    basis = np.linalg.qr(found.jacobian)[0]
    errors = fit.errors_of(A - basis @ (basis.T @ A))
    return DecayPrediction(
        Measurement(time, measured, record.name, sensor),
        measured + found.residuals,
        np.nan_to_num(errors),
        fit.residual_rms,
    )
