"""Intervals by profile likelihood: the range of a quantity over all unknowns that explain the data nearly as well.

The quantity q of the unknowns x has the interval from min q to max q over the region

    { x : 2 (L(x) - L_min) <= phi t^2,  lower <= x <= upper },

with L and t as in ``estimates``, and phi the variance of the residuals in the direction J (J' J)^-1 dq/dx, along which
q depends on the data.  Its ends are two nonlinear programs, each started at the end that the covariance predicts.  The
interval does not depend on the parametrisation, need not be symmetric, and does not cross a bound.  An interval that
ends at a bound uses the same level, although one of its ends is certain, and so covers the truth at least as often as
stated.

References
----------
M. C. Neale, M. B. Miller, The use of likelihood-based confidence intervals in genetic models, Behavior Genetics 27
(1997).
D. J. Venzon, S. H. Moolgavkar, A method for computing profile-likelihood-based confidence intervals, Applied Statistics
37 (1988).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.estimates import CONFIDENCE_LEVEL, Estimates, Quantities
from ancf_casadi.estimation.solver.loss import loss
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.exceptions import InputError


def profile_interval(
    fit: Estimates, quantity: str | Quantities, level: float = CONFIDENCE_LEVEL, *, inflation: float = 1.0
) -> tuple[float, float]:
    """Return the interval of an unknown, or of a function of the unknowns, by profile likelihood.

    Parameters
    ----------
    fit : Fit
        Estimates with their model.
    quantity : str or callable
        Name of an unknown; or a function of the unknowns, MX scalars in their order, that returns an MX scalar.
    level : float
        Confidence level.
    inflation : float
        Factor of the variance phi, beyond that of the noise in the residuals.

    Raises
    ------
    InputError
        If there is no such unknown, the level is not between 0 and 1, or there is no scatter.
    FitError
        If IPOPT does not converge.
    """
    if isinstance(quantity, str) and quantity not in fit.names:
        raise InputError(f"is not an unknown of the fit; the unknowns are {', '.join(fit.names)}", quantity)
    t = fit.quantile(level)
    if not fit.noise.variance + fit.systematic > 0.0:
        raise InputError("has no scatter: the residuals are zero, or no more than the unknowns; use more data", "fit")
    free = ~fit.active_bounds
    step = np.where(free, t * fit.errors, np.abs(fit.moves(level)).sum(axis=1))
    step = np.where(np.isfinite(step), step, fit.scale)
    u = cs.MX.sym("u", len(fit.names))  # distance from the estimate, in steps
    y = cs.DM(fit.values) + cs.DM(step) * u
    unknowns = fit.coordinates.symbols(cs.vertsplit(y))
    q = unknowns[fit.names.index(quantity)] if isinstance(quantity, str) else quantity(*unknowns)
    residuals = fit.model.call([y / cs.DM(fit.scale)], True, False)[0]
    at_estimate = cs.Function("at_estimate", [u], [loss(residuals, fit.huber), q, cs.densify(cs.gradient(q, u))])
    least, estimate, gradient = (item.full().ravel() for item in at_estimate(0))
    towards = np.zeros(len(gradient))
    towards[free] = fit.correlations[np.ix_(free, free)] @ gradient[free]
    column = np.linalg.lstsq((fit.jacobian * step)[:, free].T, gradient[free])[0]
    room = inflation * fit.dispersion(column) * t**2
    width = math.sqrt(towards @ gradient) or float(np.abs(gradient).max()) or 1.0
    lower, upper = (fit.lower - fit.values) / step, (fit.upper - fit.values) / step
    options: dict[str, Any] = {"ipopt.tol": 1e-8, "ipopt.bound_relax_factor": 0.0, "ipopt.max_iter": 300}
    if fit.settings.get("gauss_newton"):  # second derivatives are expensive or unknown
        options["ipopt.hessian_approximation"] = "limited-memory"
    ends = []
    for sign in (-1.0, 1.0):
        solution = solve_nlp(
            {"x": u, "f": -sign * (q - estimate[0]) / width, "g": 2 * (loss(residuals, fit.huber) - least[0]) / room},
            np.clip(sign * towards / width, lower, upper),
            lower=lower,
            upper=upper,
            constraint_lower=-math.inf,
            constraint_upper=1.0,
            options=options,
            advice="use the first-order interval of the fit, or another level",
        )
        ends.append(float(estimate[0]) - sign * solution.objective * width)
    return ends[0], ends[1]
