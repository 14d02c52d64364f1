"""Figures of fits of a beam, made without a display."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ancf_casadi.estimation.figures import channels_figure, saved_figure

if TYPE_CHECKING:
    from problems.beam.result import BeamFit


def beam_figure(fits: Mapping[str, BeamFit]) -> Figure:
    """Draw measured and computed motions, response curves and values of a fit; of several fits the estimates."""
    if len(fits) > 1:
        return saved_figure(fits)
    ((label, fit),) = fits.items()
    return channels_figure({label: [one for block, fitted in fit.solution.parts for one in block.channels(fitted)]})
