import casadi as cs
import numpy as np
import pytest

from ancf_casadi.mechanics.strain import gauss, hermite, hermite_curvature, hermite_slope

LENGTH = 0.3
XI = np.linspace(0.0, 1.0, 7)


@pytest.mark.parametrize(
    ("xi", "values", "slopes"),
    [(0.0, (1, 0, 0, 0), (0, 1, 0, 0)), (1.0, (0, 0, 1, 0), (0, 0, 0, 1))],
)
def test_each_function_is_one_in_its_own_nodal_quantity_and_zero_in_the_others(xi, values, slopes):
    np.testing.assert_allclose(hermite(xi, LENGTH), values, atol=1e-15)
    np.testing.assert_allclose(hermite_slope(xi, LENGTH), slopes, atol=1e-14)


def test_any_cubic_and_its_derivatives_are_reproduced_exactly():
    cubic = np.polynomial.Polynomial([0.7, -1.3, 2.1, -4.2])
    slope, curvature = cubic.deriv(), cubic.deriv(2)
    nodal = cubic(0.0), slope(0.0), cubic(LENGTH), slope(LENGTH)
    for xi in XI:
        assert np.dot(hermite(xi, LENGTH), nodal) == pytest.approx(cubic(xi * LENGTH), abs=1e-14)
        assert np.dot(hermite_slope(xi, LENGTH), nodal) == pytest.approx(slope(xi * LENGTH), abs=1e-13)
        assert np.dot(hermite_curvature(xi, LENGTH), nodal) == pytest.approx(curvature(xi * LENGTH), abs=1e-12)


def test_slopes_and_curvatures_are_the_symbolic_derivatives_of_the_functions():
    p = cs.SX.sym("p")
    values = cs.vertcat(*hermite(p / LENGTH, LENGTH))
    slopes = cs.jacobian(values, p)
    derivatives = cs.Function("derivatives", [p], [slopes, cs.jacobian(slopes, p)])
    for xi in XI:
        slope, curvature = derivatives(xi * LENGTH)
        np.testing.assert_allclose(slope.full().ravel(), hermite_slope(xi, LENGTH), atol=1e-13)
        np.testing.assert_allclose(curvature.full().ravel(), hermite_curvature(xi, LENGTH), atol=1e-12)


@pytest.mark.parametrize("points", range(1, 10))
def test_a_gauss_rule_is_exact_to_degree_2n_minus_1_and_no_further(points):
    nodes, weights = gauss(points)
    errors = [abs(weights @ nodes**degree - 1 / (degree + 1)) for degree in range(2 * points + 1)]
    assert max(errors[:-1]) < 1e-15
    assert errors[-1] > 1e-12


def test_gauss_nodes_lie_inside_the_interval_and_the_weights_are_positive():
    nodes, weights = gauss(5)
    assert (nodes > 0.0).all() and (nodes < 1.0).all()
    assert (weights > 0.0).all()
