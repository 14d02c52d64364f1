"""Beyond the paper: modal plus quadratic damping as one law for all modes at all amplitudes.

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
(Q/degrees of freedom)^1/2, and a warning says so.  The pairs come from the decays of Table 4, separate records whose
noise is independent.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 4.2 and 4.3.
A. C. Aitken, On least squares and linear combination of observations, Proceedings of the Royal Society of Edinburgh 55
(1935), 42-48.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its packages are imported on first use
from scipy.special import chdtrc

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import BAND, COMPUTED, CURVE, MEASURED, POINTS, Figure
from ancf_casadi.support.tables import Table, finite_or_none
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.paper import table_04
from problems.paper.air import Air, implied_drag_coefficient, viscous_damping_ratios
from problems.paper.inputs import AMPLITUDES, ETA2, STANDARD_BEAM, matched_beam, three_laws
from problems.paper.step import paper_step
from problems.spec.beam import make_law
from problems.study.compute import Compute
from problems.study.drawing import line, mark_synthetic, new_figure
from problems.study.step import Finding, LawChoice, study_table

REJECTED = 0.01  # probability of Q below which one eta2 does not explain all modes
AIR = Air(density=1.2, viscosity=1.81e-5)


@paper_step(
    section="Beyond the paper",
    title="Modal plus quadratic damping as one law for all modes",
    text="""
A linear ratio for each mode and one drag coefficient for the beam make one law for all modes at all amplitudes. The \
decays of Table 4 are fitted by generalised least squares, and chi-squared tests whether one drag coefficient explains \
all of them. The viscosity of the air explains a small part of the linear damping.""",
    notes=(
        "Where one drag coefficient does not explain all modes, the standard errors are enlarged by the root of "
        "chi-squared per degree of freedom.",
        "The viscous part of mode 1 is 0.09 of 1.00 % for a thin strip; with the flow around a circular cylinder as "
        "wide as the strip it would be 0.10 %.",
    ),
)
def combined_law(compute: Compute) -> Finding:
    """Return the law, the drag coefficients, and the damping ratio against amplitude."""
    fit, modes = fit_to_decays(compute)
    total = implied_drag_coefficient(fit.eta2, modes.model.beam, AIR, eta2_error=np.nan_to_num(fit.errors[-1]))
    drag, drag_table = _drag(fit, modes)
    data = {"law": _law_numbers(fit, *total), "drag": drag}
    curves = []  # of each mode: amplitudes, and the ratios under each law, which are straight in the amplitude
    for n, largest in enumerate(AMPLITUDES):
        amplitudes = np.linspace(0.0, largest, 3)
        laws = (*three_laws(), fit.choice)
        curves.append((amplitudes, {law.title: ratio_curves(law, modes, amplitudes)[:, n] for law in laws}))
    synthetic = "  The decays are synthetic."
    figures = compute.drawings(
        (f"η2 of the beam by each mode alone, and one value for all.{synthetic}", _eta2_figure, fit),
        (f"Damping ratio of each mode against its amplitude under each law.{synthetic}", _ratio_figure, curves),
    )
    rows = [(f"ζ of mode {n}, linear", "%", 100 * ratio) for n, ratio in enumerate(fit.ratios, start=1)]
    rows += [("η2, all modes", "1/m", fit.eta2), ("drag coefficient", "1", total[0])]
    errors = {"value": [*100 * fit.errors[:-1], fit.errors[-1], total[1]]}
    title = "Modal plus quadratic damping for all modes"
    law_table = study_table(title, ("", "unit", "value"), rows, fit.verdict, errors=errors)
    return Finding(data, (law_table, drag_table), figures, fit.warnings)


def fit_to_decays(compute: Compute) -> tuple[CombinedLawFit, Modes]:
    """Return the law fitted to the decays of Table 4, and the modes of the matched beam."""
    decays = [decay.data for decay in table_04.decay_fits(compute)]
    pairs = [numbers["unbounded"] for numbers in decays]  # estimates without bounds
    modes = natural_modes(Model(matched_beam(compute)), count=len(pairs))
    fit = fit_combined_law(
        np.array([numbers["frequency_hz"] for numbers in decays]),
        np.array([(pair["eta1"], pair["eta2_per_m"]) for pair in pairs]),
        np.array([pair["covariance"] for pair in pairs]),
        modes,
    )
    return fit, modes


@dataclass(frozen=True, eq=False)
class CombinedLawFit:
    """Modal and quadratic damping fitted to the coefficients of several modes."""

    frequencies: Array  # natural frequency of each mode, starting with the first, (N,), Hz
    coefficients: Array  # eta1, 1/s, and eta2, 1/m, of each mode, (N, 2)
    coefficient_errors: Array  # their standard errors, (N, 2)
    drag_constants: Array  # c_n, (N,)
    ratios: tuple[float, ...]  # linear damping ratio of each mode
    eta2: float  # of the beam, 1/m
    errors: Array  # standard errors of the ratios and of eta2, (N + 1,); nan at the bound 0
    chi_squared: float  # Q
    degrees_of_freedom: int

    @property
    def choice(self) -> LawChoice:
        """The law, modal plus quadratic, for simulations."""
        modal = {"law": "modal", "ratios": list(self.ratios), "frequencies": self.frequencies.tolist()}
        return LawChoice("combined", (modal, {"law": "quadratic", "eta2": self.eta2}), "modal + quadratic")

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
            implied = ", ".join(
                f"{value:.3g} +- {error:.2g}" for value, error in zip(*self.eta2_by_mode(), strict=True)
            )
            notes.append(
                f"one eta2 does not explain all modes (chi-squared {self.chi_squared:.3g} with "
                f"{self.degrees_of_freedom} degrees of freedom): the modes alone give {implied} 1/m; "
                "the standard errors are enlarged accordingly"
            )
        return tuple(notes)

    def eta2_by_mode(self) -> tuple[Array, Array]:
        """Return eta2 of the beam by each mode alone and its standard error, (N,), 1/m."""
        return self.coefficients[:, 1] / self.drag_constants, self.coefficient_errors[:, 1] / self.drag_constants


def fit_combined_law(frequencies: Array, coefficients: Array, covariances: Array, modes: Modes) -> CombinedLawFit:
    """Fit modal plus quadratic damping to two or more modes, starting with the first.

    They have natural frequencies (N,), Hz, pairs of eta1, 1/s, and eta2, 1/m, (N, 2), and covariances of these
    (N, 2, 2).
    """
    count = len(frequencies)
    constants = drag_constants(modes)[:count]
    rows, values = np.zeros((2 * count, count + 1)), np.zeros(2 * count)
    for n, whitening in enumerate(np.linalg.inv(np.linalg.cholesky(covariances))):
        pair = slice(2 * n, 2 * n + 2)
        rows[pair, [n, -1]] = whitening * [4 * math.pi * frequencies[n], constants[n]]
        values[pair] = whitening @ coefficients[n]
    size = np.linalg.norm(rows, axis=0)
    scaled, distance = scipy.optimize.nnls(rows / size, values)
    free, errors = scaled > 0.0, np.full(count + 1, math.nan)
    surplus, Q = 2 * count - int(np.count_nonzero(free)), float(distance) ** 2
    enlarged = 1.0 if chdtrc(surplus, Q) >= REJECTED else math.sqrt(Q / surplus)
    errors[free] = enlarged * np.linalg.norm(np.linalg.pinv(rows[:, free] / size[free]), axis=1) / size[free]
    *ratios, eta2 = (scaled / size).tolist()
    coefficient_errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    measured = frequencies, coefficients, coefficient_errors, constants
    return CombinedLawFit(*measured, tuple(ratios), eta2, errors, Q, surplus)


def drag_constants(modes: Modes) -> Array:
    """Return the constant c_n of each mode, (m,): its quadratic coefficient relative to that of the beam."""
    return QuadraticDamping(eta2=1.0).damping_ratios(modes, np.ones(modes.count)) * 3 * math.pi / 4


def ratio_curves(choice: LawChoice, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
    """Return the equivalent damping ratio of each mode at each tip amplitude (m) under a law, (amplitudes, modes)."""
    law = make_law(choice.terms, modes.model, choice.name) or SumOfLaws(())
    return np.array([law.damping_ratios(modes, np.full(modes.count, amplitude)) for amplitude in amplitudes])


def _law_numbers(fit: CombinedLawFit, drag: float, drag_error: float) -> dict[str, Any]:
    *ratio_errors, eta2_error = map(finite_or_none, fit.errors.tolist())
    return {
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
        "drag_coefficient": float(drag),
        "drag_coefficient_stderr": float(drag_error),
    }


def _drag(fit: CombinedLawFit, modes: Modes) -> tuple[list[dict[str, Any]], Table]:
    """Return drag coefficient and viscous damping of each mode, for ``results.json`` and as a table."""
    (eta1, eta2), (eta1_errors, eta2_errors) = fit.coefficients.T, fit.coefficient_errors.T
    drag, drag_errors = implied_drag_coefficient(eta2, modes.model.beam, AIR, eta2_error=eta2_errors)
    numbers = {
        "mode": np.arange(1, len(eta2) + 1),
        "drag_coefficient": drag / fit.drag_constants,
        "drag_coefficient_stderr": drag_errors / fit.drag_constants,
        "drag_coefficient_by_eq_25": drag,
        "viscous_damping_ratio": viscous_damping_ratios(modes, AIR),
    }
    percent = 100 / (4 * math.pi * fit.frequencies)  # of the damping ratio per eta1
    columns = {
        "mode": numbers["mode"],
        "η2, 1/m": eta2,
        "Cd by Eq. (25), 1": drag,
        "Cd, true shape, 1": numbers["drag_coefficient"],
        "linear part of ζ, %": percent * eta1,
        "of it viscous air, %": 100 * numbers["viscous_damping_ratio"],
        "Cd of η2 in the paper, 1": implied_drag_coefficient(np.array(ETA2), STANDARD_BEAM, AIR)[0],
    }
    errors = {
        "η2, 1/m": eta2_errors.tolist(),
        "Cd by Eq. (25), 1": drag_errors.tolist(),
        "Cd, true shape, 1": numbers["drag_coefficient_stderr"].tolist(),
        "linear part of ζ, %": (percent * eta1_errors).tolist(),
    }
    notes = (
        "Cd = 2 ρ h η2 (1183/876)/ρ_air, with the constant of the shape (21), and with that of each mode.",
        f"Air: {AIR.density:g} kg/m³, {AIR.viscosity:.3g} Pa s.  Viscous damping: oscillating flow "
        "around a thin strip at amplitudes below its width (Sader 1998).",
        "Printed η2: with the beam of the study before any change.",
    )
    data = [dict(zip(numbers, row, strict=True)) for row in _rows(numbers)]
    return data, study_table("Drag coefficient and viscous damping", [*columns], _rows(columns), *notes, errors=errors)


def _rows(columns: Mapping[str, Array]) -> Iterator[tuple[Any, ...]]:
    return zip(*(column.tolist() for column in columns.values()), strict=True)


def _eta2_figure(fit: CombinedLawFit) -> Figure:
    """Draw eta2 of each mode alone with 95 % intervals, and the common value with its interval as a band."""
    (figure, (axes,)), (eta2, errors) = new_figure(3.2), fit.eta2_by_mode()
    numbers, half = np.arange(1, len(eta2) + 1), 1.96 * np.nan_to_num(fit.errors[-1])
    axes.axhspan(fit.eta2 - half, fit.eta2 + half, color=COMPUTED, **BAND)
    axes.axhline(fit.eta2, **CURVE, label="one value for all modes, 95 % band")
    axes.errorbar(numbers, eta2, 1.96 * errors, **POINTS, color=MEASURED, label="each mode alone, 95 %")
    axes.set(xlabel="mode", ylabel="η2 of the beam, 1/m", xticks=numbers)
    axes.legend()
    return mark_synthetic(figure)


def _ratio_figure(curves: Sequence[tuple[Array, Mapping[str, Array]]]) -> Figure:
    """Draw the damping ratio of each mode under each law, by its title, against the amplitude (m)."""
    figure, panels = new_figure(1.0 + 1.3 * len(curves), len(curves))
    for n, (axes, (amplitudes, ratios)) in enumerate(zip(panels, curves, strict=True), start=1):
        for k, (title, ratio) in enumerate(ratios.items()):
            axes.plot(1e3 * amplitudes, 100 * ratio, **line(k), lw=1.6, label=title)
        top = 1.1 * max((100 * ratio).max() for ratio in ratios.values())
        axes.set(ylabel="ζ, %", xlim=(0.0, 1e3 * amplitudes[-1]), ylim=(0.0, top))
        axes.set_title(f"mode {n}")
    panels[-1].set(xlabel="amplitude of the tip, mm")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.align_ylabels()
    return mark_synthetic(figure)
