"""The nonlinear programs that match a beam to measured modes, the matching process of Section 5.1 and Table 10.

With the residuals r(m) of frequencies and shapes (``response``),

    least-squares    minimise  1/2 |t|^2 + p(m)/w     subject to  r(m) = w^(1/2) t,    w = 1e-8,
    worst-error      minimise  s + p(m)               subject to  -s <= f_k(m)/target_k - 1 <= s,

and the bounds.  p is u^2 times the preference, with u as in ``response``; worst-error always prefers the least change.
The auxiliary unknowns t and s keep r(m) in the constraints, which are met to rounding; the gradient of |r|^2/(2 w)
would magnify the rounding by 1/w.  Both programs have the form

    minimise    c^T t + 1/2 t^T Q t + 1/2 (m - m_0)^T P (m - m_0)    subject to  lower <= S r(m) + T t <= upper,

where t includes s.

Equilibrium and modes are computed at each m, with exact first and second derivatives
(``ancf_casadi.vibration.sensitivities``).  With equilibrium and eigenpairs as unknowns too, the program would need no
inner solver.  But it would have 527 unknowns instead of 47 at 20 elements, take 23 iterations instead of 10, find no
solution in 200 iterations at 80 elements, and could end at the wrong mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.support.arrays import Array
from problems.matching.preference import WEIGHT, LeastChange
from problems.matching.response import Matching, Response

TIE_WEIGHT = 1e-6  # weight of p in worst-error: a mean square change of 1 costs as much as an error of TIE_WEIGHT/2
MATCHING_OPTIONS: dict[str, Any] = {
    "no_nlp_grad": True,  # CasADi would differentiate the callbacks, and cannot
    "ipopt.tol": 1e-8,
    "ipopt.compl_inf_tol": 1e-11,  # separates active from inactive bounds clearly
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "adaptive",  # half the iterations if the targets are out of reach
    "ipopt.nlp_scaling_method": "none",  # the program is scaled here
}


@dataclass(frozen=True, eq=False)
class Optimum:
    """An optimum found by IPOPT.

    Parameters
    ----------
    m : array (N,)
        The unknowns.
    value : float
        The objective.
    iterations : int
        Iterations of IPOPT.
    seconds : float
        Time of the solution, s.
    multipliers : array (N + r,)
        Decrease of the objective per unit by which a bound is widened, to first order, by ``bounded_names``.
    """

    m: Array
    value: float
    iterations: int
    seconds: float
    multipliers: Array


@dataclass(frozen=True, eq=False)
class Program:
    """The matrices of a program, by their symbols above.

    Parameters
    ----------
    c, Q : array (k,), (k, k)
        Linear and quadratic objective of the auxiliary unknowns.
    P : array (N, N)
        Quadratic form of the preference.
    S, T : array (g, R), (g, k)
        Coefficients of the residuals and of the auxiliary unknowns in the constraints.
    lower, upper : array (g,)
        Bounds of the constraints.
    start : array (k,)
        Start of the auxiliary unknowns.
    least : float
        Lower bound of the auxiliary unknowns.
    """

    c: Array
    Q: Array
    P: Array
    S: Array
    T: Array
    lower: Array
    upper: Array
    start: Array
    least: float


def least_squares_program(matching: Matching, residuals: Array) -> Program:
    """Return the program of least squares, from the residuals at the start."""
    count, root = len(residuals), math.sqrt(WEIGHT)
    return Program(
        c=np.zeros(count),
        Q=np.eye(count),
        P=matching.preference_matrix * (matching.unit**2 / WEIGHT),
        S=np.eye(count),
        T=-root * np.eye(count),
        lower=np.zeros(count),
        upper=np.zeros(count),
        start=residuals / root,
        least=-math.inf,
    )


def worst_error_program(matching: Matching, residuals: Array) -> Program:
    """Return the program of the smallest worst relative error, from the residuals at the start."""
    one, none = np.ones(len(residuals)), np.zeros(len(residuals))
    return Program(
        c=np.ones(1),
        Q=np.zeros((1, 1)),
        P=LeastChange(TIE_WEIGHT).matrix(matching.space, TIE_WEIGHT),
        S=np.vstack([np.diag(one), np.diag(one)]),
        T=np.concatenate([-one, one])[:, None],
        lower=np.concatenate([none - math.inf, none]),
        upper=np.concatenate([none, none + math.inf]),
        start=np.abs(residuals).max(keepdims=True),
        least=0.0,
    )


def solve(matching: Matching, start: Array) -> Optimum:
    """Solve the program of a matching from a start within the bounds.

    Raises
    ------
    EquilibriumError
        If the beam has no stable equilibrium at the start.
    FitError
        If IPOPT does not converge.
    """
    response = matching.response()
    make = worst_error_program if matching.objective == "worst-error" else least_squares_program
    return _minimise(matching, response, make(matching, response.residuals(start)), start)


def _minimise(matching: Matching, response: Response, program: Program, start: Array) -> Optimum:
    """Minimise a program with IPOPT, from exact first and second derivatives."""
    space = matching.space
    size, rows, count = space.size, cs.DM(space.rows), response.size
    c, Q, P, S, T = (cs.sparsify(cs.DM(matrix)) for matrix in (program.c, program.Q, program.P, program.S, program.T))
    r = External("r", response.residuals, [size], (count, 1))
    jacobian = External("J", response.jacobian, [size], (count, size))
    curvature = External("H", response.curvature, [size, count], (size, size))

    x = cs.MX.sym("x", size + len(program.start))
    m, t = x[:size], x[size:]
    change = m - cs.DM(space.standard)
    f = cs.dot(c, t) + cs.bilin(Q, t, t) / 2 + cs.bilin(P, change, change) / 2
    g = cs.vertcat(S @ r(m) + T @ t, rows @ m)
    g_jacobian = cs.vertcat(cs.horzcat(S @ jacobian(m), T), cs.MX(cs.horzcat(rows, cs.DM(len(space.rows), t.numel()))))
    sigma, y, no_parameter = cs.MX.sym("sigma"), cs.MX.sym("y", g.numel()), cs.MX.sym("p", 0)
    multipliers_of_r = S.T @ y[: len(program.lower)]
    hessian = cs.diagcat(sigma * P + curvature(m, multipliers_of_r), sigma * Q)

    below, above = space.row_bounds
    solution = solve_nlp(
        {"x": x, "f": f, "g": g},
        np.concatenate([start, program.start]),
        lower=np.concatenate([space.lower, np.full(len(program.start), program.least)]),
        upper=np.concatenate([space.upper, np.full(len(program.start), math.inf)]),
        constraint_lower=np.concatenate([program.lower, below]),
        constraint_upper=np.concatenate([program.upper, above]),
        options={
            **MATCHING_OPTIONS,
            "grad_f": cs.Function("grad_f", [x, no_parameter], [f, cs.gradient(f, x)]),
            "jac_g": cs.Function("jac_g", [x, no_parameter], [g, g_jacobian]),
            "hess_lag": cs.Function("hess_lag", [x, no_parameter, sigma, y], [cs.triu(hessian)]),
        },
        advice="give another guess, more starts or other bounds, or let fewer properties change",
    )
    of_rows = solution.constraint_multipliers[len(program.lower) :]
    return Optimum(
        m=solution.x[:size],
        value=solution.objective,
        iterations=solution.iterations,
        seconds=solution.solve_seconds,
        multipliers=np.abs(np.concatenate([solution.bound_multipliers[:size], of_rows])),
    )


class External(cs.Callback):
    """A function of vectors, computed in Python; nan where it has no value.  Keep a reference while CasADi uses it."""

    def __init__(
        self, name: str, evaluate: Callable[..., Array], inputs: Sequence[int], output: tuple[int, int]
    ) -> None:
        cs.Callback.__init__(self)
        self._evaluate, self._inputs, self._output = evaluate, inputs, output
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._inputs)

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the size of an input."""
        return cs.Sparsity.dense(self._inputs[i], 1)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the size of the output."""
        return cs.Sparsity.dense(*self._output)

    def eval(self, arguments: Sequence[cs.DM]) -> list[cs.DM]:
        """Evaluate the function."""
        try:
            value = self._evaluate(*(argument.full().ravel() for argument in arguments))
        except (EquilibriumError, np.linalg.LinAlgError):
            value = np.full(self._output, math.nan)
        return [cs.DM(value)]
