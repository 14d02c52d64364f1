"""Other parts with simulated experiments, which only the study of the paper has.

Damping ratio and frequency against amplitude along the decays; deformed shapes over the last period of the excitation;
and the same experiments by the other integrator, as a check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypedDict, final

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.decay.envelope import DampingCurve
from ancf_casadi.mechanics.model import Model
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.modal_damping.combined_law import ratio_curves
from problems.schema.beam import law_of
from problems.study.data_table import Column
from problems.study.drawing import drawn, new_figure, plain_log_ticks, series
from problems.study.kinds.experiments.experiment import FEWEST_MODES, ExperimentResult, decay_curve
from problems.study.kinds.experiments.runs import ExperimentPart, RequestedRun, results_of, task_of
from problems.study.part import Effort, Finding, Found, Task
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAW_POINTS = 40  # of a drawn law
METHODS = ("radau", "idas")


class AmplitudeNumbers(TypedDict):
    """Windows of a decay under a law: amplitude (m), damping ratio and frequency (Hz)."""

    mode: int
    law: str
    amplitude_m: list[float]
    damping_ratio: list[float]
    frequency_hz: list[float]


@final
@dataclass(frozen=True, kw_only=True)
class Amplitudes(ExperimentPart):
    """Damping ratio and frequency against amplitude."""

    kind, heading = "amplitudes", "Damping and frequency against amplitude"
    about = 'damping ratio and frequency against amplitude in simulated decays: the keys of "transients"'
    numbers = list[AmplitudeNumbers]

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return a figure per run."""
        by_run = results_of(self.runs, results)
        modes = natural_modes(Model(self.beam_in(found)), count=max(FEWEST_MODES, *(run.mode for run in self.runs)))
        figures = []
        curves = [[decay_curve(result) for result in of_laws] for of_laws in by_run]
        for k, (run, of_laws, own) in enumerate(zip(self.runs, by_run, curves, strict=True), start=1):
            laws = [law_of(law.of(found), modes.model, law.name) for law in run.laws]
            caption = (
                f"Mode {run.mode}: damping ratio and frequency against amplitude.  Markers: windows of the simulated "
                "decays.  Lines: prediction of each law."
            )
            draw = partial(_figure, run, of_laws[0].natural_frequency, own, laws, modes)
            figures.append(drawn(f"{self.name}_{k}", caption, draw))
        data = [
            {
                "mode": run.mode,
                "law": law.name,
                "amplitude_m": curve.amplitude.tolist(),
                "damping_ratio": curve.damping_ratio.tolist(),
                "frequency_hz": curve.frequency.tolist(),
            }
            for run, own in zip(self.runs, curves, strict=True)
            for law, curve in zip(run.laws, own, strict=True)
        ]
        return Finding(data, figures=tuple(figures))


def _figure(
    run: RequestedRun,
    natural_frequency: float,
    curves: Sequence[DampingCurve],
    laws: Sequence[DampingLaw | None],
    modes: Modes,
) -> Figure:
    """Draw damping ratio and frequency against amplitude."""
    figure, (ratio, frequency) = new_figure(4.6, 2, sharex=True)
    amplitudes = np.concatenate([curve.amplitude for curve in curves])
    fine = np.geomspace(amplitudes.min(), amplitudes.max(), LAW_POINTS)
    for k, (law, curve) in enumerate(zip(laws, curves, strict=True)):
        style = series(k)
        step = max(1, len(curve.amplitude) // LAW_POINTS)
        marks = {"ls": "", "marker": style["marker"], "color": style["color"], "ms": 4}
        ratio.plot(1e3 * curve.amplitude[::step], 100 * curve.damping_ratio[::step], **marks)
        change = 100 * (curve.frequency / natural_frequency - 1)
        frequency.plot(1e3 * curve.amplitude[::step], change[::step], **marks)
        ratio.plot(1e3 * fine, 100 * ratio_curves(law, modes, fine)[:, run.mode - 1], color=style["color"],
                   ls=style["linestyle"], label=run.laws[k].title)  # fmt: skip
    frequency.axhline(0.0, color="black", lw=0.8, ls=":")
    frequency.set_title(f"small motion: {natural_frequency:.5g} Hz")
    ratio.set(ylabel="damping ratio, %", yscale="log")
    frequency.set(xlabel=f"tip amplitude of mode {run.mode}, mm", ylabel="change of the\nfrequency, %", xscale="log")
    plain_log_ticks(ratio, "y")
    plain_log_ticks(frequency, "x")
    ratio.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure


class ShapeNumbers(TypedDict):
    """Extent of the motion over one period: across the beam at the tip, and along it (m)."""

    mode: int
    tip_across_m: float
    tip_along_m: float


@final
@dataclass(frozen=True, kw_only=True)
class Shapes(ExperimentPart):
    """Deformed shapes over one period."""

    kind, heading = "shapes", "Deformed shapes over a period"
    about = 'deformed shapes over the last period of an excitation, under the first law: the keys of "transients"'
    numbers = list[ShapeNumbers]

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with the first law of each run."""
        part = super().checked(source, where)
        runs = tuple(replace(run, laws=run.laws[:1]) for run in part.runs)
        return replace(part, runs=runs, laws=tuple({run.laws[0].name: run.laws[0] for run in runs}.values()))

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return one figure with a panel per mode."""
        axis = np.array(self.beam_in(found).axis)
        data = []
        for run, result in zip(self.runs, results, strict=True):
            tip = result.shapes[:, -1]
            along, across = tip @ axis, tip @ np.array([-axis[1], axis[0]])
            data.append({"mode": run.mode, "tip_across_m": float(np.ptp(across)), "tip_along_m": float(np.ptp(along))})
        caption = (
            "Deformed shapes over the last period before the stop, light to dark.  Each panel has its own scale across "
            "the beam."
        )
        figure = drawn(self.name, caption, lambda: _shapes_figure(self.runs, results, axis))
        return Finding(data, figures=(figure,))


def _shapes_figure(runs: Sequence[RequestedRun], results: Sequence[ExperimentResult], axis: Any) -> Figure:
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


class IntegratorNumbers(TypedDict):
    """An experiment by both integrators: damping ratios, and the largest difference around the stop (m)."""

    mode: int
    law: str
    radau: float
    idas: float
    largest_difference_m: float


@final
@dataclass(frozen=True, kw_only=True)
class Integrators(ExperimentPart):
    """Simulated experiments by both integrators."""

    kind, heading = "integrators", "Check of the integrators"
    about = 'simulated experiments by both integrators, Radau and IDAS: the keys of "transients"'
    numbers = list[IntegratorNumbers]

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return each simulation by both integrators."""
        beam = self.beam_in(found)
        return tuple(
            task_of(run.experiment(law, beam, found, effort, method))
            for run in self.runs
            for law in run.laws
            for method in METHODS
        )

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the table of differences."""
        pairs: list[tuple[ExperimentResult, ExperimentResult]] = list(zip(results[::2], results[1::2], strict=True))
        which = [(run, law) for run in self.runs for law in run.laws]
        apart = [float(np.abs(ours.stop_motion - other.stop_motion).max()) for ours, other in pairs]
        columns = (
            Column("mode", tuple(run.mode for run, _ in which)),
            Column("law", tuple(law.title for _, law in which)),
            Column("damping ratio by Radau", tuple(100 * ours.damping_ratio for ours, _ in pairs), "%"),
            Column("by IDAS", tuple(100 * other.damping_ratio for _, other in pairs), "%"),
            Column("largest difference of the tip around the stop", tuple(1e3 * value for value in apart), "mm"),
            Column("amplitude there", tuple(1e3 * float(np.abs(ours.stop_motion).max()) for ours, _ in pairs), "mm"),
            Column("steps of Radau", tuple(ours.steps for ours, _ in pairs)),
            Column("of IDAS", tuple(other.steps for _, other in pairs)),
        )
        table = self.data_table("The same experiment by both integrators", columns)
        data = [
            {
                "mode": run.mode,
                "law": law.name,
                "radau": ours.damping_ratio,
                "idas": other.damping_ratio,
                "largest_difference_m": difference,
            }
            for (run, law), (ours, other), difference in zip(which, pairs, apart, strict=True)
        ]
        return Finding(data, (table,))
