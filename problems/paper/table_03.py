"""Table 3, Figure 10: proportional (Rayleigh) damping from the damping ratios of modes 1 and 2, Eq. (17)."""

from __future__ import annotations

from problems.paper.inputs import FREQUENCIES, RATIOS
from problems.paper.step import paper_step
from problems.paper.table_02 import decay_fits
from problems.study.compute import Compute
from problems.study.kinds.rayleigh import OtherModes, rayleigh_finding
from problems.study.step import Finding

PRINTED = {"value": (0.228, 3.18e-4)}  # alpha, 1/s, and beta, s
EXAMPLES = ((4.0, 0.0), (0.0, 0.1), (4.0, 0.1))  # alpha and beta of Figure 10


@paper_step(
    kind="rayleigh",
    section="External damping models (Section 4)",
    title="Proportional damping from modes 1 and 2, Eq. (17)",
    tables=("Table 3",),
    figures=("Figure 10",),
    notes=(
        "The printed beta is ten times the result of Eq. (17) with Table 2, 3.18e-5 s.",
        "Figure 10 of the paper has alpha = 4, beta = 0.1: 75 % at 1.85 Hz, so that the measured range lies on the "
        "branch of beta.",
        "Standard errors follow from those of Table 2.",
    ),
)
def proportional(compute: Compute) -> Finding:
    """Return alpha and beta, with the standard errors that follow from those of Table 2."""
    errors = [fit.numbers["damping_ratio_stderr"] for fit in decay_fits(compute)[:2]]
    others = OtherModes(FREQUENCIES[2:], RATIOS[2:])
    return rayleigh_finding(
        compute, FREQUENCIES[:2], RATIOS[:2], errors, others=others, examples=EXAMPLES, printed=PRINTED
    )
