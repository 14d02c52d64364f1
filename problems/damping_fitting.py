"""Coefficients of proportional damping from the damping ratios of several modes.

Proportional damping C = alpha M + beta K gives the mode of angular frequency omega the ratio

    zeta = alpha/(2 omega) + beta omega/2.                                                          Eq. (16)

Two modes determine both coefficients,

    alpha = 2 w1 w2 (z1 w2 - z2 w1)/(w2^2 - w1^2),    beta = 2 (z2 w2 - z1 w1)/(w2^2 - w1^2),      Eq. (17)

more modes by weighted least squares with alpha, beta >= 0.  So are two modes of which Eq. (17) would make a coefficient
negative, that is, feed energy in at low or high frequency: they are then not matched, and the fit says so.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.1.  With its Table 2, Eq. (17) gives
beta = 3.18E-5 s, not the 3.18E-4 of its Table 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.inputs import numbers, physical, positive
from ancf_casadi.nlp import Unknown, least_squares


@dataclass(frozen=True)
class RayleighErrors:
    """Standard errors of alpha (1/s) and beta (s); nan at a bound, and where two modes are matched."""

    alpha: float
    beta: float


@dataclass(frozen=True)
class RayleighFit:
    """Proportional damping fitted to modal damping ratios.

    Parameters
    ----------
    alpha : float
        Mass-proportional coefficient, 1/s.
    beta : float
        Stiffness-proportional coefficient, s.
    frequencies : tuple of float
        Frequencies of the modes, Hz.
    measured : tuple of float
        The damping ratios given.
    ratios : tuple of float
        The damping ratios these coefficients give, Eq. (16).
    standard_errors : RayleighErrors
        From the scatter of the measured ratios about the fitted ones.
    warnings : tuple of str
        What to know before using the coefficients.
    """

    alpha: float
    beta: float
    frequencies: tuple[float, ...]
    measured: tuple[float, ...]
    ratios: tuple[float, ...]
    standard_errors: RayleighErrors
    warnings: tuple[str, ...]


def fit_rayleigh(
    frequencies: Sequence[float],
    ratios: Sequence[float],
    *,
    standard_deviations: Sequence[float] | None = None,
) -> RayleighFit:
    """Fit proportional damping to modal damping ratios.

    Parameters
    ----------
    frequencies : sequence of float
        Natural frequencies, Hz, ascending; at least two.
    ratios : sequence of float
        Damping ratio of each mode, at least 0 and below 1.
    standard_deviations : sequence of float, optional
        How uncertain each ratio is; all alike if not given.  Only how they compare matters.

    Raises
    ------
    InputError
        If there are fewer than two modes, the lengths differ, the frequencies do not ascend, or a value is unusable.
    FitError
        If the fit does not converge.
    """
    hertz = tuple(physical(frequency, "frequencies") for frequency in numbers(frequencies, "frequencies"))
    ω, ζ = 2 * math.pi * np.array(hertz), np.array(numbers(ratios, "ratios"))
    given = np.ones(len(ω)) if standard_deviations is None else standard_deviations
    σ = np.array([positive(σ, "standard_deviations") for σ in numbers(given, "standard_deviations")])
    if len(ω) < 2:
        raise InputError(f"needs at least 2 modes, got {len(ω)}", "frequencies")
    for name, values in (("ratios", ζ), ("standard_deviations", σ)):
        if len(values) != len(ω):
            raise InputError(f"has {len(values)} values for {len(ω)} frequencies", name)
    if np.diff(ω).min() <= 0.0:
        raise InputError("must ascend", "frequencies")
    if ζ.min() < 0.0 or ζ.max() >= 1.0:
        raise InputError("must be at least 0 and below 1", "ratios")

    alpha, beta = _two_modes(ω, ζ)
    errors = RayleighErrors(math.nan, math.nan)
    warnings: tuple[str, ...] = ()
    if len(ω) > 2 or min(alpha, beta) < 0.0:
        alpha, beta, errors, warnings = _least_squares(ω, ζ, σ)
    predicted = alpha / (2 * ω) + beta * ω / 2
    return RayleighFit(alpha, beta, hertz, tuple(ζ.tolist()), tuple(predicted.tolist()), errors, warnings)


def _two_modes(ω: NDArray[np.float64], ζ: NDArray[np.float64]) -> tuple[float, float]:
    """Return alpha and beta that match the first two modes, Eq. (17)."""
    (ω1, ω2), (ζ1, ζ2) = ω[:2].tolist(), ζ[:2].tolist()
    spread = ω2**2 - ω1**2
    return 2 * ω1 * ω2 * (ζ1 * ω2 - ζ2 * ω1) / spread, 2 * (ζ2 * ω2 - ζ1 * ω1) / spread


def _least_squares(
    ω: NDArray[np.float64], ζ: NDArray[np.float64], σ: NDArray[np.float64]
) -> tuple[float, float, RayleighErrors, tuple[str, ...]]:
    typical = float(ζ.max()) or 1.0
    alpha, beta = typical * float(ω.min()), typical / float(ω.max())
    fit = least_squares(
        lambda α, β: (α / cs.DM(2 * ω) + β * cs.DM(ω / 2) - cs.DM(ζ)) / cs.DM(σ),
        [
            Unknown("alpha", alpha, alpha, lower=0.0, unit="1/s"),
            Unknown("beta", beta, beta, lower=0.0, unit="s"),
        ],
    )
    warnings = tuple(
        f"{name} is at its bound 0; below it the law would feed energy in"
        for name, bound in zip(fit.names, fit.at_bound, strict=True)
        if bound
    )
    errors = RayleighErrors(*fit.standard_errors.tolist())
    return fit["alpha"], fit["beta"], errors, warnings
