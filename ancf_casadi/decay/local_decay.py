"""The decay in a short segment of a record, without a damping law.

With tau from the middle of a segment, a decay and other oscillations of known frequencies are

    y = Re((z0 + z1 tau) exp((i omega - lambda) tau)) + d + sum Re(w_j exp(i omega_j tau))

and z0, z1, d and w_j follow from linear least squares.  To first order, Re(z1/z0) is the error of the decay rate
lambda, and -Im(z1/z0) that of the frequency omega.  Three rounds of

    lambda <- lambda - Re(z1/z0),    omega <- omega + Im(z1/z0)

make z1 vanish.  Then |z0| is the amplitude in the middle of the segment, and lambda = -d(ln A)/dt there, under any law.

References
----------
M. Feldman, Hilbert Transform Applications in Mechanical Vibration, Wiley (2011).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array


@dataclass(frozen=True)
class LocalDecay:
    """Decay in the middle of a segment, with standard errors for white noise of standard deviation 1."""

    λ: float  # decay rate, 1/s
    ω: float  # damped natural frequency, rad/s
    amplitude: float  # in the unit of the record
    λ_error: float
    ω_error: float
    amplitude_error: float
    misfit: float  # sum of the squared residuals


def local_decay(τ: Array, y: Array, λ: float, ω: float, other_frequencies: Sequence[float] = ()) -> LocalDecay | None:
    """Return the decay in a segment, from a first guess of rate and frequency (rad/s); None if none is plausible."""
    background = np.column_stack([np.ones(len(τ)), waves(τ, other_frequencies)])
    for _ in range(3):
        fading = np.exp(-λ * τ)
        cosine, sine = fading * np.cos(ω * τ), -fading * np.sin(ω * τ)
        basis = np.column_stack([cosine, sine, τ * cosine, τ * sine, background])
        pseudo_inverse = np.linalg.pinv(basis)
        a, b, a1, b1 = pseudo_inverse[:4] @ y
        amplitude = math.hypot(a, b)
        if not amplitude > 0.0:
            return None
        correction = complex(a1, b1) / complex(a, b)
        if not abs(correction) < ω:  # beyond is noise
            return None
        λ, ω = λ - correction.real, ω + correction.imag
    p = pseudo_inverse[:4]  # from which the gradients of lambda, omega and amplitude with the samples follow
    gradients = (a * p[2] + b * p[3]) / amplitude, (a * p[3] - b * p[2]) / amplitude, a * p[0] + b * p[1]
    λ_error, ω_error, amplitude_error = (float(np.linalg.norm(gradient)) / amplitude for gradient in gradients)
    misfit = float(np.sum((y - basis @ (pseudo_inverse @ y)) ** 2))
    return LocalDecay(λ, ω, amplitude, λ_error, ω_error, amplitude_error, misfit)


def waves(τ: Array, frequencies: Sequence[float]) -> Array:
    """Return cosine and sine (n, 2k) at the times for each of k frequencies (rad/s)."""
    phase = np.outer(τ, np.asarray(frequencies, dtype=float))
    return np.hstack([np.cos(phase), np.sin(phase)])
