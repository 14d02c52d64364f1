"""Options of the charts of the page, for ECharts.

A line of many samples is drawn by the smallest and the largest value in each of ``BINS`` parts of its times, which
looks the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.decay.envelope import LawCurve
from ancf_casadi.decay.spectrum import GAP, clear_peaks
from ancf_casadi.support.arrays import Array
from problems.study.formatting import shown

if TYPE_CHECKING:
    from problems.look.computation import DecayView  # slow to import

BINS = 1500  # pixels of a wide screen
PEAKS, HARMONICS = 6, 3  # of a spectrum that are marked
SPARKLINE = (160, 28)  # pixels
RECORD, FIT, BAND = "#5470c6", "#d9480f", 0.18  # colours, and the opacity of a band
OTHER_LAWS = ("#2f9e44", "#1971c2", "#9c36b5", "#e8590c", "#0c8599", "#846358")  # colours, one after another
PART = "rgba(136, 136, 136, 0.12)"  # of the record that was fitted
TEXT, LINES = "#888", "rgba(136, 136, 136, 0.25)"  # on light and on dark pages
LEGEND = {"legend": {"top": 0, "right": 20, "textStyle": {"color": TEXT}}}
GRID = {"left": 70, "right": 20, "top": 34, "bottom": 44}
Options = dict[str, Any]
BRUSHED: Options = {
    "brush": {"xAxisIndex": 0, "brushType": "lineX", "brushMode": "single", "throttleType": "debounce"},
    "toolbox": {"show": False},  # whose buttons ECharts adds to a brush
}


def record_chart(time: Array, values: Array, label: str) -> Options:
    """Return the chart of a record, with a brush over the times, and room for the fit; a gap ends a line."""
    gaps = 1 + np.flatnonzero(np.diff(time) > GAP * np.median(np.diff(time)))
    pieces = zip(np.split(time, gaps), np.split(values, gaps), strict=True)
    data = [point for t, y in pieces for point in (*thin(t, y), [t[-1], None])]
    return line_chart("time, s", label, [line("record", data, RECORD), line("fit", [], FIT)]) | BRUSHED


def show_fit(chart: Options, view: DecayView) -> None:
    """Draw a fit and its release into the chart of its record."""
    record, fit = chart["series"]
    fit["data"] = thin(view.fit.time, view.fit.displacement(view.fit.time))
    label = {"formatter": "release", "position": "insideEndTop"}
    release = {"xAxis": view.fit.release_time, "label": label, "lineStyle": {"color": FIT, "type": "dashed"}}
    record["markLine"] = {"symbol": "none", "silent": True, "data": [release]}
    ends = [[{"xAxis": view.fit.time[0]}, {"xAxis": view.fit.time[-1]}]]
    record["markArea"] = {"silent": True, "itemStyle": {"color": PART}, "data": ends}


def forget_fit(chart: Options) -> None:
    """Take the fit out of the chart of its record."""
    record, fit = chart["series"]
    fit["data"], record["markLine"], record["markArea"] = [], {"data": []}, {"data": []}


def residual_chart(view: DecayView) -> Options:
    """Return the chart of the record less its fit."""
    residuals = line("residuals", thin(view.fit.time, -view.fit.residuals), RECORD)
    return line_chart("time, s", f"record less fit, {view.fit.model.sensor.unit}".rstrip(", "), [residuals])


def spectrum_chart(frequencies: Array, amplitudes: Array) -> Options:
    """Return the chart of a spectrum, with a brush over the frequencies, and the frequencies of its peaks."""
    floor = 1e-6 * amplitudes.max(initial=1e-12)
    data = thin(frequencies[1:], np.maximum(amplitudes[1:], floor))
    peaks = clear_peaks(frequencies, amplitudes, PEAKS)
    label = {"show": True, "position": "top", "rotate": 40, "align": "left", "color": TEXT, "fontSize": 10}
    label |= {":formatter": "point => Number(point.data[0].toPrecision(4))"}
    named = dots("peaks", np.column_stack([frequencies, amplitudes])[peaks].tolist(), FIT)
    series = [line("spectrum", data, RECORD), named | {"silent": True, "label": label}]
    options = line_chart("frequency, Hz", "amplitude", series)
    options["xAxis"]["type"] = options["yAxis"]["type"] = "log"
    return options | BRUSHED


def show_harmonics(chart: Options, frequency: float) -> None:
    """Draw lines at the frequency of a fit and at its harmonics into the chart of the spectrum."""
    names = {frequency: "f"} | {order * frequency: f"{order} f" for order in range(2, HARMONICS + 1)}
    # at the axis, as a peak has its frequency above
    label = {"position": "insideStart", "rotate": 0, "align": "left", "verticalAlign": "bottom", "color": TEXT}
    lines = [{"xAxis": place, "label": {"formatter": name, **label}} for place, name in names.items()]
    chart["series"][0]["markLine"] = {"symbol": "none", "silent": True, "lineStyle": {"color": FIT}, "data": lines}


def amplitude_chart(view: DecayView, quantity: str, laws: Sequence[str] = ()) -> Options:
    """Return the chart of ``damping_ratio`` or ``frequency`` against amplitude: windows, law with its band, and others.

    The third entry of each point of the law is what the page says at the cursor.
    """
    scale, label = (100.0, "damping ratio, %") if quantity == "damping_ratio" else (1.0, "frequency, Hz")
    series = [drawn for name, colour in zip(view.laws, cycle(OTHER_LAWS), strict=False) if name in laws
              for drawn in _curve(name, view.laws[name], quantity, scale, colour)]  # fmt: skip
    *band, law = _curve("law", view.curve, quantity, scale, FIT)
    for k, point in enumerate(law["data"]):
        point.append(at_amplitude(view, k))
    series += [*band, law | {"lineStyle": {"width": 2}}]
    if view.windows is not None:
        points = np.column_stack([view.windows.amplitude, scale * getattr(view.windows, quantity)])
        series.append(dots("windows", points.tolist(), RECORD))
    options = line_chart(f"amplitude, {view.curve.unit}".rstrip(", "), label, series)
    formatter = "points => (points.find(point => point.seriesName == 'law') || {data: []}).data[2]"
    return options | {"tooltip": {"trigger": "axis", ":formatter": formatter}}


def _curve(name: str, curve: LawCurve, quantity: str, scale: float, colour: str) -> tuple[Options, Options, Options]:
    """Return the lower end of the band of a law, its height upon that, and the law."""
    low, high = scale * getattr(curve, f"{quantity}_band").T
    values = low, high - low, scale * getattr(curve, quantity)
    lower, height, law = (line(name, np.column_stack([curve.amplitude, z]).tolist(), colour) for z in values)
    hidden: Options = {"stack": name, "lineStyle": {"opacity": 0}, "silent": True}
    return lower | hidden | {"name": ""}, height | hidden | {"name": "", "areaStyle": {"opacity": BAND}}, law


def at_amplitude(view: DecayView, k: int) -> str:
    """Return frequency and damping ratio at the k-th amplitude as text, with half of their 95 % intervals."""
    curve = view.curve
    frequency, ratio = (getattr(curve, name)[k] for name in ("frequency", "damping_ratio"))
    halves = [float(np.ptp(getattr(curve, f"{name}_band")[k])) / 2 for name in ("frequency", "damping_ratio")]
    values = f"{shown(float(frequency), halves[0])} Hz, {shown(float(100 * ratio), 100 * halves[1])} %"
    return f"at {curve.amplitude[k]:.3g} {curve.unit}: {values} (95 %)"


def sparkline(values: Array) -> str:
    """Return the points of a small line of the finite values for SVG, one after another; none for fewer than two."""
    finite = values[np.isfinite(values)]
    if finite.size < 2:
        return ""
    x, y = np.array(thin(np.arange(finite.size, dtype=float), finite, SPARKLINE[0] // 2)).T
    parts = [(z - z.min()) / max(float(np.ptp(z)), np.finfo(float).tiny) for z in (x, -y)]
    points = np.column_stack([1 + part * (size - 2) for part, size in zip(parts, SPARKLINE, strict=True)])
    return " ".join(f"{across:.1f},{down:.1f}" for across, down in points)


def thin(x: Array, y: Array, bins: int = BINS) -> list[list[float]]:
    """Return points (x, y), of many only the smallest and the largest y in each of some parts, in order of x."""
    if len(x) > 4 * bins:
        edges = np.linspace(0, len(x), bins + 1).astype(int)[:-1]
        parts = np.split(np.arange(len(x)), edges[1:])
        extremes = np.unique([k for part in parts for k in (part[y[part].argmin()], part[y[part].argmax()])])
        x, y = x[extremes], y[extremes]
    return np.column_stack([x, y]).tolist()  # type: ignore[no-any-return]


def line(name: str, points: list[Any], colour: str, width: float = 1.0) -> Options:
    """Return a line of a chart."""
    return {"name": name, "type": "line", "data": points, "color": colour, "lineStyle": {"width": width}}


def dots(name: str, points: list[Any], colour: str) -> Options:
    """Return dots of a chart."""
    return {"name": name, "type": "scatter", "data": points, "color": colour, "symbolSize": 6, "showSymbol": True}


def line_chart(x: str, y: str, series: list[Options]) -> Options:
    """Return a chart with the names of its axes."""
    number = {
        ":formatter": "value => String(Number(value.toPrecision(6)))",
        "showMinLabel": False,
        "showMaxLabel": False,
    }
    axis = {"type": "value", "scale": True, "nameLocation": "middle", "nameTextStyle": {"color": TEXT}}
    axis |= {"axisLabel": number | {"color": TEXT}, "splitLine": {"lineStyle": {"color": LINES}}}
    for drawn in series:
        drawn.setdefault("showSymbol", False)
        drawn.setdefault("animation", False)
    return {
        "grid": GRID,
        "xAxis": axis | {"name": x, "nameGap": 28, "min": "dataMin", "max": "dataMax"},
        "yAxis": axis | {"name": y, "nameGap": 52},
        "series": series,
    }
