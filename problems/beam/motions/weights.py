"""Weights of the residuals of different sensors, from their noise, and a tolerance of the integration to match.

With the standard deviation s_c of channel c, its residuals enter a fit as (computed - measured)/s_c, and the fit weighs
them by the geometric mean G of all s_c (``ancf_casadi.estimation.solve``).

The standard deviations come from the user or from the record.  At first, third differences of the samples give them: a
smooth motion cancels in

    sum_j w_j y_j,    w_j ~ 1/prod_(k /= j) (t_j - t_k),    sum w_j^2 = 1,

over four successive samples, and white noise keeps its variance.  After a first fit, the root mean square of the
residuals of each channel takes their place, and the fit is repeated once from its estimates (iteratively reweighted
least squares).  The positions in a record have one standard deviation, that of their camera; any other channel has its
own.

No standard deviation is below ``MODEL_STD`` times the travel of the channel, the root mean square about its mean.

The tolerance of the integration follows from the noise and the effect of the integration error.  An error c of the
computed readings, one number for each of the m residuals, shifts no estimate by more than |c|/s standard errors
(``Fit.shifts``), where s^2 is the variance of the residuals, and by no more than ``LARGEST_SHIFT`` if the tolerance is
fine enough.  One integration at the estimates, at a tolerance smaller by the factor ``CHECK_RATIO``, checks this: its
error is smaller by about the same factor, so that c is the difference of the residuals.  It costs one run without
derivatives; a fit takes about ten with derivatives.  If a shift is too large, the tolerance, to which the error is
about proportional, decreases in proportion to the shift (``ancf_casadi.estimation.solve``).

The first tolerance follows from the record.  The part of c in the direction of a parameter has a root mean square of
about ``ERROR_GAIN`` times the tolerance and the size of the readings: the length L of the beam for positions (measured
for tolerances from 1e-6 to 1e-10, over one to ten periods), and ten times the travel of any other channel.  With the
root mean square size a of the weighted residuals,

    tolerance = LARGEST_SHIFT s / (m^1/2 ERROR_GAIN a),

where the noise in s comes from third differences of the samples.  Other motions may have another ``ERROR_GAIN``; the
check covers them.

A record may itself be integrated.  Without noise, the residuals are then the integration errors of the record and of
the fit.  These are not white noise: they stay in phase with the motion, and a parameter absorbs most of them, so that
the residuals do not show them (if IDAS integrated the record, its numerical damping appears as air drag).  The standard
errors therefore include a systematic error (``Fit.systematic``) of ``MODEL_STD`` times the travel of the record.  This
is negligible beside the noise of a camera, 1e-4 to 1e-2 of the travel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.block import SeriesWeights, alike
from ancf_casadi.estimation.solve import LARGEST_SHIFT
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from problems.beam.motions.record import FEWEST_SAMPLES, Channel, MotionRecord

CHECK_RATIO = 30.0
ERROR_GAIN = 0.1
USUAL_TRAVEL = 0.1  # usual travel of a beam over its length
COARSEST, TIGHTEST = 1e-6, 1e-10  # tolerances; the latter is checked at 3e-12, where rounding sets in
LENGTHS = ("position", "displacement")
MODEL_STD = 2e-5  # systematic error of a record, relative to its travel


def first_weights(records: Sequence[MotionRecord], *, robust: bool = False) -> SeriesWeights:
    """Return the weights of records, from the third differences of the samples where the noise is not given."""
    channels = [channel for record in records for channel in record.own_channels]
    groups = alike(  # the positions in a record share a standard deviation, and any other channel has its own
        number if one.sensor.quantity == "position" and one.std is None else (number, k)
        for number, record in enumerate(records)
        for k, one in enumerate(record.own_channels)
    )
    for group in groups:
        first = channels[group[0]]
        if first.std is None and sum(channels[k].measurement.time.size for k in group) < FEWEST_SAMPLES:
            raise InputError(
                f"{first.label} has fewer than {FEWEST_SAMPLES} samples, too few to find their noise; "
                "give Channel(std=...)",
                "channels",
            )
    lengths = np.array([channel.measurement.time.size for channel in channels])
    travels = np.array([float(channel.measurement.values.std()) for channel in channels])
    for own in map(list, groups):
        travels[own] = math.sqrt(float(lengths[own] @ travels[own] ** 2) / float(lengths[own].sum()))
    weights = SeriesWeights(
        lengths=lengths,
        deviations=np.array([channel.std or 1.0 for channel in channels]),
        floors=MODEL_STD * travels,
        groups=groups,
        known=tuple(channels[group[0]].std is not None for group in groups),
    )
    found = weights.improved([third_differences(channel) for channel in channels], robust=robust)
    if not found.deviations.all():
        label = channels[int(np.argmin(found.deviations))].label
        raise InputError(f"{label} is constant; leave it out, or give Channel(std=...)", "channels")
    return found


def third_differences(channel: Channel) -> Array:
    """Return the third differences of a record, scaled so that white noise keeps its variance."""
    time, values = channel.measurement.time, channel.measurement.values
    if time.size < 4:
        return np.zeros(0)
    times, samples = (np.lib.stride_tricks.sliding_window_view(part, 4) for part in (time, values))
    span = times[:, 3] - times[:, 0]
    # largest duration of four successive samples, relative to the median: no gap is among them
    kept = span <= 1.5 * np.median(span)
    times, samples = times[kept], samples[kept]
    gaps = (times[:, :, None] - times[:, None, :]) / span[kept][:, None, None] + np.eye(4)
    weights = 1 / gaps.prod(axis=2)
    return np.asarray((weights * samples).sum(axis=1) / np.linalg.norm(weights, axis=1))


def first_tolerance(records: Sequence[MotionRecord], weights: SeriesWeights, length: float) -> float:
    """Return the first tolerance for a beam of a length (m)."""
    quantities = [channel.sensor.quantity for record in records for channel in record.own_channels]
    pairs = zip(quantities, (weights.floors / MODEL_STD).tolist(), strict=True)
    sizes = np.array([length if quantity in LENGTHS else travel / USUAL_TRAVEL for quantity, travel in pairs])
    root = math.sqrt(float(weights.lengths.sum()))
    wanted = (
        LARGEST_SHIFT
        * math.hypot(1.0, root * weights.root_mean_square(weights.floors))
        / (root * ERROR_GAIN * weights.root_mean_square(sizes))
    )
    return min(max(wanted, TIGHTEST), COARSEST)


def tighter(tolerance: float, shift: float) -> float:
    """Return the tolerance that is expected to reduce a shift, in standard errors, to the allowed one."""
    # 2: additional factor by which a tolerance is tightened
    return max(tolerance * LARGEST_SHIFT / (2.0 * shift), TIGHTEST)
