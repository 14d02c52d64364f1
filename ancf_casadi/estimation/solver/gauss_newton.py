"""The loss of the residuals of a fit, and the Gauss-Newton steps that minimise it.

The loss is the pseudo-Huber loss, which limits the influence of outliers, or half the square:

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

Gauss-Newton steps.  With the residuals r(z), their Jacobian J, and the diagonal matrix D of the second derivatives psi'
of the loss, a step d minimises |D^1/2 J d + D^-1/2 psi|^2 within the bounds of z, a linear least-squares problem.
IPOPT ends where the gradient is small, but the gradient is small over a wide range of an unknown that the data hardly
determine.  These steps go on until |D^1/2 J d| is below a hundredth of the standard deviation of the residuals: the
last step then moves no unknown by more than a hundredth of its standard error.

References
----------
P. J. Huber, Robust Statistics, Wiley (1981), Sections 7.6, 7.8.
P. Charbonnier, L. Blanc-Feraud, G. Aubert, M. Barlaud, Deterministic edge-preserving regularization in computed
imaging, IEEE Transactions on Image Processing 6 (1997).
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Section 2.1.
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import evaluated
from ancf_casadi.support.interrupts import delayed_interrupts

HUBER = 1.345  # threshold d over the standard deviation of the noise
POLISHED = 0.01  # change of the residuals by the last step, in standard deviations
POLISHED_ENOUGH = 0.1  # the same, accepted if further steps do not make it smaller
POLISH_STEPS, POLISH_HALVINGS = 20, 5


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


def residuals_and_jacobian(evaluate: cs.Function, z: Array) -> tuple[Array, Array]:
    """Return residuals (m,) and Jacobian (m, n) from a Function that gives both."""
    with delayed_interrupts():
        residuals, jacobian = evaluated(evaluate, z)
    return residuals.ravel(), jacobian


def gauss_newton_functions(evaluate: cs.Function, huber: float, weight: float) -> dict[str, cs.Function]:
    """Return the options of ``nlpsol`` for a Hessian J' D J, with D the diagonal of psi/r, and a gradient J' psi.

    ``weight`` divides the loss in the objective.
    """
    z, p, factor = cs.MX.sym("z", evaluate.size1_in(0)), cs.MX.sym("p", 0, 1), cs.MX.sym("factor")
    r, jacobian = evaluate(z)
    ratio = 1 / cs.sqrt(1 + (r / huber) ** 2)  # psi/r
    rows = jacobian * cs.repmat(cs.sqrt(ratio), 1, jacobian.shape[1])
    hessian = cs.triu(factor / weight * cs.mtimes(rows.T, rows))
    gradient = cs.mtimes(jacobian.T, ratio * r) / weight
    return {
        "hess_lag": cs.Function("hess_lag", [z, p, factor, cs.MX(0, 1)], [hessian]),
        "grad_f": cs.Function("grad_f", [z, p], [loss(r, huber) / weight, gradient]),
    }


def polish(
    evaluate: cs.Function, z: Array, lower: Array, upper: Array, huber: float, systematic: float
) -> tuple[Array, int, bool]:
    """Return the unknowns after Gauss-Newton steps, the number of steps, and whether the last one was small enough.

    A step that increases the loss by more than its noise is halved.
    """
    r, jacobian = residuals_and_jacobian(evaluate, z)
    size = before = math.inf
    for count in range(POLISH_STEPS):
        psi, curvature = influence(r, huber)
        weights = row_weights(r, huber)
        rows = weights[:, None] * jacobian
        length = np.linalg.norm(rows, axis=0)
        if not (np.isfinite(rows).all() and length.all()):
            return z, count, False
        bounds = (length * (lower - z)).tolist(), (length * (upper - z)).tolist()
        step = scipy.optimize.lsq_linear(rows / length, -psi / weights, bounds, method="bvls").x / length
        size = float(np.linalg.norm(rows @ step))
        deviation = math.sqrt(dispersion(r, max(len(r) - len(z), 1), huber, systematic) * curvature)
        # The second condition ends steps that rounding or integration errors keep from shrinking.
        if size <= POLISHED * deviation or before / 2 < size <= POLISHED_ENOUGH * deviation:
            return z, count, True
        before = size
        highest = loss_value(r, huber) + POLISHED * deviation**2
        for _ in range(POLISH_HALVINGS):
            trial = np.clip(z + step, lower, upper)
            r_trial, jacobian_trial = residuals_and_jacobian(evaluate, trial)
            if loss_value(r_trial, huber) <= highest:
                break
            step = step / 2
        else:
            return z, count, size <= POLISHED_ENOUGH * deviation
        z, r, jacobian = trial, r_trial, jacobian_trial
    return z, POLISH_STEPS, size <= POLISHED_ENOUGH * deviation
