"""Evidence of a larger model in the samples of a record: one statistic and one threshold for all decisions.

A smaller model leaves the sum S0 of the squared residuals of n samples, a larger one with k more unknowns leaves S1.
For normal noise of unknown variance, the difference of the criterion BIC is

    D = n ln(S0/S1) - k ln n,

which approximates twice the logarithm of the odds of the larger model.  It is evident if D exceeds 10.  As no model is
exact, each is taken to leave a thousandth of the motion in addition.  If the variance
s^2 of the noise is known from more samples, n ln(S0/S1) is (S0 - S1)/s^2: an oscillation of amplitude A with the
standard error e, which has two unknowns, is visible if (A/e)^2 > 2 ln n + 10, and a peak of a spectrum, with its
frequency as a third one, if its power exceeds that of the noise by (3 ln n + 10)/2.

References
----------
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
R. E. Kass, A. E. Raftery, Bayes factors, Journal of the American Statistical Association 90 (1995).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Tests that fail if these are halved: test_the_decay_begins_at_the_first_sample_in_motion for CLEAR (doubled:
# test_few_samples_per_period_are_enough), test_a_release_after_rest_is_no_excitation for MODEL_ERROR.
CLEAR = 10.0  # least D; "very strong" in Kass and Raftery
MODEL_ERROR = 1e-3  # relative to the motion, that no model explains, such as an error of calibration


def least_gain(samples: float, unknowns: int) -> float:
    """Return the gain of twice the log-likelihood, n ln(S0/S1), beyond which further unknowns are evident."""
    return unknowns * math.log(samples) + CLEAR


def evident(smaller: float, larger: float, samples: float, unknowns: int, motion: float) -> bool:
    """Return whether a larger model with k further unknowns is evident, from the sums S0 and S1 that both leave."""
    rough = MODEL_ERROR**2 * motion + np.finfo(float).tiny
    gain = samples * (math.log(smaller + rough) - math.log(larger + rough))
    return gain > least_gain(samples, unknowns)


def visible(amplitude: ArrayLike, error: ArrayLike, samples: ArrayLike) -> NDArray[np.bool_]:
    """Return whether noise leaves oscillations visible, from their amplitudes and the standard errors of these."""
    return np.square(amplitude) > (2 * np.log(samples) + CLEAR) * np.square(error)
