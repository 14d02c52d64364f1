"""Figures of fits of a beam, made without a display: one column of diagrams for each kind of measurement."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure, SubFigure

from ancf_casadi.estimation.figures import saved_figure
from ancf_casadi.support.figures import literal_text
from problems.beam.curves.block import CurveBlock
from problems.beam.curves.figures import draw_responses, response_size
from problems.beam.motions.block import MotionBlock
from problems.beam.motions.figures import draw_motions, motion_size
from problems.beam.values.block import ValueBlock
from problems.beam.values.figures import draw_values, value_size
from problems.beam.values.prediction import predicted

if TYPE_CHECKING:
    from problems.beam.result import BeamFit

Drawer = Callable[[Figure | SubFigure], Figure | SubFigure]


@literal_text
def beam_figure(fits: Mapping[str, BeamFit]) -> Figure:
    """Draw measured and computed motions, response curves and values of a fit; of several fits the estimates."""
    if len(fits) > 1:
        return saved_figure(fits)
    (fit,) = fits.values()
    parts = _parts(fit)
    width, height = sum(size[0] for size, _ in parts), max(size[1] for size, _ in parts)
    figure = Figure(figsize=(width, height), layout="constrained")
    if len(parts) == 1:
        parts[0][1](figure)
        return figure
    columns: Any = figure.subfigures(1, len(parts), width_ratios=[size[0] for size, _ in parts])
    for column, (_, draw) in zip(columns, parts, strict=True):
        draw(column)
    return figure


def _parts(fit: BeamFit) -> list[tuple[tuple[float, float], Drawer]]:
    """Return the size in inches and the drawing of each kind of measurement."""
    blocks, parts = fit.solution.problem.blocks, list[tuple[tuple[float, float], Drawer]]()
    motions = [record for block in blocks if isinstance(block, MotionBlock) for record in block.records]
    curves = [record for block in blocks if isinstance(block, CurveBlock) for record in block.records]
    values = [predicted(block, fit.fit) for block in blocks if isinstance(block, ValueBlock)]
    if motions:
        parts.append((motion_size(motions), lambda figure: draw_motions(figure, motions, fit.residuals)))
    if curves:
        amplitudes, phases = [own[0] for own in fit.responses], [own[1] for own in fit.responses]
        parts.append((response_size(curves), lambda figure: draw_responses(figure, curves, amplitudes, phases)))
    if values:
        parts.append((value_size(values), lambda figure: draw_values(figure, values)))
    return parts
