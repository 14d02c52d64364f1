"""Prediction of a response curve with the estimates of a fit to other records.

At the level of the excitation, the amplitude and phase of a point are those of a motion on the branch of the curve that
the measured amplitude is nearest to.  With the derivatives at fixed amplitude (``points``), and l' = dl/dY,

    dY/dx = -(dl/dx)/l',    dphi/dx = phi_x + phi' dY/dx        at fixed level.

With the covariance C of the estimates and the rows J of these derivatives, the standard errors of the prediction are
diag(J C J')^1/2, to first order.  Beyond a jump no motion has the level; the motion at the jump takes its place,
without a standard error, and a warning says so.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.exceptions import FitError, NumericsError
from ancf_casadi.support.arrays import Array
from problems.beam.curves.record import ResponseRecord

if TYPE_CHECKING:
    from problems.beam.curves.block import CurveBlock

FREE_STD = 1e4  # factor on the standard deviations of amplitude and phase: the level decides


def response_channels(record: ResponseRecord, values: Array, errors: Array, prefix: str = "") -> list[PredictedChannel]:
    """Return measured and computed amplitudes and phases; the latter are on the turn nearest to the measured ones.

    The computed values and their standard errors are (2, m).
    """
    amplitudes, phases = values
    measured = np.full(phases.shape, math.nan) if record.measured_phases is None else record.measured_phases
    if record.measured_phases is not None:
        phases = measured + np.angle(np.exp(1j * (phases - measured)))
    labels, quantity = tuple(f"{f:.6g} Hz" for f in record.f.tolist()), record.sensor.quantity
    parts: tuple[tuple[str, str, Array, Array, float | Array], ...] = (
        ("amplitude", record.sensor.unit, record.amplitudes, amplitudes, record.amplitudes),
        ("phase", "rad", measured, phases, 1.0),
    )
    return [
        PredictedChannel(prefix + name, unit, own, computed, error, record.f, "frequency, Hz", std, size, labels,
                         f"{quantity} {name}")
        for (name, unit, own, computed, size), error, std in zip(parts, errors, record.stds[:2], strict=True)
    ]  # fmt: skip


def predicted_response(block: CurveBlock, fit: Fit, kind: str) -> RecordPrediction:
    """Return the prediction of the only record of a block with the estimates of a fit."""
    (record,), values = block.records, fit.estimates
    responses = replace(block, looseness=(FREE_STD, FREE_STD, 1.0)).evaluation()
    try:
        motions, changes = responses.motions(values)[0], responses.sensitivities(values)[0]
    except NumericsError as error:
        raise FitError(f"the response cannot be predicted: {error}") from None
    found = np.array([one.values for one in motions]).T
    places = [fit.names.index(name) for name in block.names]
    slopes, errors = fit.coordinates.slopes(fit.values)[places], []
    for motion, change in zip(motions, changes, strict=True):
        slope = motion.slopes
        by_amplitude = -change[2] / slope[2]
        jacobian = np.zeros((2, len(fit.names)))
        jacobian[:, places] = slopes * np.array([by_amplitude, change[1] + slope[1] * by_amplitude])
        errors.append(np.nan_to_num(fit.errors_of(jacobian)))
    levels = record.a * values.get(block.excitation(block.numbered[0][0]) or "", 1.0)
    beyond = np.abs(found[2] / levels - 1) > 1e-4  # relative difference of levels that are the same
    notes = (
        f"{np.count_nonzero(beyond)} of {len(beyond)} points lie beyond a jump of the predicted curve, the first at "
        f"{record.f[beyond][0]:.5g} Hz; their predictions are those at the jump",
    ) if beyond.any() else ()  # fmt: skip
    channels = response_channels(record, found[:2], np.where(beyond, math.nan, np.array(errors).T))
    return RecordPrediction(kind, tuple(channels), notes=notes)
