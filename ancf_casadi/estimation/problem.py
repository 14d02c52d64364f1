"""The problem of a fit, its blocks of residuals and its unknowns, and its solution, also after blocks have changed.

With the residuals r_b of the blocks b (``block``), in standard deviations, and the distances p of some unknowns from
their priors in standard deviations, (x - x_0)/s or log(x/x_0)/s (``Unknown.prior_residual``), a fit minimises

    1/2 sum_b |G r_b|^2 + 1/2 sum (G p)^2,    log G = sum m_b log G_b / sum m_b.

The common factor G, the geometric mean of all standard deviations that the blocks have estimated, keeps the
likelihood of the normal distribution, so that fits of several laws can be compared by their sums of squares.

The residuals that give better weights are divided by (1 - h)^1/2, with the leverage h, the part of the noise at a
residual that the fit absorbs.  A few points that determine many unknowns would otherwise seem too certain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import Block
from ancf_casadi.estimation.determination import check_determination
from ancf_casadi.estimation.fit import Fit, SolverSettings
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.solver.gauss_newton import HUBER
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown, with_guesses
from ancf_casadi.exceptions import FitError
from ancf_casadi.support.arrays import Array, Mask

LEAST_SHARE = 0.01  # least share 1 - h of the noise that a residual may show
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

    @property
    def negligible(self) -> float:
        """Norm of a change of all residuals that the computation does not tell from none."""
        return self.scale * math.hypot(*(block.negligible for block in self.blocks))

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
        """Return the fit under the weights of the blocks; ``check`` says whether to check that the data determine it.

        ``jacobian`` (m, n) is that of the residuals near the guesses, if it is known.
        """
        try:
            # too few residuals are refused below, as are unknowns of a closed form that are dependent up to rounding
            if check and not self.closed_form and sum(self.series) >= len(self.unknowns):
                self._check_determination()
            return self._minimum(jacobian)
        except FitError as error:
            reason = next((block.failure for block in self.blocks if block.failure), "")
            cause = next((block.possible_cause for block in self.blocks if block.possible_cause), "")
            raise FitError("; ".join(filter(None, [str(error), reason, cause])), error.stats) from None

    def _minimum(self, jacobian: Array | None) -> Fit:
        scale = self.scale
        return least_squares(
            self.residuals,
            self.unknowns,
            huber=HUBER * scale if self.robust else math.inf,
            systematic=scale * self.root_mean_square([block.systematic for block in self.blocks]),
            noise=AssumedNoise(
                series=self.series,
                times=self.times,
                stated=np.repeat([*(block.stated for block in self.blocks), True], [*self._sizes, len(self._priors)]),
                deviation=scale,
            ),
            settings=SolverSettings(
                closed_form=self.closed_form,
                inaccuracy=scale * math.hypot(*(block.inaccuracy for block in self.blocks)),
                advice=self.advice,
            ),
            jacobian=jacobian,
        )

    def _check_determination(self) -> None:
        """Refuse unknowns of which the data determine only combinations."""
        try:
            check_determination(self.residuals, self.unknowns, self.negligible)
        except FitError:
            accurate = replace(self, blocks=tuple(block.accurate for block in self.blocks))
            if accurate.blocks == self.blocks:
                raise
            accurate._check_determination()

    def has_same_optimum(self, other: FitProblem) -> bool:
        """Return whether another problem has the same optimum: its weights differ only by a common factor."""
        exact = not any(block.inaccuracy for block in self.blocks)
        return exact and not self.robust and np.allclose(self.factors, other.factors, rtol=1e-9)

    def with_blocks(self, changed: Sequence[Block | None]) -> FitProblem:
        """Return the problem with changed blocks in place of the old ones; None keeps a block."""
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


def standardised_residuals(fit: Fit) -> Array:
    """Return the residuals (m,) over (1 - h)^1/2, with the leverage h: as large as the noise in them."""
    leverage = np.sum(fit.free_basis[0] ** 2, axis=1)
    return np.asarray(fit.residuals / np.sqrt(np.maximum(1 - leverage, LEAST_SHARE)))


def refit(before: FitProblem, problem: FitProblem, fit: Fit, *, keep: bool = False) -> Fit:
    """Return the fit of a problem whose blocks have changed, started at the estimates of the fit before.

    ``keep`` says whether the first step uses the Jacobian of the fit before.
    """
    started = replace(problem, unknowns=tuple(with_guesses(problem.unknowns, fit.estimates)))
    again = started.fit(check=False, jacobian=reweighted_jacobian(before, problem, fit) if keep else None)
    iterations, seconds = fit.iterations + again.iterations, fit.solve_seconds + again.solve_seconds
    return replace(again, iterations=iterations, solve_seconds=seconds)


def reweighted_jacobian(before: FitProblem, problem: FitProblem, fit: Fit) -> Array:
    """Return the Jacobian (m, n) of a fit under the weights of another problem."""
    return np.asarray(fit.jacobian * (problem.factors / before.factors)[:, None])
