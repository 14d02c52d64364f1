"""The result of a decay fit: values with units, standard errors, 95 % intervals and warnings.

Standard errors and intervals are those of ``ancf_casadi.estimation``, which allow for coloured residuals.  Under the
logarithmic frequency, intervals follow the likelihood of its corner.  Warnings name terms that are strongly correlated
or not significant, and the ``limitations`` of the record and the law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.envelope import LawCurve
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.estimation.fit import Quantities
from ancf_casadi.estimation.intervals import derived_intervals
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.estimation.solver.unknown import share_lines
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.inputs import array
from ancf_casadi.support.tables import finite_or_none, to_width
from problems.decay.free_decay import FreeDecay
from problems.decay.laws import DECAY_QUANTITIES, DecayModel, Law
from problems.decay.limitations import explained_share, limitations
from problems.decay.prediction import predict_decay


def _quantity(name: str, text: str) -> property:
    return property(lambda fit: fit.values[name], doc=text)


@dataclass(frozen=True, eq=False)
class DecayFit(LeastSquaresResult):
    """A mode identified from a free decay.

    The linear law has eta1 = 2 zeta omega and eta2 = 0; only the friction law has an eta0 other than 0, only the power
    law an eta_p.  The units below are those for a record in m; ``units`` gives the units of this fit.

    Parameters
    ----------
    decay : FreeDecay
        The record from its release on, the samples of it that were fitted, and its modes.
    rows : slice
        These samples among those of all records in ``fit``.
    mode : int
        Position of the mode among those of the decay.

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
    >>> low, high = fit.intervals()["frequency"]
    >>> print(f"{low:.4f} to {high:.4f} Hz")
    1.9099 to 1.9100 Hz
    >>> fit.displacement([0.0, 5.0]).round(3)
    array([ 0.02 , -0.012])
    >>> print(fit.report())
    linear decay, 1001 samples from 0 s on; 95 % intervals
      frequency ...
    """

    kind = "decay"
    _drawing = "problems.decay.law_curve.decay_fit_figure"

    decay: FreeDecay
    rows: slice
    mode: int = 0

    frequency = _quantity(
        "frequency",
        "Frequency, Hz: under the linear law the undamped natural one; under the others, which are of first order in "
        "the damping, that of the oscillation, which is lower by about the square of the damping ratio.  If it depends "
        "on the amplitude, it is that at ``amplitude``.",
    )
    frequency_slope = _quantity("frequency_slope", "k in f_0 (1 + k A), 1/m; 0 under the other frequency laws.")
    frequency_curvature = _quantity("frequency_curvature", "k in f_0 (1 + k A^2), 1/m^2; 0 under the other ones.")
    frequency_change = _quantity(
        "frequency_change",
        "Relative change of the frequency at ``amplitude``, power or smooth; 0 under the other laws.",
    )
    frequency_exponent = _quantity("frequency_exponent", "q in this law; 0 under the other ones.")
    frequency_log_slope = _quantity("frequency_log_slope", "k in f_0 (1 + k ln(1 + A/A_s)); 0 under the other laws.")
    corner_amplitude = _quantity("corner_amplitude", "A_s in this law, m; 0 under the other laws.")
    damping_ratio = _quantity(
        "damping_ratio", "Damping ratio; under other laws than the linear one, the equivalent one at ``amplitude``."
    )
    eta1 = _quantity("eta1", "Linear damping coefficient, 1/s.")
    eta2 = _quantity("eta2", "Quadratic damping coefficient, 1/m.")
    eta0 = _quantity("eta0", "Friction force per mass, m/s^2.")
    eta_p = _quantity(
        "eta_p", "Coefficient of the force per mass ``eta_p |v|^p``, m^(1-p) s^(p-2); 0 under the other laws."
    )
    exponent = _quantity("exponent", "Exponent p of this force; nan under the other laws.")
    amplitude = _quantity(
        "amplitude",
        "Amplitude about the offset at the release, m: that of the envelope in Eq. (9), and e0 in Eq. (27).  If "
        "velocity or acceleration was measured, it is that of the displacement.",
    )
    offset = _quantity("offset", "Rest position, in the unit of the sensor; if it moves, the one at the release.")
    drift = _quantity("drift", "Its velocity at the release v, in this unit per s; 0 if it was not fitted.")
    creep = _quantity("creep", "k in the rest position d + v (1 - exp(-k t))/k, 1/s; 0 under the other ones.")

    @property
    def negligible(self) -> float:
        """Norm of residuals below which smaller ones are no evidence, those without noise."""
        return self.decay.least_deviation * math.sqrt(len(self.fit.residuals))

    @cached_property
    def values(self) -> dict[str, float]:
        """All quantities by name, estimated or not."""
        return dict(zip(DECAY_QUANTITIES, self._linearised[0].tolist(), strict=True))

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        return tuple(DECAY_QUANTITIES), tuple(map(self.model.unit, DECAY_QUANTITIES)), self._quantities

    def at_amplitude(self, amplitude: float) -> tuple[dict[str, float], dict[str, float]]:
        """Return the quantities by name as after a release from an amplitude, and their standard errors."""

        def quantities(*x: cs.MX) -> cs.MX:
            values = [cs.MX(amplitude) if self.fit.names[k].startswith("e0") else x[k] for k in self.indices]
            return self.model.quantities(*values)

        values, errors = self.fit.derived(quantities)
        names = tuple(DECAY_QUANTITIES)
        return dict(zip(names, values.tolist(), strict=True)), dict(zip(names, errors.tolist(), strict=True))

    def _quantities(self, *x: cs.MX) -> cs.MX:
        return self.model.quantities(*(x[i] for i in self.indices))

    def _ends(self, level: float) -> Array:
        """Return the intervals (q, 2) of all quantities within their bounds."""
        lower, upper = np.array(list(self.model.bounds.values())).T[:, :, None]
        return np.clip(derived_intervals(self.fit, self.quantities[2], level), lower, upper)

    @property
    def model(self) -> DecayModel:
        """Fitted curve."""
        return self.decay.modes[self.mode].model

    @cached_property
    def indices(self) -> tuple[int, ...]:
        """Positions of the unknowns of the curve in ``fit``, which may have those of other records or modes."""
        return tuple(self.fit.names.index(name) for name in self.decay.modes[self.mode].names)

    @property
    def time(self) -> Array:
        """Times of the samples from the release on (m,), s."""
        return self.decay.time

    @property
    def measured(self) -> Array:
        """Values of the record from the release on (m,), in the unit of the sensor."""
        return self.decay.record.values

    @cached_property
    def residuals(self) -> Array:
        """Fitted less measured values at these times (m,), in the unit of the sensor."""
        return self.decay.at(self.decay.record.time, self.fit.estimates) - self.measured

    @property
    def release_reason(self) -> str:
        """Reason for the start of the decay: the first sample, the end of rest, the end of an excitation, or given."""
        return self.decay.guess.reason

    @property
    def notes(self) -> tuple[str, ...]:
        """Limitations of the record."""
        return self.decay.notes

    @property
    def law(self) -> Law:
        """Fitted damping law."""
        return self.model.law

    @property
    def frequency_law(self) -> FrequencyLaw:
        """Fitted frequency law."""
        return self.model.frequency_law

    @property
    def release_time(self) -> float:
        """Start of the decay in the times of the record, s."""
        return self.decay.release_time

    @property
    def samples(self) -> int:
        """Number of samples from the release on."""
        return len(self.time)

    @property
    def fitted_samples(self) -> int:
        """Number of samples that the fit used."""
        return len(self.decay.fitted.time)

    @property
    def fitted_band(self) -> str:
        """The band to which a long record was reduced, as text; empty if all samples were fitted."""
        if self.fitted_samples == self.samples:
            return ""
        rate = self.fitted_samples / self.samples * (self.samples - 1) / (self.time[-1] - self.time[0])
        return (
            f"fitted as {self.fitted_samples} samples at {rate:.4g} Hz: the frequencies up to {rate / 2:.4g} Hz of the "
            "record, without a loss for what was fitted"
        )

    @cached_property
    def explained_share(self) -> float:
        """Share of the motion from the release on that the law explains, white noise apart; nan for one of several."""
        return explained_share(self)

    @property
    def amplitude_range(self) -> tuple[float, float]:
        """Smallest amplitude that the record shows above its noise, and that at the release."""
        end = self.model.amplitude(self.time[-1:] - self.time[0], *(cs.MX(self.fit.values[i]) for i in self.indices))
        frequency = self.at_amplitude(max(float(cs.evalf(end)), self.amplitude / 100))[0]["frequency"]
        last_period = self.displacement(self.time[self.time > self.time[-1] - 1 / frequency])
        per_amplitude = (2 * np.pi * frequency) ** self.model.sensor.derivatives  # of the record
        visible = max(float(np.ptp(last_period)) / 2, self.residual_rms) / per_amplitude
        smallest = max(visible, self.amplitude / 100)
        return min(smallest, self.amplitude / 2), self.amplitude

    @cached_property
    def ends_of_range(self) -> LawCurve | None:
        """Frequency and damping ratio at both ends of the measured amplitudes; None if neither depends on them."""
        if not self.model.depends_on_amplitude:
            return None
        from problems.decay.law_curve import law_curve  # which needs this class

        return law_curve(self, self.amplitude_range)

    @property
    def residual_rms(self) -> float:
        """Root mean square R of the residuals, Eq. (10), in the unit of the sensor."""
        return root_mean_square(self.residuals)

    @property
    def correlation(self) -> float:
        """Correlation of eta1 and eta2; nan if one of them is at a bound or not estimated."""
        pair = [self.fit.names.index(name) for name in ("eta1", "eta2") if name in self.fit.names]
        return float(self.fit.correlations[pair[0], pair[1]]) if len(pair) == 2 else math.nan

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the record and of the estimates."""
        return (*self.notes, *self.fit.warnings, *limitations(self))

    def displacement(self, time: ArrayLike) -> Array:
        """Return the fitted record, in the unit of its sensor, at times (s) of the record, from the release on."""
        t = array(time, "time").ravel() - self.release_time
        return self.decay.modes[self.mode].at(t, self.fit.estimates)

    def predict(self, record: Measurement) -> RecordPrediction:
        """Compute another decay of the same mode with its estimates, and compare.

        What belongs to the release and the sensor is fitted: amplitude, phase and rest position.

        Raises
        ------
        InputError
            If the record is not usable, has another sensor, or nothing in it oscillates.
        FitError
            If the release cannot be fitted.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> from problems import fit_decay
        >>> time, rng = np.linspace(0.0, 10.0, 1001), np.random.default_rng(0)
        >>> y = np.exp(-0.1 * time) * np.cos(12.0 * time)
        >>> takes = [Measurement(time, a * y + rng.normal(scale=1e-4, size=time.size)) for a in (0.02, 0.03)]
        >>> prediction = fit_decay(takes[0]).predict(takes[1])
        >>> [f"{1e3 * error:.1f} mm" for error in prediction.rms_errors.values()]
        ['0.1 mm']
        """
        return predict_decay(self.fit, self.decay.modes[self.mode : self.mode + 1], self.residual_rms, record)

    @property
    def title(self) -> str:
        """The laws."""
        frequency = "" if self.frequency_law == "constant" else f", frequency {self.frequency_law} in the amplitude"
        rest_law = f" with {self.model.rest}" * (self.model.rest in ("drift", "creep"))
        return f"{self.law} decay{rest_law}{frequency}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        table: dict[str, Any] = {"law": self.law, "frequency_law": self.frequency_law, "rest": self.model.rest}
        errors, intervals, unknown = self.standard_errors, self.intervals(), (math.nan, math.nan)
        for name, quantity in DECAY_QUANTITIES.items():
            suffix = quantity.suffix if self.model.unit(name) == quantity.unit else ""  # then ``units`` has the unit
            table[f"{name}{suffix}"] = finite_or_none(self.values[name])
            table[f"{name}_stderr{suffix}"] = finite_or_none(errors.get(name, math.nan))
            table[f"{name}_interval{suffix}"] = [finite_or_none(end) for end in intervals.get(name, unknown)]
        return {
            **super().to_dict(),
            **table,
            "correlation": finite_or_none(self.correlation),
            "release_time_s": self.release_time,
            "release_reason": self.release_reason,
            f"residual_rms{'_m' * (self.model.sensor.unit == 'm')}": self.residual_rms,
            "against_amplitude": self.ends_of_range.to_dict() if self.ends_of_range else None,
            "explained_share": finite_or_none(self.explained_share),
            "sensor": self.model.sensor.quantity,
            "units": self.units,
            "samples": self.samples,
            "fitted_samples": self.fitted_samples,
        }

    def report(self) -> str:
        """Return the result as text, one line per quantity."""
        rest_terms = REST_TERMS[self.model.rest] or ("offset",)
        names = ["frequency", "damping_ratio", *self.model.terms, "amplitude", *rest_terms]
        lines = [f"{self.title}, {self.samples} samples from {self.release_time:g} s on; 95 % intervals"]
        lines += [f"  {self.fitted_band}"] if self.fitted_band else []
        lines += [f"  {name:<20}{getattr(self, name):>13.6g} {self._uncertainty(name)}" for name in names]
        if curve := self.ends_of_range:
            lines += [f"  {line}" for line in curve.lines()]
        lines.append(f"  {'release':<20}{self.release_time:>13.6g} s  ({self.release_reason})")
        lines.append(f"  {'residual_rms':<20}{self.residual_rms:>13.3g} {self.model.sensor.unit}".rstrip())
        if not math.isnan(self.explained_share):
            lines.append(f"  {'explained':<20}{100 * self.explained_share:>13.4g} % of the motion from the release on")
        lines.append(f"  {'noise':<20}{self.fit.colour()}")
        lines.append(
            f"  {'solution':<20}{self.fit.rank} of {len(self.fit.names)} unknowns free of bounds, condition number "
            f"{self.fit.condition:.3g}; converged after {self.fit.iterations} iterations"
        )
        lines += [f"  {line}" for line in share_lines(self.fit.reported_shares)]
        return "\n".join([*lines, *(f"  note: {warning}" for warning in self.warnings)])

    def _uncertainty(self, name: str) -> str:
        """Return standard error, unit and interval of a quantity as text."""
        unit = self.model.unit(name)
        if name not in self.estimates:
            return f"{unit}  (fixed)".lstrip()
        error, interval = self.standard_errors[name], self.intervals()[name]
        ends = ", ".join(to_width(end, interval[1] - interval[0], 3) for end in interval)
        if math.isnan(error):
            return f"{unit}  [{ends}]  (at its bound)".lstrip()
        return f"{f'+- {error:.2g} {unit}'.rstrip()}  [{ends}]{'  (by profile likelihood)' * (name in self.profiled)}"
