"""Figures of residuals, compared models and repeated fits, made without a display."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy  # its packages are imported on first use
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ancf_casadi.estimation.agreement import Agreement
from ancf_casadi.estimation.noise.series import autocorrelation
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import (
    BAND,
    COMPUTED,
    CURVE,
    LEGEND,
    LEGEND_ABOVE,
    MEASURED,
    POINTS,
    REFERENCE,
    literal_text,
    si_prefix,
)

PLOTS_PER_ROW = 4  # plots of estimates in a row


def draw_autocorrelation(axes: Axes, residuals: Array) -> None:
    """Draw the autocorrelation of residuals; for white noise, 95 % of the lags are between the dotted lines."""
    correlation = np.nan_to_num(autocorrelation(residuals)[:201])  # lags
    axes.plot(np.arange(len(correlation)), correlation, **CURVE)
    for edge in (-1.96, 1.96):
        axes.axhline(edge / len(residuals) ** 0.5, **REFERENCE)
    axes.set(xlabel="lag, samples", ylabel="autocorrelation")


@literal_text
def criteria_figure(names: Sequence[str], criteria: Mapping[str, Sequence[float]]) -> Figure:
    """Draw the differences of criteria from their lowest values; values that are not finite are left out."""
    figure = Figure(figsize=(7, 1.2 + 0.5 * len(names)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(names))
    shifts, colours = np.linspace(-0.12, 0.12, len(criteria)), [MEASURED, COMPUTED, *(f"C{k}" for k in range(10))]
    for (label, criterion), shift, colour in zip(criteria.items(), shifts, itertools.cycle(colours), strict=False):
        values = np.array(criterion)
        finite = np.isfinite(values)
        differences = values[finite] - values[finite].min(initial=np.inf)
        axes.hlines(places[finite] + shift, 0.0, differences, color=colour, lw=2)
        axes.plot(differences, places[finite] + shift, "o", color=colour, clip_on=False, label=label)
    axes.set_xscale("symlog", linthresh=10.0)
    axes.axvspan(0.0, 10.0, color=COMPUTED, **BAND)
    highest = max(20.0, 1.1 * axes.get_xlim()[1])
    ticks = [tick for tick in (0, 5, 10, 100, 1000, 10_000, 100_000) if tick <= highest]
    axes.set(xlim=(0.0, highest), xticks=ticks, xticklabels=[f"{tick:d}" for tick in ticks])
    axes.minorticks_off()
    axes.set(yticks=places, yticklabels=names, xlabel="difference from the best law; not clear where shaded")
    axes.invert_yaxis()
    axes.legend(**LEGEND_ABOVE)
    return figure


@literal_text
def scatter_figure(labels: Sequence[str], samples: Array, estimates: Array, errors: Sequence[float]) -> Figure:
    """Draw a histogram of each column of samples (runs, p), and the normal distributions of the estimates (p,).

    None is drawn where the standard error is nan.
    """
    figure = Figure(figsize=(3 * len(labels), 2.8), layout="constrained")
    plots = figure.subplots(1, len(labels), squeeze=False).ravel()
    for axes, label, column, estimate, error in zip(plots, labels, samples.T, estimates, errors, strict=True):
        axes.hist(column, bins="sqrt", density=True, color=COMPUTED, alpha=0.5)
        axes.axvline(estimate, lw=0.8, color=MEASURED)
        if error > 0.0:
            x = estimate + error * np.linspace(-4.0, 4.0, 200)
            normal = np.exp(-(((x - estimate) / error) ** 2) / 2) / (error * np.sqrt(2 * np.pi))
            axes.plot(x, normal, lw=1, color=MEASURED)
        axes.locator_params(axis="x", nbins=4)
        axes.ticklabel_format(axis="x", useOffset=False)
        axes.set(xlabel=label.replace("_", " "), yticks=[])
    return figure


@literal_text
def agreement_figure(quantities: Sequence[tuple[str, Agreement]]) -> Figure:
    """Draw estimates with 95 % intervals, one plot per quantity, and the interval of their mean as a band."""
    figure = Figure(figsize=(3.2 * max(len(quantities), 1), 2.8), layout="constrained")
    plots = figure.subplots(1, max(len(quantities), 1), squeeze=False).ravel()
    for axes, (label, agreement) in zip(plots, quantities, strict=False):
        places = np.arange(1, len(agreement.values) + 1)
        axes.axhspan(*agreement.interval, color=COMPUTED, **BAND)
        axes.axhline(agreement.mean, **CURVE)
        axes.errorbar(places, agreement.values, yerr=1.96 * agreement.errors, **POINTS, color=MEASURED)
        axes.set(xlabel="record", ylabel=label, xticks=places, xlim=(0.5, len(places) + 0.5))
        axes.ticklabel_format(axis="y", useOffset=False)
    return figure


@literal_text
def saved_figure(fits: Mapping[str, Any]) -> Figure:
    """Draw the estimates of one or several fits with their 95 % intervals, one plot for each name."""
    units = {name: unit for fit in fits.values() for name, unit in fit.units.items()}
    rows = max(1, -(-len(units) // PLOTS_PER_ROW))
    figure = Figure(figsize=(2.6 * min(PLOTS_PER_ROW, max(1, len(units))), 2.6 * rows), layout="constrained")
    plots = figure.subplots(rows, min(PLOTS_PER_ROW, max(1, len(units))), squeeze=False).ravel()
    for axes in plots[len(units) :]:
        axes.set_visible(False)
    for axes, (name, unit) in zip(plots, units.items(), strict=False):
        values_by_fit = {
            label: (fit.estimates[name], *fit.intervals()[name]) for label, fit in fits.items() if name in fit.units
        }
        values, low, high = np.array(list(values_by_fit.values())).T
        reach = np.nan_to_num(np.array([values - low, high - values]), posinf=0.0).clip(0.0)
        axes.errorbar(range(len(values_by_fit)), values, yerr=reach, **POINTS, color=COMPUTED)
        axes.set(ylabel=f"{name}, {unit}".removesuffix(", ").replace("_", " "), xlim=(-0.5, len(values_by_fit) - 0.5))
        axes.set_xticks(range(len(values_by_fit)), list(values_by_fit))
        axes.ticklabel_format(axis="y", useOffset=False)
    return figure


@literal_text
def channels_figure(results: Mapping[str, Any]) -> Figure:
    """Draw measured (dots) and computed values, amplitudes of complex ones, and their differences below.

    Channels of one result that share a diagram, unit and axis are drawn over one another.
    """
    diagrams: dict[tuple[str, ...], list[PredictedChannel]] = {}
    for label, result in results.items():
        for channel in result.channels:
            diagrams.setdefault((label, channel.diagram or channel.name, channel.unit, channel.axis), []).append(
                channel
            )
    columns = min(PLOTS_PER_ROW, len(diagrams))
    rows = -(-len(diagrams) // columns)
    figure = Figure(figsize=(1.0 + 4.4 * columns, 4.6 * rows), layout="constrained")
    plots = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=(2, 1) * rows)
    for k, ((label, title, unit, axis), channels) in enumerate(diagrams.items()):
        upper, lower = plots[2 * (k // columns) : 2 * (k // columns) + 2, k % columns]
        lower.sharex(upper)
        size, prefix = si_prefix(max(float(np.nanmax(np.abs(channel.predicted))) for channel in channels), unit)
        centred = len(channels) > 1 and axis == TIME_AXIS  # the means of positions are far apart
        for number, channel in enumerate(channels):
            _draw_channel(upper, lower, channel, size, f"C{number % 10}" if len(channels) > 1 else COMPUTED, centred)
        quantity = f"{title}{' less its mean' * centred}, {prefix}".removesuffix(", ")
        upper.set(ylabel=quantity, title=label)
        upper.tick_params(labelbottom=False)
        unit = "%" if isinstance(channels[0].size, np.ndarray) else prefix
        lower.set(ylabel=f"difference, {unit}".removesuffix(", "), xlabel=axis)
        if all((channel.places == np.rint(channel.places)).all() for channel in channels):
            lower.xaxis.set_major_locator(MaxNLocator(integer=True))
        upper.lines[0].set_label("measured")
        place = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)} if len(channels) > 1 else {}  # beside the data
        upper.legend(**LEGEND, **place)
    for unused in plots.reshape(rows, 2, columns).swapaxes(1, 2).reshape(-1, 2)[len(diagrams) :].ravel():
        figure.delaxes(unused)
    return figure


def _draw_channel(upper: Axes, lower: Axes, channel: PredictedChannel, size: float, colour: str, centred: bool) -> None:
    """Draw a channel in units of a size: values above, residuals below, which are relative if the values are single."""
    order = np.argsort(channel.places, kind="stable")
    measured, computed, residuals = (
        np.abs(values) if np.iscomplexobj(values) else values.real
        for values in (channel.measured, channel.predicted, channel.residuals)
    )
    mean = measured.mean() if centred else 0.0
    upper.plot(channel.places, (measured - mean) / size, ".", ms=6 if channel.labels else 3, color=MEASURED)
    upper.plot(
        channel.places[order],
        (computed - mean)[order] / size,
        lw=1,
        color=colour,
        label=channel.name,
        marker="_" if channel.labels else "",
        ms=14,
    )
    residuals = 100 * residuals / channel.size if isinstance(channel.size, np.ndarray) else residuals / size
    lower.plot(channel.places[order], residuals[order], lw=0.6, marker="." if channel.labels else "", color=colour)
    if channel.labels and np.nanmin(computed) > 0.0 and np.nanmax(computed) > 10.0 * np.nanmin(computed):
        upper.set_yscale("log")


@literal_text
def corner_figure(labels: Sequence[str], columns: Sequence[Array], shares: Sequence[float]) -> Figure:
    """Draw histograms of samples on the diagonal, and pairs below it with contours about shares of the samples."""
    n = len(columns)
    figure = Figure(figsize=(1.5 + 1.7 * n, 1.2 + 1.7 * n), layout="constrained")
    plots = figure.subplots(n, n, squeeze=False, sharex="col")
    for i, row in enumerate(plots):
        for j, axes in enumerate(row):
            if j > i:
                axes.remove()
                continue
            if j == i:
                axes.hist(columns[i], bins="sqrt", color=COMPUTED, alpha=0.5)
                for end in np.quantile(columns[i], [0.025, 0.975]).tolist():
                    axes.axvline(end, **REFERENCE)
            else:
                _draw_pair(axes, columns[j], columns[i], shares)
            axes.tick_params(labelsize=7, labelbottom=i == n - 1, labelleft=0 == j < i, axis="both")
            axes.locator_params(nbins=4)
            axes.ticklabel_format(useOffset=False)
            axes.tick_params(axis="x", rotation=45)
            if i == n - 1:
                axes.set_xlabel(labels[j])
            if j == 0 < i:
                axes.set_ylabel(labels[i])
            if j == i:
                axes.set_yticks([])
    return figure


def _draw_pair(axes: Axes, x: Array, y: Array, shares: Sequence[float]) -> None:
    """Draw samples of a pair, and the contours of a smooth density that contain shares of them."""
    axes.plot(x, y, ".", ms=1, color=COMPUTED, alpha=0.3, rasterized=True)
    points = np.array([x, y])
    if np.linalg.matrix_rank(np.corrcoef(points), tol=1e-6) < 2:  # a line
        return
    kernel = scipy.stats.gaussian_kde(points)
    levels = np.quantile(kernel(points), [1 - share for share in shares])
    grid = np.meshgrid(*(np.linspace(coordinates.min(), coordinates.max(), 50) for coordinates in points))
    density = kernel(np.array([coordinates.ravel() for coordinates in grid])).reshape(grid[0].shape)
    axes.contour(*grid, density, levels=levels, colors=MEASURED, linewidths=0.8)
