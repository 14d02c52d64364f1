"""Options of the charts of frequency response functions: their magnitudes with the fit, and the stability chart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray
from problems.frf.record import FrfRecord
from problems.frf.result import FrfFit
from problems.frf.selection import StabilityChart
from problems.look.charts import BRUSHED, FIT, LEGEND, PART, RECORD, TEXT, Options, dots, line, line_chart, thin

MOST_DRAWN = 8  # functions
POLE, STABLE = "#999", "#2f9e44"


def magnitude_chart(record: FrfRecord) -> Options:
    """Return the chart of the magnitudes of functions, with a brush over the frequencies, and room for the fit."""
    drawn = _magnitudes(record.frequencies, record.columns)
    series = [line("measured", data, RECORD, 1.5) for data in drawn] + [line("fitted", [], FIT, 1.5) for _ in drawn]
    options = line_chart("frequency, Hz", f"magnitude, {record.unit}", series)
    options["yAxis"]["type"] = "log"
    return _over(options, record) | BRUSHED


def show_modes(chart: Options, fit: FrfFit) -> None:
    """Draw the fitted functions, and the band of the fit, into the chart of the magnitudes."""
    frequencies, series = fit.record.frequencies, chart["series"]
    fitted = fit.synthesised().reshape(-1, len(frequencies)).T
    for fit_line, data in zip(series[len(series) // 2 :], _magnitudes(frequencies, fitted), strict=True):
        fit_line["data"] = data
    ends = [[{"xAxis": frequencies[0]}, {"xAxis": frequencies[-1]}]]
    series[0]["markArea"] = {"silent": True, "itemStyle": {"color": PART}, "data": ends}


def pole_chart(chart: StabilityChart, record: FrfRecord, modes: Sequence[float]) -> Options:
    """Return the chart of order against frequency, with lines at the modes; the third entry of a point is its index."""
    points = np.column_stack([chart.frequencies, chart.orders, np.arange(len(chart.orders))])
    lines: Options = {"symbol": "none", "silent": True, "lineStyle": {"color": FIT, "type": "dashed"}}
    lines |= {"label": {"formatter": "{c}", "color": TEXT}, "data": [{"xAxis": float(f"{f:.4g}")} for f in modes]}
    stable = chart.is_stable
    series = [dots("pole", points[~stable].tolist(), POLE), dots("stable pole", points[stable].tolist(), STABLE)]
    series[0]["markLine"] = lines
    options = _over(line_chart("frequency, Hz", "pairs of poles", series), record)
    formatter = "point => `${point.seriesName}, ${Number(point.value[0].toPrecision(6))} Hz`"
    return options | LEGEND | {"tooltip": {"trigger": "item", ":formatter": formatter}}


def _magnitudes(frequencies: Array, values: ComplexArray) -> list[list[list[float]]]:
    """Return the points of the first functions, of their columns."""
    return [thin(frequencies, np.abs(column)) for column in values.T[:MOST_DRAWN]]


def _over(options: Options, record: FrfRecord) -> Options:
    """Return a chart over the frequencies of a record."""
    options["xAxis"] |= {"min": record.frequencies[0], "max": record.frequencies[-1]}
    return options
