"""Amplitude and phase of an oscillation over time, and the decay in a short segment, without a damping law.

Track.  The record is divided into windows of whole periods of a carrier near its frequency.  In each window,

    y = Re(z exp(i omega t)) + d

is fitted by linear least squares to the samples at their own times.  |z| is the amplitude in the middle of the window,
and omega t + arg z the phase, counted on from window to window.  A window in which missing frames increase the variance
of z too much is left out.  The track ends where noise hides the oscillation (``bic``).  It follows a frequency
that changes by up to 1/(2 w) of itself, with windows of w periods, over any number of periods.

Losses.  With dA/dt = -(c + a A + b A^2), ln A = ln e0 - c int 1/A dt - a t - b int A dt is linear in the coefficients.

Segment.  With tau from the middle of a segment, a decay and other oscillations of known frequencies are

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
from numpy.typing import NDArray

from ancf_casadi.decay.bic import is_visible
from ancf_casadi.decay.spectrum import MIN_WINDOW_SAMPLES, typical_step
from ancf_casadi.support.arrays import Array, ComplexArray, Index

# Halved, test_without_the_finder_the_damping_would_be_wrong fails; doubled,
# test_a_plain_decay_with_missing_frames_is_hardly_ever_taken_for_an_excitation does.
MAX_VARIANCE = 2.5  # of z, relative to a window without missing frames, beyond which it is left out


@dataclass(frozen=True, eq=False)
class Track:
    """An oscillation in k successive windows."""

    time: Array  # mean time of the samples of each window (k,), s
    z: ComplexArray  # complex amplitude relative to the carrier (k,), in the unit of the record
    number: Index  # number of each window (k,), from 0 at the first sample; those left out are missing
    is_visible: NDArray[np.bool_]  # True where it stands out of the noise (k,); may be False before the largest one
    length: float  # of a window, s
    step: float  # typical step of the record, s
    ω: float  # frequency of the carrier, rad/s

    @property
    def amplitude(self) -> Array:
        """Amplitude (k,), in the unit of the record."""
        return np.asarray(np.abs(self.z))

    @property
    def phase(self) -> Array:
        """Phase (k,), rad; that of the release differs from it by the whole turns since."""
        return np.asarray(self.ω * self.time + np.unwrap(np.angle(self.z)))


def track_oscillation(
    time: Array, measured: Array, ω: float, *, max_windows: int = 1000, degree: int = 0, to_end: bool = False
) -> Track:
    """Return the oscillation near a frequency (rad/s) about a polynomial of the given degree in each window.

    The track ends where noise hides the oscillation after its largest amplitude, or, with ``to_end``, with the record.
    """
    step = typical_step(time)
    period, count = 2 * math.pi / (ω * step), (time[-1] - time[0]) / step + 1  # both in steps
    size = round(period * max(1, math.ceil(MIN_WINDOW_SAMPLES / period), math.ceil(count / period / max_windows)))
    edges = np.searchsorted(time, time[0] + step * (size * np.arange(int(count / size + 1e-9) + 1) - 0.5))
    counts, unknowns = np.diff(edges), 3 + degree
    number = np.flatnonzero(counts > unknowns)
    line = 2 * (((time - time[0]) / step + 0.5) / size % 1.0) - 1  # from -1 to 1 in each window
    columns = np.array([np.cos(ω * time), -np.sin(ω * time), *(line**n for n in range(degree + 1)), measured, time])
    columns = np.append(columns, np.zeros((len(columns), 1)), axis=1)  # so that the last window may be empty
    normal = np.moveaxis(np.add.reduceat(columns[:, None] * columns, edges, axis=-1)[..., number], -1, 0)
    basis, y = slice(unknowns), unknowns
    inverse = np.linalg.inv(normal[:, basis, basis] + 1e-12 * np.eye(unknowns) * counts[number, None, None])
    coefficients = (inverse @ normal[:, basis, y, None])[..., 0]
    variance = (inverse[:, 0, 0] + inverse[:, 1, 1]) / 2  # of z, over that of the noise; 2/size without missing frames
    misfits = np.maximum(normal[:, y, y] - np.sum(coefficients * normal[:, basis, y], axis=1), 0.0)
    z, middle = coefficients[:, 0] + 1j * coefficients[:, 1], normal[:, 2, -1] / counts[number]
    complete = (variance < MAX_VARIANCE * 2 / size) & (np.abs(z) > 1e-12 * np.abs(z).max(initial=0.0))
    number, z, middle, misfits, variance = (values[complete] for values in (number, z, middle, misfits, variance))
    end, shown = len(number), np.zeros(0, dtype=bool)
    if end:
        error = np.sqrt(variance * np.median(misfits / (counts[number] - unknowns)))
        shown = is_visible(np.abs(z), error, counts[number])
        if not to_end:
            end = next((k for k in range(int(np.argmax(np.abs(z))) + 1, end) if not shown[k]), end)
    return Track(middle[:end], z[:end], number[:end], shown[:end], size * step, step, ω)


def cumulative_integral(time: Array, rate: Array) -> Array:
    """Return the integral (k,) of a rate (k,) from time 0 on, by the trapezoidal rule."""
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    return np.asarray(time[0] * rate[0] + np.concatenate([[0.0], np.cumsum(steps)]))


def weighted_least_squares(columns: Sequence[Array], y: Array, weight: Array) -> tuple[list[float], float]:
    """Return the coefficients of columns that fit y best, and the weighted sum of squared residuals."""
    basis = np.column_stack(columns) * weight[:, None]
    length = np.linalg.norm(basis, axis=0)
    coefficients = np.linalg.lstsq(basis / length, y * weight)[0] / length
    return coefficients.tolist(), float(np.sum((y * weight - basis @ coefficients) ** 2))


def fit_loss_rates(amplitude: Array, losses: Sequence[Array]) -> tuple[float, list[float], float]:
    """Return ln e0, non-negative coefficients of the losses (k,) of ln A, and the weighted sum of squared residuals.

    Terms with a negative coefficient are dropped one by one, that with the most negative loss first.
    """
    active = list(range(len(losses)))
    while True:
        columns = [np.ones(len(amplitude)), *(-losses[k] for k in active)]
        (log_start, *rates), misfit = weighted_least_squares(columns, np.log(amplitude), amplitude)
        coefficients = dict(zip(active, rates, strict=True))
        final_losses = {k: rate * losses[k][-1] for k, rate in coefficients.items()}
        if min(final_losses.values(), default=0.0) >= 0.0:
            return log_start, [coefficients.get(k, 0.0) for k in range(len(losses))], misfit
        active.remove(min(active, key=lambda k: final_losses[k]))


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
