"""Weights of the residuals of different sensors, from their noise, and a tolerance of the integration to match.

With the standard deviation s_c of channel c, its residuals enter a fit as (computed - measured)/s_c, and the fit weighs
them by the geometric mean G of all s_c (``ancf_casadi.estimation.problem``).

The standard deviations come from the user or from the record.  At first, third differences of the samples give them: a
smooth motion cancels in

    sum_j w_j y_j,    w_j ~ 1/prod_(k /= j) (t_j - t_k),    sum w_j^2 = 1,

over four successive samples, and white noise keeps its variance.  After a first fit, the root mean square of the
residuals of each channel takes their place, and the fit is repeated once from its estimates (iteratively reweighted
least squares).  The positions in a record have one standard deviation, that of their camera; any other channel has its
own.

No standard deviation is below ``MODEL_STD`` times the travel of the channel, the root mean square about its mean.

The tolerance of the integration follows from its error.  An error c of the computed readings shifts the estimates
(``Fit.shifts``), and it is part of the residuals.  A fit begins at a coarse tolerance (``coarse_tolerance``), because
far from the minimum nothing has to be accurate.  At its estimates, one integration without derivatives at a tolerance
smaller by the factor r gives c = (change of the readings)/(1 - r^-p), with the order p of the error, ``ERROR_ORDER``,
or at least ``LEAST_ORDER``.  The fit goes on from there at a tolerance smaller by r, at which the error is taken to be
r^-p c with the least order, besides an error of unknown direction, ``TYPICAL`` of that.  If this typically shifts an
estimate by more than ``LARGEST_SHIFT`` standard errors, the error is computed again, and so on, until its shifts are
small, and its root mean square is below ``MOST_VISIBLE`` standard deviations of the noise.  The error of the
derivatives counts too (``ancf_casadi.estimation.refinement``); it is at most r^-p/(1 - r^-p) times the change of the
derivatives since the last tolerance.  In 40 releases and base motions of a strip under four laws, the error falls from
1e-4 to 1e-5 with the orders 0.3 to 1.3, and 0.87 at the median.  A released strip rings: as long as steps do not follow
a mode, its error is the same at each tolerance, so a check of the error takes a much smaller one (``CHECK_RATIO``).

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
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from problems.beam.motions.record import FEWEST_SAMPLES, Channel, MotionRecord

COARSE, COARSE_PER_TRAVEL = 10**-3.5, 10**-2.2  # first tolerance: at most, and over the travel relative to the length
COARSE_WITHOUT_POSITIONS = 10**-4.5
ACCURATE = 1e-6  # for a motion that is not fitted
RATIO, CHECK_RATIO = 10.0, 10**1.5  # of the first tolerance to the second one, and of later ones
TYPICAL = 0.5  # integration error relative to that which is at most expected
MOST_VISIBLE = 0.2  # root mean square of an integration error that may be part of the residuals, standard deviations
ERROR_ORDER, LEAST_ORDER = 0.7, 0.3  # p, as expected and at least
TIGHTEST = 1e-10  # smallest tolerance; it is checked at a tenth, where rounding sets in
MOST_TIGHTENING = 100.0  # factor of the tolerance in one step
LENGTHS = ("position", "displacement")
MODEL_STD = 2e-5  # systematic error of a record, relative to its travel


def first_weights(records: Sequence[MotionRecord], *, robust: bool = False) -> SeriesWeights:
    """Return the weights of records, from the third differences of the samples where the noise is not given."""
    channels = [channel for record in records for channel in record.own_channels]
    groups = alike(  # the positions in a record share a standard deviation, and any other channel has its own
        number if channel.sensor.quantity == "position" and channel.std is None else (number, k)
        for number, record in enumerate(records)
        for k, channel in enumerate(record.own_channels)
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
    for shared in map(list, groups):
        travels[shared] = math.sqrt(float(lengths[shared] @ travels[shared] ** 2) / float(lengths[shared].sum()))
    weights = SeriesWeights(
        lengths=lengths,
        deviations=np.array([channel.std or 1.0 for channel in channels]),
        floors=MODEL_STD * travels,
        groups=groups,
        known=tuple(channels[group[0]].std is not None for group in groups),
    )
    first_weights = weights.improved([third_differences(channel) for channel in channels], robust=robust)
    if not first_weights.deviations.all():
        label = channels[int(np.argmin(first_weights.deviations))].label
        raise InputError(f"{label} is constant; leave it out, or give Channel(std=...)", "channels")
    return first_weights


def third_differences(channel: Channel) -> Array:
    """Return the third differences of a record, scaled so that white noise keeps its variance."""
    time, values = channel.measurement.time, channel.measurement.values
    if time.size < 4:
        return np.zeros(0)
    times, samples = (np.lib.stride_tricks.sliding_window_view(column, 4) for column in (time, values))
    span = times[:, 3] - times[:, 0]
    # largest duration of four successive samples, relative to the median: no gap is among them
    without_gaps = span <= 1.5 * np.median(span)
    times, samples = times[without_gaps], samples[without_gaps]
    # the third divided difference is the sum of y_i/prod (t_i - t_j) over j != i; the diagonal adds a factor of 1
    weights = 1 / ((times[:, :, None] - times[:, None, :]) / span[without_gaps][:, None, None] + np.eye(4)).prod(axis=2)
    return np.asarray((weights * samples).sum(axis=1) / np.linalg.norm(weights, axis=1))


def coarse_tolerance(records: Sequence[MotionRecord], length: float) -> float:
    """Return the first tolerance for records of a beam of a length (m)."""
    channels = [channel for record in records for channel in record.own_channels]
    travels = [float(channel.measurement.values.std()) for channel in channels if channel.sensor.quantity in LENGTHS]
    return min(COARSE, COARSE_PER_TRAVEL * max(travels) / length) if travels else COARSE_WITHOUT_POSITIONS


def coarse_or_wanted(coarse: float, wanted: float) -> float:
    """Return a coarse tolerance, or the wanted one if they are close: errors at close tolerances may be alike."""
    return coarse if coarse > 0.99 * RATIO * wanted else wanted


def tighter(tolerance: float, excess: float) -> float:
    """Return the tolerance that is expected to reduce an error to the allowed one, which it exceeds by a factor."""
    factor = float(excess ** (-1 / ERROR_ORDER))
    return max(tolerance * max(factor, 1 / MOST_TIGHTENING), TIGHTEST)
