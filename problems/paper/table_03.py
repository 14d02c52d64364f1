"""Table 3, Figure 10: proportional (Rayleigh) damping from the damping ratios of modes 1 and 2, Eq. (17)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ancf_casadi.support.figures import Figure, plain_log_ticks
from problems.modal_damping.rayleigh import fit_rayleigh, rayleigh_ratio
from problems.paper.inputs import FREQUENCIES, PRINTED_RATIOS, RATIOS
from problems.paper.step import paper_step
from problems.paper.table_02 import decay_fits
from problems.study.compute import Compute
from problems.study.drawing import line, new_figure
from problems.study.kinds.rayleigh import rayleigh_finding
from problems.study.step import Finding, study_table

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
    errors = tuple(decay.data["damping_ratio_stderr"] for decay in decay_fits(compute)[:2])
    fit: Finding = compute(rayleigh_finding, FREQUENCIES[:2], RATIOS[:2], errors, ())
    ratios = 100 * rayleigh_ratio(np.array(FREQUENCIES), fit.data["alpha"], fit.data["beta"])
    rows = zip(FREQUENCIES, PRINTED_RATIOS, ratios.tolist(), strict=True)
    heads = ("frequency, Hz", "measured, %", "Eq. (16), %")
    tables = (fit.tables[0], study_table("Damping ratios under this law", heads, rows))
    caption = (
        "Damping ratio under Rayleigh damping against frequency: the law of modes 1 and 2, and the law that fits all "
        "five modes best.  Below: laws with arbitrary coefficients, and the parts of each."
    )
    return replace(fit, tables=tables, figures=compute.drawings((caption, _figure))).beside_print(PRINTED)


def _figure() -> Figure:
    """Draw the fits to the first two and to all modes, and laws with the coefficients of Figure 10."""
    figure, (fits, arbitrary) = new_figure(5.4, 2)
    f = np.geomspace(0.5 * FREQUENCIES[0], 2 * FREQUENCIES[-1], 200)
    fits.plot(FREQUENCIES, PRINTED_RATIOS, "ko", label="measured")
    for k, (count, title) in enumerate(((2, "modes 1 and 2"), (5, "all modes"))):
        fit = fit_rayleigh(FREQUENCIES[:count], RATIOS[:count])
        fits.plot(f, 100 * rayleigh_ratio(f, fit.alpha, fit.beta), **line(k), label=f"law of {title}, Eq. (16)")
    for k, (α, β) in enumerate(EXAMPLES):
        arbitrary.plot(f, 100 * rayleigh_ratio(f, α, β), **line(k), label=f"α = {α:g} 1/s, β = {β:g} s")
    for axes in (fits, arbitrary):
        axes.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
        plain_log_ticks(axes, "x")
        axes.legend()
    plain_log_ticks(fits, "y")
    return figure
