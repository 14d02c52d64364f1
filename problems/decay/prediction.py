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

import numpy as np

from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import fitted_once
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import check_instance
from problems.decay.block import DecayBlock
from problems.decay.free_decay import DecayMode, cut_at_release


def predict_decay(fit: Fit, modes: Sequence[DecayMode], residual_rms: float, record: Any) -> RecordPrediction:
    """Return the prediction of a decay with modes that were fitted at once.

    The first unknowns of a mode are those of its laws.  ``residual_rms`` is that of the records of the same sensor; nan
    if there is none.
    """
    check_instance(record, "record", Measurement)
    sensor = modes[0].model.sensor
    if record.sensor != sensor:
        raise InputError(f"must be of {sensor.quantity} as in the fit, got {record.sensor.quantity}", "record")
    rest_law = max((mode.model.rest for mode in modes), key=list(REST_TERMS).index)
    decay = cut_at_release(record).about(rest_law)
    release_unknowns, decay_modes = list[Unknown](), []
    for number, mode in enumerate(modes, start=1):
        unknowns = [replace(u, name=f"{u.name}_predicted_{number}") for u in mode.model.release_unknowns(decay.guess)]
        law_names = mode.names[: len(mode.model.mode_unknowns(decay.guess))]
        decay_modes.append(DecayMode(mode.model, (*law_names, *(unknown.name for unknown in unknowns))))
        release_unknowns += unknowns
    block = DecayBlock.of([replace(decay, modes=tuple(decay_modes))], held_values=fit.estimates)
    release_fit = fitted_once(FitProblem((block,), tuple(release_unknowns), advice="check the record"))
    deviation = float(block.weights.deviations[0])
    _, sensitivities = replace(block, held_values=release_fit.estimates).linearised(fit.unknowns, fit.values)
    basis = np.linalg.qr(release_fit.jacobian)[0]
    jacobian = deviation * sensitivities / fit.scale
    errors = fit.errors_of(jacobian - basis @ (basis.T @ jacobian))
    channel = PredictedChannel(
        record.name or sensor.quantity,
        sensor.unit,
        decay.record.values,
        decay.record.values + release_fit.residuals,
        np.nan_to_num(errors),
        decay.time,
        TIME_AXIS,
        residual_rms,
    )
    return RecordPrediction("decay", (channel,))
