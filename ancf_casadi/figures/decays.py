"""Figures of free decays: record and fit, residuals, and damping and frequency against amplitude."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from ancf_casadi.decay.envelope import DampingCurve, LawCurve
from ancf_casadi.decay.spectrum import power_spectrum
from ancf_casadi.figures.fits import draw_autocorrelation
from ancf_casadi.support.arrays import Array, extremes
from ancf_casadi.support.figures import (
    BAND,
    COMPUTED,
    CURVE,
    LEGEND,
    MEASURED,
    PAGE_WIDTH,
    REFERENCE,
    SERIES,
    literal_text,
    si_prefix,
)

PLOT_COLUMNS = 600  # intervals of a long record, each drawn by its extremes


@literal_text
def decay_figure(
    time: Array,
    measured: Array,
    curve: Callable[[ArrayLike], Array],
    *,
    unit: str,
    values: str,
    law: LawCurve,
    points: DampingCurve | None,
) -> Figure:
    """Draw a decay: record and fit, residuals, their autocorrelation, damping ratio and frequency against amplitude.

    ``time`` (s) starts at the release, ``curve`` returns the fit at any times, and ``values`` is a title with the
    estimates.  ``points`` are damping ratio and frequency in windows of the record, ``law`` those of the fitted law.
    """
    figure = Figure(figsize=(PAGE_WIDTH, 5.4), layout="constrained")
    over_time, below, lowest = figure.subfigures(3, 1, squeeze=False, height_ratios=(1.2, 1, 1)).ravel()
    _draw_fit(over_time, below, time, measured, curve, values, unit)
    axes = lowest.subplots(1, 2)
    draw_against_amplitude(axes, points, law)
    lowest.legend(*axes[0].get_legend_handles_labels(), **LEGEND, loc="outside upper center", ncols=2)
    return figure


@literal_text
def decay_modes_figure(
    time: Array,
    measured: Array,
    fitted: Array,
    unit: str,
    amplitudes: Mapping[str, Array],
    frequencies: Sequence[float],
) -> Figure:
    """Draw a decay in several modes: record and fit, the residuals, spectra, and the amplitude of each mode.

    ``amplitudes`` holds that of each mode at the times (s), by its label.
    """
    figure = Figure(figsize=(9, 9), layout="constrained")
    over_time, below, lowest = figure.subfigures(3, 1, squeeze=False, height_ratios=(1.2, 1, 1)).ravel()
    _draw_fit(over_time, below, time, measured, lambda t: np.interp(np.asarray(t, dtype=float), time, fitted),
              "; ".join(amplitudes), unit)  # fmt: skip
    spectrum_axes, amplitude_axes = lowest.subplots(1, 2)
    end = 2 * max(frequencies)
    for values, label, colour in ((measured, "record", MEASURED), (measured - fitted, "record less fit", COMPUTED)):
        frequency, power = power_spectrum(time, values - values.mean())
        in_range = (frequency > 0.0) & (frequency <= end)
        spectrum_axes.semilogy(frequency[in_range], np.sqrt(power[in_range]), lw=0.8, color=colour,
                          label=label)  # fmt: skip
    for mode_frequency in frequencies:
        spectrum_axes.axvline(mode_frequency, **REFERENCE)
    spectrum_axes.set(xlabel="frequency, Hz", ylabel="spectrum", yticks=[])
    spectrum_axes.legend(**LEGEND)
    size, name = si_prefix(float(np.abs(measured).max()), unit)
    for (label, amplitude), (tint, *_) in zip(amplitudes.items(), itertools.cycle(SERIES)):
        amplitude_axes.semilogy(time, amplitude / size, color=tint, label=label)
    amplitude_axes.set(xlabel="time, s", ylabel=f"amplitude of each mode, {name}" if name else "amplitude of each mode")
    amplitude_axes.legend(**LEGEND)
    return figure


def _draw_fit(
    figure: SubFigure,
    below: SubFigure,
    time: Array,
    measured: Array,
    curve: Callable[[ArrayLike], Array],
    title: str,
    unit: str,
) -> None:
    """Draw a record and a fit, and below the residuals and their autocorrelation."""
    fitted = curve(time)
    turns = np.flatnonzero(np.diff(np.sign(fitted - np.median(fitted))))
    is_long = len(turns) > 2 * 40  # half periods; fewer are drawn in full
    size, name = si_prefix(float(np.abs(measured).max()), unit)
    plots = figure.subplots(1, 2, width_ratios=(3, 2), sharey=True) if is_long else [figure.subplots()]
    if is_long:
        columns = min(PLOT_COLUMNS, len(turns) // 2)  # a period or more in each
        plots[0].fill_between(*extremes(time, measured / size, columns), color=MEASURED, **BAND,
                              label="record, extremes")  # fmt: skip
        begins, *lines = extremes(time, fitted / size, columns)
        for line, label in zip(lines, (None, "fit, extremes"), strict=True):
            plots[0].plot(begins, line, **CURVE, label=label)
    end = time[turns[2 * 8]] if is_long else time[-1]  # the periods drawn beside the extremes
    in_range = time <= end
    fine_times = np.linspace(time[0], end, 4000)  # points of a drawn curve
    plots[-1].plot(time[in_range], measured[in_range] / size, ".", ms=3, color=MEASURED, label="record")
    plots[-1].plot(fine_times, curve(fine_times) / size, **CURVE, label="fit")
    for axes in plots:
        axes.set(xlabel="time, s")
    figure.legend(*plots[0].get_legend_handles_labels(), **LEGEND, loc="outside lower center", ncols=2)
    plots[0].set(ylabel=f"record, {name}" if name else "record")
    if title:
        figure.suptitle(title, fontsize="small")
    residual_axes, correlation_axes = below.subplots(1, 2)
    _draw_residuals(residual_axes, time, measured - fitted, unit)
    draw_autocorrelation(correlation_axes, measured - fitted)


def _draw_residuals(axes: Axes, time: Array, residuals: Array, unit: str) -> None:
    """Draw residuals over time; if there are many samples, their extremes."""
    size, name = si_prefix(float(np.abs(residuals).max()), unit)
    if len(time) > 2 * PLOT_COLUMNS:
        axes.fill_between(*extremes(time, residuals / size, PLOT_COLUMNS), color=MEASURED, lw=0)
    else:
        axes.plot(time, residuals / size, lw=0.6, color=MEASURED)
    axes.set(xlabel="time, s", ylabel=f"record less fit, {name}" if name else "record less fit")


@literal_text
def damping_curve_figure(curve: DampingCurve) -> Figure:
    """Draw damping ratio and frequency against amplitude, with 95 % intervals."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    draw_against_amplitude(figure.subplots(1, 2), curve, None)
    return figure


def draw_against_amplitude(axes: Sequence[Axes], points: DampingCurve | None, law: LawCurve | None) -> None:
    """Draw damping ratio and frequency against amplitude: points with 95 % intervals, and a law with its band."""
    curves = [curve for curve in (points, law) if curve is not None]
    size, unit = si_prefix(max(float(curve.amplitude.max()) for curve in curves), curves[0].unit)
    for ax, name, scale, label in zip(
        axes, ("damping_ratio", "frequency"), (100.0, 1.0), ("damping ratio, %", "frequency, Hz"), strict=True
    ):
        if law is not None:
            low, high = scale * getattr(law, f"{name}_band").T
            ax.fill_between(law.amplitude / size, low, high, color=COMPUTED, **BAND)
            ax.plot(law.amplitude / size, scale * getattr(law, name), **CURVE, label="law, 95 % band")
        if points is not None:  # those that noise leaves clear; the others would set the scale
            errors = points.damping_ratio_errors
            clear = errors <= max(np.median(np.abs(points.damping_ratio)), 3 * errors.min())
            value, error = scale * getattr(points, name), 1.96 * scale * getattr(points, f"{name}_errors")
            ax.errorbar(points.amplitude[clear] / size, value[clear], yerr=error[clear], fmt="o", ms=2.5, lw=0.7,
                        color=MEASURED, label="windows", zorder=1)  # fmt: skip
        ax.set(xlabel=f"amplitude, {unit}", ylabel=label, xlim=(0.0, None))
        ax.ticklabel_format(axis="y", useOffset=False)
