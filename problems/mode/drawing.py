"""The figure of a mode: resonance curves with their points, frequency and damping ratio against amplitude, decays.

A computed curve is the line in the plane of frequency and amplitude on which the level of the oscillator is that of the
record; this line has all branches.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.estimation.prediction import TIME_AXIS
from ancf_casadi.figures.decays import draw_against_amplitude
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, LEGEND, MEASURED, literal_text, si_prefix
from problems.beam.curves.record import ResponseRecord
from problems.mode.oscillator import motion_amplitudes, motions_at, response_curve
from problems.mode.result import ModeFit

GRID = 240  # number of frequencies and of amplitudes at which levels are computed


@literal_text
def mode_figure(fits: Mapping[str, ModeFit]) -> Figure:
    """Draw curves, decays and laws of a fit."""
    (fit,) = fits.values()
    block = fit.curve_block
    curves = list(zip(block.records, block.constants, strict=True)) if block else []
    driven = [pair for pair in curves if pair[0].control == "excitation"]
    response_controlled = [pair for pair in curves if pair[0].control == "response"]
    decays = [channel for channel in fit.channels if channel.axis == TIME_AXIS]
    phases = [pair for pair in driven if pair[0].measured_phases is not None]
    panels = (("amplitude", driven), ("phase", phases), ("level", response_controlled))
    drawn_panels = [(name, pairs) for name, pairs in panels if pairs]
    columns = len(drawn_panels) + bool(decays)
    figure = Figure(figsize=(max(8.0, 4.2 * columns), 6.4), layout="constrained")
    subfigures = figure.subfigures(2, 1, squeeze=False).ravel()
    plots = subfigures[0].subplots(1, columns, squeeze=False).ravel()
    for axes, (name, pairs) in zip(plots, drawn_panels, strict=False):
        _draw_curves(axes, fit, pairs, name)
    if decays:
        scale, unit = si_prefix(max(float(np.abs(decay.measured).max()) for decay in decays), decays[0].unit)
        for decay in decays:
            plots[-1].plot(decay.places, decay.measured.real / scale, ".", ms=1.5, color=MEASURED)
            plots[-1].plot(decay.places, decay.predicted.real / scale, lw=0.5, color=COMPUTED)
        plots[-1].set(xlabel=TIME_AXIS, ylabel=f"decay, {unit}".removesuffix(", "))
    draw_against_amplitude(subfigures[1].subplots(1, 2), None, fit.law_curve())
    return figure


def _draw_curves(axes: Axes, fit: ModeFit, pairs: list[tuple[ResponseRecord, str]], name: str) -> None:
    """Draw amplitudes, phases or levels of records against the frequency, and the computed branches."""
    first_record = pairs[0][0]
    units = {"amplitude": first_record.sensor.unit, "phase": "rad", "level": first_record.excitation_unit}
    largest = max(float(_measured_values(curve, name).max()) for curve, _ in pairs)
    scale, unit = (1.0, "rad") if name == "phase" else si_prefix(largest, units[name])
    for k, (record, constant) in enumerate(pairs):
        colour = f"C{k % 10}"
        control_unit = record.sensor.unit if record.control == "response" else record.excitation_unit
        control = float(np.median(_controlled_quantity(record)))
        control_scale, symbol = si_prefix(control, control_unit)
        label = f"{control / control_scale:.3g} {symbol}".rstrip()
        axes.plot(record.f, _measured_values(record, name) / scale, ".", ms=4, color=colour, label=label)
        _draw_branches(axes, fit, record, constant, name, scale, colour)
    axes.set(xlabel="frequency, Hz", ylabel=f"{name}, {unit}".removesuffix(", "))
    if name != "phase":
        axes.set_ylim(0.0, 1.08 * largest / scale)
        axes.legend(**LEGEND)
    axes.ticklabel_format(axis="x", useOffset=False)


def _measured_values(record: ResponseRecord, name: str) -> Array:
    """Return the amplitudes, phases or levels of a record."""
    if name == "phase":
        assert record.measured_phases is not None
        return record.measured_phases
    return record.a if name == "level" else record.amplitudes


def _controlled_quantity(record: ResponseRecord) -> Array:
    """Return the amplitudes of the reading if the response was controlled, else the levels."""
    return record.amplitudes if record.control == "response" else record.a


def _draw_branches(
    axes: Axes, fit: ModeFit, record: ResponseRecord, constant: str, name: str, scale: float, colour: str
) -> None:
    """Draw the computed curve of a record, with the controlled quantity of the record at each frequency."""
    f = np.linspace(record.f.min(), record.f.max(), GRID)
    grid = ResponseRecord(f, np.ones(GRID), sensor=record.sensor, relative=record.relative, levels=np.ones(GRID),
                          excitation_unit=record.excitation_unit)  # fmt: skip
    A = motion_amplitudes(record)
    block = fit.curve_block
    assert block is not None
    estimates = {**block.given_constants, **fit.fit.estimates}
    x = np.array([estimates[unknown] for unknown in (*fit.law_names, constant)])
    curve = response_curve(fit.model, grid, len(fit.law_names))
    sizes = np.geomspace(0.3 * A.min(), 1.2 * A.max(), GRID)
    Y, phase, level = np.array([motions_at(curve, np.full(GRID, size), x)[0].T for size in sizes]).swapaxes(0, 1)
    wide = np.broadcast_to(f, Y.shape)
    if name == "level":
        vertical, computed = level / scale, Y
    else:
        vertical, computed = Y / scale if name == "amplitude" else _continuous(phase, record), level
    axes.contour(wide, vertical, computed / _controlled_at(f, record), [1.0], colors=colour, linewidths=1.0)


def _controlled_at(frequencies: Array, record: ResponseRecord) -> Array:
    """Return the controlled quantity at frequencies, interpolated between its means at the measured frequencies."""
    measured_frequencies, owners = np.unique(record.f, return_inverse=True)
    means = np.bincount(owners, _controlled_quantity(record)) / np.bincount(owners)
    return np.interp(frequencies, measured_frequencies, means)


def _continuous(phase: Array, record: ResponseRecord) -> Array:
    """Return phases within half a turn of the median of the measured phases."""
    assert record.measured_phases is not None
    middle = float(np.median(record.measured_phases))
    return np.asarray(middle + np.angle(np.exp(1j * (phase - middle))))
