"""The figures of the paper's study, one for each table and one for each mode's transients.

Curves measured are black, fits and laws coloured; the data behind each figure are in the tables and ``results.json``.
"""

from __future__ import annotations

import math
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ancf_casadi.estimation.figures import MEASURED
from ancf_casadi.plot import png
from ancf_casadi.support.arrays import Array
from problems.study import paper
from problems.study.reproduction import LAWS, Study

COLOURS = {"generic": "#1b7f5c", "proportional": "#c23b22", "quadratic": "#2a5ca8", "undamped": "#888888"}
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
            "table02_modal_parameters": _decays(study, "linear"),
            "table03_proportional": _proportional(study),
            "table04_quadratic": _decays(study, "quadratic"),
            "table09_properties": _properties(study),
            "table10_frequencies": _frequencies(study),
            "table11_damping_ratios": _comparison(study),
            **{f"transients_mode{mode + 1}": _transients(study, mode) for mode in range(len(paper.FREQUENCIES))},
        }
        return [(f"{name}.png", png(figure)) for name, figure in drawn.items()]


def _decays(study: Study, law: str) -> Figure:
    """Synthetic decays and their fits, with the envelope."""
    records, fits = (
        (study.decays, study.identification) if law == "linear" else (study.quadratic_decays, study.quadratic)
    )
    figure = Figure(figsize=(8, 9), layout="constrained")
    for k, (axes, record, fit) in enumerate(zip(figure.subplots(5, 1), records, fits, strict=True)):
        shown = record.time <= min(record.time[-1], 25 / fit.frequency)
        fine = np.linspace(0.0, record.time[shown][-1], 2000)
        axes.plot(
            record.time[shown], 1e3 * record.displacement[shown], ".", ms=2.5, color=MEASURED, label="synthetic record"
        )
        axes.plot(fine, 1e3 * fit.displacement(fine), "-", lw=0.9, color=COLOURS["generic"], label="identified")
        found = f"f = {fit.frequency:.4g} Hz"
        found += (
            f",  ζ = {100 * fit.damping_ratio:.3g} %"
            if law == "linear"
            else f",  η1 = {fit.eta1:.3g} 1/s,  η2 = {fit.eta2:.3g} 1/m"
        )
        axes.set_title(f"mode {k + 1}:  {found}", loc="left")
        axes.set_ylabel("tip, mm")
    axes.set_xlabel("time, s")
    figure.axes[0].legend(loc="upper right", ncols=2)
    equation = "Eq. (9)" if law == "linear" else "Eq. (27)"
    figure.suptitle(f"Free decays and their identification by {equation}; synthetic, the first 25 periods")
    return figure


def _proportional(study: Study) -> Figure:
    """Damping ratio over frequency: mass, stiffness and sum, Eq. (16)."""
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
    axes.set_title(f"α = {study.rayleigh.alpha:.4g} 1/s,  β = {study.rayleigh.beta:.4g} s", loc="left")
    axes.legend()
    return figure


def _properties(study: Study) -> Figure:
    """Width and thickness along the beam."""
    beam = study.match.beam
    arc = 1e3 * np.linspace(0.0, beam.length, beam.elements + 1)
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    _steps(upper, arc, np.array(beam.width) / paper.WIDTH, "width")
    _steps(lower, arc, np.array(beam.thickness) / paper.THICKNESS, "thickness")
    lower.set_xlabel("distance from the clamp, mm")
    upper.set_title(
        f"The least change that meets Table 2:  E = {beam.elastic_modulus[0] / 1e9:.1f} GPa,  "
        f"ρ = {beam.density[0]:.0f} kg/m³",
        loc="left",
    )
    return figure


def _steps(axes: Axes, arc: Array, factors: Array, name: str) -> None:
    axes.stairs(factors, arc, baseline=1.0, fill=True, alpha=0.35, color=COLOURS["generic"])
    axes.stairs(factors, arc, baseline=None, color=COLOURS["generic"])
    for bound in (0.9, 1.1):
        axes.axhline(bound, ls="--", lw=0.8, color=COLOURS["proportional"])
    axes.set(ylabel=f"{name} / standard", ylim=(0.88, 1.12))


def _frequencies(study: Study) -> Figure:
    """Relative frequency errors before and after."""
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
    axes.set(xlabel="mode", ylabel="frequency against Table 2, %", xticks=MODES)
    axes.set_title(f"largest error after matching {study.match.max_relative_error:.0e}", loc="left")
    axes.legend()
    return figure


def _comparison(study: Study) -> Figure:
    """Damping ratio of each mode under each law."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.semilogy(MODES, 100 * np.array(paper.DAMPING_RATIOS), "s", ms=10, mfc="none", color=MEASURED, label="Table 2")
    for name in LAWS:
        axes.semilogy(MODES, 100 * np.array(study.ratios(name)), "o-", color=COLOURS[name], label=f"{name}, simulated")
    for name, printed in (("proportional", paper.PROPORTIONAL_RATIOS), ("quadratic", paper.QUADRATIC_RATIOS)):
        axes.semilogy(MODES, 100 * np.array(printed), "x", color=COLOURS[name], label=f"{name}, paper")
    axes.set(xlabel="mode", ylabel="damping ratio, %", xticks=MODES)
    axes.legend(fontsize=8)
    return figure


def _transients(study: Study, mode: int) -> Figure:
    """Tip motion under each law: the whole run, and the decay of the mode itself."""
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    panels = figure.subplots(2, len(LAWS), sharey="row")
    for column, name in enumerate(LAWS):
        result = study.of(name)[mode]
        whole, decay = panels[:, column]
        whole.plot(result.motion.time, 1e3 * result.motion.displacement, lw=0.3, color=COLOURS[name])
        whole.set_title(f"{name}, base {1e3 * result.base_amplitude:.3g} mm", loc="left")
        envelope = 2e3 * result.amplitude * np.array([-0.5, 0.5])
        decay.plot(decay_time := result.decay.time, 1e3 * result.decay.displacement, lw=0.4, color=COLOURS[name])
        middle = (decay_time[0] + decay_time[-1]) / 2
        rate = 2 * math.pi * result.frequency * result.damping_ratio
        for side in envelope:
            decay.plot(decay_time, side * np.exp(-rate * (decay_time - middle)), "--", lw=1, color=MEASURED)
        decay.set_title(f"ζ = {100 * result.damping_ratio:.3g} %", loc="left")
        decay.set_xlabel("time, s")
    panels[0, 0].set_ylabel("tip to clamp, mm")
    panels[1, 0].set_ylabel(f"mode {mode + 1} at the tip, mm")
    figure.suptitle(f"Mode {mode + 1}: driven, stopped, and its decay with the fitted envelope")
    return figure
