"""Prediction of a decay with the modes of another one.

Frequency and damping of the modes are held.  The release and the equilibrium belong to the record: they are fitted, to
residuals r with the Jacobian B by these unknowns.  With the Jacobian A by the unknowns of the modes, the predicted
readings change by

    (I - B (B' B)^-1 B') A

per change of the modes, to first order, which gives their standard errors from the covariance of the modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import check_instance
from problems.decay.laws import DECAY_LAWS, DecayModel
from problems.decay.start import of_motion


def predicted(fit: Fit, modes: Sequence[tuple[DecayModel, Sequence[int]]], record: Any) -> RecordPrediction:
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
        gauss_newton=any(DECAY_LAWS[model.law].integrated for model, _ in modes),
        advice="check the record",
    )
    mode = cs.MX.sym("mode", len(fit.names))
    readings = cs.densify(curve(mode, cs.MX(found.values)))
    tangents = cs.densify(cs.jtimes(readings, mode, cs.DM.eye(mode.numel())))
    A = cs.Function("tangents", [mode], [tangents])(fit.values).full()
    basis = np.linalg.qr(found.jacobian)[0]
    errors = fit.errors_of(A - basis @ (basis.T @ A))
    channel = PredictedChannel(
        record.name or sensor.quantity,
        sensor.unit,
        measured,
        measured + found.residuals,
        np.nan_to_num(errors),
        time,
        TIME_AXIS,
        fit.residual_rms,
    )
    return RecordPrediction("decay", (channel,))
