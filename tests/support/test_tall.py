import numpy as np
import pytest

from ancf_casadi.support.tall import inner, tall_qr, tall_times, tall_triangle


@pytest.mark.parametrize("rows", [40, 500, 5000])
def test_factors_of_a_tall_matrix_are_those_of_householder(rows):
    matrix = np.random.default_rng(22).normal(size=(rows, 12)) @ np.diag(10.0 ** np.arange(12))
    matrix[:, 3] = matrix[:, 2] + 1e-7 * matrix[:, 3] / 10.0
    q, triangle = tall_qr(matrix)
    np.testing.assert_allclose(q.T @ q, np.eye(12), atol=1e-13)
    np.testing.assert_allclose(q @ triangle, matrix, rtol=0.0, atol=1e-12 * np.abs(matrix).max())
    np.testing.assert_allclose(np.tril(triangle, -1), 0.0, atol=0.0)
    np.testing.assert_allclose(np.abs(tall_triangle(matrix)), np.abs(np.linalg.qr(matrix, mode="r")), rtol=1e-6)


@pytest.mark.parametrize("rows", [3, 768, 5000])
def test_products_of_tall_matrices_are_those_of_all_rows(rows):
    rng = np.random.default_rng(23)
    tall, other, small = rng.normal(size=(rows, 12)), rng.normal(size=(rows, 5)), rng.normal(size=(12, 5))
    np.testing.assert_allclose(tall_times(tall, small), tall @ small, atol=1e-12)
    np.testing.assert_allclose(tall_times(tall + 1j, small), (tall + 1j) @ small, atol=1e-12)
    np.testing.assert_allclose(inner(tall, other), tall.T @ other, atol=1e-10)
