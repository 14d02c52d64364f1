"""Static condensation of a beam that supports hold beyond its beginning, or that may slide.

Where the ends of a beam cannot approach each other, bending stretches it, and it becomes stiffer with the amplitude.
The modes of bending alone do not hold this motion.  With the modes phi_i about rest, the coordinates are

    e = e_0 + sum_i phi_i q_i + 1/2 sum_ij theta_ij q_i q_j,    K theta_ij = -d^2 Q_e[phi_i, phi_j],

in which all that the modes kept do not contain, first of all the motion along the beam, follows them as in a slow
motion.  The part of theta_ij in the modes kept is removed.  The strain energy is expanded on these shapes up to the
fourth power of q, which is exact for the condensed beam because further terms of e would contribute from the fifth
power on.  The relative error of forces grows with the fourth power of the amplitude, as does that of the frequency.

With the products z = (1, q_i, q_i q_j), e = E z and the strains to second order are linear in z, and

    U = 1/2 z^T W z,        1/2 sum_i d_i s_i,t^2 = 1/2 z_t^T W_s z_t.

In the frame of the base, both components of e - u are linear in z.  The parts r of the shape are (z, 0) along x and
(0, z) along y, turned by the rotation phi of the base.  Forces y on the products have the modal forces (dz/dq)^T y, and
the strain-rate force is W_s z_t.  The tangent stiffness includes the tension that balances the forces on the parts.

References
----------
S. R. Idelsohn, A. Cardona, A reduction method for nonlinear structural dynamic analysis, Computer Methods in Applied
Mechanics and Engineering 49 (1985).
S. Jain, P. Tiso, J. B. Rutzmoser, D. J. Rixen, A quadratic manifold for model order reduction of nonlinear structural
dynamics, Computers & Structures 188 (2017).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.element import Element
from ancf_casadi.reduction.forces import (
    Expression,
    Projection,
    ReducedMotion,
    component_mass,
    mass_factor,
    projected_constants,
    repeat_rows,
    rotate_vectors,
)
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import factorise, sparse
from ancf_casadi.vibration.modes import Modes

MAX_CONDENSED_MODES = 12  # the number of terms of the strain energy grows with the fourth power


@dataclass(frozen=True, eq=False)
class CondensedProjection(Projection):
    """The constants of a condensed equation of motion; the parts are the products z of both components of E."""

    first: Array  # selects q_i of each product q_i q_j, (p, m)
    second: Array  # selects q_j, (p, m)
    energy: Array  # W, without the springs, (1 + m + p, 1 + m + p)
    dissipation: Array  # W_s, without the springs, (1 + m + p, 1 + m + p)


def condensed_projection(modes: Modes, drag_points: int) -> CondensedProjection:
    """Return the projection of the full model on its condensed shapes."""
    model, m, equilibrium = modes.model, modes.count, modes.equilibrium
    if m > MAX_CONDENSED_MODES:
        message = f"must be at most {MAX_CONDENSED_MODES} where supports hold the beam beyond its beginning, got {m}"
        raise InputError(message, "modes")
    pairs = np.array([*itertools.combinations_with_replacement(range(m), 2)])
    derivatives = _modal_derivatives(modes, pairs)
    is_mixed = pairs[:, 0] != pairs[:, 1]
    E = np.column_stack([equilibrium.coordinates, modes.shapes, derivatives * np.where(is_mixed, 1.0, 0.5)])
    shape = np.hstack([E[::2], E[1::2]])
    mass = component_mass(model)[2 * model.root :, 2 * model.root :]
    R = scipy.linalg.qr(np.linalg.cholesky(mass).T @ shape[2 * model.root :], mode="r")[0][: shape.shape[1]]
    energy, dissipation = _quadratic_forms(modes, pairs, derivatives)
    return CondensedProjection(
        **projected_constants(model, shape, drag_points),
        mass_factor=R,
        first=np.eye(m)[pairs[:, 0]],
        second=np.eye(m)[pairs[:, 1]],
        energy=energy,
        dissipation=dissipation,
    )


def _modal_derivatives(modes: Modes, pairs: Index) -> Array:
    """Return theta_ij of pairs of modes, (size, p)."""
    model, equilibrium, shapes = modes.model, modes.equilibrium, modes.shapes
    e, i, j = (cs.MX.sym(name, model.size) for name in ("e", "phi_i", "phi_j"))
    first = cs.jtimes(model.elastic_force(e, model.properties), e, i)
    second = cs.Function("second", [e, i, j], [cs.jtimes(first, e, j)])
    force = model.of_free(np.hstack([second(equilibrium.coordinates, *shapes[:, pair].T).full() for pair in pairs]))
    _, stiffness, mass = equilibrium.structure.linearisation(equilibrium.exact)
    static, free_shapes = -factorise(stiffness).solve(force), model.of_free(shapes)
    return np.asarray(model.with_fixed_base(static - free_shapes @ (free_shapes.T @ (sparse(mass) @ static))))


def _quadratic_forms(modes: Modes, pairs: Index, modal_derivatives: Array) -> tuple[Array, Array]:
    """Return W and W_s."""
    m, pair_index = modes.count, {tuple(pair): k for k, pair in enumerate(pairs.tolist())}
    tuples = [*itertools.combinations_with_replacement(range(m), 4)]
    position: dict[tuple[int, ...], int] = {indices: k for k, indices in enumerate(tuples)}
    (d1, d2, d3, d4), first, second, twice_energy = _derivatives(modes, np.array(tuples), pair_index, modal_derivatives)

    def by(derivatives: Array, *indices: int) -> Array:
        """Return the derivative by q of up to four modes, which all tuples that begin with these have."""
        indices = tuple(sorted(indices))
        return np.asarray(derivatives[..., position[indices + indices[-1:] * (4 - len(indices))]])

    multiplicity = np.where(pairs[:, 0] == pairs[:, 1], 1.0, 2.0)
    W = np.zeros((1 + m + len(pairs),) * 2)
    W[0, 0] = twice_energy
    for i in range(m):
        W[0, 1 + i] = W[1 + i, 0] = by(d1, i)
        W[1 + i, 1 : 1 + m] = [by(d2, i, j) for j in range(m)]
        W[1 + i, 1 + m :] = W[1 + m :, 1 + i] = multiplicity * [by(d3, i, *pair) for pair in pairs.tolist()] / 6
    for k, pair in enumerate(pairs.tolist()):
        W[1 + m + k, 1 + m :] = (
            multiplicity[k] * multiplicity * [by(d4, *pair, *second_pair) for second_pair in pairs.tolist()] / 12
        )
    linear_strains = [by(first, i) for i in range(m)]
    quadratic_strains = [
        factor / 2 * by(second, *pair) for factor, pair in zip(multiplicity, pairs.tolist(), strict=True)
    ]
    strains = np.array([np.zeros(len(first)), *linear_strains, *quadratic_strains])
    return W, strains @ strains.T


def _derivatives(
    modes: Modes, tuples: Index, pair_index: dict[tuple[int, ...], int], modal_derivatives: Array
) -> tuple[list[Array], Array, Array, float]:
    """Return derivatives of strain energy and strains on the shapes, without the springs.

    For each of the tuples of modes (i, j, k, l), these are the first to fourth derivative of the energy by q_i, q_i q_j
    and so on, (t,), and the first and second of the scaled strains, (strains, t); the last number is twice the energy.
    """
    model, coordinates = modes.model, modes.equilibrium.coordinates
    pair_columns = [[pair_index[pair] for pair in map(tuple, tuples[:, [a, b]].tolist())] for a, b in BETWEEN]
    energies, first, second, twice_energy = [np.zeros(len(tuples)) for _ in range(4)], [], [], 0.0
    for group in model.groups:
        if any(name.startswith("spring_") for name in group.lumped):
            continue
        properties = cs.evalf(cs.MX(group.properties(cs.DM(model.properties)))).full()
        function = _along_shapes(group.element)
        for index, p in zip(group.coordinates, properties.T, strict=True):
            vectors = [modes.shapes[index][:, tuples[:, a]] for a in range(4)]
            vectors += [modal_derivatives[index][:, columns] for columns in pair_columns]
            *terms, strain, curvature = function.call([cs.DM(x) for x in (coordinates[index], *vectors, p)])
            energies = [total + term.full().ravel() for total, term in zip(energies, terms, strict=True)]
            first.append(strain.full())
            second.append(curvature.full())
            twice_energy += 2 * float(group.element.strain_energy(coordinates[index], p))
    return energies, np.vstack(first), np.vstack(second), twice_energy


BETWEEN = [*itertools.combinations(range(4), 2)]  # pairs of the four modes of a tuple


@lru_cache(maxsize=16)
def _along_shapes(element: Element) -> cs.Function:
    """Return (e, phi_i, ..., phi_l, theta_ij, ..., theta_kl, p) -> derivatives of U, then s_i and s_ij, at q = 0."""
    size, properties = element.strain_energy.size1_in(0), element.strain_energy.size1_in(1)
    e, p, q = cs.SX.sym("e", size), cs.SX.sym("p", properties), cs.SX.sym("q", 4)
    shapes, modal_derivatives = cs.SX.sym("phi", size, 4), cs.SX.sym("theta", size, len(BETWEEN))
    products = cs.vertcat(*(q[a] * q[b] for a, b in BETWEEN))
    strains = element.scaled_strains(e + shapes @ q + modal_derivatives @ products, p)
    outputs, energy = [], cs.sumsqr(strains) / 2
    for k in range(4):
        energy = cs.jacobian(energy, q[k])
        outputs.append(energy)
    first_strain = cs.jacobian(strains, q[0])
    outputs += [first_strain, cs.jacobian(first_strain, q[1])]
    at_rest = [cs.densify(output) for output in cs.substitute(outputs, [q], [cs.SX.zeros(4)])]
    inputs = [e, *cs.horzsplit(shapes), *cs.horzsplit(modal_derivatives), p]
    return cs.Function("along_shapes", inputs, at_rest, {"cse": True})


@dataclass(frozen=True, eq=False)
class CondensedMotion(ReducedMotion):
    """A motion of a condensed beam."""

    projection: CondensedProjection

    @cached_property
    def products(self) -> Expression:
        """The products z, (1 + m + p,)."""
        return cs.vertcat(cs.DM.ones(1, self.q.size2()), self.q, self._first(self.q) * self._second(self.q))

    @cached_property
    def product_rates(self) -> Expression:
        """z_t, (1 + m + p,)."""
        return cs.vertcat(cs.DM.zeros(1, self.q.size2()), self.v, self._product_rule(self.q, self.v))

    @property
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r, each (k,)."""
        z = self.products
        return self._rotate(z, 0 * z, 0 * z, z)

    @property
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r_t, each (k,)."""
        z, z_t = self.products, self.product_rates
        turning = repeat_rows(self.base[5, :], z)
        return self._rotate(z_t, -turning * z, turning * z, z_t)

    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r_tt at q_tt = a, each (k,)."""
        z, z_t, turning = self.products, self.product_rates, repeat_rows(self.base[5, :], self.products)
        squares = 2 * self._first(self.v) * self._second(self.v)
        z_tt = cs.vertcat(cs.DM.zeros(1, self.q.size2()), a, self._product_rule(self.q, a) + squares)
        radial = z_tt - turning**2 * z
        transverse = 2 * turning * z_t + repeat_rows(self.base[8, :], z) * z
        return self._rotate(radial, -transverse, transverse, radial)

    def modal_force(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of forces (x, y) on the parts, (m,)."""
        return self._project_force(self._on_products(x, y), self.q, linear=True)

    @property
    def mass(self) -> Expression:
        """Mass matrix M(q) of the modal coordinates, (m, m), from R times the derivatives of the parts."""
        m, first, second = self.q.numel(), cs.DM(self.projection.first), cs.DM(self.projection.second)
        by_q = first * cs.repmat(second @ self.q, 1, m) + second * cs.repmat(first @ self.q, 1, m)
        change = cs.vertcat(cs.DM.zeros(1, m), cs.DM.eye(m), by_q)
        by_x, by_y = (factor @ change for factor in cs.horzsplit(mass_factor(self.projection), change.size1()))
        return by_x.T @ by_x + by_y.T @ by_y

    @property
    def elastic_force(self) -> Expression:
        """(dz/dq)^T W z, (m,)."""
        return self._project_force(cs.DM(self.projection.energy) @ self.products, self.q, linear=True)

    @property
    def strain_energy(self) -> Expression:
        """Strain energy, without that of the springs, J."""
        return cs.dot(self.products, cs.DM(self.projection.energy) @ self.products) / 2

    @property
    def strain_rate(self) -> Expression:
        """(dz/dq)^T W_s z_t, (m,)."""
        return self._project_force(cs.DM(self.projection.dissipation) @ self.product_rates, self.q, linear=True)

    def tangent_rate(self, x: Expression, y: Expression) -> Expression:
        """Return the rate of the elastic force less that of dz/dq under the forces (x, y) on the parts, (m,)."""
        W, z, z_t = cs.DM(self.projection.energy), self.products, self.product_rates
        geometric = self._project_force(W @ z - self._on_products(x, y), self.v, linear=False)
        return self._project_force(W @ z_t, self.q, linear=True) + geometric

    def _first(self, q: Expression) -> Expression:
        """Return q_i of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.first)) @ q

    def _second(self, q: Expression) -> Expression:
        """Return q_j of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.second)) @ q

    def _product_rule(self, q: Expression, v: Expression) -> Expression:
        """Return q_i v_j + v_i q_j of each product."""
        return self._first(q) * self._second(v) + self._first(v) * self._second(q)

    def _project_force(self, y: Expression, q: Expression, *, linear: bool) -> Expression:
        """Return (dz/dq)^T y, or its part that is linear in q alone."""
        m, first, second = q.size1(), self.projection.first, self.projection.second
        pair_forces = y[1 + m :, :]
        force = cs.sparsify(cs.DM(first.T)) @ (self._second(q) * pair_forces)
        force += cs.sparsify(cs.DM(second.T)) @ (self._first(q) * pair_forces)
        return y[1 : 1 + m, :] + force if linear else force

    def _rotate(
        self, x: Expression, x_of_y: Expression, y_of_x: Expression, y: Expression
    ) -> tuple[Expression, Expression]:
        """Return components (x, x_of_y) and (y_of_x, y) in the frame of the base, turned by phi."""
        return rotate_vectors(self.base[2, :], cs.vertcat(x, x_of_y), cs.vertcat(y_of_x, y))

    def _on_products(self, x: Expression, y: Expression) -> Expression:
        """Return the forces on the products of forces (x, y) on the parts."""
        back_x, back_y = rotate_vectors(-self.base[2, :], x, y)
        count = back_x.size1() // 2
        return back_x[:count, :] + back_y[count:, :]
