"""Options of the charts of a beam, for ECharts: its moving modes, records with what is computed, and its motion."""

from __future__ import annotations

import numpy as np

from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.figures.beams import points_along
from ancf_casadi.figures.modes import scaled_shape
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes
from problems.look.charts import FIT, LEGEND, RECORD, TEXT, Options, dots, line, line_chart, thin

FRAMES = 32  # of a period of a mode
INTERVAL = 50  # ms from one to the next
MOVING: Options = {"axisType": "category", "autoPlay": True, "loop": True, "show": False, "playInterval": INTERVAL}


def mode_chart(modes: Modes, k: int) -> Options:
    """Return the moving chart of mode k, from 0, exaggerated as in figures; square, so that both axes have a scale."""
    equilibrium = points_along(modes.model, modes.equilibrium.coordinates).T
    shape = points_along(modes.model, scaled_shape(modes, k)).T
    frames = [equilibrium + swing * shape for swing in np.sin(2 * np.pi * np.arange(FRAMES) / FRAMES)]
    low, high = np.min(frames, axis=(0, 1)), np.max(frames, axis=(0, 1))
    half, middle = 0.55 * float((high - low).max()), (low + high) / 2
    lines = [line("", equilibrium.tolist(), FIT, 2), line("", equilibrium.tolist(), TEXT)]
    chart = line_chart("x, mm", "y, mm", lines)
    for axis, centre in zip(("xAxis", "yAxis"), middle.tolist(), strict=True):
        chart[axis] |= {"min": centre - half, "max": centre + half}
    return {
        "baseOption": chart | {"timeline": MOVING | {"data": list(range(FRAMES))}},
        "options": [{"series": [{"data": frame.tolist()}]} for frame in frames],
    }


def channel_charts(channel: PredictedChannel) -> tuple[Options, Options]:
    """Return the chart of measured and computed values of a channel, and that of their difference."""
    values = channel.measured, channel.predicted
    measured, computed = (np.asarray(np.abs(z) if np.iscomplexobj(z) else z, dtype=float) for z in values)
    lines = [_values(channel, "measured", measured, RECORD), _values(channel, "computed", computed, FIT)]
    difference = _values(channel, "difference", computed - measured, RECORD)
    name, unit = (f"{text}, {channel.unit}".rstrip(", ") for text in (channel.name, "difference"))
    return line_chart(channel.axis, name, lines) | LEGEND, line_chart(channel.axis, unit, [difference])


def tip_chart(run: Trajectory) -> Options:
    """Return the chart of the simulated motion of the tip relative to the clamp, from its first place."""
    motion = 1e3 * (run.tip - run.base)
    lines = [
        line(name, thin(run.time, values - values[0]), colour)
        for name, values, colour in zip("xy", motion.T, (RECORD, FIT), strict=True)
    ]
    return line_chart("time, s", "motion of the tip, mm", lines) | LEGEND


def _values(channel: PredictedChannel, name: str, values: Array, colour: str) -> Options:
    """Return values of a channel in the order of their places: as a line, or as dots if they are single ones."""
    order = np.argsort(channel.places, kind="stable")
    draw = dots if channel.labels else line
    return draw(name, thin(channel.places[order], values[order]), colour)
