"""Estimation from any mix of measurements: one loop over the blocks of residuals of a problem (``problem``).

The steps are: check that the data determine the unknowns (``determination``); fit; fit again with the weights that the
residuals give, for some blocks until these settle; compute the error of each block's discretisation, and refine it
until it shifts no estimate by much (``refinement``); allow for errors of the measurements that residuals need not show.

The error of the mesh of a beam is computed once, at the estimates, when it is asked for (``FitSolution.mesh_shifts``).
The residuals r(l) for elements of the length l differ from r(0) by c l^4, so that 16/15 of the way to the estimates for
l/2 lead to those without the error.

If an optimum need not be the only one, the fit starts from several points, and the result has all optima that fit as
well as the best one within the 95 % level.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import MESH_REMAINDER, Block, Fitted
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.problem import FIT_ADVICE, FitProblem, refit, standardised_residuals
from ancf_casadi.estimation.refinement import refine
from ancf_casadi.estimation.solver.least_squares import residual_function
from ancf_casadi.estimation.solver.unknown import with_guesses
from ancf_casadi.exceptions import AncfError, FitError
from ancf_casadi.support.arrays import Array

MOST_REWEIGHTINGS = 5  # of a block whose weights need to settle
OPTIMA_APART = 0.05  # relative difference of unknowns that belong to different optima
MOST_MESH_STEPS = 3  # to the estimates on a finer mesh
MOST_MESH_REMAINDER = 2.0  # sum of squares that a finer mesh may leave, relative to that of the fit


@dataclass(frozen=True, eq=False)
class FitSolution:
    """The solution of a problem."""

    problem: FitProblem  # with the weights and the discretisation of the fit
    fit: Fit
    shifts: Array  # (b, n) of the estimates by the error of each block, in standard errors; nan if unknown
    other_optima: tuple[Fit, ...]  # other optima that fit as well within the 95 % level

    @property
    def fitted_blocks(self) -> list[tuple[Block, Fitted]]:
        """Each block, and what the fit says of it."""
        blocks = zip(self.problem.blocks, self.problem.rows, self.shifts, strict=True)
        return [(block, Fitted(self.fit, rows, self.problem.scale, shifts)) for block, rows, shifts in blocks]

    @cached_property
    def mesh_shifts(self) -> Array:
        """Shifts (n,) of the estimates by the error of the mesh of the beam, in standard errors; nan if unknown.

        They are unknown if the records contradict a finer mesh, as those that were simulated on this one do.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of the finer mesh
                return _mesh_shifts(self.problem, self.fit)
        except AncfError:
            return np.full(len(self.fit.names), math.nan)
        finally:
            self.problem.close()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the Functions, which the receiving process derives again."""
        fits = [replace(fit, model=cs.Function()) for fit in (self.fit, *self.other_optima)]
        return _restore, (self.problem, self.shifts, fits, self.mesh_shifts)


def _mesh_shifts(problem: FitProblem, fit: Fit) -> Array:
    """Return ``FitSolution.mesh_shifts`` by Gauss-Newton steps with the Jacobian of the fit on the finer mesh."""
    rough = [block.rough for block in problem.blocks]
    finer = [block.split() for block in rough]
    if not any(finer):
        return np.zeros(len(fit.names))
    coarse = [block.residuals_at(fit.estimates) for block in rough]
    noise = np.fmax(np.sum(fit.residuals**2), len(fit.residuals) * fit.noise.variance)
    values = fit.values
    for _ in range(MOST_MESH_STEPS):
        estimates = dict(zip(fit.names, fit.coordinates.unknowns(values).tolist(), strict=True))
        changed = fit.residuals + fit.jacobian @ (values - fit.values)
        for before, block, rows in zip(coarse, finer, problem.rows, strict=False):
            if block:
                changed[rows] = fit.residuals[rows] + problem.scale * (block.residuals_at(estimates) - before)
        if not np.isfinite(changed).all():
            break
        change = changed - fit.residuals - fit.jacobian @ (values - fit.values)
        shifts = fit.shifts(change)
        values = np.clip(fit.values + np.nan_to_num(shifts * fit.errors), fit.lower, fit.upper)
        remaining = fit.residuals + change + fit.jacobian @ (values - fit.values)
        if np.sum(remaining**2) <= MOST_MESH_REMAINDER * noise:
            return MESH_REMAINDER * shifts
    return np.full(len(fit.names), math.nan)


def _restore(problem: FitProblem, shifts: Array, fits: Sequence[Fit], mesh_shifts: Array) -> FitSolution:
    fit, *other_optima = (replace(fit, model=residual_function(problem.residuals, fit.coordinates)) for fit in fits)
    solution = FitSolution(problem, fit, shifts, tuple(other_optima))
    solution.__dict__["mesh_shifts"] = mesh_shifts
    return solution


def solve(problem: FitProblem, starts: Sequence[Mapping[str, float]] = ({},), *, compare: bool = True) -> FitSolution:
    """Estimate the unknowns of a problem from starts, guesses by name.

    The best optimum counts; without ``compare``, the first one.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a trial that cannot be computed shortens the step
        try:
            problem, fit, other_optima = _reweight(problem, _optima(problem, starts, compare=compare))
            problem, fit, shifts = refine(problem, fit)
            return _check_result(_allow(FitSolution(problem, fit, shifts, tuple(other_optima))))
        finally:
            problem.close()


def fitted_once(problem: FitProblem) -> Fit:
    """Return the estimates for the weights and the discretisation that a problem has, enough near the truth."""
    try:
        return problem.fit(check=True)
    finally:
        problem.close()


def _optima(problem: FitProblem, starts: Sequence[Mapping[str, float]], *, compare: bool) -> list[Fit]:
    """Return the best fit, and others that fit as well; without ``compare``, the first one."""
    fits: list[Fit] = []
    failures: list[FitError] = []
    for k, start in enumerate(starts):
        try:
            problem_from_start = replace(problem, unknowns=tuple(with_guesses(problem.unknowns, start)))
            fits.append(problem_from_start.fit(check=k == 0))
            if not compare:
                break
        except FitError as error:
            failures.append(error)
            if k == 0 and not error.stats and not problem.closed_form:
                break  # the data do not determine the unknowns, from wherever the fit starts
    if not fits:
        raise failures[0]
    fits.sort(key=lambda fit: fit.residual_rms)
    optima = [fits[0]]
    highest_square = np.sum(fits[0].residuals ** 2) + np.nan_to_num(
        fits[0].quantile(CONFIDENCE_LEVEL) ** 2 * fits[0].noise.variance
    )
    for fit in fits[1:]:
        if np.sum(fit.residuals**2) < highest_square and all(_differ(fit, optimum) for optimum in optima):
            optima.append(fit)
    return optima


def _differ(fit: Fit, optimum: Fit) -> bool:
    size = np.maximum(np.maximum(np.abs(fit.values), np.abs(optimum.values)), OPTIMA_APART * fit.scale)
    return bool((np.abs(fit.values - optimum.values) > OPTIMA_APART * size).any())


def _reweight(problem: FitProblem, optima: Sequence[Fit]) -> tuple[FitProblem, Fit, Sequence[Fit]]:
    """Return the problem with the weights that residuals give, its estimates, and its other optima."""
    fit, *other_optima = optima
    for iteration in range(MOST_REWEIGHTINGS):
        residuals = standardised_residuals(fit) / problem.scale
        better = [
            None if iteration and block.settled is None else block.reweight(residuals[rows], robust=problem.robust)
            for block, rows in zip(problem.blocks, problem.rows, strict=True)
        ]
        if not any(better):
            break
        before, problem = problem, problem.with_blocks(better)
        if problem.has_same_optimum(before):
            return problem, fit, other_optima
        fit, other_optima = refit(before, problem, fit), []
    return problem, fit, other_optima


def _allow(solution: FitSolution) -> FitSolution:
    """Return the solution with standard errors that allow for all errors of the measurements."""
    for k in range(len(solution.problem.blocks)):
        block, fitted = solution.fitted_blocks[k]
        solution = replace(solution, fit=block.allowing(fitted))
    return solution


def _check_result(solution: FitSolution) -> FitSolution:
    """Return a solution; raise a FitError if it leaves most of a motion, or has most unknowns at bounds."""
    most_unexplained = solution.problem.most_unexplained
    refusing = solution.fitted_blocks if most_unexplained < 1.0 else []
    unexplained_shares = [share for block, fitted in refusing for share in block.unexplained_shares(fitted)]
    unexplained = [f"{name} ({share:.0%})" for name, share in unexplained_shares if share**2 > most_unexplained]
    at_bound = [unknown.report[0] for unknown in solution.fit.unknowns if unknown.name in solution.fit.at_bound]
    count = len(solution.fit.names)
    if unexplained:
        cause = next((f"; {block.possible_cause}" for block, _ in refusing if block.possible_cause), "")
        raise FitError(
            f"the fit leaves more than half of the motion of {', '.join(unexplained)} unexplained; check units, times "
            f"or phases, and the range of the record, or {FIT_ADVICE}{cause}"
        )
    if 2 * len(at_bound) > count > 1:
        raise FitError(
            f"{len(at_bound)} of {count} unknowns end at their bounds ({', '.join(at_bound)}): the records contradict "
            f"the model; {FIT_ADVICE}"
        )
    return solution
