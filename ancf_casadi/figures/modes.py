"""Figures of natural and of damped modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.dynamics.damped_modes import DampedModes
from ancf_casadi.figures.beams import line_styles, points_along
from ancf_casadi.figures.symbols import draw_symbols
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import GRID, LEGEND, REFERENCE, literal_text
from ancf_casadi.vibration.modes import Modes

SHAPE_SHARE = 0.15  # largest displacement in a drawn mode, relative to the length of the beam


@literal_text
def modes_figure(results: Mapping[str, Modes]) -> Figure:
    """Draw the lowest ten mode shapes on both sides of the equilibrium, by label."""
    first = next(iter(results.values()))
    equilibrium_shape = points_along(first.model, first.equilibrium.coordinates).T
    mode_count = min(max(modes.count for modes in results.values()), 10)
    is_horizontal = np.ptp(equilibrium_shape[:, 0]) > np.ptp(equilibrium_shape[:, 1])
    columns, width, height = (2, 4.2, 1.7) if is_horizontal else (5, 1.8, 3.2)
    columns = min(mode_count, columns)
    rows = -(-mode_count // columns)
    figure = Figure(figsize=(1.0 + width * columns, 0.4 + height * rows), layout="constrained")
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for k, axes in enumerate(plots):
        axes.set_visible(k < mode_count)
        if k < mode_count:
            _draw_mode(axes, k, results)
            if k + columns >= mode_count:  # nothing below
                axes.tick_params(labelbottom=True)
                axes.set(xlabel="x, mm")
    for axes in plots[::columns]:
        axes.set(ylabel="y, mm")
    if any(results):
        figure.legend(*plots[0].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=3)
    return figure


def _draw_mode(axes: Axes, k: int, results: Mapping[str, Modes]) -> None:
    """Draw mode k, from 0, of each result that has it."""
    for (label, modes), (colour, dash) in zip(results.items(), line_styles(results), strict=False):
        if k >= modes.count:
            continue
        equilibrium, shape = modes.equilibrium.coordinates, scaled_shape(modes, k)
        axes.plot(*points_along(modes.model, equilibrium), **REFERENCE)
        draw_symbols(axes, modes.model, equilibrium)
        for side, width in ((1.0, 1.5), (-1.0, 0.5)):
            axes.plot(*points_along(modes.model, equilibrium + side * shape), lw=width, color=colour, ls=dash,
                      label=label if label and side > 0.0 else None)  # fmt: skip
    values = ", ".join(f"{modes.frequencies[k]:.4g}" for modes in results.values() if k < modes.count)
    axes.set_title(f"mode {k + 1}: {values} Hz", fontsize=9)
    axes.set(aspect="equal")


def scaled_shape(modes: Modes, k: int) -> Array:
    """Return the shape of mode k, from 0, in nodal coordinates (4 n + 4,), scaled for a figure."""
    size = np.linalg.norm(points_along(modes.model, modes.shapes[:, k]), axis=0).max()
    return np.asarray(1e3 * SHAPE_SHARE * modes.model.beam.length / size * modes.shapes[:, k])


@literal_text
def damped_modes_figure(results: Mapping[str, DampedModes]) -> Figure:
    """Draw the eigenvalues in the complex plane, by label; those to the right of the dotted line grow."""
    figure = Figure(figsize=(5.6, 4.6), layout="constrained")
    axes = figure.subplots()
    for (label, modes), (colour, _), marker in zip(
        results.items(), line_styles(results), "osD^v" * len(results), strict=False
    ):
        axes.plot(modes.eigenvalues.real, modes.eigenvalues.imag, marker, color=colour, label=label or None)
    axes.axvline(0.0, **REFERENCE)
    axes.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
    axes.grid(**GRID)
    if any(results):
        axes.legend(**LEGEND)
    return figure
