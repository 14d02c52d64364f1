"""The loss of a residual: the pseudo-Huber loss, which limits the influence of outliers, or half the square.

    rho(r) = r^2/(1 + (1 + (r/d)^2)^1/2)    or, for infinite d,    rho(r) = r^2/2,

where the first, d^2 ((1 + (r/d)^2)^1/2 - 1), grows linearly for |r| well above d.  The derivative psi = rho' is
the influence of a residual, and w is the mean of psi'(r_i) over m residuals.  With n free unknowns and white noise, the
variance of the residuals as the loss counts them is

    phi = sum psi_i^2 / ((m - n) w) + m w e^2     (least squares: w = 1, phi = s^2 + m e^2).

The second term allows for a systematic error of root mean square e, which the residuals need not show.  An error in the
direction of the m residuals that is worst for an unknown x_k shifts it by m^1/2 e ((J' J)^-1_kk)^1/2.

A robust fit has d = 1.345 standard deviations of the noise.  If the noise is normal, its standard errors are a few
percent larger than those of least squares.  Outliers hardly change the median of |residual|, so 1.4826 times this
median, the standard deviation of normal residuals, estimates the noise.

References
----------
P. J. Huber, Robust Statistics, Wiley (1981), Sections 7.6, 7.8.
P. Charbonnier, L. Blanc-Feraud, G. Aubert, M. Barlaud, Deterministic edge-preserving regularization in computed
imaging, IEEE Transactions on Image Processing 6 (1997).
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array

HUBER = 1.345  # threshold d over the standard deviation of the noise


def loss(residuals: cs.MX, huber: float) -> cs.MX:
    """Return the sum of the losses of residuals."""
    if math.isinf(huber):
        return cs.sumsqr(residuals) / 2
    return cs.sum1(residuals**2 / (1 + cs.sqrt(1 + (residuals / huber) ** 2)))


def loss_value(residuals: Array, huber: float) -> float:
    """Return the sum of the losses of residuals as a number."""
    return float(residuals @ (residuals / (1 + np.sqrt(1 + (residuals / huber) ** 2))))


def influence(residuals: Array, huber: float) -> tuple[Array, float]:
    """Return the derivatives psi (m,) of the loss at residuals, and the mean w of its second derivatives."""
    growth = 1 + (residuals / huber) ** 2
    return residuals / np.sqrt(growth), float(np.mean(growth**-1.5))


def row_weights(residuals: Array, huber: float) -> Array:
    """Return the square roots (m,) of the second derivatives of the loss, the weights of the rows of a linear fit."""
    return np.asarray((1 + (residuals / huber) ** 2) ** -0.75)


def dispersion(residuals: Array, freedom: int, huber: float, systematic: float) -> float:
    """Return the variance phi of residuals; nan for zero degrees of freedom."""
    psi, w = influence(residuals, huber)
    spread = float(psi @ psi) / (freedom * w) if freedom else math.nan
    return spread + len(residuals) * w * systematic**2


def noise_of(residuals: Array) -> float:
    """Return the standard deviation of the noise in residuals with outliers."""
    # standard deviation over the median of |residual|, for normal residuals
    return 1.4826 * float(np.median(np.abs(residuals)))
