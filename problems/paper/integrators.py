"""Beyond the paper: one experiment by both integrators, as a check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ancf_casadi.mechanics.beam import Beam
from problems.paper.inputs import EXPERIMENTS, GENERIC, matched_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.transients import run_experiments
from problems.study.step import Finding, study_table

HEADS = ("mode", "law", "damping ratio by Radau, %", "by IDAS, %", "largest difference of the tip around the stop, mm",
         "amplitude there, mm", "steps of Radau", "of IDAS")  # fmt: skip


@paper_step(title="One experiment by both integrators", quick=False)
def integrators(compute: Compute) -> Finding:
    """Return a short experiment in mode 2 under the generic law by both integrators."""
    run = replace(EXPERIMENTS[1], amplitude=0.004, stop=6.0, laws=(GENERIC,))
    return compare_integrators(compute, matched_beam(compute), [run])


def compare_integrators(compute: Compute, beam: Beam, runs: Sequence[RequestedRun]) -> Finding:
    """Return the damping ratios by both integrators, and the largest difference around the stop (m).

    Each run has one law.
    """
    data, rows = [], []
    results = run_experiments(compute, beam, runs, ("radau", "idas"))
    for run, (radau, idas) in zip(runs, results, strict=True):
        ratios = [result.numbers["damping_ratio"] for result in (radau, idas)]
        steps = [result.numbers["steps"] for result in (radau, idas)]
        difference = float(np.abs(radau.stop_motion - idas.stop_motion).max())
        amplitude = float(np.abs(radau.stop_motion).max())
        (law,) = run.laws
        data.append({"mode": run.mode, "law": law.name, "radau": ratios[0], "idas": ratios[1],
                     "largest_difference_m": difference})  # fmt: skip
        percent = [100 * ratio for ratio in ratios]
        rows.append((run.mode, law.title, *percent, 1e3 * difference, 1e3 * amplitude, *steps))
    return Finding(data, (study_table("The same experiment by both integrators", HEADS, rows),))
