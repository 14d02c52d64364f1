"""Table 8, Figures 17 and 18: under the generic law, the damping ratios of neighbouring modes are independent."""

from __future__ import annotations

from dataclasses import replace

from problems.paper.inputs import EXPERIMENTS, FREQUENCIES, matched_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.transients import transients_finding
from problems.study.step import Finding, LawChoice

LAWS = (
    LawChoice(
        "generic_1",
        ({"law": "modal", "ratios": (0.012, 0.009), "frequencies": FREQUENCIES[:2]},),
        "Generic 1, ζ2 = 0.9 %",
    ),
    LawChoice(
        "generic_2",
        ({"law": "modal", "ratios": (0.012, 0.027), "frequencies": FREQUENCIES[:2]},),
        "Generic 2, ζ2 = 2.7 %",
    ),
)
PRINTED = {"generic_1": (1.2, 0.9), "generic_2": (1.2, 2.7)}  # %, of modes 1 and 2


@paper_step(
    kind="transients",
    title="Independence of neighbouring damping ratios under the generic law",
    text="""
Two generic laws share the damping ratio of mode 1 and differ in that of mode 2 by a factor of three. The decay of \
mode 1 is the same under both; that of mode 2 is not.""",
    tables=("Table 8",),
    figures=("Figure 17", "Figure 18"),
)
def independence(compute: Compute) -> Finding:
    """Return the damping ratios of modes 1 and 2 under both laws."""
    runs = [replace(run, laws=LAWS, measured_ratio=float("nan")) for run in EXPERIMENTS[:2]]
    return transients_finding(compute, matched_beam(compute), runs, PRINTED, "paper")
