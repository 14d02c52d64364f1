"""Variance of noise that is partly constant and partly proportional to the power of what was measured.

The variances v = A + B h minimise sum (ln v + r^2/v) over the squared residuals r^2; h is the squared fitted value, so
that chance in a measured value does not change its own weight.

References
----------
M. Davidian, R. J. Carroll, Variance function estimation, Journal of the American Statistical Association 82 (1987).
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.support.arrays import Array

LOG_BOUNDS = (-30.0, 30.0)  # of the logarithm of B/A, relative to the first guess
LEAST_POWER = 1e-6  # relative to the largest one


def proportional_variance(squares: Array, power: Array) -> Array:
    """Return the variances A + B h (k,) of greatest likelihood for squared residuals and powers h."""
    if not squares.any():
        return np.zeros(len(squares))
    quiet = float(np.median(squares[power <= np.median(power)])) or float(squares.mean())
    relative = float(np.median(squares / np.maximum(power, LEAST_POWER * power.max()))) or quiet / float(power.mean())

    def deviance(logarithm: float) -> float:
        """Return the deviance with the common factor of A and B that makes it least."""
        variance = quiet + math.exp(logarithm) * relative * power
        return len(power) * math.log(np.mean(squares / variance)) + float(np.sum(np.log(variance)))

    share = math.exp(scipy.optimize.minimize_scalar(deviance, bounds=LOG_BOUNDS, method="bounded").x)
    variance = quiet + share * relative * power
    return np.asarray(variance * np.mean(squares / variance))
