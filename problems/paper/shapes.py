"""Beyond the paper: deformed shapes over the last period of the excitation of each experiment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from problems.paper.inputs import GENERIC, experiments, matched_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.drawing import new_figure, series
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.transients import run_experiments
from problems.study.step import Finding


@paper_step(title="Deformed shapes over a period")
def shapes(compute: Compute) -> Finding:
    """Return the extent of the motion of the tip in the experiments under the generic law."""
    return deformed_shapes(compute, matched_beam(compute), experiments(GENERIC))


def deformed_shapes(compute: Compute, beam: Beam, runs: Sequence[RequestedRun]) -> Finding:
    """Return the extent of the motion of the tip over one period (m), and the shapes, one panel per run."""
    along, across = np.array(beam.axis), np.array(beam.across)
    data, panels = [], []
    for run, (result, *_) in zip(runs, run_experiments(compute, beam, runs), strict=True):
        tip = result.shapes[:, -1]
        extents = {"tip_across_m": float(np.ptp(tip @ across)), "tip_along_m": float(np.ptp(tip @ along))}
        data.append({"mode": run.mode, **extents})
        panels.append((run.mode, result.shapes @ along, result.shapes @ across))
    caption = (
        "Deformed shapes over the last period before the stop, light to dark.  Each panel has its own scale across "
        "the beam."
    )
    return Finding(data, figures=compute.drawings((caption, _figure, panels)))


def _figure(panels: Sequence[tuple[int, Array, Array]]) -> Figure:
    """Draw the shapes of each mode: its number, and coordinates along and across the beam."""
    figure, all_axes = new_figure(4.4, 1, len(panels), sharey=True)
    for axes, (mode, along, across) in zip(all_axes, panels, strict=True):
        for k in range(len(along)):
            axes.plot(1e3 * across[k], 1e3 * along[k], color=series(0)["color"], lw=0.8,
                      alpha=0.25 + 0.75 * k / (len(along) - 1))  # fmt: skip
        axes.set_title(f"mode {mode}")
        axes.set_xlabel("mm")
    all_axes[0].set_ylabel("position along the beam, mm")
    all_axes[0].invert_yaxis()
    return figure
