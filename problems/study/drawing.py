"""Figures of a document: one style, readable in grey, on a phone, on light and on dark pages.

A figure is 5.2 inches wide with panels below each other, so that its letters stay readable on a narrow page.  Curves
differ in dash and marker as well as in colour.  Text and axes are black; a page shows them in its own text colour.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.support.arrays import Array, extremes
from ancf_casadi.support.figures import BAND, DOTS_PER_INCH, PAGE_WIDTH, SERIES, Axes, Figure, literal_text

STYLE: dict[Any, Any] = {
    "font.size": 9.6,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.color": "#808080",
    "svg.fonttype": "none",
    "svg.hashsalt": "ancf-casadi",
}

_one_at_a_time = threading.Lock()  # the style is one for all threads
FORMATS = ("svg", "png")


@dataclass(frozen=True)
class Drawing:
    """A figure of a document."""

    caption: str
    svg: str
    png: bytes
    moving: bytes = b""  # GIF file below it, if any
    name: str = ""  # label


def render(caption: str, draw: Callable[[], Figure], formats: Sequence[str] = FORMATS) -> Drawing:
    """Draw a figure in the style of the documents, identical for identical data; each format takes a tenth of a second.

    Without a format nothing is drawn.
    """
    svg, png = io.StringIO(), io.BytesIO()
    if not formats:
        return Drawing(caption, "", b"")
    from matplotlib import rc_context  # slow to import

    with _one_at_a_time, rc_context(STYLE):
        figure = literal_text(draw)()
        if engine := figure.get_layout_engine():
            figure.set_dpi(DOTS_PER_INCH)  # letters are wider than at fewer dots
            engine.execute(figure)
            figure.set_layout_engine(None)  # which would compute the layout, and draw, once more for each file
        if "svg" in formats:
            figure.savefig(svg, format="svg", transparent=True, metadata={"Date": None})
        if "png" in formats:
            figure.savefig(png, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        return Drawing(caption, svg.getvalue(), png.getvalue())


def new_figure(height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure of the usual width and a height in inches, and its panels, row by row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False, **options).ravel())


def mark_synthetic(figure: Figure) -> Figure:
    """Write on a figure that its data are synthetic."""
    figure.suptitle("SYNTHETIC DATA", fontsize=9, ha="right", x=0.98)
    return figure


def series(number: int) -> dict[str, Any]:
    """Return colour, dash and marker of a curve, from 0, as arguments of ``Axes.plot``."""
    colour, dash, marker = SERIES[number % len(SERIES)]
    return {"color": colour, "linestyle": dash, "marker": marker}


def line(number: int) -> dict[str, Any]:
    """Return colour and dash of a curve without markers."""
    return {**series(number), "marker": ""}


def band(time: Array, values: Array, frequency: float) -> Array:
    """Return times and extremes, (3, k), of a vibration of a frequency (Hz): its samples if it has few periods."""
    periods = float(time[-1] - time[0]) * frequency
    if periods < 25:  # so few are drawn in full
        step = max(1, len(time) // 1000)
        return np.array([time[::step], values[::step], values[::step]])
    return np.array(extremes(time, values, int(min(periods, 300))))


def draw_band(axes: Axes, shown: Array, scale: float, *, filled: bool = False, **style: Any) -> None:
    """Draw what ``band`` returns, times a factor: samples as a line, extremes as two lines or as a filled area."""
    time, low, high = shown
    if np.array_equal(low, high):
        axes.plot(time, scale * low, **style)
    elif filled:
        axes.fill_between(time, scale * low, scale * high, color=style["color"], **BAND,
                          label=style.get("label"))  # fmt: skip
    else:
        axes.plot(time, scale * high, **style)
        axes.plot(time, scale * low, **{**style, "label": None})
