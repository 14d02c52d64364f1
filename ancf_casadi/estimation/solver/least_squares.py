"""Bounded least squares by IPOPT or Gauss-Newton steps, with exact derivatives.

For n unknowns x with guesses, scales and bounds, and at least as many residuals r(x), the problem in z = x/scale, or
scale/x for a reciprocal unknown, is

    minimise  1/2 r(S z)' r(S z) / w    subject to  lower <= S z <= upper,

with S the diagonal matrix of the scales, J = dr/dx, and w the largest diagonal entry of S J' J S at the guess, so that
the tolerance of the solver refers to the unknowns in units of their scales.  IPOPT solves it with the exact Hessian if
the residuals are in closed form, as those of decays.  Second derivatives of others, such as motions, are expensive:
Gauss-Newton steps take the place of IPOPT (``gauss_newton``, with the loss that replaces r^2/2 if some residuals are
outliers).  ``fit`` has the uncertainty of the solution.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import Fit, SolverSettings
from ancf_casadi.estimation.noise.stated import AssumedNoise, residual_noise
from ancf_casadi.estimation.solver.gauss_newton import Minimum, influence, loss, minimise, residuals_and_jacobian
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown, with_guesses
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.tall import tall_triangle

TIGHT: Mapping[str, Any] = {
    "ipopt.tol": 1e-12,
    "ipopt.compl_inf_tol": 1e-18,  # an unknown that just touches its bound ends the square root of this from it
    "ipopt.acceptable_tol": 1e-8,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 300,
}
UNKNOWN_NOISE, DEFAULT_SETTINGS = AssumedNoise(), SolverSettings()
AT_BOUND = 1e-6  # distance, in scales, that an interior-point method leaves between an unknown and its active bound


def least_squares(
    residuals: Callable[..., cs.MX],  # the unknowns as MX scalars, in their order -> MX vector
    unknowns: Sequence[Unknown],
    *,
    huber: float = math.inf,  # residual beyond which the loss grows linearly
    systematic: float = 0.0,  # root mean square of a systematic error, for which the standard errors allow
    noise: AssumedNoise = UNKNOWN_NOISE,  # with ``huber``, stated standard deviations count for nothing
    settings: SolverSettings = DEFAULT_SETTINGS,
    jacobian: Array | None = None,  # of the residuals by the coordinates of the unknowns near the guess, (m, n)
) -> Fit:
    """Estimate unknowns within their bounds by least squares or, with ``huber``, by the pseudo-Huber loss."""
    if not huber > 0.0:
        raise InputError(f"must be positive, got {huber:g}", "huber")
    names = tuple(unknown.name for unknown in unknowns)
    if len(set(names)) < len(names):
        raise InputError(f"share a name: {', '.join(names)}", "unknowns")
    y = Coordinates.of(unknowns)
    evaluate = residual_function(residuals, y)
    if evaluate.size1_out(0) < len(names):
        raise InputError(f"{evaluate.size1_out(0)} values cannot determine {len(names)} unknowns", "residuals")

    began = time.perf_counter()
    if settings.closed_form:
        minimum, status = _by_ipopt(residuals, evaluate, y, huber, settings.advice)
    else:
        scaled = None if jacobian is None else jacobian * y.scale
        minimum, status = _by_gauss_newton(evaluate, y, settings, huber=huber, systematic=systematic, jacobian=scaled)
    seconds = time.perf_counter() - began
    lower, upper = y.scaled_bounds
    z, r, jacobian = minimum.z, minimum.residuals, minimum.jacobian
    bound_distance = np.maximum(AT_BOUND, _invisible_moves(r, jacobian, systematic))
    at_lower, at_upper = z - lower < bound_distance, upper - z < bound_distance
    values, active = np.select([at_lower, at_upper], [y.lower, y.upper], z * y.scale), at_lower | at_upper
    if (active & (values / y.scale != z)).any():
        r, jacobian = residuals_and_jacobian(evaluate, values / y.scale)
    jacobian, free = jacobian / y.scale, ~active
    if not np.isfinite(jacobian).all():
        raise FitError(
            f"at the bounds that the estimates reach, the residuals are not finite; {settings.advice or 'move them'}"
        )
    root, condition, weak = _inverse_root(jacobian[:, free])
    if weak.any():
        undetermined = ", ".join(np.array(names)[free][weak])
        raise FitError(f"the data do not determine {undetermined}; {settings.advice or 'fix one, or add data'}")
    basis, (psi, w) = jacobian[:, free] @ root, influence(r, huber)
    scatter = residual_noise(psi, basis, noise if math.isinf(huber) else replace(noise, stated=None))
    spread = scatter.form(basis) / w**2 + len(r) * systematic**2 * np.eye(len(root))
    covariance = np.full((len(names), len(names)), math.nan)
    covariance[np.ix_(free, free)] = root @ spread @ root.T
    return Fit(
        unknowns=tuple(unknowns),
        values=values,
        covariance=covariance,
        active_bounds=active,
        residuals=r,
        series=tuple(noise.series),
        times=noise.times,
        noise=scatter,
        jacobian=jacobian,
        condition=condition,
        huber=huber,
        systematic=systematic,
        status=status,
        iterations=minimum.steps,
        solve_seconds=seconds,
        model=evaluate,
        settings=settings,
    )


def _by_gauss_newton(
    evaluate: cs.Function, y: Coordinates, settings: SolverSettings, **weights: Any
) -> tuple[Minimum, str]:
    """Return the minimum by Gauss-Newton steps; raise a FitError if none was possible, or if they do not converge."""
    minimum = minimise(evaluate, y.guess / y.scale, *y.scaled_bounds, inaccuracy=settings.inaccuracy, **weights)
    if not minimum.steps:
        _largest_weight(minimum.jacobian)  # check
    if not minimum.settled:
        raise FitError(
            f"no minimum was found: {minimum.steps} Gauss-Newton steps do not converge; "
            f"{settings.advice or 'start closer'}",
            {"iter_count": minimum.steps},
        )
    return minimum, "converged"


def _by_ipopt(
    residuals: Callable[..., cs.MX], evaluate: cs.Function, y: Coordinates, huber: float, advice: str
) -> tuple[Minimum, str]:
    """Return the minimum by IPOPT, and its return status."""
    r, jacobian = residuals_and_jacobian(evaluate, y.guess / y.scale)
    weight = _largest_weight(jacobian)
    z = cs.MX.sym("z", len(y.scale))
    objective = loss(residuals(*y.symbols(cs.vertsplit(cs.DM(y.scale) * z))), huber) / weight
    lower, upper = y.scaled_bounds
    options = {**TIGHT, **_near_start(r, weight)}
    solution = solve_nlp(
        {"x": z, "f": objective}, y.guess / y.scale, lower=lower, upper=upper, options=options, advice=advice
    )
    linearisation = residuals_and_jacobian(evaluate, solution.x)
    return Minimum(solution.x, *linearisation, solution.iterations, settled=True), solution.status


def residual_function(residuals: Callable[..., cs.MX], coordinates: Coordinates) -> cs.Function:
    """Return the Function from the coordinates, in units of their scales, to the residuals and their Jacobian."""
    z = cs.MX.sym("z", len(coordinates.scale))
    r = residuals(*coordinates.symbols(cs.vertsplit(cs.DM(coordinates.scale) * z)))
    return cs.Function("residuals", [z], [cs.densify(r), cs.densify(cs.jtimes(r, z, cs.DM.eye(z.numel())))])


def _invisible_moves(residuals: Array, jacobian: Array, systematic: float) -> Array:
    """Return the distance (n,), in scales, by which an unknown may move without a visible change of the residuals."""
    deviation = max(math.sqrt(np.mean(residuals**2)), systematic)
    with np.errstate(divide="ignore", invalid="ignore"):
        # change of the residuals, in standard deviations, by which an unknown at its bound may miss it
        return np.asarray(np.nan_to_num(0.01 * deviation / np.linalg.norm(jacobian, axis=0), posinf=0.0))


def _largest_weight(jacobian: Array) -> float:
    """Return the largest diagonal entry w of J' J, which is finite and positive."""
    weight = float(np.max(np.sum(jacobian**2, axis=0)))
    if not (math.isfinite(weight) and weight > 0.0):
        fault = "zero" if weight == 0.0 else "not finite"
        raise FitError(f"at the guess the derivatives of the residuals are {fault}; start from another guess")
    return weight


def _near_start(residuals: Array, weight: float) -> dict[str, float]:
    """Return the initial barrier parameter mu, the mean contribution of a residual to the objective at the guess.

    At a good guess the residuals are small: the default of IPOPT, 0.1, would outweigh them and drive the unknowns away.
    So would its least distance from a bound; with a unit second derivative, the barrier keeps mu^1/2.
    """
    barrier = float(np.clip(np.mean(residuals**2) / (2 * weight), 1e-12, 0.1))  # the tolerance, and IPOPT's default
    push = min(math.sqrt(barrier), 0.01)  # its default
    return {"ipopt.mu_init": barrier, "ipopt.bound_push": push, "ipopt.bound_frac": push}


def _inverse_root(jacobian: Array) -> tuple[Array, float, Mask]:
    """Return a square root H of (J' J)^-1 = H H' by a singular value decomposition of J with columns of unit length.

    The columns of J H are orthonormal.  Also return the condition number of the columns of unit length, and a mask (n,)
    of the unknowns that the data do not determine: those in the direction of the smallest singular value, if this is
    zero to rounding.
    """
    m, n = jacobian.shape
    if not n:
        return np.empty((0, 0)), math.nan, np.zeros(0, dtype=bool)
    length = np.linalg.norm(jacobian, axis=0)
    triangle = tall_triangle(jacobian / np.where(length > 0.0, length, 1.0))
    _, singular, directions = np.linalg.svd(triangle, full_matrices=False)
    if singular[-1] < m * np.finfo(float).eps:
        # component of an unknown in an undetermined direction above which the error message names it
        return np.empty((0, 0)), math.inf, np.abs(directions[-1]) > 0.1
    root = (directions.T / singular) / length[:, None]
    return root, float(singular[0] / singular[-1]), np.zeros(n, dtype=bool)


def refit_with_noise(fit: Fit, noise: Array) -> Array:
    """Return the unknowns (n,) from a fit to the fitted curve plus noise of each residual (m,), from the estimates."""
    change, y = cs.DM(fit.residuals + noise), fit.coordinates

    def residuals(*x: cs.MX) -> cs.MX:
        return fit.model.call([cs.vertcat(*y.symbols(x)) / cs.DM(y.scale)], True, False)[0] - change

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a trial that cannot be computed shortens the step
        fit_to_noise = least_squares(
            residuals, with_guesses(fit.unknowns, fit.estimates), huber=fit.huber, settings=fit.settings
        )
    return np.array(list(fit_to_noise.estimates.values()))
