"""A part with the coefficients of Rayleigh (proportional) damping, Eq. (17), Table 3 and Figure 10 of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, final

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys, is_sequence, located, numbers, physical, shown
from problems.decay.proportional import RayleighFit, fit_rayleigh, rayleigh_ratio
from problems.study.data_table import Column, DataTable, printed_values
from problems.study.drawing import drawn, line, new_figure, plain_log_ticks
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part
from problems.study.source import Source, printed_numbers, text_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KEYS = """\
  kind = "rayleigh"     alpha and beta, Eq. (17): frequencies (Hz), ratios, and
                        ratio_std of the modes to fit; identified_by = "PART": decays
                        whose standard errors to use; others = {frequencies,
                        ratios}: modes to draw beside the law; examples = [[alpha,
                        beta], ...]: laws to draw; printed = {value = [alpha, beta]}
"""


class RayleighNumbers(TypedDict):
    """Coefficients alpha (1/s) and beta (s) with their standard errors."""

    alpha: float
    beta: float
    alpha_stderr: float | None
    beta_stderr: float | None
    warnings: list[str]


@final
@dataclass(frozen=True)
class Rayleigh(Part):
    """Rayleigh damping from the damping ratios of modes.

    Parameters
    ----------
    frequencies, ratios : tuple of float
        Frequencies, Hz, and damping ratios of the fitted modes.
    ratio_std : tuple of float
        Standard deviations of the ratios; empty if unknown.
    identified_by : str
        Name of the part with decays, mode by mode, whose standard errors are used instead; none if empty.
    others : tuple of (float, float)
        Frequency and ratio of other measured modes.
    examples : tuple of (float, float)
        Coefficients alpha, 1/s, and beta, s, of laws to draw.
    printed : dict
        Printed numbers by column.
    """

    kind = "rayleigh"
    numbers = RayleighNumbers

    frequencies: tuple[float, ...]
    ratios: tuple[float, ...]
    ratio_std: tuple[float, ...]
    identified_by: str
    others: tuple[tuple[float, float], ...]
    examples: tuple[tuple[float, float], ...]
    printed: dict[str, tuple[float | None, ...]]

    @property
    def needs(self) -> tuple[str, ...]:
        """The part with the standard errors."""
        return (self.identified_by,) if self.identified_by else ()

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the coefficients, and the damping ratio against frequency."""
        deviations = self.ratio_std
        if self.identified_by:
            deviations = self._identified(found[self.identified_by].data)
        fit = fit_rayleigh(self.frequencies, self.ratios, ratio_std=deviations or None)
        errors = (fit.standard_errors["alpha"], fit.standard_errors["beta"])
        name, heading = self.heading.name, self.heading
        columns = (
            Column("coefficient", ("alpha", "beta")),
            Column("unit", ("1/s", "s")),
            Column("value", (fit.alpha, fit.beta), errors=errors, printed=printed_values(self.printed, "value")),
        )
        modes = zip((*self.frequencies, *(f for f, _ in self.others)), (*self.ratios, *(z for _, z in self.others)),
                    strict=True)  # fmt: skip
        rows = [(f, 100 * z, float(100 * rayleigh_ratio(np.array(f), fit.alpha, fit.beta))) for f, z in modes]
        law = (
            Column("frequency", tuple(f for f, *_ in rows), "Hz"),
            Column("measured", tuple(z for _, z, _ in rows), "%"),
            Column("Eq. (16)", tuple(z for *_, z in rows), "%"),
        )
        tables = (
            DataTable(name, "Coefficients of Rayleigh damping", columns, heading.notes, heading.source),
            DataTable(f"{name}_ratios", "Damping ratios under this law", law),
        )
        caption = (
            "Damping ratio under Rayleigh damping against frequency, with the parts of α and β, and the measured modes."
        )
        if self.examples:
            caption += " Below: laws with arbitrary coefficients, and the parts of each."
        data = {
            "alpha": fit.alpha,
            "beta": fit.beta,
            "alpha_stderr": None if math.isnan(errors[0]) else errors[0],
            "beta_stderr": None if math.isnan(errors[1]) else errors[1],
            "warnings": list(fit.warnings),
        }
        terms = ({"law": "rayleigh", "alpha": fit.alpha, "beta": fit.beta},)
        figure = drawn(name, caption, lambda: self._figure(fit))
        return Finding(Outcome(data, terms=terms), tables, (figure,), fit.warnings)

    def _identified(self, data: Any) -> tuple[float, ...]:
        """Return the standard errors that a part with decays has found; none if one is unknown."""
        rows = data[: len(self.ratios)] if isinstance(data, list) else []
        errors = [row.get("damping_ratio_stderr") for row in rows if "damping_ratio" in row]
        if len(errors) < len(self.ratios):
            raise InputError(
                f"the part {self.identified_by!r} does not identify these {len(self.ratios)} modes; name a part of the "
                "kind decays",
                f"{self.heading.name}: identified_by",
            )
        return () if None in errors else tuple(errors)

    def _figure(self, fit: RayleighFit) -> Figure:
        figure, panels = new_figure(5.4 if self.examples else 3.2, 2 if self.examples else 1)
        known = [*self.frequencies, *(f for f, _ in self.others)]
        f = np.geomspace(0.5 * min(known), 2 * max(known), 200)
        panels[0].plot(f, 100 * rayleigh_ratio(f, fit.alpha, 0.0), **line(1), label="α M")
        panels[0].plot(f, 100 * rayleigh_ratio(f, 0.0, fit.beta), **line(2), label="β K")
        panels[0].plot(f, 100 * rayleigh_ratio(f, fit.alpha, fit.beta), **line(0), label="α M + β K, Eq. (16)")
        panels[0].plot(self.frequencies, 100 * np.array(self.ratios), "ko", label="fitted modes")
        if self.others:
            panels[0].plot(*zip(*((f, 100 * z) for f, z in self.others), strict=True), "kx", label="other modes")
        panels[0].set_title(f"α = {fit.alpha:.4g} 1/s,  β = {fit.beta:.4g} s")
        if self.examples:
            for k, (alpha, beta) in enumerate(self.examples):
                panels[1].plot(
                    f, 100 * rayleigh_ratio(f, alpha, beta), **line(k), label=f"α = {alpha:g} 1/s, β = {beta:g} s"
                )
            panels[1].set_title("arbitrary coefficients")
        for axes in panels:
            axes.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
            plain_log_ticks(axes, "x")
            axes.legend()
        shown = 100 * np.array([*self.ratios, *(z for _, z in self.others)])
        panels[0].set_ylim(0.2 * shown.min(), 5 * shown.max())
        plain_log_ticks(panels[0], "y")
        return figure


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Rayleigh:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"frequencies", "ratios"}, {"ratio_std", "identified_by", "others", "examples", "printed"}, where)
    with located(where):
        frequencies, ratios = numbers(given["frequencies"], "frequencies"), numbers(given["ratios"], "ratios")
        deviations = numbers(given["ratio_std"], "ratio_std") if "ratio_std" in given else ()
        fit_rayleigh(frequencies, ratios, ratio_std=deviations or None)  # check
        return Rayleigh(
            heading,
            tuple(frequencies),
            tuple(ratios),
            tuple(deviations),
            text_of(given, "identified_by", ""),
            _others(given),
            _examples(given),
            printed_numbers(given, {"value": 2}),
        )


def _others(given: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """Return frequency and ratio of the other modes."""
    others = given.get("others", {"frequencies": [], "ratios": []})
    check_keys(others, {"frequencies", "ratios"}, set(), "others")
    frequencies, ratios = (numbers(others[key], f"others: {key}") for key in ("frequencies", "ratios"))
    if len(frequencies) != len(ratios):
        raise InputError(f"has {len(ratios)} values for {len(frequencies)} frequencies", "others: ratios")
    return tuple(
        (physical(f, "others: frequencies"), physical(z, "others: ratios"))
        for f, z in zip(frequencies, ratios, strict=True)
    )


def _examples(given: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """Return alpha and beta of the laws to draw."""
    examples = given.get("examples", [])
    if not is_sequence(examples):
        raise InputError(f"must be a list of pairs alpha, beta, got {shown(examples)}", "examples")
    pairs = [numbers(pair, "examples") for pair in examples]
    for pair in pairs:
        if len(pair) != 2:
            raise InputError(f"must be pairs alpha, beta, got {shown(pair)}", "examples")
    return tuple((alpha, beta) for alpha, beta in pairs)


KIND = Kind(Rayleigh.kind, "Rayleigh (proportional) damping", KEYS, read)
