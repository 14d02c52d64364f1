"""Bode plots: amplitude and phase of frequency response functions against frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.figures import SERIES, literal_text


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of a Bode plot.

    Parameters
    ----------
    name : str
        Name in the legend; none if empty.
    frequencies : array (k,)
        Frequencies, Hz.
    values : array (k,)
        Complex values.
    style : str, optional
        A colour; the curve is then a thin line of it.  Curves without a style differ by colours and dashes.
    phase : bool
        Whether to draw the phase.
    """

    name: str
    frequencies: Array
    values: ComplexArray
    style: str = ""
    phase: bool = True


@literal_text
def bode_figure(columns: Sequence[Sequence[Curve]], label: str, titles: Sequence[str] = ()) -> Figure:
    """Draw curves, one pair of plots per column: amplitude above, phase below.

    Parameters
    ----------
    columns : sequence of sequence of Curve
        The curves of each column.
    label : str
        Quantity and unit of the amplitude.
    titles : sequence of str
        Title of each column.
    """
    count = len(columns)
    figure = Figure(figsize=(max(7.0, 4.2 * count), 5.5), layout="constrained")
    plots = figure.subplots(2, count, squeeze=False, sharex="col", height_ratios=(1.7, 1))
    for column, curves in enumerate(columns):
        above, below = plots[:, column]
        _draw(above, below, curves)
        if column < len(titles):
            above.set_title(titles[column], fontsize="medium")
        if any(curve.name for curve in curves) and len(curves) <= 12:  # curves of a plot in its legend
            above.legend(frameon=False, fontsize="small")
        below.set(xlabel="frequency, Hz")
    plots[0, 0].set_ylabel(label)
    plots[1, 0].set_ylabel("phase, degrees")
    return figure


def _draw(above: Axes, below: Axes, curves: Sequence[Curve]) -> None:
    """Draw curves in a pair of plots."""
    for k, curve in enumerate(curves):
        colour, dash, _ = SERIES[k % len(SERIES)]
        line: dict[str, Any] = (
            {"color": curve.style, "lw": 0.8} if curve.style else {"color": colour, "ls": dash, "lw": 1.2}
        )
        above.semilogy(curve.frequencies, np.abs(curve.values), label=curve.name or None, **line)
        if curve.phase:
            below.plot(curve.frequencies, _unbroken(np.degrees(np.angle(curve.values))), **line)
    f = np.concatenate([curve.frequencies for curve in curves])
    # highest over lowest frequency, beyond which the axis is logarithmic
    if f.min() > 0.0 and f.max() > 8.0 * f.min():
        below.set_xscale("log")
    below.set(ylim=(-190.0, 190.0), yticks=[-180, -90, 0, 90, 180])
    for axes in (above, below):
        axes.grid(alpha=0.25, lw=0.6)


def _unbroken(degrees: Array) -> Array:
    """Return phase angles with nan where they jump by a turn, so that no line is drawn there."""
    broken = degrees.copy()
    broken[1:][np.abs(np.diff(degrees)) > 180.0] = np.nan
    return broken
