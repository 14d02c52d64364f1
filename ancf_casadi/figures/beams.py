"""The beam in a figure: its shape, the axes of positions, and the properties along it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import COMBINED, PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import (
    BAND,
    COMPUTED,
    GRID,
    LEGEND_ABOVE,
    MEASURED,
    PAGE_WIDTH,
    REFERENCE,
    SERIES,
    literal_text,
)


def points_along(model: Model, coordinates: Array) -> Array:
    """Return the positions (2, k) along a beam, mm."""
    points = np.linspace(0.0, model.beam.length, 60).tolist()
    return 1e3 * np.array([model.interpolation(s) @ coordinates for s in points]).T


def draw_plane(axes: Axes) -> None:
    """Draw the axes of positions."""
    axes.set(xlabel="horizontal position x, mm", ylabel="vertical position y, mm")
    axes.set_aspect("equal", adjustable="datalim")  # fills the panel, whether the beam stands or lies
    axes.grid(**GRID)


def line_styles(results: Mapping[str, object]) -> list[tuple[str, Any]]:
    """Return colour and dashes of each result; a single result is drawn as a computed curve."""
    return [(COMPUTED, "-")] if len(results) == 1 else [line[:2] for line in SERIES * len(results)]


@literal_text
def match_figure(targets: Array, standard: Array, matched: Array, initial_beam: Beam, matched_beam: Beam,
                 ranges: Mapping[str, Array]) -> Figure:  # fmt: skip
    """Draw the deviations of natural frequencies (Hz) from their targets, and below the changes of the properties."""
    height = 0.7 + 0.8 * len(ranges)  # inches, of the properties
    figure = Figure(figsize=(PAGE_WIDTH, 1.5 + height), layout="constrained")
    frequency_panel, property_panel = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.5, height)).ravel()
    axes, places = frequency_panel.subplots(), np.arange(len(targets))
    for frequencies, label, colour, marker in (
        (standard, "given beam", MEASURED, "x"),
        (matched, "matched", COMPUTED, "o"),
    ):
        axes.plot(places, 100 * (frequencies / targets - 1), marker, color=colour, label=label)
    axes.axhline(0.0, **REFERENCE)
    axes.margins(y=0.2)
    axes.set(ylabel="deviation, %", xlabel="measured frequency", xticks=places,
             xticklabels=[f"{target:.5g} Hz" for target in targets])  # fmt: skip
    axes.legend(**LEGEND_ABOVE)
    _draw_properties(property_panel, initial_beam, matched_beam, ranges)
    return figure


def _draw_properties(figure: SubFigure, initial_beam: Beam, matched_beam: Beam, ranges: Mapping[str, Array]) -> None:
    """Draw the relative change of the properties along a beam, and the ranges that fit equally well.

    ``ranges`` holds the lowest and highest relative change of each property to draw: (n, 2) by element, or (1, 2) for
    all elements.
    """
    edges = 1e3 * matched_beam.node_points
    plots = figure.subplots(len(ranges), 1, sharex=True, squeeze=False).ravel()
    for axes, name in zip(plots, (name for name in (*PROPERTIES, *COMBINED) if name in ranges), strict=True):
        change = 100 * (np.array(getattr(matched_beam, name)) / np.array(getattr(initial_beam, name)) - 1)
        low, high = 100 * np.broadcast_to(ranges[name], (matched_beam.elements, 2)).T
        axes.fill_between(edges, np.append(low, low[-1]), np.append(high, high[-1]), step="post", color=COMPUTED,
                          **BAND, label="fits equally well")  # fmt: skip
        axes.stairs(change, edges, baseline=None, color=COMPUTED, lw=1.5, label="matched")
        axes.axhline(0.0, **REFERENCE)
        axes.set(ylabel="{}, %".format(name.replace("_", "\n")), xlim=(0.0, edges[-1]))
    plots[0].legend(**LEGEND_ABOVE)
    plots[-1].set(xlabel="arc length, mm")
    figure.align_ylabels()
