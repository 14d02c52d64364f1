"""The two-node element, Figure 1: positions and slopes of its ends as vectors of the inertial frame.

The centre line is r(p) of Eq. (2) for the drawn vectors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.mechanics.shape import hermite
from ancf_casadi.support.arrays import Array
from problems.study.drawing import line, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LENGTH = 4.0  # l, in the units of the drawing
ENDS = np.array([[0.9, 1.9], [4.3, 1.7]])  # r0 and rl
SLOPES = np.array([[0.75, 0.66], [0.80, -0.60]])  # tau0 and taul
DRAWN_SLOPE = 1.3  # length of a drawn slope
NAMES = ("0", "l")
MARKED = 0.55  # p/l of the marked point


def centre_line(ξ: Array) -> Array:
    """Return the points r(p) of the element at ξ = p/l, (k, 2), Eq. (2)."""
    return np.asarray(np.column_stack(hermite(ξ, LENGTH)) @ np.array([ENDS[0], SLOPES[0], ENDS[1], SLOPES[1]]))


def element_figure() -> Figure:
    """Draw the element with the vectors r0, tau0, rl and taul."""
    figure, (axes,) = new_figure(3.3)
    axes.plot(*centre_line(np.linspace(0.0, 1.0, 60)).T, **{**line(0), "lw": 3.0})
    for end, slope, name, offset in zip(ENDS, SLOPES, NAMES, ((-18, 2), (6, -12)), strict=True):
        tip = end + DRAWN_SLOPE * slope / np.linalg.norm(slope)
        _arrow(axes, (0.0, 0.0), end, "--")
        _arrow(axes, end, tip, "-")
        axes.plot(*end, "ko", ms=6)
        axes.annotate(rf"$\mathbf{{r}}_{name}$", 0.45 * end, xytext=offset, textcoords="offset points", fontsize=11)
        axes.annotate(rf"$\boldsymbol{{\tau}}_{name}$", tip, xytext=(5, 0), textcoords="offset points", fontsize=11)
    middle = centre_line(np.array([MARKED]))[0]
    _arrow(axes, (0.0, 0.0), middle, ":")
    axes.plot(*middle, "o", ms=5, mfc="white", mec="black")
    axes.annotate(r"$\mathbf{r}(p)$", middle, xytext=(-6, 8), textcoords="offset points", fontsize=11)
    for unit, name in (((5.6, 0.0), "x"), ((0.0, 3.6), "y")):
        _arrow(axes, (0.0, 0.0), unit, "-")
        axes.annotate(name, unit, xytext=(4, 4), textcoords="offset points", style="italic")
    axes.annotate("O", (0.0, 0.0), xytext=(-11, -10), textcoords="offset points", style="italic")
    axes.set(xlim=(-0.4, 6.1), ylim=(-0.5, 3.9), aspect="equal")
    axes.set_axis_off()
    return figure


def _arrow(axes: Axes, start: object, end: object, dash: str) -> None:
    arrow = {"arrowstyle": "-|>", "color": "black", "linestyle": dash, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow)  # type: ignore[arg-type]
