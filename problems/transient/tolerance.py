"""The tolerance at which the motion is integrated in a fit, and what its error does to the estimates.

An error c of the computed positions, one number for each of the m residuals, shifts the estimates to first order by

    d = -(J' J)^-1 J' c                                  (``Fit.shifts``),

and none by more than |c|/s of its standard errors, s^2 the variance of the residuals.  The fit asks that no shift be
above ``ALLOWED``, a tenth.  This is checked at the estimate by one integration at a tolerance ``CHECK`` times tighter,
whose own error is as much smaller: c is the difference of the residuals.  It costs one run without derivatives, where
the fit takes about ten with them.  Otherwise the fit is repeated from its estimate at a tolerance as much tighter as
the shift is too large, for the error of the integration is about proportional to its tolerance.

The first tolerance follows from the record: the part of c in the direction of a parameter has a root mean square of
about ``GAIN`` times tolerance and length of the beam (measured from 1e-6 to 1e-10, on one to ten periods), so that

    tolerance = ALLOWED s / (m^1/2 GAIN L),

where the noise in s is taken from third differences of the samples.  It errs by as much as the motion differs from
those measured; that is what the check is for.

Trust.  Without noise the residuals are the errors of integration of the record and of the fit.  These are no white
noise: they stay in phase with the motion, and a parameter takes most of them up (of a record integrated by IDAS, its
numerical damping becomes air drag), so that the residuals do not show them.  No record is therefore trusted beyond a
share ``TRUST`` of its travel, the root mean square of the positions about their means: a systematic error of that size
(``Fit.systematic``) enters the standard errors.  It is nothing beside the noise of a camera, 1e-4 to 1e-2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from problems.transient.marker_record import MarkerRecord

ALLOWED = 0.1  # standard errors
CHECK = 30.0
GAIN = 0.1
TRUST = 2e-5
COARSEST, TIGHTEST = 1e-6, 1e-10  # tolerances; the latter is checked at 3e-12, where rounding sets in
MARGIN = 2.0  # of a tolerance that is tightened
DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # third; of white noise it has 20 times the variance


def travel(records: Sequence[MarkerRecord]) -> float:
    """Return the root mean square of the measured positions about their means, m."""
    parts = [record.columns - record.columns.mean(axis=1, keepdims=True) for record in records]
    return math.sqrt(np.mean(np.concatenate([part.ravel() for part in parts]) ** 2))


def noise(records: Sequence[MarkerRecord]) -> float:
    """Return the standard deviation of the noise in the measured positions, m, from their third differences."""
    parts = [np.convolve(column, DIFFERENCE, "valid") for record in records for column in record.columns]
    return math.sqrt(np.mean(np.concatenate(parts) ** 2) / (DIFFERENCE @ DIFFERENCE))


def spread(records: Sequence[MarkerRecord]) -> float:
    """Return s, the standard deviation expected of the residuals, m, with its allowance for a systematic error."""
    return math.hypot(noise(records), math.sqrt(_count(records)) * TRUST * travel(records))


def first_tolerance(records: Sequence[MarkerRecord], length: float) -> float:
    """Return the tolerance to begin with, for a beam of a length (m)."""
    wanted = ALLOWED * spread(records) / (math.sqrt(_count(records)) * GAIN * length)
    return min(max(wanted, TIGHTEST), COARSEST)


def tighter(tolerance: float, shift: float) -> float:
    """Return the tolerance at which a shift, in standard errors, is expected to be allowed."""
    return max(tolerance * ALLOWED / (MARGIN * shift), TIGHTEST)


def _count(records: Sequence[MarkerRecord]) -> int:
    return sum(record.columns.size for record in records)
