"""Prediction of a decay with the modes of another one.

Frequency and damping of the modes are held.  The release and the equilibrium belong to the record: they are fitted, to
residuals r with the Jacobian B by these unknowns.  With the Jacobian A by the unknowns of the modes, the predicted
readings change by

    (I - B (B' B)^-1 B') A

per change of the modes, to first order, which gives their standard errors from the covariance of the modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.rest import REST_TERMS
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import check_instance
from problems.decay.laws import DecayModel
from problems.decay.start import of_motion

if TYPE_CHECKING:
    from problems.decay.result import DecayFit


@dataclass(frozen=True, eq=False)
class DecayingMode:
    """A mode that is known from a fit, and its free decay."""

    fit: Fit
    model: DecayModel
    indices: tuple[int, ...]  # positions in ``fit`` of the unknowns of the mode, and of others that do not matter
    residual_rms: float  # of the records of the same sensor; nan if there is none


def predicted(modes: Sequence[DecayFit | DecayingMode], record: Any) -> RecordPrediction:
    """Return the prediction of a decay with modes that were fitted at once."""
    check_instance(record, "record", Measurement)
    fit, sensor = modes[0].fit, modes[0].model.sensor
    if record.sensor != sensor:
        raise InputError(f"must be of {sensor.quantity} as in the fit, got {record.sensor.quantity}", "record")
    rest = max((one.model.rest for one in modes), key=list(REST_TERMS).index)
    guess = of_motion(first_guess(record, rest=rest), sensor.derivatives)
    time, measured = record.time[guess.release :], record.values[guess.release :]
    releases = [one.model.own(guess) for one in modes]
    ends = np.cumsum([0, *map(len, releases)]).tolist()

    def curve(mode: cs.MX, release: cs.MX) -> cs.MX:
        total = cs.MX(0)
        for one, begin, end in zip(modes, ends, ends[1:], strict=False):
            shared = one.indices[: len(one.model.shared(guess))]
            total += one.model.curve(time - time[0], *(mode[k] for k in shared), *cs.vertsplit(release[begin:end]))
        return total

    found = least_squares(
        lambda *x: curve(cs.MX(fit.values), cs.vertcat(*x)) - cs.DM(measured),
        [replace(u, name=f"{u.name}_{position}") for position, own in enumerate(releases) for u in own],
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
        modes[0].residual_rms,
    )
    return RecordPrediction("decay", (channel,))
