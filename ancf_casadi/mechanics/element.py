"""One Euler-Bernoulli element in absolute nodal coordinates: its energies, and the forces that follow from them.

Length and axis of the element are properties like its width, so that one set of Functions serves every mesh.

The coordinates e = (r_0, tau_0, r_l, tau_l), Eq. (1), are positions and slopes in the laboratory frame, eight numbers.
With r = S e, Eq. (2), and line density mu, the energies are

    kinetic   T = 1/2 int mu r_t . r_t dp,                    Eq. (5)
    strain    U = 1/2 int E A eps^2 dp + 1/2 int E I kappa^2 dp,   Eq. (8)

and differentiation gives the mass matrix M = d2T/de_t2, Eq. (7), the elastic force Q_e = dU/de, Eq. (6), and the
tangent stiffness K = d2U/de2.  U is a weighted sum of squared strains over Gauss points, U = 1/2 sum_i d_i s_i(e)^2,
so with J = ds/de and D = diag(d_i)

    elastic force                                   Q_e = J^T D s,
    strain-rate (Kelvin-Voigt) force a unit time    Q_v = J^T D J e_t,

the second being objective: a rigid motion has no strain rate, hence no damping force.

Axial strain eps: ``engineering`` |r'| - 1, or ``green`` (r'.r' - 1)/2.
Curvature kappa: ``material`` r' x r''/|r'|^2, ``geometric`` r' x r''/|r'|^3, or ``small`` |r''|, whose components
along r' and across it are the two strains that turn with the beam.

Two Gauss points for each term: with three or more the axial term over-constrains the cubic in bending, and it locks.

References
----------
"Comparison of external damping models in a large deformation problem", Section 2.
Gerstmayr and Irschik 2008, "On the correct representation of bending and axial deformation in the absolute nodal
coordinate formulation with an elastic line approach" (the material curvature).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

import casadi as cs

from ancf_casadi.mechanics.shape import gauss, hermite, hermite_curvature, hermite_slope
from ancf_casadi.support.inputs import choice, whole

AxialStrain = Literal["engineering", "green"]
Curvature = Literal["material", "geometric", "small"]

AXIAL_POINTS = 2
BENDING_POINTS = 2
MASS_POINTS = 4  # exact: the integrand has degree 6
DRAG_POINTS = 4
ELEMENT_PROPERTIES = 7  # width, thickness, density, elastic modulus, length, x and y of the axis
STILL = 1e-9  # m/s; speeds below are smoothed in |v|, whose derivative has no value at rest


@dataclass(frozen=True)
class StrainMeasures:
    """Which strain measures enter Eq. (8), and with how many Gauss points.

    Parameters
    ----------
    axial : {"engineering", "green"}
        Longitudinal strain eps.
    curvature : {"material", "geometric", "small"}
        Transverse curvature kappa.
    axial_points, bending_points : int
        Gauss points of either term; the defaults do not lock.

    Raises
    ------
    InputError
        If a name is unknown or a number of points is not 1 to 9.
    """

    axial: AxialStrain = "engineering"
    curvature: Curvature = "material"
    axial_points: int = AXIAL_POINTS
    bending_points: int = BENDING_POINTS

    def __post_init__(self) -> None:
        """Validate."""
        for name, kind in (("axial", AxialStrain), ("curvature", Curvature)):
            choice(getattr(self, name), get_args(kind), name)
        for name in ("axial_points", "bending_points"):
            whole(getattr(self, name), name, 1, 9)


@dataclass(frozen=True)
class Element:
    """The CasADi Functions of one element: of the beam, of its clamp, or the mass at its tip.

    Inputs are e (d), its rate e_t (d) and the properties p of the element, SI.  A beam element has d = 8 and
    p = (width, thickness, density, elastic modulus, length, x and y of the axis); the others: ``clamp`` and ``tip``.

    Parameters
    ----------
    strain_energy : Function
        (e, p) -> U, J.
    elastic_force : Function
        (e, p) -> Q_e (d), Eq. (6).
    tangent_stiffness : Function
        (e, p) -> K (d, d).
    tangent_force : Function
        (e, e_t, p) -> K e_t (d), to be multiplied by a time in s.
    reference_force : Function
        (e_t, p) -> K e_t (d) with K of the undeformed element, to be multiplied by a time in s.
    strain_rate_force : Function
        (e, e_t, p) -> Q_v (d), to be multiplied by a time in s.
    mass : Function
        p -> M (d, d), Eq. (7).
    inertia_force : Function
        (e_tt, p) -> M e_tt (d), or any other rate.
    line_inertia_force : Function
        (e_tt, p) -> int S^T mu r_tt dp (d), the share of a mass along the beam in M e_tt.
    gravity_force : Function
        (p, g) -> Q_g (d), Eq. (7).
    drag_force : Function
        (e_t, p) -> int S^T mu |v| v dp (d), to be multiplied by a coefficient in 1/m; the integral in Eq. (23).
    """

    strain_energy: cs.Function
    elastic_force: cs.Function
    tangent_stiffness: cs.Function
    tangent_force: cs.Function
    reference_force: cs.Function
    strain_rate_force: cs.Function
    mass: cs.Function
    inertia_force: cs.Function
    line_inertia_force: cs.Function
    gravity_force: cs.Function
    drag_force: cs.Function


@lru_cache(maxsize=8)
def element(measures: StrainMeasures) -> Element:
    """Derive the Functions of a beam element from its energies, once for each choice of strain measures."""
    e, e_t, p = cs.SX.sym("e", 8), cs.SX.sym("e_t", 8), cs.SX.sym("p", ELEMENT_PROPERTIES)
    width, thickness, density, elastic_modulus, l, *axis = cs.vertsplit(p)
    area, units = width * thickness, _units(l)
    mu = density * area

    eps, eps_weights = _axial_strains(units * e, l, measures)
    kappa, kappa_weights = _curvatures(units * e, l, measures)
    d = cs.vertcat(
        *(elastic_modulus * area * l * w for w in eps_weights),
        *(elastic_modulus * area * thickness**2 / 12 * l * w for w in kappa_weights),
    )
    line_mass, line_weight = cs.DM.zeros(8, 8), cs.DM.zeros(8, 2)
    for xi, w in _rule(MASS_POINTS):
        shape = _shape(xi, hermite)
        line_mass += w * shape.T @ shape
        line_weight += w * shape.T
    drag_force = cs.SX.zeros(8)
    for xi, w in _rule(DRAG_POINTS):
        shape = _shape(xi, hermite)
        v = shape @ (units * e_t)
        drag_force += units * (w * mu * l * cs.sqrt(cs.sumsqr(v) + STILL**2) * (shape.T @ v))
    mass = mu * l * (units @ units.T) * line_mass
    return element_of(
        inputs=(e, e_t, p),
        straight=cs.vertcat(0, 0, *axis, *(l * part for part in axis), *axis),
        strains=cs.vertcat(*eps, *kappa),
        weights=d,
        mass=mass,
        line_mass=mass,
        weight=mu * l * cs.repmat(units, 1, 2) * line_weight,
        drag_force=drag_force,
    )


def element_of(
    inputs: tuple[cs.SX, cs.SX, cs.SX],
    straight: cs.SX,
    strains: cs.SX,
    weights: cs.SX,
    mass: cs.SX,
    line_mass: cs.SX,
    weight: cs.SX,
    drag_force: cs.SX,
) -> Element:
    """Derive the Functions of what stores U = 1/2 sum_i d_i s_i^2 and has a mass.

    Parameters
    ----------
    inputs : (SX, SX, SX)
        Symbols of e (d), e_t (d) and the properties p.
    straight : SX (d,)
        e of the undeformed element.
    strains, weights : SX
        The strains s(e) and their weights d(p).
    mass, line_mass : SX (d, d)
        M, and the share of a mass along the beam in it.
    weight : SX (d, 2)
        The generalized force of gravity per unit acceleration.
    drag_force : SX (d,)
        int S^T mu |v| v dp.
    """
    e, e_t, p = inputs
    s, d = strains, weights
    elastic_force = cs.jtimes(s, e, d * s, True)
    strain_rate_force = cs.jtimes(s, e, d * cs.jtimes(s, e, e_t), True)
    tangent_force = cs.jtimes(elastic_force, e, e_t)
    g = cs.SX.sym("g", 2)

    def function(name: str, inputs: list[cs.SX], output: Any) -> cs.Function:
        return cs.Function(name, inputs, [cs.cse(cs.densify(output))])

    return Element(
        strain_energy=function("strain_energy", [e, p], cs.dot(d, s**2) / 2),
        elastic_force=function("elastic_force", [e, p], elastic_force),
        tangent_stiffness=function("tangent_stiffness", [e, p], _symmetric(cs.jacobian(elastic_force, e))),
        tangent_force=function("tangent_force", [e, e_t, p], tangent_force),
        reference_force=function("reference_force", [e_t, p], cs.substitute(tangent_force, e, straight)),
        strain_rate_force=function("strain_rate_force", [e, e_t, p], strain_rate_force),
        mass=function("mass", [p], mass),
        inertia_force=function("inertia_force", [e_t, p], mass @ e_t),
        line_inertia_force=function("line_inertia_force", [e_t, p], line_mass @ e_t),
        gravity_force=function("gravity_force", [p, g], weight @ g),
        drag_force=function("drag_force", [e_t, p], drag_force),
    )


def _symmetric(matrix: cs.SX) -> cs.SX:
    """Return a symmetric matrix with its lower half taken from the upper one, which halves the work."""
    return cs.triu2symm(cs.triu(cs.densify(matrix)))


def _units(l: cs.SX) -> cs.SX:
    """Factors by which e becomes the coordinates of an element of length 1."""
    return cs.vertcat(1, 1, l, l, 1, 1, l, l)


def _rule(points: int) -> list[tuple[float, float]]:
    nodes, weights = gauss(points)
    return list(zip(nodes.tolist(), weights.tolist(), strict=True))


def _shape(xi: float, functions: Callable[[Any, float], tuple[Any, ...]]) -> cs.DM:
    """S of Eq. (2), 2 x 8, or a derivative, for an element of length 1."""
    return cs.kron(cs.DM(functions(xi, 1.0)).T, cs.DM.eye(2))


def axial_strain(slope: Any, measure: AxialStrain) -> Any:
    """Return eps from the components of r', numbers, arrays or symbols."""
    stretch = slope[0] ** 2 + slope[1] ** 2
    return stretch**0.5 - 1 if measure == "engineering" else (stretch - 1) / 2


def curvature(slope: Any, second: Any, measure: Curvature) -> Any:
    """Return kappa from the components of r' and r'', numbers, arrays or symbols; for ``small``, along the normal."""
    cross = slope[0] * second[1] - slope[1] * second[0]
    power = {"material": 1.0, "geometric": 1.5, "small": 0.5}[measure]
    return cross / (slope[0] ** 2 + slope[1] ** 2) ** power


def _axial_strains(e: cs.SX, l: cs.SX, measures: StrainMeasures) -> tuple[list[cs.SX], list[float]]:
    """Return the axial strains at the Gauss points and the weights of these; e is scaled to length 1."""
    slopes = [cs.vertsplit(_shape(xi, hermite_slope) @ e / l) for xi, _ in _rule(measures.axial_points)]
    strains = [axial_strain(slope, measures.axial) for slope in slopes]
    return strains, [w for _, w in _rule(measures.axial_points)]


def _curvatures(e: cs.SX, l: cs.SX, measures: StrainMeasures) -> tuple[list[cs.SX], list[float]]:
    """Return the curvatures at the Gauss points and the weights of these; e is scaled to length 1."""
    strains: list[cs.SX] = []
    weights: list[float] = []
    for xi, w in _rule(measures.bending_points):
        slope = cs.vertsplit(_shape(xi, hermite_slope) @ e / l)
        second = cs.vertsplit(_shape(xi, hermite_curvature) @ e / l**2)
        components = [curvature(slope, second, measures.curvature)]
        if measures.curvature == "small":
            components.append((slope[0] * second[0] + slope[1] * second[1]) / (slope[0] ** 2 + slope[1] ** 2) ** 0.5)
        strains += components
        weights += [w] * len(components)
    return strains, weights
