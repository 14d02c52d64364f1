"""Where the free decay in a record begins: after rest, or after an excitation that ends.

Rest.  The release is the last sample still at the level of the last stretch of half a period, before the strongest
swing, in which next to nothing moves.

Excitation.  Seen from a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, found block
by block, each some whole periods.  A free mode has z_k = a q^k, one under a harmonic force the steady part and a
transient,

    z_k = B p^k + C q^k,    |p| = 1,

so that an excitation that ends before block s, in block s - 1, leaves the misfit

    S(s) = min sum_{k < s-1} |z_k - B p^k - C q^k|^2 + min sum_{k >= s} |z_k - a q^k|^2

with q from the second sum.  It is taken for real if this explains z clearly better, by the criterion BIC, than the free
decays do: of one mode with any amplitude-dependent loss, dA/dk = -c - a A - b A^2 with a, b, c >= 0, and of two or
three modes that beat; and if the force does keep the swing up.  Then the release is the latest that the misfit does not
speak against: a release found late does no harm to a fit, since the closed forms hold from any instant on; one found
early does.

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
MINIMUM_WINDOW = 8  # samples; fewer may look quiet by chance where there is noise
QUIET = 0.25  # of the strongest swing in half a period: any free oscillation swings by half of it at least
LEVEL = 0.02  # of the strongest swing: what counts as not having moved
GROWN = 0.8  # of the strongest swing: a released beam swings so far within a period
NOISE_PEAK = 25.0  # times the median of its powers is more than the spectrum of noise reaches, but for 1 bin in 3e7

MOST_BLOCKS = 128
FORCED, FREE = 3, 4  # blocks that there must be of either
VISIBLE = 5.0  # standard deviations of the noise that an amplitude must have
ROUGH = 1e-3  # of an amplitude: what no model explains
CLEAR = 10.0  # difference of a criterion that leaves no doubt
POSSIBLE = 4.0  # difference of twice the logarithm of the likelihood
SUPPLY = 0.3  # of the energy that a free mode would have lost: what a force must have supplied
FORCE = 0.2  # of the amplitude: what its steady part must be
BEAT = 0.75  # of a beat there must be in the record for two modes to be seen
TURN = math.pi / 2  # rad, of the steady part in a block, at most
ZOOMS = 4
SHORTEST = 1e-3  # part of a mode that is left after a block, at least
MOST_PLACES = 20  # tried for the end of an excitation, before those between them are
ONE_MODE, LOSSY_MODE, FORCED_MODE = 4, 7, 10  # unknowns of the models


@dataclass(frozen=True)
class Release:
    """Where a free decay begins.

    Parameters
    ----------
    index : int
        First sample of it.
    reason : str
        Why there.
    """

    index: int
    reason: str


def find_release(time: Array, displacement: Array) -> Release:
    """Return where the free decay begins; at the first sample unless rest or an excitation comes before it.

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
        return Release(rest + forced, "an excitation ends before")
    forced = _end_of_excitation(time, displacement) if grows else 0  # what seems rest may be its beginning
    if forced > rest:
        return Release(forced, "an excitation ends before")
    return Release(rest, "the end of rest" if rest else "the first sample")


def peak_frequency(time: Array, swing: Array, *, steps: bool = False) -> float:
    """Return the frequency (Hz) of the highest peak of the spectrum; of that of the velocity, if there are steps.

    A step has a spectrum like 1/f, that of its derivative is flat.  What may be a peak of noise, whose spectrum is flat
    too, is taken off before it grows with f^2.
    """
    length = 2 ** math.ceil(math.log2(4 * len(swing)))
    power = np.abs(np.fft.rfft(swing, length)) ** 2
    frequency = np.arange(len(power)) / (length * (time[1] - time[0]))
    if steps:
        power = frequency**2 * np.maximum(power - NOISE_PEAK * np.median(power), 0.0)
    return float(frequency[1 + np.argmax(power[1:])])


def _end_of_rest(time: Array, displacement: Array) -> tuple[int, bool]:
    """Return the index of the last sample of rest, 0 if there is none; and whether the swing grows after it."""
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
    """Return the maximum of each ``width`` successive values, from maxima over 1, 2, 4, ... of them."""
    maximum, span = values, 1
    while 2 * span <= width:
        maximum, span = np.maximum(maximum[:-span], maximum[span:]), 2 * span
    return np.maximum(maximum[: len(values) - width + 1], maximum[width - span :])


def _end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample that is surely free; 0 if nothing speaks of an excitation."""
    z, samples = _blocks(time, displacement)
    P = len(z)
    if P < FORCED + 1 + FREE:
        return 0
    n, rough = 2 * P, float(np.sum((ROUGH * np.abs(z)) ** 2))

    def criterion(misfit: float, unknowns: int) -> float:
        return n * math.log(misfit + rough) + unknowns * math.log(n)

    rates, free = _tails(z)
    plain = criterion(float(free[0]), ONE_MODE)
    if criterion(_scatter(z, rates[0]), FORCED_MODE) + CLEAR > plain:
        return 0
    found: dict[int, tuple[float, bool]] = {}

    def misfits(places: range) -> tuple[Array, Array]:
        for s in places:
            if s not in found:
                misfit, kept = _forced(z, s, rates[s], float(free[s]))
                found[s] = misfit * P / (P - 1), kept
        tried = np.array(sorted(found))
        return tried, np.array([found[s][0] for s in tried.tolist()]) + rough

    stride = max(1, (P - FORCED - FREE) // MOST_PLACES)
    tried, left = misfits(range(FORCED + 1, P - FREE + 1, stride))
    near = int(tried[np.argmin(left)])
    tried, left = misfits(range(max(FORCED + 1, near - stride), min(P - FREE, near + 2 * stride) + 1))
    best = int(np.argmin(left))
    if not found[int(tried[best])][1]:
        return 0
    forced = criterion(found[int(tried[best])][0], FORCED_MODE) + CLEAR
    if forced > min(plain, criterion(_lossy(z), LOSSY_MODE)):
        return 0
    if forced > min(criterion(_beating(z, modes), ONE_MODE * modes) for modes in (2, 3)):
        return 0
    possible = n * np.log(left / left[best]) < POSSIBLE
    return int(tried[np.flatnonzero(possible)[-1]]) * samples


def _blocks(time: Array, displacement: Array) -> tuple[ComplexArray, int]:
    """Return z of each block, up to where it is lost in the noise, and the samples of a block."""
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
    slope = (f1 - s1 * f0 / s0) / spread
    misfit = (f2 - np.abs(f0) ** 2 / s0 - np.abs(slope) ** 2 * spread).real
    return slope, np.maximum(misfit, 0.0)


def _scatter(z: ComplexArray, rate: complex) -> float:
    """Return what of z is no curve: by its second differences, once it is turned back and grown like a free mode."""
    w = z * np.exp(-rate * np.arange(len(z)))
    size = np.abs(z[1:-1] / w[1:-1])
    return float(np.sum((np.abs(np.diff(w, 2)) * size) ** 2)) / 6 * len(z) / (len(z) - 2)


def _forced(z: ComplexArray, s: int, rate: complex, free: float) -> tuple[float, bool]:
    """Return S(s), and whether the force keeps the swing up."""
    y, k = z[: s - 1], np.arange(s - 1)
    decay = np.exp(rate * (k - s))
    centre, width = 0.0, TURN
    own, energy = np.vdot(decay, y), float(np.vdot(decay, decay).real)

    def misfits(angles: Array) -> tuple[Array, ComplexArray, ComplexArray]:
        steady = np.exp(1j * np.outer(angles, k))
        cross, share = steady.conj() @ decay, steady.conj() @ y
        determinant = np.maximum(len(y) * energy - np.abs(cross) ** 2, 1e-9 * len(y) * energy)
        B = (energy * share - cross * own) / determinant
        C = (own - cross.conj() * B) / energy
        explained = (B.conj() * share + C.conj() * own).real
        return np.vdot(y, y).real - explained, B, C

    for zoom in range(ZOOMS):
        angles = centre + width * np.linspace(-1.0, 1.0, 4 * s + 9 if zoom == 0 else 9)
        left, B, C = misfits(angles)
        best = int(np.argmin(left))
        centre, width = float(angles[best]), float(angles[1] - angles[0])
    model = B[best] * np.exp(1j * centre * k) + C[best] * decay
    power, loss = np.abs(model) ** 2, 1 - math.exp(2 * rate.real)
    steady = abs(B[best]) > FORCE * math.sqrt(float(np.mean(power)))
    beats = abs(centre - rate.imag) * (s - 1) > math.pi
    supplied = float(np.sum(power[1:] - power[:-1] * (1 - loss)))
    kept = rate.real < 0.0 and steady and (beats or supplied > SUPPLY * loss * float(np.sum(power[:-1])))
    return free + max(float(np.sum(np.abs(y - model) ** 2)), 0.0), bool(kept)


def _lossy(z: ComplexArray) -> float:
    """Return the misfit of one free mode whose amplitude A falls like dA/dk = -c - a A - b A^2, its frequency with A^2.

    In the integral form ln A = ln A0 - c int 1/A - a k - b int A, linear in the coefficients.
    """
    from scipy.optimize import nnls  # slow to import, and seldom needed

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
    """Return the misfit of several free modes, by the matrix pencil; infinite if there is no beat to be seen."""
    P = len(z)
    hankel = np.lib.stride_tricks.sliding_window_view(z, P // 2 + 1)
    vectors = np.linalg.svd(hankel, full_matrices=False)[2][:modes].T
    poles = np.linalg.eigvals(np.linalg.lstsq(vectors[:-1], vectors[1:])[0])
    poles = poles / np.maximum(np.abs(poles), 1.0)
    apart = np.abs(np.angle(poles / np.roll(poles, 1)))
    if apart.min() * P < 2 * math.pi * BEAT or np.abs(poles).min() < SHORTEST:
        return math.inf
    basis = poles ** np.arange(P)[:, None]
    return float(np.sum(np.abs(z - basis @ np.linalg.lstsq(basis, z)[0]) ** 2))
