"""Frequency and damping from a measured free decay, Eq. (10).

With the closed form r of Eq. (9) or Eq. (27), and an offset d where the point comes to rest, the measured displacements
y_i at the times t_i after the release are matched by

    minimise    R = (1/m sum_i (r(t_i) + d - y_i)^2)^1/2

    linear      over omega, zeta, r0, v0, d            with zeta within its bounds
    quadratic   over omega, eta1, eta2, e0, phi, d     with eta1, eta2, e0 >= 0

The scale of each unknown is the change of it that moves the curve by about its own size within the decay: 1/T for
omega, 1/(omega T) for zeta and so on, where T is the length of the record or of the decay, whichever is less.

Standard errors take the residuals to be white; where they are not, the fit says so.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.2; eta2 is in 1/m here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ancf_casadi.decay import DecayGuess, equivalent_damping_ratio, first_guess, linear_decay, quadratic_decay
from ancf_casadi.exceptions import InputError
from ancf_casadi.fit import Fit
from ancf_casadi.inputs import number, vector
from ancf_casadi.measurement import Measurement
from ancf_casadi.nlp import Unknown, least_squares

Law = Literal["linear", "quadratic"]

RATIO_BOUNDS = (0.0, 0.999)
CORRELATED = 0.95  # eta1 and eta2 beyond this are hardly told apart
INDISTINCT = 0.5  # relative standard error of eta2 beyond which it could as well be zero
COLOURED = 0.5  # correlation of successive residuals beyond which they are not noise
ROUNDING = 1e-6  # residual, as a part of the amplitude, below which there is no noise to judge


@dataclass(frozen=True)
class DecayErrors:
    """Standard errors of a decay fit, each in the unit of its quantity.

    Nan where the quantity is at a bound, or not one the law estimates.
    """

    frequency: float
    damping_ratio: float
    eta1: float
    eta2: float
    amplitude: float
    offset: float


@dataclass(frozen=True, eq=False)
class DecayFit:
    """What a free decay tells of a mode.

    A linear decay is a quadratic one with eta1 = 2 zeta omega and eta2 = 0.

    Parameters
    ----------
    law : {"linear", "quadratic"}
        The law fitted.
    frequency : float
        Natural frequency, Hz; the undamped one under the linear law.
    damping_ratio : float
        Damping ratio; under the quadratic law the equivalent one at ``amplitude``.
    eta1, eta2 : float
        Linear (1/s) and quadratic (1/m) damping coefficient.
    amplitude : float
        Amplitude about the offset at the release, m: that of the envelope of Eq. (9), or e0 of Eq. (27).
    offset : float
        Where the point comes to rest, m.
    release_time : float
        When the decay begins, s, in the times of the record.
    correlation : float
        Correlation of eta1 and eta2; nan under the linear law.
    standard_errors : DecayErrors
        How sure these are.
    warnings : tuple of str
        What to know before using them.
    fit : Fit
        The unknowns of the law, with their covariance.
    """

    law: Law
    frequency: float
    damping_ratio: float
    eta1: float
    eta2: float
    amplitude: float
    offset: float
    release_time: float
    correlation: float
    standard_errors: DecayErrors
    warnings: tuple[str, ...]
    fit: Fit

    @property
    def samples(self) -> int:
        """How many samples were fitted."""
        return len(self.fit.residuals)

    @property
    def residual_rms(self) -> float:
        """R of Eq. (10), m."""
        return self.fit.residual_rms

    def displacement(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the fitted displacement (m) at times (s) of the record, from the release on."""
        t = cs.DM(np.asarray(time, dtype=float) - self.release_time)
        curve = CLOSED_FORMS[self.law](cs.MX(t), *(cs.MX(value) for value in self.fit.values))
        return np.asarray(cs.evalf(curve)).ravel()

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for what is not known."""
        errors = self.standard_errors
        numbers = {
            "frequency_hz": self.frequency,
            "frequency_stderr_hz": errors.frequency,
            "damping_ratio": self.damping_ratio,
            "damping_ratio_stderr": errors.damping_ratio,
            "eta1": self.eta1,
            "eta1_stderr": errors.eta1,
            "eta2_per_m": self.eta2,
            "eta2_stderr_per_m": errors.eta2,
            "correlation": self.correlation,
            "amplitude_m": self.amplitude,
            "amplitude_stderr_m": errors.amplitude,
            "offset_m": self.offset,
            "offset_stderr_m": errors.offset,
            "release_time_s": self.release_time,
            "residual_rms_m": self.residual_rms,
        }
        finite = {key: value if math.isfinite(value) else None for key, value in numbers.items()}
        return {"law": self.law, **finite, "samples": self.samples, "warnings": list(self.warnings)}

    def report(self) -> str:
        """Return the result as text, a line each."""
        rows = [("frequency", "Hz"), ("damping_ratio", ""), ("amplitude", "m"), ("offset", "m")]
        rows[2:2] = [("eta1", "1/s"), ("eta2", "1/m")] if self.law == "quadratic" else []
        errors = asdict(self.standard_errors)
        lines = [f"{self.law} decay, {self.samples} samples from {self.release_time:g} s on"]
        lines += [
            f"  {name:<14}{getattr(self, name):>13.6g} +- {errors[name]:.2g} {unit}".rstrip() for name, unit in rows
        ]
        lines.append(f"  {'residual_rms':<14}{self.residual_rms:>13.3g} m")
        return "\n".join([*lines, *(f"  note: {warning}" for warning in self.warnings)])


def fit_decay(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    law: Law = "linear",
    offset: bool = True,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
) -> DecayFit:
    """Fit a free decay.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    law : {"linear", "quadratic"}
        Eq. (9) or Eq. (27).
    offset : bool
        Whether the point may come to rest elsewhere than at 0.
    release_time : float, optional
        When the free decay begins, s; found in the record if not given.
    ratio_bounds : (float, float)
        Bounds of the damping ratio under the linear law, above -1 and below 1.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, or an option is unknown.
    FitError
        If the fit does not converge.
    """
    if law not in get_args(Law):
        raise InputError(f"must be one of {', '.join(get_args(Law))}, got {law!r}", "law")
    lower, upper = vector(ratio_bounds, "ratio_bounds")
    if not -1.0 < lower < upper < 1.0:
        raise InputError(f"must be in order and between -1 and 1, got ({lower:g}, {upper:g})", "ratio_bounds")
    record = _record(time, displacement)
    start = None if release_time is None else number(release_time, "release_time")
    guess = first_guess(record, release_time=start, offset=offset)

    release = float(record.time[guess.release])
    t, y = cs.MX(cs.DM(record.time[guess.release :] - release)), cs.DM(record.displacement[guess.release :])
    unknowns = _linear_unknowns(guess, (lower, upper)) if law == "linear" else _quadratic_unknowns(guess)
    if offset:
        unknowns.append(Unknown("offset", guess.offset, guess.amplitude, unit="m"))
    fit = least_squares(lambda *x: CLOSED_FORMS[law](t, *x) - y, unknowns)
    values, errors = fit.derived(_linear_quantities if law == "linear" else _quadratic_quantities)
    frequency, damping_ratio, eta1, eta2, amplitude, level = values.tolist()
    return DecayFit(
        law=law,
        frequency=frequency,
        damping_ratio=damping_ratio,
        eta1=eta1,
        eta2=eta2,
        amplitude=amplitude,
        offset=level,
        release_time=release,
        correlation=fit.correlation("eta1", "eta2") if law == "quadratic" else math.nan,
        standard_errors=DecayErrors(*errors.tolist()),
        warnings=_warnings(law, fit, guess.amplitude),
        fit=fit,
    )


def _record(time: Measurement | ArrayLike, displacement: ArrayLike | None) -> Measurement:
    if isinstance(time, Measurement):
        if displacement is not None:
            raise InputError("is in the record already", "displacement")
        return time
    if displacement is None:
        raise InputError("is missing", "displacement")
    return Measurement(time, displacement)


def _linear(t: cs.MX, ω: cs.MX, ζ: cs.MX, r0: cs.MX, v0: cs.MX, offset: cs.MX | float = 0.0) -> cs.MX:
    return linear_decay(t, ω, ζ, r0, v0) + offset


def _quadratic(t: cs.MX, ω: cs.MX, η1: cs.MX, η2: cs.MX, e0: cs.MX, φ: cs.MX, offset: cs.MX | float = 0.0) -> cs.MX:
    return quadratic_decay(t, ω, η1, η2, e0, φ) + offset


CLOSED_FORMS: Mapping[Law, Callable[..., cs.MX]] = {"linear": _linear, "quadratic": _quadratic}


def _linear_unknowns(guess: DecayGuess, ratio_bounds: tuple[float, float]) -> list[Unknown]:
    lower, upper = ratio_bounds
    ω, A, T = guess.ω, guess.amplitude, guess.duration
    return [
        Unknown("omega", ω, 1 / T, lower=0.0, unit="rad/s"),
        Unknown("zeta", min(max(guess.ζ, lower), upper), 1 / (ω * T), lower=lower, upper=upper),
        Unknown("r0", guess.r0, A, unit="m"),
        Unknown("v0", guess.v0, A * ω, unit="m/s"),
    ]


def _quadratic_unknowns(guess: DecayGuess) -> list[Unknown]:
    """Return the unknowns of Eq. (27), half of the guessed damping being put down to each coefficient."""
    ω, ζ, A, T = guess.ω, guess.ζ, guess.amplitude, guess.duration
    drag = 3 * math.pi / (4 * A)  # eta2 that has an equivalent ratio of 1
    return [
        Unknown("omega", ω, 1 / T, lower=0.0, unit="rad/s"),
        Unknown("eta1", ζ * ω, 1 / T, lower=0.0, unit="1/s"),
        Unknown("eta2", ζ / 2 * drag, drag / (ω * T), lower=0.0, unit="1/m"),
        Unknown("e0", A, A, lower=0.0, unit="m"),
        Unknown("phase", guess.phase, unit="rad"),
    ]


def _linear_quantities(ω: cs.MX, ζ: cs.MX, r0: cs.MX, v0: cs.MX, offset: cs.MX | float = 0.0) -> cs.MX:
    """Return frequency, damping ratio, eta1, eta2, amplitude and offset."""
    amplitude = cs.sqrt(r0**2 + ((v0 + ζ * ω * r0) / (ω * cs.sqrt(1 - ζ**2))) ** 2)
    return cs.vertcat(ω / (2 * math.pi), ζ, 2 * ζ * ω, 0, amplitude, offset)


def _quadratic_quantities(ω: cs.MX, η1: cs.MX, η2: cs.MX, e0: cs.MX, φ: cs.MX, offset: cs.MX | float = 0.0) -> cs.MX:
    """Return frequency, damping ratio, eta1, eta2, amplitude and offset."""
    return cs.vertcat(ω / (2 * math.pi), equivalent_damping_ratio(η1, η2, ω, e0), η1, η2, e0, offset)


def _warnings(law: Law, fit: Fit, amplitude: float) -> tuple[str, ...]:
    bound = zip(fit.names, fit.values, fit.at_bound, strict=True)
    warnings = [f"{name} is at its bound {value:g}" for name, value, there in bound if there]
    if law == "quadratic":
        correlation = fit.correlation("eta1", "eta2")
        if abs(correlation) > CORRELATED:
            warnings.append(
                f"eta1 and eta2 correlate at {correlation:.3f}: the record hardly tells them apart; a longer one, or a "
                "larger amplitude, would"
            )
        uncertainty = fit.standard_error("eta2")
        if uncertainty > INDISTINCT * fit["eta2"]:
            warnings.append(f"eta2 cannot be told from zero: {fit['eta2']:.2g} +- {uncertainty:.2g} 1/m")
    r = fit.residuals
    repeated, total = float(r[1:] @ r[:-1]), float(r @ r)
    if fit.residual_rms > ROUNDING * amplitude and repeated > COLOURED * total:
        warnings.append(
            f"successive residuals correlate at {repeated / total:.2f}: they are not noise, the law does not tell all, "
            "and the standard errors are too small"
        )
    return tuple(warnings)
