"""Newton's method inside a CasADi Function, with exact derivatives of the solution.

The solution z(p) of F(z, p) = 0 comes from a CasADi rootfinder, which differentiates it by the implicit function
theorem, dz/dp = -(dF/dz)^-1 dF/dp.  The rootfinder does not report a failure: the caller checks the solution, and
multiplies it by ``certain``.
"""

from __future__ import annotations

import math

import casadi as cs

NEWTON_OPTIONS = {"error_on_fail": False, "max_iter": 12, "abstol": 0.0, "abstolStep": 1e-9}


def newton(name: str, inputs: list[cs.MX], jacobian: cs.MX, equations: cs.MX) -> cs.Function:
    """Return (start, parameters) -> solution of the equations for the first input."""
    derivative = cs.Function(f"{name}_jacobian", inputs, [jacobian, equations])
    function = cs.Function(f"{name}_equations", inputs, [equations])
    # unknowns up to which scalar operations are three times as fast as loops over the elements
    if inputs[0].numel() <= 40:
        derivative, function = (f.expand(f.name(), {"cse": True}) for f in (derivative, function))
    return cs.rootfinder(name, "fast_newton", function, {**NEWTON_OPTIONS, "jacobian_function": derivative})


def scaled(matrix: cs.MX, rows: cs.MX | cs.DM, columns: cs.MX | cs.DM) -> cs.MX:
    """Return diag(rows) A diag(columns) for a sparse matrix A."""
    row, column = matrix.sparsity().get_triplet()
    return cs.MX(matrix.sparsity(), matrix.nz[:] * rows[row] * columns[column])


def certain(condition: cs.MX) -> cs.MX:
    """Return 1 if the condition holds, else nan: a factor that makes a value and its derivatives nan."""
    return cs.if_else(condition, 1.0, math.nan)
