"""The drawings of the paper: their vectors and deflections are computed."""

import numpy as np
import pytest

from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from problems.paper.figure_01 import ENDS, SLOPES, centre_line
from problems.paper.figure_11 import deflections


def test_the_drawn_centre_line_has_the_drawn_ends_and_slopes():
    ends, step = centre_line(np.array([0.0, 1.0])), 1e-6
    np.testing.assert_allclose(ends, ENDS)
    first, second, *_ = centre_line(np.array([0.0, step]))
    np.testing.assert_allclose((second - first) / (4.0 * step), SLOPES[0], rtol=1e-4)
    before, last = centre_line(np.array([1.0 - step, 1.0]))
    np.testing.assert_allclose((last - before) / (4.0 * step), SLOPES[1], rtol=1e-4)


@pytest.mark.parametrize("axis", [(0.0, -1.0), (0.8, 0.6)])
def test_a_uniform_load_deflects_the_beam_as_in_eq_21(paper_beam, axis):
    places, bent, _ = deflections(paper_beam(8, axis=axis))
    np.testing.assert_allclose(bent, ASSUMED_SHAPE(places), atol=1e-5)


def test_mode_1_is_that_of_a_cantilever(paper_beam):
    """cosh x - cos x - sigma (sinh x - sin x), x = 1.8751 s/L; 1.5 % from Eq. (21) at most."""
    (places, _, mode), root = deflections(paper_beam(12)), 1.875104068711961
    x = root * places
    sigma = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
    exact = np.cosh(x) - np.cos(x) - sigma * (np.sinh(x) - np.sin(x))
    np.testing.assert_allclose(mode, exact / exact[-1], atol=1e-5)
    assert abs(mode - ASSUMED_SHAPE(places)).max() == pytest.approx(0.0147, abs=2e-4)
