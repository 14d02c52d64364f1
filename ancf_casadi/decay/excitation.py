"""Detection of the end of an excitation in a record: the free decay begins where the force ends.

Relative to a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, estimated by linear
least squares in blocks of whole periods, each from its samples at their own times.  A block in which missing frames
increase the variance of z too much is left out, so that k skips its number.  A free mode has z_k = a q^k.  Under a
harmonic force z is a steady part and a transient,

    z_k = B p^k + C q^k,    |p| = 1,

so that an excitation that ends in block s - 1 leaves the misfit

    S(s) = min sum_{k < s-1} |z_k - B p^k - C q^k|^2 + min sum_{k >= s} |z_k - a q^k|^2

with q from the second sum.  There is an excitation if two conditions hold.  First, it explains z clearly better, by the
criterion BIC, than each free decay: one mode with an amplitude-dependent loss, dA/dk = -c - a A - b A^2 with a, b, c >=
0, or two or three modes that beat.  Second, the force beats with the mode or supplies energy.  The release is then the
latest one that the misfit permits: the closed forms hold from any later instant on, whereas a release that is too early
spoils a fit.

References
----------
Y. Hua, T. K. Sarkar, Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
noise, IEEE Transactions on Acoustics, Speech, and Signal Processing 38 (1990).
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ancf_casadi.decay.spectrum import peak_frequencies, typical_step
from ancf_casadi.support.arrays import Array, ComplexArray

# Resolution of z.
MOST_BLOCKS = 128  # limits the time of the search
BLOCK_SAMPLES = 8  # least number of samples in a block without dropped frames
BLOCK_UNKNOWNS = 4
POOREST = 2.5  # variance of z, relative to a block without dropped frames, beyond which it is left out
FORCED, FREE = 3, 4  # least number of blocks with a force (B, C and p need three), and without
VISIBLE = 5.0  # amplitude, in standard deviations of the noise, below which z ends
MOST_PLACES = 20  # ends s tried in a first pass; a second pass tries those near the best
TURN, ZOOMS = math.pi / 2, 4  # largest turn of p (rad per block), and refinements of it, each by a factor of 4

# Decision.
MOST_STEPS = 30  # of the refinement of poles
ROUGH = 1e-3  # error, relative to the amplitude, that no model explains, such as an error of calibration
CLEAR = 10.0  # difference of BIC that leaves no doubt
POSSIBLE = 4.0  # difference of twice the log-likelihood within which an end is possible (95 %)
SUPPLY = 0.3  # least energy that a force supplies, relative to the loss of a free mode; less may be a beat of two modes
WEAK, GROWING = 0.2, 5  # size before a growth, relative to the largest, and least number of blocks of the growth
ONE_MODE, LOSSY_MODE, FORCED_MODE = 4, 7, 10  # number of unknowns of the models


def end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample after an excitation; 0 if there is none."""
    if len(time) < BLOCK_SAMPLES:
        return 0
    k, z, length = _blocks(time, displacement, peak_frequencies(time, displacement - displacement.mean())[0])
    P = len(z)
    if P < FORCED + 1 + FREE:
        return 0
    n, rough = 2 * P, float(np.sum((ROUGH * np.abs(z)) ** 2))

    def criterion(misfit: float, unknowns: int) -> float:
        return n * math.log(misfit + rough) + unknowns * math.log(n)

    log_q, free = _tails(k, z)
    plain = criterion(float(free[0]), ONE_MODE)
    if criterion(_scatter(k, z, log_q[0]), FORCED_MODE) + CLEAR > plain:  # no smooth z is clearly better than one mode
        return 0
    misfits: dict[int, float] = {}
    supplied: dict[int, bool] = {}

    def best_of(places: range) -> int:
        for s in places:
            if s not in misfits:
                misfit, supplied[s] = _forced(k[:s], z[: s - 1], log_q[s])
                misfits[s] = (misfit + float(free[s])) * P / (P - 1)
        return min(misfits, key=lambda s: (misfits[s], s))

    stride = max(1, (P - FORCED - FREE) // MOST_PLACES)
    near = best_of(range(FORCED + 1, P - FREE + 1, stride))
    end = best_of(range(max(FORCED + 1, near - stride), min(P - FREE, near + 2 * stride) + 1))
    best, forced = misfits[end], criterion(misfits[end], FORCED_MODE) + CLEAR
    if not supplied[end]:
        return 0
    if forced > min(plain, criterion(_lossy(k, z), LOSSY_MODE)):
        return 0
    if forced > min(criterion(_beating(k, z, modes), ONE_MODE * modes) for modes in (2, 3)):
        return 0
    last = max(s for s, left in misfits.items() if n * math.log((left + rough) / (best + rough)) < POSSIBLE)
    return int(np.searchsorted(time, time[0] + k[last] * length - typical_step(time) / 2))


def grows_slowly(time: Array, displacement: Array, frequency: float) -> bool:
    """Return whether the first oscillation of a given frequency (Hz) in a record grows over many blocks.

    That of an excited mode does, that after a release or a blow does not.  Its velocity is taken, in which a slower and
    larger oscillation is small.
    """
    size = np.abs(_blocks(time, np.gradient(displacement, time), frequency)[1])
    if not size.size:
        return False
    begin, peak = int(np.argmax(size > WEAK * size.max())), int(np.argmax(size))
    return 0 < begin <= peak - GROWING and bool((np.diff(size[begin - 1 : peak + 1]) > 0.0).all())


def _blocks(time: Array, displacement: Array, frequency: float) -> tuple[Array, ComplexArray, float]:
    """Return numbers and z of the blocks for a carrier (Hz), until noise hides z, and the length of a block (s)."""
    step = typical_step(time)
    period = 1 / (frequency * step)  # steps
    count = (time[-1] - time[0]) / step + 1
    periods = max(1, math.ceil(BLOCK_SAMPLES / period), math.ceil(count / period / MOST_BLOCKS))
    size = round(periods * period)
    P = int(count / size + 1e-9)
    places = (time - time[0]) / step
    edges = np.searchsorted(places, size * np.arange(P + 1) - 0.5).tolist()
    z, squares, freedom = np.full(P, np.nan, dtype=complex), 0.0, 0
    for k, (begin, end) in enumerate(pairwise(edges)):
        if end - begin <= BLOCK_UNKNOWNS:
            continue
        phase = 2 * math.pi / period * places[begin:end]
        line = 2 * (places[begin:end] - k * size) / size - 1
        basis = np.column_stack([np.cos(phase), -np.sin(phase), np.ones(end - begin), line])
        root = np.linalg.pinv(basis)
        if np.sum(root[:2] ** 2) > POOREST * 4 / size:  # 4/size without dropped frames
            continue
        found = root @ displacement[begin:end]
        z[k] = complex(found[0], found[1])
        squares += float(np.sum((displacement[begin:end] - basis @ found) ** 2))
        freedom += end - begin - BLOCK_UNKNOWNS
    known = np.flatnonzero(~np.isnan(z))
    amplitude = np.abs(z[known])
    noise = math.sqrt(2 * squares / max(1, freedom) / size)
    lost = np.flatnonzero(amplitude < max(VISIBLE * noise, 1e-12 * amplitude.max(initial=0.0)))
    lost = lost[lost > np.argmax(amplitude)] if known.size else lost
    known = known[: lost[0]] if lost.size else known
    return known.astype(float), z[known], size * step


def _tails(k: Array, z: ComplexArray) -> tuple[ComplexArray, Array]:
    """Return ln q of the free decay from each block to the last, and its misfit, by weighted regression of ln z."""
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
    """Return the misfit of a smooth curve of any shape, from the second differences of z/q^k in successive blocks."""
    w = z * np.exp(-log_q * k)
    size = np.abs(z[1:-1] / w[1:-1])
    squares = ((np.abs(np.diff(w, 2)) * size) ** 2)[k[2:] - k[:-2] == 2]
    return float(np.mean(squares)) / 6 * len(z) if squares.size else math.inf


def _forced(k: Array, y: ComplexArray, log_q: complex) -> tuple[float, bool]:
    """Return the first sum of S(s), over z = y of the blocks before the last of k, and whether the force sustains them.

    It does if it beats with the mode, or supplies part of the energy that the free mode would lose.
    """
    k, s = k[:-1], int(k[-1])
    decay = np.exp(log_q * (k - s))
    centre, width = 0.0, TURN
    own, energy = np.vdot(decay, y), float(np.vdot(decay, decay).real)

    def misfits(angles: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        steady = np.exp(1j * np.outer(angles, k))
        cross, projection = steady.conj() @ decay, steady.conj() @ y
        determinant = np.maximum(len(y) * energy - np.abs(cross) ** 2, 1e-9 * len(y) * energy)
        B = (energy * projection - cross * own) / determinant
        C = (own - cross.conj() * B) / energy
        return np.vdot(y, y).real - (B.conj() * projection + C.conj() * own).real, B, C

    for zoom in range(ZOOMS):
        angles = centre + width * np.linspace(-1.0, 1.0, 4 * s + 9 if zoom == 0 else 9)
        left, B, C = misfits(angles)
        best = int(np.argmin(left))
        centre, width = float(angles[best]), float(angles[1] - angles[0])
    model = B[best] * np.exp(1j * centre * k) + C[best] * decay
    power, loss = np.abs(model) ** 2, 1 - math.exp(2 * log_q.real)
    beats = abs(centre - log_q.imag) * s > math.pi
    supplied = float(np.sum(power[1:] - power[:-1] * (1 - loss) ** np.diff(k)))
    sustained = log_q.real < 0.0 and (beats or supplied > SUPPLY * loss * float(np.sum(power[:-1])))
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

    If blocks were left out, those of the pencil are interpolated, and the poles are refined by nonlinear least squares.
    """
    every = np.arange(k[0], k[-1] + 1)
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
    if len(k) == len(every):
        return float(np.sum(residuals(start) ** 2))
    from scipy.optimize import least_squares  # slow to import, and rarely needed

    return 2 * float(least_squares(residuals, start, max_nfev=MOST_STEPS).cost)
