"""Frequency response functions from records of force and response over time.

With spectra F and Y of force and response in K blocks and their mean products G_ff, G_yy and G_fy = mean(conj(F) Y),

    H1 = G_fy/G_ff,    H2 = G_yy/conj(G_fy),    Hv = (G_yy/G_ff)^1/2 G_fy/|G_fy|,    gamma^2 = |G_fy|^2/(G_ff G_yy).

H1 is right if the noise is that of the response, H2 if it is that of the force, Hv if both are equally noisy.  Noise of
the other channel changes the size of H1 and H2; it changes the damping only where its ratio to the signal changes over
a resonance, as that of the response does and that of an even force does not: H1 is the default.  Each has the variance

    E|H - H_0|^2 = |H|^2 (1 - gamma^2)/gamma^2/K_e,    K_e = K/(1 + 2 sum_j (1 - j/K) rho_j^2),

where rho_j is the correlation of two windows, j blocks apart (Welch).  It is computed from the relative deviations of
the blocks, to first order

    conj(F) (Y - H1 F)/G_fy for H1,    conj(Y) (Y - H2 F)/G_yy for H2,    their mean for Hv,

as the mean of their squares over K_e - 1, averaged over neighbouring lines.  Under a shaker, the deviations also give
the errors of a fit (``refinement``).  A few hits are too few for that, and most of their scatter does no harm to the
poles: the error of a short force changes slowly with the frequency, and the rest of an earlier vibration has the same
poles (``window``).  Their variance is therefore that of second differences along the lines, by the median over
neighbouring lines, which a resonance does not disturb.

References
----------
J. S. Bendat, A. G. Piersol, Random Data: Analysis and Measurement Procedures, Wiley (2010), Chapters 6 and 9.
P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Transactions on Audio and
Electroacoustics 15 (1967).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import chdtri

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import sampling_step
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.inputs import choice, error_prefix, instances, number, physical
from problems.frf.blocks import LEAST_BLOCK, Take, hammer_blocks, shaker_blocks
from problems.frf.record import KINDS, LEAST_LINES, SCATTER_LINES, BlockScatter, FrfRecord, least_std, moving_mean
from problems.frf.window import BlockWindow, hann_window

Estimator = Literal["H1", "H2", "Hv"]
Excitation = Literal["auto", "hammer", "shaker"]
Window = Literal["hann", "none"]
LEAST_POWER = 0.01  # of the force, relative to its highest: the end of the usable band
LARGEST_FREQUENCY = 0.8  # relative to half the sampling rate, beyond which a filter against aliasing acts
POWER_LINES = 5  # lines on either side over which the power of the force is averaged
RANDOM_SHARE, REST_SHARE = 0.5, 0.01  # mean squares of a random force and of a response at rest, relative to all
NOISE_LINES = 2  # lines on either side over which the noise under a Hann window is averaged
LARGEST_SHARE = 0.9  # of a block in the power of all
FEWEST_AVERAGES = 6.0  # independent blocks that state the errors of a fit
TIME_CONSTANTS = 4.0  # of an exponential window, after which a block ends
SAME_TIME = 0.1  # largest difference of the times of force and response, in steps


def frf_of(
    force: Measurement | Sequence[Measurement],
    response: Measurement | Sequence[Measurement | Sequence[Measurement]],
    *,
    estimator: Estimator = "H1",
    excitation: Excitation = "auto",
    window: Window | None = None,
    time_constant: float | None = None,
    block: float | None = None,
    overlap: float = 0.5,
    kind: FrfKind | None = None,
    points: Sequence[float] | None = None,
) -> FrfRecord:
    """Estimate frequency response functions from force and response over time, under a hammer or a shaker.

    Hits that are doubled or overloaded are left out, with a note.  ``fit_frf`` allows for the windows: the damping of
    an exponential window and, for H1, the leakage of a Hann window do not enter its damping ratios.

    Parameters
    ----------
    force : Measurement or sequence of Measurement
        Force over time; several records are averaged.
    response : Measurement or sequence
        Response at the times of the force: one record, or a list of one per output; for several forces, a list with
        such an entry for each.
    estimator : {"H1", "H2", "Hv"}
        H1 for noise of the response, H2 for noise of the force, Hv for both.
    excitation : {"auto", "hammer", "shaker"}
        Hits, or a continuous force; the force shows which if not given.
    window : {"hann", "none"}, optional
        Window of the blocks under a shaker: ``"hann"`` (default) for random forces, ``"none"`` for forces that are
        periodic in a block, and for bursts whose response ends within it.
    time_constant : float, optional
        Time constant, s, of an exponential window on the blocks of a hammer; none if not given.
    block : float, optional
        Length of a block, s; if not given, up to the next hit and four time constants at most, and under a shaker that
        of 20 overlapping blocks.
    overlap : float
        Overlap of the blocks under a shaker, 0 to 0.9.
    kind : str, optional
        Kind of the functions, if the quantity of the responses does not tell it.
    points : sequence of float, optional
        Arc lengths of the outputs from the clamp, m.

    Raises
    ------
    InputError
        If the records differ in their times, are unevenly sampled, or hold no usable block.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement, Sensor
    >>> from problems import fit_frf, frf_of
    >>> time, rng = np.arange(20_000) / 500.0, np.random.default_rng(0)
    >>> force, response = np.zeros(20_000), 1e-7 * rng.normal(size=20_000)
    >>> for hit in (1.0, 15.0, 27.0):
    ...     t = np.clip(time - hit, 0.0, None)
    ...     force += np.where(t < 0.01, 50.0 * np.sin(100 * np.pi * t), 0.0)
    ...     response += 1e-4 * np.exp(-0.5 * t) * np.sin(50.0 * t)
    >>> record = frf_of(Measurement(time, force, sensor=Sensor("force")), Measurement(time, response))
    >>> fit = fit_frf(record, frequencies=[8.0])
    >>> f"{fit.frequencies[0]:.3f} Hz, damping ratio {fit.damping_ratios[0]:.4f}"
    '7.958 Hz, damping ratio 0.0100'
    """
    choice(estimator, get_args(Estimator), "estimator")
    choice(excitation, get_args(Excitation), "excitation")
    if window is not None:
        choice(window, get_args(Window), "window")
    duration = None if block is None else physical(block, "block")
    if not 0.0 <= number(overlap, "overlap") <= 0.9:
        raise InputError(f"must be between 0 and 0.9, got {overlap:g}", "overlap")
    rate = 0.0 if time_constant is None else 1.0 / physical(time_constant, "time_constant")
    forces, responses = _pair_records(force, response)
    takes = [_join(*pair) for pair in zip(forces, responses, strict=True)]
    step = takes[0].step
    if any(abs(take.step - step) > 1e-6 * step or len(take.channels) != len(takes[0].channels) for take in takes):
        raise InputError("differ in their sampling rate or number of outputs; give one kind of records", "response")
    is_hammer = excitation == "hammer" or (excitation == "auto" and all(take.is_impulsive() for take in takes))
    if is_hammer and window is not None:
        raise InputError("belongs to a shaker; a hammer takes time_constant", "window")
    if not is_hammer and rate:
        raise InputError("belongs to the hits of a hammer; a shaker takes window", "time_constant")
    blocks = hammer_blocks(takes, duration) if is_hammer else shaker_blocks(takes, duration, overlap)
    is_hann = not is_hammer and window != "none"
    if rate and block is None:
        blocks = replace(blocks, values=blocks.values[:, :, : max(LEAST_BLOCK, round(TIME_CONSTANTS / rate / step))])
    size = blocks.values.shape[2]
    weights = hann_window(size) if is_hann else np.exp(-rate * step * np.arange(size))
    averages = len(blocks.values) if is_hammer else _independent_blocks(weights, len(blocks.values), overlap)
    spectra = np.fft.rfft(weights * blocks.values)
    lines = _usable_lines(np.mean(np.abs(spectra[:, 0]) ** 2, axis=0))
    values, coherence, deviations = _estimate(spectra[:, :1, lines], spectra[:, 1:, lines], estimator)
    scatter = BlockScatter(deviations, averages, tuple(takes), blocks.places)
    is_repeated = len(spectra) > 1
    with error_prefix("force and response"):
        return FrfRecord(
            lines / (size * step),
            values,
            _kind(responses[0]) if kind is None else kind,
            coherence=coherence if is_repeated else None,
            std=_standard_deviations(values, scatter, is_hammer=is_hammer) if is_repeated else None,
            points=points,
            notes=(*blocks.notes, *_leakage_notes(blocks.values, is_free=is_hammer or is_hann)),
            window=BlockWindow(size * step, rate, is_hann, estimator),
            scatter=None if is_hammer or averages < FEWEST_AVERAGES else scatter,
        )


def _pair_records(force: Any, response: Any) -> tuple[tuple[Measurement, ...], list[tuple[Measurement, ...]]]:
    """Return the forces of the takes, and the responses of each."""
    if isinstance(force, Measurement):
        force, response = [force], [response]
    forces = instances(force, "force", Measurement)
    entries = instances(response, "response", object)
    if len(forces) != len(entries):
        raise InputError(f"has {len(entries)} entries for {len(forces)} forces; give one for each", "response")
    responses = [
        (entry,) if isinstance(entry, Measurement) else instances(entry, "response", Measurement) for entry in entries
    ]
    for record in forces:
        if record.sensor.quantity not in ("force", "signal"):
            raise InputError(f"is a {record.sensor.quantity}; give it a sensor of the quantity 'force'", "force")
    return forces, responses


def _join(force: Measurement, responses: Sequence[Measurement]) -> Take:
    """Return a force and its responses at the same even times."""
    with error_prefix(force.name or "force"):
        step = sampling_step(force.time)
    for record in responses:
        if len(record.time) != len(force.time) or np.abs(record.time - force.time).max() > SAME_TIME * step:
            raise InputError("has other times than the force; record both together", record.name or "response")
    channels = np.array([record.values - record.values.mean() for record in (force, *responses)])
    if not channels.any(axis=1).all():
        raise InputError("is constant in the force or a response; name other columns", force.name or "force")
    return Take(force.name or "record", channels, float(force.time[0]), step)


def _kind(responses: Sequence[Measurement]) -> FrfKind:
    """Return the kind of the functions by the quantity of the responses."""
    quantities = {record.sensor.quantity for record in responses}
    kinds = {KINDS.get(quantity) for quantity in quantities}
    kind = kinds.pop()
    if kinds or kind is None:
        raise InputError(
            f"measures {' and '.join(sorted(quantities))}; give the kind of the functions, such as 'accelerance'",
            "response",
        )
    return kind


def _independent_blocks(weights: Array, count: int, overlap: float) -> float:
    """Return the number K_e of independent blocks that average as well as overlapping ones."""
    stride, squares = max(1, round(len(weights) * (1 - overlap))), 0.0
    for j in range(1, min(count, -(-len(weights) // stride))):
        correlation = weights[j * stride :] @ weights[: len(weights) - j * stride] / (weights @ weights)
        squares += float((1 - j / count) * correlation**2)
    return count / (1 + 2 * squares)


def _leakage_notes(blocks: Array, *, is_free: bool) -> list[str]:
    """Return a note if blocks without a window neither repeat nor end at rest, unless they are free of leakage."""
    changes = blocks[:, 0] - blocks[:, 0].mean(axis=0)
    end = max(1, blocks.shape[2] // 20)
    repeats = len(blocks) > 1 and np.mean(changes**2) < RANDOM_SHARE * np.mean(blocks[:, 0] ** 2)
    if is_free or repeats or np.mean(blocks[:, 1:, -end:] ** 2) < REST_SHARE * np.mean(blocks[:, 1:] ** 2):
        return []
    return [
        "the force does not repeat from block to block, and the response lasts beyond them: leakage adds to the "
        "damping; use the Hann window, or blocks of one period of the force"
    ]


def _usable_lines(power: Array) -> Index:
    """Return the numbers of the lines about the strongest one at which the force is strong enough."""
    smooth = moving_mean(power, POWER_LINES)
    least_power = LEAST_POWER * float(smooth.max())
    smooth[[0, *range(int(LARGEST_FREQUENCY * len(power)), len(power))]] = 0.0
    is_weak, peak = smooth <= least_power, int(np.argmax(smooth))
    first = int(np.flatnonzero(is_weak[: peak + 1])[-1]) + 1
    end = peak + int(np.argmax(np.append(is_weak[peak:], True)))
    if end - first < LEAST_LINES:
        raise InputError("is too short for eight lines with a force below 0.8 times half the sampling rate", "block")
    return np.arange(first, end)


def _estimate(
    force: ComplexArray, responses: ComplexArray, estimator: Estimator
) -> tuple[ComplexArray, Array, ComplexArray]:
    """Return the functions and their coherence (outputs, lines), and the deviations of the blocks from the functions.

    The spectra of the force are (blocks, 1, lines), those of the responses (blocks, outputs, lines).  H2 is the inverse
    of the H1 with each response as input and the force as output.
    """
    h1, h1_deviations = h1_functions(force, responses)
    inverse_h2, inverse_deviations = h1_functions(responses, force)
    coherence = np.clip((h1 * inverse_h2).real, 0.0, 1.0)
    values = h1 * coherence ** {"H1": 0.0, "H2": -1.0, "Hv": -0.5}[estimator]
    by_force, by_response = h1_deviations / h1, -inverse_deviations / inverse_h2
    relative = {"H1": by_force, "H2": by_response, "Hv": (by_force + by_response) / 2}[estimator]
    return values, coherence, values * relative


def h1_functions(inputs: ComplexArray, outputs: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return H1 from spectra of blocks, (blocks, ..., lines), and the deviations of the blocks from it, to first order.

    A block with the share h of the power of the input, to which H1 is closer, has residuals of variance 1 - h instead
    of 1 - 1/K; its deviations are those of blocks with equal shares.
    """
    power = np.abs(inputs) ** 2
    share = np.minimum(power / power.sum(axis=0), LARGEST_SHARE)
    values = np.mean(inputs.conj() * outputs, axis=0) / power.mean(axis=0)
    deviations = inputs.conj() * (outputs - values * inputs) / power.mean(axis=0)
    return values, deviations * np.sqrt((1 - 1 / len(power)) / (1 - share))


def _standard_deviations(values: ComplexArray, scatter: BlockScatter, *, is_hammer: bool) -> Array:
    """Return standard deviations of functions (outputs, lines); under a hammer, of errors that differ line by line."""
    if is_hammer:
        differences = scatter.map(
            lambda deviations: np.pad(np.diff(deviations, 2), ((0, 0), (0, 0), (1, 1)), mode="edge") / math.sqrt(6)
        )
        freedom = 2 * scatter.averages - 2
        variance = median_filter(differences.variance, (1, 2 * SCATTER_LINES + 1)) * freedom / chdtri(freedom, 0.5)
    else:
        variance = moving_mean(scatter.variance, NOISE_LINES)
    return np.asarray(np.maximum(np.sqrt(variance), least_std(values)))
