"""Figures of records, drawn without a display."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.records.processing import amplitude_spectrum
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, REFERENCE, literal_text


@literal_text
def record_figure(label: str, time: Array, values: Array, title: str) -> Figure:
    """Draw values over time (s)."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    axes = figure.subplots()
    _draw(axes, time, values)
    axes.set(title=title, xlabel="time, s", ylabel=label)
    return figure


@literal_text
def spectra_figure(
    series: Sequence[tuple[str, Array, Array, tuple[Array, Array]]], title: str = "", release: float = math.nan
) -> Figure:
    """Draw series over time and their spectra, one below the other, and mark the release (s) if it is not nan."""
    figure = Figure(figsize=(10, 1.4 + 1.8 * len(series)), layout="constrained")
    rows = figure.subplots(len(series), 2, sharex="col", squeeze=False, width_ratios=(3, 2))
    for (time_axes, spectrum_axes), (label, time, values, (grid, even_values)) in zip(rows, series, strict=True):
        _draw(time_axes, time, values)
        time_axes.set(ylabel=label)
        if math.isfinite(release):
            time_axes.axvline(release, **REFERENCE)
        frequency, spectrum = amplitude_spectrum(grid, even_values)
        spectrum_axes.semilogy(
            frequency[1:], np.maximum(spectrum[1:], 1e-6 * spectrum.max(initial=1e-300)), lw=0.6, color=COMPUTED
        )
        spectrum_axes.set(ylabel="amplitude")
    rows[0, 0].set(title=title)
    rows[-1, 0].set(xlabel="time, s")
    rows[-1, 1].set(xlabel="frequency, Hz")
    figure.align_ylabels()
    return figure


def _draw(axes: Axes, time: Array, values: Array) -> None:
    dense = len(time) > 2000  # samples beyond which a line is clearer than points
    axes.plot(time, values, color=MEASURED, lw=0.6 if dense else 0.4, marker="" if dense else ".", ms=2.5)
