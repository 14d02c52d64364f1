"""Limitations of a decay fit, stated as warnings.

A fit is limited by a short record, by an uncertain damping ratio, by an oscillation that lasts and is stronger than the
decay, such as hum, by residuals that are not noise, and by a law that does not hold over the whole record.  The last is
tested by dividing the record in two where the damping has received half of its information.  With the estimates x_1,
x_2 of the mode from the two parts (``agreement.subset_estimates``) and their covariances,

    (x_1 - x_2)' (C_1 + C_2)^-1 (x_1 - x_2)

follows the chi-squared distribution if the law holds.  Otherwise the errors allow for the difference (``agreement``).
If the record is shorter than the decay, the standard error of the damping is proportional to length^(-3/2), which gives
the length that would be enough.

References
----------
G. C. Chow, Tests of equality between sets of coefficients in two linear regressions, Econometrica 28 (1960).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.decay.first_guess import DecayGuess, first_guess
from ancf_casadi.decay.release import MAX_UNEXPLAINED, unexplained_before, unexplained_share
from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.decay.smooth import SMOOTH_DAMPING, SMOOTH_FREQUENCY
from ancf_casadi.decay.spectrum import oscillating_power, peak_frequencies
from ancf_casadi.estimation.agreement import DISAGREE, subset_estimates
from ancf_casadi.estimation.fit import colour_warning
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.tables import with_error
from problems.decay.block import late_residuals
from problems.decay.free_decay import NOISE_FREE

if TYPE_CHECKING:
    from problems.decay.result import DecayFit

MIN_EXPLAINED = 0.5  # share of the motion, below which a fit is refused
MIN_RESOLUTION_STEPS = 1.4  # amplitude over the resolution: a square wave of three levels has 4/pi = 1.27
DITHER = 0.35  # residuals over the resolution, beyond which noise makes up for few steps
MAX_UNEXPLAINED_BEFORE = 0.15  # unexplained share of the motion before the decay, beyond which it is random
SMALL_UNEXPLAINED = 0.003  # unexplained share of the decay, beyond which a third of the share before is allowed
DETECTED_REASONS = ("the first sample", "the end of")  # reasons for a release that the record shows
GROWS = "the oscillation grows"
FIRST_PERIODS = 2  # in which a fast pull ends before the release
FEW_PERIODS = 5  # of free decay, below which there is a warning
MAX_ORDER, ORDER_TOLERANCE = 5, 0.05  # highest harmonic that is named, and distance of its order from a whole number
IMPRECISE = 0.1  # relative standard error of the damping ratio beyond which there is a warning
POORLY_DETERMINED = (
    "e0",
    "phase",
    *REST_TERMS["creep"],
    *SMOOTH_FREQUENCY.names,
    *SMOOTH_DAMPING.names,
)  # unknowns that a part may not show alone


def limitations(result: DecayFit) -> list[str]:
    """Return the limitations of the fit of one record, one sentence each."""
    fit, values = result.fit, result.values
    noise_free = NOISE_FREE * values["amplitude"] * _speed(result)
    noisy = math.sqrt(np.mean(fit.residuals[result.rows] ** 2)) > noise_free
    warnings = [
        _length_warning(result),
        _hum_warning(result) if noisy else None,
        _precision_warning(result) if noisy else None,
        _residual_warning(result, noise_free),
        _law_change_warning(result) if noisy else None,
    ]
    return [text for text in warnings if text]


def _speed(result: DecayFit) -> float:
    """Return the amplitude of the record over that of the displacement."""
    return float((2 * math.pi * result.frequency) ** result.model.sensor.derivatives)


def _length_warning(result: DecayFit) -> str | None:
    """Return a warning if a record has few periods."""
    periods = (result.time[-1] - result.time[0]) * result.frequency
    if periods >= FEW_PERIODS:
        return None
    return (
        f"the record is short: {periods:.1f} periods of free decay barely separate frequency, damping and "
        f"offset; record {FEW_PERIODS} periods or more"
    )


def _hum_warning(result: DecayFit) -> str | None:
    """Return a warning if the fitted oscillation lasts, as hum does, and another one in the residuals decays."""
    length = float(result.time[-1] - result.time[0])
    if result.damping_ratio * 2 * math.pi * result.frequency * length > 0.1:  # otherwise the oscillation lasts
        return None
    residual = residual_oscillation(result)
    if residual is None or residual.ζ * residual.ω * length < 1.0:  # otherwise it decays
        return None
    return (
        f"the fitted oscillation of {result.frequency:.4g} Hz hardly decays, but another one of "
        f"{residual.ω / (2 * math.pi):.4g} Hz does: if the first is hum, isolate the second with isolate_mode or "
        "--band, or fit both with fit_modes"
    )


def residual_oscillation(result: DecayFit) -> DecayGuess | None:
    """Return the strongest oscillation in the residuals of a fit; None if they are noise."""
    try:
        return first_guess(Measurement(result.time, result.residuals), release_time=result.release_time)
    except InputError:
        return None


def _precision_warning(result: DecayFit) -> str | None:
    """Return a warning if the damping ratio is uncertain, with the length of a record that would be enough."""
    ζ, error, length = result.damping_ratio, result.standard_errors["damping_ratio"], result.time[-1] - result.time[0]
    if not error > IMPRECISE * abs(ζ):
        return None
    uncertainty = f"has a standard error of {error / abs(ζ):.0%}"
    if error >= abs(ζ):
        uncertainty = "does not differ significantly from zero"
    advice = "less noise, or a larger release, would help"
    if ζ * 2 * math.pi * length * result.frequency < 1.0:
        needed = length * (min(error / abs(ζ), 1.0) / IMPRECISE) ** (2 / 3) if ζ else math.inf
        advice = f"the record is too short; {needed:.2g} s would give {IMPRECISE:.0%}"
    return f"the damping ratio {uncertainty}: {advice}"


def explained_share(result: DecayFit) -> float:
    """Return the share of the oscillation from the release on that the law explains; nan for one of several modes.

    White noise is no oscillation, nor is a motion slower than half the frequency of the mode.
    """
    if len(result.decay.modes) > 1:
        return math.nan  # several modes explain the record together
    motion = float(np.var(result.measured + result.residuals))
    unexplained = oscillating_power(result.time, result.residuals, result.frequency / 2)
    return motion / (motion + unexplained) if motion else 0.0


def refuse_unexplained(result: DecayFit) -> None:
    """Raise a FitError if the decay explains less than half of its motion, or the record cannot show it.

    The latter is the case for a random response, and for an oscillation of few steps of the resolution.
    """
    share = result.explained_share
    if math.isnan(share):  # one of several modes
        return
    step, size = result.decay.resolution, result.amplitude * _speed(result)
    if size < MIN_RESOLUTION_STEPS * step and result.residual_rms < DITHER * step:
        raise FitError(
            f"the oscillation is {size / step:.1f} steps of {f'{step:.2g} {result.model.sensor.unit}'.rstrip()} large, "
            "the resolution of the record, which hide its decay; measure with a finer resolution or a larger release"
        )
    since = f"from {result.release_time:g} s on"
    residuals_near_mode = share < MIN_EXPLAINED and 0.5 < _residual_frequency(result) / result.frequency < 1.5
    if result.release_reason.startswith(DETECTED_REASONS) and (residuals_near_mode or _is_random(result)):
        growth = "".join(f", or {note.partition(':')[0]}" for note in result.notes if note.startswith(GROWS))
        raise FitError(
            f"the record looks like a response to a random excitation, not a free decay{growth}: a decay {since} "
            f"explains {100 * share:.0f} % of the motion there, and nothing like it the rest; if the record "
            "holds a free decay, give the time of its release"
        )
    if share < MIN_EXPLAINED:
        raise FitError(
            f"a decay of {result.frequency:.4g} Hz explains only {100 * share:.0f} % of the motion {since}, and the "
            f"residuals oscillate at {_residual_frequency(result):.4g} Hz: fit_modes fits several modes; if an "
            "excitation goes on, give the time of the release"
        )


def _is_random(result: DecayFit) -> bool:
    """Return whether free modes fail to explain the decay, or rest and a harmonic excitation the record before it."""
    ω, source, before = 2 * math.pi * result.frequency, result.decay.source, result.decay.guess.release
    share = 1 - result.explained_share
    free = unexplained_share(result.time, result.measured, ω) if share > SMALL_UNEXPLAINED else 0.0
    if share > MAX_UNEXPLAINED and free > min(MAX_UNEXPLAINED, share / 3):  # another law or mode would explain more
        return True
    forced, unforced = unexplained_before(source.time[:before], source.values[:before], ω, result.damping_ratio * ω)
    decay_power = float(np.var(result.measured + result.residuals))
    after_rest = result.release_reason == "the end of rest"
    allowed = MAX_UNEXPLAINED_BEFORE if free <= SMALL_UNEXPLAINED else MAX_UNEXPLAINED_BEFORE / 3
    motion = before * (forced + unforced) + result.samples * decay_power
    return before * (unforced + after_rest * forced) > allowed * motion


def _residual_frequency(result: DecayFit) -> float:
    """Return the frequency (Hz) of the strongest oscillation in the residuals."""
    return peak_frequencies(result.time, result.residuals - result.residuals.mean())[0]


def _residual_warning(result: DecayFit, noise_free: float) -> str | None:
    """Return a warning if the residuals are not noise: their share of the motion, and the likely cause."""
    warning = colour_warning(result.fit, noise_free=noise_free)
    if warning is None or math.isnan(result.explained_share):
        return warning
    residual = f"{result.residual_rms:.2g} {result.model.sensor.unit}".rstrip()
    if _is_rounded(result):
        step = f"{result.decay.resolution:.2g} {result.model.sensor.unit}".rstrip()
        return (
            f"the residuals ({residual} rms) are quantisation noise of a record with steps of {step}; the standard "
            "errors allow for their correlation"
        )
    frequency, since = _residual_frequency(result), (result.time - result.time[0]) * result.frequency
    order, squares = frequency / result.frequency, result.residuals**2
    if order < 0.5:
        cause = "a slow motion: compare rest positions"
    elif order < 1.5:
        cause = "near the mode itself: compare laws; a mode close by would look the same"
    elif round(order) <= MAX_ORDER and abs(order - round(order)) < ORDER_TOLERANCE:
        cause = f"{round(order)} times the frequency of the mode: a harmonic of it, or another mode there"
    else:
        cause = "another mode: fit_modes fits both"
    if since[-1] > FEW_PERIODS and squares[since < FIRST_PERIODS].sum() > squares.sum() / 2:
        cause += "; most of it lies in the first two periods: if they hold a pull, give a later release_time"
    return (
        f"the residuals ({residual} rms, {100 * (1 - result.explained_share):.2g} % of the motion) are not noise: they "
        f"oscillate at {frequency:.4g} Hz, {cause}; the standard errors allow for it"
    )


def _is_rounded(result: DecayFit) -> bool:
    """Return whether the residuals are as small as those of rounding to the resolution of the record."""
    return result.residual_rms < result.decay.resolution / 2


def _law_change_warning(result: DecayFit) -> str | None:
    """Return a warning if the two parts of a record disagree on the mode by more than rounding explains."""
    if _is_rounded(result):
        return None
    fit, rows = result.fit, result.rows
    time = result.time if fit.times is None else result.release_time + fit.times[rows]
    indices = [k for k in result.indices if not fit.names[k].startswith(POORLY_DETERMINED) and not fit.active_bounds[k]]
    is_late = late_residuals(fit, [rows], 1 / 2)
    is_early = ~is_late
    is_early[: rows.start] = is_early[rows.stop :] = False
    parts = [subset_estimates(fit, mask) for mask in (is_early, is_late)]
    (first, first_covariance), (second, second_covariance) = parts
    determined = [k for k in indices if np.isfinite(first[k] + second[k])]
    if not determined:
        return None
    change = (second - first)[determined]
    C = (first_covariance + second_covariance)[np.ix_(determined, determined)]
    size = np.sqrt(np.diag(C))
    normalised = change / size
    chi_squared = float(normalised @ np.linalg.lstsq(C / np.outer(size, size), normalised)[0])
    if scipy.special.chdtrc(len(determined), chi_squared) >= DISAGREE:
        return None
    worst = determined[int(np.argmax(np.abs(normalised)))]
    name, unit, factor = fit.unknowns[worst].report
    split = time[int(np.argmax(is_late[rows]))]
    before, after = (
        with_error(factor * values[worst], factor * covariance[worst, worst] ** 0.5, unit)
        for values, covariance in parts
    )
    return (
        f"the law does not hold over the record: {name} is {before} up to {split:.4g} s, and {after} "
        "later; compare laws, or show damping and frequency against amplitude"
    )
