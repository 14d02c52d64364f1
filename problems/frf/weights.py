"""Noise of frequency response functions, and the weights that follow from it.

The variance of a measured value at line k of function o is taken as

    v_ko = (A_o + B_o |H_ko|^2) g_k,

with the fitted H, so that chance in a measured value does not change its own weight.  A is the noise of the response
sensor over a constant force, B that of the force and of all errors proportional to H, and g changes slowly with the
frequency, as the force does; near an antiresonance, A dominates and the relative error grows.  A and B are those of
greatest likelihood, which minimise sum (ln v + |r|^2/v).  g is the mean over neighbouring lines and all functions, and
1 unless these means differ by more than chance.  Residuals r are enlarged by 1/(1 - h)^1/2 for the share h of a value
that the fit follows (leverage).

If the coherence gamma^2 is measured, the variance is proportional to |H|^2 (1 - gamma^2)/gamma^2.

References
----------
J. S. Bendat, A. G. Piersol, Random Data: Analysis and Measurement Procedures, Wiley (2010), Chapter 9.
M. Davidian, R. J. Carroll, Variance function estimation, Journal of the American Statistical Association 82 (1987).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from ancf_casadi.support.arrays import Array, ComplexArray
from problems.frf.record import FrfRecord, moving_mean

LOG_BOUNDS = (-30.0, 30.0)  # of the logarithm of B/A, relative to the first guess
LEAST_STD = 1e-6  # standard deviation, relative to the median of the function
LEAST_REMAINDER = 0.05  # least 1 - h


def given_deviations(record: FrfRecord) -> Array:
    """Return the standard deviations (k, F) that a record states, up to a common factor; else those for a first fit."""
    if record.std is not None:
        return record.std.reshape(-1, len(record.frequencies)).T
    if record.coherence is None:
        return first_deviations(record.columns)
    coherence = np.clip(record.coherence, 1e-6, 1.0)
    variance = np.abs(record.values) ** 2 * (1 - coherence) / coherence
    rows = variance.reshape(-1, len(record.frequencies))
    # lines on either side over which a variance from the coherence is averaged
    smooth = np.sqrt(np.array([moving_mean(row, 4) for row in rows]).T)
    floor = np.median(smooth, axis=0)
    return np.asarray(np.maximum(smooth, 1e-3 * np.where(floor > 0.0, floor, 1.0)))


def first_deviations(values: ComplexArray) -> Array:
    """Return standard deviations (k, F) for the first fit, one per function, from its second differences."""
    differences = np.abs(np.diff(values, n=2, axis=0)) ** 2
    variance = np.median(differences, axis=0) / (6 * math.log(2))
    level = np.sqrt(np.maximum(variance, (LEAST_STD * np.median(np.abs(values), axis=0)) ** 2))
    return np.tile(np.maximum(level, np.finfo(float).tiny), (len(values), 1))


def fitted_deviations(residuals: ComplexArray, amplitude: Array, leverage: Array) -> Array:
    """Return the standard deviations that residuals, absolute values and leverage of a fit show, all (k, F)."""
    squares = np.abs(residuals) ** 2 / np.maximum(1 - leverage, LEAST_REMAINDER)
    floor = (LEAST_STD * np.median(amplitude, axis=0)) ** 2
    variance = np.column_stack([_variance(*columns) for columns in zip(squares.T, amplitude.T**2, strict=True)])
    floor = np.maximum(floor, np.finfo(float).tiny)
    variance = np.maximum(variance, floor)
    variance = variance * _slow_factor(np.mean(squares / variance, axis=1))[:, None]
    return np.sqrt(np.maximum(variance, floor))


def _variance(squares: Array, power: Array) -> Array:
    """Return A + B |H|^2 (k,) for the squared residuals of a function."""
    if not squares.any():
        return np.zeros(len(squares))
    quiet = float(np.median(squares[power <= np.median(power)])) or float(squares.mean())
    relative = float(np.median(squares / np.maximum(power, LEAST_STD * power.max()))) or quiet / float(power.mean())

    def deviance(logarithm: float) -> float:
        """Return the deviance with the common factor of A and B that makes it least."""
        variance = quiet + math.exp(logarithm) * relative * power
        return len(power) * math.log(np.mean(squares / variance)) + float(np.sum(np.log(variance)))

    share = math.exp(minimize_scalar(deviance, bounds=LOG_BOUNDS, method="bounded").x)
    variance = quiet + share * relative * power
    return np.asarray(variance * np.mean(squares / variance))


def _slow_factor(ratio: Array) -> Array:
    """Return g (k,) from the mean ratio of squared residuals to variances over all functions."""
    scatter = float(np.var(ratio / ratio.mean())) if ratio.any() else 0.0
    if not scatter:
        return np.ones(len(ratio))
    half = max(math.ceil(100 * min(scatter, 1.0) / 2), 3)  # complex values that a mean in g contains at least
    blocks = len(ratio) // (2 * half + 1)
    if blocks < 2:
        return np.ones(len(ratio))
    means = np.array([block.mean() for block in np.array_split(ratio, blocks)])
    excess = float(np.sum((means / ratio.mean() - 1) ** 2)) * len(ratio) / blocks / scatter
    # probability of means in g that differ so much by chance
    return moving_mean(ratio, half) if excess > chdtri(blocks - 1, 1e-4) else np.ones(len(ratio))
