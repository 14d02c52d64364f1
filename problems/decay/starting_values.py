"""Starting values of a decay fit, from amplitude and phase over time.

With the track A_k, theta_k (``decay.track``), the integrals of the slow flow are linear in its unknowns,

    ln A = ln e0 - c int 1/A dt - a t - b int A dt,    theta = phi + omega t + omega k int delta(A)/k dt,

and linear regressions with the weights A_k^2 give all of them; a damping term that would be negative is omitted, and so
is a change of the frequency that is not evident.  The exponent of the power law is the best multiple of a half, with
ln A = ln e0 - D int A^(p-1) dt; the exponent of the frequency, or its corner, is the best of ``FREQUENCY_STARTS``.  A
peak of the spectrum gives one frequency only: if the frequency depends on the amplitude, the phase is off by many
cycles at one end of a long record, and a fit from there ends in another minimum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ancf_casadi.decay.bic import larger_model_is_evident
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.track import (
    Track,
    cumulative_integral,
    fit_loss_rates,
    track_oscillation,
    weighted_least_squares,
)
from problems.decay.free_decay import FreeDecay
from problems.decay.laws import DAMPING_TERMS, DecayModel, Law

DAMPING_STARTS: Mapping[Law, Sequence[tuple[float]]] = {"power": [(p / 2,) for p in range(9)]}  # exponents
FREQUENCY_STARTS: Mapping[FrequencyLaw, Sequence[tuple[float]]] = {  # exponents, and logarithms of the corner
    "power": [(q,) for q in (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)],
    "logarithmic": [(corner,) for corner in (-8.0, -6.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0)],
}

MIN_SPAN = 3.0  # of amplitudes: at 1, the steps of a smooth frequency would coincide
# Least amplitude that a record shows, over that of the last window in which noise leaves it visible.  At 1,
# test_a_smooth_frequency_reaches_to_half_the_smallest_visible_amplitude fails.
MIN_VISIBLE = 0.5


def starting_values(model: DecayModel, decay: FreeDecay) -> dict[str, float]:
    """Return values of unknowns by name from a decay; none if its track is too short."""
    derivatives = model.sensor.derivatives  # each multiplies the amplitude by about omega and turns the phase
    track = _track(decay, decay.guess.ω**derivatives)
    if len(track.time) < 6:  # twice the unknowns of a regression
        return {}
    ω, frequency_terms, φ = _fit_frequency(track, model)
    φ -= derivatives * math.pi / 2
    e0, damping = _fit_damping(track, model, ω)
    if not ω > 0.0:
        return {}
    return {"omega": ω, **damping, **frequency_terms, "e0": e0, "phase": math.remainder(φ, 2 * math.pi)}


def select_frequency_law(decay: FreeDecay, laws: Sequence[FrequencyLaw]) -> FrequencyLaw:
    """Return the frequency law that the track of a decay shows; the first if it is too short, or shows none."""
    track = _track(decay)
    if len(track.time) < 6:  # as above
        return laws[0]
    A = track.amplitude
    misfits = [_fit_phase(track, DecayModel("linear", frequency_law=law, reference=float(A.max())))[0] for law in laws]
    best = int(np.argmin(misfits))
    return laws[best] if larger_model_is_evident(misfits[0], misfits[best], len(A), 2, float(A @ A)) else laws[0]


def amplitude_span(decays: Sequence[FreeDecay]) -> float:
    """Return the largest amplitude of decays over the smallest that matters: half of the smallest visible one.

    Windows that noise hides one by one still contribute together; a decay may end before it reaches that amplitude.
    """
    largest, smallest = 0.0, math.inf
    for decay in decays:
        track = _track(decay)
        if len(track.time):
            hidden = max(decay.fitted.time[-1] - track.time[-1], 0.0)  # by noise, s
            faded = math.exp(-decay.guess.ζ * decay.guess.ω * hidden)
            largest = max(largest, float(track.amplitude.max()))
            smallest = min(smallest, max(MIN_VISIBLE, faded) * float(track.amplitude.min()))
    return max(largest / smallest, MIN_SPAN)


def _track(decay: FreeDecay, unit: float = 1.0) -> Track:
    """Return the oscillation of a decay about its rest position, divided by a unit of the amplitude."""
    time, guess = decay.fitted.time, decay.guess
    oscillation = (decay.fitted.values - guess.equilibrium(time)) / unit
    return track_oscillation(time, oscillation, guess.ω * math.sqrt(1 - guess.ζ**2))


def _fit_phase(track: Track, model: DecayModel) -> tuple[float, tuple[float, ...], list[float]]:
    """Fit a frequency law to the phase; return the misfit, the nonlinear unknown, and phase, omega and change."""
    A, fits = track.amplitude, []
    for nonlinear in FREQUENCY_STARTS.get(model.frequency_law, ((),)):
        changes = model.unit_changes(A, *nonlinear)
        columns = [np.ones(len(A)), track.time, *(cumulative_integral(track.time, change) for change in changes)]
        coefficients, misfit = weighted_least_squares(columns, track.phase, A)
        fits.append((misfit, nonlinear, coefficients))
    return min(fits)


def _fit_frequency(track: Track, model: DecayModel) -> tuple[float, dict[str, float], float]:
    """Return omega (rad/s), the unknowns of the frequency law if a change is evident, and the phase at the release."""
    A = track.amplitude
    constant_misfit, _, (φ, ω) = _fit_phase(track, replace(model, frequency_law="constant"))
    if model.frequency_varies:
        misfit, nonlinear, (φ_0, ω_0, *changes) = _fit_phase(track, model)
        if larger_model_is_evident(constant_misfit, misfit, len(A), len(model.frequency_terms), float(A @ A)):
            values = (*(change / ω_0 for change in changes), *nonlinear)
            return ω_0, dict(zip(model.frequency_terms, values, strict=True)), φ_0
    return ω, {}, φ


def _fit_damping(track: Track, model: DecayModel, ω: float) -> tuple[float, dict[str, float]]:
    """Return the amplitude at the release, and the unknowns of the damping."""
    A, names, fits = track.amplitude, DAMPING_TERMS[model.law], []
    for shape in DAMPING_STARTS.get(model.law, ((),)):
        losses = [cumulative_integral(track.time, rate) for rate in model.term_rates(A, ω, *shape)]
        log_start, coefficients, misfit = fit_loss_rates(A, losses)
        fits.append((misfit, log_start, coefficients, [float(loss[-1]) for loss in losses], shape))
    _, log_start, coefficients, final_losses, shape = min(fits)
    # of the damping, with which a term starts that the regression finds negative
    least = 0.02 * float(np.dot(coefficients, final_losses))
    starts = [max(value, least / loss) for value, loss in zip(coefficients, final_losses, strict=True)]
    return math.exp(log_start), dict(zip((*names, "exponent"), (*starts, *shape), strict=False))
