"""Figures of the study: one for each of Tables 2, 3, 4, 9, 10 and 11, and one for the transients of each mode.

Records and the values of Table 2 are black, fits and damping laws are coloured.  The tables and ``results.json`` hold
the data of each figure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.plot import png
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.colours import COMPUTED, MEASURED
from problems.decay.result import DecayFit
from problems.study import paper
from problems.study.reproduction import Study
from problems.study.transients import LAW_NAMES

COLOURS = {"generic": COMPUTED, "proportional": "#c23b22", "quadratic": "#2a5ca8", "undamped": "#888888"}
MODES = np.arange(1, 6)
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
}


def figures(study: Study) -> list[tuple[str, bytes]]:
    """Return the figures as PNG files, by name."""
    with matplotlib.rc_context(STYLE):
        drawn = {
            "table02_modal_parameters": table_2_modal_parameters(study),
            "table03_proportional": table_3_proportional(study),
            "table04_quadratic": table_4_quadratic(study),
            "table09_properties": table_9_properties(study),
            "table10_frequencies": table_10_frequencies(study),
            "table11_damping_ratios": table_11_damping_ratios(study),
            **{f"transients_mode{mode + 1}": transients(study, mode) for mode in range(len(paper.FREQUENCIES))},
        }
        return [(f"{name}.png", png(figure)) for name, figure in drawn.items()]


def table_2_modal_parameters(study: Study) -> Figure:
    """Draw the linear decays and their fits."""
    found = [f"f = {fit.frequency:.4g} Hz,  ζ = {100 * fit.damping_ratio:.3g} %" for fit in study.identification]
    return _decays(study.decays, study.identification, found, "Eq. (9)")


def table_3_proportional(study: Study) -> Figure:
    """Draw the damping ratio of Rayleigh damping against frequency, Eq. (16)."""
    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.subplots()
    f = np.geomspace(0.8, 200, 300)
    omega = 2 * math.pi * f
    mass, stiffness = study.rayleigh.alpha / (2 * omega), study.rayleigh.beta * omega / 2
    axes.loglog(f, 100 * mass, "--", color=COLOURS["quadratic"], label="α M")
    axes.loglog(f, 100 * stiffness, ":", color=COLOURS["quadratic"], label="β K")
    axes.loglog(f, 100 * (mass + stiffness), color=COLOURS["proportional"], label="α M + β K, Eq. (16)")
    axes.loglog(paper.FREQUENCIES, 100 * np.array(paper.DAMPING_RATIOS), "o", color=MEASURED, label="Table 2")
    axes.set(xlabel="frequency, Hz", ylabel="damping ratio, %", ylim=(0.05, 5))
    coefficients = f"α = {study.rayleigh.alpha:.4g} 1/s,  β = {study.rayleigh.beta:.4g} s"
    axes.set_title(f"Rayleigh (proportional) damping:  {coefficients}", loc="left")
    axes.legend()
    return figure


def table_4_quadratic(study: Study) -> Figure:
    """Draw the quadratic decays and their fits."""
    found = [
        f"f = {fit.frequency:.4g} Hz,  η1 = {fit.eta1:.3g} 1/s,  η2 = {fit.eta2:.3g} 1/m" for fit in study.quadratic
    ]
    return _decays(study.quadratic_decays, study.quadratic, found, "Eq. (27)")


def _decays(
    records: Sequence[Measurement], fits: Sequence[DecayFit], parameters: Sequence[str], equation: str
) -> Figure:
    """Draw synthetic decays and their fits, one below the other, with the parameters found."""
    figure = Figure(figsize=(8, 9), layout="constrained")
    panels = zip(figure.subplots(len(records), 1), records, fits, parameters, strict=True)
    for mode, (axes, record, fit, found) in enumerate(panels, start=1):
        shown = record.time <= min(record.time[-1], 25 / fit.frequency)
        time, displacement = record.time[shown], record.values[shown]
        fine = np.linspace(0.0, time[-1], 2000)
        axes.plot(time, 1e3 * displacement, ".", ms=2.5, color=MEASURED, label="synthetic record")
        axes.plot(fine, 1e3 * fit.displacement(fine), "-", lw=0.9, color=COLOURS["generic"], label="fit")
        axes.set_title(f"mode {mode}:  {found}", loc="left")
        axes.set_ylabel("tip, mm")
    axes.set_xlabel("time, s")
    figure.axes[0].legend(loc="upper right", ncols=2)
    figure.suptitle(f"Free decays and fits by {equation}; synthetic records, first 25 periods")
    return figure


def table_9_properties(study: Study) -> Figure:
    """Draw width and thickness of the matched beam along its length."""
    beam = study.match.beam
    arc = 1e3 * np.linspace(0.0, beam.length, beam.elements + 1)
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_profile(upper, arc, np.array(beam.width) / paper.WIDTH, "width")
    _draw_profile(lower, arc, np.array(beam.thickness) / paper.THICKNESS, "thickness")
    lower.set_xlabel("distance from the clamp, mm")
    upper.set_title(
        f"Smallest change that matches Table 2:  E = {beam.elastic_modulus[0] / 1e9:.1f} GPa,  "
        f"ρ = {beam.density[0]:.0f} kg/m³",
        loc="left",
    )
    return figure


def _draw_profile(axes: Axes, arc: Array, factors: Array, name: str) -> None:
    """Draw a property relative to the standard beam, with the bounds of 10 %."""
    axes.stairs(factors, arc, baseline=1.0, fill=True, alpha=0.35, color=COLOURS["generic"])
    axes.stairs(factors, arc, baseline=None, color=COLOURS["generic"])
    for bound in (0.9, 1.1):
        axes.axhline(bound, ls="--", lw=0.8, color=COLOURS["proportional"])
    axes.set(ylabel=f"{name} / standard", ylim=(0.88, 1.12))


def table_10_frequencies(study: Study) -> Figure:
    """Draw the relative frequency errors before and after matching."""
    target = np.array(paper.FREQUENCIES)
    columns = {
        "standard, hanging": (study.match.standard, COLOURS["quadratic"]),
        "paper, standard": (paper.STANDARD_FREQUENCIES, "#9db8dd"),
        "paper, optimum": (paper.OPTIMUM_FREQUENCIES, "#a9d5c5"),
        "matched": (study.match.frequencies, COLOURS["generic"]),
    }
    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.subplots()
    for k, (name, (frequencies, colour)) in enumerate(columns.items()):
        errors = 100 * (np.array(frequencies) / target - 1)
        axes.bar(MODES + 0.2 * (k - 1.5), errors, 0.19, color=colour, label=name)
    axes.axhline(0.0, lw=0.8, color=MEASURED)
    axes.set(xlabel="mode", ylabel="frequency error relative to Table 2, %", xticks=MODES)
    axes.set_title(f"largest relative error after matching: {study.match.max_relative_error:.0e}", loc="left")
    axes.legend()
    return figure


def table_11_damping_ratios(study: Study) -> Figure:
    """Draw the damping ratio of each mode under each law."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.semilogy(MODES, 100 * np.array(paper.DAMPING_RATIOS), "s", ms=10, mfc="none", color=MEASURED, label="Table 2")
    for law, name in LAW_NAMES.items():
        axes.semilogy(MODES, 100 * np.array(study.ratios(law)), "o-", color=COLOURS[law], label=f"{name}, simulated")
    for law, printed in (("proportional", paper.PROPORTIONAL_RATIOS), ("quadratic", paper.QUADRATIC_RATIOS)):
        axes.semilogy(MODES, 100 * np.array(printed), "x", color=COLOURS[law], label=f"{LAW_NAMES[law]}, paper")
    axes.set(xlabel="mode", ylabel="damping ratio, %", xticks=MODES)
    axes.legend(fontsize=8)
    return figure


def transients(study: Study, mode: int) -> Figure:
    """Draw the tip motion under each law: the whole run, and the decay of the driven mode with its fitted envelope."""
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    panels = figure.subplots(2, len(LAW_NAMES), sharey="row")
    for column, (law, name) in enumerate(LAW_NAMES.items()):
        result = study.under(law)[mode]
        whole, decay = panels[:, column]
        whole.plot(result.motion.time, 1e3 * result.motion.values, lw=0.3, color=COLOURS[law])
        whole.set_title(f"{name},\nbase amplitude {1e3 * result.base_amplitude:.3g} mm", loc="left")
        time = result.decay.time
        decay.plot(time, 1e3 * result.decay.values, lw=0.4, color=COLOURS[law])
        decay_rate = 2 * math.pi * result.frequency * result.damping_ratio
        envelope = 1e3 * result.amplitude * np.exp(-decay_rate * (time - (time[0] + time[-1]) / 2))
        for side in (-envelope, envelope):
            decay.plot(time, side, "--", lw=1, color=MEASURED)
        decay.set_title(f"ζ = {100 * result.damping_ratio:.3g} %", loc="left")
        decay.set_xlabel("time, s")
    panels[0, 0].set_ylabel("tip relative to clamp, mm")
    panels[1, 0].set_ylabel(f"tip in mode {mode + 1}, mm")
    figure.suptitle(f"Mode {mode + 1}: excitation and stop (top), decay of the mode with the fitted envelope (bottom)")
    return figure
