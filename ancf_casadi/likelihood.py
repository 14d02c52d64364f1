"""Intervals by profile likelihood: the range of a quantity over all unknowns that explain the data nearly as well.

The quantity q of the unknowns x has the interval from min q to max q over

    { x : 2 (L(x) - L_min) <= phi t^2,  lower <= x <= upper },

the region of ``ancf_casadi.fit``.  Its two ends are two nonlinear programs, each started from where the covariance
puts its solution.  The interval does not depend on how the unknowns are stated, needs not be symmetric, and ends at a
bound by itself.

References
----------
M. C. Neale, M. B. Miller, The use of likelihood-based confidence intervals in genetic models, Behavior Genetics 27
(1997).
D. J. Venzon, S. H. Moolgavkar, A method for computing profile-likelihood-based confidence intervals, Applied Statistics
37 (1988).
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.fit import LEVEL, Fit, Quantities, quantile
from ancf_casadi.nlp import loss, solve_nlp


def profile_interval(fit: Fit, quantity: str | Quantities, level: float = LEVEL) -> tuple[float, float]:
    """Return the interval of an unknown, or of a function of the unknowns, by profile likelihood.

    Parameters
    ----------
    fit : Fit
        The fit.
    quantity : str or callable
        Name of an unknown; or takes the unknowns as MX scalars, in their order, and returns an MX scalar.
    level : float
        How probably it holds the truth.

    Raises
    ------
    InputError
        If there is no such unknown, the level is not between 0 and 1, or the fit leaves no residuals to judge by.
    FitError
        If IPOPT does not converge.
    """
    if isinstance(quantity, str) and quantity not in fit.names:
        raise InputError(f"is no unknown of the fit; there are {', '.join(fit.names)}", quantity)
    room = fit.dispersion * quantile(level, fit.freedom) ** 2
    if not room > 0.0:
        raise InputError("leaves no residuals; without scatter there is no interval", "fit")
    z = cs.MX.sym("z", len(fit.names))
    x = cs.vertsplit(cs.DM(fit.scale) * z)
    q = x[fit.names.index(quantity)] if isinstance(quantity, str) else quantity(*x)
    left = fit.model.call([z], True, False)[0]
    excess = 2 * (loss(left, fit.huber) - float(cs.evalf(loss(cs.MX(cs.DM(fit.residuals)), fit.huber)))) / room
    start = fit.values / fit.scale
    slope = cs.Function("slope", [z], [cs.densify(cs.gradient(q, z))])(start).full().ravel()
    free = ~fit.at_bound
    step = np.zeros(len(start))
    spread = fit.covariance[np.ix_(free, free)] / np.outer(fit.scale[free], fit.scale[free])
    size = math.sqrt(slope[free] @ spread @ slope[free])
    if size > 0.0:
        step[free] = quantile(level, fit.freedom) * spread @ slope[free] / size
    width = size or float(np.abs(slope).max()) or 1.0
    lower, upper = fit.lower / fit.scale, fit.upper / fit.scale
    ends = []
    for sign in (-1.0, 1.0):
        solution = solve_nlp(
            {"x": z, "f": -sign * q / width, "g": excess},
            np.clip(start + sign * step, lower, upper),
            lower=lower,
            upper=upper,
            constraint_lower=-math.inf,
            constraint_upper=1.0,
            options={"ipopt.tol": 1e-9, "ipopt.bound_relax_factor": 0.0, "ipopt.max_iter": 300},
        )
        ends.append(-sign * solution.objective * width)
    return ends[0], ends[1]
