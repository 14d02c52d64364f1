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
(Q/degrees of freedom)^1/2, and a warning says so.

The pairs come from separate records, whose noise is independent.  A fit whose eta2 is at its bound 0 would understate
the errors; one Gauss-Newton step without bounds gives its pair, eta2 of which may be negative.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 4.2 and 4.3.
A. C. Aitken, On least squares and linear combination of observations, Proceedings of the Royal Society of Edinburgh 55
(1935), 42-48.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # its packages are imported on first use
from scipy.linalg import solve_triangular
from scipy.special import chdtrc

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping
from ancf_casadi.estimation.agreement import part_estimates
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import literal_text
from ancf_casadi.support.inputs import array, check_instance, instances, physical
from ancf_casadi.support.tables import Table, known
from ancf_casadi.vibration.modes import Modes
from problems.decay.result import DecayFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REJECTED = 0.01  # probability of Q below which one eta2 does not explain all modes


@dataclass(frozen=True, eq=False)
class ModeCoefficients:
    """Linear and quadratic coefficient of one mode.

    Parameters
    ----------
    frequency : float
        Natural frequency, Hz.
    eta1, eta2 : float
        Coefficients of Eq. (26), 1/s and 1/m; as estimates they may be negative.
    covariance : ndarray
        Their covariance (2, 2).

    Raises
    ------
    InputError
        If the frequency is not positive, or the covariance is not positive definite.
    """

    frequency: float
    eta1: float
    eta2: float
    covariance: Array

    def __post_init__(self) -> None:
        """Validate."""
        physical(self.frequency, "frequency")
        covariance = array(self.covariance, "covariance")
        if covariance.shape != (2, 2) or not (np.linalg.eigvalsh(covariance) > 0.0).all():
            raise InputError("must be a positive definite matrix of 2 rows", "covariance")
        object.__setattr__(self, "covariance", covariance)

    @classmethod
    def from_fit(cls, fit: DecayFit) -> ModeCoefficients:
        """Return the coefficients of a decay fit, without the bounds of the fit.

        Raises
        ------
        InputError
            If the fit has another law than the quadratic one.
        """
        check_instance(fit, "fit", DecayFit)
        if fit.law != "quadratic":
            raise InputError(f"has the law {fit.law}; fit the decays with law='quadratic'", "fit")
        all_free = replace(fit.fit, active_bounds=np.zeros(len(fit.fit.names), dtype=bool))
        values, covariance = part_estimates(all_free, np.ones(len(fit.fit.residuals), dtype=bool))
        pair = list(fit.indices[1:3])  # after the frequency
        eta1, eta2 = values[pair].tolist()
        return cls(fit.frequency, eta1, eta2, covariance[np.ix_(pair, pair)])


@dataclass(frozen=True, eq=False)
class CombinedLawFit:
    """Modal and quadratic damping fitted to the coefficients of several modes.

    Parameters
    ----------
    modes : Modes
        Modes of the beam.
    measured : tuple of ModeCoefficients
        Coefficients of each mode, starting with the first.
    drag_constants : tuple of float
        Constant c_n of each mode.
    ratios : tuple of float
        Linear damping ratio of each mode.
    eta2 : float
        Quadratic coefficient of the beam, 1/m.
    covariance : ndarray
        Covariance (N + 1, N + 1) of ratios and eta2; nan for those at the bound 0.
    chi_squared, probability : float
        Q, and the probability of a Q as large or larger if one eta2 explains all modes.
    degrees_of_freedom : int
        Number of coefficients less the number of free unknowns.
    """

    modes: Modes
    measured: tuple[ModeCoefficients, ...]
    drag_constants: tuple[float, ...]
    ratios: tuple[float, ...]
    eta2: float
    covariance: Array
    chi_squared: float
    probability: float
    degrees_of_freedom: int

    @cached_property
    def law(self) -> DampingLaw:
        """The law, modal plus quadratic."""
        frequencies = [one.frequency for one in self.measured]
        return ModalDamping(self.modes, self.ratios, frequencies=frequencies) + QuadraticDamping(eta2=self.eta2)

    @property
    def explains_all_modes(self) -> bool:
        """True if one eta2 explains the coefficients of all modes."""
        return self.probability >= REJECTED

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Standard errors of ``ratio1``, ``ratio2`` and so on, and of ``eta2`` (1/m); nan at a bound."""
        return dict(zip(self._names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unknowns at a bound, and a drag coefficient that differs from mode to mode."""
        notes = [
            f"{name} is at its bound 0; the other standard errors take it as known"
            for name, error in self.standard_errors.items()
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

    def table(self) -> Table:
        """Return the ratios and the drag coefficient of each mode beside the common one."""
        errors, (own, own_errors) = list(self.standard_errors.values()), self._implied()
        rows: list[Sequence[str | float | None]] = [
            (f"mode {n + 1}", 100 * zeta, known(100 * errors[n]), float(own[n]), float(own_errors[n]))
            for n, zeta in enumerate(self.ratios)
        ]
        rows.append(("all", None, None, self.eta2, known(errors[-1])))
        verdict = "explains all modes" if self.explains_all_modes else "does not explain all modes"
        notes = (
            f"one eta2 {verdict}: chi-squared {self.chi_squared:.3g}, {self.degrees_of_freedom} degrees of freedom, "
            f"p = {self.probability:.2g}",
        )
        columns = ("", "linear_ratio_percent", "stderr_percent", "eta2_per_m", "stderr_per_m")
        return Table("combined_law", "Modal plus quadratic damping for all modes", columns, rows, notes)

    def report(self) -> str:
        """Return the result as text."""
        return "\n".join([self.table().text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        errors = [known(error) for error in self.standard_errors.values()]
        return {
            "linear_damping_ratios": list(self.ratios),
            "linear_damping_ratio_stderr": errors[:-1],
            "eta2_per_m": self.eta2,
            "eta2_stderr_per_m": errors[-1],
            "drag_constants": list(self.drag_constants),
            "chi_squared": self.chi_squared,
            "degrees_of_freedom": self.degrees_of_freedom,
            "probability": self.probability,
            "explains_all_modes": self.explains_all_modes,
            "warnings": list(self.warnings),
        }

    @literal_text
    def figure(self) -> Figure:
        """Draw eta2 of each mode alone with 95 % intervals, and the common value with its interval as a band."""
        from matplotlib.figure import Figure  # slow to import

        from ancf_casadi.support.figures import COMPUTED, MEASURED

        figure = Figure(figsize=(5.2, 3.2), layout="constrained")
        axes, (own, errors) = figure.subplots(), self._implied()
        numbers = np.arange(1, len(own) + 1)
        half = 1.96 * np.nan_to_num(self.standard_errors["eta2"])
        axes.axhspan(self.eta2 - half, self.eta2 + half, color=COMPUTED, alpha=0.25, lw=0)
        axes.axhline(self.eta2, color=COMPUTED, lw=1.2, label="one value for all modes, 95 % band")
        axes.errorbar(numbers, own, 1.96 * errors, fmt="o", ms=4, lw=1, color=MEASURED, label="each mode alone, 95 %")
        axes.set(xlabel="mode", ylabel="η2 of the beam, 1/m", xticks=numbers)
        axes.legend(frameon=False, fontsize="small")
        return figure

    @property
    def _names(self) -> list[str]:
        return [*(f"ratio{n + 1}" for n in range(len(self.ratios))), "eta2"]

    def _implied(self) -> tuple[Array, Array]:
        """Return eta2 of the beam by each mode alone and its standard error, (N,), 1/m."""
        constants = np.array(self.drag_constants)
        own = np.array([one.eta2 for one in self.measured])
        errors = np.sqrt([one.covariance[1, 1] for one in self.measured])
        return own / constants, errors / constants


def fit_combined_law(measured: Sequence[ModeCoefficients], modes: Modes) -> CombinedLawFit:
    """Fit modal plus quadratic damping to the coefficients of two or more modes.

    Parameters
    ----------
    measured : sequence of ModeCoefficients
        Coefficients of each mode, starting with the first.
    modes : Modes
        Modes of the beam, at least as many.

    Raises
    ------
    InputError
        If there are fewer than two modes, or more coefficients than modes.
    """
    check_instance(modes, "modes", Modes)
    measured = instances(measured, "measured", ModeCoefficients)
    count = len(measured)
    if not 2 <= count <= modes.count:
        raise InputError(f"has {count} modes; needs two or more, and no more than the {modes.count} given", "measured")
    constants = drag_constants(modes)[:count]
    rows, values = np.zeros((2 * count, count + 1)), np.zeros(2 * count)
    for n, one in enumerate(measured):
        own = slice(2 * n, 2 * n + 2)
        root = np.linalg.cholesky(one.covariance)
        design = np.zeros((2, count + 1))
        design[0, n], design[1, -1] = 4 * math.pi * one.frequency, constants[n]
        rows[own] = solve_triangular(root, design, lower=True)
        values[own] = solve_triangular(root, [one.eta1, one.eta2], lower=True)
    size = np.linalg.norm(rows, axis=0)
    found, distance = scipy.optimize.nnls(rows / size, values)
    free = found > 0.0
    surplus, Q = 2 * count - int(np.count_nonzero(free)), float(distance) ** 2
    probability = float(chdtrc(surplus, Q))
    covariance = np.full((count + 1, count + 1), math.nan)
    inverse = np.linalg.pinv(rows[:, free] / size[free])
    enlarged = 1.0 if probability >= REJECTED else Q / surplus
    covariance[np.ix_(free, free)] = enlarged * (inverse @ inverse.T) / np.outer(size[free], size[free])
    *ratios, eta2 = (found / size).tolist()
    return CombinedLawFit(
        modes=modes,
        measured=measured,
        drag_constants=tuple(constants.tolist()),
        ratios=tuple(ratios),
        eta2=eta2,
        covariance=covariance,
        chi_squared=Q,
        probability=probability,
        degrees_of_freedom=surplus,
    )


def drag_constants(modes: Modes) -> Array:
    """Return the constant c_n of each mode, (m,): its quadratic coefficient relative to that of the beam."""
    return QuadraticDamping(eta2=1.0).damping_ratios(modes, np.ones(modes.count)) * 3 * math.pi / 4


def ratio_curves(law: DampingLaw | None, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
    """Return the equivalent damping ratio of each mode at each tip amplitude (m) under a law, (amplitudes, modes)."""
    if law is None:
        return np.zeros((len(amplitudes), modes.count))
    return np.array([law.damping_ratios(modes, np.full(modes.count, amplitude)) for amplitude in amplitudes])
