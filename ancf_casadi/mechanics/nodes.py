"""The nodes of a beam, what its supports leave free, and points on the beam.

The nodal coordinates e = (r_0, tau_0, r_1, tau_1, ...) are four numbers per node in the laboratory frame.  Node 0 is
the base, b = (r_b, tau_b), whose motion is given.  A beam that a rigid clamp holds at its beginning begins with this
node; otherwise the base is a node of its own, ahead of those of the beam, to which supports and springs refer but no
element of the beam.  The supports leave the free coordinates q,

    e = N q + G b.

Each row of N has at most one entry: 1 for a coordinate that is free, and a component of the direction of sliding where
a node slides.  Forces on the free coordinates are N^T Q, and the resultant on the base is G^T Q.  The columns of N are
unit vectors, normal to those of G.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar, cast

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.strain import axial_strain, gauss, hermite, hermite_curvature, hermite_slope
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import number
from ancf_casadi.support.tables import Displayed

V = TypeVar("V")  # numbers or symbols
NODE = 4  # coordinates of a node: position and slope


def unit_velocities(size: int) -> Array:
    """Return the rates of nodal coordinates at a unit velocity along x and along y, (size, 2)."""
    return np.tile(np.eye(NODE, 2), (size // NODE, 1))


@dataclass(frozen=True)
class Nodes(Displayed):
    """The nodes of a beam; ``Model`` adds the forces."""

    beam: Beam

    @cached_property
    def root(self) -> int:
        """Number of the beam's first node: 0 if a rigid clamp holds it, else 1."""
        return int(Clamp() not in self.beam.supports)

    @property
    def size(self) -> int:
        """Number of nodal coordinates, 4 (n + 1 + root)."""
        return NODE * (self.beam.elements + 1 + self.root)

    @cached_property
    def freedoms(self) -> int:
        """Number of free coordinates q."""
        return int(self.free_of.max()) + 1

    @property
    def unit_velocities(self) -> Array:
        """Rates of the coordinates at a unit velocity along x and along y, (size, 2)."""
        return unit_velocities(self.size)

    @cached_property
    def scale(self) -> Array:
        """Typical size of each coordinate: the length of the beam for positions, 1/2 for slopes, (4 n + 4,)."""
        length = self.beam.length
        return np.tile([length, length, 0.5, 0.5], self.size // NODE)

    @cached_property
    def natural_nodes(self) -> tuple[Array, Array]:
        """Position, m, and slope of each node of the beam as manufactured, its beginning at the origin, (n + 1, 2)."""
        lengths, curvature = self.beam.element_lengths, np.array(self.beam.natural_curvature or [0.0])
        turn = lengths * curvature
        angles = np.cumsum(np.concatenate([[0.0], turn]))
        chords = lengths * np.sinc(turn / (2 * np.pi))
        middle = (angles[:-1] + angles[1:]) / 2
        steps = np.column_stack([chords * np.cos(middle), chords * np.sin(middle)])
        positions = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
        (ax, ay) = self.beam.axis
        rotation = np.array([[ax, ay], [-ay, ax]])
        return positions @ rotation, np.column_stack([np.cos(angles), np.sin(angles)]) @ rotation

    @cached_property
    def straight(self) -> Array:
        """Coordinates of the beam as manufactured, without stress, and of the base, which is at the origin."""
        axis = np.array(self.beam.axis)
        if not self.beam.natural_curvature:
            arc = np.concatenate([np.zeros(self.root), self.beam.node_points])
            return np.column_stack([np.outer(arc, axis), np.tile(axis, (arc.size, 1))]).ravel()
        nodes = np.hstack(self.natural_nodes)
        base = np.array([0.0, 0.0, *axis])
        return np.concatenate([base, nodes.ravel()]) if self.root else nodes.ravel()

    @property
    def straight_at_support(self) -> Array:
        """Coordinates of the beam as manufactured, moved as a rigid body to its first support, if it has one."""
        nodes = self.straight.reshape(-1, 2, 2).copy()  # position and slope
        for support in self.beam.supports[:1]:
            cosine, sine = math.cos(support.angle), math.sin(support.angle)
            place = self.straight[self.nodes_of(support.point)[:2]]
            nodes[self.root :, 0] -= place
            nodes[self.root :] @= np.array([[cosine, sine], [-sine, cosine]])
            nodes[self.root :, 0] += place + support.displacement
        return nodes.ravel()

    def nodes_of(self, point: float) -> Index:
        """Return the indices of the coordinates of the node at an arc length where one is placed, (4,)."""
        node = int(np.abs(self.beam.node_points - point).argmin()) + self.root
        return NODE * node + np.arange(NODE)

    @property
    def free_of(self) -> Index:
        """The number of the free coordinate that moves each nodal coordinate, -1 for one that is held, (size,)."""
        return self._supported[0]

    @property
    def weights(self) -> Array:
        """The entry of N for each nodal coordinate, 0 for one that is held, (size,)."""
        return self._supported[1]

    @property
    def whole_of_base(self) -> Array:
        """The matrix G, (size, 4)."""
        return self._supported[2]

    @cached_property
    def whole_of_free(self) -> cs.DM:
        """The matrix N, sparse, (size, N)."""
        rows = np.flatnonzero(self.weights)
        indices = rows.tolist(), self.free_of[rows].tolist()
        return cs.DM.triplet(*indices, cs.DM(self.weights[rows]), self.size, self.freedoms)

    @cached_property
    def _supported(self) -> tuple[Index, Array, Array]:
        """For each coordinate, the number of the free one that moves it, or -1; its weight; and G, (size, 4)."""
        weights, G = np.ones(self.size), np.zeros((self.size, NODE))
        weights[:NODE], G[:NODE] = 0.0, np.eye(NODE)
        leader = np.arange(self.size)  # the coordinate that stands for the free one
        for support in self.beam.supports:
            x, y, first, second = self.nodes_of(support.point)
            if first < NODE:
                continue
            place, angle = self.straight[[x, y]] + support.displacement, math.atan2(*self.straight[[second, first]])
            slope = np.array([math.cos(angle + support.angle), math.sin(angle + support.angle)])
            if support.sliding is None:
                weights[[x, y]], G[[x, y]] = 0.0, np.hstack([np.eye(2), self._base_frame_matrix(place)])
            else:
                direction = np.array(support.sliding)
                normal_projector = np.eye(2) - np.outer(direction, direction)
                weights[[x, y]] = direction
                G[[x, y]] = normal_projector @ np.hstack([np.eye(2), self._base_frame_matrix(place)])
                leader[[x, y]] = x
            if not support.turns and not math.isfinite(getattr(support, "stiffness", math.inf)):
                weights[[first, second]], G[[first, second], 2:] = 0.0, self._base_frame_matrix(slope)
        leaders = leader[weights != 0.0]
        numbers = np.full(self.size, -1)
        numbers[weights != 0.0] = np.unique(leaders, return_inverse=True)[1]
        return numbers, weights, G

    def _base_frame_matrix(self, vector: Array) -> Array:
        """Return the matrix (2, 2) that takes the slope of the base to a vector that turns with it."""
        (ax, ay), (x, y) = self.beam.axis, vector.tolist()
        cosine, sine = ax * x + ay * y, ax * y - ay * x
        return np.array([[cosine, -sine], [sine, cosine]])

    @cached_property
    def held_at_base_alone(self) -> bool:
        """True if the coordinates of the base are held and no others, so that N and G select."""
        return self.freedoms == self.size - NODE and bool((self.weights[NODE:] == 1.0).all())

    @cached_property
    def first_moved(self) -> Index:
        """The first nodal coordinate that each free coordinate moves, (N,)."""
        moving = np.flatnonzero(self.weights)
        return np.asarray(moving[np.unique(self.free_of[moving], return_index=True)[1]])

    @cached_property
    def free_scale(self) -> Array:
        """Typical size of each free coordinate, (N,)."""
        return self.scale[self.first_moved]

    def of_free(self, values: V) -> V:
        """Return N^T x of forces at all nodes, numbers or symbols, (size, ...): those on the free coordinates.

        For coordinates, velocities or accelerations that the supports allow, this is q.
        """
        x: Any = values
        symbolic = not isinstance(values, np.ndarray)
        if self.held_at_base_alone:
            q = x[NODE:, :] if symbolic else x[NODE:]
        elif symbolic:
            q = self.whole_of_free.T @ x
        else:
            q, rows = np.zeros((self.freedoms, *x.shape[1:])), np.flatnonzero(self.weights)
            np.add.at(q, self.free_of[rows], (self.weights[rows] * x[rows].T).T)
        return cast(V, q)

    def of_base(self, values: V) -> V:
        """Return G^T x of forces at all nodes, numbers or symbols, (size, ...): their resultant on the base."""
        x: Any = values
        symbolic = not isinstance(values, np.ndarray)
        if self.held_at_base_alone:
            resultant = x[:NODE, :] if symbolic else x[:NODE]
        elif symbolic:
            resultant = cs.sparsify(cs.DM(self.whole_of_base)).T @ x
        else:
            resultant = np.tensordot(self.whole_of_base.T, x, 1)
        return cast(V, resultant)

    def whole(self, q: V, base: V) -> V:
        """Return e = N q + G b for numbers or symbols: coordinates, velocities or accelerations, (size, ...)."""
        x: Any = q
        b: Any = base
        symbolic = not isinstance(q, np.ndarray)
        if self.held_at_base_alone:
            e = cs.vertcat(b, x) if symbolic else np.concatenate([b, x])
        elif symbolic:
            e = self.whole_of_free @ x + cs.sparsify(cs.DM(self.whole_of_base)) @ b
        else:
            e = (self.weights * x[self.free_of].T).T + np.tensordot(self.whole_of_base, b, 1)
        return cast(V, e)

    def with_fixed_base(self, q: V) -> V:
        """Return N q for numbers or symbols: a motion of all nodes while the base rests, (size, ...)."""
        x: Any = q
        fixed_base: Any = np.zeros((NODE, *x.shape[1:])) if isinstance(q, np.ndarray) else cs.MX(NODE, x.shape[1])
        return self.whole(q, cast(V, fixed_base))

    @cached_property
    def rigid_motion(self) -> cs.Function:
        """(e, velocity of the clamped node) -> velocities of a beam that moves with it as a rigid body."""
        e, velocity = cs.MX.sym("e", self.size), cs.MX.sym("velocity", NODE)
        nodes = cs.reshape(e, NODE, -1)
        x, y = nodes[2, 0], nodes[3, 0]
        turn = (x * velocity[3] - y * velocity[2]) / (x * x + y * y)
        arms = nodes - cs.vertcat(nodes[:2, 0], 0.0, 0.0)
        turning = cs.vertcat(-arms[1, :], arms[0, :], -arms[3, :], arms[2, :])
        moved = turn * turning + cs.vertcat(velocity[:2], 0.0, 0.0)
        return cs.Function("rigid_motion", [e, velocity], [cs.vec(moved)])

    def way_to_supports(self, e: Array) -> Array:
        """Return the way of each coordinate to the place at which a support holds it, 0 for a free one, (size,)."""
        return self.whole(self.of_free(e), np.array([0.0, 0.0, *self.beam.axis])) - e

    @cached_property
    def is_held(self) -> bool:
        """True if the supports, without any springs, hold the beam against all rigid motions."""
        nodes = self.straight.reshape(-1, 2).copy()
        rotation = np.column_stack([-nodes[:, 1], nodes[:, 0]]).ravel() / self.scale
        motions = np.column_stack([np.resize(row, self.size) for row in ([1.0, 0, 0, 0], [0, 1.0, 0, 0])] + [rotation])
        held_motions = motions - self.with_fixed_base(self.of_free(motions))
        return int(np.linalg.matrix_rank(held_motions[NODE * self.root :])) == 3

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
        begin, end = self.beam.node_points[index : index + 2]
        first, second = (begin + gauss(2)[0] * (end - begin)).tolist()
        return first, second

    @property
    def all_gauss_points(self) -> list[float]:
        """The arc lengths of the two Gauss points of each element, m."""
        return [s for index in range(self.beam.elements) for s in self.gauss_points(index)]

    def gauss_strains(self, e: Array) -> Array:
        """Return the engineering axial strain at the two Gauss points of each element, (2 n,)."""
        slopes = np.array([self.slope_interpolation(s) @ e for s in self.all_gauss_points])
        return np.asarray(axial_strain(slopes.T, "engineering"))

    def end_angles(self, e: Array) -> Array:
        """Return the angles from the slopes at both ends of each element to its chord, (..., n, 2), rad.

        They are relative to those of the beam as manufactured; their difference is the turn of the element.
        """
        return _chord_angles(e, self.root) - _chord_angles(self.straight, self.root)

    def element_at(self, point: float) -> int:
        """Return the number, from 0, of the element with the point at arc length ``point`` (m)."""
        point = number(point, "point")
        if not 0.0 <= point <= self.beam.length:
            raise InputError(f"the point must be on the beam, 0 to {self.beam.length:g} m, got {point:g}", "point")
        return min(int(np.searchsorted(self.beam.node_points, point, "right")) - 1, self.beam.elements - 1)

    def place_at(self, point: float) -> tuple[int, float]:
        """Return the number of the element with a point, and the place of the point in it, 0 to 1."""
        index = self.element_at(point)
        begin, end = self.beam.node_points[index : index + 2]
        return index, float((point - begin) / (end - begin))

    def _interpolation(self, point: float, functions: Callable[[Any, float], tuple[Any, ...]]) -> Array:
        index, xi = self.place_at(point)
        row, first = np.zeros(self.size // 2), 2 * (index + self.root)
        row[first : first + 4] = functions(xi, float(self.beam.element_lengths[index]))
        return np.asarray(np.kron(row, np.eye(2)), dtype=np.float64)


def _chord_angles(e: Array, root: int) -> Array:
    """Return the angles from the slopes at both ends of each element to its chord, (..., n, 2)."""
    nodes = e.reshape(*e.shape[:-1], -1, NODE)[..., root:, :]
    chords = np.diff(nodes[..., :2], axis=-2)[..., None, :]
    slopes = np.stack([nodes[..., :-1, 2:], nodes[..., 1:, 2:]], axis=-2)
    cross = slopes[..., 0] * chords[..., 1] - slopes[..., 1] * chords[..., 0]
    return np.asarray(np.arctan2(cross, (slopes * chords).sum(axis=-1)))
