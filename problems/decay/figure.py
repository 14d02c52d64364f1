"""Figures of decay fits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.decay.envelope import PERIODS, damping_curve
from ancf_casadi.estimation.figures import agreement_figure, saved_figure
from ancf_casadi.exceptions import InputError
from ancf_casadi.plot import decay_figure, fit_figure
from ancf_casadi.records.measurement import Measurement
from problems.decay.law_curve import law_curve
from problems.decay.result import DecayFit
from problems.decay.takes import DecayFits, DecayModes


def decay_fit_figure(fits: Mapping[str, DecayFit]) -> Figure:
    """Draw record and fit, the residuals, and damping ratio and frequency against amplitude, by law and by windows.

    Of several fits the estimates are drawn.
    """
    if len(fits) > 1:
        return saved_figure(fits)
    (fit,) = fits.values()
    measured = fit.displacement(fit.time) - fit.residuals
    try:
        periods = fit.frequency * (fit.time[-1] - fit.time[0]) / 40  # windows, which are longer in a long record
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


def takes_figure(fits: Mapping[str, DecayFits]) -> Figure:
    """Draw the quantities of the mode from each record with 95 % intervals, and their mean."""
    agreements = [one for fit in fits.values() for one in fit.agreements]
    if len(fits) > 1 or not agreements:
        return saved_figure(fits)
    return agreement_figure([(f"{one.name}, {one.unit}".removesuffix(", "), one) for one in agreements])


def modes_figure(fits: Mapping[str, DecayModes]) -> Figure:
    """Draw the record, the sum of the modes, the residuals and their autocorrelation; of several fits the estimates."""
    if len(fits) > 1:
        return saved_figure(fits)
    (modes,) = fits.values()
    first = modes[0]
    fitted = np.sum([fit.displacement(first.time) for fit in modes], axis=0)
    return fit_figure(first.time, fitted - first.residuals, fitted, first.model.sensor.unit)


def _value(fit: DecayFit, name: str, scale: float, unit: str) -> str:
    """Return a value with its standard error, to two digits of the latter."""
    value, error, label = scale * getattr(fit, name), scale * fit.standard_errors[name], name.replace("_", " ")
    if not error > 0.0:
        return f"{label} {value:.5g} {unit}"
    digits = min(max(1 - math.floor(math.log10(error)), 0), 12)
    return f"{label} ({value:.{digits}f} ± {error:.{digits}f}) {unit}"
