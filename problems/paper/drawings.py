"""The drawings of the paper, and the reason why other figures are not computed.

The drawings are the element, Figure 1, with its centre line r(p) of Eq. (2), and the assumed deflection, Figure 11: a
cantilever under a uniform load, Eq. (21), beside its first mode.  The computed deflection is the static equilibrium of
a beam under a small weight across its axis, divided by the displacement of the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import hermite
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Axes, Figure
from ancf_casadi.vibration.modes import natural_modes
from ancf_casadi.vibration.statics import static_equilibrium
from problems.study.drawing import drawn, line, new_figure, series
from problems.study.part import Finding, Found

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

ENDS = np.array([[0.9, 1.9], [4.3, 1.7]])  # r0 and rl
SLOPES = np.array([[0.75, 0.66], [0.80, -0.60]])  # tau0 and taul
END_NAMES = ("0", "l")


def element(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
    """Return the drawing of the element."""
    caption = (
        "Element of the beam: the positions r₀, rₗ and the slopes τ₀, τₗ of its nodes, in the inertial frame, "
        "are its coordinates; r(p) is a point of the centre line."
    )
    return Finding({}, figures=(drawn(caption, element_figure),))


def uniform_load(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
    """Return the assumed deflection, and the largest differences of the computed ones, relative to that of the tip."""
    places, bent, mode = deflections(part.beam_in(found))
    caption = (
        "Deflection of the beam under a uniform load, relative to that of the tip: Eq. (21), the computed "
        "equilibrium, and mode 1 beside them.  Below: differences from Eq. (21)."
    )
    differences = {
        "uniform_load_difference": float(np.abs(bent - ASSUMED_SHAPE(places)).max()),
        "mode_1_difference": float(np.abs(mode - ASSUMED_SHAPE(places)).max()),
    }
    return Finding(differences, figures=(drawn(caption, lambda: deflection_figure(places, bent, mode)),))


def omitted(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
    """Return the labels of what is not computed, and the reason."""
    return Finding({"omitted": [*part.tables, *part.figures], "reason": part.text})


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


def deflections(beam: Beam) -> tuple[Array, Array, Array]:
    """Return places along a beam without gravity, its deflection there under a uniform load, and its mode 1."""
    x, y = beam.axis
    across = np.array([-y, x])
    weightless = beam.with_(gravity=(0.0, 0.0))
    stiffness = min(np.array(beam.elastic_modulus) * np.array([s.second_moment for s in beam.sections]))
    # deflection of the tip relative to the length
    acceleration = 1e-3 * 8 * stiffness / (beam.mass * beam.length**2)  # w = mu g L^4/(8 E I)
    loaded = static_equilibrium(Model(beam.with_(gravity=tuple(acceleration * across))))
    modes = natural_modes(Model(weightless), count=1)
    places = np.linspace(0.0, 1.0, 51)
    points = [modes.model.interpolation(float(s)) for s in places * beam.length]
    bent, mode = (np.array([point @ e for point in points]) @ across for e in (loaded.coordinates, modes.shapes[:, 0]))
    return places, bent / bent[-1], mode / mode[-1]


def deflection_figure(places: Array, bent: Array, mode: Array) -> Figure:
    """Draw the deflections, and below their differences from Eq. (21)."""
    figure, (deflection, difference) = new_figure(4.2, 2, sharex=True, height_ratios=(2, 1))
    assumed, computed = ASSUMED_SHAPE(places), {**series(2), "linestyle": ""}
    deflection.plot(places, assumed, **line(0), label="Eq. (21)")
    deflection.plot(places[::5], bent[::5], **computed, ms=5, label="computed, uniform load")
    deflection.plot(places, mode, **line(1), label="computed, mode 1")
    deflection.set(ylabel="deflection / deflection of the tip")
    deflection.legend()
    difference.plot(places[::5], 100 * (bent - assumed)[::5], **computed, ms=5)
    difference.plot(places, 100 * (mode - assumed), **line(1))
    difference.set(xlabel="arc length / length of the beam", ylabel="difference\nfrom Eq. (21), %")
    figure.align_ylabels()
    return figure
