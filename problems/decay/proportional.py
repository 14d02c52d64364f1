"""Coefficients of Rayleigh (proportional) damping from the damping ratios of several modes.

Rayleigh damping C = alpha M + beta K gives a mode of angular frequency omega the damping ratio

    zeta = alpha/(2 omega) + beta omega/2.                                                          Eq. (16)

Two modes determine both coefficients,

    alpha = 2 w1 w2 (z1 w2 - z2 w1)/(w2^2 - w1^2),    beta = 2 (z2 w2 - z1 w1)/(w2^2 - w1^2),      Eq. (17)

with w = omega and z = zeta.  More modes are fitted by weighted least squares with alpha, beta >= 0.  So are two modes
if Eq. (17) makes a coefficient negative, because the law would supply energy at low or high frequency; the law then
does not match both modes, and the fit has a warning.

With standard deviations sigma_i of the ratios and the rows b_i = (1/(2 omega_i), omega_i/2)/sigma_i of B, the
coefficients that are not at a bound have the covariance (B^T B)^-1, for any number of modes.  If no deviations are
given, all modes are assumed to have the same one.  It is estimated from the scatter, sigma^2 = sum (zeta - fitted)^2/
(m - n), if there are more modes m than free coefficients n.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.1.  With its Table 2, Eq. (17) gives
beta = 3.18E-5 s, not the 3.18E-4 of its Table 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.least_squares import least_squares
from ancf_casadi.estimation.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.figures import literal_text
from ancf_casadi.support.inputs import is_sequence, numbers, physical
from ancf_casadi.support.tables import Table, known

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSED = 3.0  # difference from a measured ratio, in standard deviations, beyond which there is a warning


@dataclass(frozen=True)
class RayleighFit:
    """Rayleigh damping fitted to modal damping ratios.

    Parameters
    ----------
    alpha : float
        Mass-proportional coefficient, 1/s.
    beta : float
        Stiffness-proportional coefficient, s.
    frequencies : tuple of float
        Frequencies of the modes, Hz.
    measured : tuple of float
        Measured damping ratios.
    ratio_std : tuple of float or None
        Standard deviations of the measured ratios, if given.
    ratios : tuple of float
        Damping ratios of the fitted law, Eq. (16).
    standard_errors : mapping of str to float
        Standard errors of ``alpha`` (1/s) and ``beta`` (s); nan at a bound, and nan without ``ratio_std`` if there are
        no more modes than free coefficients.
    warnings : tuple of str
        Coefficients at a bound, and modes that the law does not match.

    Examples
    --------
    >>> from ancf_casadi import RayleighDamping
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> [round(ratio, 4) for ratio in fit.ratios]
    [0.0101, 0.0027, 0.0031]
    >>> law = RayleighDamping(alpha=fit.alpha, beta=fit.beta)
    """

    alpha: float
    beta: float
    frequencies: tuple[float, ...]
    measured: tuple[float, ...]
    ratio_std: tuple[float, ...] | None
    ratios: tuple[float, ...]
    standard_errors: Mapping[str, float]
    warnings: tuple[str, ...]

    def table(self) -> Table:
        """Return measured and fitted damping ratios, one row per mode, and the coefficients."""
        deviations = self.ratio_std or [None] * len(self.measured)
        rows = [
            (mode, *values)
            for mode, values in enumerate(
                zip(self.frequencies, self.measured, deviations, self.ratios, strict=True), start=1
            )
        ]
        columns = ("mode", "frequency_hz", "damping_ratio", "standard_deviation", "fitted_ratio")
        notes = (
            f"alpha {self.alpha:.6g} {self._uncertainty('alpha', '1/s')}",
            f"beta {self.beta:.6g} {self._uncertainty('beta', 's')}",
            *(f"note: {warning}" for warning in self.warnings),
        )
        return Table("rayleigh", "Rayleigh (proportional) damping", columns, rows, notes)

    def _uncertainty(self, name: str, unit: str) -> str:
        """Return standard error and unit of a coefficient as text."""
        error = self.standard_errors[name]
        if math.isnan(error):
            return f"{unit}  ({'at its bound' if getattr(self, name) == 0.0 else 'standard error unknown'})"
        return f"+- {error:.2g} {unit}"

    def report(self) -> str:
        """Return the table as text."""
        return self.table().text()

    @literal_text
    def figure(self) -> Figure:
        """Draw the measured damping ratios with their errors, and the fitted law, Eq. (16), against frequency."""
        from matplotlib.figure import Figure  # matplotlib is slow to import

        from ancf_casadi.support.figures import COMPUTED, MEASURED

        figure = Figure(figsize=(6, 3.6), layout="constrained")
        axes = figure.subplots()
        frequencies = np.geomspace(0.8 * self.frequencies[0], 1.25 * self.frequencies[-1], 200)
        ratios = rayleigh_ratio(frequencies, self.alpha, self.beta)
        axes.plot(frequencies, 100 * ratios, lw=1, color=COMPUTED, label="fit")
        errors = None if self.ratio_std is None else 100 * np.array(self.ratio_std)
        axes.errorbar(
            self.frequencies, 100 * np.array(self.measured), errors, fmt="o", color=MEASURED, label="measured"
        )
        axes.set(xscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
        axes.set_xticks(self.frequencies, [f"{frequency:.4g}" for frequency in self.frequencies])
        axes.minorticks_off()
        axes.legend(frameon=False)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        return {
            "alpha": self.alpha,
            "alpha_stderr": known(self.standard_errors["alpha"]),
            "beta": self.beta,
            "beta_stderr": known(self.standard_errors["beta"]),
            "frequencies_hz": list(self.frequencies),
            "damping_ratios": list(self.measured),
            "ratio_std": None if self.ratio_std is None else list(self.ratio_std),
            "fitted_ratios": list(self.ratios),
            "warnings": list(self.warnings),
        }


def rayleigh_ratio(frequency: Array, alpha: float, beta: float) -> Array:
    """Return the damping ratio at each frequency (Hz) under Rayleigh damping, Eq. (16)."""
    ω = 2 * math.pi * frequency
    return alpha / (2 * ω) + beta * ω / 2


def fit_rayleigh(
    frequencies: Sequence[float],
    ratios: Sequence[float],
    *,
    ratio_std: float | Sequence[float] | None = None,
) -> RayleighFit:
    """Fit Rayleigh damping to modal damping ratios.

    Parameters
    ----------
    frequencies : sequence of float
        Natural frequencies, Hz, ascending; at least two.
    ratios : sequence of float
        Damping ratio of each mode, at least 0 and below 1.
    ratio_std : float or sequence of float, optional
        Standard deviations of the ratios; one for all, or one for each.  If not given, all ratios have the same weight.

    Raises
    ------
    InputError
        If there are fewer than two modes, the lengths differ, the frequencies do not increase, or a value is unusable.
    FitError
        If the fit does not converge.

    Examples
    --------
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> print(f"alpha {fit.alpha:.2f} 1/s, beta {fit.beta:.1e} s")
    alpha 0.24 1/s, beta 2.7e-05 s
    """
    hertz = tuple(physical(frequency, "frequencies") for frequency in numbers(frequencies, "frequencies"))
    ω, ζ = 2 * math.pi * np.array(hertz), np.array(numbers(ratios, "ratios"))
    if len(ω) < 2:
        raise InputError(f"needs at least 2 modes, got {len(ω)}", "frequencies")
    given: Any = ratio_std if ratio_std is None or is_sequence(ratio_std) else [ratio_std] * len(ω)
    deviations = None if given is None else tuple(physical(deviation, "ratio_std") for deviation in given)
    σ = np.ones(len(ω)) if deviations is None else np.array(deviations)
    for name, values in (("ratios", ζ), ("ratio_std", σ)):
        if len(values) != len(ω):
            raise InputError(f"has {len(values)} values for {len(ω)} frequencies", name)
    if np.diff(ω).min() <= 0.0:
        raise InputError("must increase", "frequencies")
    if ζ.min() < 0.0 or ζ.max() >= 1.0:
        raise InputError("must be at least 0 and below 1", "ratios")

    found, free = np.array(_two_modes(ω, ζ)), np.ones(2, dtype=bool)
    if len(ω) > 2 or found.min() < 0.0:
        found, free = _bounded(ω, ζ, σ)
    basis = np.array([1 / (2 * ω), ω / 2]).T
    predicted = basis @ found
    missed = (ζ - predicted) / σ
    variance = 1.0
    if deviations is None:
        surplus = len(ω) - np.count_nonzero(free)
        variance = float(missed @ missed) / surplus if surplus else math.nan
    errors = np.full(2, math.nan)
    errors[free] = math.sqrt(variance) * _unit_errors(basis[:, free] / σ[:, None])
    warnings = [
        f"{name} is at its bound 0: the ratios alone would make it negative, and the law would supply energy"
        for name, there in zip(("alpha", "beta"), ~free, strict=True)
        if there
    ]
    if deviations is not None:
        warnings += [
            f"mode {k + 1}, {hertz[k]:.6g} Hz: the fitted damping ratio {predicted[k]:.3g} differs from the measured "
            f"{ζ[k]:.3g} by {abs(missed[k]):.1f} standard deviations; use modal damping to match every mode"
            for k in np.flatnonzero(np.abs(missed) > MISSED).tolist()
        ]
    return RayleighFit(
        alpha=float(found[0]),
        beta=float(found[1]),
        frequencies=hertz,
        measured=tuple(ζ.tolist()),
        ratio_std=deviations,
        ratios=tuple(predicted.tolist()),
        standard_errors=dict(zip(("alpha", "beta"), errors.tolist(), strict=True)),
        warnings=tuple(warnings),
    )


def _two_modes(ω: Array, ζ: Array) -> tuple[float, float]:
    """Return alpha and beta that match the first two modes, Eq. (17)."""
    (ω1, ω2), (ζ1, ζ2) = ω[:2].tolist(), ζ[:2].tolist()
    spread = ω2**2 - ω1**2
    return 2 * ω1 * ω2 * (ζ1 * ω2 - ζ2 * ω1) / spread, 2 * (ζ2 * ω2 - ζ1 * ω1) / spread


def _bounded(ω: Array, ζ: Array, σ: Array) -> tuple[Array, Mask]:
    """Return alpha and beta, neither negative, and a mask of those that are not at their bound."""
    typical = float(ζ.max()) or 1.0
    alpha, beta = typical * float(ω.min()), typical / float(ω.max())
    fit = least_squares(
        lambda α, β: (α / cs.DM(2 * ω) + β * cs.DM(ω / 2) - cs.DM(ζ)) / cs.DM(σ),
        [
            Unknown("alpha", alpha, alpha, lower=0.0, unit="1/s"),
            Unknown("beta", beta, beta, lower=0.0, unit="s"),
        ],
    )
    return fit.values, ~fit.active_bounds


def _unit_errors(basis: Array) -> Array:
    """Return the standard errors of coefficients for residuals of variance 1, from the columns of their basis."""
    length = np.linalg.norm(basis, axis=0)
    return np.asarray(np.linalg.norm(np.linalg.pinv(basis / length), axis=1) / length)
