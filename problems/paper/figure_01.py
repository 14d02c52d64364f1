"""Figure 1: the element with its centre line r(p), Eq. (2)."""

from __future__ import annotations

import numpy as np

from ancf_casadi.mechanics.strain import hermite
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Axes, Figure
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.drawing import line, new_figure
from problems.study.step import Finding

ENDS = np.array([[0.9, 1.9], [4.3, 1.7]])  # r0 and rl
SLOPES = np.array([[0.75, 0.66], [0.80, -0.60]])  # tau0 and taul
END_NAMES = ("0", "l")


@paper_step(section="The beam (Section 2)", title="The element", figures=("Figure 1",))
def element(compute: Compute) -> Finding:
    """Return the drawing of the element."""
    caption = (
        "Element of the beam: the positions r₀, rₗ and the slopes τ₀, τₗ of its nodes, in the inertial frame, "
        "are its coordinates; r(p) is a point of the centre line."
    )
    return Finding({}, figures=compute.drawings((caption, element_figure)))


def centre_line(ξ: Array) -> Array:
    """Return the points r(p) of the element at ξ = p/l, (k, 2), Eq. (2)."""
    return np.asarray(np.column_stack(hermite(ξ, 4.0)) @ np.array([ENDS[0], SLOPES[0], ENDS[1], SLOPES[1]]))


def element_figure() -> Figure:
    """Draw the element with the vectors r0, tau0, rl and taul."""
    figure, (axes,) = new_figure(3.3)
    axes.plot(*centre_line(np.linspace(0.0, 1.0, 60)).T, **{**line(0), "lw": 3.0})
    for end, slope, name, offset in zip(ENDS, SLOPES, END_NAMES, ((-18, 2), (6, -12)), strict=True):
        tip = end + 1.3 * slope / np.linalg.norm(slope)  # length of a drawn slope
        _arrow(axes, (0.0, 0.0), end, "--")
        _arrow(axes, end, tip, "-")
        axes.plot(*end, "ko", ms=6)
        axes.annotate(rf"$\mathbf{{r}}_{name}$", 0.45 * end, xytext=offset, textcoords="offset points", fontsize=11)
        axes.annotate(rf"$\boldsymbol{{\tau}}_{name}$", tip, xytext=(5, 0), textcoords="offset points", fontsize=11)
    middle = centre_line(np.array([0.55]))[0]  # p/l of the marked point
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
