"""Figures of motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.dynamics.trajectory import Motion
from ancf_casadi.exceptions import InputError
from ancf_casadi.figures.beams import draw_plane, line_styles, points_along
from ancf_casadi.figures.symbols import draw_symbols
from ancf_casadi.support.figures import GRID, LEGEND, MEASURED, literal_text


@literal_text
def motion_figure(runs: Mapping[str, Motion]) -> Figure:
    """Draw the motion of the tip relative to the clamp over time, and shapes of the beam at twelve instants, by label.

    The motion is the change of the horizontal and of the vertical position since the start.  With several runs, only
    the shapes at the start and at the end are drawn.
    """
    if not all(len(run.time) for run in runs.values()):
        raise InputError("the motion has no samples", "figure")
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    over_time, in_plane = figure.subfigures(1, 2, squeeze=False, width_ratios=(8, 5)).ravel()
    panels = over_time.subplots(2, 1, sharex=True)
    over_time.suptitle("displacement of the tip relative to the clamp", fontsize="medium")
    for (label, run), (colour, dash) in zip(runs.items(), line_styles(runs), strict=False):
        for axes, motion in zip(panels, run.swing.T, strict=True):
            axes.plot(run.time, 1e3 * (motion - motion[0]), lw=0.7, color=colour, ls=dash, label=label or None)
    for axes, direction in zip(panels, ("horizontal", "vertical"), strict=True):
        axes.set(ylabel=f"{direction}, mm")
        axes.grid(**GRID)
    panels[-1].set(xlabel="time, s")
    over_time.align_ylabels()
    if any(runs):
        panels[0].legend(**LEGEND)
    _draw_shapes(in_plane.subplots(), runs)
    return figure


def _draw_shapes(axes: Axes, runs: Mapping[str, Motion]) -> None:
    """Draw beams at equally spaced instants: the first dashed, the last bold, the others thin."""
    for (label, run), (colour, dash) in zip(runs.items(), line_styles(runs), strict=False):
        last, is_single = len(run.time) - 1, len(runs) == 1
        rows = np.unique(np.linspace(0, last, 12 if is_single else 2).astype(int)).tolist()
        styles: dict[int, dict[str, Any]] = {row: {"lw": 0.6, "alpha": 0.5} for row in rows}
        styles |= {last: {"lw": 2.0, "ls": dash}, 0: {"lw": 1.2, "ls": "--"}}
        for row in rows:
            name = f"{label}, " if label else ""
            row_colour = MEASURED if is_single and row == 0 else colour
            axes.plot(*points_along(run.model, run.state(row).coordinates), color=row_colour,
                      label=f"{name}at {run.time[row]:.4g} s" if row in (0, last) else None, **styles[row])  # fmt: skip
        draw_symbols(axes, run.model, run.state(-1).coordinates)
    draw_plane(axes)
    axes.set_title(f"shape of the beam at {len(rows)} instants", fontsize="medium")
    axes.figure.legend(**LEGEND, loc="outside lower center", ncols=3 if is_single else 2)
