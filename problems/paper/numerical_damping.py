"""Beyond the paper: the experiments without damping, whose remaining damping ratio is that of the integrator."""

from __future__ import annotations

from problems.paper.inputs import STOPS, matched_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.transients import transients_finding
from problems.study.step import Finding, LawChoice

UNDAMPED = LawChoice("undamped", (), "undamped")
AMPLITUDES = (0.076, 0.0040, 0.0015, 0.0007, 0.00045)  # m


@paper_step(
    kind="transients",
    title="Numerical damping",
    text="""
The same experiments without damping, for a tenth of the time: the remaining ratio is that of the integrator.""",
    draw=False,
    quick=False,
)
def numerical_damping(compute: Compute) -> Finding:
    """Return the damping ratio of each mode without a damping law."""
    runs = [
        RequestedRun(mode, amplitude, stop / 10, laws=(UNDAMPED,))
        for mode, (amplitude, stop) in enumerate(zip(AMPLITUDES, STOPS, strict=True), start=1)
    ]
    return transients_finding(compute, matched_beam(compute), runs)
