"""A part with damping ratio and frequency against amplitude, along the decays of simulated experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypedDict, final

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.schema.beam import law_of
from problems.study.drawing import drawn, new_figure, plain_log_ticks, series
from problems.study.kind import Kind
from problems.study.kinds.experiments.experiment import FEWEST_MODES, ExperimentResult
from problems.study.kinds.experiments.runs import ExperimentPart, Run, read_runs, results_of
from problems.study.part import Effort, Finding, Heading, Outcome
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KEYS = """\
  kind = "amplitudes"   damping ratio and frequency against amplitude in the decays
                        of simulated experiments: the keys of "transients"
"""
POINTS = 40  # of a drawn law


class AmplitudeNumbers(TypedDict):
    """Windows of a decay under a law: amplitude (m), damping ratio and frequency (Hz)."""

    mode: int
    law: str
    amplitude_m: list[float]
    damping_ratio: list[float]
    frequency_hz: list[float]


@final
@dataclass(frozen=True)
class Amplitudes(ExperimentPart):
    """Damping ratio and frequency against amplitude."""

    kind = "amplitudes"
    numbers = list[AmplitudeNumbers]

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return a figure per run."""
        by_run = results_of(self.runs, results)
        modes = natural_modes(Model(self.choice.beam(found)), count=max(FEWEST_MODES, *(run.mode for run in self.runs)))
        figures = []
        for k, (run, of_laws) in enumerate(zip(self.runs, by_run, strict=True), start=1):
            laws = [law_of(law.of(found), modes.model, law.name) for law in run.laws]
            caption = (
                f"Mode {run.mode}: damping ratio and frequency against amplitude.  Markers: windows of the simulated "
                "decays.  Lines: prediction of each law."
            )
            draw = partial(_figure, run, of_laws, laws, modes)
            figures.append(drawn(f"{self.heading.name}_{k}", caption, draw))
        data = [
            {
                "mode": run.mode,
                "law": law.name,
                "amplitude_m": result.curve[:, 0].tolist(),
                "damping_ratio": result.curve[:, 1].tolist(),
                "frequency_hz": result.curve[:, 2].tolist(),
            }
            for run, of_laws in zip(self.runs, by_run, strict=True)
            for law, result in zip(run.laws, of_laws, strict=True)
        ]
        return Finding(Outcome(data), figures=tuple(figures))


def _figure(run: Run, results: Sequence[ExperimentResult], laws: Sequence[DampingLaw | None], modes: Modes) -> Figure:
    """Draw damping ratio and frequency against amplitude."""
    figure, (ratio, frequency) = new_figure(4.6, 2, sharex=True)
    amplitudes = np.concatenate([result.curve[:, 0] for result in results])
    fine = np.geomspace(amplitudes.min(), amplitudes.max(), POINTS)
    for k, (law, result) in enumerate(zip(laws, results, strict=True)):
        style = series(k)
        amplitude, ratios, frequencies = result.curve.T
        step = max(1, len(amplitude) // POINTS)
        marks = {"ls": "", "marker": style["marker"], "color": style["color"], "ms": 4}
        ratio.plot(1e3 * amplitude[::step], 100 * ratios[::step], **marks)
        change = 100 * (frequencies / result.natural_frequency - 1)
        frequency.plot(1e3 * amplitude[::step], change[::step], **marks)
        ratio.plot(1e3 * fine, 100 * _predicted(law, modes, run.mode, fine), color=style["color"],
                   ls=style["linestyle"], label=run.laws[k].title)  # fmt: skip
    frequency.axhline(0.0, color="black", lw=0.8, ls=":")
    frequency.set_title(f"small motion: {results[0].natural_frequency:.5g} Hz")
    ratio.set(ylabel="damping ratio, %", yscale="log")
    frequency.set(xlabel=f"tip amplitude of mode {run.mode}, mm", ylabel="change of the\nfrequency, %", xscale="log")
    plain_log_ticks(ratio, "y")
    plain_log_ticks(frequency, "x")
    ratio.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure


def _predicted(law: DampingLaw | None, modes: Modes, mode: int, amplitudes: Array) -> Array:
    """Return the damping ratio of a mode under a law at each amplitude (m)."""
    if law is None:
        return np.zeros(len(amplitudes))
    return np.array([law.damping_ratios(modes, [amplitude] * modes.count)[mode - 1] for amplitude in amplitudes])


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Amplitudes:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"runs"}, {"beam", "laws"}, where)
    return Amplitudes(heading, source.beam_choice(given, where), read_runs(source, given, where))


KIND = Kind(Amplitudes.kind, "Damping and frequency against amplitude", KEYS, read)
