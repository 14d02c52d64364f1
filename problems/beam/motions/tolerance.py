"""The tolerance of the integration in a fit, from the noise of the records and the effect of the integration error.

To first order, an error c of the computed readings, one number for each of the m residuals, shifts the estimates by

    d = -(J' J)^-1 J' c                                  (``Fit.shifts``),

and none by more than |c|/s standard errors, where s^2 is the variance of the residuals.  No shift may exceed
``LARGEST_SHIFT``, a tenth.  One integration at the estimates, at a tolerance smaller by the factor ``CHECK_RATIO``,
checks this: its error is smaller by about the same factor, so that c is the difference of the residuals.  It costs one
run without derivatives; a fit takes about ten with derivatives.  If a shift is too large, the fit is repeated from its
estimates.  The error is about proportional to the tolerance, so that the tolerance decreases in proportion to the
shift.

The first tolerance follows from the record.  The part of c in the direction of a parameter has a root mean square of
about ``ERROR_GAIN`` times the tolerance and the size of the readings: the length L of the beam for positions (measured
for tolerances from 1e-6 to 1e-10, over one to ten periods), and ten times the travel of any other channel.  With the
root mean square size a of the weighted residuals (``weights``),

    tolerance = LARGEST_SHIFT s / (m^1/2 ERROR_GAIN a),

where the noise in s comes from third differences of the samples.  Other motions may have another ``ERROR_GAIN``; the
check covers them.

A record may itself be integrated.  Without noise, the residuals are then the integration errors of the record and of
the fit.  These are not white noise: they stay in phase with the motion, and a parameter absorbs most of them, so that
the residuals do not show them (if IDAS integrated the record, its numerical damping appears as air drag).  The standard
errors therefore include a systematic error (``Fit.systematic``) of ``weights.MODEL_STD`` times the travel of the
record, the root mean square of the readings about their means.  This is negligible beside the noise of a camera, 1e-4
to 1e-2 of the travel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.solve import LARGEST_SHIFT
from problems.beam.motions.record import MotionRecord
from problems.beam.motions.weights import Weights

CHECK_RATIO = 30.0
ERROR_GAIN = 0.1
USUAL_TRAVEL = 0.1  # usual travel of a beam over its length
COARSEST, TIGHTEST = 1e-6, 1e-10  # tolerances; the latter is checked at 3e-12, where rounding sets in
LENGTHS = ("position", "displacement")


def first_tolerance(records: Sequence[MotionRecord], weights: Weights, length: float) -> float:
    """Return the first tolerance for a beam of a length (m)."""
    quantities = [channel.sensor.quantity for record in records for channel in record.own_channels]
    pairs = zip(quantities, weights.travels.tolist(), strict=True)
    sizes = np.array([length if quantity in LENGTHS else travel / USUAL_TRAVEL for quantity, travel in pairs])
    root = math.sqrt(weights.lengths.sum())
    wanted = (
        LARGEST_SHIFT
        * math.hypot(1.0, root * weights.systematic)
        / (root * ERROR_GAIN * weights.root_mean_square(sizes))
    )
    return min(max(wanted, TIGHTEST), COARSEST)


def tighter(tolerance: float, shift: float) -> float:
    """Return the tolerance that is expected to reduce a shift, in standard errors, to the allowed one."""
    return max(
        tolerance * LARGEST_SHIFT / (2.0 * shift), TIGHTEST
    )  # additional factor by which a tolerance is tightened
