"""The tolerance of the integration in a fit, from the noise of the records and the effect of the integration error.

To first order, an error c of the computed positions, one number for each of the m residuals, shifts the estimates by

    d = -(J' J)^-1 J' c                                  (``Fit.shifts``),

and none by more than |c|/s standard errors, where s^2 is the variance of the residuals.  No shift may exceed
``ALLOWED``, a tenth.  One integration at the estimates, at a tolerance smaller by the factor ``CHECK``, checks this:
its error is smaller by about the same factor, so that c is the difference of the residuals.  The check costs one run
without derivatives; a fit takes about ten with derivatives.  If a shift is too large, the fit is repeated from its
estimates.  The error is about proportional to the tolerance, so that the tolerance decreases in proportion to the
shift.

The first tolerance follows from the record.  The part of c in the direction of a parameter has a root mean square of
about ``GAIN`` times the tolerance and the length L of the beam (measured for tolerances from 1e-6 to 1e-10, over one to
ten periods), so that

    tolerance = ALLOWED s / (m^1/2 GAIN L),

where the noise in s comes from third differences of the samples.  Other motions may have another ``GAIN``; the check
covers them.

A record may itself be integrated.  Without noise, the residuals are then the integration errors of the record and of
the fit.  These are not white noise: they stay in phase with the motion, and a parameter absorbs most of them, so that
the residuals do not show them (if IDAS integrated the record, its numerical damping appears as air drag).  The standard
errors therefore include a systematic error (``Fit.systematic``) of ``TRUST`` times the travel of the record, the root
mean square of the positions about their means.  This is negligible beside the noise of a camera, 1e-4 to 1e-2 of the
travel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.loss import HUBER, noise_of
from ancf_casadi.support.arrays import Array
from problems.transient.marker_record import MarkerRecord

ALLOWED = 0.1  # largest shift, standard errors
CHECK = 30.0
GAIN = 0.1
TRUST = 2e-5
COARSEST, TIGHTEST = 1e-6, 1e-10  # tolerances; the latter is checked at 3e-12, where rounding sets in
MARGIN = 2.0  # additional factor by which a tolerance is tightened
DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # third difference; it multiplies the variance of white noise by 20


def travel(records: Sequence[MarkerRecord]) -> float:
    """Return the root mean square of the measured positions about their means, m."""
    parts = [record.columns - record.columns.mean(axis=1, keepdims=True) for record in records]
    return math.sqrt(np.mean(np.concatenate([part.ravel() for part in parts]) ** 2))


def noise(records: Sequence[MarkerRecord]) -> float:
    """Return the standard deviation of the noise in the measured positions, m, from their third differences."""
    return math.sqrt(np.mean(_differences(records) ** 2))


def spread(records: Sequence[MarkerRecord]) -> float:
    """Return s, the expected standard deviation of the residuals, m, with the allowance for a systematic error."""
    return math.hypot(noise(records), math.sqrt(_count(records)) * TRUST * travel(records))


def huber_threshold(records: Sequence[MarkerRecord], residuals: Array | None = None) -> float:
    """Return the residual, m, beyond which the robust loss grows linearly, from residuals or, if none, from samples."""
    scale = noise_of(_differences(records) if residuals is None else residuals)
    return HUBER * max(scale, TRUST * travel(records))


def first_tolerance(records: Sequence[MarkerRecord], length: float) -> float:
    """Return the first tolerance for a beam of a length (m)."""
    wanted = ALLOWED * spread(records) / (math.sqrt(_count(records)) * GAIN * length)
    return min(max(wanted, TIGHTEST), COARSEST)


def tighter(tolerance: float, shift: float) -> float:
    """Return the tolerance that is expected to reduce a shift, in standard errors, to the allowed one."""
    return max(tolerance * ALLOWED / (MARGIN * shift), TIGHTEST)


def _differences(records: Sequence[MarkerRecord]) -> Array:
    """Return the third differences of the positions, m, scaled so that white noise keeps its variance."""
    parts = [np.convolve(column, DIFFERENCE, "valid") for record in records for column in record.columns]
    return np.concatenate(parts) / math.sqrt(DIFFERENCE @ DIFFERENCE)


def _count(records: Sequence[MarkerRecord]) -> int:
    return sum(record.columns.size for record in records)
