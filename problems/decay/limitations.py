"""Limitations of a decay fit, stated as warnings.

A fit is limited by a short record, by an uncertain damping ratio, by an oscillation that lasts and is stronger than the
decay, such as hum, by residuals that are not noise, and by a law that does not hold over the whole record.  The last is
tested by dividing the record in two where the damping has received half of its information.  With the estimates x_1,
x_2 of the mode from the two parts (``agreement.part_estimates``) and their covariances,

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
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.decay.first_guess import DecayGuess, first_guess
from ancf_casadi.decay.phase import FREQUENCY_TERMS
from ancf_casadi.decay.rest import REST_TERMS
from ancf_casadi.decay.spectrum import peak_frequencies
from ancf_casadi.estimation.agreement import DISAGREE, part_estimates
from ancf_casadi.estimation.fit import Fit, colour_warning
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Mask
from ancf_casadi.support.tables import with_error

if TYPE_CHECKING:
    from problems.decay.result import DecayFit

NOISE_FREE = 1e-6  # residual relative to the amplitude, below which there is no noise
FEW_PERIODS = 5  # of free decay, below which there is a warning
MOST_ORDER, NEAR_ORDER = 5, 0.05  # highest harmonic that is named, and distance of its order from a whole number
IMPRECISE = 0.1  # relative standard error of the damping ratio beyond which there is a warning
DAMPING = ("zeta", "eta1", "eta2", "eta0")  # unknowns whose information divides the record, the first that is free
OF_PARTS = ("e0", "phase", *REST_TERMS["creep"], *FREQUENCY_TERMS["smooth"])  # unknowns that a part may not show alone


def limitations(decay: DecayFit) -> list[str]:
    """Return the limitations of the fit of one record, one sentence each."""
    fit, values = decay.fit, decay.values
    speed = (2 * math.pi * values["frequency"]) ** decay.model.sensor.derivatives
    noise_free = NOISE_FREE * values["amplitude"] * speed
    noisy = math.sqrt(np.mean(fit.residuals[decay.rows] ** 2)) > noise_free
    found = [
        _short(decay),
        _lasting(decay) if noisy else None,
        _uncertain(decay) if noisy else None,
        _unexplained(decay, noise_free),
        _changing(decay) if noisy else None,
    ]
    return [text for text in found if text]


def _short(decay: DecayFit) -> str | None:
    periods = (decay.time[-1] - decay.time[0]) * decay.frequency
    if periods >= FEW_PERIODS:
        return None
    return (
        f"the record is short: {periods:.1f} periods of free decay hardly separate frequency, damping and "
        f"equilibrium; record {FEW_PERIODS} periods or more"
    )


def _lasting(decay: DecayFit) -> str | None:
    """Return a warning if the fitted oscillation lasts, as hum does, and another one in the residuals decays."""
    length = float(decay.time[-1] - decay.time[0])
    if decay.damping_ratio * 2 * math.pi * decay.frequency * length > 0.1:  # otherwise the oscillation lasts
        return None
    other = residual_oscillation(decay)
    if other is None or other.ζ * other.ω * length < 1.0:  # otherwise it decays
        return None
    return (
        f"the fitted oscillation of {decay.frequency:.4g} Hz hardly decays, but another one beside it, of "
        f"{other.ω / (2 * math.pi):.4g} Hz, does: if the former is hum, fit the latter by isolate_mode or the option "
        "--band, or both by fit_modes"
    )


def residual_oscillation(decay: DecayFit) -> DecayGuess | None:
    """Return the strongest oscillation in the residuals of a fit; None if they are noise."""
    try:
        return first_guess(Measurement(decay.time, decay.residuals), release_time=decay.release_time)
    except InputError:
        return None


def _uncertain(decay: DecayFit) -> str | None:
    ζ, error, length = decay.damping_ratio, decay.standard_errors["damping_ratio"], decay.time[-1] - decay.time[0]
    if not error > IMPRECISE * abs(ζ):
        return None
    uncertainty = f"has a standard error of {error / abs(ζ):.0%}"
    if error >= abs(ζ):
        uncertainty = "does not differ significantly from zero"
    advice = "less noise, or a larger release, would help"
    if ζ * 2 * math.pi * length * decay.frequency < 1.0:
        needed = length * (min(error / abs(ζ), 1.0) / IMPRECISE) ** (2 / 3) if ζ else math.inf
        advice = f"the record is too short; {needed:.2g} s would give {IMPRECISE:.0%}"
    return f"the damping ratio {uncertainty}: {advice}"


def _unexplained(decay: DecayFit, noise_free: float) -> str | None:
    """Return a warning if the residuals are not noise: the share of the motion that the law explains, and the rest."""
    found = colour_warning(decay.fit, noise_free=noise_free)
    if found is None or (len(decay.fit.residuals) == decay.rows.stop and len(decay.indices) < len(decay.fit.names)):
        return found  # of several modes, which explain the record together
    measured = decay.displacement(decay.time) - decay.residuals
    rest = float(np.mean(decay.residuals**2) / np.var(measured))
    digits = min(max(-1 - math.floor(math.log10(rest)), 0), 12)
    frequency = peak_frequencies(decay.time, decay.residuals - decay.residuals.mean())[0]
    order = frequency / decay.frequency
    if order < 0.5:
        cause = "a slow motion: compare rest positions"
    elif order < 1.5:
        cause = "near the mode itself: compare laws; a mode close by would look the same"
    elif round(order) <= MOST_ORDER and abs(order - round(order)) < NEAR_ORDER:
        cause = f"{round(order)} times the frequency of the mode: a harmonic of it, or another mode there"
    else:
        cause = "another mode: fit_modes fits both"
    return (
        f"the law explains {100 * (1 - rest):.{digits}f} % of the motion; the rest, {decay.residual_rms:.2g} "
        f"{decay.model.sensor.unit} rms, is not noise but mostly an oscillation of {frequency:.4g} Hz, {cause}; "
        "the standard errors allow for it"
    ).replace("  rms", " rms")


def _changing(decay: DecayFit) -> str | None:
    """Return a warning if the two parts of a record disagree on the mode."""
    fit, rows = decay.fit, decay.rows
    time = decay.time if fit.times is None else decay.release_time + fit.times[rows]
    mode = [k for k in decay.indices if not fit.names[k].startswith(OF_PARTS) and not fit.active_bounds[k]]
    late = late_part(fit, [rows], 1 / 2)
    early = ~late
    early[: rows.start] = early[rows.stop :] = False
    parts = [part_estimates(fit, mask) for mask in (early, late)]
    (first, first_covariance), (second, second_covariance) = parts
    known = [k for k in mode if np.isfinite(first[k] + second[k])]
    if not known:
        return None
    change = (second - first)[known]
    covariance = (first_covariance + second_covariance)[np.ix_(known, known)]
    size = np.sqrt(np.diag(covariance))
    normal = change / size
    square = float(normal @ np.linalg.lstsq(covariance / np.outer(size, size), normal)[0])
    if scipy.special.chdtrc(len(known), square) >= DISAGREE:
        return None
    worst = known[int(np.argmax(np.abs(normal)))]
    name, unit = fit.names[worst], f" {fit.units[worst]}".rstrip()
    split = time[int(np.argmax(late[rows]))]
    before, after = (with_error(values[worst], found[worst, worst] ** 0.5) for values, found in parts)
    return (
        f"the law does not hold over the record: {name} is {before}{unit} up to {split:.4g} s, and {after}{unit} "
        "later; compare laws, or show damping and frequency against amplitude"
    )


def late_part(fit: Fit, parts: Sequence[slice], share: float) -> Mask:
    """Return a mask of the residuals of each record after a share of its information on the damping."""
    mask = np.zeros(len(fit.residuals), dtype=bool)
    named = (k for start in DAMPING for k, name in enumerate(fit.names) if name.startswith(start))
    column = next((k for k in named if not fit.active_bounds[k]), 0)
    for rows in parts:
        information = np.cumsum(fit.jacobian[rows, column] ** 2)
        mask[rows] = information >= share * information[-1]
    return mask
