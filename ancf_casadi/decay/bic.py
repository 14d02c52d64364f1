"""Evidence of a larger model in the samples of a record, by the Bayesian information criterion (BIC).

A smaller model has the sum S0 of squared residuals over n samples, a larger one with k more unknowns has S1.  For
normal noise of unknown variance, the difference of BIC is

    D = n ln(S0/S1) - k ln n,

which approximates twice the logarithm of the odds of the larger model.  The larger model is evident if D exceeds 10.
As no model is exact, an error of a thousandth of the motion is added to both sums.  If the variance s^2 of the noise
is known from more samples, n ln(S0/S1) is (S0 - S1)/s^2: an oscillation of amplitude A with the
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

# Tests that fail if these are halved: test_the_decay_begins_at_the_first_sample_in_motion for BIC_MARGIN (doubled:
# test_few_samples_per_period_are_enough), test_a_release_after_rest_is_no_excitation for MODEL_ERROR.
BIC_MARGIN = 10.0  # least D; "very strong" in Kass and Raftery
MODEL_ERROR = 1e-3  # relative to the motion, that no model explains, such as an error of calibration


def gain_threshold(samples: float, added_unknowns: int) -> float:
    """Return the gain of twice the log-likelihood, n ln(S0/S1), beyond which added unknowns are evident."""
    return added_unknowns * math.log(samples) + BIC_MARGIN


def larger_model_is_evident(
    smaller_misfit: float, larger_misfit: float, samples: float, added_unknowns: int, motion: float
) -> bool:
    """Return whether a larger model is evident, from both sums of squared residuals and that of the motion."""
    model_error = MODEL_ERROR**2 * motion + np.finfo(float).tiny
    gain = samples * (math.log(smaller_misfit + model_error) - math.log(larger_misfit + model_error))
    return gain > gain_threshold(samples, added_unknowns)


def is_visible(amplitude: ArrayLike, standard_error: ArrayLike, samples: ArrayLike) -> NDArray[np.bool_]:
    """Return whether oscillations stand out of the noise, from their amplitudes and standard errors."""
    return np.square(amplitude) > (2 * np.log(samples) + BIC_MARGIN) * np.square(standard_error)
