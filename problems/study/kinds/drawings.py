"""Parts without computed numbers: a drawing, and the reason why tables and figures are not computed.

The drawings are the element, Figure 1 of the paper, with its centre line r(p) of Eq. (2), and the assumed deflection,
Figure 11: a cantilever under a uniform load, Eq. (21), beside its first mode.  The computed deflection is the static
equilibrium of a beam under a small weight across its axis, divided by the displacement of the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypedDict, final

import numpy as np
from msgspec import Meta

from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import hermite
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import static_equilibrium
from ancf_casadi.vibration.modes import natural_modes
from problems.study.drawing import drawn, line, new_figure, series
from problems.study.part import Effort, Finding, Found, Part
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDS = np.array([[0.9, 1.9], [4.3, 1.7]])  # r0 and rl
SLOPES = np.array([[0.75, 0.66], [0.80, -0.60]])  # tau0 and taul
END_NAMES = ("0", "l")


class DrawingNumbers(TypedDict, total=False):
    """Largest differences of the computed deflections from Eq. (21), relative to that of the tip; none for others."""

    uniform_load_difference: float
    mode_1_difference: float


@final
@dataclass(frozen=True, kw_only=True)
class DrawingPart(Part):
    """A drawing."""

    kind, about, heading = "drawing", "{}", "Drawing"
    numbers = DrawingNumbers
    naming = ("beam",)

    subject: Annotated[
        Literal["element", "uniform-load"],
        Meta(
            description='"element": a two-node element with its coordinates; "uniform-load": the deflection under a '
            "uniform load beside mode 1"
        ),
    ]
    beam: Annotated[str, Meta(description='"PART"')] = ""

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the drawing."""
        if self.subject == "element":
            caption = (
                "Element of the beam: the positions r₀, rₗ and the slopes τ₀, τₗ of its nodes, in the inertial frame, "
                "are its coordinates; r(p) is a point of the centre line."
            )
            return Finding({}, figures=(drawn(self.name, caption, element_figure),))
        shapes = deflections(self.beam_in(found))
        differences = {
            "uniform_load_difference": float(np.abs(shapes.uniform_load - shapes.assumed).max()),
            "mode_1_difference": float(np.abs(shapes.mode - shapes.assumed).max()),
        }
        caption = (
            "Deflection of the beam under a uniform load, relative to that of the tip: Eq. (21), the computed "
            "equilibrium, and mode 1 beside them.  Below: differences from Eq. (21)."
        )
        return Finding(differences, figures=(drawn(self.name, caption, lambda: deflection_figure(shapes)),))


class OmittedNumbers(TypedDict):
    """Labels that are not computed, and the reason."""

    omitted: list[str]
    reason: str


@final
@dataclass(frozen=True, kw_only=True)
class Omitted(Part):
    """Tables and figures that are not computed."""

    kind, about, heading = "omitted", "{}", "Not computed"
    numbers = OmittedNumbers

    reason: Annotated[str, Meta(description="why the labelled tables and figures are not computed")]

    def checked(self, source: Source, where: str) -> Self:
        """Return the part, which must have a reason."""
        if not self.reason.strip():
            raise InputError("must not be empty; say why the tables and figures are not computed", f"{where}: reason")
        return self

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the reason."""
        return Finding({"omitted": [*self.tables, *self.figures], "reason": self.reason})


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


@dataclass(frozen=True, eq=False)
class Deflection:
    """Deflections along a cantilever, relative to that of the tip.

    Parameters
    ----------
    places : ndarray
        Arc length relative to the length of the beam (k,).
    uniform_load : ndarray
        Computed deflection under a uniform load (k,).
    assumed : ndarray
        The shape of Eq. (21) (k,).
    mode : ndarray
        Mode 1 (k,).
    """

    places: Array
    uniform_load: Array
    assumed: Array
    mode: Array


def deflections(beam: Beam) -> Deflection:
    """Return the deflections of a beam without gravity.

    Raises
    ------
    EquilibriumError
        If no equilibrium is found.
    """
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
    return Deflection(places, bent / bent[-1], ASSUMED_SHAPE(places), mode / mode[-1])


def deflection_figure(shapes: Deflection) -> Figure:
    """Draw the deflections, and below their differences from Eq. (21)."""
    figure, (deflection, difference) = new_figure(4.2, 2, sharex=True, height_ratios=(2, 1))
    deflection.plot(shapes.places, shapes.assumed, **line(0), label="Eq. (21)")
    computed = {**series(2), "linestyle": ""}
    deflection.plot(shapes.places[::5], shapes.uniform_load[::5], **computed, ms=5, label="computed, uniform load")
    deflection.plot(shapes.places, shapes.mode, **line(1), label="computed, mode 1")
    deflection.set(ylabel="deflection / deflection of the tip")
    deflection.legend()
    difference.plot(shapes.places[::5], 100 * (shapes.uniform_load - shapes.assumed)[::5], **computed, ms=5)
    difference.plot(shapes.places, 100 * (shapes.mode - shapes.assumed), **line(1))
    difference.set(xlabel="arc length / length of the beam", ylabel="difference\nfrom Eq. (21), %")
    figure.align_ylabels()
    return figure
