"""The figure of a mode: resonance curves with their points, frequency and damping ratio against amplitude, decays.

A computed curve is the line in the plane of frequency and amplitude on which the level of the oscillator is that of the
record; this line has all branches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.decay.envelope import draw_against_amplitude
from ancf_casadi.estimation.prediction import TIME_AXIS
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, literal_text, si_prefix
from problems.beam.curves.record import ResponseRecord
from problems.mode.oscillator import motion_amplitudes, motions_at, response_curve
from problems.mode.result import ModeFit

GRID = 240  # frequencies and amplitudes at which levels are computed
ONE_LEVEL = 0.02  # relative range of levels that count as one


@literal_text
def mode_figure(fits: Mapping[str, ModeFit]) -> Figure:
    """Draw curves, decays and laws of a fit."""
    (fit,) = fits.values()
    block = fit.curve_block
    curves = list(zip(block.records, block.constants, strict=True)) if block else []
    driven = [pair for pair in curves if pair[0].control == "excitation"]
    held = [pair for pair in curves if pair[0].control == "response"]
    decays = [one for one in fit.channels if one.axis == TIME_AXIS]
    phases = [pair for pair in driven if pair[0].measured_phases is not None]
    upper = [name for name, own in (("amplitude", driven), ("phase", phases), ("level", held)) if own]
    upper += ["decay"] * bool(decays)
    figure = Figure(figsize=(max(8.0, 4.2 * len(upper)), 6.4), layout="constrained")
    parts = figure.subfigures(2, 1, squeeze=False).ravel()
    plots = parts[0].subplots(1, len(upper), squeeze=False).ravel()
    for axes, name in zip(plots, upper, strict=True):
        if name == "decay":
            scale, unit = si_prefix(max(float(np.abs(one.measured).max()) for one in decays), decays[0].unit)
            for one in decays:
                axes.plot(one.places, one.measured.real / scale, ".", ms=1.5, color=MEASURED)
                axes.plot(one.places, one.predicted.real / scale, lw=0.5, color=COMPUTED)
            axes.set(xlabel=TIME_AXIS, ylabel=f"decay, {unit}".removesuffix(", "))
            continue
        _draw_curves(axes, fit, {"amplitude": driven, "phase": phases, "level": held}[name], name)
    draw_against_amplitude(parts[1].subplots(1, 2), None, fit.law_curve())
    return figure


def _draw_curves(axes: Axes, fit: ModeFit, pairs: list[tuple[ResponseRecord, str]], name: str) -> None:
    """Draw amplitudes, phases or levels of records against the frequency, and the computed branches."""
    first = pairs[0][0]
    units = {"amplitude": first.sensor.unit, "phase": "rad", "level": first.excitation_unit}
    largest = max(float(_measured(one, name).max()) for one, _ in pairs)
    scale, unit = (1.0, "rad") if name == "phase" else si_prefix(largest, units[name])
    for k, (record, constant) in enumerate(pairs):
        colour = f"C{k % 10}"
        held_unit = record.sensor.unit if record.control == "response" else record.excitation_unit
        size, symbol = si_prefix(float(np.median(_held(record))), held_unit)
        held = f"{np.median(_held(record)) / size:.3g} {symbol}".rstrip()
        axes.plot(record.f, _measured(record, name) / scale, ".", ms=4, color=colour, label=held)
        _draw_branches(axes, fit, record, constant, name, scale, colour)
    axes.set(xlabel="frequency, Hz", ylabel=f"{name}, {unit}".removesuffix(", "))
    if name != "phase":
        axes.set_ylim(0.0, 1.08 * largest / scale)
        axes.legend(frameon=False, fontsize="small")
    axes.ticklabel_format(axis="x", useOffset=False)


def _measured(record: ResponseRecord, name: str) -> Array:
    """Return the amplitudes, phases or levels of a record."""
    if name == "phase":
        assert record.measured_phases is not None
        return record.measured_phases
    return record.a if name == "level" else record.amplitudes


def _held(record: ResponseRecord) -> Array:
    """Return the quantity that was held."""
    return record.amplitudes if record.control == "response" else record.a


def _draw_branches(
    axes: Axes, fit: ModeFit, record: ResponseRecord, constant: str, name: str, scale: float, colour: str
) -> None:
    """Draw the computed curve of a record, on which the held quantity is that of the record at each frequency."""
    f = np.linspace(record.f.min(), record.f.max(), GRID)
    ones = np.ones(GRID)
    grid = replace(record, frequencies=f, values=ones, phases=None, levels=ones, sweep=None, amplitude_std=None,
                   phase_std=None, level_std=None)  # fmt: skip
    A = motion_amplitudes(record)
    block = fit.curve_block
    assert block is not None
    x = np.array([{**block.known, **fit.fit.estimates}[own] for own in (*fit.law_names, constant)])
    curve = response_curve(fit.model, grid, len(fit.law_names))
    sizes = np.geomspace(0.3 * A.min(), 1.2 * A.max(), GRID)
    Y, phase, level = np.array([motions_at(curve, size * ones, x)[0].T for size in sizes]).swapaxes(0, 1)
    wide = np.broadcast_to(f, Y.shape)
    if name == "level":
        vertical, computed = level / scale, Y
    else:
        vertical, computed = Y / scale if name == "amplitude" else _continuous(phase, record), level
    axes.contour(wide, vertical, computed / _held_at(f, record), [1.0], colors=colour, linewidths=1.0)


def _held_at(frequencies: Array, record: ResponseRecord) -> Array:
    """Return the held quantity at frequencies: its mean, or between its values if it varies."""
    held = _held(record)
    if np.ptp(held) <= ONE_LEVEL * held.mean():
        return np.full(len(frequencies), held.mean())
    places, owners = np.unique(record.f, return_inverse=True)
    return np.interp(frequencies, places, np.bincount(owners, held) / np.bincount(owners))


def _continuous(phase: Array, record: ResponseRecord) -> Array:
    """Return phases on the turn around the middle of the measured ones."""
    assert record.measured_phases is not None
    middle = float(np.median(record.measured_phases))
    return np.asarray(middle + np.angle(np.exp(1j * (phase - middle))))
