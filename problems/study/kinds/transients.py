"""A step with simulated experiments: Figures 17 to 27, Tables 8, 11 and 12 of the paper.

Each run drives a mode of the beam, stops, and lets it decay under several laws (``experiment``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array, maxima
from ancf_casadi.support.figures import REFERENCE, Figure, plain_log_ticks
from ancf_casadi.support.tables import Table, finite_or_none
from problems.study.compute import Compute
from problems.study.drawing import draw_band, line, new_figure, series
from problems.study.kinds.experiment import ExperimentResult, RequestedRun, run_experiment
from problems.study.step import Finding, Findings, LawChoice, Printed, Step, Study, printed_numbers, study_table

TRANSIENT_KEYS = {"experiment", "runs"}  # other keys of its numbers

Row = tuple[int, LawChoice, dict[str, Any]]  # number of a run, law, and the numbers of the experiment


def run_experiments(compute: Compute, beam: Beam, runs: Sequence[RequestedRun]) -> list[list[ExperimentResult]]:
    """Simulate each run under each of its laws; return the results run by run."""
    inputs = []
    for run in runs:
        requested = replace(run.shorten() if compute.quick else run, laws=(), measured_ratio=math.nan)
        inputs += [(beam, law.terms, requested) for law in run.laws]
    results = iter(compute.all(run_experiment, inputs))
    return [[next(results) for _ in run.laws] for run in runs]


@final
@dataclass(frozen=True, kw_only=True)
class Transients(Step):
    """Simulated experiments on a beam."""

    kind, heading = "transients", "Excitation, stop and decay"
    naming = ("beam",)

    runs: Annotated[tuple[RequestedRun, ...], Meta(min_length=1)]
    laws: Annotated[tuple[LawChoice, ...], Meta(description="names of [[laws]]")] = ()
    beam: Annotated[str, Meta(description='"STEP"')] = ""
    printed: Annotated[Printed, Meta(description="{LAW = [damping ratio of each run, %]}")] = field(
        default_factory=dict
    )

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its laws and printed numbers."""
        runs = tuple(replace(run, laws=run.laws or self.laws) for run in self.runs)
        for k, run in enumerate(runs, start=1):
            run.check(study, f"{where}: runs: {k}")
        laws = _laws(runs)
        if taken := TRANSIENT_KEYS & laws.keys():
            raise InputError(f"the name {', '.join(sorted(taken))} is taken in results.json; rename the law", where)
        printed = printed_numbers(self.printed, dict.fromkeys(laws, len(runs)), where)
        return replace(self, runs=runs, laws=tuple(laws.values()), printed=printed)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the damping ratios, the amplitudes, and a figure per run."""
        runs = [replace(run, laws=tuple(law.resolve(findings) for law in run.laws)) for run in self.runs]
        return transients_finding(compute, self.beam_in(findings), runs, self.printed, self.printed_by)


def _laws(runs: Sequence[RequestedRun]) -> dict[str, LawChoice]:
    """Return the laws of all runs by name."""
    return {law.name: law for run in runs for law in run.laws}


def transients_finding(
    compute: Compute,
    beam: Beam,
    runs: Sequence[RequestedRun],
    printed: Printed | None = None,
    printed_by: str = "printed",
) -> Finding:
    """Simulate runs: their damping ratios, the amplitudes, a figure per run, and one of all damping ratios."""
    results, printed = run_experiments(compute, beam, runs), printed or {}
    rows: list[Row] = [
        (k, law, {"mode": result.numbers["mode"], "law": law.name, **result.numbers})
        for k, (run, results_of_run) in enumerate(zip(runs, results, strict=True))
        for law, result in zip(run.laws, results_of_run, strict=True)
    ]
    laws, measured = _laws(runs), [finite_or_none(run.measured_ratio) for run in runs]
    data: dict[str, Any] = {"experiment": measured} if measured.count(None) < len(runs) else {}
    for name in laws:
        ratios = {k: numbers["damping_ratio"] for k, law, numbers in rows if law.name == name}
        data[name] = [ratios.get(k) for k in range(len(runs))]
    data["runs"] = [numbers for *_, numbers in rows]
    in_order = sorted(rows, key=lambda row: int(row[2]["mode"]))
    drawings: list[Any] = [
        (_caption(run, results_of_run), _run_figure, run, results_of_run)
        for run, results_of_run in zip(runs, results, strict=True)
    ]
    if len(runs) > 2:
        titles = {name: law.title for name, law in laws.items()}
        modes = [run.mode for run in runs]
        overview = ("Damping ratio of each mode under each law.", _overview, modes, data, titles, printed, printed_by)
        drawings.append(overview)
    printed_ratios = [printed[law.name][k] if law.name in printed else None for k, law, _ in in_order]
    finding = Finding(data, (_ratios(runs, in_order), _amplitudes(in_order)), compute.drawings(*drawings))
    return finding.beside_print({"simulated, %": printed_ratios if printed_ratios.count(None) < len(rows) else None})


def _ratios(runs: Sequence[RequestedRun], rows: Sequence[Row]) -> Table:
    measured = any(math.isfinite(run.measured_ratio) for run in runs)
    cells = [
        (numbers["mode"], law.title, *[100 * runs[k].measured_ratio][:measured], 100 * numbers["damping_ratio"],
         100 * numbers["expected_damping_ratio"], 1e3 * numbers["amplitude_m"])
        for k, law, numbers in rows
    ]  # fmt: skip
    return study_table(
        "Damping ratios of the decays after the stop",
        ("mode", "law", *["measured, %"][:measured], "simulated, %", "predicted by the law, %", "at amplitude, mm"),
        cells,
    )


def _amplitudes(rows: Sequence[Row]) -> Table:
    sizes = ("base_amplitude_m", "requested_amplitude_m", "reached_amplitude_m")
    heads = ("mode", "law", "drive, Hz", "base amplitude, mm", "requested, mm", "at the stop, mm",
             "frequency in the decay, Hz")  # fmt: skip
    cells = [
        (numbers["mode"], law.title, numbers["drive_hz"], *(1e3 * numbers[name] for name in sizes),
         numbers["frequency_hz"])
        for _, law, numbers in rows
    ]  # fmt: skip
    # relative difference from the requested amplitude that the table explains
    short = any(row["reached_amplitude_m"] < (1 - 0.05) * row["requested_amplitude_m"] for *_, row in rows)
    reason = (
        "Where the amplitude at the stop is smaller than requested, the frequency of the mode falls with the "
        "amplitude by more than the width of the resonance, so that a drive at constant frequency reaches no more."
    )
    notes = ("The base amplitude is that of linear theory for the requested amplitude of the tip.", reason)
    return study_table("Amplitudes of the excitation and of the tip", heads, cells, *notes[: 1 + short])


def _overview(
    modes: Sequence[int], data: Mapping[str, Any], titles: Mapping[str, str], printed: Printed, printed_by: str
) -> Figure:
    """Draw the damping ratio of each mode under each law; ``titles`` are those of the laws by name."""
    figure, (axes,) = new_figure(3.6)
    order = sorted(range(len(modes)), key=lambda k: modes[k])
    places = np.arange(len(order))

    def in_order(ratios: Sequence[float | None]) -> Array:
        return np.array([ratios[k] for k in order], dtype=float)

    if "experiment" in data:
        axes.plot(places, 100 * in_order(data["experiment"]), "ks", ms=9, mfc="none", label="measured")
    for k, (name, title) in enumerate(titles.items()):
        axes.plot(places, 100 * in_order(data[name]), **series(k), ms=5, label=title)
        if name in printed:
            axes.plot(places, in_order(printed[name]), ls="", marker="x", ms=7, color=series(k)["color"])
    if printed:
        axes.plot([], [], "kx", ms=7, label=printed_by)
    axes.set(yscale="log", ylabel="damping ratio, %", xlabel="mode")
    axes.set_xticks(places, [str(modes[k]) for k in order])
    axes.set_title("damping ratio of each mode under each law")
    plain_log_ticks(axes, "y")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
    return figure


def _caption(run: RequestedRun, results: Sequence[ExperimentResult]) -> str:
    caption = (
        f"Mode {run.mode}, driven until {results[0].numbers['stop_s']:.4g} s.  Top: extremes of the tip "
        "displacement relative to the clamp.  Middle: the same around the stop.  "
        "Bottom: amplitude of the mode after the stop."
    )
    if math.isfinite(run.measured_ratio):
        caption += "  The measured decay is synthetic: Eq. (9) with the measured damping ratio."
    return caption


def _run_figure(run: RequestedRun, results: Sequence[ExperimentResult]) -> Figure:
    """Draw the motion under each law: extremes, waveform around the stop, amplitude of the decay."""
    figure, (whole_run, around, decay) = new_figure(5.4, 3)
    for k, (law, result) in enumerate(zip(run.laws, results, strict=True)):
        label = f"{law.title}, ζ = {100 * result.numbers['damping_ratio']:.3g} %"
        draw_band(whole_run, result.motion, 1e3, **line(k), lw=1)
        around.plot(result.stop_time, 1e3 * result.stop_motion, **line(k), lw=1)
        time, peaks = _peaks(result)
        decay.plot(time, 1e3 * peaks, **line(k), label=label)
    if math.isfinite(run.measured_ratio):  # Eq. (9) from the amplitude of the first law on
        time, peaks = _peaks(results[0])
        rate = 2 * math.pi * results[0].numbers["drive_hz"] * run.measured_ratio
        label = f"measured ζ = {100 * run.measured_ratio:.3g} %, synthetic"
        decay.plot(time, 1e3 * peaks[0] * np.exp(-rate * (time - time[0])), "k:", lw=1.5, label=label)
    whole_run.axvline(results[0].numbers["stop_s"], **REFERENCE)
    around.axvline(0.0, **REFERENCE)
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
