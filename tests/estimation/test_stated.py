"""Residuals with stated standard deviations: coverage when these are right and wrong, alone and in a mix."""

import casadi as cs
import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import chi2

from ancf_casadi.estimation.fit import quantile
from ancf_casadi.estimation.noise.spectrum import estimated_noise
from ancf_casadi.estimation.noise.stated import CONTRADICTED, DOUBTED, AssumedNoise, stated_noise
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown


def half_width(square, freedom):
    """Return the half width of the 95 % interval of one unknown for a sum of squares, in stated deviations."""
    residuals, basis = np.zeros(freedom + 1), np.eye(freedom + 1)[:, :1]
    residuals[1:] = np.sqrt(square / freedom)
    noise = stated_noise(residuals, basis, 1.0)
    return quantile(0.95, noise.freedom) * np.sqrt(noise.form(basis)[0, 0])


def coverage(freedom, factor):
    """Return the coverage if the true standard deviation is a factor of the stated one, by quadrature."""
    squares = chi2.ppf((np.arange(400) + 0.5) / 400, freedom)
    halves = np.array([half_width(factor**2 * square, freedom) for square in squares])
    return np.mean(2 * ndtr(halves / factor) - 1)


@pytest.mark.parametrize(("freedom", "right", "small"), [(1, 0.959, 0.83), (2, 0.958, 0.87), (6, 0.957, 0.93)])
def test_stated_standard_deviations_are_known_until_residuals_contradict_them(freedom, right, small):
    """The larger one of stated and estimated deviation, with the quantile for 6 degrees, would cover in 99 %."""
    assert coverage(freedom, 1.0) == pytest.approx(right, abs=1.5e-3)
    assert coverage(freedom, 2.0) == pytest.approx(small, abs=5e-3)
    assert coverage(freedom, 0.5) > 0.999  # never less than stated


def test_the_width_of_intervals_is_continuous_between_the_stated_and_the_estimated_deviation():
    ends = chi2.isf([DOUBTED, CONTRADICTED], 4)
    for end in ends:
        assert half_width(0.9999 * end, 4) == pytest.approx(half_width(1.0001 * end, 4), rel=1e-3)
    assert half_width(ends[0], 4) == pytest.approx(1.959964)
    assert half_width(ends[1], 4) == pytest.approx(quantile(0.95, 4) * np.sqrt(ends[1] / 4))
    widths = [half_width(square, 4) for square in np.linspace(0.0, 2 * ends[1], 50)]
    assert (np.diff(widths) >= 0.0).all()


def test_in_a_mix_the_stated_residuals_alone_are_tested():
    """The probability is uniform if the statement is right, however much of them the other residuals determine."""
    rng, found, known = np.random.default_rng(0), [], np.arange(35) < 5
    x = np.concatenate([np.linspace(0.0, 1.0, 5), np.linspace(0.0, 4.0, 30)])
    basis = np.linalg.qr(np.column_stack([np.ones(35), x]))[0]
    for _ in range(2000):
        noise = 0.1 * rng.standard_normal(35)
        rest = noise - basis @ (basis.T @ noise)
        found.append(stated_noise(rest[known], basis[known], 0.1).p_value)
    assert np.mean(found) == pytest.approx(0.5, abs=0.025)  # 4 standard deviations
    assert np.mean(np.array(found) < 0.05) == pytest.approx(0.05, abs=0.02)


def test_in_a_mix_each_kind_of_residual_has_its_own_noise():
    """Values three times as inexact as stated widen the errors of what they determine, and only these."""
    rng = np.random.default_rng(3)
    noise = np.concatenate([3.0 * np.array([1.0, -1.0, 1.0, -1.0, 0.5, -0.5]), rng.standard_normal(40)])
    known = np.arange(46) < 6
    a, b = cs.DM(known.astype(float)), cs.DM((~known).astype(float))
    fits = [
        least_squares(
            lambda x, y, scale=scale: a * x + b * y - cs.DM(np.where(known, scale, 1.0) * noise),
            [Unknown("x", 0.0), Unknown("y", 0.0)],
            noise=AssumedNoise([1] * 6 + [40], stated=known),
        )
        for scale in (1 / 3, 1.0)
    ]
    right, wrong = fits
    assert right.standard_errors["x"] == pytest.approx(6**-0.5, rel=1e-9)
    assert wrong.standard_errors["x"] == pytest.approx(np.sqrt(9 * 4.5 / 5 / 6), rel=1e-9)
    own = noise[6:] - noise[6:].mean()
    alone = estimated_noise(own, np.full((40, 1), 40**-0.5), [40], None)
    for fit in fits:
        assert fit.standard_errors["y"] == pytest.approx(np.sqrt(alone.variance / 40), rel=1e-9)
    assert any("2.8 times the stated standard deviations" in note for note in wrong.warnings)
    assert not any("stated" in note for note in right.warnings)
