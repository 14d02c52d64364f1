"""Simulated experiments of the paper, seen in other ways than by the kind ``transients``.

Damping ratio and frequency against amplitude along the decays; deformed shapes over the last period of the excitation;
and the same experiments by the other integrator, as a check.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.decay.envelope import DampingCurve
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.paper.combined_law import ratio_curves
from problems.schema.beam import law_of
from problems.study.data_table import Column
from problems.study.drawing import drawn, new_figure, series
from problems.study.kinds.experiment import FEWEST_MODES, ExperimentResult, RequestedRun, decay_curve
from problems.study.kinds.transients import experiment_tasks, results_of
from problems.study.part import Effort, Finding, Found, Task

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

LAW_POINTS = 40  # of a drawn law
METHODS: tuple[Method, ...] = ("radau", "idas")


def tasks(part: PaperPart, found: Found, effort: Effort, methods: Sequence[Method] = ("radau",)) -> tuple[Task, ...]:
    """Return the simulations, run by run, law by law and method by method."""
    return experiment_tasks(part.runs, part.beam_in(found), found, effort, methods)


def amplitudes(part: PaperPart, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
    """Return amplitude (m), damping ratio and frequency (Hz) in windows of each decay, and a figure per run."""
    by_run = results_of(part.runs, results)
    modes = natural_modes(Model(part.beam_in(found)), count=max(FEWEST_MODES, *(run.mode for run in part.runs)))
    curves = [[decay_curve(result) for result in of_laws] for of_laws in by_run]
    figures = []
    for run, of_laws, own in zip(part.runs, by_run, curves, strict=True):
        laws = [law_of(law.of(found), modes.model, law.name) for law in run.laws]
        caption = (
            f"Mode {run.mode}: damping ratio and frequency against amplitude.  Markers: windows of the simulated "
            "decays.  Lines: prediction of each law."
        )
        figures.append(drawn(caption, partial(_amplitude_figure, run, of_laws[0].numbers, own, laws, modes)))
    data = [
        {
            "mode": run.mode,
            "law": law.name,
            "amplitude_m": curve.amplitude.tolist(),
            "damping_ratio": curve.damping_ratio.tolist(),
            "frequency_hz": curve.frequency.tolist(),
        }
        for run, own in zip(part.runs, curves, strict=True)
        for law, curve in zip(run.laws, own, strict=True)
    ]
    return Finding(data, figures=tuple(figures))


def _amplitude_figure(
    run: RequestedRun,
    numbers: Mapping[str, Any],
    curves: Sequence[DampingCurve],
    laws: Sequence[DampingLaw | None],
    modes: Modes,
) -> Figure:
    """Draw damping ratio and frequency against amplitude."""
    figure, (ratio, frequency) = new_figure(4.6, 2, sharex=True)
    amplitudes = np.concatenate([curve.amplitude for curve in curves])
    fine, natural = np.geomspace(amplitudes.min(), amplitudes.max(), LAW_POINTS), numbers["natural_frequency_hz"]
    for k, (law, curve) in enumerate(zip(laws, curves, strict=True)):
        style = series(k)
        step = max(1, len(curve.amplitude) // LAW_POINTS)
        marks = {"ls": "", "marker": style["marker"], "color": style["color"], "ms": 4}
        ratio.plot(1e3 * curve.amplitude[::step], 100 * curve.damping_ratio[::step], **marks)
        frequency.plot(1e3 * curve.amplitude[::step], 100 * (curve.frequency[::step] / natural - 1), **marks)
        ratio.plot(1e3 * fine, 100 * ratio_curves(law, modes, fine)[:, run.mode - 1], color=style["color"],
                   ls=style["linestyle"], label=run.laws[k].title)  # fmt: skip
    frequency.axhline(0.0, color="black", lw=0.8, ls=":")
    frequency.set_title(f"small motion: {natural:.5g} Hz")
    ratio.set(ylabel="damping ratio, %", yscale="log")
    frequency.set(xlabel=f"tip amplitude of mode {run.mode}, mm", ylabel="change of the\nfrequency, %", xscale="log")
    plain_log_ticks(ratio, "y")
    plain_log_ticks(frequency, "x")
    ratio.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure


def shapes(part: PaperPart, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
    """Return the extent of the motion of the tip over one period (m), and the shapes, one panel per mode."""
    axis = np.array(part.beam_in(found).axis)
    data = []
    for run, result in zip(part.runs, results, strict=True):
        tip = result.shapes[:, -1]
        along, across = tip @ axis, tip @ np.array([-axis[1], axis[0]])
        data.append({"mode": run.mode, "tip_across_m": float(np.ptp(across)), "tip_along_m": float(np.ptp(along))})
    caption = (
        "Deformed shapes over the last period before the stop, light to dark.  Each panel has its own scale across "
        "the beam."
    )
    figure = drawn(caption, lambda: _shapes_figure(part.runs, results, axis))
    return Finding(data, figures=(figure,))


def _shapes_figure(runs: Sequence[RequestedRun], results: Sequence[ExperimentResult], axis: Array) -> Figure:
    """Draw the shapes of each mode in coordinates along and across the beam."""
    figure, panels = new_figure(4.4, 1, len(runs), sharey=True)
    normal = np.array([-axis[1], axis[0]])
    for axes, run, result in zip(panels, runs, results, strict=True):
        along, across = result.shapes @ axis, result.shapes @ normal
        for k in range(len(along)):
            axes.plot(1e3 * across[k], 1e3 * along[k], color=series(0)["color"], lw=0.8,
                      alpha=0.25 + 0.75 * k / (len(along) - 1))  # fmt: skip
        axes.set_title(f"mode {run.mode}")
        axes.set_xlabel("mm")
    panels[0].set_ylabel("position along the beam, mm")
    panels[0].invert_yaxis()
    return figure


def integrators(part: PaperPart, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
    """Return the damping ratios by both integrators, and the largest difference around the stop (m)."""
    pairs: list[tuple[ExperimentResult, ExperimentResult]] = list(zip(results[::2], results[1::2], strict=True))
    which = [(run, law) for run in part.runs for law in run.laws]
    apart = [float(np.abs(ours.stop_motion - other.stop_motion).max()) for ours, other in pairs]
    columns = (
        Column("mode", tuple(run.mode for run, _ in which)),
        Column("law", tuple(law.title for _, law in which)),
        Column("damping ratio by Radau", tuple(100 * ours.numbers["damping_ratio"] for ours, _ in pairs), "%"),
        Column("by IDAS", tuple(100 * other.numbers["damping_ratio"] for _, other in pairs), "%"),
        Column("largest difference of the tip around the stop", tuple(1e3 * value for value in apart), "mm"),
        Column("amplitude there", tuple(1e3 * float(np.abs(ours.stop_motion).max()) for ours, _ in pairs), "mm"),
        Column("steps of Radau", tuple(ours.numbers["steps"] for ours, _ in pairs)),
        Column("of IDAS", tuple(other.numbers["steps"] for _, other in pairs)),
    )
    table = part.data_table("The same experiment by both integrators", columns)
    data = [
        {
            "mode": run.mode,
            "law": law.name,
            "radau": ours.numbers["damping_ratio"],
            "idas": other.numbers["damping_ratio"],
            "largest_difference_m": difference,
        }
        for (run, law), (ours, other), difference in zip(which, pairs, apart, strict=True)
    ]
    return Finding(data, (table,))
