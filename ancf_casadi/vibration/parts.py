"""A structure as parts made of equal pieces: forces and masses of one piece, their derivatives, and where they belong.

What is a sum over pieces, the balance of forces R and the pencil K - lambda M, has derivatives that are sums too.  They
are derived once for a piece with coordinates e and properties p, to the second order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.clamp import elastic_clamp
from ancf_casadi.mechanics.element import StrainMeasures, element
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.compilation import Buffered

AXIS = cs.DM([1.0, 0.0])  # no balance and no mass depends on it


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of a structure by its forces and its mass, and what is derived from them.

    Parameters
    ----------
    force : casadi.Function
        (e, p) -> elastic force less gravity (d,), of coordinates (d,) and properties (k,).
    mass : casadi.Function
        p -> mass matrix (d, d).
    """

    force: cs.Function
    mass: cs.Function

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers d of coordinates and k of properties."""
        return self.force.size1_in(0), self.force.size1_in(1)

    @cached_property
    def balance(self) -> cs.Function:
        """(e, p) -> R, K, dR/dp, M."""
        e, p = self._symbols()
        force = self.force(e, p)
        outputs = [force, cs.jacobian(force, e), cs.jacobian(force, p), self.mass(p)]
        return cs.Function("balance", [e, p], [cs.densify(output) for output in outputs], {"cse": True})

    @cached_property
    def stiffness_product(self) -> cs.Function:
        """(e, p, de, x) -> (K + (dK/de) de) x, the derivative of the force along x."""
        e, p = self._symbols()
        de, x = cs.SX.sym("de", self.sizes[0]), cs.SX.sym("x", self.sizes[0])
        along = cs.jtimes(self.force(e, p), e, x)
        product = cs.densify(along + cs.jtimes(along, e, de))
        return cs.Function("stiffness_product", [e, p, de, x], [product], {"cse": True})

    @cached_property
    def pencil_jacobians(self) -> cs.Function:
        """(e, p, phi, lambda) -> d(K phi)/de, d((K - lambda M) phi)/dp, 1/2 d(phi^T M phi)/dp."""
        e, p, phi, eigenvalue, pencil, norm = self._mode()
        outputs = [cs.jacobian(pencil, e), cs.jacobian(pencil, p), cs.jacobian(norm, p)]
        return cs.Function(
            "pencil_jacobians", [e, p, phi, eigenvalue], [cs.densify(output) for output in outputs], {"cse": True}
        )

    @cached_property
    def force_curvature(self) -> cs.Function:
        """(e, p, z) -> d2(z^T R)/d(e, p)2."""
        e, p = self._symbols()
        z = cs.SX.sym("z", self.sizes[0])
        hessian = cs.hessian(cs.dot(z, self.force(e, p)), cs.vertcat(e, p))[0]
        return cs.Function("force_curvature", [e, p, z], [cs.densify(hessian)], {"cse": True})

    @cached_property
    def pencil_curvature(self) -> cs.Function:
        """(e, p, phi, lambda, a, beta) -> d2(a^T (K - lambda M) phi - beta/2 phi^T M phi)/d(e, p, phi, lambda)2."""
        e, p, phi, eigenvalue, pencil, norm = self._mode()
        a, beta = cs.SX.sym("a", self.sizes[0]), cs.SX.sym("beta")
        lagrangian = cs.dot(a, pencil) - beta * norm
        hessian = cs.hessian(lagrangian, cs.vertcat(e, p, phi, eigenvalue))[0]
        return cs.Function("pencil_curvature", [e, p, phi, eigenvalue, a, beta], [cs.densify(hessian)], {"cse": True})

    def _symbols(self) -> tuple[cs.SX, cs.SX]:
        return cs.SX.sym("e", self.sizes[0]), cs.SX.sym("p", self.sizes[1])

    def _mode(self) -> tuple[cs.SX, ...]:
        """Symbols e, p, phi, lambda, and (K - lambda M) phi and 1/2 phi^T M phi."""
        e, p = self._symbols()
        phi, eigenvalue = cs.SX.sym("phi", self.sizes[0]), cs.SX.sym("lambda")
        inertia = self.mass(p) @ phi
        pencil = cs.jtimes(self.force(e, p), e, phi) - eigenvalue * inertia
        return e, p, phi, eigenvalue, pencil, cs.dot(phi, inertia) / 2


@dataclass(frozen=True, eq=False)
class Part:
    """Equal pieces of a structure, and where their coordinates and properties are.

    Parameters
    ----------
    piece : Piece
        One of them.
    coordinates : array (pieces, d)
        Which of the structure's coordinates each sees.
    properties : array (pieces, k)
        Which of the structure's properties.
    """

    piece: Piece
    coordinates: Index
    properties: Index


def structure_properties(model: Model) -> Array:
    """Return all properties: those of the elements row by row, the tip mass, the clamp stiffness (0 if rigid)."""
    lumped = [model.beam.tip_mass, model.beam.clamp_stiffness if model.root else 0.0]
    return np.concatenate([model.properties.ravel(), lumped])


def beam_parts(model: Model) -> tuple[Part, ...]:
    """Return the parts of a model; their properties are those of ``structure_properties``."""
    n, beam = model.beam.elements, model.beam
    elements = np.arange(n)[:, None]
    of_element = n * np.arange(len(PROPERTIES))
    piece = _element_piece(beam.element_length, model.measures, beam.gravity)
    parts = [Part(piece, NODE * (elements + model.root) + np.arange(2 * NODE), elements + of_element)]
    if beam.tip_mass:
        tip = np.arange(model.size - NODE, model.size - 2)
        parts.append(Part(_tip_piece(beam.gravity), tip[None, :], np.array([[n * len(PROPERTIES)]])))
    if model.root:
        given = np.append(of_element, n * len(PROPERTIES) + 1)
        parts.append(Part(_clamp_piece(beam.element_length), np.arange(2 * NODE)[None, :], given[None, :]))
    return tuple(parts)


def tip_load_part(model: Model, first: int) -> Part:
    """Return a load at the tip, its properties (Fx, Fy, m) being those from number ``first`` on."""
    tip = np.arange(model.size - NODE, model.size)
    return Part(_load_piece(), tip[None, :], first + np.arange(3)[None, :])


@lru_cache(maxsize=1)
def _load_piece() -> Piece:
    """Return a force and a moment, which follows the slope of the node."""
    e, load = cs.SX.sym("e", NODE), cs.SX.sym("load", 3)
    theta = cs.atan2(e[3], e[2])
    force = -cs.vertcat(load[:2], load[2] * cs.gradient(theta, e[2:]))
    return Piece(cs.Function("force", [e, load], [force]), cs.Function("mass", [load], [cs.DM.zeros(NODE, NODE)]))


@lru_cache(maxsize=8)
def _tip_piece(gravity: tuple[float, float]) -> Piece:
    e, m = cs.SX.sym("e", 2), cs.SX.sym("m")
    force, mass = -m * cs.DM(gravity), m * cs.SX.eye(2)
    return Piece(cs.Function("force", [e, m], [force]), cs.Function("mass", [m], [cs.densify(mass)]))


@lru_cache(maxsize=8)
def _clamp_piece(length: float) -> Piece:
    """Return a clamp, whose last property is its stiffness."""
    e, p, k = cs.SX.sym("e", 2 * NODE), cs.SX.sym("p", len(PROPERTIES)), cs.SX.sym("k")
    given = cs.vertcat(p, k)
    force = elastic_clamp().elastic_force(e, cs.vertcat(p, length, AXIS, k))
    mass = cs.Function("mass", [given], [cs.DM.zeros(2 * NODE, 2 * NODE)])
    return Piece(cs.Function("force", [e, given], [force]), mass)


@lru_cache(maxsize=8)
def _element_piece(length: float, measures: StrainMeasures, gravity: tuple[float, float]) -> Piece:
    functions = element(measures)
    e, p = cs.SX.sym("e", 2 * NODE), cs.SX.sym("p", len(PROPERTIES))
    whole = cs.vertcat(p, length, AXIS)
    balance = functions.elastic_force(e, whole) - functions.gravity_force(whole, gravity)
    return Piece(cs.Function("force", [e, p], [balance]), cs.Function("mass", [p], [functions.mass(whole)]))


def blocks(function: cs.Function, *inputs: Array) -> list[Array]:
    """Call a Function for each piece, inputs as rows; return its outputs, each (pieces, rows, columns)."""
    pieces = len(inputs[0])
    evaluate = Buffered(_mapped(function, pieces), *(np.ascontiguousarray(values) for values in inputs))
    return [output.reshape(pieces, -1, function.size1_out(k)).transpose(0, 2, 1) for k, output in enumerate(evaluate())]


@lru_cache(maxsize=64)
def _mapped(function: cs.Function, pieces: int) -> cs.Function:
    return function.map(pieces)
