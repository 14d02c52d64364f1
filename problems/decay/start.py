"""Starting values of a decay fit, from amplitude and phase over time.

With the track A_k, theta_k (``ancf_casadi.decay.track``), the integrals of the slow flow are linear in its unknowns,

    ln A = ln e0 - c int 1/A dt - a t - b int A dt,    theta = phi + omega t + omega k int delta(A)/k dt,

and linear regressions with the weights A_k^2 give all of them; a term of the damping that would be negative is left
out, and so is a change of the frequency that is not evident.  The exponent of the power law is the best multiple of a
half, with ln A = ln e0 - D int A^(p-1) dt; the exponent of the frequency, or its corner, is the best of ``SHAPES``.  A
peak of the spectrum gives one frequency only: if the frequency depends on the amplitude, it is off by many cycles at
one end of a long record, and a fit from there ends in another minimum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ancf_casadi.decay.evidence import evident
from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.track import Track, track
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from problems.decay.laws import DECAY_TERMS, EXPONENTS, DecayModel

SHAPES: Mapping[FrequencyLaw, Sequence[tuple[float]]] = {  # exponents, and logarithms of the corner, to start from
    "power": [(q,) for q in (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)],
    "logarithmic": [(corner,) for corner in (-8.0, -6.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0)],
}


def of_motion(guess: DecayGuess, derivatives: int) -> DecayGuess:
    """Return the guess of the motion from that of its velocity or acceleration, with offset and drift as measured."""
    amplitude, phase = guess.amplitude / guess.ω**derivatives, guess.phase - derivatives * math.pi / 2
    return replace(guess, amplitude=amplitude, phase=phase)


def starting_values(model: DecayModel, decay: Measurement, guess: DecayGuess) -> dict[str, float]:
    """Return values of unknowns by name from a record after the release; none if noise hides it too early."""
    time = decay.time
    derivatives = model.sensor.derivatives  # each multiplies the amplitude by about omega and turns the phase
    about = (decay.values - guess.offset - guess.drift * time) / guess.ω**derivatives
    found = track(time, about, guess.ω * math.sqrt(1 - guess.ζ**2))
    if len(found.time) < 6:  # twice the unknowns of a regression
        return {}
    ω, bending, φ = _phase(found, model)
    φ -= derivatives * math.pi / 2
    e0, damping = _damping(found, model, ω)
    if not ω > 0.0:
        return {}
    values = {"omega": ω, **damping, **bending, "e0": e0, "phase": math.remainder(φ, 2 * math.pi)}
    ζ = damping.get("zeta", 0.0)
    values["r0"] = e0 * math.cos(φ)
    values["v0"] = -e0 * ω * (ζ * math.cos(φ) + math.sqrt(max(0.0, 1 - ζ**2)) * math.sin(φ))
    return values


def _phase(found: Track, model: DecayModel) -> tuple[float, dict[str, float], float]:
    """Return omega (rad/s), the unknowns of the frequency law if a change is evident, and the phase at the release."""
    A = found.amplitude
    line = [np.ones(len(A)), found.time]
    (φ, ω), left = _regression(line, found.phase, A)
    bent = []
    for shape in SHAPES.get(model.frequency_law, ((),) * model.bends):
        (φ_0, ω_0, change), less = _regression([*line, found.since_start(model.change(A, 1.0, *shape))], found.phase, A)
        bent.append((less, shape, φ_0, ω_0, change))
    if bent:
        less, shape, φ_0, ω_0, change = min(bent)
        if evident(left, less, len(A), 1 + len(shape), float(A @ A)):
            return ω_0, dict(zip(model.frequency_terms, (change / ω_0, *shape), strict=True)), φ_0
    return ω, {}, φ


def _damping(found: Track, model: DecayModel, ω: float) -> tuple[float, dict[str, float]]:
    """Return the amplitude at the release, and the unknowns of the damping."""
    A = found.amplitude
    if model.law == "power":
        return _power(found, model.reference, ω)
    if model.law == "linear":
        return _terms(found, {"zeta": ω * found.time})
    losses = {
        "eta1": found.time / 2,
        "eta2": 4 * ω / (3 * math.pi) * found.since_start(A),
        "eta0": 2 / (math.pi * ω) * found.since_start(1 / A),
    }
    return _terms(found, {name: losses[name] for name in DECAY_TERMS[model.law]})


def _terms(found: Track, losses: Mapping[str, Array]) -> tuple[float, dict[str, float]]:
    """Return the amplitude at the release, and the coefficients of losses of ln A; none of these is negative."""
    A, chosen = found.amplitude, dict(losses)
    level, values = float(np.log(A[0])), dict.fromkeys(losses, 0.0)
    while chosen:
        (level, *terms), _ = _regression([np.ones(len(A)), *(-loss for loss in chosen.values())], np.log(A), A)
        values |= dict(zip(chosen, terms, strict=True))
        parts = {name: values[name] * loss[-1] for name, loss in chosen.items()}
        lowest = min(parts, key=lambda name: parts[name])
        if parts[lowest] >= 0.0:
            break
        values[lowest] = 0.0
        del chosen[lowest]
    total = sum(values[name] * loss[-1] for name, loss in losses.items())
    # of the damping, with which a term starts that the regression finds negative
    return math.exp(level), {name: max(values[name], 0.02 * total / loss[-1]) for name, loss in losses.items()}


def _power(found: Track, reference: float, ω: float) -> tuple[float, dict[str, float]]:
    """Return the amplitude at the release, and damping ratio and exponent of the power law."""
    A, best = found.amplitude, (math.inf, 0.0, 0.0, 1.0)
    for p in np.arange(EXPONENTS[0], EXPONENTS[1] + 0.5, 0.5).tolist():
        basis = [np.ones(len(A)), -found.since_start((A / reference) ** (p - 1))]
        (level, rate), left = _regression(basis, np.log(A), A)
        best = min(best, (left, level, rate, p))
    _, level, rate, p = best
    return math.exp(level), {"zeta": rate / ω, "exponent": p}


def _regression(columns: list[Array], y: Array, weight: Array) -> tuple[list[float], float]:
    """Return the coefficients of columns that fit y best, and the sum of squares of weight times what is left."""
    basis = np.column_stack(columns) * weight[:, None]
    length = np.linalg.norm(basis, axis=0)
    found = np.linalg.lstsq(basis / length, y * weight)[0] / length
    return found.tolist(), float(np.sum((y * weight - basis @ found) ** 2))
