"""The generalized force of a load over time on the nodes of a beam, at a fixed point or on its way along the beam.

With position r = S e and slope tau = S' e at the point, the virtual work F.dr + m dtheta of a load (Fx, Fy, m), theta =
atan2(tau_y, tau_x), gives the generalized force

    Q = S^T F + S'^T h,    h = m (-tau_y, tau_x)/|tau|^2,

and the power F.r_t + h.tau_t.  A force on its way along the beam has its place s(t) as a fourth component.  Then
Q = S(s)^T F is a function of time alone, and its rate is continuous at the nodes, as S' is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import hermite
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import Equilibrium, static_equilibrium

S = TypeVar("S", cs.SX, cs.MX)
LOAD_SIZE = 3  # components of a load: force x and y, N, and moment, N m
TIP = PointLoad()  # point and frame of a load at the tip


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


@dataclass(frozen=True, eq=False)
class PlacedLoad:
    """A load at a point of a model: its generalized force, power and stiffness."""

    model: Model
    place: PointLoad  # point and frame of the load

    def force(self, e: cs.MX, load: cs.MX) -> cs.MX:
        """Return Q of loads (3 or 4, s) on the nodes, (4 n + 4, s), for coordinates e of s states."""
        F, h = self._pair(e, load)
        return self._shape.T @ F + self._slope.T @ h

    def power(self, e: cs.MX, e_t: cs.MX, load: cs.MX) -> cs.MX:
        """Return the power F.r_t + h.tau_t, (1, s)."""
        F, h = self._pair(e, load)
        return cs.sum1((self._shape @ e_t) * F) + cs.sum1((self._slope @ e_t) * h)

    @cached_property
    def stiffness(self) -> tuple[list[int], Callable[[cs.MX, cs.MX], cs.MX]]:
        """Places in ``Model.entries`` of the entries of dQ/de that are not zero, and (e, loads) -> them, (k, s)."""
        index, _ = self.model.place_at(self.place.place(self.model.beam))
        own = self.model.groups[0].coordinates[index]
        slope, shape = (part.full()[:, own] for part in (self._slope, self._shape))
        weights = np.hstack([np.kron(slope.T, slope.T), np.kron(slope.T, shape.T)][: 1 + self.place.follower])
        used = np.flatnonzero(weights.any(axis=1))
        places = own.size**2 * index + used  # ``entries`` start with those of one element of the beam after another
        W = cs.sparsify(cs.DM(weights[used]))
        return places.tolist(), lambda e, load: W @ self._derivatives(e, load)

    def _derivatives(self, e: cs.MX, load: cs.MX) -> cs.MX:
        """Return dh/dtau and, of a follower, dF/dtau, column by column, one below the other, (4, s) each."""
        tau = cs.SX.sym("tau", 2)
        p = cs.SX.sym("p", LOAD_SIZE)
        F, h = point_force(tau, p, follower=self.place.follower)
        parts = [h, F][: 1 + self.place.follower]
        outputs = [cs.densify(cs.vertcat(*(cs.vec(cs.jacobian(part, tau)) for part in parts)))]
        return cs.Function("of_slope", [tau, p], outputs).map(e.shape[1])(self._slope @ e, load[:LOAD_SIZE, :])

    def _pair(self, e: cs.MX, load: cs.MX) -> tuple[cs.MX, cs.MX]:
        return point_force(self._slope @ e, load, follower=self.place.follower)

    @cached_property
    def _shape(self) -> cs.DM:
        """S, sparse."""
        return cs.sparsify(cs.DM(self.model.interpolation(self.place.place(self.model.beam))))

    @cached_property
    def _slope(self) -> cs.DM:
        """S', sparse."""
        return cs.sparsify(cs.DM(self.model.slope_interpolation(self.place.place(self.model.beam))))


@dataclass(frozen=True, eq=False)
class TravellingLoad:
    """A force (Fx, Fy) at the place s that is the fourth component of the load: its generalized force and power."""

    model: Model

    def force(self, e: cs.MX, load: cs.MX) -> cs.MX:
        """Return S(s)^T F of loads (4, k) on the nodes, (4 n + 4, k)."""
        beam, count = self.model.beam, self.model.beam.elements + 1
        lengths, way = beam.element_lengths, cs.repmat(load[LOAD_SIZE, :], count, 1) - cs.DM(beam.node_points)
        position, slope = cs.MX(-1.0), cs.MX(0.0)
        for sign, own in ((1.0, np.append(lengths, 1.0)), (-1.0, np.append(1.0, lengths))):  # beyond a node, before it
            of_position, of_slope, *_ = hermite(cs.fmin(cs.fmax(sign * way / cs.DM(own), 0.0), 1.0), 1.0)
            position, slope = position + of_position, slope + sign * cs.DM(own) * of_slope
        forces = [cs.repmat(load[c, :], count, 1) for c in (0, 1)]
        rows = [cs.vec(weights * force).T for weights in (position, slope) for force in forces]
        return cs.vertcat(cs.MX(NODE * self.model.root, load.shape[1]), cs.reshape(cs.vertcat(*rows), NODE * count, -1))

    def power(self, e: cs.MX, e_t: cs.MX, load: cs.MX) -> cs.MX:
        """Return the power F.r_t, (1, k), of the point of the beam under the force."""
        return cs.sum1(self.force(e, load) * e_t)


def equilibrium_under(
    model: Model, load: Array, place: PointLoad | None = TIP, further: Sequence[LineLoad] = ()
) -> Equilibrium:
    """Return the static equilibrium under gravity, a load (3 or 4,) and further ones."""
    force_x, force_y, moment, *travelled = load.tolist()
    place = PointLoad(point=travelled[0]) if place is None else place
    if place == TIP:
        return static_equilibrium(model, tip_force=(force_x, force_y), tip_moment=moment, loads=further)
    own = PointLoad((force_x, force_y), moment, place.point, place.follower)
    return static_equilibrium(model, loads=[own, *further])
