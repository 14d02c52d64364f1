"""The autoregressive process of order 1 that the residuals of a fit show.

The residuals r = (I - H) e of a fit, with the hat matrix H = q q' of an orthonormal basis q, correlate less than their
noise e, because the fitted curve absorbs most of its slow part.  With the symmetric matrix A of the pairs one step
apart in a series, r'A r = sum r_i r_(i+1), noise of variance 1 with the correlations R(rho) has

    E r'A r = tr A R - 2 tr q'A R q + tr (q'A q)(q'R q),        E r'r = m - tr q'R q.

rho is the value at which their ratio, less the bias 2 rho/m of a ratio of two random numbers, is the one found.  All
traces are sums of powers of rho over the lags.  The estimate that takes r for e is too small by 0.1 for 100 samples of
a decay of six periods, and the variance of the estimates by a quarter.

The standard deviation of rho from n pairs is ((1 - rho^2)/n)^1/2.  With the variance of the prediction errors held, the
power sum_k rho^k a_k/(1 - rho^2) in the columns of the Jacobian, whose correlations are a_k, then has the relative
variance

    V = (d/d rho (log sum_k rho^k a_k - log (1 - rho^2)))^2 (1 - rho^2)/n.

A fit of several sensors may have noise of several colours.  The series have no correlation, a common one, or each its
own, whichever has the lowest BIC.  With one for all, intervals of what a sensor with slow noise determines would be too
narrow by a third, and others too wide.

References
----------
F. H. C. Marriott, J. A. Pope, Bias in the estimation of autocorrelations, Biometrika 41 (1954).
M. H. Quenouille, Approximate tests of correlation in time-series, Journal of the Royal Statistical Society B 11 (1949),
for the standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.noise.series import transform
from ancf_casadi.support.arrays import Array, Index

FEWEST_RESIDUALS = 8  # residuals, below which the noise counts as white


def correlations(residuals: Array, basis: Array, grids: Sequence[tuple[slice, Index]]) -> tuple[list[float], float]:
    """Return the coefficient rho of each series, and the variance of log S due to their errors.

    All are zero, or all are equal, or each series has its own, by the criterion BIC.  With the correlation r of the
    residuals of a series one step apart, 1 + rho^2 - 2 rho r is the variance of the prediction errors of the process.
    """
    pairs, lagged = np.array([_lagged_correlation(residuals[rows], slots) for rows, slots in grids]).T
    count = len(grids)
    common = first_correlation(residuals, basis, grids)
    pooled = np.full(count, float(pairs @ lagged / max(pairs.sum(), 1.0)))
    trials = {0: ([(0.0, 0.0)] * count, np.zeros(count)), 1: ([common] * count, pooled)}
    if count > 1:
        by_series = [
            first_correlation(residuals[rows], basis[rows], [(slice(None), slots)])
            if len(slots) >= FEWEST_RESIDUALS
            else (0.0, 0.0)
            for rows, slots in grids
        ]
        trials[count] = by_series, lagged

    def criterion(parameters: int) -> float:
        coefficients = trials[parameters][1]
        prediction_variances = 1 + coefficients**2 - 2 * coefficients * lagged
        return float(pairs @ np.log(prediction_variances)) + parameters * math.log(len(residuals))

    best = trials[min(trials, key=criterion)][0]
    shares = [float(np.sum(basis[rows] ** 2)) for rows, _ in grids]
    return [ρ for ρ, _ in best], float(np.average([variance for _, variance in best], weights=shares))


def _lagged_correlation(residuals: Array, slots: Index) -> tuple[int, float]:
    """Return the number of pairs of residuals one step of the grid apart, and their correlation; 0 if unknown."""
    adjacent, square = np.diff(slots) == 1, float(np.mean(residuals**2))
    count, limit = int(np.count_nonzero(adjacent)), 1 - 1 / len(residuals)
    if not (count and square > 0.0):
        return 0, 0.0
    return count, float(np.clip(residuals[:-1][adjacent] @ residuals[1:][adjacent] / count / square, -limit, limit))


def first_correlation(residuals: Array, basis: Array, grids: Sequence[tuple[slice, Index]]) -> tuple[float, float]:
    """Return the correlation rho of noise one step of the grid apart, and the variance V of the log of its power.

    ``grids`` has the rows of each series, and their places (slots) on its even grid.  Both results are 0 if no
    residuals are one step apart, or all are zero.
    """
    (m, n), gram = basis.shape, basis.T @ basis
    products, pairs, neighbours = 0.0, 0, np.zeros((m, n))
    for rows, slots in grids:
        r, q, adjacent = residuals[rows], basis[rows], (np.diff(slots) == 1)[:, None]
        products, pairs = products + float(r[:-1] @ (adjacent[:, 0] * r[1:])), pairs + int(adjacent.sum())
        neighbours[rows][:-1] += adjacent * q[1:] / 2
        neighbours[rows][1:] += adjacent * q[:-1] / 2
    if not (pairs and residuals.any()):
        return 0.0, 0.0
    cross, complement = basis.T @ neighbours, np.eye(n) - gram
    absorbed = [basis, 2 * basis - basis @ gram, 2 * neighbours - basis @ cross]
    size = 1 + max(int(slots[-1]) for _, slots in grids)
    sums = np.zeros((3, size))  # over the lags: correlations of the basis, and of what it absorbs of r'r and r'A r
    for rows, slots in grids:
        lags = int(slots[-1]) + 1
        length = 2 ** math.ceil(math.log2(2 * lags))
        spectrum = transform(basis[rows], slots, length).conj()
        for total, columns in zip(sums, absorbed, strict=True):
            power = np.sum(transform(columns[rows], slots, length) * spectrum, axis=1).real
            total[:lags] += np.fft.irfft(power, length)[:lags] * np.where(np.arange(lags) > 0, 2, 1)
    # if these are a subset of the residuals of a fit, the others count as white noise: I - q'q is their leverage
    limit, squares, constant = 1 - 1 / m, m + np.sum(gram * complement), np.sum(cross * complement)
    ratio = products / float(residuals @ residuals)

    def powers(ρ: float) -> Array:
        return np.cumprod(np.append(1.0, np.full(size - 1, ρ)))

    def excess(ρ: float) -> float:
        """Return the expected ratio of r'A r to r'r less that of the residuals."""
        _, absorbed_squares, absorbed_products = sums @ powers(ρ)
        return float((ρ * pairs - absorbed_products + constant) / (squares - absorbed_squares) - 2 * ρ / m - ratio)

    if excess(limit) <= 0.0 or excess(-limit) >= 0.0:
        ρ = math.copysign(limit, products)
    else:
        # a thousandth of the least standard deviation
        ρ = float(scipy.optimize.brentq(excess, -limit, limit, xtol=1e-3 / m))
    power = float(sums[0] @ powers(ρ))
    if not power > 0.0:
        return ρ, 0.0
    slope = float(sums[0][1:] @ (np.arange(1, size) * powers(ρ)[:-1])) / power + 2 * ρ / (1 - ρ**2)
    return ρ, slope**2 * (1 - ρ**2) / pairs
