"""Figures of response curves, made without a display."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure, SubFigure

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import MEASURED, SERIES, literal_text
from problems.beam.curves.record import ResponseRecord
from problems.beam.motions.figures import IN_MM


def response_size(records: Sequence[ResponseRecord]) -> tuple[float, float]:
    """Return width and height of a figure of response curves, inches."""
    return 1.5 + 5.5 * len({record.sensor.quantity for record in records}), 1.0 + 3.2 * _rows(records)


def _rows(records: Sequence[ResponseRecord]) -> int:
    return 2 if any(record.measured_phases is not None for record in records) else 1


@literal_text
def response_figure(records: Sequence[ResponseRecord], amplitudes: Sequence[Array], phases: Sequence[Array]) -> Figure:
    """Return a figure with ``draw_responses``."""
    figure = Figure(figsize=response_size(records), layout="constrained")
    draw_responses(figure, records, amplitudes, phases)
    return figure


@literal_text
def draw_responses(
    figure: Figure | SubFigure,
    records: Sequence[ResponseRecord],
    amplitudes: Sequence[Array],
    phases: Sequence[Array],
) -> Figure | SubFigure:
    """Draw measured (dots) and computed amplitudes against frequency, and the phases below where they were measured.

    Each quantity of the records has a column.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where to draw.
    records : sequence of ResponseRecord
        The measurements.
    amplitudes, phases : sequence of array
        Computed amplitudes, in the unit of the sensor, and phases, rad, of each record.
    """
    quantities = list(dict.fromkeys(record.sensor.quantity for record in records))
    rows = _rows(records)
    plots = figure.subplots(rows, len(quantities), squeeze=False, sharex="col")
    for number, (record, own, angle) in enumerate(zip(records, amplitudes, phases, strict=True)):
        colour, dash, marker = SERIES[number % len(SERIES)]
        column = plots[:, quantities.index(record.sensor.quantity)]
        size = 1e3 if record.sensor.quantity in IN_MM else 1.0
        order = np.argsort(record.f)
        column[0].plot(record.f, size * record.amplitudes, marker, ms=4, mfc="none", mec=MEASURED)
        column[0].plot(record.f[order], size * own[order], ls=dash, lw=1.2, color=colour, label=record.label)
        if record.measured_phases is not None:
            column[1].plot(record.f, _degrees(record.measured_phases), marker, ms=4, mfc="none", mec=MEASURED)
            column[1].plot(record.f[order], _degrees(angle[order]), ls=dash, lw=1.2, color=colour)
    for column, quantity in zip(plots.T, quantities, strict=True):
        unit = "mm" if quantity in IN_MM else next(r.sensor.unit for r in records if r.sensor.quantity == quantity)
        column[0].set_ylabel(f"{quantity} amplitude{f', {unit}' if unit else ''}")
        column[0].legend(frameon=False, fontsize="small")
        if rows == 2:
            column[1].set_ylabel("phase, degrees")
        column[-1].set_xlabel("frequency, Hz")
    return figure


def _degrees(phases: Array) -> Array:
    """Return phases in degrees without jumps of a full turn, the median between -180 and 180."""
    found = np.degrees(np.unwrap(phases))
    return np.asarray(found - 360 * np.round(np.median(found) / 360))
