"""Estimation from any mix of measurements: one loop over blocks of residuals.

With the residuals r_b of the blocks b (``block``), in standard deviations, and the distances p of some unknowns from
their priors in standard deviations, (x - x_0)/s or log(x/x_0)/s (``Unknown.prior_residual``), a fit minimises

    1/2 sum_b |G r_b|^2 + 1/2 sum (G p)^2,    log G = sum m_b log G_b / sum m_b.

The common factor G, the geometric mean of all standard deviations that the blocks found in their data, keeps the
likelihood of the normal distribution, so that fits of several laws can be compared by their sums of squares.

The residuals that give better weights are divided by (1 - h)^1/2, with the leverage h, the part of the noise at a
residual that the fit absorbs.  A few points that determine many unknowns would otherwise seem too certain.

The steps are: check that the data determine the unknowns (``determination``); fit; fit again with the weights that the
residuals give, for some blocks until these settle; compute the error of each block's discretisation, and the shifts of
the estimates that it causes; if one is above ``LARGEST_SHIFT`` standard errors, refine the block, and fit again from
the estimates; allow for errors of the measurements that residuals need not show.  An error of the derivatives shifts
the estimates too; its size follows from the change of the Jacobian since the coarser fit.  Once this change is small,
finer blocks keep the Jacobian, which costs more than the residuals.  Shifts whose size alone is known count once in
this criterion, and ``DOUBTS`` times in what the fit states.

The error of the mesh of a beam is computed once, at the estimates, when it is asked for (``FitSolution.mesh_shifts``).
The residuals r(l) for elements of the length l differ from r(0) by c l^4, so that 16/15 of the way to the estimates for
l/2 lead to those without the error.

If an optimum need not be the only one, the fit starts from several points, and the result has all optima that fit as
well as the best one within the 95 % level.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import MESH_REMAINDER, Block, Fitted
from ancf_casadi.estimation.determination import check_determination
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.solver.gauss_newton import HUBER
from ancf_casadi.estimation.solver.least_squares import least_squares, residual_function
from ancf_casadi.estimation.solver.unknown import Unknown, with_guesses
from ancf_casadi.exceptions import AncfError, FitError
from ancf_casadi.support.arrays import Array, Mask

LARGEST_SHIFT = 0.1  # typical shift of an estimate by the error of the discretisation, beyond which it is refined
KEPT_TURN = LARGEST_SHIFT / 5  # typical shift by the change of the Jacobian, below which finer blocks keep this one
DOUBTS = 2.0  # shift of unknown direction that a fit states, over its root mean square
MOST_REFINEMENTS = 6  # of a block
MOST_REWEIGHTINGS = 5  # of a block whose weights need to settle
CHANGED_WEIGHTS = 0.05  # relative change by a refinement (test_the_noise_is_that_at_the_last_tolerance)
LEAST_SHARE = 0.01  # least share 1 - h of the noise that a residual may show
OPTIMA_APART = 0.05  # relative difference of unknowns that belong to different optima
MOST_MESH_STEPS = 3  # to the estimates on a finer mesh
MOST_MESH_REMAINDER = 2.0  # sum of squares that a finer mesh may leave, relative to that of the fit
FIT_ADVICE = "start from other guesses, set bounds, or fix some unknowns"


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Blocks and unknowns of a fit."""

    blocks: tuple[Block, ...]
    unknowns: tuple[Unknown, ...]  # with their guesses
    robust: bool = False  # use the pseudo-Huber loss
    most_unexplained: float = 0.5  # share of the mean square of a motion, beyond which a fit is no result
    advice: str = FIT_ADVICE  # for the error message if there is no solution

    @property
    def closed_form(self) -> bool:
        """True if all blocks have residuals in closed form."""
        return all(block.closed_form for block in self.blocks)

    @property
    def series(self) -> list[int]:
        """Lengths of the series of residuals; priors are single values."""
        return [*(length for block in self.blocks for length in block.series), *[1] * len(self._priors)]

    @property
    def times(self) -> Array:
        """Times of the residuals."""
        return np.concatenate([*(block.times for block in self.blocks), np.zeros(len(self._priors))])

    @property
    def rows(self) -> list[slice]:
        """Residuals of each block among all."""
        return [slice(*ends) for ends in pairwise([0, *np.cumsum(self._sizes).tolist()])]

    @property
    def masks(self) -> list[Mask]:
        """Residuals of each record of each block among all."""
        sizes = [sum(record) for block in self.blocks for record in block.lengths]
        owners = np.repeat(np.arange(len(sizes) + 1), [*sizes, len(self._priors)])
        return [owners == k for k in range(len(sizes))]

    @property
    def scale(self) -> float:
        """The geometric mean G of the standard deviations."""
        sizes = [0 if block.prior else size for block, size in zip(self.blocks, self._sizes, strict=True)]
        return math.exp(float(np.dot(sizes, np.log([block.scale for block in self.blocks]))) / sum(sizes))

    def root_mean_square(self, sizes: Sequence[float]) -> float:
        """Return the root mean square of all residuals from that of each block."""
        return math.sqrt(float(np.dot(self._sizes, np.square(sizes))) / sum(self._sizes))

    def residuals(self, *values: cs.MX) -> cs.MX:
        """Return all residuals for the unknowns, in their order."""
        values_by_name = dict(zip((unknown.name for unknown in self.unknowns), values, strict=True))
        blocks_and_priors = [block.residuals(values_by_name) for block in self.blocks]
        blocks_and_priors += [unknown.prior_residual(values_by_name[unknown.name]) for unknown in self._priors]
        return self.scale * cs.vertcat(*blocks_and_priors)

    @property
    def factors(self) -> Array:
        """Residuals (m,) of the fit for residuals of 1 in the units of their series."""
        return self.scale * np.concatenate([*(block.factors for block in self.blocks), np.ones(len(self._priors))])

    def fit(self, *, check: bool, jacobian: Array | None = None) -> Fit:
        """Return the estimates for the weights of the blocks; ``check`` says whether the data must determine them.

        ``jacobian`` (m, n) is that of the residuals near the guesses, if it is known.
        """
        try:
            # fewer residuals are refused below, and so are those in closed form that rounding alone makes depend
            if check and not self.closed_form and sum(self.series) >= len(self.unknowns):
                self._check_determination()
            return self._minimum(jacobian)
        except FitError as error:
            reasons = [block.failure for block in self.blocks if block.failure]
            raise FitError("; ".join([str(error), *reasons[:1]]), error.stats) from None

    def _minimum(self, jacobian: Array | None) -> Fit:
        scale = self.scale
        return least_squares(
            self.residuals,
            self.unknowns,
            huber=HUBER * scale if self.robust else math.inf,
            closed_form=self.closed_form,
            series=self.series,
            times=self.times,
            inaccuracy=scale * math.hypot(*(block.inaccuracy for block in self.blocks)),
            systematic=scale * self.root_mean_square([block.systematic for block in self.blocks]),
            stated=np.repeat([*(block.stated for block in self.blocks), True], [*self._sizes, len(self._priors)]),
            deviation=scale,
            jacobian=jacobian,
            advice=self.advice,
        )

    def _check_determination(self) -> None:
        """Refuse unknowns of which the data determine combinations only."""
        negligible = self.scale * math.hypot(*(block.negligible for block in self.blocks))
        try:
            check_determination(self.residuals, self.unknowns, negligible)
        except FitError:
            accurate = replace(self, blocks=tuple(block.accurate for block in self.blocks))
            if accurate.blocks == self.blocks:
                raise
            accurate._check_determination()

    def has_same_optimum(self, other: FitProblem) -> bool:
        """Return whether the same unknowns are optimal under other weights: if they differ by a common factor alone."""
        exact = not any(block.inaccuracy for block in self.blocks)
        return exact and not self.robust and np.allclose(self.factors, other.factors, rtol=1e-9)

    def with_blocks(self, changed: Sequence[Block | None]) -> FitProblem:
        """Return the problem with blocks that have become better or finer in their places."""
        return replace(self, blocks=tuple(new or old for new, old in zip(changed, self.blocks, strict=True)))

    def close(self) -> None:
        """Forget what the blocks no longer need once the fit has ended."""
        for block in self.blocks:
            block.close()

    @property
    def _sizes(self) -> list[int]:
        return [sum(block.series) for block in self.blocks]

    @property
    def _priors(self) -> list[Unknown]:
        return [unknown for unknown in self.unknowns if unknown.prior]


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
            return _check_result(_allow(_refine(problem, fit, other_optima)))
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
        fit, other_optima = _refit(before, problem, fit), []
    return problem, fit, other_optima


def standardised_residuals(fit: Fit) -> Array:
    """Return the residuals (m,) over (1 - h)^1/2, with the leverage h: as large as the noise in them."""
    leverage = np.sum(fit.free_basis[0] ** 2, axis=1)
    return np.asarray(fit.residuals / np.sqrt(np.maximum(1 - leverage, LEAST_SHARE)))


def _shifts(
    problem: FitProblem, fit: Fit, block: Block, rows: slice, turn: Array, error: Array, doubts: float = 1.0
) -> Array:
    """Return the shifts (n,) of the estimates by the error of the residuals of a block, in standard errors.

    Those of known direction add to ``doubts`` times the root mean square of others, which include ``turn``.
    """
    change, doubt = np.zeros((2, len(fit.residuals)))
    change[rows], doubt[rows] = problem.scale * error, problem.scale * block.doubt(error)
    shifts = fit.shifts(change) + (fit.remaining if block.inaccuracy else 0.0)
    return shifts + np.copysign(doubts * np.hypot(fit.scatter(doubt), turn if block.inaccuracy else 0.0), shifts)


def _is_small(shift_by: Callable[[Array], Array], error: Array) -> bool:
    """Return whether an error shifts no estimate by much."""
    return bool(np.abs(shift_by(error)).max() <= LARGEST_SHIFT)


def _turn(fit: Fit, coarser: Array) -> Array:
    """Return the typical shifts (n,) by the change of the Jacobian from a coarser one (m, n), in standard errors.

    At the minimum J' r = 0.  A change of J by D shifts the estimates by (J' J)^-1 D' r, where r is mostly noise, but
    orthogonal to J: a part J A of D shifts nothing.
    """
    free = ~fit.active_bounds
    change = (fit.jacobian - coarser)[:, free] * fit.scale[free]
    basis, triangle = fit.free_basis
    normal, inverse = change - basis @ (basis.T @ change), np.linalg.inv(triangle.T @ triangle)
    sizes = np.zeros(len(fit.names))
    sizes[free] = np.linalg.norm(normal @ inverse, axis=0) / np.sqrt(np.diag(inverse))
    return sizes


def _refine(problem: FitProblem, fit: Fit, other_optima: Sequence[Fit]) -> FitSolution:
    """Return the solution with blocks so fine that their errors shift no estimate by much."""
    turn, compared = np.zeros(len(fit.names)), False
    for _ in range(MOST_REFINEMENTS + 1):
        shifts = np.zeros((len(problem.blocks), len(fit.names)))
        finer: list[Block | None] = []
        for block_shifts, block, rows in zip(shifts, problem.blocks, problem.rows, strict=True):
            shift_by = partial(_shifts, problem, fit, block, rows)
            small = partial(_is_small, partial(shift_by, np.zeros(len(fit.names))))
            error = block.error(fit.estimates, fit.residuals[rows] / problem.scale, small)
            if not (error.any() or block.inaccuracy or block.doubt(error)):
                finer.append(None)
                continue
            block_shifts[:] = shift_by(turn, error, doubts=DOUBTS)
            shift = np.max(meaningful(shift_by(turn, error), fit, block.meaningful))
            better = block.refine(float(shift), error)
            if better and math.isfinite(shift):
                noise = standardised_residuals(fit)[rows] / problem.scale
                better = better.reweight(noise + error, robust=problem.robust) or better
            finer.append(better)
        if not any(finer):
            changed = _changed_weights(problem, fit)
            if not any(changed):
                break
            before, problem = problem, problem.with_blocks(changed)
            fit = _refit(before, problem, fit, keep=True)
            continue
        coarse = [block for block, better in zip(problem.blocks, finer, strict=True) if better]
        keep = compared and turn.max() <= KEPT_TURN and all(block.inaccuracy for block in coarse)
        before, problem = problem, problem.with_blocks(finer)
        coarser = _reweighted_jacobian(before, problem, fit)
        fit = _refit(before, problem, fit, keep=keep)
        if not keep:
            turn, compared = _turn(fit, coarser), True
        for block in coarse:
            block.close()
    return FitSolution(problem, fit, shifts, tuple(other_optima))


def _changed_weights(problem: FitProblem, fit: Fit) -> list[Block | None]:
    """Return the refined blocks with the weights that residuals give, where the errors of coarser ones were noise."""
    if not any(block.inaccuracy for block in problem.blocks):
        return []
    noise = standardised_residuals(fit) / problem.scale
    changed: list[Block | None] = []
    for block, rows in zip(problem.blocks, problem.rows, strict=True):
        better = block.reweight(noise[rows], robust=problem.robust) if block.inaccuracy else None
        changed.append(better if better and not block.has_similar_weights(better, CHANGED_WEIGHTS) else None)
    return changed


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
        raise FitError(
            f"the fit leaves more than half of the motion of {', '.join(unexplained)} unexplained; check the unit of "
            f"the levels, the phases, and the range of the record, or {FIT_ADVICE}"
        )
    if 2 * len(at_bound) > count > 1:
        raise FitError(
            f"{len(at_bound)} of {count} unknowns end at their bounds ({', '.join(at_bound)}): the records contradict "
            f"the model; {FIT_ADVICE}"
        )
    return solution


def meaningful(shifts: Array, fit: Fit, least_relative: float) -> Array:
    """Return the sizes (n,) of shifts, in standard errors; 0 where below a part ``least_relative`` of the estimate."""
    sizes = np.abs(shifts)
    return np.where(sizes * fit.errors <= least_relative * np.abs(fit.values), 0.0, sizes)


def _refit(before: FitProblem, problem: FitProblem, fit: Fit, *, keep: bool = False) -> Fit:
    """Return the estimates of a problem whose blocks have changed, from those of the fit before.

    ``keep`` says whether the steps begin with the Jacobian of this fit.
    """
    started = replace(problem, unknowns=tuple(with_guesses(problem.unknowns, fit.estimates)))
    again = started.fit(check=False, jacobian=_reweighted_jacobian(before, problem, fit) if keep else None)
    iterations, seconds = fit.iterations + again.iterations, fit.solve_seconds + again.solve_seconds
    return replace(again, iterations=iterations, solve_seconds=seconds)


def _reweighted_jacobian(before: FitProblem, problem: FitProblem, fit: Fit) -> Array:
    """Return the Jacobian (m, n) of a fit under the weights of another problem."""
    return np.asarray(fit.jacobian * (problem.factors / before.factors)[:, None])
