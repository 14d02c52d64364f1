"""Refinement of a block: the shifts of the estimates that a fit states."""

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.estimation.block import Account, Block, SeriesWeights
from ancf_casadi.estimation.solve import FitProblem, solve
from ancf_casadi.estimation.solver.unknown import Unknown


@dataclass(frozen=True, eq=False, kw_only=True)
class Lines(Block):
    """Two series with the slope x; a coarse version, which a fit refines, has an error in the second one."""

    values: np.ndarray  # (2, m)
    weights: SeriesWeights
    coarse_error: np.ndarray  # (m,)
    is_fine: bool = False

    lengths = property(lambda self: [[self.values.shape[1]] * 2])
    negligible = 0.0
    inaccuracy = 1e-9

    def residuals(self, unknowns):
        places = np.arange(self.values.shape[1])
        first, second = self.values
        measured = first, second + (0.0 if self.is_fine else self.coarse_error)
        pairs = zip(measured, self.weights.deviations.tolist(), strict=True)
        return cs.vertcat(*((unknowns["x"] * places - cs.DM(y)) / deviation for y, deviation in pairs))

    def refine(self, shift, error):
        return None if self.is_fine else replace(self, is_fine=True)

    def account(self, fitted):
        return Account()

    def channels(self, fitted):
        return []


def fitted(coarse_error, noise):
    weights = SeriesWeights(
        np.array([200, 200]), np.array([1.0, 3.0]), np.full(2, 1e-9), groups=((0,), (1,)), known=(False, False)
    )
    lines = Lines(values=0.5 * np.arange(200) + noise, weights=weights, coarse_error=coarse_error)
    return solve(FitProblem((lines,), (Unknown("x", 0.4),)))


def test_other_weights_are_no_error_of_the_derivatives():
    solution = fitted(np.zeros(200), np.random.default_rng(0).normal(size=(2, 200)) * [[1.0], [30.0]])
    (block,) = solution.problem.blocks
    assert block.is_fine
    assert block.weights.deviations[1] > 20.0
    assert np.abs(solution.shifts).max() < 1e-6


def test_the_noise_is_that_at_the_last_tolerance():
    """Not that of the coarse version, whose error of 3 is three times the noise."""
    random = np.random.default_rng(0)
    solution = fitted(3.0 * random.choice([-1.0, 1.0], size=200), random.normal(size=(2, 200)))
    (block,) = solution.problem.blocks
    assert block.weights.deviations == pytest.approx([1.0, 1.0], rel=0.1)
