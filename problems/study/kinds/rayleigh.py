"""A step with the coefficients of Rayleigh (proportional) damping, Eq. (17), Table 3 and Figure 10 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import error_prefix
from problems.modal_damping.rayleigh import fit_rayleigh
from problems.study.compute import Compute
from problems.study.step import Finding, Findings, Printed, Step, Study, printed_numbers, study_table


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
        if self.identified_by and self.ratio_std:
            raise InputError("are found by the step that identified_by names; leave them out", f"{where}: ratio_std")
        with error_prefix(where):
            fit_rayleigh(self.frequencies, self.ratios, ratio_std=self.ratio_std or None)
        return replace(self, printed=printed_numbers(self.printed, {"value": 2}, where))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the coefficients, and the damping ratio against frequency."""
        deviations = self.ratio_std
        if self.identified_by:
            deviations = self._ratio_errors(findings[self.identified_by].data)
        fit = compute(rayleigh_finding, self.frequencies, self.ratios, deviations, compute.formats)
        return fit.beside_print(self.printed)

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
    frequencies: Sequence[float], ratios: Sequence[float], ratio_std: Sequence[float], formats: tuple[str, ...]
) -> Finding:
    """Fit Rayleigh damping: its coefficients, and the ratio of each mode, also over frequency."""
    fit = fit_rayleigh(frequencies, ratios, ratio_std=ratio_std or None)
    rows = [(name, fit.units[name], value) for name, value in fit.estimates.items()]
    errors = {"value": list(fit.standard_errors.values())}
    coefficients = study_table(
        "Coefficients of Rayleigh damping", ("coefficient", "unit", "value"), rows, errors=errors
    )
    return Finding.of(
        fit,
        "Damping ratio under Rayleigh damping against frequency, with the parts of α and β, and the measured modes.",
        formats,
        tables=(coefficients, *fit.tables()),
        terms=({"law": "rayleigh", "alpha": fit.alpha, "beta": fit.beta},),
    )
