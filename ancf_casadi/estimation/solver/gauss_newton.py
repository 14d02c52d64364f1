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
of the loss, a step d minimises |D^1/2 J d + D^-1/2 psi|^2 within the bounds of z, a linear least-squares problem.  At
first no unknown moves by more than its scale; this limit grows where the loss decreases as the linear problem predicts,
and shrinks where it does not.  The last step is one that changes the residuals by less than ``LAST_STEP`` standard
deviations: it moves no unknown by a larger part of its standard error, and the linear problem gives the residuals
after it.

The residuals may have an error of their own, such as that of an integration.  It changes the loss by much more than it
moves the minimum, because it is nearly orthogonal to the columns of J.  Then a step also counts as good if the next
one, by the same J, is less than half as long, whatever the loss (the natural monotonicity test of Deuflhard).  As such
Jacobians are expensive, a step that changes the residuals by up to three standard deviations is the last one if the
next one, by the same J, changes them by less than a tenth of one.  The first J may come from an earlier minimum nearby
whose steps were small; then so are these, and the next one is not computed.

References
----------
P. Deuflhard, Newton Methods for Nonlinear Problems, Springer (2004), Section 4.3.
P. J. Huber, Robust Statistics, Wiley (1981), Sections 7.6, 7.8.
P. Charbonnier, L. Blanc-Feraud, G. Aubert, M. Barlaud, Deterministic edge-preserving regularization in computed
imaging, IEEE Transactions on Image Processing 6 (1997).
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Section 2.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import evaluate_dense
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.progress import count_step

HUBER = 1.345  # threshold d over the standard deviation of the noise
LAST_STEP = 1e-3  # change of the residuals by the last step, in standard deviations
LAST_INACCURATE_STEP = 0.1  # the same where the residuals have an error of their own, whose check sees what it leaves
LONGEST_LAST_STEP = 3.0  # the same, if the next step, by the same Jacobian, is that small
ROUNDING = 1e-13  # the same, relative to that by unknowns from zero
MOST_STEPS, MOST_FAILURES = 50, 6  # the latter in a row
LEAST_GAIN, GOOD_GAIN = 1e-3, 0.75  # decrease of the loss over the predicted one
NEARER = 0.5  # length of a further step after a step, by the same Jacobian, that shows progress to the minimum
GROWTH, SHRINKAGE = 3.0, 0.25  # of the limit of a step


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


def robust_deviation(residuals: Array) -> float:
    """Return the standard deviation of the noise in residuals with outliers."""
    # standard deviation over the median of |residual|, for normal residuals
    return 1.4826 * float(np.median(np.abs(residuals)))


def residuals_and_jacobian(evaluate: cs.Function, z: Array) -> tuple[Array, Array]:
    """Return residuals (m,) and Jacobian (m, n) from a Function that gives both."""
    residuals, jacobian = _evaluate_step(evaluate, z)
    return residuals.ravel(), jacobian


def _evaluate_step(function: cs.Function, z: Array) -> list[Array]:
    """Return the outputs of a Function, which counts as one step; an interrupt waits for its end."""
    with delayed_interrupts():
        outputs = evaluate_dense(function, z)
    count_step()
    return outputs


@dataclass(frozen=True, eq=False)
class Minimum:
    """The end of Gauss-Newton steps."""

    z: Array  # unknowns (n,)
    residuals: Array  # (m,)
    jacobian: Array  # of the residuals (m, n)
    steps: int  # number of steps
    settled: bool  # whether a further step is small, or below the error of the residuals


def minimise(
    evaluate: cs.Function,
    z: Array,
    lower: Array,
    upper: Array,
    *,
    huber: float = math.inf,
    systematic: float = 0.0,
    inaccuracy: float = 0.0,
    jacobian: Array | None = None,
) -> Minimum:
    """Minimise the loss within bounds by Gauss-Newton steps from z, in units of the scales of the unknowns.

    ``evaluate`` returns residuals and Jacobian; ``inaccuracy`` is the norm of the error of the residuals, below which
    no step needs to be; ``jacobian`` is the first J, that at z if not given.
    """
    small, outdated = LAST_INACCURATE_STEP if inaccuracy else LAST_STEP, jacobian is not None
    y = cs.MX.sym("z", len(z))
    values = cs.Function("values", [y], [evaluate.call([y], True, False)[0]])
    if jacobian is None:
        r, jacobian = residuals_and_jacobian(evaluate, z)
    else:
        r = _evaluate_step(values, z)[0].ravel()

    def further_change(residuals: Array, z: Array, rows: Array, weights: Array) -> float:
        """Return the change of the weighted residuals by the next step from z, by the same Jacobian."""
        if not np.isfinite(residuals).all():
            return math.inf
        return float(np.linalg.norm(rows @ _step(rows, influence(residuals, huber)[0] / weights, lower - z, upper - z)))

    reach, failures, steps = 1.0, 0, 0
    while True:
        psi, curvature = influence(r, huber)
        weights = row_weights(r, huber)
        rows = weights[:, None] * jacobian
        if not (np.isfinite(rows).all() and rows.any()):
            return Minimum(z, r, jacobian, steps, settled=False)
        step = _step(rows, psi / weights, lower - z, upper - z)
        change = float(np.linalg.norm(rows @ step))
        deviation = math.sqrt(dispersion(r, max(len(r) - len(z), 1), huber, systematic) * curvature)
        rounding = ROUNDING * float(np.linalg.norm(rows * z))
        last, last_change = np.clip(z + step, lower, upper), max(small * deviation, inaccuracy, rounding)
        is_last = change <= last_change
        if not is_last and inaccuracy and change <= LONGEST_LAST_STEP * deviation:
            is_last = (
                outdated or further_change(_evaluate_step(values, last)[0].ravel(), last, rows, weights) <= last_change
            )
        if is_last:
            return Minimum(last, r + jacobian @ (last - z), jacobian, steps + 1, settled=True)
        if failures == MOST_FAILURES or steps == MOST_STEPS:
            return Minimum(z, r, jacobian, steps, settled=False)
        if np.abs(step).max() > reach:
            step = _step(rows, psi / weights, np.maximum(lower - z, -reach), np.minimum(upper - z, reach))
        trial = np.clip(z + step, lower, upper)
        predicted = -float(psi @ (jacobian @ step)) - float(np.sum((rows @ step) ** 2)) / 2
        r_trial, jacobian_trial = residuals_and_jacobian(evaluate, trial)
        steps += 1
        gain = (loss_value(r, huber) - loss_value(r_trial, huber)) / predicted
        nearer = inaccuracy and not gain > GOOD_GAIN and further_change(r_trial, trial, rows, weights) < NEARER * change
        if gain > LEAST_GAIN or nearer:
            z, r, jacobian, failures, outdated = trial, r_trial, jacobian_trial, 0, False
            if gain > GOOD_GAIN:
                reach *= GROWTH
            elif not gain > LEAST_GAIN:  # or steps would pass a minimum of large residuals to and fro
                reach = NEARER * float(np.abs(step).max())
        elif outdated:
            (r, jacobian), outdated = residuals_and_jacobian(evaluate, z), False
        else:  # the loss increases, or is not finite
            reach, failures = SHRINKAGE * float(np.abs(step).max()), failures + 1


def _step(rows: Array, right: Array, low: Array, high: Array) -> Array:
    """Return the step d (n,) between bounds that minimises |rows d + right|^2."""
    length = np.linalg.norm(rows, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    solution = scipy.optimize.lsq_linear(rows / length, -right, (length * low, length * high), method="bvls")
    return np.asarray(solution.x / length)
