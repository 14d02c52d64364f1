"""The balance of forces and the mass of one element, with their derivatives to the second order.

The balance of forces R = Q_e - Q_g and the pencil K - lambda M of a structure are sums over its elements, and so are
their derivatives.  The derivatives are therefore taken once for an element with coordinates e and properties p.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs

from ancf_casadi.mechanics.element import Element
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.mechanics.strain import hermite, hermite_slope


@dataclass(frozen=True, eq=False)
class ElementBalance:
    """The balance of forces and the mass of one element, and the Functions derived from them."""

    # (e, p) -> R (d,), the elastic force minus the weight, for coordinates e (d,) and properties p (k,)
    force: cs.Function
    mass: cs.Function  # p -> mass matrix M (d, d)

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers d of coordinates and k of properties."""
        return self.force.size1_in(0), self.force.size1_in(1)

    @cached_property
    def linearisation(self) -> cs.Function:
        """(e, p) -> R, K = dR/de, dR/dp, M."""
        e, p = self._symbols()
        force = self.force(e, p)
        return _function("linearisation", [e, p], [force, cs.jacobian(force, e), cs.jacobian(force, p), self.mass(p)])

    @cached_property
    def stiffness_product(self) -> cs.Function:
        """(e, p, de, x) -> (K + (dK/de) de) x, the derivative of the force along x."""
        e, p = self._symbols()
        de, x = cs.SX.sym("de", self.sizes[0]), cs.SX.sym("x", self.sizes[0])
        along = cs.jtimes(self.force(e, p), e, x)
        return _function("stiffness_product", [e, p, de, x], [along + cs.jtimes(along, e, de)])

    @cached_property
    def pencil_jacobians(self) -> cs.Function:
        """(e, p, phi, lambda) -> d(K phi)/de, d((K - lambda M) phi)/dp, 1/2 d(phi^T M phi)/dp."""
        e, p, phi, eigenvalue, pencil, norm = self._mode()
        jacobians = [cs.jacobian(pencil, e), cs.jacobian(pencil, p), cs.jacobian(norm, p)]
        return _function("pencil_jacobians", [e, p, phi, eigenvalue], jacobians)

    @cached_property
    def force_hessian(self) -> cs.Function:
        """(e, p, z) -> d2(z^T R)/d(e, p)2."""
        e, p = self._symbols()
        z = cs.SX.sym("z", self.sizes[0])
        hessian = cs.hessian(cs.dot(z, self.force(e, p)), cs.vertcat(e, p))[0]
        return _function("force_hessian", [e, p, z], [hessian])

    @cached_property
    def pencil_hessian(self) -> cs.Function:
        """(e, p, phi, lambda, a, beta) -> d2(a^T (K - lambda M) phi - beta/2 phi^T M phi)/d(e, p, phi, lambda)2."""
        e, p, phi, eigenvalue, pencil, norm = self._mode()
        a, beta = cs.SX.sym("a", self.sizes[0]), cs.SX.sym("beta")
        lagrangian = cs.dot(a, pencil) - beta * norm
        hessian = cs.hessian(lagrangian, cs.vertcat(e, p, phi, eigenvalue))[0]
        return _function("pencil_hessian", [e, p, phi, eigenvalue, a, beta], [hessian])

    def _symbols(self) -> tuple[cs.SX, cs.SX]:
        return cs.SX.sym("e", self.sizes[0]), cs.SX.sym("p", self.sizes[1])

    def _mode(self) -> tuple[cs.SX, ...]:
        """Symbols e, p, phi, lambda, and the expressions (K - lambda M) phi and 1/2 phi^T M phi."""
        e, p = self._symbols()
        phi, eigenvalue = cs.SX.sym("phi", self.sizes[0]), cs.SX.sym("lambda")
        inertia = self.mass(p) @ phi
        pencil = cs.jtimes(self.force(e, p), e, phi) - eigenvalue * inertia
        return e, p, phi, eigenvalue, pencil, cs.dot(phi, inertia) / 2


@lru_cache(maxsize=32)
def element_balance(
    element: Element, constants: tuple[float, ...], lumped: int, gravity: tuple[float, float]
) -> ElementBalance:
    """Return the balance of an element under gravity (m/s^2).

    Its properties are a column of P, the ``constants``, which are fixed, and a number of ``lumped`` ones.
    """
    coordinates, properties = element.elastic_force.size1_in(0), element.elastic_force.size1_in(1) - len(constants)
    e, p = cs.SX.sym("e", coordinates), cs.SX.sym("p", properties)
    column, last = cs.vertsplit(p, [0, properties - lumped, properties])
    whole = cs.vertcat(column, *constants, last)
    force = element.elastic_force(e, whole) - element.gravity_force(whole, gravity)
    return ElementBalance(cs.Function("force", [e, p], [force]), cs.Function("mass", [p], [element.mass(whole)]))


@lru_cache(maxsize=32)
def load_balance(xi: float, l: float) -> ElementBalance:
    """Return the balance of an element of length l under a load p = (Fx, Fy, m) at the point xi, from 0 to 1.

    The moment m follows the slope of the point.
    """
    e, load = cs.SX.sym("e", 2 * NODE), cs.SX.sym("load", 3)
    position, slope = (cs.kron(cs.DM(values(xi, l)).T, cs.DM.eye(2)) for values in (hermite, hermite_slope))
    tangent = slope @ e
    turn = cs.gradient(cs.atan2(tangent[1], tangent[0]), e)
    force = -(position.T @ load[:2] + load[2] * turn)
    mass = cs.Function("mass", [load], [cs.DM.zeros(2 * NODE, 2 * NODE)])
    return ElementBalance(cs.Function("force", [e, load], [force]), mass)


def _function(name: str, inputs: list[cs.SX], outputs: list[cs.SX]) -> cs.Function:
    """Return a Function with dense outputs that evaluates common subexpressions once."""
    return cs.Function(name, inputs, [cs.densify(output) for output in outputs], {"cse": True})
