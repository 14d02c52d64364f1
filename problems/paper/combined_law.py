"""Modal plus quadratic damping as one law for all modes at all amplitudes.

The quadratic law has one linear coefficient for all modes, so that it matches a single mode only; modal damping does
not depend on the amplitude.  Their sum has a linear ratio zeta_n per mode and one drag coefficient eta2 for the beam.
Mode n then decays by Eq. (26) with

    eta1_n = 2 omega_n zeta_n,    eta2_n = c_n eta2,

where c_n = 1183/876 int mu |phi_n|^3 dp / phi_n^T M phi_n for a tip displacement of 1 (``QuadraticDamping``): 0.998,
0.874, 0.853, 0.841, 0.834 for a uniform beam.  From N fitted pairs y = (eta1_n, eta2_n) with covariances V_n, the N + 1
unknowns x follow by generalised least squares,

    minimise Q = sum (y_n - A_n x)' V_n^-1 (y_n - A_n x)    subject to    x >= 0,

with the covariance (sum A_n' V_n^-1 A_n)^-1 of the unknowns that are not at a bound.  If one eta2 explains all modes, Q
follows the chi-squared distribution with 2 N less the number of free unknowns as degrees of freedom.  If its
probability is below ``REJECTED``, one eta2 does not explain them; the errors are then multiplied by
(Q/degrees of freedom)^1/2, and a warning says so.  The pairs come from the part with decays under the quadratic law,
separate records whose noise is independent.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 4.2 and 4.3.
A. C. Aitken, On least squares and linear combination of observations, Proceedings of the Royal Society of Edinburgh 55
(1935), 42-48.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # its packages are imported on first use
from scipy.linalg import solve_triangular
from scipy.special import chdtrc

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, Figure
from ancf_casadi.support.tables import Cell, Table, known
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.paper.air import Air, implied_drag_coefficient, viscous_damping_ratios
from problems.spec.beam import law_of
from problems.study.drawing import Drawing, drawn, line, new_figure
from problems.study.part import Finding, Found

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

NAME = "modal + quadratic"
REJECTED = 0.01  # probability of Q below which one eta2 does not explain all modes


@dataclass(frozen=True, eq=False)
class ModeCoefficients:
    """Linear and quadratic coefficient of one mode in Eq. (26), estimated without bounds."""

    frequency: float  # natural frequency, Hz
    eta1: float  # 1/s
    eta2: float  # 1/m
    covariance: Array  # of eta1 and eta2, (2, 2)

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of eta1 and eta2."""
        return math.sqrt(self.covariance[0, 0]), math.sqrt(self.covariance[1, 1])


@dataclass(frozen=True, eq=False)
class CombinedLawFit:
    """Modal and quadratic damping fitted to the coefficients of several modes."""

    modes: Modes
    measured: tuple[ModeCoefficients, ...]  # of each mode, starting with the first
    drag_constants: Array  # c_n, (N,)
    ratios: tuple[float, ...]  # linear damping ratio of each mode
    eta2: float  # of the beam, 1/m
    errors: tuple[float, ...]  # standard errors of the ratios and of eta2, (N + 1,); nan at the bound 0
    chi_squared: float  # Q
    degrees_of_freedom: int

    @property
    def law(self) -> DampingLaw:
        """The law, modal plus quadratic."""
        frequencies = [one.frequency for one in self.measured]
        return ModalDamping(self.modes, self.ratios, frequencies=frequencies) + QuadraticDamping(eta2=self.eta2)

    @property
    def probability(self) -> float:
        """Probability of a Q as large or larger if one eta2 explains all modes."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_squared))

    @property
    def explains_all_modes(self) -> bool:
        """True if one eta2 explains the coefficients of all modes."""
        return self.probability >= REJECTED

    @property
    def verdict(self) -> str:
        """Sentence that says whether one eta2 explains all modes."""
        return (
            f"One eta2 {'explains' if self.explains_all_modes else 'does not explain'} all modes: chi-squared "
            f"{self.chi_squared:.3g}, {self.degrees_of_freedom} degrees of freedom, p = {self.probability:.2g}."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unknowns at a bound, and a drag coefficient that differs from mode to mode."""
        names = (*(f"ratio{n + 1}" for n in range(len(self.ratios))), "eta2")
        notes = [
            f"{name} is at its bound 0; the other standard errors take it as known"
            for name, error in zip(names, self.errors, strict=True)
            if math.isnan(error)
        ]
        if not self.explains_all_modes:
            implied = ", ".join(f"{value:.3g} +- {error:.2g}" for value, error in zip(*self._implied(), strict=True))
            notes.append(
                f"one eta2 does not explain all modes (chi-squared {self.chi_squared:.3g} with "
                f"{self.degrees_of_freedom} degrees of freedom): the modes alone give {implied} 1/m; "
                "the standard errors are enlarged accordingly"
            )
        return tuple(notes)

    def figure(self) -> Figure:
        """Draw eta2 of each mode alone with 95 % intervals, and the common value with its interval as a band."""
        (figure, (axes,)), (own, errors) = new_figure(3.2), self._implied()
        numbers, half = np.arange(1, len(own) + 1), 1.96 * np.nan_to_num(self.errors[-1])
        axes.axhspan(self.eta2 - half, self.eta2 + half, color=COMPUTED, alpha=0.25, lw=0)
        axes.axhline(self.eta2, color=COMPUTED, lw=1.2, label="one value for all modes, 95 % band")
        axes.errorbar(numbers, own, 1.96 * errors, fmt="o", ms=4, lw=1, color=MEASURED, label="each mode alone, 95 %")
        axes.set(xlabel="mode", ylabel="η2 of the beam, 1/m", xticks=numbers)
        axes.legend()
        return figure

    def _implied(self) -> tuple[Array, Array]:
        """Return eta2 of the beam by each mode alone and its standard error, (N,), 1/m."""
        own = np.array([(one.eta2, one.errors[1]) for one in self.measured]).T / self.drag_constants
        return own[0], own[1]


def fit_combined_law(measured: Sequence[ModeCoefficients], modes: Modes) -> CombinedLawFit:
    """Fit modal plus quadratic damping to the coefficients of two or more modes, starting with the first."""
    count, constants = len(measured), drag_constants(modes)[: len(measured)]
    rows, values = np.zeros((2 * count, count + 1)), np.zeros(2 * count)
    for n, one in enumerate(measured):
        own, root = slice(2 * n, 2 * n + 2), np.linalg.cholesky(one.covariance)
        design = np.zeros((2, count + 1))
        design[0, n], design[1, -1] = 4 * math.pi * one.frequency, constants[n]
        rows[own] = solve_triangular(root, design, lower=True)
        values[own] = solve_triangular(root, [one.eta1, one.eta2], lower=True)
    size = np.linalg.norm(rows, axis=0)
    found, distance = scipy.optimize.nnls(rows / size, values)
    free, errors = found > 0.0, np.full(count + 1, math.nan)
    surplus, Q = 2 * count - int(np.count_nonzero(free)), float(distance) ** 2
    enlarged = 1.0 if chdtrc(surplus, Q) >= REJECTED else math.sqrt(Q / surplus)
    errors[free] = enlarged * np.linalg.norm(np.linalg.pinv(rows[:, free] / size[free]), axis=1) / size[free]
    *ratios, eta2 = (found / size).tolist()
    return CombinedLawFit(modes, tuple(measured), constants, tuple(ratios), eta2, tuple(errors.tolist()), Q, surplus)


def drag_constants(modes: Modes) -> Array:
    """Return the constant c_n of each mode, (m,): its quadratic coefficient relative to that of the beam."""
    return QuadraticDamping(eta2=1.0).damping_ratios(modes, np.ones(modes.count)) * 3 * math.pi / 4


def ratio_curves(law: DampingLaw | None, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
    """Return the equivalent damping ratio of each mode at each tip amplitude (m) under a law, (amplitudes, modes)."""
    if law is None:
        return np.zeros((len(amplitudes), modes.count))
    return np.array([law.damping_ratios(modes, np.full(modes.count, amplitude)) for amplitude in amplitudes])


def finding(part: PaperPart, results: Sequence[Any], found: Found) -> Finding:
    """Return the law, the drag coefficients, and the damping ratio against amplitude."""
    measured = []
    for row in found[part.decays].data:
        own = row["unbounded"]
        measured.append(
            ModeCoefficients(row["frequency_hz"], own["eta1"], own["eta2_per_m"], np.array(own["covariance"]))
        )
    air = Air(**part.inputs["air"])
    modes = natural_modes(Model(part.beam_in(found)), count=len(measured))
    fit, beam = fit_combined_law(measured, modes), modes.model.beam
    drag = [implied_drag_coefficient(one.eta2, beam, air, eta2_error=one.errors[1]) for one in measured]
    viscous = viscous_damping_ratios(modes, air).tolist()
    total = implied_drag_coefficient(fit.eta2, beam, air, eta2_error=float(np.nan_to_num(fit.errors[-1])))
    *ratio_errors, eta2_error = (known(error) for error in fit.errors)
    of_modes = zip(drag, fit.drag_constants.tolist(), viscous, strict=True)
    data: dict[str, Any] = {
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
                "mode": n,
                "drag_coefficient": value / c,
                "drag_coefficient_stderr": error / c,
                "drag_coefficient_by_eq_25": value,
                "viscous_damping_ratio": ratio,
            }
            for n, ((value, error), c, ratio) in enumerate(of_modes, start=1)
        ],
    }
    terms = (
        {"law": "modal", "ratios": list(fit.ratios), "frequencies": [one.frequency for one in measured]},
        {"law": "quadratic", "eta2": fit.eta2},
    )
    rows = [(f"ζ of mode {n}, linear", "%", 100 * ratio) for n, ratio in enumerate(fit.ratios, start=1)]
    rows += [("η2, all modes", "1/m", fit.eta2), ("drag coefficient", "1", total[0])]
    errors = {"value": [*(100 * error for error in fit.errors[:-1]), fit.errors[-1], total[1]]}
    title = "Modal plus quadratic damping for all modes"
    law = part.table(title, ("", "unit", "value"), rows, fit.verdict, errors=errors)
    tables = (law, _drag(part, fit, air, data["drag"], drag, found))
    return Finding(data, tables, _drawings(part, fit, modes, found), fit.warnings, terms=terms)


def _drag(
    part: PaperPart,
    fit: CombinedLawFit,
    air: Air,
    rows: Sequence[Mapping[str, Any]],
    drag: Sequence[tuple[float, float]],
    found: Found,
) -> Table:
    """Return the table of drag coefficients: ``rows`` as in ``results.json``, ``drag`` by Eq. (25) with its errors."""
    standard = found[""].beam
    assert standard is not None
    unit = implied_drag_coefficient(1.0, standard.beam(), air)[0]
    rates = [4 * math.pi * one.frequency for one in fit.measured]  # 1/s, of eta1 per damping ratio
    columns: dict[str, Sequence[Cell]] = {
        "mode": [row["mode"] for row in rows],
        "η2, 1/m": [one.eta2 for one in fit.measured],
        "Cd by Eq. (25), 1": [value for value, _ in drag],
        "Cd, true shape, 1": [row["drag_coefficient"] for row in rows],
        "linear part of ζ, %": [100 * one.eta1 / rate for rate, one in zip(rates, fit.measured, strict=True)],
        "of it viscous air, %": [100 * row["viscous_damping_ratio"] for row in rows],
        f"Cd of η2 in the {part.printed_by}, 1": [unit * one for one in part.inputs["printed_eta2"]],
    }
    errors = {
        "η2, 1/m": [one.errors[1] for one in fit.measured],
        "Cd by Eq. (25), 1": [error for _, error in drag],
        "Cd, true shape, 1": [row["drag_coefficient_stderr"] for row in rows],
        "linear part of ζ, %": [100 * one.errors[0] / rate for rate, one in zip(rates, fit.measured, strict=True)],
    }
    notes = (
        "Cd = 2 ρ h η2 (1183/876)/ρ_air, with the constant of the shape (21), and with that of each mode.",
        f"Air: {air.density:g} kg/m³, {air.viscosity:.3g} Pa s.  Viscous damping: oscillating flow "
        "around a thin strip at amplitudes below its width (Sader 1998).",
        "Printed η2: with the beam of the study before any change.",
    )
    cells = zip(*columns.values(), strict=True)
    return part.table("Drag coefficient and viscous damping", [*columns], cells, *notes, errors=errors)


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
    figure, panels = new_figure(1.0 + 1.3 * len(limits), len(limits))
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
