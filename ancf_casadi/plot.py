"""Figures of records, fits, motions and properties, drawn without a display.

Each function returns a matplotlib ``Figure``; ``figure_bytes`` converts a figure to a PNG, SVG or PDF file.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from ancf_casadi.beam_symbols import draw_loads, draw_symbols
from ancf_casadi.decay.envelope import DampingCurve, LawCurve, draw_against_amplitude
from ancf_casadi.decay.spectrum import power_spectrum
from ancf_casadi.dynamics.damped_modes import DampedModes
from ancf_casadi.dynamics.trajectory import Motion
from ancf_casadi.estimation.figures import draw_autocorrelation
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, SERIES, literal_text, si_prefix
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes
from ancf_casadi.vibration.paths import EquilibriumPath

DATE_FIELDS = {".png": "Software", ".svg": "Date", ".pdf": "CreationDate"}  # metadata that would differ between runs
DOTS_PER_INCH = 130
SHAPE_SHARE = 0.15  # largest displacement in a drawn mode, relative to the length of the beam
PLOT_COLUMNS = 600  # intervals of a long record, each drawn by its extremes


def figure_bytes(figure: Figure, suffix: str = ".png") -> bytes:
    """Return the content of a PNG, SVG or PDF file with a figure, identical for identical figures."""
    kind = suffix.lower()
    if kind not in DATE_FIELDS:
        raise InputError(f"must end in {', '.join(DATE_FIELDS)}, got {suffix or 'no suffix'!r}", "figure")
    out = io.BytesIO()
    with rc_context({"svg.hashsalt": "ancf-casadi"}):  # a random one would change the bytes
        figure.savefig(out, format=kind[1:], dpi=DOTS_PER_INCH, bbox_inches="tight", metadata={DATE_FIELDS[kind]: None})
    return out.getvalue()


@literal_text
def decay_figure(
    time: Array,
    measured: Array,
    curve: Callable[[ArrayLike], Array],
    *,
    unit: str,
    values: str,
    law: LawCurve,
    points: DampingCurve | None,
) -> Figure:
    """Draw a decay: record and fit, residuals, their autocorrelation, damping ratio and frequency against amplitude.

    ``time`` (s) starts at the release, ``curve`` returns the fit at any times, and ``values`` is a title with the
    estimates.  ``points`` are damping ratio and frequency in windows of the record, ``law`` those of the fitted law.
    """
    figure = Figure(figsize=(9, 9), layout="constrained")
    over_time, below, lowest = figure.subfigures(3, 1, squeeze=False, height_ratios=(1.2, 1, 1)).ravel()
    _draw_fit(over_time, below, time, measured, curve, values, unit)
    axes = lowest.subplots(1, 2)
    draw_against_amplitude(axes, points, law)
    axes[0].legend(frameon=False, fontsize="small")
    return figure


@literal_text
def decay_modes_figure(
    time: Array,
    measured: Array,
    fitted: Array,
    unit: str,
    amplitudes: Mapping[str, Array],
    frequencies: Sequence[float],
) -> Figure:
    """Draw a decay in several modes: record and fit, the residuals, spectra, and the amplitude of each mode.

    ``amplitudes`` holds that of each mode at the times (s), by its label.
    """
    figure = Figure(figsize=(9, 9), layout="constrained")
    over_time, below, lowest = figure.subfigures(3, 1, squeeze=False, height_ratios=(1.2, 1, 1)).ravel()
    _draw_fit(over_time, below, time, measured, lambda t: np.interp(np.asarray(t, dtype=float), time, fitted),
              "; ".join(amplitudes), unit)  # fmt: skip
    spectrum_axes, amplitude_axes = lowest.subplots(1, 2)
    end = 2 * max(frequencies)
    for values, label, colour in ((measured, "record", MEASURED), (measured - fitted, "record less fit", COMPUTED)):
        frequency, power = power_spectrum(time, values - values.mean())
        in_range = (frequency > 0.0) & (frequency <= end)
        spectrum_axes.semilogy(frequency[in_range], np.sqrt(power[in_range]), lw=0.8, color=colour,
                          label=label)  # fmt: skip
    for mode_frequency in frequencies:
        spectrum_axes.axvline(mode_frequency, ls=":", lw=0.8, color=MEASURED)
    spectrum_axes.set(xlabel="frequency, Hz", ylabel="spectrum", yticks=[])
    spectrum_axes.legend(frameon=False, fontsize="small")
    size, name = si_prefix(float(np.abs(measured).max()), unit)
    for (label, amplitude), (tint, *_) in zip(amplitudes.items(), itertools.cycle(SERIES)):
        amplitude_axes.semilogy(time, amplitude / size, color=tint, label=label)
    amplitude_axes.set(xlabel="time, s", ylabel=f"amplitude of each mode, {name}" if name else "amplitude of each mode")
    amplitude_axes.legend(frameon=False, fontsize="small")
    return figure


def _draw_fit(
    figure: SubFigure,
    below: SubFigure,
    time: Array,
    measured: Array,
    curve: Callable[[ArrayLike], Array],
    title: str,
    unit: str,
) -> None:
    """Draw a record and a fit, and below the residuals and their autocorrelation."""
    fitted = curve(time)
    turns = np.flatnonzero(np.diff(np.sign(fitted - np.median(fitted))))
    is_long = len(turns) > 2 * 40  # half periods; fewer are drawn in full
    size, name = si_prefix(float(np.abs(measured).max()), unit)
    plots = figure.subplots(1, 2, width_ratios=(3, 2), sharey=True) if is_long else [figure.subplots()]
    if is_long:
        columns = min(PLOT_COLUMNS, len(turns) // 2)  # a period or more in each
        plots[0].fill_between(*_extremes(time, measured / size, columns), color=MEASURED, alpha=0.35, lw=0,
                              label="record, extremes")  # fmt: skip
        begins, *lines = _extremes(time, fitted / size, columns)
        for line, label in zip(lines, (None, "fit, extremes"), strict=True):
            plots[0].plot(begins, line, lw=1, color=COMPUTED, label=label)
    end = time[turns[2 * 8]] if is_long else time[-1]  # the periods drawn beside the extremes
    in_range = time <= end
    fine_times = np.linspace(time[0], end, 4000)  # points of a drawn curve
    plots[-1].plot(time[in_range], measured[in_range] / size, ".", ms=3, color=MEASURED, label="record")
    plots[-1].plot(fine_times, curve(fine_times) / size, lw=1, color=COMPUTED, label="fit")
    for axes in plots:
        axes.set(xlabel="time, s")
    plots[0].legend(frameon=False, fontsize="small", loc="upper right")
    plots[0].set(ylabel=f"record, {name}" if name else "record")
    if title:
        figure.suptitle(title, fontsize="medium")
    residual_axes, correlation_axes = below.subplots(1, 2)
    _draw_residuals(residual_axes, time, measured - fitted, unit)
    draw_autocorrelation(correlation_axes, measured - fitted)


def _extremes(time: Array, values: Array, columns: int) -> tuple[Array, Array, Array]:
    """Return the begin of each column of a diagram, and the smallest and the largest value in it."""
    edges = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], columns, endpoint=False)))
    return time[edges], np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


def _draw_residuals(axes: Axes, time: Array, residuals: Array, unit: str) -> None:
    """Draw residuals over time; if there are many samples, their extremes."""
    size, name = si_prefix(float(np.abs(residuals).max()), unit)
    if len(time) > 2 * PLOT_COLUMNS:
        axes.fill_between(*_extremes(time, residuals / size, PLOT_COLUMNS), color=MEASURED, lw=0)
    else:
        axes.plot(time, residuals / size, lw=0.6, color=MEASURED)
    axes.set(xlabel="time, s", ylabel=f"record less fit, {name}" if name else "record less fit")


@literal_text
def motion_figure(runs: Mapping[str, Motion]) -> Figure:
    """Draw the motion of the tip relative to the clamp over time, and shapes of the beam at twelve instants, by label.

    The motion is the change of the horizontal and of the vertical position since the start.  With several runs, only
    the shapes at the start and at the end are drawn.
    """
    if not all(len(run.time) for run in runs.values()):
        raise InputError("the motion has no samples", "figure")
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    over_time, in_plane = figure.subfigures(1, 2, squeeze=False, width_ratios=(8, 5)).ravel()
    panels = over_time.subplots(2, 1, sharex=True)
    over_time.suptitle("displacement of the tip relative to the clamp", fontsize="medium")
    for (label, run), (colour, dash) in zip(runs.items(), line_styles(runs), strict=False):
        for axes, motion in zip(panels, run.swing.T, strict=True):
            axes.plot(run.time, 1e3 * (motion - motion[0]), lw=0.7, color=colour, ls=dash, label=label or None)
    for axes, direction in zip(panels, ("horizontal", "vertical"), strict=True):
        axes.set(ylabel=f"{direction}, mm")
        axes.grid(alpha=0.3)
    panels[-1].set(xlabel="time, s")
    over_time.align_ylabels()
    if any(runs):
        panels[0].legend(frameon=False, fontsize="small")
    _draw_shapes(in_plane.subplots(), runs)
    return figure


def line_styles(results: Mapping[str, object]) -> list[tuple[str, Any]]:
    """Return colour and dashes of each result; a single result is drawn as a computed curve."""
    return [(COMPUTED, "-")] if len(results) == 1 else [line[:2] for line in SERIES * len(results)]


def _draw_shapes(axes: Axes, runs: Mapping[str, Motion]) -> None:
    """Draw beams at equally spaced instants: the first dashed, the last bold, the others thin."""
    for (label, run), (colour, dash) in zip(runs.items(), line_styles(runs), strict=False):
        last, is_single = len(run.time) - 1, len(runs) == 1
        rows = np.unique(np.linspace(0, last, 12 if is_single else 2).astype(int)).tolist()
        styles: dict[int, dict[str, Any]] = {row: {"lw": 0.6, "alpha": 0.5} for row in rows}
        styles |= {last: {"lw": 2.0, "ls": dash}, 0: {"lw": 1.2, "ls": "--"}}
        for row in rows:
            name = f"{label}, " if label else ""
            row_colour = MEASURED if is_single and row == 0 else colour
            axes.plot(*_shape(run.model, run.state(row).coordinates), color=row_colour,
                      label=f"{name}at {run.time[row]:.4g} s" if row in (0, last) else None, **styles[row])  # fmt: skip
        draw_symbols(axes, run.model, run.state(-1).coordinates)
    draw_plane(axes)
    axes.set_title(f"shape of the beam at {len(rows)} instants", fontsize="medium")
    axes.figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=3 if is_single else 2)


def _shape(model: Model, coordinates: Array) -> Array:
    """Return the positions (2, k) along a beam, mm."""
    points = np.linspace(0.0, model.beam.length, 60).tolist()
    return 1e3 * np.array([model.interpolation(s) @ coordinates for s in points]).T


def draw_plane(axes: Axes) -> None:
    """Draw the axes of positions."""
    axes.set(xlabel="horizontal position x, mm", ylabel="vertical position y, mm")
    axes.set_aspect("equal", adjustable="datalim")  # fills the panel, whether the beam stands or lies
    axes.grid(alpha=0.3)


@literal_text
def equilibrium_figure(equilibria: Mapping[str, Equilibrium]) -> Figure:
    """Draw the beam in equilibrium and without load, by label, with supports, attachments and forces."""
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    axes = figure.subplots()
    for (label, equilibrium), (colour, dash) in zip(equilibria.items(), line_styles(equilibria), strict=False):
        axes.plot(*_shape(equilibrium.model, equilibrium.model.straight), color=MEASURED, ls=":", lw=0.8)
        axes.plot(
            *_shape(equilibrium.model, equilibrium.coordinates), color=colour, ls=dash, lw=2.0, label=label or "at rest"
        )
        draw_symbols(axes, equilibrium.model, equilibrium.coordinates)
        draw_loads(axes, equilibrium.model, equilibrium.coordinates, equilibrium.all_loads)
    axes.lines[0].set_label("without load")
    draw_plane(axes)
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=4)
    return figure


@literal_text
def path_figure(paths: Mapping[str, EquilibriumPath], point: float | None = None) -> Figure:
    """Draw the factor against the displacement of a point, by label; unstable parts dashed, critical points marked."""
    first, figure = next(iter(paths.values())), Figure(figsize=(6.4, 4.6), layout="constrained")
    axes, point = figure.subplots(), first.reference_point if point is None else point
    start = first.equilibria[0].position(point)
    places = {label: 1e3 * (path.positions(point) - start) for label, path in paths.items()}
    component = int(np.ptp(np.vstack([*places.values()]), axis=0).argmax())
    for (label, path), (colour, _) in zip(paths.items(), line_styles(paths), strict=False):
        x = places[label][:, component]
        axes.plot(x, path.factors, "--", color=colour, lw=1.0)
        for k in np.flatnonzero(path.stable[:-1] | path.stable[1:]):
            axes.plot(x[k : k + 2], path.factors[k : k + 2], color=colour, lw=2.0)
        axes.lines[-1].set_label(label or "stable")
        critical = [*path.critical_indices]
        axes.plot(x[critical], path.factors[critical], "o", ms=5, color=MEASURED)
    axes.lines[0].set_label("unstable")
    axes.lines[-1].set_label("limit point or bifurcation")
    axes.set(xlabel=f"{'xy'[component]} displacement of the point at {point:.4g} m, mm", ylabel="factor")
    axes.grid(alpha=0.3)
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=4)
    return figure


@literal_text
def damped_modes_figure(results: Mapping[str, DampedModes]) -> Figure:
    """Draw the eigenvalues in the complex plane, by label; those to the right of the dotted line grow."""
    figure = Figure(figsize=(5.6, 4.6), layout="constrained")
    axes = figure.subplots()
    for (label, modes), (colour, _), marker in zip(
        results.items(), line_styles(results), "osD^v" * len(results), strict=False
    ):
        axes.plot(modes.eigenvalues.real, modes.eigenvalues.imag, marker, color=colour, label=label or None)
    axes.axvline(0.0, ls=":", lw=1.0, color=MEASURED)
    axes.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
    axes.grid(alpha=0.3)
    if any(results):
        axes.legend(frameon=False, fontsize="small")
    return figure


@literal_text
def modes_figure(results: Mapping[str, Modes]) -> Figure:
    """Draw the lowest ten mode shapes on both sides of the equilibrium, by label."""
    first = next(iter(results.values()))
    equilibrium_shape = _shape(first.model, first.equilibrium.coordinates).T
    mode_count = min(max(modes.count for modes in results.values()), 10)
    is_horizontal = np.ptp(equilibrium_shape[:, 0]) > np.ptp(equilibrium_shape[:, 1])
    columns, width, height = (2, 4.2, 1.7) if is_horizontal else (5, 1.8, 3.2)
    columns = min(mode_count, columns)
    rows = -(-mode_count // columns)
    figure = Figure(figsize=(1.0 + width * columns, 0.4 + height * rows), layout="constrained")
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for k, axes in enumerate(plots):
        axes.set_visible(k < mode_count)
        if k < mode_count:
            _draw_mode(axes, k, results)
            if k + columns >= mode_count:  # nothing below
                axes.tick_params(labelbottom=True)
                axes.set(xlabel="x, mm")
    for axes in plots[::columns]:
        axes.set(ylabel="y, mm")
    if any(results):
        figure.legend(*plots[0].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=3)
    return figure


def _draw_mode(axes: Axes, k: int, results: Mapping[str, Modes]) -> None:
    """Draw mode k, from 0, of each result that has it."""
    for (label, modes), (colour, dash) in zip(results.items(), line_styles(results), strict=False):
        if k >= modes.count:
            continue
        equilibrium, shape = modes.equilibrium.coordinates, scaled_shape(modes, k)
        axes.plot(*_shape(modes.model, equilibrium), ls=":", lw=0.8, color=MEASURED)
        draw_symbols(axes, modes.model, equilibrium)
        for side, width in ((1.0, 1.5), (-1.0, 0.5)):
            axes.plot(*_shape(modes.model, equilibrium + side * shape), lw=width, color=colour, ls=dash,
                      label=label if label and side > 0.0 else None)  # fmt: skip
    values = ", ".join(f"{modes.frequencies[k]:.4g}" for modes in results.values() if k < modes.count)
    axes.set_title(f"mode {k + 1}: {values} Hz", fontsize=9)
    axes.set(aspect="equal")


def scaled_shape(modes: Modes, k: int) -> Array:
    """Return the shape of mode k, from 0, in nodal coordinates (4 n + 4,), scaled for a figure."""
    size = np.linalg.norm(_shape(modes.model, modes.shapes[:, k]), axis=0).max()
    return np.asarray(1e3 * SHAPE_SHARE * modes.model.beam.length / size * modes.shapes[:, k])


@literal_text
def match_figure(targets: Array, standard: Array, matched: Array, initial_beam: Beam, matched_beam: Beam,
                 ranges: Mapping[str, Array]) -> Figure:  # fmt: skip
    """Draw the deviations of natural frequencies (Hz) from their targets, and below the changes of the properties."""
    figure = Figure(figsize=(8, 3.4 + 1.6 * len(ranges)), layout="constrained")
    frequency_panel, property_panel = figure.subfigures(
        2, 1, squeeze=False, height_ratios=(2.2, 1.2 + 1.6 * len(ranges))
    ).ravel()
    axes, places = frequency_panel.subplots(), np.arange(len(targets))
    for frequencies, label, colour, marker in (
        (standard, "given beam", MEASURED, "x"),
        (matched, "matched", COMPUTED, "o"),
    ):
        axes.plot(places, 100 * (frequencies / targets - 1), marker, color=colour, label=label)
    axes.axhline(0.0, ls=":", lw=0.8, color=MEASURED)
    axes.set(ylabel="deviation, %", xlabel="measured frequency", xticks=places,
             xticklabels=[f"{target:.5g} Hz" for target in targets])  # fmt: skip
    axes.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    _draw_properties(property_panel, initial_beam, matched_beam, ranges)
    return figure


@literal_text
def properties_figure(
    initial_beam: Beam, matched_beam: Beam, ranges: Mapping[str, Array], width: float = 8.0
) -> Figure:
    """Draw the relative change of the properties along a beam, and the ranges that fit equally well.

    ``ranges`` holds the lowest and highest relative change of each element, (n, 2), or of all elements, (1, 2), of each
    property to draw; the figure is ``width`` inches wide.
    """
    figure = Figure(figsize=(width, 1.2 + 1.6 * len(ranges)), layout="constrained")
    _draw_properties(figure, initial_beam, matched_beam, ranges)
    return figure


def _draw_properties(
    figure: Figure | SubFigure, initial_beam: Beam, matched_beam: Beam, ranges: Mapping[str, Array]
) -> None:
    edges = 1e3 * np.linspace(0.0, matched_beam.length, matched_beam.elements + 1)
    plots = figure.subplots(len(ranges), 1, sharex=True, squeeze=False).ravel()
    for axes, name in zip(plots, (name for name in PROPERTIES if name in ranges), strict=True):
        change = 100 * (np.array(getattr(matched_beam, name)) / np.array(getattr(initial_beam, name)) - 1)
        low, high = 100 * np.broadcast_to(ranges[name], (matched_beam.elements, 2)).T
        axes.fill_between(edges, np.append(low, low[-1]), np.append(high, high[-1]), step="post", color=COMPUTED,
                          alpha=0.2, lw=0, label="fits equally well")  # fmt: skip
        axes.stairs(change, edges, baseline=None, color=COMPUTED, lw=1.5, label="matched")
        axes.axhline(0.0, ls=":", lw=0.8, color=MEASURED)
        axes.set(ylabel=f"{name.replace('_', ' ')}, %", xlim=(0.0, edges[-1]))
    plots[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    plots[-1].set(xlabel="arc length, mm")
    figure.align_ylabels()
