"""The threshold of the pseudo-Huber loss from the noise of the data.

The loss grows linearly beyond 1.345 standard deviations of the noise.  If the noise is normal, the estimates then have
standard errors a few percent larger than those of least squares.  Outliers hardly change the median of |residual|, so
1.4826 times this median, the standard deviation of normal residuals, estimates the noise.

References
----------
P. J. Huber, Robust Statistics, Wiley (1981), Section 7.8.
"""

from __future__ import annotations

import numpy as np

from ancf_casadi.support.arrays import Array

HUBER = 1.345  # threshold over the standard deviation of the noise
NORMAL = 1.4826  # standard deviation over the median of |residual|, normal residuals


def noise_of(residuals: Array) -> float:
    """Return the standard deviation of the noise in residuals with outliers."""
    return NORMAL * float(np.median(np.abs(residuals)))
