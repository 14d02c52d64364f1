"""A part with simulated experiments: Figures 17 to 27, Tables 8, 11 and 12 of the paper.

Each run drives a mode of the beam, stops, and lets it decay under several laws (``experiment``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.dynamics.integration import Method
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from problems.modal_damping.effects import turning_points
from problems.schema.table import keys_of
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, draw_band, drawn, line, new_figure, plain_log_ticks, series
from problems.study.kinds.experiment import ExperimentResult, RequestedRun, run_experiment
from problems.study.part import Effort, Finding, Found, LawChoice, Part, Printed, Source, Task, printed_numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRANSIENT_KEYS = {"experiment", "runs"}  # other keys of its numbers


def with_laws(runs: Sequence[RequestedRun], laws: tuple[LawChoice, ...]) -> tuple[RequestedRun, ...]:
    """Return the runs of a part with their laws: their own ones, or those of the part."""
    return tuple(replace(run, laws=run.laws or laws) for run in runs)


def experiment_tasks(
    runs: Sequence[RequestedRun], beam: Beam, found: Found, effort: Effort, methods: Sequence[Method] = ("radau",)
) -> tuple[Task, ...]:
    """Return the simulations of runs as tasks: run by run, law by law, method by method."""
    tasks = []
    for run in runs:
        own = replace(  # without what does not concern the simulation
            run, stop=effort.driving * run.stop, ramp=effort.driving * run.ramp, laws=(), measured_ratio=math.nan
        )
        cost = 0.01 * max(own.frequency, 2.0) * (own.stop + max(own.window, 1.0))  # by the number of periods
        tasks += [
            Task(run_experiment, (beam, law.of(found), own, effort, method), cost)
            for law in run.laws
            for method in methods
        ]
    return tuple(tasks)


def results_of(runs: Sequence[RequestedRun], results: Sequence[ExperimentResult]) -> list[list[ExperimentResult]]:
    """Return the results of the tasks of a part run by run."""
    own = iter(results)
    return [[next(own) for _ in run.laws] for run in runs]


@final
@dataclass(frozen=True, kw_only=True)
class Transients(Part):
    """Simulated experiments on a beam."""

    kind, about, heading = "transients", "simulated experiments: {}", "Excitation, stop and decay"
    naming = ("beam",)

    runs: Annotated[
        tuple[RequestedRun, ...], Meta(min_length=1, description=f"[{{{', '.join(keys_of(RequestedRun))}}}, ...]")
    ]
    laws: Annotated[tuple[LawChoice, ...], Meta(description="names of [[laws]]")] = ()
    beam: Annotated[str, Meta(description='"PART"')] = ""
    printed: Annotated[Printed, Meta(description="{LAW = [damping ratio of each run, %]}")] = field(
        default_factory=dict
    )

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its laws and printed numbers."""
        runs = with_laws(self.runs, self.laws)
        for k, run in enumerate(runs, start=1):
            run.check(source, f"{where}: runs: {k}")
        laws = {law.name: law for run in runs for law in run.laws}
        if taken := TRANSIENT_KEYS & laws.keys():
            raise InputError(f"the name {', '.join(sorted(taken))} is taken in results.json; rename the law", where)
        printed = printed_numbers(self.printed, dict.fromkeys(laws, len(runs)), where)
        return replace(self, runs=runs, laws=tuple(laws.values()), printed=printed)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the simulations, run by run and law by law."""
        return experiment_tasks(self.runs, self.beam_in(found), found, effort)

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the damping ratios, the amplitudes, and a figure per run."""
        by_run = results_of(self.runs, results)
        tables = (self._ratios(by_run), self._amplitudes(by_run))
        return Finding(self._data(by_run), tables, self._figures(by_run))

    def _figures(self, by_run: Sequence[Sequence[ExperimentResult]]) -> tuple[Drawing, ...]:
        of_runs = [
            self._drawing(k, run, of_laws) for k, (run, of_laws) in enumerate(zip(self.runs, by_run, strict=True))
        ]
        return (*of_runs, self._overview(by_run)) if len(self.runs) > 2 else tuple(of_runs)

    def _data(self, by_run: Sequence[Sequence[ExperimentResult]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if any(math.isfinite(run.measured_ratio) for run in self.runs):
            found["experiment"] = [
                run.measured_ratio if math.isfinite(run.measured_ratio) else None for run in self.runs
            ]
        for law in self.laws:
            ratios: list[float | None] = [None] * len(self.runs)
            for k, (run, of_laws) in enumerate(zip(self.runs, by_run, strict=True)):
                if law in run.laws:
                    ratios[k] = of_laws[run.laws.index(law)].damping_ratio
            found[law.name] = ratios
        found["runs"] = [
            {
                "mode": run.mode,
                "law": law.name,
                "requested_amplitude_m": run.amplitude,
                "reached_amplitude_m": result.reached,
                "base_amplitude_m": result.base_amplitude,
                "drive_hz": run.frequency or result.natural_frequency,
                "natural_frequency_hz": result.natural_frequency,
                "stop_s": result.stop,
                "amplitude_m": result.amplitude,
                "frequency_hz": result.frequency,
                "damping_ratio": result.damping_ratio,
                "damping_ratio_stderr": result.damping_ratio_error,
                "expected_damping_ratio": result.expected_ratio,
                "steps": result.steps,
            }
            for run, of_laws in zip(self.runs, by_run, strict=True)
            for law, result in zip(run.laws, of_laws, strict=True)
        ]
        return found

    def _rows(
        self, by_run: Sequence[Sequence[ExperimentResult]]
    ) -> list[tuple[int, RequestedRun, LawChoice, ExperimentResult]]:
        return [
            (k, run, law, result)
            for k, (run, of_laws) in self._by_mode(by_run)
            for law, result in zip(run.laws, of_laws, strict=True)
        ]

    def _by_mode(
        self, by_run: Sequence[Sequence[ExperimentResult]]
    ) -> list[tuple[int, tuple[RequestedRun, Sequence[ExperimentResult]]]]:
        """Return number, run and results in ascending order of the modes."""
        return sorted(enumerate(zip(self.runs, by_run, strict=True)), key=lambda entry: entry[1][0].mode)

    def _ratios(self, by_run: Sequence[Sequence[ExperimentResult]]) -> DataTable:
        rows = self._rows(by_run)
        columns = [
            Column("mode", tuple(run.mode for _, run, _, _ in rows)),
            Column("law", tuple(law.title for _, _, law, _ in rows)),
        ]
        if any(math.isfinite(run.measured_ratio) for run in self.runs):
            columns.append(Column("measured", tuple(100 * run.measured_ratio for _, run, _, _ in rows), "%"))
        printed = tuple(self.printed[law.name][k] if law.name in self.printed else None for k, _, law, _ in rows)
        columns += [
            Column("simulated", tuple(100 * result.damping_ratio for *_, result in rows), "%",
                   printed=printed if any(value is not None for value in printed) else None),
            Column("predicted by the law", tuple(100 * result.expected_ratio for *_, result in rows), "%"),
            Column("at amplitude", tuple(1e3 * result.amplitude for *_, result in rows), "mm"),
        ]  # fmt: skip
        title = "Damping ratios of the decays after the stop"
        return self.data_table(title, columns)

    def _amplitudes(self, by_run: Sequence[Sequence[ExperimentResult]]) -> DataTable:
        rows = self._rows(by_run)
        columns = (
            Column("mode", tuple(run.mode for _, run, _, _ in rows)),
            Column("law", tuple(law.title for _, _, law, _ in rows)),
            Column("drive", tuple(run.frequency or result.natural_frequency for _, run, _, result in rows), "Hz"),
            Column("base amplitude", tuple(1e3 * result.base_amplitude for *_, result in rows), "mm"),
            Column("requested", tuple(1e3 * run.amplitude for _, run, _, _ in rows), "mm"),
            Column("at the stop", tuple(1e3 * result.reached for *_, result in rows), "mm"),
            Column("frequency in the decay", tuple(result.frequency for *_, result in rows), "Hz"),
        )
        # relative difference from the requested amplitude that the table explains
        short = any(result.reached < (1 - 0.05) * run.amplitude for _, run, _, result in rows)
        reason = (
            "Where the amplitude at the stop is smaller than requested, the frequency of the mode falls with the "
            "amplitude by more than the width of the resonance, so that a drive at constant frequency reaches no more."
        )
        notes = ("The base amplitude is that of linear theory for the requested amplitude of the tip.", reason)
        title = "Amplitudes of the excitation and of the tip"
        return self.data_table(title, columns, *notes[: 1 + short], suffix="_amplitudes")

    def _drawing(self, k: int, run: RequestedRun, results: Sequence[ExperimentResult]) -> Drawing:
        caption = (
            f"Mode {run.mode}, driven until {results[0].stop:.4g} s.  Top: extremes of the tip displacement relative "
            "to the clamp.  Middle: the same around the stop.  Bottom: amplitude of the mode after the stop."
        )
        if math.isfinite(run.measured_ratio):
            caption += "  The measured decay is synthetic: Eq. (9) with the measured damping ratio."
        return drawn(f"{self.name}_{k + 1}", caption, lambda: _run_figure(run, results))

    def _overview(self, by_run: Sequence[Sequence[ExperimentResult]]) -> Drawing:
        def draw() -> Figure:
            figure, (axes,) = new_figure(3.6)
            ordered = self._by_mode(by_run)
            places = np.arange(len(ordered))
            measured = np.array([run.measured_ratio for _, (run, _) in ordered])
            if np.isfinite(measured).any():
                axes.plot(places, 100 * measured, "ks", ms=9, mfc="none", label="measured")
            for k, law in enumerate(self.laws):
                ratios = np.array([
                    results[run.laws.index(law)].damping_ratio if law in run.laws else np.nan
                    for _, (run, results) in ordered
                ])  # fmt: skip
                axes.plot(places, 100 * ratios, **series(k), ms=5, label=law.title)
                if law.name in self.printed:
                    printed = [self.printed[law.name][number] for number, _ in ordered]
                    axes.plot(places, np.array(printed, dtype=float), ls="", marker="x", ms=7,
                              color=series(k)["color"])  # fmt: skip
            if self.printed:
                axes.plot([], [], "kx", ms=7, label=self.printed_by)
            axes.set(yscale="log", ylabel="damping ratio, %", xlabel="mode")
            axes.set_xticks(places, [str(run.mode) for _, (run, _) in ordered])
            axes.set_title("damping ratio of each mode under each law")
            plain_log_ticks(axes, "y")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
            return figure

        return drawn(f"{self.name}_ratios", "Damping ratio of each mode under each law.", draw)


def _run_figure(run: RequestedRun, results: Sequence[ExperimentResult]) -> Figure:
    """Draw the motion under each law: extremes, waveform around the stop, amplitude of the decay."""
    figure, (whole_run, around, decay) = new_figure(5.4, 3)
    for k, (law, result) in enumerate(zip(run.laws, results, strict=True)):
        label = f"{law.title}, ζ = {100 * result.damping_ratio:.3g} %"
        draw_band(whole_run, result.motion, 1e3, **line(k), lw=1)
        around.plot(result.stop_time, 1e3 * result.stop_motion, **line(k), lw=1)
        time, peaks = _peaks(result)
        decay.plot(time - result.stop, 1e3 * peaks, **line(k), label=label)
    if math.isfinite(run.measured_ratio):
        _draw_measured(decay, run, results[0])
    whole_run.axvline(results[0].stop, color="black", lw=0.6, ls=":")
    around.axvline(0.0, color="black", lw=0.6, ls=":")
    whole_run.set(xlabel="time, s", ylabel="tip relative\nto clamp, mm")
    around.set(xlabel="time after the stop, s", ylabel="tip relative\nto clamp, mm")
    decay.set(xlabel="time after the stop, s", ylabel=f"amplitude\nof mode {run.mode}, mm", yscale="log")
    plain_log_ticks(decay, "y")
    decay.legend(loc="upper left", bbox_to_anchor=(0.0, -0.35))
    figure.align_ylabels()
    return figure


def _peaks(result: ExperimentResult) -> tuple[Any, Any]:
    """Return times and sizes of the extremes of the decay."""
    at = turning_points(result.decay)
    return result.decay_time[at], np.abs(result.decay[at])


def _draw_measured(axes: Axes, run: RequestedRun, result: ExperimentResult) -> None:
    """Draw Eq. (9) with the measured damping ratio, from the amplitude of the first law on."""
    time, peaks = _peaks(result)
    rate = 2 * math.pi * (run.frequency or result.natural_frequency) * run.measured_ratio
    label = f"measured ζ = {100 * run.measured_ratio:.3g} %, synthetic"
    axes.plot(time - result.stop, 1e3 * peaks[0] * np.exp(-rate * (time - time[0])), "k:", lw=1.5, label=label)
