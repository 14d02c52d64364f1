"""Hermite shape functions of one element, Eq. (3), and Gauss rules on [0, 1].

With xi = p/l running over the element, the position is r(p) = s1 r_0 + s2 tau_0 + s3 r_l + s4 tau_l, Eq. (2), and

    s1 = 1 - 3 xi^2 + 2 xi^3,   s2 = l (xi - 2 xi^2 + xi^3),   s3 = 3 xi^2 - 2 xi^3,   s4 = l (xi^3 - xi^2).

The functions take numbers or CasADi symbols and return the four values in that order; primes are d/dp.

References
----------
"Comparison of external damping models in a large deformation problem", Section 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ancf_casadi.support.arrays import Array


def hermite(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1..s4 at ``xi`` for an element of length ``l``, Eq. (3)."""
    return 1 - 3 * xi**2 + 2 * xi**3, l * (xi - 2 * xi**2 + xi**3), 3 * xi**2 - 2 * xi**3, l * (xi**3 - xi**2)


def hermite_slope(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1'..s4' at ``xi``, 1/m for the positions and 1 for the slopes."""
    return (
        (6 * xi**2 - 6 * xi) / l,
        1 - 4 * xi + 3 * xi**2,
        (6 * xi - 6 * xi**2) / l,
        3 * xi**2 - 2 * xi,
    )


def hermite_curvature(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1''..s4'' at ``xi``, 1/m^2 for the positions and 1/m for the slopes."""
    return (12 * xi - 6) / l**2, (6 * xi - 4) / l, (6 - 12 * xi) / l**2, (6 * xi - 2) / l


def gauss(points: int) -> tuple[Array, Array]:
    """Return nodes and weights of the Gauss-Legendre rule on [0, 1], exact to degree 2 ``points`` - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return (nodes + 1) / 2, weights / 2
