"""Figure of a decay fit."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from ancf_casadi.decay.envelope import PERIODS, damping_curve
from ancf_casadi.exceptions import InputError
from ancf_casadi.plot import decay_figure
from ancf_casadi.records.measurement import Measurement
from problems.decay.law_curve import law_curve
from problems.decay.result import DecayFit

MOST_POINTS = 40  # windows, which are longer in a long record


def decay_fit_figure(fit: DecayFit) -> Figure:
    """Draw record and fit, the residuals, and damping ratio and frequency against amplitude, by law and by windows."""
    measured = fit.displacement(fit.time) - fit.residuals
    try:
        periods = fit.frequency * (fit.time[-1] - fit.time[0]) / MOST_POINTS
        longer = periods if periods > PERIODS else None
        record = Measurement(fit.time, measured, sensor=fit.model.sensor)
        points = damping_curve(record, periods=longer, release_time=fit.release_time)
    except InputError:  # too short, or hidden by noise
        points = None
    values = f"{fit.law} damping, {_value(fit, 'frequency', 1.0, 'Hz')}, {_value(fit, 'damping_ratio', 100.0, '%')}"
    return decay_figure(
        fit.time,
        measured,
        fit.displacement,
        unit=fit.model.sensor.unit,
        values=values,
        law=law_curve(fit),
        points=points,
    )


def _value(fit: DecayFit, name: str, scale: float, unit: str) -> str:
    """Return a value with its standard error, to two digits of the latter."""
    value, error, label = scale * getattr(fit, name), scale * fit.standard_errors[name], name.replace("_", " ")
    if not error > 0.0:
        return f"{label} {value:.5g} {unit}"
    digits = min(max(1 - math.floor(math.log10(error)), 0), 12)
    return f"{label} ({value:.{digits}f} ± {error:.{digits}f}) {unit}"
