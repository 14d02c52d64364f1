"""A part with simulated experiments: Figures 17 to 27, Tables 8, 11 and 12 of the paper.

Each run drives a mode of the beam, stops, and lets it decay under several laws (``experiment``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array, maxima
from ancf_casadi.support.figures import Axes, Figure, plain_log_ticks
from ancf_casadi.support.tables import Table, known
from problems.spec.help import described_keys
from problems.study.drawing import Drawing, draw_band, drawn, line, new_figure, series
from problems.study.kinds.experiment import ExperimentResult, RequestedRun, run_experiment
from problems.study.part import Finding, Found, LawChoice, Part, Printed, Study, Task, printed_numbers

RUN_KEYS = ", ".join(described_keys(RequestedRun))
TRANSIENT_KEYS = {"experiment", "runs"}  # other keys of its numbers

Row = tuple[int, LawChoice, dict[str, Any]]  # number of a run, law, and the numbers of the experiment


def with_laws(runs: Sequence[RequestedRun], laws: tuple[LawChoice, ...]) -> tuple[RequestedRun, ...]:
    """Return the runs of a part with their laws: their own ones, or those of the part."""
    return tuple(replace(run, laws=run.laws or laws) for run in runs)


def experiment_tasks(
    runs: Sequence[RequestedRun], beam: Beam, found: Found, methods: Sequence[Method] = ("radau",)
) -> tuple[Task, ...]:
    """Return the simulations of runs as tasks: run by run, law by law, method by method."""
    tasks = []
    for run in runs:
        own = replace(run, laws=(), measured_ratio=math.nan)  # without what does not concern the simulation
        cost = 0.01 * max(own.frequency, 2.0) * (own.stop + max(own.window, 1.0))  # by the number of periods
        tasks += [
            Task(run_experiment, (beam, law.of(found), own, method), cost) for law in run.laws for method in methods
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

    runs: Annotated[tuple[RequestedRun, ...], Meta(min_length=1, description=f"[{{{RUN_KEYS}}}, ...]")]
    laws: Annotated[tuple[LawChoice, ...], Meta(description="names of [[laws]]")] = ()
    beam: Annotated[str, Meta(description='"PART"')] = ""
    printed: Annotated[Printed, Meta(description="{LAW = [damping ratio of each run, %]}")] = field(
        default_factory=dict
    )

    def checked(self, study: Study, where: str) -> Self:
        """Return the part with its laws and printed numbers."""
        runs = with_laws(self.runs, self.laws)
        for k, run in enumerate(runs, start=1):
            run.check(study, f"{where}: runs: {k}")
        laws = {law.name: law for run in runs for law in run.laws}
        if taken := TRANSIENT_KEYS & laws.keys():
            raise InputError(f"the name {', '.join(sorted(taken))} is taken in results.json; rename the law", where)
        printed = printed_numbers(self.printed, dict.fromkeys(laws, len(runs)), where)
        return replace(self, runs=runs, laws=tuple(laws.values()), printed=printed)

    def shortened(self) -> Self:
        """Return the part of a quick look, with short runs."""
        return replace(self, runs=tuple(run.shortened() for run in self.runs))

    def tasks(self, found: Found) -> tuple[Task, ...]:
        """Return the simulations, run by run and law by law."""
        return experiment_tasks(self.runs, self.beam_in(found), found)

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        """Return the damping ratios, the amplitudes, and a figure per run."""
        which = [(k, law) for k, run in enumerate(self.runs) for law in run.laws]
        rows: list[Row] = [
            (k, law, {"mode": one.numbers["mode"], "law": law.name, **one.numbers})
            for (k, law), one in zip(which, results, strict=True)
        ]
        data: dict[str, Any] = {"experiment": [known(run.measured_ratio) for run in self.runs]}
        if data["experiment"].count(None) == len(self.runs):
            del data["experiment"]
        for law in self.laws:
            ratios = {k: row["damping_ratio"] for k, own, row in rows if own == law}
            data[law.name] = [ratios.get(k) for k in range(len(self.runs))]
        data["runs"] = [row for *_, row in rows]
        in_order = sorted(rows, key=lambda row: int(row[2]["mode"]))
        figures = [_drawing(run, own) for run, own in zip(self.runs, results_of(self.runs, results), strict=True)]
        if len(self.runs) > 2:
            caption = "Damping ratio of each mode under each law."
            figures.append(drawn(caption, lambda: self._overview(data)))
        return Finding(data, (self._ratios(in_order), self._amplitudes(in_order)), tuple(figures))

    def _ratios(self, rows: Sequence[Row]) -> Table:
        measured = any(math.isfinite(run.measured_ratio) for run in self.runs)
        cells = [
            (row["mode"], law.title, *[100 * self.runs[k].measured_ratio][:measured], 100 * row["damping_ratio"],
             100 * row["expected_damping_ratio"], 1e3 * row["amplitude_m"])
            for k, law, row in rows
        ]  # fmt: skip
        printed = [self.printed[law.name][k] if law.name in self.printed else None for k, law, _ in rows]
        return self.table(
            "Damping ratios of the decays after the stop",
            ("mode", "law", *["measured, %"][:measured], "simulated, %", "predicted by the law, %", "at amplitude, mm"),
            cells,
            printed={"simulated, %": printed if any(value is not None for value in printed) else None},
        )

    def _amplitudes(self, rows: Sequence[Row]) -> Table:
        sizes = ("base_amplitude_m", "requested_amplitude_m", "reached_amplitude_m")
        heads = ("mode", "law", "drive, Hz", "base amplitude, mm", "requested, mm", "at the stop, mm",
                 "frequency in the decay, Hz")  # fmt: skip
        cells = [(row["mode"], law.title, row["drive_hz"], *(1e3 * row[name] for name in sizes), row["frequency_hz"])
                 for _, law, row in rows]  # fmt: skip
        # relative difference from the requested amplitude that the table explains
        short = any(row["reached_amplitude_m"] < (1 - 0.05) * row["requested_amplitude_m"] for *_, row in rows)
        reason = (
            "Where the amplitude at the stop is smaller than requested, the frequency of the mode falls with the "
            "amplitude by more than the width of the resonance, so that a drive at constant frequency reaches no more."
        )
        notes = ("The base amplitude is that of linear theory for the requested amplitude of the tip.", reason)
        title = "Amplitudes of the excitation and of the tip"
        return self.table(title, heads, cells, *notes[: 1 + short])

    def _overview(self, data: Mapping[str, Any]) -> Figure:
        """Draw the damping ratio of each mode under each law."""
        figure, (axes,) = new_figure(3.6)
        order = sorted(range(len(self.runs)), key=lambda k: self.runs[k].mode)
        places = np.arange(len(order))

        def in_order(ratios: Sequence[float | None]) -> Array:
            return np.array([ratios[k] for k in order], dtype=float)

        if "experiment" in data:
            axes.plot(places, 100 * in_order(data["experiment"]), "ks", ms=9, mfc="none", label="measured")
        for k, law in enumerate(self.laws):
            axes.plot(places, 100 * in_order(data[law.name]), **series(k), ms=5, label=law.title)
            if law.name in self.printed:
                axes.plot(places, in_order(self.printed[law.name]), ls="", marker="x", ms=7,
                          color=series(k)["color"])  # fmt: skip
        if self.printed:
            axes.plot([], [], "kx", ms=7, label=self.printed_by)
        axes.set(yscale="log", ylabel="damping ratio, %", xlabel="mode")
        axes.set_xticks(places, [str(self.runs[k].mode) for k in order])
        axes.set_title("damping ratio of each mode under each law")
        plain_log_ticks(axes, "y")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
        return figure


def _drawing(run: RequestedRun, results: Sequence[ExperimentResult]) -> Drawing:
    caption = (
        f"Mode {run.mode}, driven until {results[0].numbers['stop_s']:.4g} s.  Top: extremes of the tip "
        "displacement relative to the clamp.  Middle: the same around the stop.  "
        "Bottom: amplitude of the mode after the stop."
    )
    if math.isfinite(run.measured_ratio):
        caption += "  The measured decay is synthetic: Eq. (9) with the measured damping ratio."
    return drawn(caption, lambda: _run_figure(run, results))


def _run_figure(run: RequestedRun, results: Sequence[ExperimentResult]) -> Figure:
    """Draw the motion under each law: extremes, waveform around the stop, amplitude of the decay."""
    figure, (whole_run, around, decay) = new_figure(5.4, 3)
    for k, (law, result) in enumerate(zip(run.laws, results, strict=True)):
        label = f"{law.title}, ζ = {100 * result.numbers['damping_ratio']:.3g} %"
        draw_band(whole_run, result.motion, 1e3, **line(k), lw=1)
        around.plot(result.stop_time, 1e3 * result.stop_motion, **line(k), lw=1)
        time, peaks = _peaks(result)
        decay.plot(time, 1e3 * peaks, **line(k), label=label)
    if math.isfinite(run.measured_ratio):
        _draw_measured(decay, run, results[0])
    whole_run.axvline(results[0].numbers["stop_s"], color="black", lw=0.6, ls=":")
    around.axvline(0.0, color="black", lw=0.6, ls=":")
    whole_run.set(xlabel="time, s", ylabel="tip relative\nto clamp, mm")
    around.set(xlabel="time after the stop, s", ylabel="tip relative\nto clamp, mm")
    decay.set(xlabel="time after the stop, s", ylabel=f"amplitude\nof mode {run.mode}, mm", yscale="log")
    plain_log_ticks(decay, "y")
    decay.legend(loc="upper left", bbox_to_anchor=(0.0, -0.35))
    figure.align_ylabels()
    return figure


def _peaks(result: ExperimentResult) -> tuple[Array, Array]:
    """Return times after the stop, s, and sizes of the extremes of the decay."""
    at = maxima(np.abs(result.decay))
    return result.decay_time[at] - result.numbers["stop_s"], np.abs(result.decay[at])


def _draw_measured(axes: Axes, run: RequestedRun, result: ExperimentResult) -> None:
    """Draw Eq. (9) with the measured damping ratio, from the amplitude of the first law on."""
    time, peaks = _peaks(result)
    rate = 2 * math.pi * result.numbers["drive_hz"] * run.measured_ratio
    label = f"measured ζ = {100 * run.measured_ratio:.3g} %, synthetic"
    axes.plot(time, 1e3 * peaks[0] * np.exp(-rate * (time - time[0])), "k:", lw=1.5, label=label)
