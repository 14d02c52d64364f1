"""Shape functions of one element, Eqs. (2) and (3), and Gauss rules on [0, 1].

With xi = p/l from 0 to 1 along the element, the position is r(p) = s1 r_0 + s2 tau_0 + s3 r_l + s4 tau_l = S e,
Eq. (2), with Hermite's cubics, Eq. (3):

    s1 = 1 - 3 xi^2 + 2 xi^3,   s2 = l (xi - 2 xi^2 + xi^3),   s3 = 3 xi^2 - 2 xi^3,   s4 = l (xi^3 - xi^2).

The functions take numbers or CasADi symbols and return the four values in that order; primes are d/dp.

References
----------
"Comparison of external damping models in a large deformation problem", Section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array


def hermite(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1..s4 at ``xi`` for an element of length ``l``, Eq. (3)."""
    return 1 - 3 * xi**2 + 2 * xi**3, l * (xi - 2 * xi**2 + xi**3), 3 * xi**2 - 2 * xi**3, l * (xi**3 - xi**2)


def hermite_slope(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1'..s4' at ``xi``, in 1/m for the positions and dimensionless for the slopes."""
    return (
        (6 * xi**2 - 6 * xi) / l,
        1 - 4 * xi + 3 * xi**2,
        (6 * xi - 6 * xi**2) / l,
        3 * xi**2 - 2 * xi,
    )


def hermite_curvature(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1''..s4'' at ``xi``, in 1/m^2 for the positions and in 1/m for the slopes."""
    return (12 * xi - 6) / l**2, (6 * xi - 4) / l, (6 - 12 * xi) / l**2, (6 * xi - 2) / l


def shape_matrix(xi: float, functions: Callable[[Any, float], tuple[Any, ...]] = hermite) -> cs.DM:
    """Return S of Eq. (2), or a derivative of it, for an element of length 1, (2, 8)."""
    return cs.kron(cs.DM(functions(xi, 1.0)).T, cs.DM.eye(2))


def gauss(points: int) -> tuple[Array, Array]:
    """Return nodes and weights of the Gauss-Legendre rule on [0, 1], exact up to degree 2 ``points`` - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return (nodes + 1) / 2, weights / 2


def gauss_pairs(points: int) -> list[tuple[float, float]]:
    """Return the rule of ``gauss`` as pairs (node, weight)."""
    nodes, weights = gauss(points)
    return list(zip(nodes.tolist(), weights.tolist(), strict=True))
