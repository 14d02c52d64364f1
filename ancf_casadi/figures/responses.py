"""Figures of response curves, backbones, periodic motions and frequency response functions, by label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.response.backbone import Backbone
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.linear_frf import LinearFrf
from ancf_casadi.response.periodic import PERIOD_SAMPLES, PeriodicMotion
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.figures import GRID, LEGEND, SERIES, literal_text

BIFURCATION_MARKERS = {"fold": "o", "branch point": "D", "period doubling": "s", "Neimark-Sacker": "^"}
UNSTABLE_DASH = (0, (4, 2))
FIGURE_SIZE = (6.4, 5.6)  # inches


@literal_text
def response_figure(curves: Mapping[str, ResponseCurve], point: float | None = None) -> Figure:
    """Draw amplitude and phase of a point along curves, by label; unstable motions are dashed, bifurcations marked."""
    figure = Figure(figsize=FIGURE_SIZE, layout="constrained")
    above, below = _two_axes(figure, sharex=True, height_ratios=(2, 1))
    first = next(iter(curves.values()))
    name, unit = first.quantity
    if any(curve.quantity != first.quantity for curve in curves.values()):
        raise InputError(f"the curves must be over the same quantity, here {name}", "figure")
    beam = first.motions[0].excited.model is not None
    kinds: set[str] = set()
    for (label, curve), (colour, _, _) in zip(curves.items(), SERIES * len(curves), strict=False):
        x, stable = curve.values, curve.stable
        amplitude, phase = (1e3 if beam else 1.0) * curve.amplitude(point), np.degrees(curve.phase(point))
        for axes, y in ((above, amplitude), (below, phase)):
            draw_branches(axes, x, y, stable, label if axes is above else None, color=colour)
        for bifurcation in curve.bifurcations:
            k, marker = bifurcation.index, BIFURCATION_MARKERS[bifurcation.kind]
            above.plot(x[k], amplitude[k], marker, color=colour, fillstyle="none", markersize=5)
            kinds.add(bifurcation.kind)
    above.set_ylabel("amplitude (mm)" if beam else "amplitude")
    below.set_ylabel("phase (degrees)")
    below.set_xlabel(f"{name} ({unit})" if unit else name)
    _legend(above, kinds, any((~curve.stable).any() for curve in curves.values()))
    return figure


def _two_axes(figure: Figure, **settings: Any) -> tuple[Axes, Axes]:
    """Return two diagrams of a figure, one below the other."""
    above, below = figure.subplots(2, 1, **settings)
    for axes in (above, below):
        axes.grid(**GRID)
    return above, below


def draw_branches(
    axes: Axes, x: Array, y: Array, stable: NDArray[np.bool_], label: str | None = None, **style: Any
) -> None:
    """Draw a curve, in its style where stable and dashed where not."""
    solid, dashed = np.where(stable, y, np.nan), np.where(stable, np.nan, y)
    edges = np.flatnonzero(stable[1:] != stable[:-1])
    dashed[edges], dashed[edges + 1] = y[edges], y[edges + 1]
    axes.plot(x, solid, label=label or None, **style)
    axes.plot(x, dashed, **style | {"linestyle": UNSTABLE_DASH, "lw": 1.0, "marker": ""})


def _legend(axes: Axes, kinds: set[str], unstable: bool) -> None:
    """Add a legend of labels, bifurcations and dashes, if there is anything to explain."""
    handles, labels = axes.get_legend_handles_labels()
    if unstable:
        handles.append(Line2D([], [], color="0.4", linestyle=UNSTABLE_DASH, linewidth=1.0))
        labels.append("unstable")
    for kind in BIFURCATION_MARKERS:
        if kind in kinds:
            handles.append(
                Line2D([], [], color="0.4", marker=BIFURCATION_MARKERS[kind], fillstyle="none", linestyle="none")
            )
            labels.append(kind)
    if handles:
        axes.legend(handles, labels)


@literal_text
def backbone_figure(backbones: Mapping[str, Backbone]) -> Figure:
    """Draw frequency and damping ratio against amplitude, by label."""
    figure = Figure(figsize=FIGURE_SIZE, layout="constrained")
    above, below = _two_axes(figure, sharex=True)
    beam = next(iter(backbones.values())).motions[0].excited.model is not None
    for (label, curve), (colour, dash, _) in zip(backbones.items(), SERIES * len(backbones), strict=False):
        x = (1e3 if beam else 1.0) * curve.amplitudes
        above.plot(x, curve.frequencies, color=colour, linestyle=dash, label=label or None)
        below.plot(x, 100.0 * curve.damping_ratios, color=colour, linestyle=dash)
    above.set_ylabel("frequency (Hz)")
    below.set_ylabel("damping ratio (%)")
    below.set_xlabel("amplitude (mm)" if beam else "amplitude")
    for axes in (above, below):
        axes.ticklabel_format(axis="y", useOffset=False)
    if any(backbones):
        above.legend()
    return figure


@literal_text
def periodic_figure(motions: Mapping[str, PeriodicMotion]) -> Figure:
    """Draw the displacement of the tip, or of the first coordinate, over a period, and the size of its harmonics."""
    figure = Figure(figsize=FIGURE_SIZE, layout="constrained")
    above, below = _two_axes(figure)
    beam = bool(next(iter(motions.values())).excited.unit)
    scale, phases = 1e3 if beam else 1.0, np.linspace(0.0, 1.0, PERIOD_SAMPLES + 1)
    for (label, motion), (colour, dash, marker) in zip(motions.items(), SERIES * len(motions), strict=False):
        displacement = scale * motion.displacement()
        above.plot(phases, np.append(displacement, displacement[0]), color=colour, linestyle=dash, label=label or None)
        size = scale * np.abs(motion.harmonics()[: motion.harmonic_count + 1])
        below.semilogy(range(len(size)), size, marker, color=colour, fillstyle="none")
    unit = " (mm)" if beam else ""
    above.set(xlabel="time (periods of the excitation)", ylabel=f"displacement{unit}")
    below.set(xlabel="harmonic", ylabel=f"amplitude{unit}")
    if any(motions):
        above.legend()
    return figure


def frf_figure(functions: Mapping[str, LinearFrf]) -> Figure:
    """Draw amplitude and phase of frequency response functions against frequency (Bode plot)."""
    first = next(iter(functions.values()))
    if any(frf.kind != first.kind for frf in functions.values()):
        raise InputError(f"the functions must be of the same kind, here {first.kind}", "figure")
    curves = [
        Curve(f"{label}, {name}" if label else name, frf.frequencies, values)
        for label, frf in functions.items()
        for names, row in zip(frf.labels(), frf.values, strict=True)
        for name, values in zip(names, row, strict=True)
    ]
    return bode_figure([curves], first.kind.replace("-", " ") + (f", {first.unit}" if first.unit != "1" else ""))


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of a Bode plot."""

    name: str  # in the legend; none if empty
    frequencies: Array  # (k,), Hz
    values: ComplexArray  # (k,)
    style: str = ""  # colour of a thin line; curves without a style differ by colours and dashes
    phase: bool = True  # whether to draw the phase


@literal_text
def bode_figure(columns: Sequence[Sequence[Curve]], label: str, titles: Sequence[str] = ()) -> Figure:
    """Draw curves, one pair of plots per column: amplitude above, phase below."""
    count = len(columns)
    figure = Figure(figsize=(max(7.0, 4.2 * count), 5.5), layout="constrained")
    plots = figure.subplots(2, count, squeeze=False, sharex="col", height_ratios=(1.7, 1))
    for column, curves in enumerate(columns):
        above, below = plots[:, column]
        _draw_bode(above, below, curves)
        if column < len(titles):
            above.set_title(titles[column], fontsize="medium")
        if any(curve.name for curve in curves) and len(curves) <= 12 and count == 1:  # curves of a plot in its legend
            above.legend(**LEGEND)
        below.set(xlabel="frequency, Hz")
    if count > 1:
        figure.legend(*plots[0, 0].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=3)
    plots[0, 0].set_ylabel(label)
    plots[1, 0].set_ylabel("phase, degrees")
    return figure


def _draw_bode(above: Axes, below: Axes, curves: Sequence[Curve]) -> None:
    """Draw curves in a pair of plots."""
    for k, curve in enumerate(curves):
        colour, dash, _ = SERIES[k % len(SERIES)]
        line: dict[str, Any] = (
            {"color": curve.style, "lw": 0.8} if curve.style else {"color": colour, "ls": dash, "lw": 1.2}
        )
        above.semilogy(curve.frequencies, np.abs(curve.values), label=curve.name or None, **line)
        if curve.phase:
            below.plot(curve.frequencies, _break_at_jumps(np.degrees(np.angle(curve.values))), **line)
    f = np.concatenate([curve.frequencies for curve in curves])
    # highest over lowest frequency, beyond which the axis is logarithmic
    if f.min() > 0.0 and f.max() > 8.0 * f.min():
        below.set_xscale("log")
    below.set(ylim=(-190.0, 190.0), yticks=[-180, -90, 0, 90, 180])
    for axes in (above, below):
        axes.grid(**GRID)


def _break_at_jumps(degrees: Array) -> Array:
    """Return phase angles with nan where they jump by a turn, so that no line is drawn there."""
    result = degrees.copy()
    result[1:][np.abs(np.diff(degrees)) > 180.0] = np.nan
    return result
