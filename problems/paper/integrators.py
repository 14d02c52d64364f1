"""Beyond the paper: one experiment by both integrators, as a check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ancf_casadi.mechanics.beam import Beam
from problems.paper.inputs import EXPERIMENTS, GENERIC, matched_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.experiment import RequestedRun, run_experiment
from problems.study.step import Finding, LawChoice, study_table

HEADS = ("mode", "law", "damping ratio by Radau, %", "by IDAS, %", "largest difference of the tip around the stop, mm",
         "amplitude there, mm", "steps of Radau", "of IDAS")  # fmt: skip


@paper_step(title="One experiment by both integrators", quick=False)
def integrators(compute: Compute) -> Finding:
    """Return a short experiment in mode 2 under the generic law by both integrators."""
    run = replace(EXPERIMENTS[1], amplitude=0.004, stop=6.0)
    return compare_integrators(compute, matched_beam(compute), GENERIC, run)


def compare_integrators(compute: Compute, beam: Beam, law: LawChoice, run: RequestedRun) -> Finding:
    """Return the damping ratios by both integrators, and the largest difference around the stop (m)."""
    radau, idas = compute.all(run_experiment, [(beam, law.terms, run, method) for method in ("radau", "idas")])
    ratios = {"radau": radau.numbers["damping_ratio"], "idas": idas.numbers["damping_ratio"]}
    difference = float(np.abs(radau.stop_motion - idas.stop_motion).max())
    amplitude = float(np.abs(radau.stop_motion).max())
    row = (run.mode, law.title, *(100 * ratio for ratio in ratios.values()), 1e3 * difference, 1e3 * amplitude,
           radau.numbers["steps"], idas.numbers["steps"])  # fmt: skip
    data = [{"mode": run.mode, "law": law.name, **ratios, "largest_difference_m": difference}]
    return Finding(data, (study_table("The same experiment by both integrators", HEADS, [row]),))
