"""Elements in absolute nodal coordinates, their energies, Eqs. (5) and (8), the resulting forces, and groups of them.

Length and axis of an element are properties like its width, so one set of Functions serves every mesh.

The eight coordinates e = (r_0, tau_0, r_l, tau_l) of an Euler-Bernoulli element, Eq. (1), are positions and slopes in
the laboratory frame.  With r = S e, Eq. (2), and the mass per length mu, the energies are

    kinetic   T = 1/2 int mu r_t . r_t dp,                            Eq. (5)
    strain    U = 1/2 int E A eps^2 dp + 1/2 int E I kappa^2 dp,      Eq. (8)

and differentiation gives the mass matrix M = d2T/de_t2, Eq. (7), the elastic force Q_e = dU/de, Eq. (6), and the
tangent stiffness K = d2U/de2.  U is a weighted sum of squared strains at Gauss points, U = 1/2 sum_i d_i s_i(e)^2.
With J = ds/de and D = diag(d_i),

    elastic force                                               Q_e = J^T D s,
    strain-rate (Kelvin-Voigt) force per unit time constant     Q_v = J^T D J e_t.

Q_v is objective: a rigid motion has no strain rate, hence no damping force.

With a natural curvature kappa_0, the strains s are those beyond the strains of an arc of curvature kappa_0 in the same
measures, so that the beam as manufactured is free of stress on any mesh.  (Its cubics miss the arc by a strain of
(kappa_0 l)^4/480, whose tension can exceed the buckling load of a thin beam.)

A prestress sigma_0 is a further axial strain sigma_0/E.

If the sections have rotary inertia, the kinetic energy has a further term

    1/2 int rho I r'_t . r'_t dp,

which is that of their rotation where the slopes r' keep their length: Rayleigh's correction, with a constant matrix.

What is attached to the beam at a node is an element too (``point_elements``).

References
----------
"Comparison of external damping models in a large deformation problem", Section 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.nodes import unit_velocities
from ancf_casadi.mechanics.strain import (
    StrainMeasures,
    axial_strains,
    bending_strains,
    gauss_pairs,
    hermite_slope,
    shape_matrix,
)
from ancf_casadi.support.arrays import Array, Index

ELEMENT_PROPERTIES = 7  # width, thickness, density, elastic modulus, length, x and y of the axis
SINC_TERMS = 8  # of the series of sin(x)/x, exact to rounding up to x = 1.5
SMOOTHING_SPEED = 1e-9  # m/s; |v| is smoothed below this speed, because it has no derivative at rest


@dataclass(frozen=True, eq=False)
class Element:
    """The CasADi Functions of one element: a piece of the beam, or what is attached to it.

    But for the first, they are those of ``Model`` with the same names, for coordinates e (d), velocities e_t (d) and
    the properties p of one element, in SI units; the matrices are (d, d).  A beam element has d = 8 and p = (width,
    thickness, density, elastic modulus, length, x and y of the axis).  The force
    with the tangent stiffness, that with the stiffness of the undeformed element and the strain-rate force are to be
    multiplied by a time (s), the drag by a coefficient in 1/m, and the friction by one in m/s^2.
    """

    scaled_strains: cs.Function  # (e, p) -> d_i^(1/2) s_i, whose squares add up to 2 U
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
    friction_force: cs.Function
    dashpot_force: cs.Function

    @property
    def unit_velocities(self) -> Array:
        """Rates of the coordinates at a unit velocity along x and along y, (d, 2)."""
        return unit_velocities(self.elastic_force.size1_in(0))


@lru_cache(maxsize=8)
def element(
    measures: StrainMeasures, *, curved: bool = False, prestressed: bool = False, rotary: bool = False
) -> Element:
    """Derive the Functions of a beam element from its energies, once for each choice of strain measures.

    A ``curved`` or ``prestressed`` element has more properties: the ratio of its natural curvature to the largest one
    of the beam, that of its prestress, then the largest curvature, 1/m, and prestress, Pa.  ``rotary`` says whether its
    sections have rotary inertia.
    """
    initial_count = curved + prestressed
    e, e_t, p = symbols(8, ELEMENT_PROPERTIES + 2 * initial_count)
    initial = p[ELEMENT_PROPERTIES : ELEMENT_PROPERTIES + initial_count] * p[ELEMENT_PROPERTIES + initial_count :]
    width, thickness, density, elastic_modulus, l, *axis = cs.vertsplit(p[:ELEMENT_PROPERTIES])
    area, units = width * thickness, cs.vertcat(1, 1, l, l, 1, 1, l, l)  # units * e: for a length of 1
    mu = density * area

    eps, kappa = axial_strains(units * e, l, measures), bending_strains(units * e, l, measures)
    unstressed = cs.vertcat(0, 0, *axis, *(l * component for component in axis), *axis)
    if curved:
        arc = _arc(l, initial[0])
        arc_strains = [axial_strains(arc, l, measures), bending_strains(arc, l, measures)]
        eps, kappa = (
            [(strain - natural, w) for (strain, w), (natural, _) in zip(strains, without, strict=True)]
            for strains, without in zip((eps, kappa), arc_strains, strict=True)
        )
        (ax, ay) = axis
        unstressed = cs.kron(cs.SX.eye(4), cs.blockcat([[ax, -ay], [ay, ax]])) @ (arc / units)
    if prestressed:
        eps = [(strain + initial[-1] / elastic_modulus, w) for strain, w in eps]
    d = cs.vertcat(
        *(elastic_modulus * area * l * w for _, w in eps),
        *(elastic_modulus * area * thickness**2 / 12 * l * w for _, w in kappa),
    )
    unit_mass, unit_weight = cs.DM.zeros(8, 8), cs.DM.zeros(8, 2)
    for xi, w in gauss_pairs(4):  # exact: the integrand has degree 6
        shape = shape_matrix(xi)
        unit_mass += w * shape.T @ shape
        unit_weight += w * shape.T
    line_mass = mu * l * (units @ units.T) * unit_mass
    mass = line_mass
    if rotary:
        slopes = [(shape_matrix(xi, hermite_slope), w) for xi, w in gauss_pairs(3)]  # exact: of degree 4
        unit_turns = sum((w * slope.T @ slope for slope, w in slopes), cs.DM(8, 8))
        mass = line_mass + mu * thickness**2 / 12 / l * (units @ units.T) * unit_turns
    # of drag and friction; approximate: |v| v and v/|v| are not polynomials
    return derived_element(
        inputs=(e, e_t, p),
        straight=unstressed,
        energy=(cs.vertcat(*(strain for strain, _ in eps + kappa)), d),
        mass=mass,
        line_mass=line_mass,
        gravity=mu * l * cs.repmat(units, 1, 2) * unit_weight,
        surface=[(shape_matrix(xi) @ cs.diag(units), w * mu * l) for xi, w in gauss_pairs(4)],
    )


def symbols(coordinates: int, properties: int) -> tuple[cs.SX, cs.SX, cs.SX]:
    """Return symbols of the coordinates, velocities and properties of an element."""
    return cs.SX.sym("e", coordinates), cs.SX.sym("e_t", coordinates), cs.SX.sym("p", properties)


def _arc(l: cs.SX, curvature: cs.SX) -> cs.SX:
    """Return the coordinates of an arc of length ``l``, scaled to an element of length 1, seen from its middle."""
    half = l * curvature / 2
    square, chord = half * half, cs.SX(1)
    for k in range(SINC_TERMS, 0, -1):  # sin(half)/half
        chord = 1 - square / (2 * k * (2 * k + 1)) * chord
    return l * cs.vertcat(0, 0, cs.cos(half), -cs.sin(half), chord, 0, cs.cos(half), cs.sin(half))


def derived_element(
    inputs: tuple[cs.SX, cs.SX, cs.SX],
    straight: cs.SX,
    energy: tuple[cs.SX, cs.SX] | None = None,
    mass: cs.SX | None = None,
    line_mass: cs.SX | None = None,
    gravity: cs.SX | None = None,
    surface: Sequence[tuple[cs.SX, cs.SX]] = (),
    dashpot: cs.SX | None = None,
) -> Element:
    """Derive the Functions of an element with a mass and the strain energy U = 1/2 sum_i d_i s_i^2, both 0 by default.

    The inputs are symbols of e (d), e_t (d) and the properties p; ``straight`` (d,) are the coordinates of the
    undeformed element, and ``energy`` its s(e) and d(p).  ``line_mass`` is the part of the mass M (d, d) from mass
    along the beam, ``gravity`` (d, 2) is Q_g per unit acceleration of gravity, and ``surface`` holds S (2, d) and the
    mass at each point where drag and friction act.  ``dashpot`` (d,) is a force that resists e_t.
    """
    e, e_t, p = inputs
    s, d = energy or (cs.SX(0, 1), cs.SX(0, 1))
    no_mass = cs.SX.zeros(e.numel(), e.numel())
    mass, line_mass = no_mass if mass is None else mass, no_mass if line_mass is None else line_mass
    weight = cs.SX.zeros(e.numel(), 2) if gravity is None else gravity
    elastic_force = cs.jtimes(s, e, d * s, True)
    strain_rate_force = cs.jtimes(s, e, d * cs.jtimes(s, e, e_t), True)
    tangent_force = cs.jtimes(elastic_force, e, e_t)
    tangent_stiffness = cs.triu2symm(cs.triu(cs.densify(cs.jacobian(elastic_force, e))))  # the matrix is symmetric
    g, v0 = cs.SX.sym("g", 2), cs.SX.sym("v0")
    moving = [(m * shape.T, shape @ e_t) for shape, m in surface]
    drag_force = sum((side @ v * cs.sqrt(cs.sumsqr(v) + SMOOTHING_SPEED**2) for side, v in moving), 0 * e_t)
    friction_force = sum((side @ v / cs.sqrt(cs.sumsqr(v) + v0**2) for side, v in moving), 0 * e_t)

    outputs: dict[str, tuple[list[cs.SX], Any]] = {
        "scaled_strains": ([e, p], cs.sqrt(d) * s),
        "strain_energy": ([e, p], cs.dot(d, s**2) / 2),
        "elastic_force": ([e, p], elastic_force),
        "tangent_stiffness": ([e, p], tangent_stiffness),
        "tangent_force": ([e, e_t, p], tangent_force),
        "reference_force": ([e_t, p], cs.substitute(tangent_force, e, straight)),
        "strain_rate_force": ([e, e_t, p], strain_rate_force),
        "mass": ([p], mass),
        "inertia_force": ([e_t, p], mass @ e_t),
        "line_inertia_force": ([e_t, p], line_mass @ e_t),
        "gravity_force": ([p, g], weight @ g),
        "drag_force": ([e_t, p], drag_force),
        "friction_force": ([e_t, p, v0], friction_force),
        "dashpot_force": ([e_t, p], 0 * e_t if dashpot is None else dashpot),
    }
    return Element(
        **{name: cs.Function(name, inputs, [cs.cse(cs.densify(output))]) for name, (inputs, output) in outputs.items()}
    )


@dataclass(frozen=True, eq=False)
class Group:
    """Equal elements, and their places among the coordinates and properties of the beam.

    The symbolic assembly (``model``) and the numerical one (``vibration.assembly``) use the same groups.  The
    properties of an element are a column of P if the group has columns, then ``constants``, then ``lumped``.
    """

    element: Element  # the Functions of one of them
    coordinates: Index  # indices of the nodal coordinates of each of the k elements, (k, d)
    columns: slice  # the columns of P that belong to these elements: k, or none
    constants: Array  # the fixed properties of each element, such as length and axis, (c, k)
    lumped: dict[str, float]  # names and values of the properties that the elements share (``Beam.lumped``)

    @property
    def count(self) -> int:
        """Number k of elements."""
        return len(self.coordinates)

    def first(self, count: int) -> Group:
        """Return the first elements of the group."""
        columns, constants = slice(min(self.columns.stop, count)), self.constants[:, :count]
        return replace(self, coordinates=self.coordinates[:count], columns=columns, constants=constants)

    def properties(self, P: Any, lumped: Mapping[str, Any] | None = None) -> Any:
        """Return the properties of each element as columns, from P (4, n) and, if given, other lumped ones by name."""
        values = self.lumped if lumped is None else {name: lumped[name] for name in self.lumped}
        constants = [cs.DM(self.constants), *(cs.repmat(value, 1, self.count) for value in values.values())]
        columns = P[:, self.columns]
        return cs.vertcat(*([columns] if columns.shape[1] else []), *constants)

    def gather(self, e: cs.MX) -> cs.MX:
        """Return the coordinates of each element as columns, (d, k s), from s states of all nodes, (size, s)."""
        columns = np.arange(e.size2())[:, None] * e.size1()
        indices = (self.coordinates.ravel() + columns).ravel()
        return cs.reshape(e.nz[indices.tolist()], self.coordinates.shape[1], -1)

    def scatter(self, forces: cs.MX, size: int) -> cs.MX:
        """Return the sums at all nodes, (size, s), of element forces, (d, k s)."""
        rows = self.coordinates.ravel()
        pattern = cs.Sparsity.triplet(size, rows.size, rows.tolist(), list(range(rows.size)))
        return cs.DM(pattern, 1.0) @ cs.reshape(forces, rows.size, -1)
