"""Detection of the start of the free decay in a record: the end of an initial rest, or the end of an excitation.

Rest.  Before the largest swing, the last half period in which almost nothing moves gives the level of rest.  The
release is the last sample at this level.

Excitation.  Relative to a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, estimated
in blocks of whole periods.  A free mode has z_k = a q^k.  Under a harmonic force z is a steady part and a transient,

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
from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray

MINIMUM_SAMPLES = 10
MINIMUM_WINDOW = 8  # samples; fewer may look quiet by chance

# The end of rest; all relative to the largest swing within half a period.
QUIET = 0.25  # largest swing of a window at rest; with a free oscillation it is at least 0.5
LEVEL = 0.02  # departure that does not count as motion
GROWN = 0.8  # swing that a released beam reaches within a period; that of a driven beam grows slowly
NOISE_PEAK = 25.0  # power relative to the median of the spectrum; noise exceeds it in 1 of 3e7 bins

# The end of an excitation: resolution of z.
MOST_BLOCKS = 128  # limits the time of the search
FORCED, FREE = 3, 4  # least number of blocks with a force (B, C and p need three), and without
VISIBLE = 5.0  # amplitude, in standard deviations of the noise, below which z ends
MOST_PLACES = 20  # ends s tried in a first pass; a second pass tries those near the best
TURN, ZOOMS = math.pi / 2, 4  # largest turn of p (rad per block), and refinements of it, each by a factor of 4

# The end of an excitation: decision.
ROUGH = 1e-3  # error, relative to the amplitude, that no model explains, such as an error of calibration
CLEAR = 10.0  # difference of BIC that leaves no doubt
POSSIBLE = 4.0  # difference of twice the log-likelihood within which an end is possible (95 %)
SUPPLY = 0.3  # least energy that a force supplies, relative to the loss of a free mode; less may be a beat of two modes
ONE_MODE, LOSSY_MODE, FORCED_MODE = 4, 7, 10  # number of unknowns of the models


@dataclass(frozen=True)
class Release:
    """Start of a free decay.

    Parameters
    ----------
    index : int
        First sample of the decay.
    reason : str
        Reason: the first sample, the end of rest, the end of an excitation, or given.
    """

    index: int
    reason: str


def find_release(time: Array, displacement: Array) -> Release:
    """Return the start of the free decay; the first sample unless rest or an excitation precedes it.

    Parameters
    ----------
    time : ndarray
        Equally spaced times, s.
    displacement : ndarray
        Displacement at each, m.
    """
    if len(time) < MINIMUM_SAMPLES or np.ptp(displacement) == 0.0:
        return Release(0, "the first sample")
    rest, grows = _end_of_rest(time, displacement)
    forced = _end_of_excitation(time[rest:], displacement[rest:])
    if forced:
        return Release(rest + forced, "the end of an excitation")
    forced = _end_of_excitation(time, displacement) if grows else 0  # the rest may be a weak excitation
    if forced > rest:
        return Release(forced, "the end of an excitation")
    return Release(rest, "the end of rest" if rest else "the first sample")


def peak_frequency(time: Array, swing: Array, *, steps: bool = False) -> float:
    """Return the frequency (Hz) of the highest peak of the spectrum; for a record with steps, of the velocity.

    The spectrum of a step falls as 1/f, that of its derivative is flat.  Noise also has a flat spectrum, and is
    subtracted before the power is multiplied by f^2.
    """
    length = 2 ** math.ceil(math.log2(4 * len(swing)))
    power = np.abs(np.fft.rfft(swing, length)) ** 2
    frequency = np.arange(len(power)) / (length * (time[1] - time[0]))
    if steps:
        power = frequency**2 * np.maximum(power - NOISE_PEAK * np.median(power), 0.0)
    return float(frequency[1 + np.argmax(power[1:])])


def _end_of_rest(time: Array, displacement: Array) -> tuple[int, bool]:
    """Return the index of the last sample at rest, 0 if there is none, and whether the swing then grows slowly."""
    period = 1 / peak_frequency(time, displacement - displacement.mean(), steps=True)
    width = int(np.clip(round(period / (time[1] - time[0]) / 2), MINIMUM_WINDOW, len(time)))
    swing = _running_maximum(displacement, width) + _running_maximum(-displacement, width)
    quiet = np.flatnonzero(swing[: int(np.argmax(swing))] <= QUIET * swing.max())
    if quiet.size == 0:
        return 0, False
    rest = displacement[quiet[-1] : quiet[-1] + width]
    departure = np.abs(rest - np.median(rest))
    still = departure <= max(LEVEL * swing.max(), 3 * np.median(departure))
    end = int(quiet[-1] + np.flatnonzero(still)[-1])
    return end, bool(swing[end : end + 2 * width].max(initial=0.0) < GROWN * swing.max())


def _running_maximum(values: Array, width: int) -> Array:
    """Return the maximum of each ``width`` successive values, from maxima over 1, 2, 4, ... values."""
    maximum, span = values, 1
    while 2 * span <= width:
        maximum, span = np.maximum(maximum[:-span], maximum[span:]), 2 * span
    return np.maximum(maximum[: len(values) - width + 1], maximum[width - span :])


def _end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample after an excitation; 0 if there is none."""
    z, samples = _blocks(time, displacement)
    P = len(z)
    if P < FORCED + 1 + FREE:
        return 0
    n, rough = 2 * P, float(np.sum((ROUGH * np.abs(z)) ** 2))

    def criterion(misfit: float, unknowns: int) -> float:
        return n * math.log(misfit + rough) + unknowns * math.log(n)

    log_q, free = _tails(z)
    plain = criterion(float(free[0]), ONE_MODE)
    if criterion(_scatter(z, log_q[0]), FORCED_MODE) + CLEAR > plain:  # no smooth z is clearly better than one mode
        return 0
    misfits: dict[int, float] = {}
    supplied: dict[int, bool] = {}

    def best_of(places: range) -> int:
        for s in places:
            if s not in misfits:
                misfit, supplied[s] = _forced(z, s, log_q[s])
                misfits[s] = (misfit + float(free[s])) * P / (P - 1)
        return min(misfits, key=lambda s: (misfits[s], s))

    stride = max(1, (P - FORCED - FREE) // MOST_PLACES)
    near = best_of(range(FORCED + 1, P - FREE + 1, stride))
    end = best_of(range(max(FORCED + 1, near - stride), min(P - FREE, near + 2 * stride) + 1))
    best, forced = misfits[end], criterion(misfits[end], FORCED_MODE) + CLEAR
    if not supplied[end]:
        return 0
    if forced > min(plain, criterion(_lossy(z), LOSSY_MODE)):
        return 0
    if forced > min(criterion(_beating(z, modes), ONE_MODE * modes) for modes in (2, 3)):
        return 0
    return max(s for s, left in misfits.items() if n * math.log((left + rough) / (best + rough)) < POSSIBLE) * samples


def _blocks(time: Array, displacement: Array) -> tuple[ComplexArray, int]:
    """Return z of each block, until noise hides it, and the number of samples per block."""
    step = time[1] - time[0]
    period = 1 / (peak_frequency(time, displacement - displacement.mean()) * step)  # samples
    periods = max(1, math.ceil(MINIMUM_WINDOW / period), math.ceil(len(time) / period / MOST_BLOCKS))
    samples = round(periods * period)
    P = len(time) // samples
    phase = 2 * math.pi / period * np.arange(samples)
    basis = np.column_stack([np.cos(phase), -np.sin(phase), np.ones(samples), np.linspace(-1.0, 1.0, samples)])
    rows = displacement[: P * samples].reshape(P, samples)
    found = rows @ np.linalg.pinv(basis).T
    noise = math.sqrt(2 * np.sum((rows - found @ basis.T) ** 2) / max(1, P * (samples - 4)) / samples)
    z = (found[:, 0] + 1j * found[:, 1]) * np.exp(-2j * math.pi / period * samples * np.arange(P))
    size = np.abs(z)
    lost = np.flatnonzero(size < max(VISIBLE * noise, 1e-12 * size.max(initial=0.0)))
    lost = lost[lost > np.argmax(size)] if P else lost
    return z[: lost[0]] if lost.size else z, samples


def _tails(z: ComplexArray) -> tuple[ComplexArray, Array]:
    """Return ln q of the free decay from each block to the last, and its misfit, by weighted regression of ln z."""
    k, w = np.arange(len(z), dtype=float), np.abs(z) ** 2
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


def _scatter(z: ComplexArray, log_q: complex) -> float:
    """Return the misfit of a smooth curve of any shape, from the second differences of z/q^k."""
    w = z * np.exp(-log_q * np.arange(len(z)))
    size = np.abs(z[1:-1] / w[1:-1])
    return float(np.sum((np.abs(np.diff(w, 2)) * size) ** 2)) / 6 * len(z) / (len(z) - 2)


def _forced(z: ComplexArray, s: int, log_q: complex) -> tuple[float, bool]:
    """Return the first sum of S(s), over the blocks before s - 1, and whether the force sustains the swing.

    It does if it beats with the mode, or supplies part of the energy that the free mode would lose.
    """
    y, k = z[: s - 1], np.arange(s - 1)
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
    beats = abs(centre - log_q.imag) * (s - 1) > math.pi
    supplied = float(np.sum(power[1:] - power[:-1] * (1 - loss)))
    sustained = log_q.real < 0.0 and (beats or supplied > SUPPLY * loss * float(np.sum(power[:-1])))
    return float(np.sum(np.abs(y - model) ** 2)), sustained


def _lossy(z: ComplexArray) -> float:
    """Return the misfit of one free mode with dA/dk = -c - a A - b A^2 and a frequency that depends on A^2.

    The integral form ln A = ln A0 - c int 1/A - a k - b int A is linear in the coefficients.
    """
    from scipy.optimize import nnls  # slow to import, and rarely needed

    A, k = np.abs(z), np.arange(len(z), dtype=float)
    one = np.ones(len(z))

    def integral(values: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2)])

    columns = np.column_stack([one, -one, -integral(1 / A) / np.mean(1 / A), -k, -integral(A) / A.mean()])
    loss = nnls(A[:, None] * columns, A * np.log(A / A[0]))[1] ** 2
    turn = np.column_stack([one, k, integral(A**2) / np.mean(A**2)])
    angle = np.unwrap(np.angle(z))
    found = np.linalg.lstsq(A[:, None] * turn, A * angle)[0]
    return float(loss + np.sum((A * (angle - turn @ found)) ** 2))


def _beating(z: ComplexArray, modes: int) -> float:
    """Return the misfit of several free modes, by the matrix pencil."""
    P = len(z)
    hankel = np.lib.stride_tricks.sliding_window_view(z, P // 2 + 1)
    vectors = np.linalg.svd(hankel, full_matrices=False)[2][:modes].T
    poles = np.linalg.eigvals(np.linalg.lstsq(vectors[:-1], vectors[1:])[0])
    poles = poles / np.maximum(np.abs(poles), 1.0)
    basis = poles ** np.arange(P)[:, None]
    return float(np.sum(np.abs(z - basis @ np.linalg.lstsq(basis, z)[0]) ** 2))
