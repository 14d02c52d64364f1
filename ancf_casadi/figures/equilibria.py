"""Figures of equilibria and their paths."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.figures.beams import draw_plane, line_styles, points_along
from ancf_casadi.figures.symbols import draw_loads, draw_symbols
from ancf_casadi.support.figures import GRID, LEGEND, MEASURED, REFERENCE, literal_text
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.paths import EquilibriumPath


@literal_text
def equilibrium_figure(equilibria: Mapping[str, Equilibrium]) -> Figure:
    """Draw the beam in equilibrium and without load, by label, with supports, attachments and forces."""
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    axes = figure.subplots()
    for (label, equilibrium), (colour, dash) in zip(equilibria.items(), line_styles(equilibria), strict=False):
        axes.plot(*points_along(equilibrium.model, equilibrium.model.straight), **REFERENCE)
        axes.plot(
            *points_along(equilibrium.model, equilibrium.coordinates),
            color=colour,
            ls=dash,
            lw=2.0,
            label=label or "at rest",
        )
        draw_symbols(axes, equilibrium.model, equilibrium.coordinates)
        draw_loads(axes, equilibrium.model, equilibrium.coordinates, equilibrium.all_loads)
    axes.lines[0].set_label("without load")
    draw_plane(axes)
    figure.legend(**LEGEND, loc="outside lower center", ncols=4)
    return figure


@literal_text
def path_figure(paths: Mapping[str, EquilibriumPath], point: float | None = None) -> Figure:
    """Draw the factor against the displacement of a point, by label; unstable parts dashed, critical points marked."""
    first, figure = next(iter(paths.values())), Figure(figsize=(6.4, 4.6), layout="constrained")
    axes, point = figure.subplots(), first.reference_point if point is None else point
    start = first.equilibria[0].position(point)
    places = {label: 1e3 * (path.positions(point) - start) for label, path in paths.items()}
    component = int(np.ptp(np.vstack([*places.values()]), axis=0).argmax())
    for (label, path), (colour, _) in zip(paths.items(), line_styles(paths), strict=False):
        x = places[label][:, component]
        axes.plot(x, path.factors, "--", color=colour, lw=1.0)
        for k in np.flatnonzero(path.stable[:-1] | path.stable[1:]):
            axes.plot(x[k : k + 2], path.factors[k : k + 2], color=colour, lw=2.0)
        axes.lines[-1].set_label(label or "stable")
        critical = [*path.critical_indices]
        axes.plot(x[critical], path.factors[critical], "o", ms=5, color=MEASURED)
    axes.lines[0].set_label("unstable")
    axes.lines[-1].set_label("limit point or bifurcation")
    axes.set(xlabel=f"{'xy'[component]} displacement of the point at {point:.4g} m, mm", ylabel="factor")
    axes.grid(**GRID)
    figure.legend(**LEGEND, loc="outside lower center", ncols=4)
    return figure
