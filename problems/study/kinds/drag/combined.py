"""A part with modal plus quadratic damping as one law for all modes, and the air drag behind it.

It takes eta1 and eta2 of each mode from a part with decays under the quadratic law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Self, TypedDict, final

import numpy as np
from msgspec import Meta

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.modal_damping.air import Air, implied_drag_coefficient, viscous_damping_ratios
from problems.modal_damping.combined_law import CombinedLawFit, ModeCoefficients, fit_combined_law, ratio_curves
from problems.schema.beam import law_of
from problems.schema.table import Positive
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn, line, new_figure
from problems.study.part import Effort, Finding, Found, Part
from problems.study.source import LawChoice, Printed, Source, printed_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "modal + quadratic"


class CombinedNumbers(TypedDict):
    """The law, and the drag of each mode."""

    law: dict[str, Any]
    drag: list[dict[str, Any]]


@final
@dataclass(frozen=True, kw_only=True)
class CombinedLaw(Part):
    """One law for all modes, and the drag of the air."""

    kind, heading = "combined_law", "One law for all modes"
    about = "modal plus quadratic damping for all modes, and the drag of the air: {}"
    numbers = CombinedNumbers
    naming = ("beam", "decays")

    decays: Annotated[str, Meta(description='"PART": decays with law = "quadratic"')]
    laws: Annotated[tuple[LawChoice, ...], Meta(description="to draw beside it")] = ()
    beam: Annotated[str, Meta(description='"PART"')] = ""
    amplitudes: Annotated[tuple[Positive, ...], Meta(description="m, at the tip, up to which each mode is drawn")] = ()
    air: Annotated[Air, Meta(description="{density, density_std (kg/m^3), viscosity (Pa s)}")] = field(
        default_factory=Air
    )
    printed: Annotated[Printed, Meta(description="{eta2 (1/m)}")] = field(default_factory=dict)

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its printed numbers."""
        return replace(self, printed=printed_numbers(self.printed, {"eta2": None}, where))

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts whose findings it needs, and always the beam of the file, for the printed numbers."""
        return tuple(dict.fromkeys((*super().needs, "")))

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the law, the drag coefficients, and the damping ratio against amplitude."""
        rows = found[self.decays].data
        measured = _coefficients(rows, self.decays)
        if len(self.printed.get("eta2", measured)) != len(measured):
            raise InputError(f"must have one value per mode, {len(measured)}", f"{self.name}: printed: eta2")
        modes = natural_modes(Model(self.beam_in(found)), count=len(measured))
        fit = fit_combined_law(measured, modes)
        drag = [self._drag_coefficient(fit, one.eta2, math.sqrt(one.covariance[1, 1])) for one in measured]
        viscous = viscous_damping_ratios(modes, self.air)
        total = self._drag_coefficient(fit, fit.eta2, float(np.nan_to_num(fit.standard_errors["eta2"])))
        data = {
            "law": {**fit.to_dict(), "drag_coefficient": total[0], "drag_coefficient_stderr": total[1]},
            "drag": [
                {
                    "mode": n + 1,
                    "drag_coefficient": value / c,
                    "drag_coefficient_stderr": error / c,
                    "drag_coefficient_by_eq_25": value,
                    "viscous_damping_ratio": float(viscous[n]),
                }
                for n, ((value, error), c) in enumerate(zip(drag, fit.drag_constants, strict=True))
            ],
        }
        frequencies = [one.frequency for one in measured]
        terms = (
            {"law": "modal", "ratios": list(fit.ratios), "frequencies": frequencies},
            {"law": "quadratic", "eta2": fit.eta2},
        )
        tables = (self._law(fit, total), self._drag(fit, drag, viscous.tolist(), found[""].beam))
        return Finding(data, tables, self._drawings(fit, modes, found, rows), fit.warnings, terms=terms)

    def _drag_coefficient(self, fit: CombinedLawFit, eta2: float, error: float = 0.0) -> tuple[float, float]:
        return implied_drag_coefficient(eta2, fit.modes.model.beam, self.air, eta2_error=error)

    def _law(self, fit: CombinedLawFit, total: tuple[float, float]) -> DataTable:
        errors = list(fit.standard_errors.values())
        table = fit.table()
        columns = (
            Column("", (*(f"ζ of mode {n + 1}, linear" for n in range(len(fit.ratios))), "η2, all modes",
                        "drag coefficient")),
            Column("unit", (*["%"] * len(fit.ratios), "1/m", "1")),
            Column("value", (*(100 * ratio for ratio in fit.ratios), fit.eta2, total[0]),
                   errors=(*(100 * error for error in errors[:-1]), errors[-1], total[1])),
        )  # fmt: skip
        verdict = table.notes[0]
        note = f"{verdict[0].upper()}{verdict[1:]}."
        return self.data_table("Modal plus quadratic damping for all modes", columns, note)

    def _drag(
        self, fit: CombinedLawFit, drag: Sequence[tuple[float, float]], viscous: Sequence[float], given: Beam | None
    ) -> DataTable:
        modes, constants = range(1, len(drag) + 1), fit.drag_constants
        linear = [100 * one.eta1 / (4 * math.pi * one.frequency) for one in fit.measured]
        linear_errors = [100 * math.sqrt(one.covariance[0, 0]) / (4 * math.pi * one.frequency) for one in fit.measured]
        columns = [
            Column("mode", tuple(modes)),
            Column("η2", tuple(one.eta2 for one in fit.measured), "1/m",
                   tuple(math.sqrt(one.covariance[1, 1]) for one in fit.measured)),
            Column("Cd by Eq. (25)", tuple(value for value, _ in drag), "1", tuple(error for _, error in drag)),
            Column("Cd, true shape", tuple(value / c for (value, _), c in zip(drag, constants, strict=True)), "1",
                   tuple(error / c for (_, error), c in zip(drag, constants, strict=True))),
            Column("linear part of ζ", tuple(linear), "%", tuple(linear_errors)),
            Column("of it viscous air", tuple(100 * ratio for ratio in viscous), "%"),
        ]  # fmt: skip
        if given and "eta2" in self.printed:
            unit = implied_drag_coefficient(1.0, given, self.air)[0]
            own = (None if one is None else unit * one for one in self.printed["eta2"])
            columns.append(Column(f"Cd of η2 in the {self.printed_by}", tuple(own), "1"))
        notes = (
            "Cd = 2 ρ h η2 (1183/876)/ρ_air, with the constant of the shape (21), and with that of each mode.",
            f"Air: {self.air.density:g} kg/m³, {self.air.viscosity:.3g} Pa s.  Viscous damping: oscillating flow "
            "around a thin strip at amplitudes below its width (Sader 1998).",
            *(["Printed η2: with the beam of the study before any change."] if self.printed else []),
        )
        return self.data_table("Drag coefficient and viscous damping", columns, *notes, suffix="_drag")

    def _drawings(
        self, fit: CombinedLawFit, modes: Modes, found: Found, rows: Sequence[Mapping[str, Any]]
    ) -> tuple[Any, ...]:
        synthetic = any(row["synthetic"] for row in rows)
        source = "  The decays are synthetic." if synthetic else ""
        laws = {choice.title: law_of(choice.of(found), modes.model, choice.name) for choice in self.laws}
        all_laws = {title: law for title, law in laws.items() if law is not None} | {NAME: fit.law}
        limits = self.amplitudes or tuple(row["amplitude_m"] for row in rows)
        name = self.name
        return (
            drawn(
                f"{name}_eta2", f"η2 of the beam by each mode alone, and one value for all.{source}",
                lambda: _marked(fit.figure(), synthetic),
            ),
            drawn(
                f"{name}_ratios", f"Damping ratio of each mode against its amplitude under each law.{source}",
                lambda: _marked(_ratios(all_laws, modes, limits), synthetic),
            ),
        )  # fmt: skip


def _coefficients(rows: Any, name: str) -> list[ModeCoefficients]:
    """Return eta1 and eta2 of each mode from the numbers of a part with decays.

    Raises
    ------
    InputError
        If the part has no decays under the quadratic law.
    """
    if not isinstance(rows, list) or len(rows) < 2 or not all(row.get("unbounded") for row in rows):
        raise InputError(f'the part {name!r} must have two or more decays with law = "quadratic"', "decays")
    return [
        ModeCoefficients(
            row["frequency_hz"],
            row["unbounded"]["eta1"],
            row["unbounded"]["eta2_per_m"],
            np.array(row["unbounded"]["covariance"]),
        )
        for row in rows
    ]


def _marked(figure: Figure, synthetic: bool) -> Figure:
    """Return a figure, marked if its data are synthetic."""
    if synthetic:
        figure.suptitle("SYNTHETIC DATA", fontsize=9, ha="right", x=0.98)
    return figure


def _ratios(laws: Mapping[str, DampingLaw], modes: Modes, limits: Sequence[float]) -> Figure:
    """Draw the damping ratio of each mode against its amplitude, up to a limit (m) of its own."""
    figure, panels = new_figure(1.0 + 1.5 * len(limits), len(limits))
    for n, (axes, limit) in enumerate(zip(panels, limits, strict=True)):
        amplitudes, top = np.linspace(0.0, limit, 3), 0.0  # of a drawn law, which is straight in the amplitude
        for k, (title, law) in enumerate(laws.items()):
            ratios = 100 * ratio_curves(law, modes, amplitudes)[:, n]
            axes.plot(1e3 * amplitudes, ratios, **line(k), lw=1.6, label=title)
            top = max(top, 1.1 * ratios.max())
        axes.set(ylabel="ζ, %", xlim=(0.0, 1e3 * limit), ylim=(0.0, top))
        axes.set_title(f"mode {n + 1}")
    panels[-1].set(xlabel="amplitude of the tip, mm")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.align_ylabels()
    return figure
