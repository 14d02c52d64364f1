"""Factors and products of matrices with many more rows than columns, in blocks of rows.

BLAS divides a large operation among threads, which wait for each other if other work keeps a core busy.  In the
factorisation of a tall matrix, this happens for every column.  The blocks are so small that each stays in one thread
and in the cache.

The triangle R of the QR factors is that of the stacked triangles of the blocks (TSQR).  Q = A R^-1 with one step of
iterative refinement is nearly orthonormal, and a Cholesky factor of Q' Q makes it orthonormal.

References
----------
J. Demmel, L. Grigori, M. Hoemmen, J. Langou, Communication-optimal parallel and sequential QR and LU factorizations,
SIAM Journal on Scientific Computing 34 (2012).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ancf_casadi.support.arrays import Array

MAX_PRODUCTS = 2**17  # multiplications of real matrices that OpenBLAS leaves to one thread, A' A included
MAX_ENTRIES = 9215  # of a matrix that OpenBLAS multiplies with a vector in one thread
FACTOR_ROWS = 8  # of a block that is factorised, per column
MAX_FACTOR_ENTRIES = 8191  # entries of such a block that OpenBLAS updates in one thread


def tall_triangle(matrix: Array) -> Array:
    """Return the triangle of the QR factors of a tall matrix, (c, c)."""
    columns = matrix.shape[1]
    size = max(min(FACTOR_ROWS * columns, MAX_FACTOR_ENTRIES // columns), 2 * columns)
    while len(matrix) > size:
        divisible = len(matrix) // size * size
        triangles = np.asarray(np.linalg.qr(matrix[:divisible].reshape(-1, size, columns), mode="r"))
        matrix = np.concatenate([triangles.reshape(-1, columns), matrix[divisible:]])
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def tall_qr(matrix: Array) -> tuple[Array, Array]:
    """Return the QR factors of a tall matrix, (m, c) and (c, c)."""
    triangle = tall_triangle(matrix)
    length = np.linalg.norm(triangle, axis=0)
    triangle /= length
    inverse = np.linalg.inv(triangle)
    q = np.empty(matrix.shape)
    for rows in _blocks(*matrix.shape):
        scaled = matrix[rows] / length
        estimate = scaled @ inverse
        q[rows] = estimate + (scaled - estimate @ triangle) @ inverse
    correction = np.linalg.cholesky(inner(q, q)).T
    return tall_times(q, np.linalg.inv(correction)), correction @ triangle * length


def tall_times(tall: Any, small: Array) -> Any:
    """Return the product of a tall matrix (m, c) and a small real one (c, n)."""
    if np.iscomplexobj(tall):
        return tall_times(tall.real, small) + 1j * tall_times(tall.imag, small)
    product = np.empty((len(tall), small.shape[1]))
    for rows in _blocks(len(tall), max(small.shape)):
        np.matmul(tall[rows], small, out=product[rows])
    return product


def inner(first: Any, second: Any) -> Any:
    """Return the product A' B of two tall matrices (m, c), (m, n)."""
    blocks = _blocks(len(first), max(first.shape[1], second.shape[1]))
    return sum(first[rows].T @ second[rows] for rows in blocks)


def _blocks(count: int, columns: int) -> Iterator[slice]:
    """Return the rows of the blocks of matrices with up to this number of columns."""
    size = max(min(MAX_PRODUCTS // (columns * (columns + 1)), MAX_ENTRIES // columns), 1)
    return (slice(start, start + size) for start in range(0, count, size))
