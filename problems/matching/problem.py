"""The program that matches a beam to measured modes, in its unknowns alone.

With the residuals r(m), relative frequency errors and what is left of the shapes, in units of the best known one,

    least-squares    minimise  1/2 |t|^2 + p(m)/w     subject to  r(m) = w^(1/2) t,    w = 1e-8,
    worst-error      minimise  s + p(m)  subject to  -s <= f_k(m)/target_k - 1 <= s,

and the bounds.  p is the preference, with worst-error that for the least change.  The residuals are unknowns t of their
own: as constraints they are met to the rounding of computed ones, while the gradient of |r|^2/(2 w) would magnify it by
1/w.

Equilibrium and modes are solved for at each m, with exact first and second derivatives
(``vibration.sensitivities``).  Stated with equilibrium and eigenpairs as unknowns too the program has no solution
process inside, but 527 unknowns instead of 47 at 20 elements: 23 iterations instead of 10, no solution in 200 at 80
elements, and it can end at a mode that was not meant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.nlp import solve_nlp
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.support.arrays import Array
from problems.matching.preference import WEIGHT, LeastChange
from problems.matching.response import Matching

TIE = 1e-6  # weight of p with worst-error: a mean square change of 1 may cost half of it in worst error
OPTIONS: dict[str, Any] = {
    "no_nlp_grad": True,  # CasADi would differentiate what it cannot
    "ipopt.tol": 1e-8,
    "ipopt.compl_inf_tol": 1e-11,  # an unknown at its bound is there, and one that is not does not feel it
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "adaptive",  # half the iterations where the targets are out of reach
    "ipopt.nlp_scaling_method": "none",  # the problem is scaled here
}


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where IPOPT ended.

    Parameters
    ----------
    m : array (N,)
        The unknowns.
    value : float
        The objective.
    iterations : int
        Iterations of IPOPT.
    seconds : float
        Time they took, s.
    multipliers : array (N + r,)
        What widening the bounds of the unknowns and of the smooth factors by 1 would take from the objective, to first
        order.
    """

    m: Array
    value: float
    iterations: int
    seconds: float
    multipliers: Array


def solve(matching: Matching, start: Array) -> Optimum:
    """Solve the program from a start within the bounds.

    Raises
    ------
    EquilibriumError
        If the beam has no stable equilibrium at the start.
    FitError
        If IPOPT does not converge.
    """
    space, response = matching.space, matching.response()
    size, rows = space.size, cs.DM(space.rows)
    first = response.residuals(start)
    count = response.size
    worst = matching.objective == "worst-error"
    own = 1 if worst else count

    X = cs.MX.sym("X", size + own)
    m, t = X[:size], X[size:]
    r = external("r", lambda m: response.residuals(m), [size], (count, 1))
    jacobian = external("J", lambda m: response.jacobian(m), [size], (count, size))
    curvature = external("H", lambda m, y: response.curvature(m, y), [size, count], (size, size))
    change = m - cs.DM(space.standard)
    tie = LeastChange(TIE).matrix(space, TIE) if worst else matching.weights * (matching.unit**2 / WEIGHT)
    tied = cs.sparsify(cs.DM(tie))
    if worst:
        f = t + cs.bilin(tied, change, change) / 2
        share = np.ones((count, 1))
        g = [r(m) - t, r(m) + t]
        limits = [(-math.inf, 0.0)] * count + [(0.0, math.inf)] * count
        own_start, own_lower = [float(np.abs(first).max())], 0.0
    else:
        f = cs.sumsqr(t) / 2 + cs.bilin(tied, change, change) / 2
        share = math.sqrt(WEIGHT) * np.eye(count)
        g = [r(m) - math.sqrt(WEIGHT) * t]
        limits = [(0.0, 0.0)] * count
        own_start, own_lower = (first / math.sqrt(WEIGHT)).tolist(), -math.inf
    low, high = np.concatenate([np.array(limits), np.array(space.row_bounds).T]).T
    constraints = cs.vertcat(*g, rows @ m)

    J, y, sigma, none = jacobian(m), cs.MX.sym("y", constraints.numel()), cs.MX.sym("sigma"), cs.MX.sym("p", 0)
    blocks = [cs.horzcat(J, -share), cs.horzcat(J, share)] if worst else [cs.horzcat(J, -share)]
    by_x = cs.vertcat(*blocks, cs.MX(cs.horzcat(rows, cs.DM(rows.shape[0], own))))
    of_r = y[:count] + y[count : 2 * count] if worst else y[:count]
    of_own = cs.DM(own, own) if worst else cs.DM.eye(own)
    second = sigma * cs.diagcat(tied, of_own) + cs.diagcat(curvature(m, of_r), cs.MX(own, own))
    solution = solve_nlp(
        {"x": X, "f": f, "g": constraints},
        np.concatenate([start, own_start]),
        lower=np.concatenate([space.lower, np.full(own, own_lower)]),
        upper=np.concatenate([space.upper, np.full(own, math.inf)]),
        constraint_lower=low,
        constraint_upper=high,
        options={
            **OPTIONS,
            "grad_f": cs.Function("grad_f", [X, none], [f, cs.gradient(f, X)]),
            "jac_g": cs.Function("jac_g", [X, none], [constraints, by_x]),
            "hess_lag": cs.Function("hess_lag", [X, none, sigma, y], [cs.triu(second)]),
        },
    )
    of_rows = solution.constraint_multipliers[len(low) - len(space.rows) :]
    return Optimum(
        m=solution.x[:size],
        value=solution.objective,
        iterations=solution.iterations,
        seconds=solution.solve_seconds,
        multipliers=np.abs(np.concatenate([solution.bound_multipliers[:size], of_rows])),
    )


class External(cs.Callback):
    """A function of vectors that is computed in Python; nan where it has no value."""

    def __init__(
        self, name: str, evaluate: Callable[..., Array], inputs: Sequence[int], output: tuple[int, int]
    ) -> None:
        cs.Callback.__init__(self)
        self.evaluate, self.inputs, self.output = evaluate, inputs, output
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self.inputs)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return 1

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the size of an input."""
        return cs.Sparsity.dense(self.inputs[i], 1)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the size of the output."""
        return cs.Sparsity.dense(*self.output)

    def eval(self, arguments: Sequence[cs.DM]) -> list[cs.DM]:
        """Evaluate."""
        try:
            value = self.evaluate(*(argument.full().ravel() for argument in arguments))
        except (EquilibriumError, np.linalg.LinAlgError):
            value = np.full(self.output, math.nan)
        return [cs.DM(value)]


def external(name: str, evaluate: Callable[..., Array], inputs: Sequence[int], output: tuple[int, int]) -> External:
    """Return a function computed in Python as one that CasADi can call; keep a reference while it is used."""
    return External(name, evaluate, inputs, output)
