"""Modal plus quadratic damping as one law for all modes, and the air drag behind it.

eta1 and eta2 of each mode come from the part with decays under the quadratic law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.tables import known
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.paper.air import Air, implied_drag_coefficient, viscous_damping_ratios
from problems.paper.coefficients import CombinedLawFit, ModeCoefficients, fit_combined_law, ratio_curves
from problems.schema.beam import law_of
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, drawn, line, new_figure
from problems.study.part import Effort, Finding, Found

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.paper.reproduce import PaperPart

NAME = "modal + quadratic"


def finding(part: PaperPart, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
    """Return the law, the drag coefficients, and the damping ratio against amplitude."""
    rows = found[part.decays].data
    measured = [
        ModeCoefficients(
            row["frequency_hz"],
            row["unbounded"]["eta1"],
            row["unbounded"]["eta2_per_m"],
            np.array(row["unbounded"]["covariance"]),
        )
        for row in rows
    ]
    air = Air(**part.inputs["air"])
    modes = natural_modes(Model(part.beam_in(found)), count=len(measured))
    fit = fit_combined_law(measured, modes)
    beam, given = modes.model.beam, found[""].beam
    assert given is not None
    drag = [
        implied_drag_coefficient(one.eta2, beam, air, eta2_error=math.sqrt(one.covariance[1, 1])) for one in measured
    ]
    viscous = viscous_damping_ratios(modes, air)
    total = implied_drag_coefficient(fit.eta2, beam, air, eta2_error=float(np.nan_to_num(fit.errors[-1])))
    *ratio_errors, eta2_error = (known(error) for error in fit.errors)
    data = {
        "law": {
            "linear_damping_ratios": list(fit.ratios),
            "linear_damping_ratio_stderr": ratio_errors,
            "eta2_per_m": fit.eta2,
            "eta2_stderr_per_m": eta2_error,
            "drag_constants": fit.drag_constants.tolist(),
            "chi_squared": fit.chi_squared,
            "degrees_of_freedom": fit.degrees_of_freedom,
            "probability": fit.probability,
            "explains_all_modes": fit.explains_all_modes,
            "warnings": list(fit.warnings),
            "drag_coefficient": total[0],
            "drag_coefficient_stderr": total[1],
        },
        "drag": [
            {
                "mode": n + 1,
                "drag_coefficient": value / c,
                "drag_coefficient_stderr": error / c,
                "drag_coefficient_by_eq_25": value,
                "viscous_damping_ratio": float(viscous[n]),
            }
            for n, ((value, error), c) in enumerate(zip(drag, fit.drag_constants.tolist(), strict=True))
        ],
    }
    frequencies = [one.frequency for one in measured]
    terms = (
        {"law": "modal", "ratios": list(fit.ratios), "frequencies": frequencies},
        {"law": "quadratic", "eta2": fit.eta2},
    )
    tables = (_law(part, fit, total), _drag(part, fit, air, drag, viscous.tolist(), given))
    return Finding(data, tables, _drawings(part, fit, modes, found), fit.warnings, terms=terms)


def _law(part: PaperPart, fit: CombinedLawFit, total: tuple[float, float]) -> DataTable:
    columns = (
        Column("", (*(f"ζ of mode {n + 1}, linear" for n in range(len(fit.ratios))), "η2, all modes",
                    "drag coefficient")),
        Column("unit", (*["%"] * len(fit.ratios), "1/m", "1")),
        Column("value", (*(100 * ratio for ratio in fit.ratios), fit.eta2, total[0]),
               errors=(*(100 * error for error in fit.errors[:-1]), fit.errors[-1], total[1])),
    )  # fmt: skip
    return part.data_table("Modal plus quadratic damping for all modes", columns, fit.verdict)


def _drag(
    part: PaperPart,
    fit: CombinedLawFit,
    air: Air,
    drag: Sequence[tuple[float, float]],
    viscous: Sequence[float],
    given: Beam,
) -> DataTable:
    modes, constants = range(1, len(drag) + 1), fit.drag_constants.tolist()
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
    unit = implied_drag_coefficient(1.0, given, air)[0]
    printed = tuple(unit * one for one in part.inputs["printed_eta2"])
    columns.append(Column(f"Cd of η2 in the {part.printed_by}", printed, "1"))
    notes = (
        "Cd = 2 ρ h η2 (1183/876)/ρ_air, with the constant of the shape (21), and with that of each mode.",
        f"Air: {air.density:g} kg/m³, {air.viscosity:.3g} Pa s.  Viscous damping: oscillating flow "
        "around a thin strip at amplitudes below its width (Sader 1998).",
        "Printed η2: with the beam of the study before any change.",
    )
    return part.data_table("Drag coefficient and viscous damping", columns, *notes)


def _drawings(part: PaperPart, fit: CombinedLawFit, modes: Modes, found: Found) -> tuple[Drawing, ...]:
    laws = {choice.title: law_of(choice.of(found), modes.model, choice.name) for choice in part.laws}
    all_laws = {title: law for title, law in laws.items() if law is not None} | {NAME: fit.law}
    of_modes = "η2 of the beam by each mode alone, and one value for all."
    ratios = "Damping ratio of each mode against its amplitude under each law."
    draw_ratios = partial(_ratios, all_laws, modes, part.inputs["amplitudes"])
    return tuple(
        drawn(f"{caption}  The decays are synthetic.", partial(_marked, draw))
        for caption, draw in ((of_modes, fit.figure), (ratios, draw_ratios))
    )


def _marked(draw: Callable[[], Figure]) -> Figure:
    """Return a figure of synthetic data, marked as such."""
    figure = draw()
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
