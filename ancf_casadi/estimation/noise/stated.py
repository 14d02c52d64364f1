"""The noise of residuals whose standard deviation the user states.

Let Q be the sum of squares of the stated residuals, and M = I - B B' with the rows B of an orthonormal basis of the
columns of the Jacobian that belong to them.  If the stated variance sigma^2 is right, Q/sigma^2 has the mean tr M and
the variance 2 tr M^2, and is close to c chi^2 with nu degrees of freedom,

    c = tr M^2/tr M,    nu = (tr M)^2/tr M^2,

exactly if all residuals are stated: c = 1, nu = m - n.  The probability p of a larger Q decides:

    p above 20 %    the stated variance sigma^2, which is known, with the quantile of the normal distribution
    p below 5 %     the residuals contradict it: the estimate Q/tr M, with that of Student's distribution for nu
    between         (Q/tr M)^l sigma^(2 (1 - l)), nu/l degrees of freedom, l = log(p/20 %)/log(5 %/20 %)

The width of an interval therefore is a continuous function of the residuals, at least as large as stated.  For one
unknown and nu = 1, 2, 4, 6, 10, 20, intervals of 95 % cover the truth in 95.9, 95.8, 95.7, 95.7, 95.6, 95.4 % if the
statement is right, and in 83, 87, 91, 93, 94, 95 % if it is too small by a factor of two, which few values do not
contradict.  The larger of both standard deviations with Student's quantile would cover in 99.6 % for nu = 4 if the
statement is right.

Stated values without an order, such as frequencies, count as white.  The noise of the other residuals of a fit is
estimated from these (``spectrum``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.noise.covariance import Noise
from ancf_casadi.estimation.noise.spectrum import UNSEEN, estimated_noise
from ancf_casadi.support.arrays import Array, Mask

# Probabilities of larger residuals above which stated standard deviations count, and below which estimated ones do.
# test_stated_standard_deviations_are_known_until_residuals_contradict_them fails with 0.5 or with 0.05, 0.01.
DOUBTED, CONTRADICTED = 0.2, 0.05


@dataclass(frozen=True, eq=False)
class AssumedNoise:
    """Order, times and stated standard deviations of the residuals (m,) of a fit, which its noise follows from."""

    series: Sequence[int] = ()  # lengths of the series of residuals, each in the order of time; white noise without
    times: Array | None = None  # of the residuals, s; if None, those of a series are equally spaced
    stated: Mask | None = None  # residuals whose standard deviation the user states; None for no residual
    deviation: float = 1.0  # the stated standard deviation


def residual_noise(residuals: Array, basis: Array, assumed: AssumedNoise) -> Noise:
    """Return the noise of residuals (m,); ``basis`` (m, n) is an orthonormal basis of the columns of the Jacobian."""
    series, times, stated = assumed.series, assumed.times, assumed.stated
    if stated is None or not stated.any():
        return estimated_noise(residuals, basis, series, times)
    noise_of_stated = stated_noise(residuals[stated], basis[stated], assumed.deviation)
    if stated.all():
        return noise_of_stated
    others, n = ~stated, basis.shape[1]
    count, leverage = int(np.count_nonzero(others)), float(np.sum(basis[others] ** 2))
    lengths = [int(np.count_nonzero(of_series)) for of_series in np.split(others, np.cumsum(series)[:-1])]
    columns, sizes, _ = np.linalg.svd(basis[others], full_matrices=False)
    rows = (columns * sizes)[:, sizes > UNSEEN]  # the same rows in coordinates of which none is zero
    noise_of_others = estimated_noise(residuals[others], rows, lengths, None if times is None else times[others])
    if not noise_of_others.freedom:
        return noise_of_others
    variances = [noise_of_stated.variance, noise_of_others.variance]
    noise = Noise(
        variance=float(np.average(variances, weights=[len(others) - count, count])),
        # of a sum of variances, each weighted by its share of the n columns
        freedom=n / ((n - leverage) / noise_of_stated.freedom + leverage / noise_of_others.freedom),
        subsets=((stated, noise_of_stated), (others, noise_of_others)),
        p_value=noise_of_stated.p_value,
        stated_ratio=noise_of_stated.stated_ratio,
    )
    return replace(noise, inflation=float(np.trace(noise.form(basis))) / (n * noise.variance))


def stated_noise(residuals: Array, basis: Array, deviation: float) -> Noise:
    """Return the noise of residuals (m,) with a stated standard deviation from the rows (m, n) of the basis."""
    m, gram = len(residuals), basis.T @ basis
    mean, square = m - float(np.trace(gram)), m - 2 * float(np.trace(gram)) + float(np.sum(gram**2))
    if mean < UNSEEN * m:
        return Noise(deviation**2, math.inf)
    ratio, freedom = float(residuals @ residuals) / (mean * deviation**2), mean**2 / square
    p_value = float(scipy.special.chdtrc(freedom, ratio * freedom))
    exponent = math.log(max(p_value, CONTRADICTED) / DOUBTED) / math.log(CONTRADICTED / DOUBTED)
    if exponent <= 0.0:
        return Noise(deviation**2, math.inf, p_value=p_value)
    excess = ratio**exponent
    return Noise(deviation**2 * excess, freedom / exponent, p_value=p_value, stated_ratio=math.sqrt(excess))
