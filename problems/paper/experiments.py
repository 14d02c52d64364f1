"""Simulated experiments of the paper, seen in other ways than by the kind ``transients``.

Damping ratio and frequency against amplitude along the decays; deformed shapes over the last period of the excitation;
the same experiments by the other integrator, as a check; and their response curves.

An experiment drives a mode for a limited time (``transients``).  The curve shows the steady vibration under
the same excitation, at its frequency and beside it, by the amplitude of the driven mode as in the experiment: the other
modes move the tip too, by about the amplitude of the base.  The range extends from the natural frequency by a multiple
of the relative width of the resonance, which is the damping ratio plus the change of the frequency with the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.decay.envelope import DampingCurve
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.stepping import ReducedTrajectory
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.paper.combined_law import ratio_curves
from problems.spec.beam import law_of
from problems.spec.motion import RESPONSE_MODES, ResponseSpec, ResponseTask
from problems.study.drawing import drawn, new_figure, series
from problems.study.kinds.experiment import FEWEST_MODES, ExperimentResult, RequestedRun, decay_curve
from problems.study.kinds.response import SUMMARY_HEADS, curve_numbers, draw_curve, summary_rows
from problems.study.kinds.transients import experiment_tasks, results_of
from problems.study.part import Finding, Found, Task, Terms

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

LAW_POINTS = 40  # of a drawn law
METHODS: tuple[Method, ...] = ("radau", "idas")
RANGE_WIDTH = 5.0  # half-width of the range of frequencies relative to that of the resonance
RANGE_MARGIN = 1.3  # of the expected change of frequency

Resonance = tuple[dict[str, Any], Array]  # a curve, and the amplitude of the driven mode at the tip at each point, m


def tasks(part: PaperPart, found: Found, methods: Sequence[Method] = ("radau",)) -> tuple[Task, ...]:
    """Return the simulations, run by run, law by law and method by method."""
    return experiment_tasks(part.runs, part.beam_in(found), found, methods)


def amplitudes(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
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


def shapes(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
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


def integrators(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
    """Return the damping ratios by both integrators, and the largest difference around the stop (m)."""
    pairs: list[tuple[ExperimentResult, ExperimentResult]] = list(zip(results[::2], results[1::2], strict=True))
    which = [(run, law) for run in part.runs for law in run.laws]
    data, rows = [], []
    for (run, law), (radau, idas) in zip(which, pairs, strict=True):
        ratios = [one.numbers["damping_ratio"] for one in (radau, idas)]
        steps = [one.numbers["steps"] for one in (radau, idas)]
        apart, amplitude = (
            float(np.abs(one).max()) for one in (radau.stop_motion - idas.stop_motion, radau.stop_motion)
        )
        data.append({"mode": run.mode, "law": law.name, "radau": ratios[0], "idas": ratios[1],
                     "largest_difference_m": apart})  # fmt: skip
        rows.append((run.mode, law.title, *(100 * ratio for ratio in ratios), 1e3 * apart, 1e3 * amplitude, *steps))
    heads = ("mode", "law", "damping ratio by Radau, %", "by IDAS, %",
             "largest difference of the tip around the stop, mm", "amplitude there, mm", "steps of Radau",
             "of IDAS")  # fmt: skip
    return Finding(data, (part.table("The same experiment by both integrators", heads, rows),))


def resonance(beam: Beam, terms: Terms, amplitude: float, frequencies: tuple[float, float], mode: int) -> Resonance:
    """Return the response curve under a base amplitude (m), and the amplitude of the driven mode along it."""
    model = Model(beam)
    law, count = law_of(terms, model, "damping"), max(RESPONSE_MODES, mode)
    task = ResponseTask(model, law, ResponseSpec(frequencies, amplitude, points=24), count, {})
    curve = task.curve(amplitude)
    return curve_numbers(task, curve), np.array([_amplitude(motion, mode) for motion in curve.motions])


def _amplitude(motion: PeriodicMotion, mode: int) -> float:
    """Return the amplitude of a mode at the tip in the motion relative to the clamp, m."""
    period = motion.trajectory(64)
    assert isinstance(period, ReducedTrajectory)
    modes = period.reduced.modes
    return float(np.ptp(modes.modal_coordinate(period.relative_coordinates, mode - 1)) / 2)


def resonance_tasks(part: PaperPart, found: Found) -> tuple[Task, ...]:
    """Return the curve of each experiment under each law."""
    beam, terms = part.beam_in(found), {law.name: law.of(found) for law in part.laws}
    return tuple(
        Task(
            resonance,
            (beam, terms[run["law"]], run["base_amplitude_m"], range_of(run), run["mode"]),
            4.0,  # expected computing time of a curve
        )
        for run in _runs(part, found)
    )


def _runs(part: PaperPart, found: Found) -> list[Mapping[str, Any]]:
    """Return the numbers of the experiments under the laws of this part."""
    names = {law.name for law in part.laws}
    return [run for run in found[part.transients].data["runs"] if run["law"] in names]


def resonances(part: PaperPart, results: Sequence[Resonance], found: Found) -> Finding:
    """Return the curves of each mode in a panel, with the amplitudes that the experiments have reached."""
    runs = _runs(part, found)
    titles = {law.name: law.title for law in part.laws}
    rows = [
        (run["mode"], titles[run["law"]], *(1e3 * run[key] for key in ("base_amplitude_m", "reached_amplitude_m")))
        for run in runs
    ]
    heads = ("mode", "law", "base amplitude, mm", "reached before the stop, mm", *SUMMARY_HEADS)
    cells = [(*row, *peaks) for row, peaks in zip(rows, summary_rows([curve for curve, _ in results]), strict=True)]
    table = part.table("Steady vibration at the base amplitudes of the experiments", heads, cells)
    keys = ("mode", "law", "base_amplitude_m", "drive_hz", "reached_amplitude_m")
    data = [
        {**{key: run[key] for key in keys}, "amplitude_m": amplitudes.tolist(), "curve": curve}
        for run, (curve, amplitudes) in zip(runs, results, strict=True)
    ]
    figures = []
    for mode in dict.fromkeys(run["mode"] for run in runs):
        own = [(run, one) for run, one in zip(runs, results, strict=True) if run["mode"] == mode]
        caption = (
            f"Mode {mode}: steady vibration under the base motion of the experiment; dashed: unstable.  "
            "Larger markers: amplitude that the experiment has reached before its stop."
        )
        figures.append(drawn(caption, partial(_resonance_figure, titles, own)))
    return Finding(data, (table,), tuple(figures))


def _resonance_figure(titles: Mapping[str, str], own: Sequence[tuple[Mapping[str, Any], Resonance]]) -> Figure:
    """Draw the curves of one mode; ``titles`` are those of all laws by name."""
    figure, (axes,) = new_figure(3.4)
    for run, (curve, amplitudes) in own:
        k = list(titles).index(run["law"])
        draw_curve(axes, curve, 1e3 * amplitudes, k, titles[run["law"]])
        axes.plot(run["drive_hz"], 1e3 * run["reached_amplitude_m"], ls="", ms=8, mec="black", mew=0.8,
                  **{key: series(k)[key] for key in ("color", "marker")})  # fmt: skip
    axes.set(xlabel="frequency, Hz", ylabel="amplitude of the mode\nat the tip, mm", ylim=(0.0, None))
    axes.set_title(f"mode {own[0][0]['mode']}")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2), ncols=2)
    return figure


def range_of(run: Mapping[str, Any]) -> tuple[float, float]:
    """Return the first and the last frequency of a curve, Hz, from the numbers of an experiment.

    A mode that softens is on the upper branch of its curve above the resonance, where the curve therefore begins.  The
    amplitude of the steady vibration is estimated by the growth of a linear vibration until the stop, and the change of
    frequency with the amplitude by the frequency of the decay.
    """
    natural, ratio = run["natural_frequency_hz"], run["expected_damping_ratio"]
    amplitude = run["requested_amplitude_m"] / -math.expm1(-2 * math.pi * natural * ratio * run["stop_s"])
    change = (run["frequency_hz"] / natural - 1) * (amplitude / run["amplitude_m"]) ** 2
    # least distance of the last frequency below the natural one, relative to it
    lowest = 1 - min(RANGE_WIDTH * ratio - RANGE_MARGIN * min(change, 0.0), 0.03)
    return natural * (1 + RANGE_WIDTH * ratio + RANGE_MARGIN * max(change, 0.0)), natural * lowest
