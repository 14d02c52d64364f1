"""Gauss-Newton steps of a bounded least-squares problem.

With the residuals r(z), their Jacobian J, and the diagonal matrix D of the second derivatives psi' of the loss, a step
d minimises |D^1/2 J d + D^-1/2 psi|^2 within the bounds of z, a linear least-squares problem.  IPOPT ends where the
gradient is small, but the gradient is small over a wide range of an unknown that the data hardly determine.  These
steps go on until |D^1/2 J d| is below a hundredth of the standard deviation of the residuals: the last step then moves
no unknown by more than a hundredth of its standard error.

References
----------
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Section 2.1.
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.solver.loss import dispersion, influence, loss, loss_value, row_weights
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import evaluated
from ancf_casadi.support.interrupts import delayed_interrupts

POLISHED = 0.01  # change of the residuals by the last step, in standard deviations
POLISHED_ENOUGH = 0.1  # the same, accepted if further steps do not make it smaller
POLISH_STEPS, POLISH_HALVINGS = 20, 5


def residuals_and_jacobian(evaluate: cs.Function, z: Array) -> tuple[Array, Array]:
    """Return residuals (m,) and Jacobian (m, n) from a Function that gives both."""
    with delayed_interrupts():
        residuals, jacobian = evaluated(evaluate, z)
    return residuals.ravel(), jacobian


def gauss_newton_functions(evaluate: cs.Function, huber: float, weight: float, forward: bool) -> dict[str, cs.Function]:
    """Return the options of ``nlpsol`` for a Hessian J' D J, with D the diagonal of psi/r, and a gradient J' psi.

    ``weight`` divides the loss in the objective; ``forward`` computes the gradient from J too.
    """
    z, p, factor = cs.MX.sym("z", evaluate.size1_in(0)), cs.MX.sym("p", 0, 1), cs.MX.sym("factor")
    r, jacobian = evaluate(z)
    ratio = 1 / cs.sqrt(1 + (r / huber) ** 2)  # psi/r
    rows = jacobian * cs.repmat(cs.sqrt(ratio), 1, jacobian.shape[1])
    hessian = cs.triu(factor / weight * cs.mtimes(rows.T, rows))
    functions = {"hess_lag": cs.Function("hess_lag", [z, p, factor, cs.MX(0, 1)], [hessian])}
    if forward:
        gradient = cs.mtimes(jacobian.T, ratio * r) / weight
        functions["grad_f"] = cs.Function("grad_f", [z, p], [loss(r, huber) / weight, gradient])
    return functions


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
