"""Nonlinear programs, solved by IPOPT with exact derivatives: minimise f(x) within bounds of x and of g(x).

References
----------
A. Waechter, L. T. Biegler, On the implementation of an interior-point filter line-search algorithm for large-scale
nonlinear programming, Mathematical Programming 106 (2006).
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from mmap import mmap
from typing import Any

import casadi as cs

from ancf_casadi.exceptions import FitError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import delayed_interrupts, has_interrupt
from ancf_casadi.support.progress import count_step

BLAS_BYTES = 3 * 2**27  # OpenBLAS allocates 128 MiB for each of two threads or more, which have stacks and heaps too
WITHOUT_OUTPUT: Mapping[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}
IPOPT_ADVICE = {
    "Maximum_Iterations_Exceeded": "the iteration limit was reached; start closer, or raise 'ipopt.max_iter'",
    "Maximum_CpuTime_Exceeded": "the time limit was reached; start closer, or raise 'ipopt.max_cpu_time'",
    "Maximum_WallTime_Exceeded": "the time limit was reached; start closer, or raise 'ipopt.max_wall_time'",
    "Infeasible_Problem_Detected": "no nearby point meets all constraints; widen the bounds, or start elsewhere",
    "Restoration_Failed": "no nearby point meets all constraints; start elsewhere, or check the scales",
    "Diverging_Iterates": "the unknowns diverged; bound them, or check that the data determine them",
    "Invalid_Number_Detected": "a value or derivative is not finite; start elsewhere, or bound the unknowns",
    "Search_Direction_Becomes_Too_Small": "the steps became too small; check the scales, or loosen 'ipopt.tol'",
    "Error_In_Step_Computation": "no step could be computed; check the scales, or start elsewhere",
    "Invalid_Option": "an option of IPOPT is unknown, or the linear solver that it names is not installed",
}


@dataclass(frozen=True, eq=False)
class NlpSolution:
    """Solution of a nonlinear program."""

    x: Array  # variables at the minimum
    objective: float  # at the minimum
    iterations: int  # of IPOPT
    solve_seconds: float  # without the time to build the problem
    status: str  # return status of IPOPT
    bound_multipliers: Array  # of the bounds of ``x``, positive at an upper bound
    constraint_multipliers: Array  # positive at an upper bound


def solve_nlp(
    nlp: Mapping[str, cs.MX],
    start: Array,
    *,
    lower: Array | float = -math.inf,
    upper: Array | float = math.inf,
    constraint_lower: Array | float = 0.0,
    constraint_upper: Array | float = 0.0,
    options: Mapping[str, Any] | None = None,
    advice: str = "",
) -> NlpSolution:
    """Minimise ``f`` over ``x`` under the constraints ``g`` of ``nlp``, if there are any, with IPOPT, silently.

    The constraints are equations by default.  ``options`` are those of ``nlpsol``, for example ``hess_lag``, and of
    IPOPT; ``advice`` replaces that of the error message if IPOPT does not converge.
    """
    bounds = {"lbx": lower, "ubx": upper}
    if "g" in nlp:
        bounds |= {"lbg": constraint_lower, "ubg": constraint_upper}
    settings = {**WITHOUT_OUTPUT, **(options or {})}
    _check_memory()
    settings["iteration_callback"] = _EachIteration(nlp)  # ``settings`` keeps it while the solver runs
    try:
        solver = cs.nlpsol("solver", "ipopt", nlp, settings)
        began = time.perf_counter()
        with delayed_interrupts():
            result = solver(x0=start, **bounds)
        seconds = time.perf_counter() - began
    except RuntimeError as error:
        raise FitError(f"the problem cannot be solved as stated: {_reason(error)}") from None
    stats = solver.stats()
    if not stats["success"]:
        status = stats["return_status"]
        advice = advice or IPOPT_ADVICE.get(status, "start elsewhere, or check scales and bounds")
        raise FitError(f"no minimum was found after {stats['iter_count']} iterations ({status}): {advice}", stats)
    return NlpSolution(
        x=result["x"].full().ravel(),
        objective=float(result["f"]),
        iterations=stats["iter_count"],
        solve_seconds=seconds,
        status=stats["return_status"],
        bound_multipliers=result["lam_x"].full().ravel(),
        constraint_multipliers=result["lam_g"].full().ravel(),
    )


@cache
def _check_memory() -> None:
    """Check once that the buffers of OpenBLAS can be allocated; under a limit of memory, it would try for ever."""
    try:
        mmap(-1, BLAS_BYTES).close()
    except OSError:
        raise FitError(
            f"IPOPT needs {BLAS_BYTES >> 20} MiB of memory, above the limit of this process; raise it (ulimit -v)"
        ) from None


class _EachIteration(cs.Callback):
    """Callback after each iteration of IPOPT, which counts it as a step, and stops the solver if a signal is noted."""

    def __init__(self, nlp: Mapping[str, cs.MX]) -> None:
        """Take the shapes of the problem."""
        cs.Callback.__init__(self)
        rows = {name: nlp[name].numel() if name in nlp else 0 for name in ("f", "x", "g", "p")}
        self.rows = [rows[name.removeprefix("lam_")] for name in cs.nlpsol_out()]
        self.construct("each_iteration", {})

    def get_n_in(self) -> int:
        """Return the number of outputs of a solver."""
        return int(cs.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the shape of an output of the solver."""
        return cs.Sparsity.dense(self.rows[i])

    def eval(self, _: Sequence[cs.DM]) -> list[int]:
        """Count one step, and return whether to stop."""
        count_step()
        return [int(has_interrupt())]


def _reason(error: RuntimeError) -> str:
    """Return the end of a CasADi error message, without file names and line numbers."""
    text = re.split(r"\S*casadi/\S+:\d+: ", str(error))[-1]
    return " ".join(text.split())[:200]
