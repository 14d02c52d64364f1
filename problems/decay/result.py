"""What a free decay tells of a mode: values with units, how sure they are, and what to know before using them.

Standard errors and 95 % intervals are those of ``estimation``; they take the residuals to be white.  The fit warns
of what it can see itself: terms the record does not tell apart, or from zero; residuals that are not white, so that the
errors are too small; a record too short.  Of a record shorter than the decay, the error of the damping falls with the
length^(-3/2); from this the length that would do is found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.estimation.autocorrelation import colour_warning
from ancf_casadi.estimation.estimates import LEVEL
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.profile import profile_interval
from ancf_casadi.estimation.resampling import refit
from ancf_casadi.estimation.result import known
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array
from problems.decay.laws import LAWS, DecayModel, Law

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Interval = tuple[float, float]

ROUNDING = 1e-6  # residual, as a part of the amplitude, below which there is no noise to judge
FEW_PERIODS = 5  # of free decay, below which frequency, damping and equilibrium are hardly separate
VAGUE = 0.1  # relative standard error of the damping ratio beyond which the record is too short for it
UNITS = {
    "frequency": "Hz", "damping_ratio": "", "eta1": "1/s", "eta2": "1/m", "eta0": "m/s^2", "amplitude": "m",
    "offset": "m", "drift": "m/s",
}  # fmt: skip
QUANTITIES = tuple(UNITS)
SUFFIXES = {
    "frequency": "_hz",
    "eta2": "_per_m",
    "eta0": "_m_per_s2",
    "amplitude": "_m",
    "offset": "_m",
    "drift": "_m_per_s",
}


@dataclass(frozen=True, eq=False)
class DecayFit:
    """What a free decay tells of a mode.

    A linear decay is a quadratic one with eta1 = 2 zeta omega and eta2 = 0, and that one with friction eta0 = 0.

    Parameters
    ----------
    law : {"linear", "quadratic", "friction", "one-mode"}
        The law fitted.
    frequency : float
        Natural frequency, Hz; the undamped one under the linear law.
    damping_ratio : float
        Damping ratio; under the other laws the equivalent one at ``amplitude``.
    eta1, eta2, eta0 : float
        Linear (1/s) and quadratic (1/m) damping coefficient; friction force by mass (m/s^2).
    amplitude : float
        Amplitude about the offset at the release, m: that of the envelope of Eq. (9), or e0 of Eq. (27).
    offset : float
        Where the point comes to rest, m; if it drifts, at the release.
    drift : float
        Velocity of the point of rest, m/s; 0 if the fit had none.
    release_time : float
        When the decay begins, s, in the times of the record.
    release_reason : str
        Why there: the first sample, the end of rest, an excitation that ends before, or as given.
    correlation : float
        Correlation of eta1 and eta2; nan under the linear law.
    standard_errors : mapping of str to float
        Standard error of each quantity by name, unknowns at a bound taken as known; nan for a quantity that is at a
        bound or not estimated.
    intervals : mapping of str to (float, float)
        95 % interval of each quantity by name, one-sided at a bound; nan for a quantity that is not estimated.
    warnings : tuple of str
        What to know before using them.
    time : ndarray
        Times of the samples fitted (m,), s.
    residuals : ndarray
        Fitted less measured displacement at these (m,), m.
    model : DecayModel
        The curve fitted.
    indices : tuple of int
        Which unknowns of ``fit`` are those of the curve; all, unless several records were fitted at once.
    fit : Fit
        The unknowns of the law, with their covariance, bounds, rank and condition, and what the solver said.
    """

    law: Law
    frequency: float
    damping_ratio: float
    eta1: float
    eta2: float
    eta0: float
    amplitude: float
    offset: float
    drift: float
    release_time: float
    release_reason: str
    correlation: float
    standard_errors: Mapping[str, float]
    intervals: Mapping[str, Interval]
    warnings: tuple[str, ...]
    time: Array
    residuals: Array
    model: DecayModel
    indices: tuple[int, ...]
    fit: Fit

    @property
    def samples(self) -> int:
        """How many samples were fitted."""
        return len(self.residuals)

    @property
    def estimates(self) -> dict[str, float]:
        """Quantities that the law estimates, by name."""
        return {name: getattr(self, name) for name in QUANTITIES if not math.isnan(self.intervals[name][0])}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each estimated quantity."""
        return {name: UNITS[name] for name in self.estimates}

    def refit(self, noise: Array) -> Array:
        """Return the estimated quantities from a fit to the fitted curve plus noise (m)."""
        x = refit(self.fit, noise, gauss_newton=LAWS[self.law].integrated)
        found = np.asarray(cs.evalf(quantities(self.model, self.indices, cs.vertsplit(cs.MX(cs.DM(x)))))).ravel()
        return np.asarray(found[[QUANTITIES.index(name) for name in self.estimates]])

    @property
    def residual_rms(self) -> float:
        """R of Eq. (10), m."""
        return math.sqrt(np.mean(self.residuals**2))

    @property
    def active_bounds(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return self.fit.at_bound

    def displacement(self, time: ArrayLike) -> Array:
        """Return the fitted displacement (m) at times (s) of the record, from the release on."""
        t = array(time, "time").ravel() - self.release_time
        curve = self.model.curve(t, *(cs.MX(self.fit.values[i]) for i in self.indices))
        return np.asarray(cs.evalf(curve)).ravel()

    def profile_interval(self, name: str, level: float = LEVEL) -> Interval:
        """Return the interval of a quantity by profile likelihood.

        Parameters
        ----------
        name : str
            ``frequency``, ``damping_ratio``, ``eta1``, ``eta2``, ``eta0``, ``amplitude``, ``offset`` or ``drift``.
        level : float
            How probably it holds the truth.

        Raises
        ------
        InputError
            If the law has no such quantity, the level is not between 0 and 1, or there is no residual.
        FitError
            If a program for an end does not converge.
        """
        if name not in self.estimates:
            raise InputError(f"is not estimated by this fit; there are {', '.join(self.estimates)}", name)
        which = QUANTITIES.index(name)
        return profile_interval(self.fit, lambda *x: quantities(self.model, self.indices, x)[which], level)

    def figure(self) -> Figure:
        """Draw record and fit, and the residuals over time and their autocorrelation."""
        from ancf_casadi.plot import fit_figure  # matplotlib is slow to import

        fitted = self.displacement(self.time)
        return fit_figure(self.time, fitted - self.residuals, fitted)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for what is not known."""
        table: dict[str, Any] = {"law": self.law}
        for name in QUANTITIES:
            suffix = SUFFIXES.get(name, "")
            low, high = self.intervals[name]
            table[f"{name}{suffix}"] = known(getattr(self, name))
            table[f"{name}_stderr{suffix}"] = known(self.standard_errors[name])
            table[f"{name}_interval{suffix}"] = [known(low), known(high)]
        table |= {
            "correlation": known(self.correlation),
            "release_time_s": self.release_time,
            "release_reason": self.release_reason,
            "residual_rms_m": self.residual_rms,
            "samples": self.samples,
            "at_bound": list(self.active_bounds),
            "warnings": list(self.warnings),
            "fit": self.fit.to_dict(),
        }
        return table

    def report(self) -> str:
        """Return the result as text, a line each."""
        shown = (
            "frequency",
            "damping_ratio",
            *LAWS[self.law].terms,
            "amplitude",
            "offset",
            *["drift"] * self.model.drift,
        )
        lines = [f"{self.law} decay, {self.samples} samples from {self.release_time:g} s on; 95 % intervals"]
        for name in shown:
            low, high = (_precise(end, self.intervals[name]) for end in self.intervals[name])
            value = (
                f"  {name:<14}{getattr(self, name):>13.6g} +- {self.standard_errors[name]:.2g} {UNITS[name]}".rstrip()
            )
            lines.append(f"{value}  [{low}, {high}]")
        lines.append(f"  {'release':<14}{self.release_time:>13.6g} s  ({self.release_reason})")
        lines.append(f"  {'residual_rms':<14}{self.residual_rms:>13.3g} m")
        lines.append(
            f"  {'problem':<14}rank {self.fit.rank} of {len(self.fit.names)}, condition {self.fit.condition:.3g}, "
            f"{self.fit.status} after {self.fit.iterations} iterations"
        )
        return "\n".join([*lines, *(f"  note: {warning}" for warning in self.warnings)])


def quantities(model: DecayModel, indices: tuple[int, ...], x: Sequence[cs.MX]) -> cs.MX:
    """Return the quantities of a decay, in the order of ``QUANTITIES``, from all unknowns of a fit."""
    return model.quantities(*(x[i] for i in indices))


def decay_result(
    model: DecayModel,
    fit: Fit,
    time: Array,
    *,
    indices: tuple[int, ...],
    rows: slice,
    ratio_bounds: Interval,
    reason: str,
) -> DecayFit:
    """Return what a fit tells of one of its records.

    Parameters
    ----------
    model : DecayModel
        The curve fitted.
    fit : Fit
        Its unknowns.
    time : ndarray
        Times of the record from the release on, s.
    indices : tuple of int
        Which unknowns are those of the record.
    rows : slice
        Which residuals are.
    ratio_bounds : (float, float)
        Bounds of the damping ratio under the linear law.
    reason : str
        Why the free decay begins with the first of the times.
    """
    values, errors = fit.derived(lambda *x: quantities(model, indices, x))
    lower, upper = ratio_bounds if model.law == "linear" else (0.0, math.inf)
    least = np.array([0.0, lower, 0.0 if lower >= 0.0 else -math.inf, 0.0, 0.0, 0.0, -math.inf, -math.inf])
    most = np.full(len(least), math.inf)
    most[1] = upper
    ends = np.clip(fit.derived_intervals(lambda *x: quantities(model, indices, x)).T, least, most).T
    named = dict(zip(QUANTITIES, values.tolist(), strict=True))
    standard_errors = dict(zip(QUANTITIES, errors.tolist(), strict=True))
    residuals = fit.residuals[rows]
    return DecayFit(
        law=model.law,
        **named,
        release_time=float(time[0]),
        release_reason=reason,
        correlation=math.nan if model.law == "linear" else float(fit.correlations[indices[1], indices[2]]),
        standard_errors=standard_errors,
        intervals={name: (float(low), float(high)) for name, (low, high) in zip(QUANTITIES, ends, strict=True)},
        warnings=(*fit.warnings, *_warnings(named, standard_errors, time[-1] - time[0], residuals)),
        time=time,
        residuals=residuals,
        model=model,
        indices=indices,
        fit=fit,
    )


def _warnings(named: dict[str, float], errors: Mapping[str, float], length: float, r: Array) -> list[str]:
    """Return what the record tells of itself, beyond what its fit does."""
    warnings = []
    periods = length * named["frequency"]
    if periods < FEW_PERIODS:
        warnings.append(
            f"the record is short: {periods:.1f} periods of free decay; {FEW_PERIODS} or more tell apart more"
        )
    noisy = math.sqrt(np.mean(r**2)) > ROUNDING * named["amplitude"]
    ζ, error = named["damping_ratio"], errors["damping_ratio"]
    if noisy and error > VAGUE * abs(ζ):
        share = f"to {error / abs(ζ):.0%} only" if error < abs(ζ) else "no better than to be zero"
        advice = "less noise, or a larger release, would help"
        if ζ * 2 * math.pi * periods < 1.0:
            needed = length * (min(error / abs(ζ), 1.0) / VAGUE) ** (2 / 3) if ζ else math.inf
            advice = f"the record is too short, one of {needed:.2g} s would do {VAGUE:.0%}"
        warnings.append(f"the damping ratio is known {share}: {advice}")
    coloured = colour_warning(r, noise_free=ROUNDING * named["amplitude"])
    return [*warnings, coloured] if coloured else warnings


def _precise(end: float, interval: Interval) -> str:
    """Return an end of an interval with three digits of its width."""
    width = interval[1] - interval[0]
    if not (math.isfinite(width) and width > 0.0 and end):
        return f"{end:.6g}"
    return f"{end:.{min(17, max(3, 3 + math.ceil(math.log10(abs(end) / width))))}g}"
