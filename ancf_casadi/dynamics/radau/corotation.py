"""Corrections, residuals and predictions in coordinates that turn with the beam.

The axial stiffness of a thin beam is thousands of times its bending stiffness, and its direction turns with the beam:
matrices evaluated in one configuration are of little use in the next.  The axial strains, however, depend only on the
lengths of the slopes r' at the two Gauss points g = 1/2 -+ sqrt(3)/6 of each element, and these slopes determine the
nodes: r' is quadratic in an element of length l, so that

    r_k+1 = r_k + l/2 (r'_1 + r'_2),    tau_k+1 = tau_k + (r'_2 - r'_1)/(g_2 - g_1).

Corrections.  G maps the free coordinates to these slopes, and R turns each slope by the angle between two
configurations.  X = G^-1 R G then takes corrections from one configuration to the other: the axial stiffness X^T K X is
the same in both, inertia and bending are nearly so.  Residuals go the other way, by X^T.

Prediction.  A motion is extrapolated in the logarithms of the slopes, log length and angle, so that errors of the
angles do not stretch the beam.

A link joins two nodes.  It is an element, whose pair of vectors are the slopes at its Gauss points, or joins a base of
its own to the first node of the beam, and then its pair of vectors are the position and slope of this node.  The
Functions of a link take positions in units of l, so that their machine code serves all meshes.

A beam that supports hold beyond its beginning turns little.  Corrections that turn with it would not end at these
supports; there X is 1, and the coordinates themselves are extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import mapped, side_by_side
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import gauss, hermite_slope
from ancf_casadi.support.arrays import Array, Index


@dataclass(frozen=True, eq=False)
class Corotation:
    """Rotation of vectors from a reference to several configurations of a beam, such as the stages of a step.

    Turns are arrays (4 c, links) for c configurations.
    """

    model: Model
    configurations: int  # their number c
    make: Callable[[cs.Function], cs.Function]  # compiles a Function, or leaves it to the virtual machine

    @cached_property
    def links(self) -> int:
        """Number of links; 0 if supports hold the beam beyond its beginning."""
        model = self.model
        beyond = slice(NODE * (model.root + 1), None)
        return 0 if (model.weights[beyond] != 1.0).any() else model.size // NODE - 1

    def turns(self, reference: cs.MX, e: cs.MX) -> cs.MX:
        """Return the turns from a reference (4 n + 4,) to configurations with coordinates e (4 n + 4, c)."""
        if not self.links:
            return cs.MX(NODE * self.configurations, 0)
        return self._mapped("turns", self._gathered(reference), self._gathered(e))

    def forth(self, corrections: cs.MX, turns: cs.MX) -> cs.MX:
        """Return X dW for corrections of the free coordinates (N, c)."""
        if not self.links:
            return corrections
        steps = self._mapped("forth", self._gathered(self.model.moved(corrections)), turns)
        return self._of_free(self._nodes(_running_sum(self._scaled(steps, 1))))

    def back(self, residuals: cs.MX, turns: cs.MX) -> cs.MX:
        """Return X^T N^T R for residuals at all nodes (4 n + 4, c)."""
        if not self.links:
            return self.model.of_free(residuals)
        c, links = self.configurations, self.links
        places = NODE + np.arange(links * NODE) + self.model.size * np.arange(c)[:, None]
        behind = _picked(residuals, places.reshape(c, links, NODE).transpose(1, 0, 2), NODE * c)
        summed = self._scaled(_running_sum(behind, back=True), 1)
        turned = self._scaled(self._mapped("back", summed, turns), -1)
        places = np.arange(2 * NODE * c * links).reshape(links, c, 2, NODE)  # of first and second nodes
        second, first = _picked(turned, places[:, :, 1], NODE * c), _picked(turned, places[1:, :, 0], NODE * c)
        return self._of_free(self._nodes(second + cs.horzcat(first, cs.DM.zeros(NODE * c, 1))))

    def continued(self, weights: cs.MX, motion: cs.MX, base: cs.MX) -> cs.MX:
        """Extrapolate a motion in the logarithms of the slopes, and return the free coordinates (N, c).

        ``motion`` (4 n + 4, k + 1) are coordinates at k + 1 instants.  Column i of ``weights`` (k, c) holds the weights
        of the logarithms, from the first instant to each other one, in configuration i; ``base`` (4, c) are the
        base nodes of the configurations.
        """
        c, model = self.configurations, self.model
        if not self.links:
            return model.of_free(_extrapolated(motion, weights))
        found = self._mapped("continued", self._gathered(motion), cs.repmat(cs.vec(weights), 1, self.links))
        steps, first = self._scaled(found, 1), base
        if model.root:  # of the link to the base, ``continued`` gives the slope alone
            own, along = slice(NODE, NODE + 2), np.diag(model.weights[NODE : NODE + 2] == 1.0).astype(float)
            if model.free_of[NODE] == model.free_of[NODE + 1] >= 0:
                along = np.outer(model.weights[own], model.weights[own])
            position = cs.DM(along) @ _extrapolated(motion[own, :], weights) + cs.DM(model.whole_of_base[own]) @ base
            first = cs.vertcat(position, cs.MX(2, c))
        return self._of_free(self._nodes(_running_sum(cs.horzcat(steps[:, 0] + cs.vec(first), steps[:, 1:]))))

    def _of_free(self, nodes: cs.MX) -> cs.MX:
        """Return N^T x of coordinates x of all nodes but the base."""
        if self.model.held_at_base_alone:
            return nodes
        return self.model.of_free(cs.vertcat(cs.MX(NODE, nodes.shape[1]), nodes))

    @cached_property
    def _element(self) -> dict[str, cs.Function]:
        points = gauss(2)[0].tolist()
        values = np.array([hermite_slope(xi, 1.0) for xi in points])
        plane, span = np.eye(2), points[1] - points[0]
        to_pair = np.kron(values, plane)
        to_step = np.kron(np.array([[0.5, 0.5], [-1 / span, 1 / span]]), plane)
        link = _link(to_pair, to_pair, to_step, self.configurations)
        return {name: self.make(side_by_side(one, is_diff_in=[False] * one.n_in())) for name, one in link.items()}

    @cached_property
    def _clamp(self) -> dict[str, cs.Function]:
        second = np.hstack([np.zeros((NODE, NODE)), np.eye(NODE)])
        slope = np.kron(np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]), np.eye(2))
        return _link(second, slope, np.eye(NODE), self.configurations, np.diag([0.0, 0.0, 1.0, 1.0]))

    def _mapped(self, name: str, *columns: cs.MX) -> cs.MX:
        """Evaluate a Function of the links for all of them."""
        root = self.model.root
        result = mapped(self._element[name], *(part[:, root:] for part in columns))[0]
        if root:
            result = cs.horzcat(self._clamp[name](*(part[:, 0] for part in columns)), result)
        return result

    def _gathered(self, vectors: cs.MX) -> cs.MX:
        """Return the coordinates of each link as columns, (8 c, links), positions in units of l."""
        size, columns = vectors.shape
        rows = NODE * np.arange(self.links)[:, None, None] + np.arange(2 * NODE)
        places = rows + size * np.arange(columns)[:, None]
        return self._scaled(_picked(vectors, places, 2 * NODE * columns), -1)

    def _scaled(self, columns: cs.MX, power: int) -> cs.MX:
        """Multiply the first two of each four rows, positions or forces on them, by a power of l."""
        lengths = self.model.beam.element_lengths**power
        lengths = np.concatenate([lengths[:1], lengths]) if self.model.root else lengths
        position = np.tile([1.0, 1.0, 0.0, 0.0], columns.shape[0] // NODE)[:, None]
        return columns * cs.DM(position * lengths + (1.0 - position))

    def _nodes(self, columns: cs.MX) -> cs.MX:
        """Return the coordinates (4 links, c) of all nodes but the base from those of each as columns (4 c, links)."""
        c, links = self.configurations, self.links
        return _picked(columns, np.arange(NODE * c * links).reshape(links, c, NODE).transpose(1, 0, 2), NODE * links)


def _link(
    to_pair: Array, to_angles: Array, to_step: Array, count: int, continued: Array | None = None
) -> dict[str, cs.Function]:
    """Derive the Functions of a link between two nodes, for c configurations, one below the other.

    turns: (coordinates in the reference (8,), coordinates (8 c,)) -> cosines and sines of the angles of its pair (4 c,)
    forth: (corrections in the reference (8 c,), turns) -> their steps from the first node to the second (4 c,)
    back: (residuals summed beyond the link (4 c,), turns) -> contribution to the residuals in the reference (8 c,)
    continued: (coordinates at k + 1 instants (8 (k + 1),), weights (k, c)) -> steps of the coordinates (4 c,)

    From the coordinates of the nodes, ``to_pair`` (4, 8) gives the pair of vectors that are turned, and ``to_angles``
    the pair that gives the angles.  The step (4, 4) between the nodes follows from the former by ``to_step``, and from
    the latter by ``continued`` if that differs.
    """
    pair, angles, step = (cs.sparsify(cs.DM(part)) for part in (to_pair, to_angles, to_step))
    own = step if continued is None else cs.sparsify(cs.DM(continued))
    first, e, f = cs.SX.sym("first", 2 * NODE), cs.SX.sym("e", 2 * NODE, count), cs.SX.sym("f", NODE, count)
    turns = cs.SX.sym("turns", 2 * 2, count)

    def turned(vectors: cs.SX, turn: cs.SX, sign: float) -> cs.SX:
        """Turn two vectors, (x, y, x, y)."""
        parts = []
        for k in range(2):
            x, y, cosine, sine = vectors[2 * k], vectors[2 * k + 1], turn[2 * k], sign * turn[2 * k + 1]
            parts += [cosine * x - sine * y, sine * x + cosine * y]
        return cs.vertcat(*parts)

    def function(name: str, inputs: Sequence[cs.SX], columns: Sequence[cs.SX]) -> cs.Function:
        return cs.Function(name, [cs.vec(part) for part in inputs], [cs.cse(cs.densify(cs.vertcat(*columns)))])

    each = range(count)
    found = [
        function("turns", [first, e], [_angles(angles @ first, angles @ e[:, i]) for i in each]),
        function("forth", [e, turns], [step @ turned(pair @ e[:, i], turns[:, i], 1.0) for i in each]),
        function("back", [f, turns], [pair.T @ turned(step.T @ f[:, i], turns[:, i], -1.0) for i in each]),
        _continued(angles, own, count),
    ]
    return {one.name(): one for one in found}


def _angles(first: cs.SX, second: cs.SX) -> cs.SX:
    """Return cosines and sines of the angles from two vectors to two others."""
    parts = []
    for k in (0, 2):
        x, y, u, v = first[k], first[k + 1], second[k], second[k + 1]
        cosine, sine = x * u + y * v, x * v - y * u
        size = cs.sqrt(cosine**2 + sine**2)
        parts += [cosine / size, sine / size]
    return cs.vertcat(*parts)


def _continued(angles: cs.DM, step: cs.DM, count: int) -> cs.Function:
    """(coordinates at k + 1 instants, weights) -> steps, as in ``_link``, with k the number of configurations."""
    motion, weights = cs.SX.sym("motion", 2 * NODE, count + 1), cs.SX.sym("weights", count, count)
    vectors = angles @ motion
    continued: list[list[cs.SX]] = [[] for _ in range(count)]
    for k in (0, 2):
        x, y = vectors[k, 0], vectors[k + 1, 0]
        square = x**2 + y**2
        u, v = vectors[k, 1:], vectors[k + 1, 1:]
        cosine, sine = (x * u + y * v) / square, (x * v - y * u) / square
        size, angle = cs.exp(cs.log(cosine**2 + sine**2) / 2 @ weights), cs.atan2(sine, cosine) @ weights
        for i in range(count):
            c, s = size[i] * cs.cos(angle[i]), size[i] * cs.sin(angle[i])
            continued[i] += [c * x - s * y, s * x + c * y]
    columns = [step @ cs.vertcat(*parts) for parts in continued]
    return cs.Function("continued", [cs.vec(motion), cs.vec(weights)], [cs.densify(cs.vertcat(*columns))])


def _extrapolated(motion: cs.MX, weights: cs.MX) -> cs.MX:
    """Return coordinates (d, c) from those at k + 1 instants, (d, k + 1), with weights as of ``continued``."""
    first = motion[:, 0]
    changes = motion[:, 1:] - cs.repmat(first, 1, motion.shape[1] - 1)
    return cs.repmat(first, 1, weights.shape[1]) + changes @ weights


def _running_sum(columns: cs.MX, *, back: bool = False) -> cs.MX:
    """Return the sum of all columns up to each, or from each on, in log2(n) additions of arrays."""
    width = 1
    while width < columns.shape[1]:
        added = columns[:, width:] + columns[:, :-width]
        columns = cs.horzcat(added, columns[:, -width:]) if back else cs.horzcat(columns[:, :width], added)
        width *= 2
    return columns


def _picked(x: cs.MX, places: Index, rows: int) -> cs.MX:
    """Return entries of x as a matrix with ``rows`` rows; places count down the columns, in x and in the result."""
    return cs.reshape(cs.vec(cs.densify(x)).nz[places.ravel().tolist()], rows, places.size // rows)
