"""Damping ratio and frequency against amplitude under the law of a fit, with 95 % bands, as curves, tables and figures.

The band at each amplitude is the interval of a derived quantity (``Fit``): to first order in the unknowns, but by the
likelihood of the corner of a logarithmic frequency.  It holds for one amplitude at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.envelope import DampingCurve, LawCurve, damping_curve
from ancf_casadi.estimation.comparison import LawComparison, mixed_ends
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.intervals import derived_intervals
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import array, check_instance
from ancf_casadi.support.tables import Cell, Table
from problems.decay.result import DecayFit
from problems.decay.takes import DecayFits, DecayModes


def law_curve(
    fit: DecayFit | LawComparison[DecayFit], amplitudes: ArrayLike | None = None, *, level: float = CONFIDENCE_LEVEL
) -> LawCurve:
    """Return damping ratio and frequency against amplitude under the law of a fit, or averaged over several laws.

    Parameters
    ----------
    fit : DecayFit or LawComparison
        The fit; or a comparison of decay laws, which count by their probabilities: the values are means over the laws,
        and the bands have the quantiles of the mixture of their distributions.
    amplitudes : array_like, optional
        Amplitudes (k,), in the unit of ``fit.amplitude``, positive; those between release and end of the record if not
        given.
    level : float
        Confidence level of the bands.

    Raises
    ------
    InputError
        If an amplitude is not positive, or the level is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import fit_decay, law_curve
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> y = 0.02 / (1.0 + 0.2 * time) * np.cos(12.0 * time) + noise  # quadratic damping
    >>> curve = law_curve(fit_decay(time, y, law="quadratic"), amplitudes=[0.010, 0.020])
    >>> [f"{100 * ratio:.2f} %" for ratio in curve.damping_ratio]
    ['0.83 %', '1.67 %']
    """
    check_instance(fit, "fit", DecayFit, LawComparison)
    if isinstance(fit, LawComparison):
        check_instance(fit.best, "fit", DecayFit)
        return _average_laws(fit, amplitudes, level)
    if amplitudes is None:
        amplitude_grid = np.geomspace(*fit.amplitude_range, 60)
    else:
        amplitude_grid = check_amplitudes(amplitudes)
    return curve_with_bands(
        fit.fit,
        lambda *x: fit.model.against_amplitude(amplitude_grid, *(x[i] for i in fit.indices)),
        amplitude_grid,
        level,
        fit.units["amplitude"],
    )


def _average_laws(comparison: LawComparison[DecayFit], amplitudes: ArrayLike | None, level: float) -> LawCurve:
    """Return the mean over the laws that are not ruled out, and the bands of the mixture."""
    if amplitudes is None:
        amplitudes = law_curve(comparison.best).amplitude
    weights, fits = np.array([weight for weight, _ in comparison.probable]), [fit for _, fit in comparison.probable]
    curves = [law_curve(fit, amplitudes, level=level) for fit in fits]

    def average(name: str) -> tuple[Array, Array]:
        values, ends = (np.array([getattr(curve, key) for curve in curves]) for key in (name, f"{name}_band"))
        return weights @ values, mixed_ends(weights, values, ends, level)

    return LawCurve(curves[0].amplitude, *average("damping_ratio"), *average("frequency"), curves[0].unit)


def curve_with_bands(
    fit: Fit, against: Callable[..., tuple[cs.MX, cs.MX]], amplitudes: Array, level: float, unit: str
) -> LawCurve:
    """Return damping ratio and frequency, which are functions of the unknowns, with the bands of their intervals."""

    def ratio_and_frequency(*x: cs.MX) -> cs.MX:
        return cs.vertcat(*against(*x))

    values, ends = fit.derived(ratio_and_frequency)[0], derived_intervals(fit, ratio_and_frequency, level)
    ratio, frequency = np.split(values, 2)
    ratio_band, frequency_band = np.split(ends, 2)
    return LawCurve(amplitudes, ratio, ratio_band, frequency, frequency_band, unit)


def check_amplitudes(amplitudes: ArrayLike) -> Array:
    """Return amplitudes as an array (k,); all must be positive."""
    values = array(amplitudes, "amplitudes").ravel()
    if not (values > 0.0).all():
        raise InputError(f"must be positive, got {values.min():g}", "amplitudes")
    return values


def amplitude_table(fit: DecayFit) -> Table:
    """Return damping ratio and frequency against amplitude, by windows with standard errors and by the law with bands.

    One row per window of ``damping_curve``; the bands are the ends of 95 % intervals.  A record that is too short for
    windows, or hidden by noise, has the law alone.

    Parameters
    ----------
    fit : DecayFit
        The fit.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import amplitude_table, fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> y = 0.02 / (1.0 + 0.2 * time) * np.cos(12.0 * time) + noise  # quadratic damping
    >>> table = amplitude_table(fit_decay(time, y, law="quadratic"))
    >>> table.columns[1:3], [round(value, 3) for value in table.rows[0][1:3]]
    (('amplitude_m', 'damping_ratio'), [0.018, 0.015])
    """
    check_instance(fit, "fit", DecayFit)
    points = measured_curve(fit)
    law = law_curve(fit, None if points is None else points.amplitude)
    bands = [law.damping_ratio, *law.damping_ratio_band.T, law.frequency, *law.frequency_band.T]
    heads = ["law_damping_ratio", "lower_95", "upper_95", "law_frequency_hz", "lower_95", "upper_95"]
    first_columns = ["time_s", "amplitude_m" if law.unit == "m" else "amplitude"]
    rows: list[list[Cell]] = [[None, amplitude] for amplitude in law.amplitude.tolist()]
    if points is not None:
        window_table = points.table()
        first_columns, rows = list(window_table.columns), [list(row) for row in window_table.rows]
    rows = [[*row, *values] for row, values in zip(rows, np.column_stack(bands).tolist(), strict=True)]
    return Table("against_amplitude", f"{fit.title} against amplitude", (*first_columns, *heads), rows)


def measured_curve(fit: DecayFit) -> DampingCurve | None:
    """Return the windows of a fitted record, with the frequency that its law states; None if noise hides them all."""
    record = Measurement(fit.time, fit.measured, sensor=fit.model.sensor)
    try:
        windows = damping_curve(record, release_time=fit.release_time)
    except InputError:
        return None
    if fit.law == "linear":
        return windows
    return replace(windows, frequency=windows.frequency * np.sqrt(1 - windows.damping_ratio**2))


def decay_fit_figure(fits: Mapping[str, DecayFit]) -> Figure:
    """Draw record and fit, the residuals, and damping ratio and frequency against amplitude, by law and by windows."""
    from ancf_casadi.figures.decays import decay_figure  # matplotlib is slow to import

    (fit,) = fits.values()
    values = f"{fit.law} damping\n{_value(fit, 'frequency', 1.0, 'Hz')}, {_value(fit, 'damping_ratio', 100.0, '%')}"
    return decay_figure(
        fit.time,
        fit.measured,
        fit.displacement,
        unit=fit.model.sensor.unit,
        values=values,
        law=law_curve(fit),
        points=measured_curve(fit),
    )


def takes_figure(fits: Mapping[str, DecayFits]) -> Figure:
    """Draw the quantities of the mode from each record with 95 % intervals, and their mean."""
    from ancf_casadi.figures.fits import agreement_figure, saved_figure  # matplotlib is slow to import

    agreements = [a for fit in fits.values() for a in fit.agreements]
    if not agreements:
        return saved_figure(fits)
    return agreement_figure([(f"{a.name}, {a.unit}".removesuffix(", "), a) for a in agreements])


def modes_figure(fits: Mapping[str, DecayModes]) -> Figure:
    """Draw the record, the sum of the modes, the residuals, spectra, and the amplitude of each mode."""
    from ancf_casadi.figures.decays import decay_modes_figure  # matplotlib is slow to import

    (modes,) = fits.values()
    first, time = modes[0], modes[0].time
    fitted = np.sum([fit.displacement(time) for fit in modes], axis=0)
    speed = [(2 * math.pi * fit.frequency) ** first.model.sensor.derivatives for fit in modes]
    amplitudes = {
        f"{fit.frequency:.4g} Hz, {100 * fit.damping_ratio:.3g} %": factor * fit.amplitude * np.exp(
            -2 * math.pi * fit.damping_ratio * fit.frequency * (time - time[0])
        )
        for fit, factor in zip(modes, speed, strict=True)
    }  # fmt: skip
    frequencies = [fit.frequency for fit in modes]
    return decay_modes_figure(time, first.measured, fitted, first.model.sensor.unit, amplitudes, frequencies)


def _value(fit: DecayFit, name: str, scale: float, unit: str) -> str:
    """Return a value with its standard error, to two digits of the latter."""
    value, error, label = scale * getattr(fit, name), scale * fit.standard_errors[name], name.replace("_", " ")
    if not error > 0.0:
        return f"{label} {value:.5g} {unit}"
    digits = min(max(1 - math.floor(math.log10(error)), 0), 12)
    return f"{label} ({value:.{digits}f} ± {error:.{digits}f}) {unit}"
