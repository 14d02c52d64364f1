"""A short piece of a free decay, fitted without a damping law.

With tau from the middle of the piece, a decay and other oscillations of known frequencies are

    y = Re((z0 + z1 tau) exp((i omega - lambda) tau)) + d + sum Re(w_j exp(i omega_j tau))

and z0, z1, d and w_j follow from linear least squares.  To first order, Re(z1/z0) is the error of the decay rate
lambda, and -Im(z1/z0) that of the frequency omega.  Three rounds of

    lambda <- lambda - Re(z1/z0),    omega <- omega + Im(z1/z0)

make z1 vanish.  Then |z0| is the amplitude in the middle of the piece, and lambda = -d(ln A)/dt there, whatever the
law.

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
    """Decay in the middle of a piece of a record.

    Parameters
    ----------
    λ, ω : float
        Decay rate (1/s) and damped natural frequency (rad/s).
    amplitude : float
        Amplitude, in the unit of the record.
    λ_error, ω_error, amplitude_error : float
        Their standard errors for white noise of standard deviation 1.
    misfit : float
        Sum of the squared residuals.
    """

    λ: float
    ω: float
    amplitude: float
    λ_error: float
    ω_error: float
    amplitude_error: float
    misfit: float


def local_decay(τ: Array, y: Array, λ: float, ω: float, others: Sequence[float] = ()) -> LocalDecay | None:
    """Return the decay in a piece of a record; None if there is no plausible one.

    Parameters
    ----------
    τ : ndarray
        Times from the middle of the piece, s.
    y : ndarray
        Value at each, in any unit.
    λ, ω : float
        First guess of decay rate (1/s) and frequency (rad/s).
    others : sequence of float
        Frequencies of other oscillations, rad/s.
    """
    rest = np.column_stack([np.ones(len(τ)), waves(τ, others)])
    for _ in range(3):
        fading = np.exp(-λ * τ)
        cosine, sine = fading * np.cos(ω * τ), -fading * np.sin(ω * τ)
        basis = np.column_stack([cosine, sine, τ * cosine, τ * sine, rest])
        root = np.linalg.pinv(basis)
        a, b, a1, b1 = root[:4] @ y
        amplitude = math.hypot(a, b)
        if not amplitude > 0.0:
            return None
        correction = complex(a1, b1) / complex(a, b)
        if not abs(correction) < ω:  # beyond is noise
            return None
        λ, ω = λ - correction.real, ω + correction.imag
    size, rate = (a * root[0] + b * root[1]) / amplitude, (a * root[2] + b * root[3]) / amplitude**2
    turn = (a * root[3] - b * root[2]) / amplitude**2
    errors = [float(np.linalg.norm(row)) for row in (rate, turn, size)]
    return LocalDecay(λ, ω, amplitude, errors[0], errors[1], errors[2], float(np.sum((y - basis @ (root @ y)) ** 2)))


def waves(τ: Array, frequencies: Sequence[float]) -> Array:
    """Return cosine and sine (n, 2k) at the times for each of k frequencies (rad/s)."""
    phase = np.outer(τ, np.asarray(frequencies, dtype=float))
    return np.hstack([np.cos(phase), np.sin(phase)])
