"""The coefficients of Radau IIA of order 5, derived from its nodes.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.5 and IV.8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

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
    exponents = np.arange(1, STAGES + 1)
    integral = np.linalg.inv(np.vander(nodes, increasing=True)) / exponents[:, None]
    weights: Array = np.asarray(nodes[:, None] ** exponents @ integral, dtype=float)
    inverse = np.asarray(np.linalg.inv(weights), dtype=float)
    values, vectors = np.linalg.eig(inverse)
    real, pair = int(np.argmin(np.abs(values.imag))), int(np.argmax(values.imag))
    transform = np.column_stack([vectors[:, real].real, vectors[:, pair].real, -vectors[:, pair].imag])
    block = np.linalg.solve(transform, inverse @ transform)
    gamma, mu = float(block[0, 0]), complex(block[1, 1], block[2, 1])
    moments = 1 / exponents - np.array([1 / gamma, 0.0, 0.0])
    quadrature = np.linalg.solve(nodes ** (exponents - 1)[:, None], moments)
    embedded = (quadrature - weights[-1]) @ inverse
    return Tableau(nodes, inverse, transform, gamma, mu, embedded, integral)


def overstrain_weights() -> cs.Function:
    """(tau/h) -> W, (3, 3), alpha and beta of a Maxwell branch (``collocation``)."""
    x, inverse = cs.SX.sym("x"), cs.SX(RADAU.inverse)
    weights = x * inverse @ cs.inv(cs.SX.eye(STAGES) + x * inverse)
    (re, im), gamma = (RADAU.mu.real, RADAU.mu.imag), RADAU.gamma
    size = (1 + x * re) ** 2 + (x * im) ** 2
    values = cs.vertcat(x * gamma / (1 + x * gamma), x * (re + x * (re**2 + im**2)) / size, x * im / size)
    fit = cs.DM(np.linalg.pinv(np.array([[1.0, gamma], [1.0, re], [0.0, im]])))
    return cs.Function("overstrain_weights", [x], [weights, *cs.vertsplit(fit @ values)])


def powers(x: Any, orders: int) -> list[list[Any]]:
    """Return 1, x, ..., x^5 and their derivatives up to an order, (orders, 6)."""
    return [[math.perm(k, order) * x ** max(k - order, 0) for k in range(6)] for order in range(orders)]


RADAU = tableau()
# (6, 6), each row a polynomial of degree 5 with one of its values and first two derivatives at 0, then at 1, equal to 1
QUINTIC = np.linalg.inv(np.array(powers(0.0, 3) + powers(1.0, 3))).T
