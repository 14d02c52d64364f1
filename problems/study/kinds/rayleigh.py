"""A step with the coefficients of Rayleigh (proportional) damping, Eq. (17), Table 3 and Figure 10 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.tables import finite_or_none
from problems.modal_damping.rayleigh import fit_rayleigh, rayleigh_ratio
from problems.study.compute import Compute
from problems.study.drawing import line, new_figure
from problems.study.step import Finding, Findings, Printed, Step, Study, printed_numbers, table_beside_print


@dataclass(frozen=True)
class OtherModes:
    """Frequencies (Hz) and damping ratios of modes."""

    frequencies: tuple[float, ...] = ()
    ratios: tuple[float, ...] = ()


NO_MODES = OtherModes()


@final
@dataclass(frozen=True, kw_only=True)
class Rayleigh(Step):
    """Rayleigh damping from the damping ratios of modes, Eq. (17)."""

    kind, heading = "rayleigh", "Rayleigh (proportional) damping"
    naming = ("identified_by",)

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz, of the modes to fit")]
    ratios: tuple[float, ...]
    ratio_std: tuple[float, ...] = ()
    identified_by: Annotated[str, Meta(description='"STEP": decays whose standard errors to use')] = ""
    printed: Annotated[Printed, Meta(description="{value = [alpha, beta]}")] = field(default_factory=dict)

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its printed numbers, once its modes have a law."""
        with error_prefix(where):
            fit_rayleigh(self.frequencies, self.ratios, ratio_std=self.ratio_std or None)
        return replace(self, printed=printed_numbers(self.printed, {"value": 2}, where))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the coefficients, and the damping ratio against frequency."""
        deviations = self.ratio_std
        if self.identified_by:
            deviations = self._ratio_errors(findings[self.identified_by].data)
        return rayleigh_finding(compute, self.frequencies, self.ratios, deviations, printed=self.printed)

    def _ratio_errors(self, data: Any) -> tuple[float, ...]:
        """Return the standard errors that a step with decays has found; none if one is unknown."""
        rows = data[: len(self.ratios)] if isinstance(data, list) else []
        errors = [row.get("damping_ratio_stderr") for row in rows if "damping_ratio" in row]
        if len(errors) < len(self.ratios):
            raise InputError(
                f"the step {self.identified_by!r} does not identify these {len(self.ratios)} modes; name a step of the "
                "kind decays",
                f"{self.where}: identified_by",
            )
        return () if None in errors else tuple(errors)


def rayleigh_finding(
    compute: Compute,
    frequencies: Sequence[float],
    ratios: Sequence[float],
    ratio_std: Sequence[float] = (),
    *,
    others: OtherModes = NO_MODES,
    examples: Sequence[tuple[float, float]] = (),
    printed: Printed | None = None,
) -> Finding:
    """Fit the coefficients of Rayleigh damping: their table, the ratio of each mode, and a figure over frequency."""
    fit = fit_rayleigh(frequencies, ratios, ratio_std=ratio_std or None)
    errors = (fit.standard_errors["alpha"], fit.standard_errors["beta"])
    modes = zip((*frequencies, *others.frequencies), (*ratios, *others.ratios), strict=True)
    rows = [(f, 100 * z, float(100 * rayleigh_ratio(np.array(f), fit.alpha, fit.beta))) for f, z in modes]
    tables = (
        table_beside_print(
            "Coefficients of Rayleigh damping",
            ("coefficient", "unit", "value"),
            [("alpha", "1/s", fit.alpha), ("beta", "s", fit.beta)],
            errors={"value": errors},
            printed={"value": (printed or {}).get("value")},
        ),
        table_beside_print("Damping ratios under this law", ("frequency, Hz", "measured, %", "Eq. (16), %"), rows),
    )
    caption = (
        "Damping ratio under Rayleigh damping against frequency, with the parts of α and β, and the measured modes."
    )
    if examples:
        caption += " Below: laws with arbitrary coefficients, and the parts of each."
    data = {
        "alpha": fit.alpha,
        "beta": fit.beta,
        "alpha_stderr": finite_or_none(errors[0]),
        "beta_stderr": finite_or_none(errors[1]),
        "warnings": list(fit.warnings),
    }
    terms = ({"law": "rayleigh", "alpha": fit.alpha, "beta": fit.beta},)
    figures = compute.drawings((caption, _figure, fit.alpha, fit.beta, frequencies, ratios, others, examples))
    return Finding(data, tables, figures, fit.warnings, terms=terms)


def _figure(
    alpha: float,
    beta: float,
    frequencies: Sequence[float],
    ratios: Sequence[float],
    others: OtherModes,
    examples: Sequence[tuple[float, float]],
) -> Figure:
    figure, panels = new_figure(5.4 if examples else 3.2, 2 if examples else 1)
    all_frequencies = [*frequencies, *others.frequencies]
    f = np.geomspace(0.5 * min(all_frequencies), 2 * max(all_frequencies), 200)
    panels[0].plot(f, 100 * rayleigh_ratio(f, alpha, 0.0), **line(1), label="α M")
    panels[0].plot(f, 100 * rayleigh_ratio(f, 0.0, beta), **line(2), label="β K")
    panels[0].plot(f, 100 * rayleigh_ratio(f, alpha, beta), **line(0), label="α M + β K, Eq. (16)")
    panels[0].plot(frequencies, 100 * np.array(ratios), "ko", label="fitted modes")
    if others.ratios:
        panels[0].plot(others.frequencies, 100 * np.array(others.ratios), "kx", label="other modes")
    panels[0].set_title(f"α = {alpha:.4g} 1/s,  β = {beta:.4g} s")
    for k, (α, β) in enumerate(examples):
        panels[1].plot(f, 100 * rayleigh_ratio(f, α, β), **line(k), label=f"α = {α:g} 1/s, β = {β:g} s")
        panels[1].set_title("arbitrary coefficients")
    for axes in panels:
        axes.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
        plain_log_ticks(axes, "x")
        axes.legend()
    shown = 100 * np.array([*ratios, *others.ratios])
    panels[0].set_ylim(0.2 * shown.min(), 5 * shown.max())
    plain_log_ticks(panels[0], "y")
    return figure
