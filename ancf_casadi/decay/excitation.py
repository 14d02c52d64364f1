"""Detection of the end of an excitation in a record: the free decay begins where the force ends.

Relative to a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, estimated in windows of
whole periods (``track``).  A free mode has z_k = a q^k.  Under a harmonic force z is a steady part and a transient,

    z_k = B p^k + C q^k,    |p| = 1,

so that an excitation that ends in window s - 1 leaves the misfit

    S(s) = min sum_{k < s-1} |z_k - B p^k - C q^k|^2 + min sum_{k >= s} |z_k - a q^k|^2

with q from the second sum.  There is an excitation if two conditions hold.  First, it is evident (``evidence``) beside
each free decay: one mode with an amplitude-dependent loss, dA/dk = -c - a A - b A^2 with a, b, c >= 0, or two or three
modes that beat.  Second, the force beats with the mode or supplies energy.  The release is then the latest one beside
which no other is evident: the closed forms hold from any later instant on, whereas a release that is too early spoils
a fit.

References
----------
Y. Hua, T. K. Sarkar, Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
noise, IEEE Transactions on Acoustics, Speech, and Signal Processing 38 (1990).
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.decay.evidence import evident
from ancf_casadi.decay.spectrum import LEAST_SAMPLES, peak_frequencies, typical_step
from ancf_casadi.decay.track import Windows, windows
from ancf_casadi.support.arrays import Array, ComplexArray

MOST_WINDOWS = 128  # limits the time of the search, which grows with the cube (benchmarks/test_decay_fit.py)
# Halved, test_a_plain_decay_is_never_cut fails.
FEWEST = 3  # windows with a force, and without: B, C and p need three


def end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample after an excitation; 0 if there is none."""
    if len(time) < LEAST_SAMPLES:
        return 0
    found = _windows(time, displacement, peak_frequencies(time, displacement - displacement.mean())[0])
    z, P = found.z, len(found.z)
    if P < 2 * FEWEST + 1:
        return 0
    k = (found.middle - found.middle[0]) / found.length

    def clearly(free: float, forced: float, unknowns: int) -> bool:
        return evident(free, forced, 2 * P, unknowns, motion=float(np.vdot(z, z).real))

    log_q, free = _tails(k, z)
    if not clearly(float(free[0]), _scatter(k, z, log_q[0]), 10 - 4):  # no smooth z is clearly better than one mode
        return 0
    misfits: dict[int, float] = {}
    supplied: dict[int, bool] = {}

    def best_of(places: range) -> int:
        for s in places:
            if s not in misfits:
                misfit, supplied[s] = _forced(k[:s], z[: s - 1], log_q[s])
                misfits[s] = (misfit + float(free[s])) * P / (P - 1)
        return min(misfits, key=lambda s: (misfits[s], s))

    stride = math.isqrt(P)
    near = best_of(range(FEWEST + 1, P - FEWEST + 1, stride))
    end = best_of(range(max(FEWEST + 1, near - stride), min(P - FEWEST, near + 2 * stride) + 1))
    best = misfits[end]  # of ten unknowns: q, its amplitude, B, p, C and s
    if not supplied[end] or not clearly(float(free[0]), best, 10 - 4) or not clearly(_lossy(k, z), best, 10 - 7):
        return 0
    if not all(clearly(_beating(k, z, modes), best, 10 - 4 * modes) for modes in (2, 3)):
        return 0
    last = max(s for s, left in misfits.items() if not clearly(left, best, 0))
    return int(np.searchsorted(time, time[0] + found.number[last] * found.length - typical_step(time) / 2))


def grows_slowly(time: Array, displacement: Array, frequency: float) -> bool:
    """Return whether the first oscillation of a given frequency (Hz) in a record grows over many windows.

    That of an excited mode does, that after a release or a blow does not.  Its velocity is taken, in which a slower and
    larger oscillation is small.
    """
    found = _windows(time, np.gradient(displacement, time), frequency)
    size = np.abs(found.z)
    peak = int(np.argmax(size)) if size.size else 0
    size = size[np.append(-1, np.flatnonzero(~found.seen[:peak]))[-1] + 1 : peak + 1]
    growth = np.arange(len(size)) + 0.5
    if len(size) < 3:
        return False
    steady, grown = size - size.mean(), size - growth * (growth @ size) / (growth @ growth)
    alike, slow, motion = (float(values @ values) for values in (steady, grown, size))
    return evident(alike, slow, len(size) - 1, 0, motion)


def _windows(time: Array, values: Array, frequency: float) -> Windows:
    return windows(time - time[0], values, 2 * math.pi * frequency, most=MOST_WINDOWS, degree=1)


def _tails(k: Array, z: ComplexArray) -> tuple[ComplexArray, Array]:
    """Return ln q of the free decay from each window to the last, and its misfit, by weighted regression of ln z."""
    w = np.abs(z) ** 2
    logarithm = np.log(np.abs(z)) + 1j * np.unwrap(np.angle(z))

    def after(values: ComplexArray | Array) -> ComplexArray:
        return np.asarray(np.cumsum(values[::-1])[::-1], dtype=complex)

    s0, s1, s2 = after(w), after(w * k), after(w * k**2)
    f0, f1, f2 = after(w * logarithm), after(w * k * logarithm), after(w * np.abs(logarithm) ** 2)
    spread = s2 - s1**2 / s0
    spread[-1] = 1.0
    log_q = (f1 - s1 * f0 / s0) / spread
    misfit = (f2 - np.abs(f0) ** 2 / s0 - np.abs(log_q) ** 2 * spread).real
    return log_q, np.maximum(misfit, 0.0)


def _scatter(k: Array, z: ComplexArray, log_q: complex) -> float:
    """Return the misfit of a smooth curve of any shape, from the second differences of z/q^k in successive windows."""
    w = z * np.exp(-log_q * k)
    size = np.abs(z[1:-1] / w[1:-1])
    squares = ((np.abs(np.diff(w, 2)) * size) ** 2)[k[2:] - k[:-2] < 2.5]
    return float(np.mean(squares)) / 6 * len(z) if squares.size else math.inf


def _forced(k: Array, y: ComplexArray, log_q: complex) -> tuple[float, bool]:
    """Return the first sum of S(s), over z = y before the last of the windows k, and whether the force sustains them.

    It does if it beats with the mode, or supplies more than half of the energy that the free mode would lose.
    """
    k, s = k[:-1], float(k[-1])
    decay = np.exp(log_q * (k - s))
    centre, width = 0.0, math.pi / 2
    own, energy = np.vdot(decay, y), float(np.vdot(decay, decay).real)

    def misfits(angles: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        steady = np.exp(1j * np.outer(angles, k))
        cross, projection = steady.conj() @ decay, steady.conj() @ y
        determinant = np.maximum(len(y) * energy - np.abs(cross) ** 2, 1e-9 * len(y) * energy)
        B = (energy * projection - cross * own) / determinant
        C = (own - cross.conj() * B) / energy
        return np.vdot(y, y).real - (B.conj() * projection + C.conj() * own).real, B, C

    for zoom in range(4):
        angles = centre + width * np.linspace(-1.0, 1.0, math.ceil(4 * s) + 9 if zoom == 0 else 9)
        left, B, C = misfits(angles)
        best = int(np.argmin(left))
        centre, width = float(angles[best]), float(angles[1] - angles[0])
    model = B[best] * np.exp(1j * centre * k) + C[best] * decay
    power, loss = np.abs(model) ** 2, 1 - math.exp(2 * log_q.real)
    beats = abs(centre - log_q.imag) * s > math.pi
    supplied = float(np.sum(power[1:] - power[:-1] * (1 - loss) ** np.diff(k)))
    sustained = log_q.real < 0.0 and (beats or supplied > loss * float(np.sum(power[:-1])) / 2)
    return float(np.sum(np.abs(y - model) ** 2)), sustained


def _lossy(k: Array, z: ComplexArray) -> float:
    """Return the misfit of one free mode with dA/dk = -c - a A - b A^2 and a frequency that depends on A^2.

    The integral form ln A = ln A0 - c int 1/A - a k - b int A is linear in the coefficients.
    """
    from scipy.optimize import nnls  # slow to import, and rarely needed

    A = np.abs(z)
    one = np.ones(len(z))

    def integral(values: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(k))])

    columns = np.column_stack([one, -one, -integral(1 / A) / np.mean(1 / A), -k, -integral(A) / A.mean()])
    loss = nnls(A[:, None] * columns, A * np.log(A / A[0]))[1] ** 2
    turn = np.column_stack([one, k, integral(A**2) / np.mean(A**2)])
    angle = np.unwrap(np.angle(z))
    found = np.linalg.lstsq(A[:, None] * turn, A * angle)[0]
    return float(loss + np.sum((A * (angle - turn @ found)) ** 2))


def _beating(k: Array, z: ComplexArray, modes: int) -> float:
    """Return the misfit of several free modes, by the matrix pencil.

    If windows were left out, they are interpolated for the pencil, and nonlinear least squares refines the poles.
    """
    every = np.arange(round(k[-1]) + 1.0)
    filled = np.exp(np.interp(every, k, np.log(np.abs(z))) + 1j * np.interp(every, k, np.unwrap(np.angle(z))))
    hankel = np.lib.stride_tricks.sliding_window_view(filled, len(filled) // 2 + 1)
    vectors = np.linalg.svd(hankel, full_matrices=False)[2][:modes].T
    poles = np.linalg.eigvals(np.linalg.lstsq(vectors[:-1], vectors[1:])[0])

    def residuals(log_poles: Array) -> Array:
        growth, turn = np.split(log_poles, 2)
        basis = np.exp(np.outer(k, np.minimum(growth, 0.0) + 1j * turn))
        left = z - basis @ np.linalg.lstsq(basis, z)[0]
        return np.concatenate([left.real, left.imag])

    start = np.concatenate([np.log(np.maximum(np.abs(poles), np.finfo(float).tiny)), np.angle(poles)])
    if len(k) == len(every) and np.allclose(k, every):
        return float(np.sum(residuals(start) ** 2))
    from scipy.optimize import least_squares  # slow to import, and rarely needed

    return 2 * float(least_squares(residuals, start).cost)
