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
    rotated,
    rows_of,
)
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import factorise, sparse
from ancf_casadi.vibration.modes import Modes

MOST_CONDENSED_MODES = 12  # the number of terms of the strain energy grows with the fourth power


@dataclass(frozen=True, eq=False)
class CondensedProjection(Projection):
    """The constants of a condensed equation of motion; the parts are the products z of both components of E."""

    first: Array  # selects q_i of each product q_i q_j, (p, m)
    second: Array  # selects q_j, (p, m)
    energy: Array  # W, without the springs, (1 + m + p, 1 + m + p)
    dissipation: Array  # W_s, without the springs, (1 + m + p, 1 + m + p)


def condensed_projection(modes: Modes, drag_points: int) -> CondensedProjection:
    """Return the projection of the full model on its condensed shapes."""
    model, m, rest = modes.model, modes.count, modes.equilibrium
    if m > MOST_CONDENSED_MODES:
        message = f"must be at most {MOST_CONDENSED_MODES} where supports hold the beam beyond its beginning, got {m}"
        raise InputError(message, "modes")
    pairs = np.array([*itertools.combinations_with_replacement(range(m), 2)])
    followed = _followed(modes, pairs)
    twice = pairs[:, 0] != pairs[:, 1]
    E = np.column_stack([rest.coordinates, modes.shapes, followed * np.where(twice, 1.0, 0.5)])
    shape = np.hstack([E[::2], E[1::2]])
    mass = component_mass(model)[2 * model.root :, 2 * model.root :]
    R = scipy.linalg.qr(np.linalg.cholesky(mass).T @ shape[2 * model.root :], mode="r")[0][: shape.shape[1]]
    energy, dissipation = _quadratic_forms(modes, pairs, followed)
    return CondensedProjection(
        **projected_constants(model, shape, drag_points),
        mass_factor=R,
        first=np.eye(m)[pairs[:, 0]],
        second=np.eye(m)[pairs[:, 1]],
        energy=energy,
        dissipation=dissipation,
    )


def _followed(modes: Modes, pairs: Index) -> Array:
    """Return theta_ij of pairs of modes, (size, p)."""
    model, rest, shapes = modes.model, modes.equilibrium, modes.shapes
    e, i, j = (cs.MX.sym(name, model.size) for name in ("e", "phi_i", "phi_j"))
    once = cs.jtimes(model.elastic_force(e, model.properties), e, i)
    second = cs.Function("second", [e, i, j], [cs.jtimes(once, e, j)])
    force = model.of_free(np.hstack([second(rest.coordinates, *shapes[:, pair].T).full() for pair in pairs]))
    _, stiffness, mass = rest.structure.linearisation(rest.exact)
    moved, kept = -factorise(stiffness).solve(force), model.of_free(shapes)
    return np.asarray(model.moved(moved - kept @ (kept.T @ (sparse(mass) @ moved))))


def _quadratic_forms(modes: Modes, pairs: Index, followed: Array) -> tuple[Array, Array]:
    """Return W and W_s."""
    m, place = modes.count, {tuple(pair): k for k, pair in enumerate(pairs.tolist())}
    tuples = [*itertools.combinations_with_replacement(range(m), 4)]
    number: dict[tuple[int, ...], int] = {own: k for k, own in enumerate(tuples)}
    derivatives, first, second, rest = _derivatives(modes, np.array(tuples), place, followed)
    one, two, three, four = derivatives
    times = np.where(pairs[:, 0] == pairs[:, 1], 1.0, 2.0)
    linear, W = 1 + np.arange(m), np.zeros((1 + m + len(pairs),) * 2)
    W[0, 0] = rest
    for i in range(m):
        W[0, 1 + i] = W[1 + i, 0] = one[number[i, i, i, i]]
        W[1 + i, linear] = [two[number[(*sorted((i, j)), *(2 * (max(i, j),)))]] for j in range(m)]
        cubic = [three[number[(*sorted((i, *pair)), max(i, *pair))]] for pair in pairs.tolist()]
        W[1 + i, 1 + m :] = W[1 + m :, 1 + i] = times * cubic / 6
    for k, pair in enumerate(pairs.tolist()):
        quartic = [four[number[tuple(sorted((*pair, *other)))]] for other in pairs.tolist()]
        W[1 + m + k, 1 + m :] = times[k] * times * quartic / 12
    strains = np.column_stack(
        [
            np.zeros(len(first)),
            *(first[:, number[i, i, i, i]] for i in range(m)),
            *(own / 2 * second[:, number[i, j, j, j]] for own, (i, j) in zip(times, pairs.tolist(), strict=True)),
        ]
    )
    return W, strains.T @ strains


def _derivatives(
    modes: Modes, tuples: Index, place: dict[tuple[int, ...], int], followed: Array
) -> tuple[list[Array], Array, Array, float]:
    """Return derivatives of strain energy and strains on the shapes, without the springs.

    For each of the tuples of modes (i, j, k, l), these are the first to fourth derivative of the energy by q_i, q_i q_j
    and so on, (t,), and the first and second of the scaled strains, (strains, t); the last number is twice the energy.
    """
    model, rest = modes.model, modes.equilibrium.coordinates
    between = [[place[own] for own in map(tuple, tuples[:, [a, b]].tolist())] for a, b in BETWEEN]
    energies, first, second, twice = [np.zeros(len(tuples)) for _ in range(4)], [], [], 0.0
    for group in model.groups:
        if any(name.startswith("spring_") for name in group.lumped):
            continue
        properties = cs.evalf(cs.MX(group.properties(cs.DM(model.properties)))).full()
        function = _along_shapes(group.element)
        for index, p in zip(group.coordinates, properties.T, strict=True):
            vectors = [modes.shapes[index][:, tuples[:, a]] for a in range(4)]
            vectors += [followed[index][:, own] for own in between]
            *own, strain, curvature = function.call([cs.DM(x) for x in (rest[index], *vectors, p)])
            energies = [total + part.full().ravel() for total, part in zip(energies, own, strict=True)]
            first.append(strain.full())
            second.append(curvature.full())
            twice += 2 * float(group.element.strain_energy(rest[index], p))
    return energies, np.vstack(first), np.vstack(second), twice


BETWEEN = [*itertools.combinations(range(4), 2)]  # pairs of the four modes of a tuple


@lru_cache(maxsize=16)
def _along_shapes(element: Element) -> cs.Function:
    """Return (e, phi_i, ..., phi_l, theta_ij, ..., theta_kl, p) -> derivatives of U, then s_i and s_ij, at q = 0."""
    size, properties = element.strain_energy.size1_in(0), element.strain_energy.size1_in(1)
    e, p, q = cs.SX.sym("e", size), cs.SX.sym("p", properties), cs.SX.sym("q", 4)
    shapes, followed = cs.SX.sym("phi", size, 4), cs.SX.sym("theta", size, len(BETWEEN))
    products = cs.vertcat(*(q[a] * q[b] for a, b in BETWEEN))
    strains = element.scaled_strains(e + shapes @ q + followed @ products, p)
    found, energy = [], cs.sumsqr(strains) / 2
    for k in range(4):
        energy = cs.jacobian(energy, q[k])
        found.append(energy)
    once = cs.jacobian(strains, q[0])
    found += [once, cs.jacobian(once, q[1])]
    at_rest = [cs.densify(part) for part in cs.substitute(found, [q], [cs.SX.zeros(4)])]
    inputs = [e, *cs.horzsplit(shapes), *cs.horzsplit(followed), p]
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
        return cs.vertcat(cs.DM.zeros(1, self.q.size2()), self.v, self._mixed(self.q, self.v))

    @property
    def parts(self) -> tuple[Expression, Expression]:
        """Components of r, each (k,)."""
        z = self.products
        return self._turned(z, 0 * z, 0 * z, z)

    @property
    def part_rates(self) -> tuple[Expression, Expression]:
        """Components of r_t, each (k,)."""
        z, z_t = self.products, self.product_rates
        turning = rows_of(self.base[5, :], z)
        return self._turned(z_t, -turning * z, turning * z, z_t)

    def part_accelerations(self, a: Expression) -> tuple[Expression, Expression]:
        """Return the components of r_tt at q_tt = a, each (k,)."""
        z, z_t, turning = self.products, self.product_rates, rows_of(self.base[5, :], self.products)
        squares = 2 * self._first(self.v) * self._second(self.v)
        z_tt = cs.vertcat(cs.DM.zeros(1, self.q.size2()), a, self._mixed(self.q, a) + squares)
        along = z_tt - turning**2 * z
        across = 2 * turning * z_t + rows_of(self.base[8, :], z) * z
        return self._turned(along, -across, across, along)

    def modal_force(self, x: Expression, y: Expression) -> Expression:
        """Return the modal forces of forces (x, y) on the parts, (m,)."""
        return self._pulled(self._on_products(x, y), self.q, linear=True)

    @property
    def mass(self) -> Expression:
        """Mass matrix M(q) of the modal coordinates, (m, m), from R times the derivatives of the parts."""
        m, first, second = self.q.numel(), cs.DM(self.projection.first), cs.DM(self.projection.second)
        by_q = first * cs.repmat(second @ self.q, 1, m) + second * cs.repmat(first @ self.q, 1, m)
        change = cs.vertcat(cs.DM.zeros(1, m), cs.DM.eye(m), by_q)
        by_x, by_y = (own @ change for own in cs.horzsplit(mass_factor(self.projection), change.size1()))
        return by_x.T @ by_x + by_y.T @ by_y

    @property
    def elastic_force(self) -> Expression:
        """(dz/dq)^T W z, (m,)."""
        return self._pulled(cs.DM(self.projection.energy) @ self.products, self.q, linear=True)

    @property
    def strain_energy(self) -> Expression:
        """Strain energy, without that of the springs, J."""
        return cs.dot(self.products, cs.DM(self.projection.energy) @ self.products) / 2

    @property
    def strain_rate(self) -> Expression:
        """(dz/dq)^T W_s z_t, (m,)."""
        return self._pulled(cs.DM(self.projection.dissipation) @ self.product_rates, self.q, linear=True)

    def tangent_rate(self, x: Expression, y: Expression) -> Expression:
        """Return the rate of the elastic force less that of dz/dq under the forces (x, y) on the parts, (m,)."""
        W, z, z_t = cs.DM(self.projection.energy), self.products, self.product_rates
        changed = self._pulled(W @ z - self._on_products(x, y), self.v, linear=False)
        return self._pulled(W @ z_t, self.q, linear=True) + changed

    def _first(self, q: Expression) -> Expression:
        """Return q_i of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.first)) @ q

    def _second(self, q: Expression) -> Expression:
        """Return q_j of each product q_i q_j."""
        return cs.sparsify(cs.DM(self.projection.second)) @ q

    def _mixed(self, q: Expression, v: Expression) -> Expression:
        """Return q_i v_j + v_i q_j of each product."""
        return self._first(q) * self._second(v) + self._first(v) * self._second(q)

    def _pulled(self, y: Expression, q: Expression, *, linear: bool) -> Expression:
        """Return (dz/dq)^T y, or its part that is linear in q alone."""
        m, first, second = q.size1(), self.projection.first, self.projection.second
        on_pairs = y[1 + m :, :]
        by_pairs = cs.sparsify(cs.DM(first.T)) @ (self._second(q) * on_pairs)
        by_pairs += cs.sparsify(cs.DM(second.T)) @ (self._first(q) * on_pairs)
        return y[1 : 1 + m, :] + by_pairs if linear else by_pairs

    def _turned(
        self, x: Expression, x_of_y: Expression, y_of_x: Expression, y: Expression
    ) -> tuple[Expression, Expression]:
        """Return components (x, x_of_y) and (y_of_x, y) in the frame of the base, turned by phi."""
        return rotated(self.base[2, :], cs.vertcat(x, x_of_y), cs.vertcat(y_of_x, y))

    def _on_products(self, x: Expression, y: Expression) -> Expression:
        """Return the forces on the products of forces (x, y) on the parts."""
        back_x, back_y = rotated(-self.base[2, :], x, y)
        count = back_x.size1() // 2
        return back_x[:count, :] + back_y[count:, :]
