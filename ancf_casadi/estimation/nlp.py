"""Bounded least squares and other nonlinear programs, solved by IPOPT with exact derivatives.

Unknowns x with guesses, scales and bounds, and residuals r(x) of which there are m, more than the n unknowns, give

    minimise  1/2 r(S z)' r(S z) / w    subject to  lower <= S z <= upper,

with S the diagonal matrix of the scales and w the largest diagonal entry of S J' J S at the guess, J = dr/dx, so that
the tolerance of the solver speaks of the unknowns in units of their scales.  Gradient and Hessian are CasADi's.

IPOPT ends where the gradient is small in units of the scales, which says little of an unknown that the data hardly
determine.  With the Hessian of Gauss and Newton, steps d of theirs follow, each the solution of a linear least
squares problem within the bounds, until |J d| is a hundredth of the standard deviation of the residuals: then no
unknown moves by more than a hundredth of its standard error.

Where some residuals are outliers, r^2/2 gives way to the pseudo-Huber loss d^2 ((1 + (r/d)^2)^1/2 - 1), which grows in
proportion to r beyond a residual d.  What the fit tells of the unknowns is in ``ancf_casadi.estimation.fit``.

References
----------
A. Waechter, L. T. Biegler, On the implementation of an interior-point filter line-search algorithm for large-scale
nonlinear programming, Mathematical Programming 106 (2006).
P. Charbonnier, L. Blanc-Feraud, G. Aubert, M. Barlaud, Deterministic edge-preserving regularization in computed
imaging, IEEE Transactions on Image Processing 6 (1997).
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import lsq_linear

from ancf_casadi.estimation.fit import Fit, dispersion, influence
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import positive
from ancf_casadi.support.interrupts import delayed_interrupts

SILENT: Mapping[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}
TIGHT: Mapping[str, Any] = {
    "ipopt.tol": 1e-12,
    "ipopt.compl_inf_tol": 1e-18,  # an unknown that just touches its bound ends its square root away
    "ipopt.acceptable_tol": 1e-8,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 300,
}
LEAST_BARRIER, MOST_BARRIER = 1e-12, 0.1  # the tolerance, and the default of IPOPT
NEAR = 0.1  # standard deviations of the residuals, to which IPOPT goes where steps of Gauss and Newton follow
POLISHED = 0.01  # standard deviations of the residuals by which a last step may change them
POLISHING_STEPS, HALVINGS = 20, 5
AT_BOUND = 1e-6  # of the scale: what an interior point method leaves between an unknown and its bound
ADVICE = {
    "Maximum_Iterations_Exceeded": "the iteration limit was reached; start closer, or raise 'ipopt.max_iter'",
    "Maximum_CpuTime_Exceeded": "the time limit was reached; start closer, or raise it",
    "Maximum_WallTime_Exceeded": "the time limit was reached; start closer, or raise it",
    "Infeasible_Problem_Detected": "no point near meets all constraints; widen the bounds, or start elsewhere",
    "Restoration_Failed": "no point near meets all constraints; start elsewhere, or check the scales",
    "Diverging_Iterates": "the unknowns ran away; bound them, or check that the data determine them",
    "Invalid_Number_Detected": "a value or derivative is not finite; start elsewhere, or bound the unknowns",
    "Search_Direction_Becomes_Too_Small": "the steps became too small; check the scales, or loosen 'ipopt.tol'",
    "Error_In_Step_Computation": "no step could be computed; check the scales, or start elsewhere",
    "Invalid_Option": "an option is unknown, or its linear solver is not installed",
}


@dataclass(frozen=True)
class Unknown:
    """A quantity to be estimated.

    Parameters
    ----------
    name : str
        What it is called in the result.
    guess : float
        Where to start.
    scale : float
        A change that matters: the problem is solved in units of it.
    lower, upper : float
        Bounds.
    unit : str
        SI unit, for reports.

    Raises
    ------
    InputError
        If the scale is not positive, the bounds are not in order, or the guess is not finite and between them.
    """

    name: str
    guess: float
    scale: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""

    def __post_init__(self) -> None:
        """Validate."""
        positive(self.scale, f"{self.name}: scale")
        if not self.lower < self.upper:
            raise InputError(f"the lower bound {self.lower:g} is not below the upper {self.upper:g}", self.name)
        if not (math.isfinite(self.guess) and self.lower <= self.guess <= self.upper):
            raise InputError(f"the guess {self.guess:g} is not within [{self.lower:g}, {self.upper:g}]", self.name)


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution of a nonlinear program.

    Parameters
    ----------
    x : ndarray
        Where the minimum is.
    objective : float
        Its value.
    iterations : int
        Iterations of IPOPT.
    solve_seconds : float
        Time they took, without that of building the problem.
    status : str
        What IPOPT said.
    bound_multipliers : ndarray
        Multipliers of the bounds of ``x``, positive at an upper one.
    constraint_multipliers : ndarray
        Multipliers of the constraints, positive at an upper bound.
    """

    x: Array
    objective: float
    iterations: int
    solve_seconds: float
    status: str
    bound_multipliers: Array
    constraint_multipliers: Array


def least_squares(
    residuals: Callable[..., cs.MX],
    unknowns: Sequence[Unknown],
    *,
    huber: float = math.inf,
    gauss_newton: bool = False,
    forward: bool = False,
    series: Sequence[int] = (),
    noise: float = 0.0,
    systematic: float = 0.0,
    options: Mapping[str, Any] | None = None,
) -> Fit:
    """Estimate unknowns by least squares within their bounds, or by a loss that bears outliers.

    Parameters
    ----------
    residuals : callable
        Takes the unknowns as MX scalars, in their order; returns the residuals as an MX vector.
    unknowns : sequence of Unknown
        What to estimate.
    huber : float
        Residual beyond which the loss grows linearly; least squares without it.
    gauss_newton : bool
        Whether to take J' J for the Hessian, where second derivatives are dear, as through an integration.
    forward : bool
        Whether to make the gradient of J then too, where J is kept for the Hessian, as that of ``motion`` is.
    series : sequence of int
        Lengths of the series that the residuals are made of, each in the order of time; one if not given.
    noise : float
        Standard deviation expected of the residuals: with ``gauss_newton``, IPOPT goes no nearer to the minimum than a
        tenth of it, which the steps that follow do.
    systematic : float
        Root mean square of an error that the residuals may have in common; it enters the standard errors (``fit``).
    options : mapping, optional
        Options of ``nlpsol`` and IPOPT (``"ipopt.max_iter"``); they override those set here.

    Raises
    ------
    InputError
        If ``huber`` is not positive, two unknowns share a name, or there are fewer residuals than unknowns.
    FitError
        If IPOPT does not converge, or the residuals do not determine the unknowns.
    """
    if not huber > 0.0:
        raise InputError(f"must be positive, got {huber:g}", "huber")
    names = tuple(unknown.name for unknown in unknowns)
    if len(set(names)) < len(names):
        raise InputError(f"share a name: {', '.join(names)}", "unknowns")
    scale, guess, lower, upper = np.array([[u.scale, u.guess, u.lower, u.upper] for u in unknowns]).T

    evaluate = residual_function(residuals, scale)
    if evaluate.size1_out(0) < len(names):
        raise InputError(f"{evaluate.size1_out(0)} values cannot determine {len(names)} unknowns", "residuals")
    z = cs.MX.sym("z", len(names))
    r = residuals(*cs.vertsplit(cs.DM(scale) * z))
    remaining, jacobian = _numbers(evaluate, guess / scale)
    weight = float(np.max(np.sum(jacobian**2, axis=0)))
    if not (math.isfinite(weight) and weight > 0.0):
        raise FitError(f"at the guess the derivatives of the residuals are {'zero' if weight == 0.0 else 'not finite'}")
    if gauss_newton:
        options = {**TIGHT, **_gauss_newton(evaluate, huber, weight, forward), **(options or {})}
        for name in ("ipopt.tol", "ipopt.compl_inf_tol"):
            options[name] = max(options[name], NEAR * noise / math.sqrt(weight))
    solution = solve_nlp(
        {"x": z, "f": loss(r, huber) / weight},
        guess / scale,
        lower=lower / scale,
        upper=upper / scale,
        options={**TIGHT, "ipopt.mu_init": _barrier(remaining, weight), **(options or {})},
    )

    found, polished = solution.x, 0
    if gauss_newton:
        near, steps, settled = _polished(evaluate, found, lower / scale, upper / scale, huber, systematic)
        if settled:
            found, polished = near, steps
        elif noise:
            raise FitError(f"no minimum was found: {steps} steps of Gauss and Newton do not settle; start closer")
    at_lower, at_upper = found - lower / scale < AT_BOUND, upper / scale - found < AT_BOUND
    values = np.select([at_lower, at_upper], [lower, upper], found * scale)
    remaining, jacobian = _numbers(evaluate, values / scale)
    jacobian = jacobian / scale
    at_bound = at_lower | at_upper
    covariance, condition = _covariance(remaining, jacobian, ~at_bound, names, huber, systematic)
    return Fit(
        names=names,
        units=tuple(unknown.unit for unknown in unknowns),
        values=values,
        lower=lower,
        upper=upper,
        scale=scale,
        covariance=covariance,
        active_bounds=at_bound,
        residuals=remaining,
        series=tuple(series) or (len(remaining),),
        jacobian=jacobian,
        condition=condition,
        huber=huber,
        systematic=systematic,
        status=solution.status,
        iterations=solution.iterations + polished,
        solve_seconds=solution.solve_seconds,
        model=evaluate,
    )


def _barrier(residuals: Array, weight: float) -> float:
    """Return the barrier parameter to start with: what one residual adds to the objective at the guess.

    The default of IPOPT, 0.1, outweighs residuals that are small at a good guess, and drives the unknowns off it.
    """
    return float(np.clip(np.mean(residuals**2) / (2 * weight), LEAST_BARRIER, MOST_BARRIER))


def residual_function(residuals: Callable[..., cs.MX], scale: Array) -> cs.Function:
    """Return what gives residuals and their derivatives by the unknowns, these in units of their scales."""
    z = cs.MX.sym("z", len(scale))
    r = residuals(*cs.vertsplit(cs.DM(scale) * z))
    return cs.Function("residuals", [z], [cs.densify(r), cs.densify(cs.jtimes(r, z, cs.DM.eye(len(scale))))])


def loss(residuals: cs.MX, huber: float) -> cs.MX:
    """Return half the sum of the squared residuals, or their pseudo-Huber loss."""
    if math.isinf(huber):
        return cs.sumsqr(residuals) / 2
    return huber**2 * cs.sum1(cs.sqrt(1 + (residuals / huber) ** 2) - 1)


def _loss_of(residuals: Array, huber: float) -> float:
    """Return the loss as a number."""
    return float(cs.evalf(loss(cs.MX(cs.DM(residuals)), huber)))


def _gauss_newton(evaluate: cs.Function, huber: float, weight: float, forward: bool) -> dict[str, cs.Function]:
    """Return J' D J, D the slope psi/r of the loss by residual, for Hessian; and the gradient J' psi, if asked for."""
    z, p, factor = cs.MX.sym("z", evaluate.size1_in(0)), cs.MX.sym("p", 0, 1), cs.MX.sym("factor")
    r, jacobian = evaluate(z)
    slope = 1 / cs.sqrt(1 + (r / huber) ** 2)
    gradient = cs.mtimes(jacobian.T, slope * r) / weight
    rows = jacobian * cs.repmat(cs.sqrt(slope), 1, jacobian.shape[1])
    hessian = cs.triu(factor / weight * cs.mtimes(rows.T, rows))
    functions = {"hess_lag": cs.Function("hess_lag", [z, p, factor, cs.MX(0, 1)], [hessian])}
    if forward:
        functions["grad_f"] = cs.Function("grad_f", [z, p], [loss(r, huber) / weight, gradient])
    return functions


def _polished(
    evaluate: cs.Function,
    z: Array,
    lower: Array,
    upper: Array,
    huber: float,
    systematic: float,
) -> tuple[Array, int, bool]:
    """Return the unknowns after steps of Gauss and Newton, the number of steps, and whether they have settled.

    A step that increases the loss by more than its noise is halved.
    """
    r, jacobian = _numbers(evaluate, z)
    size = before = math.inf
    for count in range(POLISHING_STEPS):
        slope, curvature = influence(r, huber)
        root = (1 + (r / huber) ** 2) ** -0.75
        rows = root[:, None] * jacobian
        length = np.linalg.norm(rows, axis=0)
        if not (np.isfinite(rows).all() and length.all()):
            return z, count, False
        bounds = (length * (lower - z)).tolist(), (length * (upper - z)).tolist()
        step = lsq_linear(rows / length, -slope / root, bounds, method="bvls").x / length
        size = float(np.linalg.norm(rows @ step))
        deviation = math.sqrt(dispersion(r, max(len(r) - len(z), 1), huber, systematic) * curvature)
        if size <= POLISHED * deviation or before / 2 < size <= NEAR * deviation:  # the latter by noise of evaluation
            return z, count, True
        before = size
        most = _loss_of(r, huber) + POLISHED * deviation**2
        for _ in range(HALVINGS):
            trial = np.clip(z + step, lower, upper)
            r_trial, jacobian_trial = _numbers(evaluate, trial)
            if _loss_of(r_trial, huber) <= most:
                break
            step = step / 2
        else:
            return z, count, size <= NEAR * deviation
        z, r, jacobian = trial, r_trial, jacobian_trial
    return z, POLISHING_STEPS, size <= NEAR * deviation


def solve_nlp(
    nlp: Mapping[str, cs.MX],
    start: Array,
    *,
    lower: Array | float = -math.inf,
    upper: Array | float = math.inf,
    constraint_lower: Array | float = 0.0,
    constraint_upper: Array | float = 0.0,
    options: Mapping[str, Any] | None = None,
) -> Solution:
    """Solve a nonlinear program with IPOPT, silently.

    Parameters
    ----------
    nlp : mapping
        Variables ``x``, objective ``f`` and, if there are any, constraints ``g``.
    start : ndarray
        Where to start.
    lower, upper : ndarray or float
        Bounds of ``x``.
    constraint_lower, constraint_upper : ndarray or float
        Bounds of ``g``; equations by default.
    options : mapping, optional
        Options of ``nlpsol`` and IPOPT, for example ``hess_lag`` or ``"ipopt.max_iter"``.

    Raises
    ------
    FitError
        If IPOPT does not converge, or CasADi refuses the problem.
    """
    bounds = {"lbx": lower, "ubx": upper}
    if "g" in nlp:
        bounds |= {"lbg": constraint_lower, "ubg": constraint_upper}
    try:
        solver = cs.nlpsol("solver", "ipopt", nlp, {**SILENT, **(options or {})})
        began = time.perf_counter()
        with delayed_interrupts():
            result = solver(x0=start, **bounds)
        seconds = time.perf_counter() - began
    except RuntimeError as error:
        raise FitError(f"the problem cannot be solved as stated: {_reason(error)}") from None
    stats = solver.stats()
    if not stats["success"]:
        status = stats["return_status"]
        advice = ADVICE.get(status, "start elsewhere, or check scales and bounds")
        raise FitError(f"no minimum was found after {stats['iter_count']} iterations ({status}): {advice}", stats)
    return Solution(
        x=result["x"].full().ravel(),
        objective=float(result["f"]),
        iterations=stats["iter_count"],
        solve_seconds=seconds,
        status=stats["return_status"],
        bound_multipliers=result["lam_x"].full().ravel(),
        constraint_multipliers=result["lam_g"].full().ravel(),
    )


def _numbers(function: cs.Function, x: Array) -> tuple[Array, Array]:
    """Return a vector and its Jacobian, from a Function that gives both."""
    with delayed_interrupts():
        vector, jacobian = function(x)
    return vector.full().ravel(), jacobian.full()


def _covariance(
    residuals: Array,
    jacobian: Array,
    free: Mask,
    names: tuple[str, ...],
    huber: float,
    systematic: float,
) -> tuple[Array, float]:
    """Return phi/w (J' J)^-1 for the free unknowns, by a singular value decomposition with columns of unit length.

    Also return the condition number of these columns.
    """
    length = np.linalg.norm(jacobian[:, free], axis=0)
    triangle = np.linalg.qr(jacobian[:, free] / np.where(length > 0.0, length, 1.0), mode="r")
    _, singular, directions = np.linalg.svd(triangle, full_matrices=False)
    if free.any() and singular[-1] < len(residuals) * np.finfo(float).eps:
        weak = np.flatnonzero(free)[np.abs(directions[-1]) > 0.1]
        raise FitError(f"the data do not determine {', '.join(names[i] for i in weak)}; fix one, or add data")
    _, curvature = influence(residuals, huber)
    surplus = len(residuals) - int(np.count_nonzero(free))
    variance = dispersion(residuals, surplus, huber, systematic) / curvature
    root = (directions.T / singular) / length[:, None]
    covariance = np.full((len(names), len(names)), math.nan)
    covariance[np.ix_(free, free)] = variance * root @ root.T
    return covariance, float(singular[0] / singular[-1]) if free.any() else math.nan


def _reason(error: RuntimeError) -> str:
    """Return what a message of CasADi says at its end, without the places in its source."""
    said = re.split(r"\S*casadi/\S+:\d+: ", str(error))[-1]
    return " ".join(said.split())[:200]
