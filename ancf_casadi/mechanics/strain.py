"""Shape functions of one element, Eqs. (2) and (3), its strain measures in Eq. (8), Gauss rules, and loads at a point.

With xi = p/l from 0 to 1 along the element, the position is r(p) = s1 r_0 + s2 tau_0 + s3 r_l + s4 tau_l = S e,
Eq. (2), with Hermite's cubics, Eq. (3):

    s1 = 1 - 3 xi^2 + 2 xi^3,   s2 = l (xi - 2 xi^2 + xi^3),   s3 = 3 xi^2 - 2 xi^3,   s4 = l (xi^3 - xi^2).

Their functions take numbers or CasADi symbols and return the four values in that order; primes are d/dp.

Axial strain eps: ``engineering`` |r'| - 1, or ``green`` (r'.r' - 1)/2.
Curvature kappa: ``material`` r' x r''/|r'|^2, ``geometric`` r' x r''/|r'|^3, or ``small`` |r''|.  For ``small``, the
components of r'' along r' and normal to r' are two separate strains, because they rotate with the beam.

Each term has two Gauss points.  Three or more in the axial term over-constrain the cubic in bending: the element locks.

A load (Fx, Fy, m) at a point with position r = S e and slope tau = S' e does the virtual work F.dr + m dtheta, theta =
atan2(tau_y, tau_x), and so has the generalized force

    Q = S^T F + S'^T h,    h = m (-tau_y, tau_x)/|tau|^2.

References
----------
"Comparison of external damping models in a large deformation problem", Section 2.
Gerstmayr and Irschik 2008, "On the correct representation of bending and axial deformation in the absolute nodal
coordinate formulation with an elastic line approach" (the material curvature).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import choice, whole
from ancf_casadi.support.tables import Displayed

S = TypeVar("S", cs.SX, cs.MX)
AxialStrain = Literal["engineering", "green"]
Curvature = Literal["material", "geometric", "small"]


def hermite(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1..s4 at ``xi`` for an element of length ``l``, Eq. (3)."""
    return 1 - 3 * xi**2 + 2 * xi**3, l * (xi - 2 * xi**2 + xi**3), 3 * xi**2 - 2 * xi**3, l * (xi**3 - xi**2)


def hermite_slope(xi: Any, l: float) -> tuple[Any, Any, Any, Any]:
    """Return s1'..s4' at ``xi``, in 1/m for the positions and dimensionless for the slopes."""
    return (6 * xi**2 - 6 * xi) / l, 1 - 4 * xi + 3 * xi**2, (6 * xi - 6 * xi**2) / l, 3 * xi**2 - 2 * xi


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


@dataclass(frozen=True)
class StrainMeasures(Displayed):
    """The strain measures in Eq. (8) and their numbers of Gauss points.

    Parameters
    ----------
    axial : {"engineering", "green"}
        Longitudinal strain eps.
    curvature : {"material", "geometric", "small"}
        Transverse curvature kappa.
    axial_points, bending_points : int
        Numbers of Gauss points; with the defaults the element does not lock.

    Raises
    ------
    InputError
        If a name is unknown or a number of points is not 1 to 9.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, StrainMeasures, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> linear = Model(beam, StrainMeasures(curvature="small"))
    >>> natural_modes(linear, count=2).frequencies.round(2)
    array([ 1.88, 10.59])
    """

    axial: AxialStrain = "engineering"
    curvature: Curvature = "material"
    axial_points: int = 2
    bending_points: int = 2

    def __post_init__(self) -> None:
        """Validate."""
        for name, kind in (("axial", AxialStrain), ("curvature", Curvature)):
            choice(getattr(self, name), get_args(kind), name)
        for name in ("axial_points", "bending_points"):
            whole(getattr(self, name), name, 1, 9)

    @property
    def axial_rule(self) -> Sequence[tuple[float, float]]:
        """The points of the axial term, from 0 to 1 along the element, and their weights."""
        return gauss_pairs(self.axial_points)


def axial_strain(slope: Any, measure: AxialStrain) -> Any:
    """Return eps from the components of r': numbers, arrays or symbols."""
    squared = slope[0] ** 2 + slope[1] ** 2
    return squared**0.5 - 1 if measure == "engineering" else (squared - 1) / 2


def curvature(slope: Any, second: Any, measure: Curvature) -> Any:
    """Return kappa (for ``small`` its normal part) from the components of r' and r'': numbers, arrays or symbols."""
    cross = slope[0] * second[1] - slope[1] * second[0]
    power = {"material": 1.0, "geometric": 1.5, "small": 0.5}[measure]
    return cross / (slope[0] ** 2 + slope[1] ** 2) ** power


def axial_strains(e: cs.SX, l: cs.SX, measures: StrainMeasures) -> list[tuple[cs.SX, float]]:
    """Return eps at each point of its rule with its weight, from coordinates e scaled to an element of length 1."""
    slopes = [(cs.vertsplit(shape_matrix(xi, hermite_slope) @ e / l), w) for xi, w in measures.axial_rule]
    return [(axial_strain(slope, measures.axial), w) for slope, w in slopes]


def bending_strains(e: cs.SX, l: cs.SX, measures: StrainMeasures) -> list[tuple[cs.SX, float]]:
    """Return kappa at each Gauss point with its weight, from coordinates e scaled to an element of length 1."""
    strains = []
    for xi, w in gauss_pairs(measures.bending_points):
        slope = cs.vertsplit(shape_matrix(xi, hermite_slope) @ e / l)
        second = cs.vertsplit(shape_matrix(xi, hermite_curvature) @ e / l**2)
        strains.append((curvature(slope, second, measures.curvature), w))
        if measures.curvature == "small":
            along = (slope[0] * second[0] + slope[1] * second[1]) / (slope[0] ** 2 + slope[1] ** 2) ** 0.5
            strains.append((along, w))
    return strains


def point_force(slope: S, load: S, *, follower: bool) -> tuple[S, S]:
    """Return F and h, (2, s), of loads (3 or 4, s) at a point with slopes (2, s)."""
    x, y = slope[0, :], slope[1, :]
    turn = load[2, :] / (x * x + y * y)
    h = cs.vertcat(-y * turn, x * turn)
    if not follower:
        return load[:2, :], h
    length = cs.sqrt(x * x + y * y)
    along, across = load[0, :] / length, load[1, :] / length
    return cs.vertcat(along * x - across * y, along * y + across * x), h
