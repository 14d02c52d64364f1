"""Amplitude and phase of an oscillation over time, and the motions that may explain them.

Track.  The record is divided into windows of whole periods of a carrier near its frequency.  In each window,

    y = Re(z exp(i omega t)) + d

is fitted by linear least squares to the samples at their own times.  |z| is the amplitude in the middle of the window,
and omega t + arg z the phase, counted on from window to window.  A window in which missing frames increase the variance
of z too much is left out.  The track ends where noise hides the oscillation (``bic``).  It follows a frequency
that changes by up to 1/(2 w) of itself, with windows of w periods, over any number of periods.

Free motion.  One mode has z_k = a q^k; with an amplitude-dependent loss, dA/dk = -c - a A - b A^2, its logarithm
ln A = ln e0 - c int 1/A dk - a k - b int A dk is linear in the coefficients.  Several modes are sums of q_j^k.

Forced motion.  Under a harmonic force z is a steady response and a transient, z_k = B p^k + C q^k with |p| = 1.

References
----------
Y. Hua, T. K. Sarkar, Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
noise, IEEE Transactions on Acoustics, Speech, and Signal Processing 38 (1990).
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
    def k(self) -> Array:
        """Times since the first window (k,), in windows."""
        return np.asarray((self.time - self.time[:1]) / self.length)

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


def fit_free_tails(k: Array, z: ComplexArray) -> tuple[ComplexArray, Array]:
    """Return ln q (k,) of the free decay a q^k from each window to the last, and its misfit (k,).

    Both follow from a regression of ln z with the weights |z|^2, since an error of z is |z| times one of ln z.
    """
    w = np.abs(z) ** 2
    logarithm = np.log(np.abs(z)) + 1j * np.unwrap(np.angle(z))

    def sum_from(values: ComplexArray | Array) -> ComplexArray:
        return np.asarray(np.cumsum(values[::-1])[::-1], dtype=complex)

    s0, s1, s2 = sum_from(w), sum_from(w * k), sum_from(w * k**2)
    f0, f1, f2 = sum_from(w * logarithm), sum_from(w * k * logarithm), sum_from(w * np.abs(logarithm) ** 2)
    spread = np.maximum((s2 - s1**2 / s0).real, np.finfo(float).tiny)
    spread[-1] = 1.0  # a single window has no slope
    log_q = (f1 - s1 * f0 / s0) / spread
    misfit = (f2 - np.abs(f0) ** 2 / s0 - np.abs(log_q) ** 2 * spread).real
    return log_q, np.maximum(misfit, 0.0)


def scatter_misfit(k: Array, z: ComplexArray, log_q: complex) -> float:
    """Return the misfit of a smooth curve of any shape, from the second differences of z/q^k in successive windows."""
    detrended = z * np.exp(-log_q * k)
    amplitude = np.abs(z[1:-1] / detrended[1:-1])
    squares = ((np.abs(np.diff(detrended, 2)) * amplitude) ** 2)[k[2:] - k[:-2] < 2.5]
    return float(np.mean(squares)) / 6 * len(z) if squares.size else math.inf


def fit_forced_response(k: Array, y: ComplexArray, log_q: complex) -> tuple[float, bool]:
    """Fit B p^k + C q^k with |p| = 1, for a given q, to the values y in all windows k but the last.

    Return the misfit, and whether the force sustains the motion: it beats with the mode, or supplies more than half of
    the energy that the free mode would lose.  Of p, the angle is searched: in each of four rounds about the best one of
    the round before, with B and C from linear least squares.
    """
    k, s = k[:-1], float(k[-1])
    exponent = log_q * (k - s)
    decay = np.exp(exponent - exponent.real.max())  # transient, of size 1 where it is largest
    centre_angle, width = 0.0, math.pi / 2
    decay_projection, energy = np.vdot(decay, y), float(np.vdot(decay, decay).real)

    def fit_amplitudes(angles: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        """Return misfit, B and C for each angle, from the normal equations of two unknowns."""
        steady = np.exp(1j * np.outer(angles, k))
        cross, projection = steady.conj() @ decay, steady.conj() @ y
        determinant = np.maximum(len(y) * energy - np.abs(cross) ** 2, 1e-9 * len(y) * energy)
        B = (energy * projection - cross * decay_projection) / determinant
        C = (decay_projection - cross.conj() * B) / energy
        return np.vdot(y, y).real - (B.conj() * projection + C.conj() * decay_projection).real, B, C

    for zoom in range(4):
        angles = centre_angle + width * np.linspace(-1.0, 1.0, math.ceil(4 * s) + 9 if zoom == 0 else 9)
        misfits, B, C = fit_amplitudes(angles)
        best_index = int(np.argmin(misfits))
        centre_angle, width = float(angles[best_index]), float(angles[1] - angles[0])
    model = B[best_index] * np.exp(1j * centre_angle * k) + C[best_index] * decay
    power, loss = np.abs(model) ** 2, 1 - math.exp(2 * log_q.real)
    beats = abs(centre_angle - log_q.imag) * s > math.pi
    supplied_energy = float(np.sum(power[1:] - power[:-1] * (1 - loss) ** np.diff(k)))
    sustained = log_q.real < 0.0 and (beats or supplied_energy > loss * float(np.sum(power[:-1])) / 2)
    return float(np.sum(np.abs(y - model) ** 2)), sustained


def one_mode_misfit(k: Array, z: ComplexArray) -> float:
    """Return the misfit of one free mode with dA/dk = -c - a A - b A^2 and a frequency that depends on A^2."""
    A = np.abs(z)
    loss = fit_loss_rates(A, [cumulative_integral(k, 1 / A), k, cumulative_integral(k, A)])[2]
    return (
        loss + weighted_least_squares([np.ones(len(z)), k, cumulative_integral(k, A**2)], np.unwrap(np.angle(z)), A)[1]
    )


def several_modes_misfit(k: Array, z: ComplexArray, modes: int) -> float:
    """Return the misfit of several free modes, by the matrix pencil."""
    all_windows = np.arange(round(k[-1]) + 1.0)
    logarithm = np.log(np.abs(z)) + 1j * np.unwrap(np.angle(z))
    filled = np.exp(np.interp(all_windows, k, logarithm))
    hankel = np.lib.stride_tricks.sliding_window_view(filled, len(filled) // 2 + 1)
    vectors = np.linalg.svd(hankel, full_matrices=False)[2][:modes].T
    poles = np.linalg.eigvals(np.linalg.lstsq(vectors[:-1], vectors[1:])[0])

    def residuals(log_poles: Array) -> Array:
        growth, turn = np.split(log_poles, 2)
        basis = np.exp(np.outer(k, np.minimum(growth, 0.0) + 1j * turn))
        misfit = z - basis @ np.linalg.lstsq(basis, z)[0]
        return np.concatenate([misfit.real, misfit.imag])

    start = np.concatenate([np.log(np.maximum(np.abs(poles), np.finfo(float).tiny)), np.angle(poles)])
    if len(k) == len(all_windows) and np.allclose(k, all_windows):
        return float(np.sum(residuals(start) ** 2))
    from scipy.optimize import least_squares  # slow to import, and rarely needed

    return 2 * float(least_squares(residuals, start).cost)
