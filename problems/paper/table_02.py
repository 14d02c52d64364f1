"""Table 2, Figures 5 to 9: frequency and damping ratio of each mode from free decays, Eqs. (9) and (10)."""

from __future__ import annotations

from problems.paper.inputs import FREQUENCIES, PRINTED_RATIOS, RATIOS, SEED
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.decays import SyntheticDecay, decays_finding, fit_all, synthetic_decays
from problems.study.step import Finding

AMPLITUDES = (0.050, 0.015, 0.008, 0.005, 0.005)  # m, at release
PRINTED = {"frequency": FREQUENCIES, "damping_ratio": PRINTED_RATIOS}  # Hz, %

DECAYS = synthetic_decays(map(SyntheticDecay, FREQUENCIES, AMPLITUDES, RATIOS), SEED)


def decay_fits(compute: Compute) -> list[Finding]:
    """Return the fits of the decays by the linear law."""
    return fit_all(compute, DECAYS, "linear", "zero", compute.formats)


@paper_step(
    kind="decays",
    title="Modal parameters from free decays, Eqs. (9) and (10)",
    text="""
Each record is a free decay by Eq. (9) with the frequency and damping ratio of Table 2, white noise added. The fit by \
Eq. (10) recovers both with their standard errors.""",
    tables=("Table 2",),
    figures=("Figure 5", "Figure 6", "Figure 7", "Figure 8", "Figure 9"),
    notes=(
        "The paper states neither frame rate nor length nor noise nor amplitude of its records; those here are inputs.",
    ),
)
def modal_identification(compute: Compute) -> Finding:
    """Return the modal parameters that the fits of the decays identify."""
    return decays_finding(DECAYS, decay_fits(compute), PRINTED)
