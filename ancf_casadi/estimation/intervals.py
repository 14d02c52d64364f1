"""Intervals of estimates by profile likelihood, where those to first order (``fit``) are wrong.

An interval by profile likelihood is the range of a quantity over all unknowns that explain the data nearly as well.
The quantity q of the unknowns x has the interval from min q to max q over the region

    { x : 2 (L(x) - L_min) <= phi t^2,  lower <= x <= upper },

with L, p and s as in ``fit``, and phi the variance of the residuals in the directions along which q depends on the
data: the mean of those of J (J' J)^-1 dq/dx and of the p, weighted by t^2 C_qq and the s^2.  Its ends are two nonlinear
programs, each started at the end that the covariance predicts.  The interval does not depend on the parametrisation,
need not be symmetric, and does not cross a bound.  An interval that ends at a bound uses the same level, although one
of its ends is certain, and so covers the truth at least as often as stated.

One unknown may be far from linear while the others are nearly so once it is held (``Unknown.curved``).  It is then held
at values c on both sides of its estimate, as far as L_c of the fit of the others allows.  With the first-order interval
from q_c - a_c to q_c + b_c of this fit, and phi in the direction p of c, a quantity has the interval from the least
q_c - d_c a_c to the largest q_c + d_c b_c,

    d_c = (1 - 2 (L_c - L_min)/(phi t^2))^1/2,

which is the interval by profile likelihood if the others are linear and the noise is white.

Two evaluations show whether the ends x +- half of a first-order interval are those by profile likelihood.  With
J = Q T and u = T^-T dq/dx, the other unknowns are best along d = T^-1 u half/u'u.  At x +- d the residuals r, less what
the columns Q without u/|u| explain, have the rise 2 (L - L_min) = rho phi t^2.  The profile ends near

    q(x) +- |q(x +- d) - q(x)|/rho^(1/2),

and rho = 1 and q linear leave no difference.  (L is evaluated closer to the estimate where a bound is nearer than d.)

References
----------
M. C. Neale, M. B. Miller, The use of likelihood-based confidence intervals in genetic models, Behavior Genetics 27
(1997).
D. J. Venzon, S. H. Moolgavkar, A method for computing profile-likelihood-based confidence intervals, Applied Statistics
37 (1988).
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, ROUNDING, Fit, Quantities
from ancf_casadi.estimation.solver.gauss_newton import influence, loss, loss_value, minimise
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.compilation import evaluate_dense

# Values at which a curved unknown is held, per length of its first-order interval.  At 4,
# test_with_a_curved_unknown_held_intervals_are_those_by_profile_likelihood fails.
HELD_STEPS = 16
# Difference of the ends of both intervals, relative to half of them, beyond which they follow the likelihood.  At 1,
# test_the_interval_of_a_curved_fit_is_that_by_profile_likelihood fails.
MOST_BEND = 0.1
LEAST_PART = 0.1  # part of d to a bound, below which rounding would count
HELD = 1e-9  # distance, in scales, that a held unknown may move


@dataclass(frozen=True, eq=False)
class HeldFit:
    """The fit of the other unknowns, with one held at a value c."""

    values: Array  # of all unknowns, (n,)
    others: Fit
    reach: float  # d_c, the share of the first-order interval of the others that the confidence level leaves


def _variance_towards(fit: Fit, gradient: Array, level: float) -> float:
    """Return the variance phi of a quantity with the derivatives (n,) by the coordinates."""
    free, (moves, variances) = ~fit.active_bounds, fit.bound_moves(level)
    columns = (fit.jacobian * fit.scale)[:, free]
    column = np.asarray(np.linalg.lstsq(columns.T, (gradient * fit.scale)[free])[0], dtype=np.float64)
    half_interval = np.nan_to_num(fit.quantile(level) * fit.errors_of(gradient[None]))
    with np.errstate(invalid="ignore"):  # 0 times an infinite move
        changes = np.append(half_interval, np.nan_to_num(gradient @ moves))
    dispersions = np.append(fit.dispersion(column), variances)
    if not changes.any():
        return float(dispersions.max())
    return float(np.average(dispersions, weights=(changes / abs(changes).max()) ** 2))


def profile_interval(
    fit: Fit, quantity: str | Quantities, level: float = CONFIDENCE_LEVEL, *, inflation: float = 1.0
) -> tuple[float, float]:
    """Return the interval of an unknown, by name, or of a function of the unknowns, by profile likelihood.

    ``inflation`` is a factor of the variance phi, beyond that of the noise in the residuals.
    """
    if isinstance(quantity, str) and quantity not in fit.names:
        raise InputError(f"is not an unknown of the fit; the unknowns are {', '.join(fit.names)}", quantity)
    t = fit.quantile(level)
    if not fit.noise.variance + fit.systematic > 0.0:
        raise InputError("has no scatter: the residuals are zero, or no more than the unknowns; use more data", "fit")
    free = ~fit.active_bounds
    step = np.where(free, t * fit.errors, np.abs(fit.bound_moves(level)[0]).sum(axis=1))
    step = np.where(np.isfinite(step), step, fit.scale)
    u = cs.MX.sym("u", len(fit.names))  # distance from the estimate, in steps
    y = cs.DM(fit.values) + cs.DM(step) * u
    unknowns = fit.coordinates.symbols(cs.vertsplit(y))
    q = unknowns[fit.names.index(quantity)] if isinstance(quantity, str) else quantity(*unknowns)
    residuals = fit.model.call([y / cs.DM(fit.scale)], True, False)[0]
    at_estimate = cs.Function("at_estimate", [u], [loss(residuals, fit.huber), q, cs.densify(cs.gradient(q, u))])
    least_loss, estimate, gradient = (item.full().ravel() for item in at_estimate(0))
    towards = np.zeros(len(gradient))
    towards[free] = fit.correlations[np.ix_(free, free)] @ gradient[free]
    room = inflation * _variance_towards(fit, gradient / step, level) * t**2
    width = math.sqrt(towards @ gradient) or float(np.abs(gradient).max()) or 1.0
    lower, upper = (fit.lower - fit.values) / step, (fit.upper - fit.values) / step
    options: dict[str, Any] = {"ipopt.tol": 1e-8, "ipopt.bound_relax_factor": 0.0, "ipopt.max_iter": 300}
    if not fit.settings.closed_form:  # second derivatives are expensive or unknown
        options["ipopt.hessian_approximation"] = "limited-memory"
    ends = []
    for sign in (-1.0, 1.0):
        solution = solve_nlp(
            {
                "x": u,
                "f": -sign * (q - estimate[0]) / width,
                "g": 2 * (loss(residuals, fit.huber) - least_loss[0]) / room,
            },
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


@lru_cache(maxsize=8)
def profiles(
    fit: Fit, names: tuple[str, ...], quantities: Quantities | None, level: float
) -> dict[str, tuple[float, float]]:
    """Return the intervals by profile likelihood, by name, where those to first order are wrong.

    The quantities are the unknowns if none are given.  Intervals that cannot be found are left out.
    """
    intervals = {}
    for k in np.flatnonzero(_nonlinearity(fit, quantities, level) > MOST_BEND).tolist():
        with contextlib.suppress(FitError):
            of = names[k] if quantities is None else lambda *x, k=k: quantities(*x)[k]
            intervals[names[k]] = profile_interval(fit, of, level)
    return intervals


def _nonlinearity(fit: Fit, quantities: Quantities | None, level: float) -> Array:
    """Return by how much the ends of first-order and profile intervals differ, in halves of these (q,).

    It is 0 where a quantity has no error, and everywhere if an unknown is curved, since that is then held.
    """
    n, free = len(fit.names), ~fit.active_bounds
    function = None if quantities is None else fit.linearisation(quantities)
    values, rows = (fit.values, np.eye(n)) if function is None else (output.full() for output in function(fit.values))
    halves = np.nan_to_num(fit.quantile(level) * fit.errors_of(rows))
    differences = np.zeros(len(rows))
    if not free.any() or not fit.noise.variance > 0.0 or any(unknown.curved for unknown in fit.unknowns):
        return differences
    z = cs.MX.sym("z", n)
    residuals_alone = cs.Function("residuals_alone", [z], [fit.model.call([z], True, False)[0]])
    basis, triangle = fit.free_basis
    least_loss, w = loss_value(fit.residuals, fit.huber), influence(fit.residuals, fit.huber)[1]
    moved = (np.abs(rows[:, free] * fit.errors[free]) > ROUNDING * fit.scale[free]).any(axis=1)
    for k in np.flatnonzero(moved & (halves > 0.0)):
        u: Array = np.linalg.solve(triangle.T, (rows[k] * fit.scale)[free])
        d, u = np.zeros(n), u / np.linalg.norm(u)
        d[free] = fit.scale[free] * np.linalg.solve(triangle, u)
        d *= halves[k] / float(rows[k] @ d)
        most_rise = fit.dispersion(np.asarray(basis @ u)) * fit.quantile(level) ** 2
        for side in (-1.0, 1.0):
            to_bound = np.where(side * d > 0.0, fit.upper - fit.values, fit.values - fit.lower)[d != 0.0]
            part = min(1.0, float(np.min(to_bound / np.abs(d[d != 0.0]))))
            if part < LEAST_PART:
                continue
            y = fit.values + side * part * d
            residuals = evaluate_dense(residuals_alone, y / fit.scale)[0].ravel()
            scores = basis.T @ influence(residuals, fit.huber)[0]
            explained = (scores @ scores - (u @ scores) ** 2) / w
            rise = 2 * (loss_value(residuals, fit.huber) - least_loss) - explained
            quantity = (y if function is None else function(y)[0].full().ravel())[k]
            change = abs(float(quantity - values.ravel()[k])) / halves[k]
            difference = abs(change * math.sqrt(most_rise / rise) - 1) if rise > 0.0 else math.inf
            differences[k] = max(differences[k], difference)
    return differences


def derived_intervals(fit: Fit, quantities: Quantities, level: float = CONFIDENCE_LEVEL) -> Array:
    """Return the intervals (q, 2) of quantities; nan where no unknown enters."""
    linearisation = fit.linearisation(quantities)
    values, jacobian = (item.full() for item in linearisation(fit.values))
    ends = fit.first_order_ends(values.ravel(), jacobian, level)
    curved = [k for k, unknown in enumerate(fit.unknowns) if unknown.curved]
    if not curved or not fit.noise.variance > 0.0:
        return ends
    ends_by_value = []
    for held in held_fits(fit, curved[0], level):
        middle, jacobian = (item.full() for item in linearisation(held.values))
        first_order = held.others.first_order_ends(middle.ravel(), np.delete(jacobian, curved[0], axis=1), level)
        ends_by_value.append(middle + held.reach * np.nan_to_num(first_order - middle))
    low, high = np.array(ends_by_value).transpose(2, 0, 1)
    return np.where(np.isnan(ends), ends, np.array([low.min(axis=0), high.max(axis=0)]).T)


@lru_cache(maxsize=2)
def held_fits(fit: Fit, k: int, level: float) -> tuple[HeldFit, ...]:
    """Return the fits with the unknown k held, from its estimate outwards as far as the confidence level allows."""
    free_others = np.flatnonzero(~fit.active_bounds & (np.arange(len(fit.names)) != k))
    scaled = fit.jacobian[:, free_others] * fit.scale[free_others]
    effect_of_k = fit.jacobian[:, k] - scaled @ np.linalg.lstsq(scaled, fit.jacobian[:, k])[0]
    most_rise, least_loss = fit.dispersion(effect_of_k) * fit.quantile(level) ** 2, loss_value(fit.residuals, fit.huber)
    step = float(np.ptp(fit.intervals(level)[k])) / HELD_STEPS
    others = _fit_without(fit, k, fit.values, fit.residuals, fit.jacobian, fit.active_bounds)
    held_fits = [HeldFit(fit.values, others, 1.0)]
    for sign, bound in ((-1.0, fit.lower[k]), (1.0, fit.upper[k])):
        last_values, last_rise = fit.values, 0.0  # the rise of 2 L is relative to the most that the level allows
        while last_rise < 1.0 and last_values[k] != bound:
            c = float(np.clip(last_values[k] + sign * step, fit.lower[k], fit.upper[k]))
            values, others = _fit_held(fit, k, c, last_values)
            rise = max(2 * (loss_value(others.residuals, fit.huber) - least_loss) / most_rise, 0.0)
            if rise < 1.0:
                held_fits.append(HeldFit(values, others, math.sqrt(1 - rise)))
            else:
                part = (1 - math.sqrt(last_rise)) / (math.sqrt(rise) - math.sqrt(last_rise))
                held_fits.append(HeldFit(last_values + part * (values - last_values), others, 0.0))
            last_values, last_rise = values, rise
    return tuple(held_fits)


def _fit_held(fit: Fit, k: int, at: float, start_values: Array) -> tuple[Array, Fit]:
    """Return all unknowns (n,), and the fit of the others with the unknown k held, starting from given ones."""
    start, lower, upper = start_values / fit.scale, fit.lower / fit.scale, fit.upper / fit.scale
    start[k] = at / fit.scale[k]
    lower[k], upper[k] = start[k] - HELD, start[k] + HELD
    minimum = minimise(fit.model, start, lower, upper, huber=fit.huber, systematic=fit.systematic)
    z, values = minimum.z, minimum.z * fit.scale
    values[k] = at
    active = (z - lower < HELD) | (upper - z < HELD)
    return values, _fit_without(fit, k, values, minimum.residuals, minimum.jacobian / fit.scale, active)


def _fit_without(fit: Fit, k: int, values: Array, residuals: Array, jacobian: Array, active: Mask) -> Fit:
    """Return the fit of all unknowns but one, with the noise of the fit of all."""
    active, w = np.delete(active, k), influence(residuals, fit.huber)[1]
    remaining_fit = replace(
        fit,
        unknowns=tuple(unknown for i, unknown in enumerate(fit.unknowns) if i != k),
        values=np.delete(values, k),
        covariance=np.full((len(active), len(active)), math.nan),
        active_bounds=active,
        residuals=residuals,
        jacobian=np.delete(jacobian, k, axis=1),
    )
    basis, triangle = remaining_fit.free_basis
    root = remaining_fit.scale[~active, None] * np.linalg.inv(triangle)
    spread = fit.noise.form(basis) / w**2 + len(residuals) * fit.systematic**2 * np.eye(len(root))
    remaining_fit.covariance[np.ix_(~active, ~active)] = root @ spread @ root.T
    return remaining_fit
