"""Figures of fits to large motion, made without a display."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.colours import MEASURED
from problems.transient.marker_record import MarkerRecord


def markers_figure(records: Sequence[MarkerRecord], residuals: Array) -> Figure:
    """Draw measured (dots) and fitted positions over time, and the residuals below; one column per record.

    Parameters
    ----------
    records : sequence of MarkerRecord
        The measurements.
    residuals : ndarray
        Computed less measured positions, m: record by record, coordinate by coordinate.
    """
    figure = Figure(figsize=(2.0 + 5.0 * len(records), 5.4), layout="constrained")
    plots = figure.subplots(2, len(records), height_ratios=(2, 1), sharex="col", squeeze=False)
    ends = np.cumsum([record.columns.size for record in records])[:-1]
    for k, (record, own) in enumerate(zip(records, np.split(residuals, ends), strict=True)):
        motion, left = plots[:, k]
        time, measured = np.asarray(record.time), record.columns
        for row, (positions, rest) in enumerate(zip(measured, own.reshape(measured.shape), strict=True)):
            point = "tip" if record.points is None else f"{1e3 * record.points[row // 2]:.4g} mm"
            colour, mean = f"C{row}", positions.mean()
            motion.plot(time, 1e3 * (positions - mean), ".", ms=3, color=MEASURED)
            motion.plot(time, 1e3 * (positions + rest - mean), lw=1, color=colour, label=f"{'xy'[row % 2]}, {point}")
            left.plot(time, 1e3 * rest, lw=0.6, color=colour)
        motion.set(ylabel="position less its mean, mm", title=f"record {k + 1}" if len(records) > 1 else None)
        motion.legend(frameon=False, ncols=2, fontsize="small")
        left.set(xlabel="time, s", ylabel="residual, mm")
    return figure
