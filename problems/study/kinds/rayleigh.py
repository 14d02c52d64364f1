"""A part with the coefficients of Rayleigh (proportional) damping, Eq. (17), Table 3 and Figure 10 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.support.inputs import located
from ancf_casadi.support.specs import Positive, Spec
from ancf_casadi.support.tables import known
from problems.modal_damping.rayleigh import RayleighFit, fit_rayleigh, rayleigh_ratio
from problems.study.drawing import drawn, line, new_figure
from problems.study.part import Finding, Found, Part, Printed, Study, printed_numbers


class OtherModes(Spec, frozen=True):
    """Frequencies (Hz) and damping ratios of modes."""

    frequencies: tuple[Positive, ...] = ()
    ratios: tuple[Positive, ...] = ()


@final
@dataclass(frozen=True, kw_only=True)
class Rayleigh(Part):
    """Rayleigh damping from the damping ratios of modes."""

    kind, about, heading = "rayleigh", "alpha and beta, Eq. (17): {}", "Rayleigh (proportional) damping"
    naming = ("identified_by",)

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz, of the modes to fit")]
    ratios: tuple[float, ...]
    ratio_std: tuple[float, ...] = ()
    identified_by: Annotated[str, Meta(description='"PART": decays whose standard errors to use')] = ""
    others: Annotated[OtherModes, Meta(description="{frequencies, ratios}: modes to draw beside the law")] = field(
        default_factory=OtherModes
    )
    examples: Annotated[tuple[tuple[float, float], ...], Meta(description="[[alpha, beta], ...]: laws to draw")] = ()
    printed: Annotated[Printed, Meta(description="{value = [alpha, beta]}")] = field(default_factory=dict)

    def checked(self, study: Study, where: str) -> Self:
        """Return the part with its printed numbers, once its modes have a law."""
        with located(where):
            fit_rayleigh(self.frequencies, self.ratios, ratio_std=self.ratio_std or None)
            if len(self.others.ratios) != len(self.others.frequencies):
                raise InputError(
                    f"has {len(self.others.ratios)} values for {len(self.others.frequencies)} frequencies",
                    "others: ratios",
                )
        return replace(self, printed=printed_numbers(self.printed, {"value": 2}, where))

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        """Return the coefficients, and the damping ratio against frequency."""
        deviations = self.ratio_std
        if self.identified_by:
            deviations = self._identified(found[self.identified_by].data)
        fit = fit_rayleigh(self.frequencies, self.ratios, ratio_std=deviations or None)
        errors = (fit.standard_errors["alpha"], fit.standard_errors["beta"])
        modes = zip((*self.frequencies, *self.others.frequencies), (*self.ratios, *self.others.ratios), strict=True)
        rows = [(f, 100 * z, float(100 * rayleigh_ratio(np.array(f), fit.alpha, fit.beta))) for f, z in modes]
        tables = (
            self.table(
                "Coefficients of Rayleigh damping",
                ("coefficient", "unit", "value"),
                [("alpha", "1/s", fit.alpha), ("beta", "s", fit.beta)],
                errors={"value": errors},
                printed={"value": self.printed.get("value")},
            ),
            self.table("Damping ratios under this law", ("frequency, Hz", "measured, %", "Eq. (16), %"), rows),
        )
        caption = (
            "Damping ratio under Rayleigh damping against frequency, with the parts of α and β, and the measured modes."
        )
        if self.examples:
            caption += " Below: laws with arbitrary coefficients, and the parts of each."
        data = {
            "alpha": fit.alpha,
            "beta": fit.beta,
            "alpha_stderr": known(errors[0]),
            "beta_stderr": known(errors[1]),
            "warnings": list(fit.warnings),
        }
        terms = ({"law": "rayleigh", "alpha": fit.alpha, "beta": fit.beta},)
        figure = drawn(caption, lambda: self._figure(fit))
        return Finding(data, tables, (figure,), fit.warnings, terms=terms)

    def _identified(self, data: Any) -> tuple[float, ...]:
        """Return the standard errors that a part with decays has found; none if one is unknown."""
        rows = data[: len(self.ratios)] if isinstance(data, list) else []
        errors = [row.get("damping_ratio_stderr") for row in rows if "damping_ratio" in row]
        if len(errors) < len(self.ratios):
            raise InputError(
                f"the part {self.identified_by!r} does not identify these {len(self.ratios)} modes; name a part of the "
                "kind decays",
                f"{self.name}: identified_by",
            )
        return () if None in errors else tuple(errors)

    def _figure(self, fit: RayleighFit) -> Figure:
        figure, panels = new_figure(5.4 if self.examples else 3.2, 2 if self.examples else 1)
        known = [*self.frequencies, *self.others.frequencies]
        f = np.geomspace(0.5 * min(known), 2 * max(known), 200)
        panels[0].plot(f, 100 * rayleigh_ratio(f, fit.alpha, 0.0), **line(1), label="α M")
        panels[0].plot(f, 100 * rayleigh_ratio(f, 0.0, fit.beta), **line(2), label="β K")
        panels[0].plot(f, 100 * rayleigh_ratio(f, fit.alpha, fit.beta), **line(0), label="α M + β K, Eq. (16)")
        panels[0].plot(self.frequencies, 100 * np.array(self.ratios), "ko", label="fitted modes")
        if self.others.ratios:
            panels[0].plot(self.others.frequencies, 100 * np.array(self.others.ratios), "kx", label="other modes")
        panels[0].set_title(f"α = {fit.alpha:.4g} 1/s,  β = {fit.beta:.4g} s")
        for k, (alpha, beta) in enumerate(self.examples):
            label = f"α = {alpha:g} 1/s, β = {beta:g} s"
            panels[1].plot(f, 100 * rayleigh_ratio(f, alpha, beta), **line(k), label=label)
            panels[1].set_title("arbitrary coefficients")
        for axes in panels:
            axes.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
            plain_log_ticks(axes, "x")
            axes.legend()
        shown = 100 * np.array([*self.ratios, *self.others.ratios])
        panels[0].set_ylim(0.2 * shown.min(), 5 * shown.max())
        plain_log_ticks(panels[0], "y")
        return figure
