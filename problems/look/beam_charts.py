"""Options of the charts of a beam, for ECharts: its moving modes, records with what is computed, and its motion."""

from __future__ import annotations

import numpy as np

from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.figures.beams import points_along
from ancf_casadi.figures.modes import scaled_shape
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.vibration.modes import Modes
from problems.look.charts import FIT, RECORD, TEXT, Options, line_chart, thin

FRAMES = 32  # of a period of a mode
LEGEND: Options = {"legend": {"top": 0, "textStyle": {"color": TEXT}}}
INTERVAL = 50  # ms from one to the next


def mode_chart(modes: Modes, k: int) -> Options:
    """Return the moving chart of mode k, from 0, as large as in figures, for a square chart: both axes have a scale."""
    rest, shape = modes.equilibrium.coordinates, scaled_shape(modes, k)
    swings = np.sin(2 * np.pi * np.arange(FRAMES) / FRAMES).tolist()
    frames = np.array([points_along(modes.model, rest + swing * shape).T for swing in swings])
    low, high = frames.min(axis=(0, 1)), frames.max(axis=(0, 1))
    half, middle = 0.55 * float((high - low).max()), (low + high) / 2
    options = line_chart("x, mm", "y, mm", [_line("", frames[0], FIT, 2), _line("", frames[0], TEXT, 1)])
    for axis, centre in zip(("xAxis", "yAxis"), middle.tolist(), strict=True):
        options[axis] |= {"min": centre - half, "max": centre + half}
    moving = {"axisType": "category", "autoPlay": True, "loop": True, "show": False, "playInterval": INTERVAL}
    timeline = moving | {"data": list(range(FRAMES)), "animation": False}
    return {
        "baseOption": options | {"timeline": timeline},
        "options": [{"series": [{"data": frame.tolist()}]} for frame in frames],
    }


def channel_chart(channel: PredictedChannel) -> Options:
    """Return the chart of the measured values of a channel, and of the computed ones over them."""
    measured, computed = (_real(values) for values in (channel.measured, channel.predicted))
    lines = [_values(channel, "measured", measured, RECORD), _values(channel, "computed", computed, FIT)]
    return line_chart(channel.axis, f"{channel.name}, {channel.unit}".rstrip(", "), lines) | LEGEND


def difference_chart(channel: PredictedChannel) -> Options:
    """Return the chart of the computed less the measured values of a channel."""
    line = _values(channel, "difference", _real(channel.predicted) - _real(channel.measured), RECORD)
    return line_chart(channel.axis, f"difference, {channel.unit}".rstrip(", "), [line])


def tip_chart(run: Trajectory) -> Options:
    """Return the chart of the simulated motion of the tip relative to the clamp, from its place at rest."""
    motion = 1e3 * (run.tip - run.base)
    lines = [
        _line(name, thin(run.time, values - values[0]), colour, 1)
        for name, values, colour in zip("xy", motion.T, (RECORD, FIT), strict=True)
    ]
    return line_chart("time, s", "motion of the tip, mm", lines) | LEGEND


def _real(values: Array | ComplexArray) -> Array:
    """Return real values, or the amplitudes of complex ones."""
    return np.asarray(np.abs(values) if np.iscomplexobj(values) else values.real)


def _values(channel: PredictedChannel, name: str, values: Array, colour: str) -> Options:
    """Return values of a channel in the order of their places: as a line, or as dots if they are single ones."""
    order = np.argsort(channel.places, kind="stable")
    line = _line(name, thin(channel.places[order], values[order]), colour, 1)
    return line | ({"type": "scatter", "symbolSize": 7, "showSymbol": True} if channel.labels else {})


def _line(name: str, points: object, colour: str, width: float) -> Options:
    data = points.tolist() if isinstance(points, np.ndarray) else points
    return {"name": name, "type": "line", "data": data, "color": colour, "lineStyle": {"width": width}}
