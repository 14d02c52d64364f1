"""The beam as one symbolic model: assembly of the elements, the clamp, and points on the beam.

The nodal coordinates e = (r_0, tau_0, r_1, tau_1, ..., r_n, tau_n), 4 (n + 1) numbers in the laboratory frame, are
shared by neighbouring elements.  Forces and matrices add up over the elements,

    M e_tt + Q_damp(e, e_t) + Q_e(e) = Q_g,                  Eq. (6), with damping on the left,

and node 0 is clamped in position and slope: the ``free`` coordinates are those of the other nodes.  The Functions of an
element are mapped over the elements and never expanded here, so graphs stay small and all derivatives stay sparse.
A tip mass is one more element, at the last node.  With an elastic clamp the base is a node ahead of the first node of
the beam, which makes 4 (n + 2) coordinates, and the clamp is one more element, between these two nodes.

The properties P are a matrix with one column (width, thickness, density, elastic modulus) per element.  Every Function
here is symbolic in P; ``Model.properties`` holds the values of the beam.

The curvature of a cubic element is accurate at its two Gauss points; elsewhere it is taken from the straight line
through these values.  Of the axial strain, only the mean over an element is accurate; elsewhere the straight line
through the means of two elements is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES, Beam
from ancf_casadi.mechanics.element import Element, Group, elastic_clamp, element, tip_mass
from ancf_casadi.mechanics.strain import (
    StrainMeasures,
    axial_strain,
    curvature,
    gauss,
    hermite,
    hermite_curvature,
    hermite_slope,
)
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import check_instance, number
from ancf_casadi.support.tables import Displayed

NODE = 4  # coordinates of a node: position and slope
At = Callable[[Array], tuple[Any, Any]]  # multiplies an interpolation by coordinates, numbers or symbols: x and y


@dataclass(frozen=True)
class Model(Displayed):
    """A beam as symbolic equations of motion.

    Each Function takes nodal coordinates e (4 n + 4, or 4 n + 8 with an elastic clamp), velocities e_t, and properties
    P (4, n).

    Parameters
    ----------
    beam : Beam
        The beam.
    measures : StrainMeasures
        The strain measures of Eq. (8).

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> model.size
    20
    >>> model.interpolation(0.25) @ model.straight
    array([ 0.  , -0.25])
    """

    beam: Beam
    measures: StrainMeasures = field(default_factory=StrainMeasures)

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.beam, "beam", Beam)
        check_instance(self.measures, "measures", StrainMeasures)

    def __reduce__(self) -> tuple[type[Model], tuple[Beam, StrainMeasures]]:
        """Pickle the model without its Functions, which the receiving process derives again."""
        return Model, (self.beam, self.measures)

    @property
    def root(self) -> int:
        """Number of the beam's first node: 0, or 1 with an elastic clamp."""
        return int(math.isfinite(self.beam.clamp_stiffness))

    @property
    def size(self) -> int:
        """Number of nodal coordinates, 4 (n + 1 + root)."""
        return NODE * (self.beam.elements + 1 + self.root)

    @property
    def free(self) -> slice:
        """The coordinates that are not clamped."""
        return slice(NODE, self.size)

    @cached_property
    def scale(self) -> Array:
        """Typical size of each coordinate: the length of the beam for positions, 1/2 for slopes, (4 n + 4,)."""
        length = self.beam.length
        return np.tile([length, length, 0.5, 0.5], self.size // NODE)

    @cached_property
    def properties(self) -> Array:
        """The properties P of the beam, (4, n)."""
        return np.array([getattr(self.beam, name) for name in PROPERTIES])

    @property
    def lumped(self) -> dict[str, float]:
        """The properties of ``beam.LUMPED`` that the model has, in this order: those of its tip mass and its clamp."""
        own = {name: value for group in self.groups for name, value in group.lumped.items()}
        return {name: own[name] for name in LUMPED if name in own}

    @cached_property
    def straight(self) -> Array:
        """Coordinates of the beam as manufactured: straight along its axis, unstretched, clamp at the origin."""
        axis = np.array(self.beam.axis)
        arc = np.concatenate([np.zeros(self.root), np.linspace(0.0, self.beam.length, self.beam.elements + 1)])
        return np.column_stack([np.outer(arc, axis), np.tile(axis, (arc.size, 1))]).ravel()

    @cached_property
    def element(self) -> Element:
        """The Functions of one beam element."""
        return element(self.measures)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The elements of the beam, the clamp if it is elastic, and the tip mass if there is one."""
        beam, n, coordinates = self.beam, self.beam.elements, np.arange(2 * NODE)
        constants = (beam.element_length, *beam.axis)
        places = NODE * (np.arange(n)[:, None] + self.root) + coordinates
        groups = [Group(self.element, places, n, constants, {})]
        if self.root:
            clamp = {"clamp_stiffness": beam.clamp_stiffness}
            groups.append(Group(elastic_clamp(), coordinates[None, :], 1, constants, clamp))
        if beam.tip_mass:
            tip = self.size - NODE + coordinates[None, :NODE]
            groups.append(Group(tip_mass(), tip, 0, (), {"tip_mass": beam.tip_mass}))
        return tuple(groups)

    @cached_property
    def strain_energy(self) -> cs.Function:
        """(e, P) -> U, J, Eq. (8)."""
        e, p = self._symbols()
        energies = map(cs.sum2, self._mapped("strain_energy", p, e))
        return cs.Function("strain_energy", [e, p], [sum(energies, cs.MX(0))], ["e", "P"], ["U"])

    @cached_property
    def elastic_force(self) -> cs.Function:
        """(e, P) -> Q_e, Eq. (6)."""
        return self._force("elastic_force", "e", output="Q_e")

    @cached_property
    def tangent_stiffness(self) -> cs.Function:
        """(e, P) -> K = dQ_e/de, sparse."""
        e, p = self._symbols()
        stiffness = self._matrix(self._mapped("tangent_stiffness", p, e))
        return cs.Function("tangent_stiffness", [e, p], [stiffness], ["e", "P"], ["K"])

    @cached_property
    def tangent_force(self) -> cs.Function:
        """(e, e_t, P) -> K e_t, the time derivative of the elastic force."""
        return self._force("tangent_force", "e", "e_t")

    @cached_property
    def reference_force(self) -> cs.Function:
        """(e_t, P) -> K e_t with K of the straight beam."""
        return self._force("reference_force", "e_t")

    @cached_property
    def strain_rate_force(self) -> cs.Function:
        """(e, e_t, P) -> Q_v, the objective Kelvin-Voigt force per unit time constant."""
        return self._force("strain_rate_force", "e", "e_t")

    @cached_property
    def drag_force(self) -> cs.Function:
        """``(e_t, P) -> int S^T mu |v| v dp``, the integral in Eq. (23)."""
        return self._force("drag_force", "e_t")

    @cached_property
    def friction_force(self) -> cs.Function:
        """``(e_t, P, v0) -> int S^T mu v/(|v|^2 + v0^2)^(1/2) dp``, smoothed below the speed v0 (m/s)."""
        return self._force("friction_force", "e_t", v0=1)

    @cached_property
    def mass(self) -> cs.Function:
        """P -> M, Eq. (7), sparse."""
        _, p = self._symbols()
        return cs.Function("mass", [p], [self._matrix(self._mapped("mass", p))], ["P"], ["M"])

    @cached_property
    def line_inertia_force(self) -> cs.Function:
        """(e_tt, P) -> int S^T mu r_tt dp, the part of M e_tt from mass along the beam; also for velocities."""
        return self._force("line_inertia_force", "e_tt")

    @cached_property
    def inertia_force(self) -> cs.Function:
        """(e_tt, P) -> M e_tt; also for velocities."""
        return self._force("inertia_force", "e_tt")

    @cached_property
    def gravity_force(self) -> cs.Function:
        """(P, g) -> Q_g, Eq. (7); g is the acceleration of gravity (2), m/s^2."""
        return self._force("gravity_force", output="Q_g", g=2)

    def sum_at_nodes(self, forces: Sequence[cs.MX]) -> cs.MX:
        """Return the sums at all nodes, (4 n + 4, s), of the element forces of each group, (d, k s), in s states."""
        sums = [group.scatter(columns, self.size) for group, columns in zip(self.groups, forces, strict=True)]
        return sum(sums[1:], sums[0])

    @cached_property
    def entries(self) -> tuple[Index, Index]:
        """Rows and columns of the entries of all element matrices, group by group, each matrix column by column."""
        rows, columns = [], []
        for group in self.groups:
            d = group.coordinates.shape[1]
            rows.append(np.tile(group.coordinates, d).ravel())
            columns.append(np.repeat(group.coordinates, d, axis=1).ravel())
        return np.concatenate(rows), np.concatenate(columns)

    def entries_from(self, first: int) -> tuple[Index, Index, Index]:
        """Return the places in ``entries`` of those from coordinate ``first`` on, and their rows and columns."""
        rows, columns = (index - first for index in self.entries)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        return kept, rows[kept], columns[kept]

    def matrix(self, values: cs.MX, first: int = 0) -> cs.MX:
        """Return the sparse sum of element matrices, ``values`` as in ``entries``, from coordinate ``first`` on."""
        kept, rows, columns = self.entries_from(first)
        pairs, target = np.unique(np.column_stack([columns, rows]), axis=0, return_inverse=True)
        size = self.size - first
        pattern = cs.Sparsity.triplet(size, size, pairs[:, 1].tolist(), pairs[:, 0].tolist())
        sums = cs.Sparsity.triplet(len(pairs), values.numel(), target.ravel().tolist(), kept.tolist())
        return cs.MX(pattern, cs.DM(sums, 1.0) @ values)

    def interpolation(self, point: float) -> Array:
        """Return S with r(s) = S e, Eq. (2), for the point at arc length ``point`` (m) from the clamp, (2, 4 n + 4).

        A point that is not on the beam raises an ``InputError``, here and in the following methods.
        """
        return self._interpolation(point, hermite)

    def slope_interpolation(self, point: float) -> Array:
        """Return S' with r'(s) = S' e, (2, 4 n + 4)."""
        return self._interpolation(point, hermite_slope)

    def curvature_interpolation(self, point: float) -> Array:
        """Return S'' with r''(s) = S'' e, (2, 4 n + 4), 1/m."""
        return self._interpolation(point, hermite_curvature)

    def gauss_points(self, index: int) -> tuple[float, float]:
        """Return the arc lengths of the two Gauss points of an element, m, where the strains are accurate."""
        first, second = ((index + gauss(2)[0]) * self.beam.element_length).tolist()
        return first, second

    def gauss_slopes(self, e: Array) -> Array:
        """Return r' at the two Gauss points of each element, (2, 2 n)."""
        points = [s for index in range(self.beam.elements) for s in self.gauss_points(index)]
        return np.array([self.slope_interpolation(s) @ e for s in points]).T

    def element_at(self, point: float) -> int:
        """Return the number, from 0, of the element with the point at arc length ``point`` (m)."""
        point = number(point, "point")
        if not 0.0 <= point <= self.beam.length:
            raise InputError(f"the point must be on the beam, 0 to {self.beam.length:g} m, got {point:g}", "point")
        return min(int(point / self.beam.element_length), self.beam.elements - 1)

    def _interpolation(self, point: float, functions: Callable[[Any, float], tuple[Any, ...]]) -> Array:
        index, l = self.element_at(point), self.beam.element_length
        row, first = np.zeros(self.size // 2), 2 * (index + self.root)
        row[first : first + 4] = functions(point / l - index, l)
        return np.asarray(np.kron(row, np.eye(2)), dtype=np.float64)

    def _symbols(self) -> tuple[cs.MX, cs.MX]:
        """Symbols of the nodal coordinates e and the properties P."""
        return cs.MX.sym("e", self.size), cs.MX.sym("P", len(PROPERTIES), self.beam.elements)

    def _mapped(self, name: str, p: cs.MX, *vectors: cs.MX, shared: Sequence[cs.MX] = ()) -> list[cs.MX]:
        """Evaluate an element Function for each group, from vectors at all nodes; its last inputs are ``shared``."""
        results = []
        for group in self.groups:
            function: cs.Function = getattr(group.element, name)
            same = [cs.repmat(symbol, 1, group.count) for symbol in shared]
            results.append(function.map(group.count)(*map(group.gather, vectors), group.properties(p), *same))
        return results

    def _force(self, name: str, *inputs: str, output: str = "Q", **shared: int) -> cs.Function:
        """Return the sum of an element force as a Function of vectors at all nodes, P, and shared numbers by size."""
        vectors = [cs.MX.sym(symbol, self.size) for symbol in inputs]
        same = [cs.MX.sym(symbol, size) for symbol, size in shared.items()]
        _, p = self._symbols()
        total = self.sum_at_nodes(self._mapped(name, p, *vectors, shared=same))
        return cs.Function(name, [*vectors, p, *same], [total], [*inputs, "P", *shared], [output])

    def _matrix(self, blocks: Sequence[cs.MX]) -> cs.MX:
        """Return the sum of the element matrices of each group as one sparse matrix."""
        return self.matrix(cs.vertcat(*map(cs.vec, blocks)))

    def _summary(self) -> str:
        measures = "" if self.measures == StrainMeasures() else f", {self.measures}"
        return f"{self.beam._summary()}{measures}"


def curvature_at(model: Model, s: float, at: At) -> Any:
    """Return the curvature at arc length ``s`` (m), 1/m, positive counterclockwise."""
    points = first, second = model.gauss_points(model.element_at(s))
    slopes, seconds = (
        [at(rows(point)) for point in points] for rows in (model.slope_interpolation, model.curvature_interpolation)
    )
    values = [curvature(*pair, model.measures.curvature) for pair in zip(slopes, seconds, strict=True)]
    return values[0] + (s - first) / (second - first) * (values[1] - values[0])


def axial_strains_near(model: Model, s: float, at: At) -> list[tuple[float, int, Any]]:
    """Return the two elements whose mean axial strains give that at arc length ``s`` (m): weight, number and strain."""
    model.element_at(s)
    place = s / model.beam.element_length - 0.5
    index = min(max(int(place), 0), model.beam.elements - 2)
    pairs = ((1.0 - (place - index), index), (place - index, index + 1))
    return [(weight, k, _mean_axial_strain(model, k, at)) for weight, k in pairs]


def _mean_axial_strain(model: Model, index: int, at: At) -> Any:
    strains = [axial_strain(at(model.slope_interpolation(s)), model.measures.axial) for s in model.gauss_points(index)]
    return (strains[0] + strains[1]) / 2
