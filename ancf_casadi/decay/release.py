"""Detection of the start of the free decay in a record: the end of an initial rest, or the end of an excitation.

Rest.  Before the largest swing, the last window of half a period in which almost nothing moves gives the level of rest.
The decay begins at the first sample after the last one at this level: the release itself lies between the two, and the
closed forms hold from any later instant on.  A window holds the samples at their own times.  One with a hole of more
than half its length may hide a swing and is not taken for rest.

Excitation.  Relative to a carrier near its frequency, the record is y = Re(z exp(i omega t)) with a slow z, estimated
in windows of whole periods (``track``).  A free mode has z_k = a q^k, and a harmonic force leads to B p^k + C q^k with
|p| = 1, so that an excitation that ends in window s - 1 leaves the misfit

    S(s) = min sum_{k < s-1} |z_k - B p^k - C q^k|^2 + min sum_{k >= s} |z_k - a q^k|^2

with q from the second sum.  There is an excitation if two conditions hold.  First, it is evident (``bic``) beside
each free decay: one mode with an amplitude-dependent loss, dA/dk = -c - a A - b A^2 with a, b, c >= 0, or two or three
modes that beat.  Second, the force beats with the mode or supplies energy.  The release is then the latest one beside
which no other is evident: the closed forms hold from any later instant on, whereas a release that is too early spoils
a fit.

The windows of a long record hold many periods.  A motion that ends within a few of them is therefore searched in
shorter ones first, which divide its second half, and so on.  At least three windows must follow the excitation.

Gaps.  A piece of less than one and a half periods between the release and a gap is left out, because it does not show
whether the beam rests or moves.  If the decay begins at the end of a gap, a note says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.decay.bic import MODEL_ERROR, larger_model_is_evident
from ancf_casadi.decay.outliers import without_outliers
from ancf_casadi.decay.spectrum import GAP, MIN_WINDOW_SAMPLES, peak_frequencies, step_frequency, typical_step
from ancf_casadi.decay.track import (
    Track,
    fit_forced_response,
    fit_free_tails,
    one_mode_misfit,
    scatter_misfit,
    several_modes_misfit,
    track_oscillation,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import resolution, without_line
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.inputs import check_instance, number

# Tests that fail: test_a_record_in_which_nothing_oscillates_is_refused (either minimum halved),
# test_an_excitation_that_grows_out_of_the_noise_is_not_taken_for_rest_and_release (REST_SWING doubled, RELEASE_SWING
# halved), test_a_release_after_rest_is_no_excitation (RELEASE_SWING doubled), test_a_plain_decay_is_never_cut
# (MIN_WINDOWS halved), test_the_decay_begins_at_the_first_sample_in_motion (MOTION_LEVEL halved), and
# test_a_record_is_refused_from_a_share_of_gaps_of_95_percent_on (MAX_LENGTH either way).
MAX_LENGTH = 20.0  # largest length of a record, relative to that of its samples without the gaps
MIN_SAMPLES = 10
MIN_PERIODS = 1.5  # fewer do not show whether the beam rests or moves
REST_SWING = 0.25  # largest swing of a window at rest, relative to all; with a free oscillation it is at least 0.5
RELEASE_SWING = 0.8  # relative swing that a released beam reaches within a period; that of a driven beam grows slowly
MAX_WINDOWS = 128  # limits the time of the search, which grows with the cube (benchmarks/test_decay_fit.py)
MIN_WINDOWS = 3  # windows with a force, and without: B, C and p need three
ALL_RELEASES = "fit_decays(separate_takes(record)), or --release all"
MAX_TAKE_WINDOWS = 512  # of a record with several releases
RELEASE_JUMP = 1.25  # least growth of the amplitude at a release, from one window to the next but one
MAX_UNEXPLAINED = 0.04  # share of the motion that a free decay leaves; random responses leave more
MAX_UNEXPLAINED_BY_TAKES = 0.02  # the same for several releases
QUANTISATION_ERROR = 0.25  # error of the amplitude of a quantised oscillation, in steps of the quantisation
DECAY_TOLERANCE = 1.05  # largest growth of the amplitude, due to noise, from window to window of a decay
MOTION_LEVEL = 0.02  # departure that does not count as motion, relative to the largest swing


@dataclass(frozen=True)
class Release:
    """Start of a free decay."""

    index: int  # of the first sample of the decay
    reason: str  # the first sample, the end of rest, the end of an excitation, the end of a gap, or given
    frequency: float = 0.0  # of the strongest oscillation before and after it, Hz; 0 if there are too few samples
    notes: tuple[str, ...] = ()  # reasons for doubt


def find_release(time: Array, measured: Array, release_time: float | None = None) -> Release:
    """Return the start of the free decay in values of any sensor: given, or detected after rest or an excitation.

    If none is given and the record holds several releases, return the last one.
    """
    if len(time) < MIN_SAMPLES or np.ptp(measured) == 0.0:
        return Release(0, "the first sample")
    step = typical_step(time)
    if time[-1] - time[0] > MAX_LENGTH * step * len(time):
        share = 1 - step * len(time) / (time[-1] - time[0])
        raise InputError(f"consists of gaps for {share:.0%} of its length; cut out the part with the decay", "record")
    without_drift = without_line(time, measured)
    frequency = step_frequency(time, without_drift)
    if release_time is not None:
        begin = int(np.searchsorted(time, number(release_time, "release_time") - 1e-6 * step))
        return Release(begin, "given", frequency)
    takes = find_takes(time, measured)
    take_start = takes[-1].start if takes else 0
    t, y = time[take_start:], measured[take_start:]
    rest_end, grows_slowly_after = _find_end_of_rest(t, y, without_drift[take_start:], 1 / frequency, step)
    excitation_end = rest_end + find_end_of_excitation(t[rest_end:], y[rest_end:])
    if excitation_end == rest_end and grows_slowly_after:
        excitation_end = find_end_of_excitation(t, y)  # the rest may be a weak excitation
    begin = _skip_gaps(t, max(rest_end, excitation_end), 1 / frequency, step)
    reason, notes = "the end of rest" if rest_end else "the first sample", list[str]()
    if excitation_end > rest_end:
        reason = "the end of an excitation"
    if takes:
        reason, times = "the last of several releases", ", ".join(f"{time[take.start]:.4g} s" for take in takes)
        notes.append(
            f"the record holds {len(takes)} releases, at about {times}; the last one is fitted (all: {ALL_RELEASES})"
        )
    gap = float(t[begin] - t[begin - 1]) if begin else 0.0
    if gap > GAP * step:
        if not takes:
            reason = "the end of a gap"
        notes.append(
            f"a gap of {gap:.3g} s hides the release or follows it closely; the decay is fitted from the end of the "
            f"gap, {t[begin]:g} s"
        )
    return Release(take_start + begin, reason, frequency, tuple(notes))


def _skip_gaps(time: Array, begin: int, period: float, step: float) -> int:
    """Return the first sample after all gaps that follow the begin too closely to distinguish rest from motion."""
    longest = max(period / 2, GAP * step)
    first_periods = slice(begin, int(np.searchsorted(time, time[begin] + 4 * MIN_PERIODS * period)))
    for gap in (begin + np.flatnonzero(np.diff(time[first_periods]) > longest)).tolist():
        if time[gap] - time[begin] < MIN_PERIODS * period:
            begin = gap + 1
    return begin


def _find_end_of_rest(
    time: Array, measured: Array, without_drift: Array, period: float, step: float
) -> tuple[int, bool]:
    """Return the index of the first sample after rest, 0 if there is none, and whether the swing then grows slowly."""
    min_samples = min(MIN_WINDOW_SAMPLES, max(MIN_WINDOW_SAMPLES // 2, math.ceil(period / step)))
    width = max(period / 2, (min_samples - 1) * step)
    last_indices = np.maximum(np.searchsorted(time, time + width - step / 2), np.arange(len(time)) + min_samples - 1)
    last_indices = last_indices[last_indices < len(time)]
    if not last_indices.size:
        return 0, False
    swing = _sliding_maximum(without_drift, last_indices) + _sliding_maximum(-without_drift, last_indices)
    has_no_hole = _sliding_maximum(np.append(np.diff(time), 0.0), last_indices - 1) <= max(width / 2, 2.5 * step)
    rest_windows = np.flatnonzero((has_no_hole & (swing <= REST_SWING * swing.max()))[: int(np.argmax(swing))])
    if rest_windows.size == 0:
        return 0, False
    begin, end = int(rest_windows[-1]), int(last_indices[rest_windows[-1]])
    level = np.median(measured[begin : end + 1])
    departure = np.abs(measured - level)
    at_rest = departure <= max(MOTION_LEVEL * swing.max(), 3 * np.median(departure[begin : end + 1]))
    last_at_rest = begin + int(np.flatnonzero(at_rest[begin : end + 1])[-1])
    while at_rest[last_at_rest + 1 : last_at_rest + 3].any():  # beyond the window, which ends before a hole
        last_at_rest += 1 if at_rest[last_at_rest + 1] else 2
    if last_at_rest + 1 == len(time):
        return 0, False
    following = slice(last_at_rest, int(np.searchsorted(time, time[last_at_rest] + 2 * width)))
    return last_at_rest + 1, bool(
        has_no_hole[following].all() and swing[following].max(initial=0.0) < RELEASE_SWING * swing.max()
    )


def _sliding_maximum(values: Array, last_indices: Index) -> Array:
    """Return the maximum of ``values`` from each index i to ``last_indices[i]``, by maxima over 1, 2, 4, ... values."""
    first_indices = np.arange(len(last_indices))
    counts = last_indices - first_indices + 1
    maxima, span_maxima, span = np.empty(len(last_indices)), values, 1
    while span <= counts.max():
        of_span = (span <= counts) & (counts < 2 * span)
        maxima[of_span] = np.maximum(span_maxima[first_indices[of_span]], span_maxima[last_indices[of_span] - span + 1])
        if span > counts.max() // 2:
            break
        span_maxima, span = np.maximum(span_maxima[:-span], span_maxima[span:]), 2 * span
    return maxima


def find_end_of_excitation(time: Array, displacement: Array) -> int:
    """Return the index of the first sample after an excitation; 0 if there is none.

    A motion that ends within a few windows is searched in shorter ones first, which divide its second half.
    """
    if len(time) < MIN_WINDOW_SAMPLES:
        return 0
    ω = 2 * math.pi * peak_frequencies(time, displacement - displacement.mean())[0]
    track = _track_windows(time, displacement, ω)
    A, windows = track.amplitude, len(track.z)
    if windows < 2 * MIN_WINDOWS + 1:
        return 0
    last_windows = windows - 1 - int(np.flatnonzero(A > A.max() / 2)[-1])  # with less than half of the largest swing
    if 0 < last_windows <= 2 * MIN_WINDOWS and ω * (time[-1] - time[0]) > 2 * math.pi * MAX_WINDOWS:
        begin, end = (_first_sample(time, track, k) for k in (track.number[windows // 2], track.number[-1] + 1))
        later_end = find_end_of_excitation(time[begin:end], displacement[begin:end])
        if later_end:
            return begin + later_end
    return _find_end_in_windows(time, displacement, track)


def _first_sample(time: Array, track: Track, window: int) -> int:
    """Return the index of the first sample of a window."""
    return int(np.searchsorted(time, time[0] + window * track.length - track.step / 2))


def _find_end_in_windows(time: Array, displacement: Array, track: Track) -> int:
    """Return the index of the first sample of the window that follows an excitation; 0 if there is none."""
    k, z, windows = track.k, track.z, len(track.z)
    motion = _motion_power(z, displacement)

    def is_evident(free: float, forced: float, added_unknowns: int) -> bool:
        return larger_model_is_evident(free, forced, 2 * windows, added_unknowns, motion)

    log_q, free_misfits = fit_free_tails(k, z)
    single_misfit, unknowns = float(free_misfits[0]), 10  # of a force and its end: q, its amplitude, B, p, C and s
    # no smooth z is evident beside one mode, with four unknowns
    if not is_evident(single_misfit, scatter_misfit(k, z, log_q[0]), unknowns - 4):
        return 0
    misfits: dict[int, float] = {}
    sustained: dict[int, bool] = {}

    def best_end(ends: range) -> int:
        for s in ends:
            if s not in misfits:
                misfit, sustained[s] = fit_forced_response(k[:s], z[: s - 1], log_q[s])
                misfits[s] = (misfit + float(free_misfits[s])) * windows / (windows - 1)
        return min(misfits, key=lambda s: (misfits[s], s))

    # the misfit falls towards a short decay after a long excitation only within a few windows
    coarse_end = best_end(range(MIN_WINDOWS + 1, windows - MIN_WINDOWS + 1, MIN_WINDOWS))
    reach = math.isqrt(windows)
    first, last = max(MIN_WINDOWS + 1, coarse_end - reach), min(windows - MIN_WINDOWS, coarse_end + 2 * reach)
    end = best_end(range(first, last + 1))
    best_misfit = misfits[end]
    if not sustained[end] or not is_evident(single_misfit, best_misfit, unknowns - 4):
        return 0
    if not is_evident(one_mode_misfit(k, z), best_misfit, unknowns - 7):
        return 0
    if not all(is_evident(several_modes_misfit(k, z, modes), best_misfit, unknowns - 4 * modes) for modes in (2, 3)):
        return 0
    latest_end = max(s for s, misfit in misfits.items() if not is_evident(misfit, best_misfit, 0))
    return _first_sample(time, track, int(track.number[latest_end]))


def _motion_power(z: ComplexArray, values: Array) -> float:
    """Return the sum of squares of a motion, raised so that the model error covers the quantisation of the values."""
    return max(float(np.vdot(z, z).real), len(z) * (QUANTISATION_ERROR * resolution(values) / MODEL_ERROR) ** 2)


def find_takes(time: Array, measured: Array) -> list[slice]:
    """Return the samples of each free decay in a record with several releases; empty if there are fewer than two.

    A release raises the amplitude within two windows; before and after, the amplitude falls.  There are several takes
    if a free decay in each of them is evident beside one free decay, and beside two or three modes that beat.
    """
    if len(time) < MIN_WINDOW_SAMPLES or np.ptp(measured) == 0.0:
        return []
    frequency = peak_frequencies(time, measured - measured.mean())[0]
    track = track_oscillation(
        time - time[0], measured, 2 * math.pi * frequency, max_windows=MAX_TAKE_WINDOWS, degree=1, to_end=True
    )
    z, A = track.z, track.amplitude
    if len(z) < 2 * MIN_WINDOWS + 1:
        return []
    k = track.k
    min_amplitude = REST_SWING * float(A.max())
    jumps = [0]
    for i in range(2, len(z) - 2):
        before, release, after = A[i - 2 : i], A[i], A[i + 1 : i + 3]
        falls = before[1] <= DECAY_TOLERANCE * before[0] and after[1] <= DECAY_TOLERANCE * after[0] >= release
        if falls and after[0] > max(RELEASE_JUMP * before[1], min_amplitude) and i - jumps[-1] > 1:
            jumps.append(i)
    ends = [*jumps[1:], len(z)]
    takes = [slice(begin + 2 * (begin > 0), end) for begin, end in zip(jumps, ends, strict=True)]
    takes = [take for take in takes if take.stop - take.start >= MIN_WINDOWS + 1 and A[take].max() > min_amplitude]
    if len(takes) < 2:
        return []
    single_misfit = min(one_mode_misfit(k, z), several_modes_misfit(k, z, 2), several_modes_misfit(k, z, 3))
    window_share = sum(take.stop - take.start for take in takes) / len(z)  # and share of the noise in the takes
    takes_misfit = sum(one_mode_misfit(k[take] - k[take.start], z[take]) for take in takes) / window_share
    if takes_misfit > MAX_UNEXPLAINED_BY_TAKES * float(np.vdot(z, z).real):
        return []
    motion = _motion_power(z, measured)
    if not larger_model_is_evident(single_misfit, takes_misfit, 2 * len(z), 5 * len(takes), motion):
        return []
    edges = time[0] + track.length * np.append(track.number, track.number[-1] + 1) - track.step / 2
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
    """Divide the mean square of a record before a release into that of a forced response and a remainder.

    The first is explained by a harmonic force on the mode with frequency ω and rate λ (rad/s), the second is not.
    """
    if len(time) < MIN_WINDOW_SAMPLES:
        return 0.0, 0.0
    track = track_oscillation(time - time[0], measured, ω, max_windows=MAX_TAKE_WINDOWS, degree=1, to_end=True)
    if len(track.z) < 2 * MIN_WINDOWS + 1:
        return 0.0, 0.0
    k, z = track.k, track.z
    noise = scatter_misfit(k, z, fit_free_tails(k, z)[0][0])
    unexplained = max(fit_forced_response(np.append(k, k[-1] + 1), z, complex(-λ * track.length))[0] - noise, 0.0)
    return max(float(np.vdot(z, z).real) - noise - unexplained, 0.0) / (2 * len(k)), unexplained / (2 * len(k))


def unexplained_share(time: Array, measured: Array, ω: float) -> float:
    """Return the share of a motion near a frequency (rad/s) that neither one nor two free modes nor noise explain."""
    track = _track_windows(time, measured, ω)
    k, z = track.k, track.z
    if len(z) < 2 * MIN_WINDOWS + 1:
        return 0.0
    noise = scatter_misfit(k, z, fit_free_tails(k, z)[0][0])
    return max(min(one_mode_misfit(k, z), several_modes_misfit(k, z, 2)) - noise, 0.0) / float(np.vdot(z, z).real)


def grows_slowly(time: Array, displacement: Array, frequency: float) -> bool:
    """Return whether the first oscillation of a given frequency (Hz) in a record grows over many windows."""
    track = _track_windows(time, np.gradient(displacement, time), 2 * math.pi * frequency)
    A = track.amplitude
    peak = int(np.argmax(A)) if A.size else 0
    A = A[np.append(-1, np.flatnonzero(~track.is_visible[:peak]))[-1] + 1 : peak + 1]
    ramp = np.arange(len(A)) + 0.5
    if len(A) < 3:
        return False
    constant_residuals, ramp_residuals = A - A.mean(), A - ramp * (ramp @ A) / (ramp @ ramp)
    squares = [float(values @ values) for values in (constant_residuals, ramp_residuals, A)]
    return larger_model_is_evident(squares[0], squares[1], len(A) - 1, 0, squares[2])


def _track_windows(time: Array, values: Array, ω: float) -> Track:
    """Return the oscillation near a frequency (rad/s) about a line in each of few windows."""
    return track_oscillation(time - time[0], values, ω, max_windows=MAX_WINDOWS, degree=1)
