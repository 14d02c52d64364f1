"""Detection of the start of the free decay in a record: the end of an initial rest, or the end of an excitation.

Rest.  Before the largest swing, the last window of half a period in which almost nothing moves gives the level of rest.
The decay begins at the first sample after the last one at this level: the release itself lies between the two, and the
closed forms hold from any later instant on.  A window holds the samples at their own times.  One with a hole of more
than half its length may hide a swing and is not taken for rest.

Excitation.  Relative to a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, estimated
in windows of whole periods (``track``).  A free mode has z_k = a q^k.  Under a harmonic force z is a steady part and a
transient,

    z_k = B p^k + C q^k,    |p| = 1,

so that an excitation that ends in window s - 1 leaves the misfit

    S(s) = min sum_{k < s-1} |z_k - B p^k - C q^k|^2 + min sum_{k >= s} |z_k - a q^k|^2

with q from the second sum.  There is an excitation if two conditions hold.  First, it is evident (``evidence``) beside
each free decay: one mode with an amplitude-dependent loss, dA/dk = -c - a A - b A^2 with a, b, c >= 0, or two or three
modes that beat.  Second, the force beats with the mode or supplies energy.  The release is then the latest one beside
which no other is evident: the closed forms hold from any later instant on, whereas a release that is too early spoils
a fit.

Gaps.  A piece of less than one and a half periods between the release and a gap is left out, because it does not show
whether the beam rests or moves.  If the decay begins at the end of a gap, a note says so.

References
----------
Y. Hua, T. K. Sarkar, Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
noise, IEEE Transactions on Acoustics, Speech, and Signal Processing 38 (1990).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.decay.evidence import MODEL_ERROR, evident
from ancf_casadi.decay.outliers import without_outliers
from ancf_casadi.decay.spectrum import GAP, LEAST_SAMPLES, peak_frequencies, step_frequency, typical_step
from ancf_casadi.decay.track import Track, losses_of, regression, since_start, track
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import resolution, without_line
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.inputs import check_instance

# Tests that fail: test_a_record_in_which_nothing_oscillates_is_refused (either minimum halved),
# test_an_excitation_that_grows_out_of_the_noise_is_not_taken_for_rest_and_release (REST_SWING doubled, GROWN halved),
# test_a_release_after_rest_is_no_excitation (GROWN doubled), test_a_plain_decay_is_never_cut (FEWEST halved), and
# test_the_decay_begins_at_the_first_sample_in_motion (LEVEL halved).
MINIMUM_SAMPLES = 10
MINIMUM_PERIODS = 1.5  # fewer do not show whether the beam rests or moves
REST_SWING = 0.25  # largest swing of a window at rest, relative to all; with a free oscillation it is at least 0.5
GROWN = 0.8  # relative swing that a released beam reaches within a period; that of a driven beam grows slowly
MOST_WINDOWS = 128  # limits the time of the search, which grows with the cube (benchmarks/test_decay_fit.py)
FEWEST = 3  # windows with a force, and without: B, C and p need three
ALL_RELEASES = "fit_decays(separate_takes(record)), or --release all"
MOST_TAKE_WINDOWS = 512  # of a record with several releases
JUMP = 1.25  # least growth of the amplitude at a release, from one window to the next but one
MOST_UNEXPLAINED = 0.04  # share of the motion that a free decay leaves; random responses leave more
MOST_LEFT_BY_TAKES = 0.02  # the same for several releases
QUANTISED = 0.25  # error of the amplitude of a quantised oscillation, in steps of the quantisation
FALLING = 1.05  # largest growth of the amplitude from window to window that counts as a decay, for the noise in it
LEVEL = 0.02  # departure that does not count as motion, relative to the largest swing


@dataclass(frozen=True)
class Release:
    """Start of a free decay."""

    index: int  # of the first sample of the decay
    reason: str  # the first sample, the end of rest, the end of an excitation, the end of a gap, or given
    notes: tuple[str, ...] = ()  # reasons for doubt


def find_release(time: Array, measured: Array) -> Release:
    """Return the start of the free decay in values of any sensor, the first unless rest or an excitation precedes."""
    if len(time) < MINIMUM_SAMPLES or np.ptp(measured) == 0.0:
        return Release(0, "the first sample")
    takes = find_takes(time, measured)
    if takes:
        begins = ", ".join(f"{time[take.start]:.4g} s" for take in takes)
        note = (
            f"the record holds {len(takes)} releases, at about {begins}; the last one is fitted (all: {ALL_RELEASES})"
        )
        last = find_release(time[takes[-1].start :], measured[takes[-1].start :])
        return Release(takes[-1].start + last.index, "the last of several releases", (note, *last.notes))
    period = 1 / step_frequency(time, without_line(time, measured))
    rest, grows = _end_of_rest(time, measured, period)
    forced = rest + end_of_excitation(time[rest:], measured[rest:])
    if forced == rest and grows:
        forced = end_of_excitation(time, measured)  # the rest may be a weak excitation
    begin = _after_gaps(time, max(rest, forced), period)
    gap = float(time[begin] - time[begin - 1]) if begin else 0.0
    reason = "the end of an excitation" if forced > rest else "the end of rest" if rest else "the first sample"
    if gap <= GAP * typical_step(time):
        return Release(begin, reason)
    note = (
        f"a gap of {gap:.3g} s hides the release or follows it closely; the decay is taken from the end of the gap on, "
        f"{time[begin]:g} s"
    )
    return Release(begin, "the end of a gap", (note,))


def _after_gaps(time: Array, begin: int, period: float) -> int:
    """Return the first sample after gaps that leave too little of the record before them to tell rest from motion."""
    longest = max(period / 2, GAP * typical_step(time))
    early = slice(begin, int(np.searchsorted(time, time[begin] + 4 * MINIMUM_PERIODS * period)))
    for gap in (begin + np.flatnonzero(np.diff(time[early]) > longest)).tolist():
        if time[gap] - time[begin] < MINIMUM_PERIODS * period:
            begin = gap + 1
    return begin


def _end_of_rest(time: Array, displacement: Array, period: float) -> tuple[int, bool]:
    """Return the index of the first sample after rest, 0 if there is none, and whether the swing then grows slowly."""
    step = typical_step(time)
    least = min(LEAST_SAMPLES, max(LEAST_SAMPLES // 2, math.ceil(period / step)))
    width = max(period / 2, (least - 1) * step)
    last = np.maximum(np.searchsorted(time, time + width - step / 2), np.arange(len(time)) + least - 1)
    last = last[last < len(time)]
    if not last.size:
        return 0, False
    flat = without_line(time, displacement)
    swing = _highest(flat, last) + _highest(-flat, last)
    whole = _highest(np.append(np.diff(time), 0.0), last - 1) <= max(width / 2, 2.5 * step)
    quiet = np.flatnonzero((whole & (swing <= REST_SWING * swing.max()))[: int(np.argmax(swing))])
    if quiet.size == 0:
        return 0, False
    begin, end = int(quiet[-1]), int(last[quiet[-1]])
    level = np.median(displacement[begin : end + 1])
    departure = np.abs(displacement - level)
    still = departure <= max(LEVEL * swing.max(), 3 * np.median(departure[begin : end + 1]))
    rest = begin + int(np.flatnonzero(still[begin : end + 1])[-1])
    while still[rest + 1 : rest + 3].any():  # beyond the window, which ends before a hole
        rest += 1 if still[rest + 1] else 2
    if rest + 1 == len(time):
        return 0, False
    near = slice(rest, int(np.searchsorted(time, time[rest] + 2 * width)))
    return rest + 1, bool(whole[near].all() and swing[near].max(initial=0.0) < GROWN * swing.max())


def _highest(values: Array, last: Index) -> Array:
    """Return the maximum of ``values`` from each index i to ``last[i]``, from maxima over 1, 2, 4, ... values."""
    begin = np.arange(len(last))
    count = last - begin + 1
    found, maximum, span = np.empty(len(last)), values, 1
    while span <= count.max():
        here = (span <= count) & (count < 2 * span)
        found[here] = np.maximum(maximum[begin[here]], maximum[last[here] - span + 1])
        if span > count.max() // 2:
            break
        maximum, span = np.maximum(maximum[:-span], maximum[span:]), 2 * span
    return found


def end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample after an excitation; 0 if there is none."""
    if len(time) < LEAST_SAMPLES:
        return 0
    found = _tracked(time, displacement, peak_frequencies(time, displacement - displacement.mean())[0])
    z, P = found.z, len(found.z)
    if P < 2 * FEWEST + 1:
        return 0
    k = (found.time - found.time[0]) / found.length
    motion = _motion(z, displacement)

    def clearly(free: float, forced: float, unknowns: int) -> bool:
        return evident(free, forced, 2 * P, unknowns, motion)

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


def _motion(z: ComplexArray, values: Array) -> float:
    """Return the sum of the squares of a motion, no less than that of one with the errors of quantised values."""
    return max(float(np.vdot(z, z).real), len(z) * (QUANTISED * resolution(values) / MODEL_ERROR) ** 2)


def find_takes(time: Array, measured: Array) -> list[slice]:
    """Return the samples of each free decay in a record with several releases; empty if there are fewer than two.

    A release raises the amplitude within two windows, before and after which it falls.  The takes are several if a free
    decay in each of them is evident beside one free decay, and beside two or three modes that beat.
    """
    if len(time) < LEAST_SAMPLES or np.ptp(measured) == 0.0:
        return []
    frequency = peak_frequencies(time, measured - measured.mean())[0]
    found = track(time - time[0], measured, 2 * math.pi * frequency, most=MOST_TAKE_WINDOWS, degree=1, to_end=True)
    z, size = found.z, found.amplitude
    if len(z) < 2 * FEWEST + 1:
        return []
    k = (found.time - found.time[0]) / found.length
    least = REST_SWING * float(size.max())
    jumps = [0]
    for i in range(2, len(z) - 2):
        falls = size[i - 1] <= FALLING * size[i - 2] and size[i + 2] <= FALLING * size[i + 1] >= size[i]
        if falls and size[i + 1] > max(JUMP * size[i - 1], least) and i - jumps[-1] > 1:
            jumps.append(i)
    ends = [*jumps[1:], len(z)]
    takes = [slice(begin + 2 * (begin > 0), end) for begin, end in zip(jumps, ends, strict=True)]
    takes = [take for take in takes if take.stop - take.start >= FEWEST + 1 and size[take].max() > least]
    if len(takes) < 2:
        return []
    one = min(_lossy(k, z), _beating(k, z, 2), _beating(k, z, 3))
    share = sum(take.stop - take.start for take in takes) / len(z)  # of the windows, which hold as much of the noise
    several = sum(_lossy(k[take] - k[take.start], z[take]) for take in takes) / share
    motion = float(np.vdot(z, z).real)
    if several > MOST_LEFT_BY_TAKES * motion or not evident(
        one, several, 2 * len(z), 5 * len(takes), _motion(z, measured)
    ):
        return []
    step = typical_step(time)
    edges = time[0] + found.length * np.append(found.number, found.number[-1] + 1) - step / 2
    return [slice(*np.searchsorted(time, edges[[take.start, take.stop]]).tolist()) for take in takes]


def separate_takes(record: Measurement) -> tuple[Measurement, ...]:
    """Return each free decay of a record with several releases as a record; the record alone if there is one.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement, separate_takes
    >>> time = np.arange(3000) / 100.0
    >>> since = time % 15.0  # released at 0 and at 15 s
    >>> record = Measurement(time, 0.02 * np.exp(-0.2 * since) * np.cos(12.0 * since))
    >>> [f"{take.time[0]:.1f} to {take.time[-1]:.1f} s" for take in separate_takes(record)]
    ['0.0 to 14.6 s', '15.6 to 29.6 s']
    """
    check_instance(record, "record", Measurement)
    record = without_outliers(record)
    takes = find_takes(record.time, record.values) or [slice(None)]
    return tuple(
        Measurement(record.time[take], record.values[take], record.name, record.sensor, record.notes) for take in takes
    )


def unexplained_before(time: Array, measured: Array, ω: float, λ: float) -> tuple[float, float]:
    """Return the parts of the mean square of a record before a release that a mode under a harmonic force leaves.

    The first is explained by a harmonic force on the mode with frequency ω and rate λ (rad/s), the second is not.
    """
    if len(time) < LEAST_SAMPLES:
        return 0.0, 0.0
    found = track(time - time[0], measured, ω, most=MOST_TAKE_WINDOWS, degree=1, to_end=True)
    if len(found.z) < 2 * FEWEST + 1:
        return 0.0, 0.0
    k, z = (found.time - found.time[0]) / found.length, found.z
    noise = _scatter(k, z, _tails(k, z)[0][0])
    left = max(_forced(np.append(k, k[-1] + 1), z, complex(-λ * found.length))[0] - noise, 0.0)
    return max(float(np.vdot(z, z).real) - noise - left, 0.0) / (2 * len(k)), left / (2 * len(k))


def unexplained_share(time: Array, measured: Array, ω: float) -> float:
    """Return the share of a motion near a frequency (rad/s) that neither one free mode nor two explain, noise apart."""
    found = track(time - time[0], measured, ω, most=MOST_WINDOWS, degree=1)
    k, z = (found.time - found.time[:1]) / found.length, found.z
    if len(z) < 2 * FEWEST + 1:
        return 0.0
    noise = _scatter(k, z, _tails(k, z)[0][0])
    return max(min(_lossy(k, z), _beating(k, z, 2)) - noise, 0.0) / float(np.vdot(z, z).real)


def grows_slowly(time: Array, displacement: Array, frequency: float) -> bool:
    """Return whether the first oscillation of a given frequency (Hz) in a record grows over many windows."""
    found = _tracked(time, np.gradient(displacement, time), frequency)
    size = found.amplitude
    peak = int(np.argmax(size)) if size.size else 0
    size = size[np.append(-1, np.flatnonzero(~found.seen[:peak]))[-1] + 1 : peak + 1]
    growth = np.arange(len(size)) + 0.5
    if len(size) < 3:
        return False
    steady, grown = size - size.mean(), size - growth * (growth @ size) / (growth @ growth)
    alike, slow, motion = (float(values @ values) for values in (steady, grown, size))
    return evident(alike, slow, len(size) - 1, 0, motion)


def _tracked(time: Array, values: Array, frequency: float) -> Track:
    return track(time - time[0], values, 2 * math.pi * frequency, most=MOST_WINDOWS, degree=1)


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
    """Return the misfit of one free mode with dA/dk = -c - a A - b A^2 and a frequency that depends on A^2."""
    A = np.abs(z)
    loss = losses_of(A, [since_start(k, 1 / A), k, since_start(k, A)])[2]
    return loss + regression([np.ones(len(z)), k, since_start(k, A**2)], np.unwrap(np.angle(z)), A)[1]


def _beating(k: Array, z: ComplexArray, modes: int) -> float:
    """Return the misfit of several free modes, by the matrix pencil."""
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
