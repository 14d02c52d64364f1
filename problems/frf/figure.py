"""Figure of a fit of frequency response functions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.estimation.figures import saved_figure
from ancf_casadi.response.drawing import Curve, bode_figure
from ancf_casadi.support.figures import COMPUTED, MEASURED
from problems.frf.result import FrfFit

GREY = "#b0b0b0"


def frf_figure(fits: Mapping[str, FrfFit]) -> Figure:
    """Draw measured and fitted functions, amplitude and phase, and their difference; of several fits the estimates."""
    if len(fits) > 1:
        return saved_figure(fits)
    (fit,) = fits.values()
    record = fit.record
    measured = record.values.reshape(-1, len(record.frequencies))
    fitted = fit.synthesised().reshape(measured.shape)
    misfit = np.linalg.norm(fitted - measured, axis=1) / np.linalg.norm(measured, axis=1)
    drawn = np.sort(np.argsort(misfit)[::-1][:4]).tolist()  # functions; of more, those with the largest residuals
    columns = [
        [
            Curve("measured", record.frequencies, measured[k], MEASURED),
            Curve("fitted", record.frequencies, fitted[k], COMPUTED),
            Curve("difference", record.frequencies, fitted[k] - measured[k], GREY, phase=False),
        ]
        for k in drawn
    ]
    unit = "" if record.unit == "1" else f", {record.unit}"
    names = record.names()
    return bode_figure(
        columns, record.kind.replace("-", " ") + unit, [names[k] for k in drawn] if len(names) > 1 else []
    )
