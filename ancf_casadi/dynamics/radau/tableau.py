"""Radau IIA collocation of order 5: the coefficients of the method, and the quintic polynomial of a step.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.5 and IV.8.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array

STAGES = 3


@dataclass(frozen=True, eq=False)
class Tableau:
    """The coefficients of the method."""

    nodes: Array  # c, (3,)
    inverse: Array  # A^-1 of the weights A, (3, 3)
    transform: Array  # T with T^-1 A^-1 T = [[gamma, 0, 0], [0, mu', -mu''], [0, mu'', mu']], (3, 3)
    gamma: float  # real eigenvalue of A^-1
    mu: complex  # complex eigenvalue of A^-1
    embedded: Array  # weights of the increments in the error estimate, in which h f(t) has 1/gamma, (3,)
    integral: Array  # coefficients of x, x^2, x^3 in the integral from 0 to x of a function known at the nodes


def tableau() -> Tableau:
    """Derive the coefficients from the nodes."""
    nodes = np.array(cs.collocation_points(STAGES, "radau"))
    powers = np.arange(1, STAGES + 1)
    integral = np.linalg.inv(np.vander(nodes, increasing=True)) / powers[:, None]
    weights: Array = np.asarray(nodes[:, None] ** powers @ integral, dtype=float)
    inverse = np.asarray(np.linalg.inv(weights), dtype=float)
    values, vectors = np.linalg.eig(inverse)
    real, pair = int(np.argmin(np.abs(values.imag))), int(np.argmax(values.imag))
    transform = np.column_stack([vectors[:, real].real, vectors[:, pair].real, -vectors[:, pair].imag])
    block = np.linalg.solve(transform, inverse @ transform)
    gamma, mu = float(block[0, 0]), complex(block[1, 1], block[2, 1])
    moments = 1 / powers - np.array([1 / gamma, 0.0, 0.0])
    quadrature = np.linalg.solve(nodes ** (powers - 1)[:, None], moments)
    embedded = (quadrature - weights[-1]) @ inverse
    return Tableau(nodes, inverse, transform, gamma, mu, embedded, integral)


def quintic() -> Array:
    """Return the coefficients (6, 6) of six polynomials of degree 5, each with one quantity 1 and five quantities 0.

    The quantities are the value and the first and second derivatives at 0, then at 1.
    """
    conditions = np.zeros((6, 6))
    for k in range(6):
        conditions[:3, k] = [k == 0, k == 1, 2 * (k == 2)]
        conditions[3:, k] = [1, k, k * (k - 1)]
    return np.asarray(np.linalg.inv(conditions).T)


RADAU = tableau()
QUINTIC = quintic()
