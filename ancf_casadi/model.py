"""The beam as one symbolic model: assembly of the elements, the clamp, and points on the beam.

The nodal coordinates e = (r_0, tau_0, r_1, tau_1, ..., r_n, tau_n), 4 (n + 1) numbers in the laboratory frame, are
shared by neighbouring elements.  Forces and matrices add up over the elements,

    M e_tt + Q_damp(e, e_t) + Q_e(e) = Q_g,                  Eq. (6), with damping on the left,

and node 0, position and slope, is clamped: the ``free`` coordinates are those of the other nodes.  The element
Functions are mapped over the elements, never expanded here, so graphs stay small and all derivatives sparse.
A tip mass m adds m r_tt and its weight at the last node.  Where the clamp is elastic, the base is a further node ahead
of the beam's own, 4 (n + 2) numbers in all, and the clamp one more element between the two.

The properties P are a matrix with one column (width, thickness, density, elastic modulus) an element, so that
every Function here is symbolic in them too; ``Model.properties`` holds the beam's own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.beam import PROPERTIES, Beam
from ancf_casadi.clamp import elastic_clamp
from ancf_casadi.element import Element, StrainMeasures, element
from ancf_casadi.exceptions import InputError
from ancf_casadi.inputs import check_instance, number
from ancf_casadi.shape import gauss, hermite, hermite_curvature, hermite_slope

NODE = 4  # coordinates of a node: position and slope


@dataclass(frozen=True)
class Model:
    """A beam as symbolic equations of motion.

    Each Function takes nodal coordinates e (4 n + 4, or 4 n + 8 behind an elastic clamp), rates e_t, and properties
    P (4, n).

    Parameters
    ----------
    beam : Beam
        What is modelled.
    measures : StrainMeasures
        The strain measures of Eq. (8).

    Raises
    ------
    InputError
        If one is of another class.
    """

    beam: Beam
    measures: StrainMeasures = field(default_factory=StrainMeasures)

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.beam, "beam", Beam)
        check_instance(self.measures, "measures", StrainMeasures)

    def __reduce__(self) -> tuple[type[Model], tuple[Beam, StrainMeasures]]:
        """Travel between processes without the Functions, which are derived again there."""
        return Model, (self.beam, self.measures)

    @property
    def root(self) -> int:
        """Number of the beam's first node: 0, or 1 behind an elastic clamp."""
        return int(math.isfinite(self.beam.clamp_stiffness))

    @property
    def size(self) -> int:
        """Number of nodal coordinates, 4 (n + 1 + root)."""
        return NODE * (self.beam.elements + 1 + self.root)

    @property
    def free(self) -> slice:
        """The coordinates that the clamp leaves free."""
        return slice(NODE, self.size)

    @cached_property
    def scale(self) -> NDArray[np.float64]:
        """What a coordinate is measured by: the length of the beam for positions, 1/2 for slopes, (4 n + 4,)."""
        length = self.beam.length
        return np.tile([length, length, 0.5, 0.5], self.size // NODE)

    @cached_property
    def properties(self) -> NDArray[np.float64]:
        """The beam's properties P, (4, n)."""
        return np.array([getattr(self.beam, name) for name in PROPERTIES])

    @cached_property
    def straight(self) -> NDArray[np.float64]:
        """Coordinates of the beam as manufactured: straight along its axis, unstretched, clamp at the origin."""
        axis = np.array(self.beam.axis)
        arc = np.concatenate([np.zeros(self.root), np.linspace(0.0, self.beam.length, self.beam.elements + 1)])
        return np.column_stack([np.outer(arc, axis), np.tile(axis, (arc.size, 1))]).ravel()

    @cached_property
    def element(self) -> Element:
        """The Functions of one element."""
        return element(self.beam.element_length, self.measures)

    @cached_property
    def clamp(self) -> Element | None:
        """The Functions of the elastic clamp; None where it is rigid."""
        return elastic_clamp(self.beam.clamp_stiffness, self.beam.element_length) if self.root else None

    @cached_property
    def strain_energy(self) -> cs.Function:
        """(e, P) -> U, J, Eq. (8)."""
        e, p = self._symbols()
        energy = cs.sum2(self.element.strain_energy.map(self.beam.elements)(self.gather(e), p))
        if self.clamp is not None:
            energy += self.clamp.strain_energy(e[: 2 * NODE], p[:, 0])
        return cs.Function("strain_energy", [e, p], [energy], ["e", "P"], ["U"])

    @cached_property
    def elastic_force(self) -> cs.Function:
        """(e, P) -> Q_e, Eq. (6)."""
        return self._force("elastic_force", "e", output="Q_e")

    @cached_property
    def tangent_stiffness(self) -> cs.Function:
        """(e, P) -> K = dQ_e/de, sparse."""
        e, p = self._symbols()
        blocks = self.element.tangent_stiffness.map(self.beam.elements)(self.gather(e), p)
        if self.clamp is not None:
            blocks = cs.horzcat(self.clamp.tangent_stiffness(e[: 2 * NODE], p[:, 0]), blocks)
        return cs.Function("tangent_stiffness", [e, p], [self._scatter_matrix(blocks)], ["e", "P"], ["K"])

    @cached_property
    def tangent_force(self) -> cs.Function:
        """(e, e_t, P) -> K e_t, the rate of the elastic force."""
        return self._force("tangent_force", "e", "e_t")

    @cached_property
    def strain_rate_force(self) -> cs.Function:
        """(e, e_t, P) -> Q_v, the objective Kelvin-Voigt force a unit of time constant."""
        return self._force("strain_rate_force", "e", "e_t")

    @cached_property
    def drag_force(self) -> cs.Function:
        """(e_t, P) -> int S^T mu |v| v dp, the integral in Eq. (23)."""
        return self._force("drag_force", "e_t")

    @cached_property
    def mass(self) -> cs.Function:
        """P -> M, Eq. (7), sparse."""
        _, p = self._symbols()
        blocks = self.element.mass.map(self.beam.elements)(p)
        if self.clamp is not None:
            blocks = cs.horzcat(self.clamp.mass(p[:, 0]), blocks)
        mass = self._scatter_matrix(blocks)
        if self.beam.tip_mass:
            tip = cs.DM(self.interpolation(self.beam.length))
            mass += self.beam.tip_mass * (cs.sparsify(tip).T @ cs.sparsify(tip))
        return cs.Function("mass", [p], [mass], ["P"], ["M"])

    @cached_property
    def line_inertia_force(self) -> cs.Function:
        """(e_tt, P) -> int S^T mu r_tt dp, or any other rate: the beam's own share of M e_tt."""
        return self._force("line_inertia_force", "e_tt", of="inertia_force")

    @cached_property
    def inertia_force(self) -> cs.Function:
        """(e_tt, P) -> M e_tt, or any other rate."""
        _, p = self._symbols()
        e_tt = cs.MX.sym("e_tt", self.size)
        force = self.line_inertia_force(e_tt, p) + self._at_tip(self.beam.tip_mass * e_tt[-NODE:-2])
        return cs.Function("inertia_force", [e_tt, p], [force], ["e_tt", "P"], ["Q"])

    @cached_property
    def gravity_force(self) -> cs.Function:
        """(P, g) -> Q_g, Eq. (7); g is the acceleration of gravity (2), m/s^2."""
        _, p = self._symbols()
        g = cs.MX.sym("g", 2)
        forces = self.element.gravity_force.map(self.beam.elements)(p, cs.repmat(g, 1, self.beam.elements))
        force = self.scatter(forces) + self._at_tip(self.beam.tip_mass * g)
        return cs.Function("gravity_force", [p, g], [force], ["P", "g"], ["Q_g"])

    def gather(self, e: cs.MX) -> cs.MX:
        """Return the coordinates of each element as columns, (8, n)."""
        nodes = cs.reshape(e, NODE, -1)[:, self.root :]
        return cs.vertcat(nodes[:, :-1], nodes[:, 1:])

    def scatter(self, columns: cs.MX) -> cs.MX:
        """Return the sum at the nodes of element forces (8, n), (4 n + 4,)."""
        none = cs.MX(NODE, 1)
        forces = cs.vec(cs.horzcat(columns[:NODE, :], none) + cs.horzcat(none, columns[NODE:, :]))
        return cs.vertcat(cs.MX(NODE * self.root, 1), forces)

    def interpolation(self, s: float) -> NDArray[np.float64]:
        """Return S with r(s) = S e for the material point at arc length ``s`` (m) from the clamp, (2, 4 n + 4).

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return self._interpolation(s, hermite)

    def slope_interpolation(self, s: float) -> NDArray[np.float64]:
        """Return S' with r'(s) = S' e, (2, 4 n + 4).

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return self._interpolation(s, hermite_slope)

    def curvature_interpolation(self, s: float) -> NDArray[np.float64]:
        """Return S'' with r''(s) = S'' e, (2, 4 n + 4), 1/m.

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return self._interpolation(s, hermite_curvature)

    def gauss_slopes(self, e: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return r' at the two Gauss points of each element, (2, 2 n), where the strains are accurate."""
        l = self.beam.element_length
        points = ((np.arange(self.beam.elements)[:, None] + gauss(2)[0]) * l).ravel()
        return np.array([self.slope_interpolation(float(s)) @ e for s in points]).T

    def element_of(self, s: float) -> int:
        """Return the number, from 0, of the element with the point at arc length ``s`` (m).

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        s = number(s, "s")
        if not 0.0 <= s <= self.beam.length:
            raise InputError(f"the point must be on the beam, 0 to {self.beam.length:g} m, got {s:g}", "s")
        return min(int(s / self.beam.element_length), self.beam.elements - 1)

    def _interpolation(self, s: float, functions: Any) -> NDArray[np.float64]:
        index, l = self.element_of(s), self.beam.element_length
        row, first = np.zeros(self.size // 2), 2 * (index + self.root)
        row[first : first + 4] = functions(s / l - index, l)
        return np.asarray(np.kron(row, np.eye(2)), dtype=np.float64)

    def _symbols(self) -> tuple[cs.MX, cs.MX]:
        """Nodal coordinates and properties."""
        return cs.MX.sym("e", self.size), cs.MX.sym("P", len(PROPERTIES), self.beam.elements)

    def _force(self, name: str, *inputs: str, of: str = "", output: str = "Q") -> cs.Function:
        """Sum up at the nodes a force of the elements, a function of nodal coordinates or rates and the properties."""
        vectors = [cs.MX.sym(symbol, self.size) for symbol in inputs]
        _, p = self._symbols()
        element: cs.Function = getattr(self.element, of or name)
        force = self.scatter(element.map(self.beam.elements)(*map(self.gather, vectors), p))
        if self.clamp is not None:
            own = getattr(self.clamp, of or name)(*(vector[: 2 * NODE] for vector in vectors), p[:, 0])
            force += cs.vertcat(own, cs.MX(self.size - 2 * NODE, 1))
        return cs.Function(name, [*vectors, p], [force], [*inputs, "P"], [output])

    def _at_tip(self, vector: cs.MX) -> cs.MX:
        """Return the generalized force of a force (2,) at the tip."""
        return cs.vertcat(cs.MX(self.size - NODE, 1), vector, cs.MX(2, 1))

    def _scatter_matrix(self, blocks: cs.MX) -> cs.MX:
        """Sum of the matrices (8, 8) of the clamp, where it is elastic, and of the elements as one sparse matrix."""
        size, count = 2 * NODE, blocks.size2() // (2 * NODE)
        local = np.arange(size)
        row, column = np.tile(local, size), np.repeat(local, size)
        offset = NODE * np.repeat(np.arange(count), size * size)
        rows, columns = offset + np.tile(row, count), offset + np.tile(column, count)
        pairs, target = np.unique(np.column_stack([columns, rows]), axis=0, return_inverse=True)
        pattern = cs.Sparsity.triplet(self.size, self.size, pairs[:, 1].tolist(), pairs[:, 0].tolist())
        sums = cs.Sparsity.triplet(len(pairs), target.size, target.ravel().tolist(), list(range(target.size)))
        return cs.MX(pattern, cs.mtimes(cs.MX(cs.DM(sums, 1.0)), cs.vec(blocks)))
