"""Refinement of a block: the shifts of the estimates that a fit states."""

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import Account, Block, SeriesWeights
from ancf_casadi.estimation.solve import FitProblem, solve
from ancf_casadi.estimation.solver.unknown import Unknown


@dataclass(frozen=True, eq=False, kw_only=True)
class Lines(Block):
    """Two series with the slope x, exact on each of the finer versions that a fit asks for."""

    values: np.ndarray  # (2, m)
    weights: SeriesWeights
    is_fine: bool = False

    lengths = property(lambda self: [[self.values.shape[1]] * 2])
    negligible = 0.0
    inaccuracy = 1e-9

    def residuals(self, unknowns):
        places = np.arange(self.values.shape[1])
        pairs = zip(self.values, self.weights.deviations.tolist(), strict=True)
        return cs.vertcat(*((unknowns["x"] * places - cs.DM(y)) / deviation for y, deviation in pairs))

    def refined(self, shift, error):
        return None if self.is_fine else replace(self, is_fine=True)

    def account(self, fitted):
        return Account()

    def channels(self, fitted):
        return []


def test_other_weights_are_no_error_of_the_derivatives():
    noise = np.random.default_rng(0).normal(size=(2, 200)) * [[1.0], [30.0]]
    weights = SeriesWeights(
        np.array([200, 200]), np.array([1.0, 3.0]), np.full(2, 1e-9), groups=((0,), (1,)), known=(False, False)
    )
    lines = Lines(values=0.5 * np.arange(200) + noise, weights=weights)
    solution = solve(FitProblem((lines,), (Unknown("x", 0.4),)))
    (block,) = solution.problem.blocks
    assert block.is_fine
    assert block.weights.deviations[1] > 20.0
    assert np.abs(solution.shifts).max() < 1e-6
