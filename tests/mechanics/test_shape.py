import numpy as np
import pytest

from ancf_casadi.mechanics.strain import gauss, hermite, hermite_curvature, hermite_slope

LENGTH = 0.3
XI = np.linspace(0.0, 1.0, 7)


def test_any_cubic_and_its_derivatives_are_reproduced_exactly():
    cubic = np.polynomial.Polynomial([0.7, -1.3, 2.1, -4.2])
    slope, curvature = cubic.deriv(), cubic.deriv(2)
    nodal = cubic(0.0), slope(0.0), cubic(LENGTH), slope(LENGTH)
    for xi in XI:
        assert np.dot(hermite(xi, LENGTH), nodal) == pytest.approx(cubic(xi * LENGTH), abs=1e-14)
        assert np.dot(hermite_slope(xi, LENGTH), nodal) == pytest.approx(slope(xi * LENGTH), abs=1e-13)
        assert np.dot(hermite_curvature(xi, LENGTH), nodal) == pytest.approx(curvature(xi * LENGTH), abs=1e-12)


@pytest.mark.parametrize("points", range(1, 10))
def test_a_gauss_rule_is_exact_to_degree_2n_minus_1_and_no_further(points):
    nodes, weights = gauss(points)
    errors = [abs(weights @ nodes**degree - 1 / (degree + 1)) for degree in range(2 * points + 1)]
    assert max(errors[:-1]) < 1e-15
    assert errors[-1] > 1e-12
