"""Prediction of a decay with the modes of another one.

Frequency and damping of the modes are held.  The release and the equilibrium belong to the record: they are fitted, to
residuals r with the Jacobian B by these unknowns.  With the Jacobian A by the unknowns of the modes, the predicted
readings change by

    (I - B (B' B)^-1 B') A

per change of the modes, to first order, which gives their standard errors from the covariance of the modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import check_instance
from problems.decay.laws import DecayModel
from problems.decay.starting_values import guess_of_displacement


def predict_decay(
    fit: Fit, modes: Sequence[tuple[DecayModel, tuple[int, ...]]], residual_rms: float, record: Any
) -> RecordPrediction:
    """Return the prediction of a decay with modes that were fitted at once.

    A mode has its model and the positions of its unknowns in the fit, the first ones of those given.  ``residual_rms``
    is that of the records of the same sensor; nan if there is none.
    """
    check_instance(record, "record", Measurement)
    sensor = modes[0][0].sensor
    if record.sensor != sensor:
        raise InputError(f"must be of {sensor.quantity} as in the fit, got {record.sensor.quantity}", "record")
    rest_law = max((model.rest for model, _ in modes), key=list(REST_TERMS).index)
    guess = guess_of_displacement(first_guess(record, rest=rest_law), sensor.derivatives)
    time, measured = record.time[guess.release :], record.values[guess.release :]
    releases = [model.release_unknowns(guess) for model, _ in modes]
    ends = np.cumsum([0, *map(len, releases)]).tolist()

    def curve(mode: cs.MX, release: cs.MX) -> cs.MX:
        total = cs.MX(0)
        for (model, indices), begin, end in zip(modes, ends, ends[1:], strict=False):
            mode_indices = indices[: len(model.mode_unknowns(guess))]
            total += model.curve(time - time[0], *(mode[k] for k in mode_indices), *cs.vertsplit(release[begin:end]))
        return total

    release_fit = least_squares(
        lambda *x: curve(cs.MX(fit.values), cs.vertcat(*x)) - cs.DM(measured),
        [replace(u, name=f"{u.name}_{position}") for position, unknowns in enumerate(releases) for u in unknowns],
        advice="check the record",
    )
    mode = cs.MX.sym("mode", len(fit.names))
    readings = cs.densify(curve(mode, cs.MX(release_fit.values)))
    tangents = cs.densify(cs.jtimes(readings, mode, cs.DM.eye(mode.numel())))
    A = cs.Function("tangents", [mode], [tangents])(fit.values).full()
    basis = np.linalg.qr(release_fit.jacobian)[0]
    errors = fit.errors_of(A - basis @ (basis.T @ A))
    channel = PredictedChannel(
        record.name or sensor.quantity,
        sensor.unit,
        measured,
        measured + release_fit.residuals,
        np.nan_to_num(errors),
        time,
        TIME_AXIS,
        residual_rms,
    )
    return RecordPrediction("decay", (channel,))
