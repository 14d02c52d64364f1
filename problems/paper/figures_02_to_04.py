"""Figures 2 to 4: photographs, which are not computed."""

from __future__ import annotations

from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.step import Finding

FIGURES = ("Figure 2", "Figure 3", "Figure 4")
REASON = (
    "Photographs of the high-speed camera, the exciter and the set-up with its markers; there is nothing to compute."
)


@paper_step(
    section="Experimental modal testing and identification (Section 3)",
    title="The experiment",
    figures=FIGURES,
    text=REASON,
)
def photographs(compute: Compute) -> Finding:
    """Return the labels of what is not computed, and the reason."""
    return Finding({"omitted": list(FIGURES), "reason": REASON})
