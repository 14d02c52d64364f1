"""Beyond the paper: damping ratio and frequency against amplitude, along the decays of the experiments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ancf_casadi.decay.envelope import DampingCurve
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import REFERENCE, Figure, plain_log_ticks
from ancf_casadi.vibration.modes import natural_modes
from problems.paper.combined_law import fit_to_decays, ratio_curves
from problems.paper.inputs import experiments, matched_beam, three_laws
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.drawing import new_figure, series
from problems.study.kinds.experiment import FEWEST_MODES, RequestedRun, decay_curve
from problems.study.kinds.transients import run_experiments
from problems.study.step import Finding

LAW_POINTS = 40  # of a drawn law


@paper_step(
    title="Damping and frequency against amplitude under each law",
    text="""
The ratios of the generic and the proportional law do not depend on the amplitude; that of a quadratic law grows with \
it, and so does that of the combined law, which alone is meant for all modes at all amplitudes. The frequency of mode \
1 hardly changes, that of the higher modes falls with the square of the amplitude.""",
    quick=False,
)
def against_amplitude(compute: Compute) -> Finding:
    """Return the curves of each mode under the three laws of the paper and under the combined law."""
    runs = experiments(*three_laws(), fit_to_decays(compute)[0].choice)
    return amplitude_curves(compute, matched_beam(compute), runs)


def amplitude_curves(compute: Compute, beam: Beam, runs: Sequence[RequestedRun]) -> Finding:
    """Return amplitude (m), damping ratio and frequency (Hz) in windows of each decay, and a figure per run."""
    modes = natural_modes(Model(beam), count=max(FEWEST_MODES, *(run.mode for run in runs)))
    data: list[dict[str, Any]] = []
    drawings = []
    for run, results in zip(runs, run_experiments(compute, beam, runs), strict=True):
        curves = [decay_curve(result) for result in results]
        for law, curve in zip(run.laws, curves, strict=True):
            data.append(
                {
                    "mode": run.mode,
                    "law": law.name,
                    "amplitude_m": curve.amplitude.tolist(),
                    "damping_ratio": curve.damping_ratio.tolist(),
                    "frequency_hz": curve.frequency.tolist(),
                }
            )
        amplitudes = np.concatenate([curve.amplitude for curve in curves])
        fine = np.geomspace(amplitudes.min(), amplitudes.max(), LAW_POINTS)
        predicted = [ratio_curves(law, modes, fine)[:, run.mode - 1] for law in run.laws]
        caption = (
            f"Mode {run.mode}: damping ratio and frequency against amplitude.  Markers: windows of the simulated "
            "decays.  Lines: prediction of each law."
        )
        titles = [law.title for law in run.laws]
        natural = results[0].numbers["natural_frequency_hz"]
        drawings.append((caption, _figure, run.mode, natural, titles, curves, fine, predicted))
    return Finding(data, figures=compute.drawings(*drawings))


def _figure(
    mode: int,
    natural: float,
    titles: Sequence[str],
    curves: Sequence[DampingCurve],
    fine: Array,
    predicted: Sequence[Array],
) -> Figure:
    """Draw damping ratio and frequency against amplitude, and the predictions of the laws at fine amplitudes (m)."""
    figure, (ratio, frequency) = new_figure(4.6, 2, sharex=True)
    for k, (title, curve, prediction) in enumerate(zip(titles, curves, predicted, strict=True)):
        style = series(k)
        step = max(1, len(curve.amplitude) // LAW_POINTS)
        marks = {"ls": "", "marker": style["marker"], "color": style["color"], "ms": 4}
        ratio.plot(1e3 * curve.amplitude[::step], 100 * curve.damping_ratio[::step], **marks)
        frequency.plot(1e3 * curve.amplitude[::step], 100 * (curve.frequency[::step] / natural - 1), **marks)
        ratio.plot(1e3 * fine, 100 * prediction, color=style["color"], ls=style["linestyle"], label=title)
    frequency.axhline(0.0, **REFERENCE)
    frequency.set_title(f"small motion: {natural:.5g} Hz")
    ratio.set(ylabel="damping ratio, %", yscale="log")
    frequency.set(xlabel=f"tip amplitude of mode {mode}, mm", ylabel="change of the\nfrequency, %", xscale="log")
    plain_log_ticks(ratio, "y")
    plain_log_ticks(frequency, "x")
    ratio.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure
