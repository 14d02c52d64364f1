"""Refinement of a block: the shifts of the estimates that a fit states."""

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.estimation.block import Account, Block, SeriesWeights
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.refinement import jacobian_turn
from ancf_casadi.estimation.solve import solve
from ancf_casadi.estimation.solver.least_squares import least_squares
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


def test_a_change_of_the_jacobian_shifts_the_estimates_by_its_part_normal_to_it():
    """Of many fits to noise, one Jacobian gives estimates that scatter about those of the other as stated."""
    random = np.random.default_rng(1)
    basis = np.stack([np.ones(300), np.linspace(0.0, 1.0, 300)], axis=1) @ [[1.0, 1.0], [0.0, 0.05]]  # nearly parallel
    change = 0.02 * random.normal(size=basis.shape)

    def residuals(a, b):
        return cs.DM(basis) @ cs.vertcat(a, b) - cs.DM(basis.sum(axis=1) + random.normal(size=300))

    fit = least_squares(residuals, [Unknown("a", 1.0), Unknown("b", 1.0)])
    combined = basis @ np.array([[1.1, 0.3], [-0.2, 0.9]])
    assert jacobian_turn(fit, combined).max() < 1e-9
    noise = random.normal(size=(300, 2000))
    noise -= basis @ np.linalg.lstsq(basis, noise)[0]
    other = basis - change
    shifts = np.linalg.solve(other.T @ basis, other.T @ noise)  # of the roots of (J - D)' r = 0
    errors = np.sqrt(np.diag(np.linalg.inv(basis.T @ basis)))
    assert jacobian_turn(fit, other) == pytest.approx(shifts.std(axis=1) / errors, rel=0.1)
