"""Figures of records at rest and of frequencies, with the computed values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, literal_text
from problems.beam.values.prediction import ValuePrediction
from problems.beam.values.records import StaticRecord

CASE_MARKERS = "osD^v<>P"


def value_size(predictions: Sequence[ValuePrediction]) -> tuple[float, float]:
    """Return width and height of a figure of values, inches."""
    return 1.0 + 5.5 * len({isinstance(one.record, StaticRecord) for one in predictions}), 5.6


@literal_text
def values_figure(predictions: Sequence[ValuePrediction]) -> Figure:
    """Return a figure with ``draw_values``."""
    figure = Figure(figsize=value_size(predictions), layout="constrained")
    draw_values(figure, predictions)
    return figure


@literal_text
def draw_values(figure: Figure | SubFigure, predictions: Sequence[ValuePrediction]) -> Figure | SubFigure:
    """Draw measured and computed values of records in the upper row, and relative errors in the lower one.

    Static tests have one column of axes, over the load; frequencies have another, over the number of the mode.
    """
    kinds = [[p for p in predictions if isinstance(p.record, StaticRecord) is static] for static in (True, False)]
    columns = [(k == 0, group) for k, group in enumerate(kinds) if group]
    grid = figure.subplots(2, len(columns), squeeze=False, sharex="col", height_ratios=(1.6, 1))
    for (static, group), upper, lower in zip(columns, *grid, strict=True):
        for k, prediction in enumerate(group):
            _draw(upper, lower, prediction, CASE_MARKERS[k % len(CASE_MARKERS)], k)
        lower.axhline(0.0, ls=":", lw=0.8, color=MEASURED)
        lower.set(xlabel="load, N" if static else "mode", ylabel="computed/measured - 1, %")
        unit = group[0].record.units[0]
        upper.set(ylabel=f"reading{f', {unit}' * bool(unit)}" if static else "frequency, Hz")
        if not static:
            modes = sorted({int(mode) for prediction in group for mode in _modes(prediction.record.labels)})
            lower.set(xticks=modes, xlim=(modes[0] - 0.5, modes[-1] + 0.5))
            values = np.concatenate([prediction.record.measured for prediction in group])
            # ratio of the frequencies beyond which their axis is logarithmic
            upper.set_yscale("log" if values.max() > 10.0 * values.min() else "linear")
        upper.legend(frameon=False, fontsize=9)
        for axes in (upper, lower):
            axes.spines[["top", "right"]].set_visible(False)
            axes.grid(alpha=0.25)
    return figure


def _draw(upper: Axes, lower: Axes, prediction: ValuePrediction, marker: str, k: int) -> None:
    """Draw one record: measured values as markers, computed ones as a line or, for modes, as bars."""
    record = prediction.record
    across = _loads(record) if isinstance(record, StaticRecord) else _modes(record.labels)
    order = np.argsort(across, kind="stable")
    shade = 0.35 + 0.65 / (1 + k)
    upper.plot(across, record.measured, marker, mfc="none", color=MEASURED, alpha=shade, label=record.name)
    line, size = ("-", 1.0) if isinstance(record, StaticRecord) else ("_", 22.0)
    label = "computed" if k == 0 else None
    upper.plot(across[order], prediction.values[order], line, ms=size, lw=1, color=COMPUTED, alpha=shade, label=label)
    lower.plot(across, 100 * prediction.relative_errors, marker, mfc="none", color=MEASURED, alpha=shade)


def _loads(record: StaticRecord) -> Array:
    """Return the size of the total force for each measured value."""
    sizes = [float(np.hypot(*np.sum([(0.0, 0.0), *(load.force for load in case)], axis=0))) for case in record.cases]
    return np.asarray(np.repeat(sizes, len(record.columns))[record.present], dtype=np.float64)


def _modes(labels: Sequence[str]) -> Array:
    return np.array([float(label.split()[-1]) for label in labels])
