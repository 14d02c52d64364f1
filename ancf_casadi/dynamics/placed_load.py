"""The generalized force of a load over time on the nodes of a beam, at a fixed point or on its way along the beam.

A load (Fx, Fy, m) at a fixed point has the generalized force Q of ``mechanics.strain`` and the power Q . e_t.  A force
on its way along the beam has its place s(t) as a fourth component.  Then Q = S(s)^T F is a function of time alone, and
its rate is continuous at the nodes, as S' is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import hermite, point_force
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.statics import stable_position

LOAD_SIZE = 3  # components of a load: force x and y, N, and moment, N m
TIP = PointLoad()  # point and frame of a load at the tip


def load_force(model: Model, place: PointLoad | None, e: cs.MX, load: cs.MX) -> cs.MX:
    """Return Q of loads (3 or 4, s) at a place on the nodes, (4 n + 4, s), for coordinates e of s states.

    The place holds the point and the frame of the load; None if the load travels.
    """
    if place is None:
        return _travelling_force(model, load)
    index, _ = model.place_at(place.place(model.beam))
    coordinates = model.groups[0].coordinates[index].tolist()
    count = len(coordinates)
    rows = cs.DM.triplet(coordinates, [*range(count)], cs.DM.ones(count), model.size, count)
    return rows @ load_on_element(model, place, e[coordinates, :], load)


def load_on_element(model: Model, place: PointLoad, e: cs.MX, load: cs.MX) -> cs.MX:
    """Return Q of loads (3 or 4, s) on the element that they act on, (8, s), for its coordinates in s states."""
    index, _ = model.place_at(place.place(model.beam))
    coordinates = model.groups[0].coordinates[index].tolist()
    shape, slope = (cs.sparsify(interpolation[:, coordinates]) for interpolation in _interpolations(model, place))
    x, p = cs.SX.sym("e", len(coordinates), e.shape[1]), cs.SX.sym("load", *load.shape)
    F, h = point_force(slope @ x, p, follower=place.follower)
    force: cs.MX = cs.Function("load", [x, p], [cs.densify(shape.T @ F + slope.T @ h)])(e, load)
    return force


def load_stiffness(model: Model, place: PointLoad, e: cs.MX, load: cs.MX) -> tuple[list[int], cs.MX]:
    """Return the places in ``Model.entries`` of the entries of dQ/de that are not zero, and these entries, (k, s)."""
    index, _ = model.place_at(place.place(model.beam))
    coordinates, interpolations = model.groups[0].coordinates[index], _interpolations(model, place)
    shape, slope = (interpolation.full()[:, coordinates] for interpolation in interpolations)
    weights = np.hstack([np.kron(slope.T, slope.T), np.kron(slope.T, shape.T)][: 1 + place.follower])
    used = np.flatnonzero(weights.any(axis=1))
    places = coordinates.size**2 * index + used  # ``entries`` start with those of one element of the beam after another
    tau, p = cs.SX.sym("tau", 2), cs.SX.sym("p", LOAD_SIZE)
    F, h = point_force(tau, p, follower=place.follower)
    # dh/dtau and, of a follower, dF/dtau, column by column, one below the other
    by_slope = cs.vertcat(*(cs.vec(cs.jacobian(load_part, tau)) for load_part in [h, F][: 1 + place.follower]))
    derivatives = cs.Function("of_slope", [tau, p], [cs.densify(by_slope)]).map(e.shape[1])
    W = cs.sparsify(cs.DM(weights[used]))
    return places.tolist(), W @ derivatives(interpolations[1] @ e, load[:LOAD_SIZE, :])


def _interpolations(model: Model, place: PointLoad) -> tuple[cs.DM, cs.DM]:
    """Return S and S' at a place, sparse."""
    point = place.place(model.beam)
    return cs.sparsify(cs.DM(model.interpolation(point))), cs.sparsify(cs.DM(model.slope_interpolation(point)))


def _travelling_force(model: Model, load: cs.MX) -> cs.MX:
    """Return S(s)^T F of forces (Fx, Fy) at the place s that is the fourth component of the loads (4, k)."""
    beam, count = model.beam, model.beam.elements + 1
    lengths, way = beam.element_lengths, cs.repmat(load[LOAD_SIZE, :], count, 1) - cs.DM(beam.node_points)
    position, slope = cs.MX(-1.0), cs.MX(0.0)
    for sign, segment_lengths in (
        (1.0, np.append(lengths, 1.0)),
        (-1.0, np.append(1.0, lengths)),
    ):  # beyond a node, before it
        of_position, of_slope, *_ = hermite(cs.fmin(cs.fmax(sign * way / cs.DM(segment_lengths), 0.0), 1.0), 1.0)
        position, slope = position + of_position, slope + sign * cs.DM(segment_lengths) * of_slope
    forces = [cs.repmat(load[c, :], count, 1) for c in (0, 1)]
    rows = [cs.vec(weights * force).T for weights in (position, slope) for force in forces]
    return cs.vertcat(cs.MX(NODE * model.root, load.shape[1]), cs.reshape(cs.vertcat(*rows), NODE * count, -1))


def coordinates_at_rest(model: Model, load: Array, place: PointLoad | None, further: Sequence[LineLoad]) -> Array:
    """Return the coordinates of the stable equilibrium under gravity, a load (3 or 4,) and further ones."""
    force_x, force_y, moment, *travelled = load.tolist()
    place = PointLoad(point=travelled[0]) if place is None else place
    loads: list[Load] = [replace(place, force=(force_x, force_y), moment=moment), *further]
    return stable_position(model, tuple(load for load in loads if any(load.values)), side=1).coordinates
