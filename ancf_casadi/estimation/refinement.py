"""Refinement of a fit: refine the blocks until their discretisation errors shift no estimate by much.

The error of a block's discretisation shifts the estimates.  If the shift of one of them is typically above
``LARGEST_SHIFT`` standard errors, the block is refined, and the fit goes on from the estimates.  An error of the
derivatives shifts the estimates too; its size follows from the change of the Jacobian since the coarser fit.  Once this
shift is small, finer blocks keep the Jacobian, which costs more than the residuals.

A shift has a part s of known direction, and parts of which the root mean squares d_k alone are known.  Its root mean
square, (s^2 + sum d_k^2)^1/2, decides on the refinement.  The fit states |s| + ((margin s)^2 + sum (DOUBTS d_k)^2)^1/2,
where the largest error is (1 + margin) times the expected one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ancf_casadi.estimation.block import Block
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.problem import FitProblem, refit, reweighted_jacobian, standardised_residuals
from ancf_casadi.support.arrays import Array

LARGEST_SHIFT = 0.1  # typical shift of an estimate by the error of the discretisation, above which a block is refined
KEPT_TURN = LARGEST_SHIFT / 2  # typical shift by the error of the Jacobian, below which finer blocks keep it
DOUBTS = 2.0  # shift of unknown direction that a fit states, over its root mean square
MOST_REFINEMENTS = 6  # of a block
CHANGED_WEIGHTS = 0.05  # relative change by a refinement (test_the_noise_is_that_at_the_last_tolerance)


def refine(problem: FitProblem, fit: Fit) -> tuple[FitProblem, Fit, Array]:
    """Return the problem with fine enough blocks, its fit, and the shifts (b, n) by the error of each of the b blocks.

    The shifts are those of the n estimates in standard errors; nan if unknown.
    """
    stage = Stage(problem, fit)
    for _ in range(MOST_REFINEMENTS + 1):
        blocks = zip(stage.problem.blocks, stage.problem.rows, strict=True)
        shifts, finer = zip(*(stage.check(block, rows) for block, rows in blocks), strict=True)
        if any(finer):
            stage = stage.refined(finer)
        elif any(changed := stage.changed_weights()):
            stage = stage.reweighted(changed)
        else:
            break
    return stage.problem, stage.fit, np.array(shifts)


@dataclass(frozen=True, eq=False)
class Stage:
    """A fit at one stage of the refinement of its blocks."""

    problem: FitProblem
    fit: Fit
    turn: Array | None = None  # typical shifts (n,) by the error of the Jacobian; None without a coarser one

    def check(self, block: Block, rows: slice) -> tuple[Array, Block | None]:
        """Return the shifts (n,) that the fit states for the error of a block, and a finer block; None if fine enough.

        The ``rows`` are the residuals of the block.
        """
        fit, scale = self.fit, self.problem.scale
        error = block.error(fit.estimates, fit.residuals[rows] / scale, partial(self._is_small, block, rows))
        if not (error.any() or block.inaccuracy or block.doubt(error)):
            return np.zeros(len(fit.names)), None
        known, scatter = self._shifts(block, rows, error)
        turn = np.zeros(len(fit.names)) if self.turn is None or not block.inaccuracy else self.turn
        typical = meaningful(np.sqrt(known**2 + scatter**2 + turn**2), fit, block.meaningful)
        finer = block.refine(float(typical.max()), error)
        if finer and np.isfinite(typical).all():
            noise = standardised_residuals(fit)[rows] / scale
            finer = finer.reweight(noise + error, robust=self.problem.robust) or finer
        doubts = np.sqrt((block.margin(error) * known) ** 2 + DOUBTS**2 * (scatter**2 + turn**2))
        return known + np.copysign(doubts, known), finer

    def _is_small(self, block: Block, rows: slice, error: Array) -> bool:
        """Return whether an error of a block shifts no estimate by much, apart from an error of the Jacobian."""
        return bool(np.hypot(*self._shifts(block, rows, error)).max() <= LARGEST_SHIFT)

    def _shifts(self, block: Block, rows: slice, error: Array) -> tuple[Array, Array]:
        """Return the shifts (n,) of the estimates by the error of the residuals of a block, in standard errors.

        Also return the root mean squares (n,) of those by errors whose size alone is known.
        """
        fit, scale = self.fit, self.problem.scale
        change, doubt = np.zeros((2, len(fit.residuals)))
        change[rows], doubt[rows] = scale * error, scale * block.doubt(error)
        return fit.shifts(change) + (fit.remaining if block.inaccuracy else 0.0), fit.scatter(doubt)

    def refined(self, finer: Sequence[Block | None]) -> Stage:
        """Return the fit with finer blocks in the places of some; the coarse ones are closed."""
        coarse = [block for block, better in zip(self.problem.blocks, finer, strict=True) if better]
        settled = self.turn is not None and self.turn.max() <= KEPT_TURN
        keep = settled and all(block.inaccuracy for block in coarse)
        problem = self.problem.with_blocks(finer)
        fit = refit(self.problem, problem, self.fit, keep=keep)
        for block in coarse:
            block.close()
        if keep:
            return Stage(problem, fit, self.turn)
        turn = jacobian_turn(fit, reweighted_jacobian(self.problem, problem, self.fit))
        return Stage(problem, fit, max(block.jacobian_error for block in finer if block) * turn)

    def changed_weights(self) -> list[Block | None]:
        """Return blocks with weights by their present residuals, without errors of coarser ones; None if similar."""
        problem = self.problem
        if not any(block.inaccuracy for block in problem.blocks):
            return []
        noise = standardised_residuals(self.fit) / problem.scale
        changed: list[Block | None] = []
        for block, rows in zip(problem.blocks, problem.rows, strict=True):
            better = block.reweight(noise[rows], robust=problem.robust) if block.inaccuracy else None
            changed.append(better if better and not block.has_similar_weights(better, CHANGED_WEIGHTS) else None)
        return changed

    def reweighted(self, changed: Sequence[Block | None]) -> Stage:
        """Return the fit with other weights of some blocks."""
        problem = self.problem.with_blocks(changed)
        return Stage(problem, refit(self.problem, problem, self.fit, keep=True), self.turn)


def jacobian_turn(fit: Fit, coarser: Array) -> Array:
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


def meaningful(shifts: Array, fit: Fit, least_relative: float) -> Array:
    """Return the sizes (n,) of shifts, in standard errors; 0 below the fraction ``least_relative`` of the estimate."""
    sizes = np.abs(shifts)
    return np.where(sizes * fit.errors <= least_relative * np.abs(fit.values), 0.0, sizes)
