"""The result of a decay fit: values with units, standard errors, 95 % intervals and warnings.

Standard errors and intervals are those of ``ancf_casadi.estimation``, which allow for coloured residuals.  Warnings
name terms that are strongly correlated or not significant, say if the residuals are not noise, so that the law does not
explain all of the motion, and if the record is too short.  If the record is shorter than the decay, the standard error
of the damping is proportional to length^(-3/2), which gives the length that would be enough.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.estimation.estimates import LEVEL
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.profile import profile_interval
from ancf_casadi.estimation.resampling import refit
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array
from ancf_casadi.support.tables import known
from problems.decay.laws import LAWS, QUANTITIES, DecayModel, FrequencyLaw, Interval, Law
from problems.decay.limitations import limitations

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class DecayFit:
    """A mode identified from a free decay.

    The linear law has eta1 = 2 zeta omega and eta2 = 0; only the friction law has an eta0 other than 0, only the power
    law an eta_p.  The units below are those for a record in m; ``units`` gives the units of this fit.

    Parameters
    ----------
    law : {"linear", "quadratic", "friction", "power", "one-mode"}
        Fitted damping law.
    frequency_law : {"constant", "linear", "quadratic"}
        Fitted frequency law.
    frequency : float
        Natural frequency f, Hz, at zero amplitude if it depends on the amplitude A; the undamped frequency under the
        linear law.
    frequency_slope : float
        k1 in f (1 + k1 A), 1/m; 0 under the other frequency laws.
    frequency_curvature : float
        k2 in f (1 + k2 A^2), 1/m^2; 0 under the other frequency laws.
    damping_ratio : float
        Damping ratio; under the other laws the equivalent one at ``amplitude``.
    eta1 : float
        Linear damping coefficient, 1/s.
    eta2 : float
        Quadratic damping coefficient, 1/m.
    eta0 : float
        Friction force per mass, m/s^2.
    eta_p : float
        Coefficient of the force per mass ``eta_p |v|^p``, m^(1-p) s^(p-2); 0 under the other laws.
    exponent : float
        Exponent p of this force; nan under the other laws.
    amplitude : float
        Amplitude about the offset at the release, m: that of the envelope in Eq. (9), e0 in Eq. (27), and that of the
        initial state in Eq. (26).  If velocity or acceleration was measured, it is that of the displacement.
    offset : float
        Equilibrium, in the unit of the sensor; with drift, the one at the release.
    drift : float
        Rate of the equilibrium, in this unit per s; 0 if it was not fitted.
    release_time : float
        Start of the decay in the times of the record, s.
    release_reason : str
        Reason for this start: the first sample, the end of rest, the end of an excitation, or given.
    correlation : float
        Correlation of eta1 and eta2; nan under the linear law.
    standard_errors : mapping of str to float
        Standard error of each quantity by name, with unknowns at a bound taken as known; nan if the quantity itself is
        at a bound or not estimated.
    intervals : mapping of str to (float, float)
        95 % interval of each quantity by name, one-sided at a bound; nan for a quantity that is not estimated.
    warnings : tuple of str
        Limitations of the estimates.
    time : ndarray
        Times of the samples from the release on (m,), s.
    residuals : ndarray
        Fitted less measured values at these times (m,), in the unit of the sensor.
    fitted_samples : int
        Number of samples that the fit used: fewer than all if the record has far more than its mode needs.
    model : DecayModel
        Fitted curve.
    indices : tuple of int
        Positions in ``fit`` of the unknowns of the curve; not all if several records or modes were fitted at once.
    fit : Fit
        All unknowns, with covariance, bounds and condition number, and the status of the solver.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
    >>> fit = fit_decay(record)
    >>> print(f"{fit.damping_ratio:.5f} +- {fit.standard_errors['damping_ratio']:.5f}")
    0.00834 +- 0.00001
    >>> low, high = fit.intervals["frequency"]
    >>> print(f"{low:.4f} to {high:.4f} Hz")
    1.9099 to 1.9100 Hz
    """

    law: Law
    frequency_law: FrequencyLaw
    frequency: float
    frequency_slope: float
    frequency_curvature: float
    damping_ratio: float
    eta1: float
    eta2: float
    eta0: float
    eta_p: float
    exponent: float
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
    fitted_samples: int
    model: DecayModel
    indices: tuple[int, ...]
    fit: Fit

    @property
    def samples(self) -> int:
        """Number of samples from the release on."""
        return len(self.residuals)

    @property
    def estimates(self) -> dict[str, float]:
        """Estimated quantities by name."""
        return {name: getattr(self, name) for name in QUANTITIES if not math.isnan(self.intervals[name][0])}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each estimated quantity."""
        return {name: self.model.unit(name) for name in self.estimates}

    def refit(self, noise: Array) -> Array:
        """Return the estimated quantities from a fit to the fitted curve plus noise, in the unit of the sensor."""
        x = refit(self.fit, noise, gauss_newton=LAWS[self.law].integrated)
        found = self.model.values(x[list(self.indices)])
        return np.array([found[name] for name in self.estimates])

    @property
    def residual_rms(self) -> float:
        """Root mean square R of the residuals, Eq. (10), in the unit of the sensor."""
        return math.sqrt(np.mean(self.residuals**2))

    @property
    def active_bounds(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return self.fit.at_bound

    def displacement(self, time: ArrayLike) -> Array:
        """Return the fitted record, in the unit of its sensor, at times (s) of the record, from the release on.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> from problems import fit_decay
        >>> time = np.linspace(0.0, 10.0, 1001)
        >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
        >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
        >>> fit_decay(record).displacement([0.0, 5.0]).round(3)
        array([ 0.02 , -0.012])
        """
        t = array(time, "time").ravel() - self.release_time
        curve = self.model.curve(t, *(cs.MX(self.fit.values[i]) for i in self.indices))
        return np.asarray(cs.evalf(curve)).ravel()

    def profile_interval(self, name: str, level: float = LEVEL) -> Interval:
        """Return the interval of a quantity by profile likelihood.

        Parameters
        ----------
        name : str
            One of ``estimates``: ``frequency``, ``damping_ratio``, ``eta1``, ``amplitude``, ``offset`` and so on.
        level : float
            Confidence level.

        Raises
        ------
        InputError
            If the law has no such quantity, the level is not between 0 and 1, or there is no scatter.
        FitError
            If a nonlinear program for an end does not converge.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> from problems import fit_decay
        >>> time = np.linspace(0.0, 10.0, 1001)
        >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
        >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
        >>> [f"{end:.4f}" for end in fit_decay(record).profile_interval("damping_ratio")]
        ['0.0083', '0.0084']
        """
        if name not in self.estimates:
            raise InputError(f"is not estimated by this fit; it has {', '.join(self.estimates)}", name)
        which = list(QUANTITIES).index(name)
        return profile_interval(self.fit, lambda *x: self.model.quantities(*(x[i] for i in self.indices))[which], level)

    def figure(self) -> Figure:
        """Draw record and fit, the residuals, and damping ratio and frequency against amplitude (``law_curve``).

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> from problems import fit_decay
        >>> time = np.linspace(0.0, 10.0, 1001)
        >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
        >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
        >>> fit_decay(record).figure().savefig("decay.png")
        """
        from problems.decay.figure import decay_fit_figure  # matplotlib is slow to import

        return decay_fit_figure(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        table: dict[str, Any] = {"law": self.law, "frequency_law": self.frequency_law}
        for name, quantity in QUANTITIES.items():
            low, high = self.intervals[name]
            suffix = quantity.suffix if self.model.unit(name) == quantity.unit else ""  # then ``units`` has the unit
            table[f"{name}{suffix}"] = known(getattr(self, name))
            table[f"{name}_stderr{suffix}"] = known(self.standard_errors[name])
            table[f"{name}_interval{suffix}"] = [known(low), known(high)]
        table |= {
            "correlation": known(self.correlation),
            "release_time_s": self.release_time,
            "release_reason": self.release_reason,
            f"residual_rms{'_m' * (self.model.sensor.unit == 'm')}": self.residual_rms,
            "sensor": self.model.sensor.quantity,
            "units": self.units,
            "samples": self.samples,
            "fitted_samples": self.fitted_samples,
            "at_bound": list(self.active_bounds),
            "warnings": list(self.warnings),
            "fit": self.fit.to_dict(),
        }
        return table

    def report(self) -> str:
        """Return the result as text, one line per quantity.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> from problems import fit_decay
        >>> time = np.linspace(0.0, 10.0, 1001)
        >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
        >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
        >>> print(fit_decay(record).report())
        linear decay, 1001 samples from 0 s on; 95 % intervals
          frequency ...
        """
        drift = ["drift"] * self.model.drift
        shown = ["frequency", "damping_ratio", *self.model.terms, "amplitude", "offset", *drift]
        bent = "" if self.frequency_law == "constant" else f", frequency {self.frequency_law} in the amplitude"
        lines = [f"{self.law} decay{bent}, {self.samples} samples from {self.release_time:g} s on; 95 % intervals"]
        if self.fitted_samples < self.samples:
            step = (self.time[-1] - self.time[0]) / (self.samples - 1)
            rate = self.fitted_samples / self.samples / step
            lines.append(
                f"  fitted as {self.fitted_samples} samples at {rate:.4g} Hz: the frequencies up to {rate / 2:.4g} Hz "
                "of the record, without a loss for this mode"
            )
        lines += [f"  {name:<20}{getattr(self, name):>13.6g} {self._uncertainty(name)}" for name in shown]
        lines.append(f"  {'release':<20}{self.release_time:>13.6g} s  ({self.release_reason})")
        lines.append(f"  {'residual_rms':<20}{self.residual_rms:>13.3g} {self.model.sensor.unit}".rstrip())
        lines.append(f"  {'noise':<20}{self.fit.colour()}")
        lines.append(
            f"  {'solution':<20}{self.fit.rank} of {len(self.fit.names)} unknowns free of bounds, condition number "
            f"{self.fit.condition:.3g}; {self.fit.status} after {self.fit.iterations} iterations"
        )
        return "\n".join([*lines, *(f"  note: {warning}" for warning in self.warnings)])

    def _uncertainty(self, name: str) -> str:
        """Return standard error, unit and interval of a quantity as text."""
        error, interval, unit = self.standard_errors[name], self.intervals[name], self.model.unit(name)
        if name not in self.estimates:
            return f"{unit}  (fixed)".lstrip()
        ends = ", ".join(_precise(end, interval) for end in interval)
        if math.isnan(error):
            return f"{unit}  [{ends}]  (at its bound)".lstrip()
        return f"{f'+- {error:.2g} {unit}'.rstrip()}  [{ends}]"


def decay_result(
    model: DecayModel,
    fit: Fit,
    time: Array,
    residuals: Array,
    *,
    indices: tuple[int, ...],
    rows: slice,
    ratio_bounds: Interval,
    reason: str,
    notes: Sequence[str] = (),
) -> DecayFit:
    """Return the result for one of the records of a fit.

    Parameters
    ----------
    model : DecayModel
        Fitted curve.
    fit : Fit
        Unknowns of all records.
    time, residuals : ndarray
        Times of the record from the release on, s, and its residuals.
    indices : tuple of int
        Positions of the unknowns of the record.
    rows : slice
        Samples of the record that were fitted, among those of all records.
    ratio_bounds : (float, float)
        Bounds of the damping ratio under the linear law.
    reason : str
        Reason for the start of the free decay.
    notes : sequence of str
        Limitations of the record.
    """

    def quantities(*x: cs.MX) -> cs.MX:
        return model.quantities(*(x[i] for i in indices))

    bounds = {name: (quantity.lower, quantity.upper) for name, quantity in QUANTITIES.items()}
    if model.law == "linear":
        bounds["damping_ratio"] = ratio_bounds
        bounds["eta1"] = (0.0 if ratio_bounds[0] >= 0.0 else -math.inf, math.inf)
    values, errors = (dict(zip(QUANTITIES, column.tolist(), strict=True)) for column in fit.derived(quantities))
    ends = np.clip(fit.derived_intervals(quantities).T, *np.array(list(bounds.values())).T).T
    return DecayFit(
        law=model.law,
        frequency_law=model.frequency_law,
        **values,
        release_time=float(time[0]),
        release_reason=reason,
        correlation=_correlation(fit, "eta1", "eta2"),
        standard_errors=errors,
        intervals={name: (low, high) for name, (low, high) in zip(QUANTITIES, ends.tolist(), strict=True)},
        warnings=(*notes, *fit.warnings, *limitations(model, fit, indices, rows, time, residuals, values, errors)),
        time=time,
        residuals=residuals,
        fitted_samples=rows.stop - rows.start,
        model=model,
        indices=indices,
        fit=fit,
    )


def _correlation(fit: Fit, first: str, second: str) -> float:
    """Return the correlation of two unknowns; nan if one is at a bound or not in the fit."""
    if not {first, second} <= set(fit.names):
        return math.nan
    return float(fit.correlations[fit.names.index(first), fit.names.index(second)])


def _precise(end: float, interval: Interval) -> str:
    """Return an end of an interval with three digits of its width."""
    width = interval[1] - interval[0]
    if not (math.isfinite(width) and width > 0.0 and end):
        return f"{end:.6g}"
    return f"{end:.{min(17, max(3, 3 + math.ceil(math.log10(abs(end) / width))))}g}"
