"""Table 4: quadratic damping of each mode from free decays, Eq. (27)."""

from __future__ import annotations

from problems.paper.inputs import AMPLITUDES, ETA1, ETA2, FREQUENCIES, PRINTED_RATIOS, SEED
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.decays import SyntheticDecay, decays_finding, fit_all, synthetic_decays
from problems.study.step import Finding

PRINTED = {"frequency": FREQUENCIES, "damping_ratio": PRINTED_RATIOS, "eta1": ETA1, "eta2": ETA2}

DECAYS = synthetic_decays(
    (SyntheticDecay(frequency, amplitude, eta1=eta1, eta2=eta2)
     for frequency, amplitude, eta1, eta2 in zip(FREQUENCIES, AMPLITUDES, ETA1, ETA2, strict=True)),
    SEED + 1,
)  # fmt: skip


def decay_fits(compute: Compute) -> list[Finding]:
    """Return the fits of the decays by the quadratic law."""
    return fit_all(compute, DECAYS, "quadratic", "zero")


@paper_step(
    kind="decays",
    title="Quadratic damping of each mode from free decays, Eq. (27)",
    text="""
Each record is a free decay by Eq. (27) with the eta1 and eta2 that Table 4 prints, from the amplitude at which Eq. \
(26) has the printed equivalent damping ratio, white noise added.""",
    tables=("Table 4",),
    draw=False,
    notes=(
        "The paper prints eta2 per mm: 1.1E-4 stands for 0.11 1/m. The equivalent ratio refers to the amplitude, which "
        "the paper does not state; 76, 14.9, 7.6, 5.5 and 14.4 mm follow from its ratios.",
        "Where the standard error is close to eta2 and the correlation close to -1, the record determines only a "
        "combination of eta1 and eta2.",
    ),
)
def quadratic(compute: Compute) -> Finding:
    """Return eta1 and eta2 of each mode that the fits of the decays identify."""
    return decays_finding(DECAYS, decay_fits(compute), PRINTED)
