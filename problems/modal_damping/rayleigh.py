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
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ancf_casadi.estimation.noise.covariance import Noise
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, Figure, literal_text
from ancf_casadi.support.inputs import is_sequence, numbers, physical, shown
from ancf_casadi.support.tables import Table, finite_or_none

LARGEST_DEVIATION = 3.0  # difference from a measured ratio, in standard deviations, beyond which there is a warning


@dataclass(frozen=True, eq=False)
class RayleighFit(LeastSquaresResult):
    """Rayleigh damping fitted to modal damping ratios.

    Parameters
    ----------
    frequencies : tuple of float
        Frequencies of the modes, Hz.
    measured : tuple of float
        Measured damping ratios.
    ratio_std : tuple of float or None
        Standard deviations of the measured ratios, if given.

    Examples
    --------
    >>> from ancf_casadi import RayleighDamping
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> [round(ratio, 4) for ratio in fit.ratios]
    [0.0101, 0.0027, 0.0031]
    >>> law = RayleighDamping(alpha=fit.alpha, beta=fit.beta)
    """

    kind = "rayleigh"
    _drawing = _comparing = "problems.modal_damping.rayleigh.rayleigh_figure"

    frequencies: tuple[float, ...]
    measured: tuple[float, ...]
    ratio_std: tuple[float, ...] | None

    @property
    def alpha(self) -> float:
        """Mass-proportional coefficient, 1/s."""
        return self.fit["alpha"]

    @property
    def beta(self) -> float:
        """Stiffness-proportional coefficient, s."""
        return self.fit["beta"]

    @property
    def ratios(self) -> tuple[float, ...]:
        """Damping ratios of the fitted law, Eq. (16)."""
        return tuple(rayleigh_ratio(np.array(self.frequencies), self.alpha, self.beta).tolist())

    @property
    def warnings(self) -> tuple[str, ...]:
        """Coefficients at a bound, and modes that the law does not match."""
        notes = [
            f"{name} is at its bound 0: the ratios alone would make it negative, and the law would supply energy"
            for name in (self.at_bound if any(self.measured) else ())
        ]
        for k, deviation in enumerate(self.ratio_std or ()):
            difference = abs(self.ratios[k] - self.measured[k]) / deviation
            if difference > LARGEST_DEVIATION:
                notes.append(
                    f"mode {k + 1}, {self.frequencies[k]:.6g} Hz: the fitted damping ratio {self.ratios[k]:.3g} "
                    f"differs from the measured {self.measured[k]:.3g} by {difference:.1f} standard deviations; use "
                    "modal damping to match every mode"
                )
        return tuple(notes)

    def predict(self, record: tuple[Sequence[float], Sequence[float]]) -> RecordPrediction:
        """Compute the damping ratios of other modes, and compare.

        Parameters
        ----------
        record : (sequence of float, sequence of float)
            Frequencies, Hz, and measured damping ratios.

        Raises
        ------
        InputError
            If it is not a pair of sequences of equal length, or a value is unusable.
        """
        f, ζ, _ = _check_modes(*_split_record(record), ratio_std=None)
        predicted, errors = self.fit.derived(lambda α, β: rayleigh_ratio(f, α, β))
        noise = float(np.mean(self.ratio_std)) if self.ratio_std else self.fit.residual_rms
        channel = PredictedChannel("damping ratio", "", ζ, predicted, np.nan_to_num(errors), f, "frequency, Hz", noise)
        return RecordPrediction("rayleigh", (channel,))

    def table(self) -> Table:
        """Return measured and fitted damping ratios, one row per mode, and the coefficients."""
        deviations = self.ratio_std or [None] * len(self.measured)
        columns = ("mode", "frequency_hz", "damping_ratio", "standard_deviation", "fitted_ratio")
        modes = range(1, len(self.measured) + 1)
        rows = list(zip(modes, self.frequencies, self.measured, deviations, self.ratios, strict=True))
        notes = [f"{name} {value:.6g} {self._uncertainty(name)}" for name, value in self.estimates.items()]
        return Table("rayleigh", "Rayleigh (proportional) damping", columns, rows, notes)

    def _uncertainty(self, name: str) -> str:
        """Return standard error and unit of a coefficient as text."""
        error, unit = self.standard_errors[name], self.units[name]
        if math.isnan(error):
            return f"{unit}  ({'at its bound' if name in self.at_bound else 'standard error unknown'})"
        return f"+- {error:.2g} {unit}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        return {
            **super().to_dict(),
            "alpha": self.alpha,
            "alpha_stderr": finite_or_none(self.standard_errors["alpha"]),
            "beta": self.beta,
            "beta_stderr": finite_or_none(self.standard_errors["beta"]),
            "frequencies_hz": list(self.frequencies),
            "damping_ratios": list(self.measured),
            "ratio_std": None if self.ratio_std is None else list(self.ratio_std),
            "fitted_ratios": list(self.ratios),
        }


def rayleigh_ratio(frequency: Array, alpha: Any, beta: Any) -> Any:
    """Return the damping ratio at each frequency (Hz) under Rayleigh damping, Eq. (16); coefficients may be symbols."""
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
    f, ζ, deviations = _check_modes(frequencies, ratios, ratio_std)
    ω, σ = 2 * math.pi * f, np.ones(len(f)) if deviations is None else deviations
    if len(f) < 2:
        raise InputError(f"needs at least 2 modes, got {len(f)}", "frequencies")
    largest = float(ζ.max()) or 1.0
    α_0, β_0 = largest * float(ω.min()), largest / float(ω.max())
    fit = least_squares(
        lambda α, β: (rayleigh_ratio(f, α, β) - ζ) / σ,
        [Unknown("alpha", α_0, α_0, lower=0.0, unit="1/s"), Unknown("beta", β_0, β_0, lower=0.0, unit="s")],
        noise=AssumedNoise(stated=None if deviations is None else np.ones(len(f), dtype=bool)),
    )
    if deviations is not None:  # they are known, whatever the scatter
        fit = replace(fit, covariance=fit.covariance / fit.noise.variance, noise=Noise(1.0, math.inf))
    stds = None if deviations is None else tuple(deviations.tolist())
    return RayleighFit(fit, tuple(f.tolist()), tuple(ζ.tolist()), stds, again=partial(_refit, ratio_std=ratio_std))


def _refit(records: Any, ratio_std: float | Sequence[float] | None) -> RayleighFit:
    return fit_rayleigh(*_split_record(records), ratio_std=ratio_std)


def _split_record(record: Any) -> tuple[Any, Any]:
    if not is_sequence(record) or len(record) != 2:
        raise InputError(f"must be frequencies and damping ratios, got {shown(record)}", "records")
    frequencies, ratios = record
    return frequencies, ratios


def _check_modes(frequencies: Any, ratios: Any, ratio_std: Any) -> tuple[Array, Array, Array | None]:
    """Return frequencies (m,), Hz, damping ratios (m,), and their standard deviations (m,) if given."""
    f = np.array([physical(frequency, "frequencies") for frequency in numbers(frequencies, "frequencies")])
    ζ, deviations = np.array(numbers(ratios, "ratios")), None
    if ratio_std is not None:
        ratio_stds = ratio_std if is_sequence(ratio_std) else [ratio_std] * len(f)
        deviations = np.array([physical(deviation, "ratio_std") for deviation in ratio_stds])
    for name, values in (("ratios", ζ), ("ratio_std", deviations)):
        if values is not None and len(values) != len(f):
            raise InputError(f"has {len(values)} values for {len(f)} frequencies", name)
    if (np.diff(f) <= 0.0).any():
        raise InputError("must increase", "frequencies")
    if ζ.min(initial=0.0) < 0.0 or ζ.max(initial=0.0) >= 1.0:
        raise InputError("must be at least 0 and below 1", "ratios")
    return f, ζ, deviations


@literal_text
def rayleigh_figure(fits: Mapping[str, RayleighFit]) -> Figure:
    """Draw measured damping ratios with their errors, and the fitted laws, Eq. (16), against frequency.

    Of a single law, the parts of its coefficients are drawn too.
    """
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    ticks = sorted({frequency for fit in fits.values() for frequency in fit.frequencies})
    frequencies = np.geomspace(0.8 * ticks[0], 1.25 * ticks[-1], 200)
    for k, (label, fit) in enumerate(fits.items()):
        colours = (COMPUTED, MEASURED) if not k else (f"C{k}", f"C{k}")
        ratios = rayleigh_ratio(frequencies, fit.alpha, fit.beta)
        axes.plot(frequencies, 100 * ratios, lw=1, color=colours[0], label=f"{label} fit".strip())
        terms = {"mass, α/(2 ω)": (fit.alpha, 0.0, ":"), "stiffness, β ω/2": (0.0, fit.beta, "--")}
        for name, (alpha, beta, dash) in terms.items() if len(fits) == 1 else ():
            ratios = rayleigh_ratio(frequencies, alpha, beta)
            axes.plot(frequencies, 100 * ratios, lw=1, ls=dash, color=COMPUTED, label=name)
        errors = None if fit.ratio_std is None else 100 * np.array(fit.ratio_std)
        measured = 100 * np.array(fit.measured)
        axes.errorbar(fit.frequencies, measured, errors, fmt="o", color=colours[1], label=f"{label} measured".strip())
    axes.set(xscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
    axes.set_xticks(ticks, [f"{frequency:.4g}" for frequency in ticks])
    axes.minorticks_off()
    axes.legend(frameon=False)
    return figure
