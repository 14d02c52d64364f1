"""One link of a beam: the Functions that a pass evaluates link by link, in coordinates that turn with the beam.

A link joins a node to the next one: an element of the beam, or what joins a base of its own to the first node of the
beam.  Each Function takes the values carried from the previous link, the columns of this link, and inputs shared by all
links; it returns the values for the next link, and the results for the second node.  Positions are taken in units of
the length l, so that machine code serves all meshes.

Turns.  The axial stiffness of a thin beam is thousands of times its bending stiffness, and its direction turns with the
beam: matrices evaluated in one configuration are of little use in the next.  The axial strains, however, depend only on
the lengths of the slopes r' at the two Gauss points g = 1/2 -+ sqrt(3)/6 of each element, and these slopes determine
the nodes: r' is quadratic in an element of length l, so that

    r_k+1 = r_k + l/2 (r'_1 + r'_2),    tau_k+1 = tau_k + (r'_2 - r'_1)/(g_2 - g_1).

Let G map the free coordinates to these slopes, and let R turn each slope by the angle between two configurations.
X = G^-1 R G then takes corrections from one configuration to the other: the axial stiffness X^T K X is the same in
both, inertia and bending are nearly so.  Residuals go the other way, by X^T.  The link to a base of its own turns the
position and slope of the first node of the beam with this slope.

Prediction.  A motion is extrapolated in the logarithms of the slopes, log length and angle, so that errors of the
angles do not stretch the beam.

A beam that supports hold beyond its beginning turns little.  Corrections that turn with it would violate these
supports; there X is 1, and the coordinates themselves are extrapolated.

Modal damping.  With the rows B_k of a node, as they are if the clamp points along x, and R of the clamp at a stage, the
pass to the tip adds up the modal velocities w = sum_k B_k^T R^T v_k, and the pass to the base adds the forces
R B_k diag(d) w.  These Functions depend on the number m of modes.

Supports.  The rows of N and G of a node, e = N q + G b, are a column of 32 numbers: the free coordinates of the node
have places among its four, so that its part of N is a 4x4 matrix.  Elements whose nodes are all free do without them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.radau import elimination
from ancf_casadi.dynamics.radau.elimination import BLOCK, LINK
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import gauss, hermite_slope

Kind = Literal["element", "base", "held"]  # an element that turns; a base of its own; an element of a beam that is held
VALUES = NODE * STAGES  # numbers of a node at all stages


@lru_cache
def link_function(name: str, kind: Kind, modes: int) -> cs.Function:
    """Derive a Function of one link under the damping of m modes: (carried, columns, shared) -> carried, results."""
    if name == "eliminate":
        return elimination.eliminate()
    if name == "substitute":
        carried, f, inner = _columns(VALUES, VALUES, 6 * BLOCK)
        x = cs.vec(elimination.substitute(_of_stages(f), inner, _of_stages(carried)))
        return _function(name, "element", [carried, f, inner], [x, x])
    if name == "extrapolate":
        return _extrapolate(kind)
    if name == "update":
        return _update(kind)
    return {"advance": _advance, "reduce": _reduce}[name](kind, modes)


def _advance(kind: Kind, modes: int) -> cs.Function:
    """Derive the Function of ``Links.advance``.

    The carried values belong to the first node: its corrections before and after turning, its motion at the stages, its
    coordinates in the reference, and the modal velocities up to there.
    """
    sizes = VALUES, VALUES, 3 * VALUES, NODE, STAGES * modes
    carried, h = cs.SX.sym("carried", sum(sizes)), cs.SX.sym("h")
    w, turns, z, q, v, reference, B = _columns(VALUES, VALUES, VALUES, NODE, NODE, NODE, NODE * modes)
    l, supports, base = _columns(1, 2 * BLOCK, 3 * VALUES)
    offsets = np.cumsum([0, *sizes]).tolist()
    *corrections_before, of_motion, reference_before, modal_before = cs.vertsplit(carried, offsets)
    before, turned_before = map(_of_stages, corrections_before)
    motion_before = cs.vertsplit(cs.reshape(of_motion, VALUES, STAGES), NODE)
    N, G = _support_matrices(supports)
    link = _Link.of(kind, l)

    corrections, turned = _turn_corrections(kind, link, N, w, turns, before, turned_before)
    increments = _of_stages(z) - turned
    inverse = cs.DM(RADAU.inverse).T
    velocities = increments @ inverse / h
    accelerations = (velocities - cs.repmat(v, 1, STAGES)) @ inverse / h
    motion = [cs.repmat(q, 1, STAGES) + increments, velocities, accelerations]
    if kind != "element":
        of_base = cs.vertsplit(cs.reshape(base, 3 * NODE, STAGES), NODE)
        motion = [x + G @ b for x, b in zip(motion, of_base, strict=True)]
    motion_of_both = [cs.vertcat(first, second) for first, second in zip(motion_before, motion, strict=True)]
    angles = turns
    if link:
        start = link.directions(cs.vertcat(reference_before, reference))
        angles = cs.vertcat(*(_angles(start, stage) for stage in cs.horzsplit(link.directions(motion_of_both[0]))))
    modal = modal_before + cs.vec(_modal_velocities(B, motion[1], base))
    passed = cs.vertcat(*map(cs.vec, (corrections, turned, cs.vertcat(*motion))), reference, modal)
    inputs = [carried, w, turns, z, q, v, reference, B, l, *([] if kind == "element" else [supports]), h, base]
    return _function("advance", kind, inputs, [passed, cs.vec(increments), angles, *map(cs.vec, motion_of_both), modal])


def _update(kind: Kind) -> cs.Function:
    """Derive the Function of ``Links.update``; carried are the results of ``_turn_corrections`` for its first node."""
    carried, base = cs.SX.sym("carried", 2 * VALUES), cs.SX.sym("base", VALUES)
    w, turns, z, q, l, supports = _columns(VALUES, VALUES, VALUES, NODE, 1, 2 * BLOCK)
    before, turned_before = map(_of_stages, cs.vertsplit(carried, VALUES))
    N, G = _support_matrices(supports)

    corrections, turned = _turn_corrections(kind, _Link.of(kind, l), N, w, turns, before, turned_before)
    increments = _of_stages(z) - turned
    coordinates = cs.repmat(q, 1, STAGES) + increments
    if kind != "element":
        coordinates += G @ _of_stages(base)
    inputs = [carried, w, turns, z, q, l, *([] if kind == "element" else [supports]), base]
    passed = cs.vertcat(cs.vec(corrections), cs.vec(turned))
    return _function("update", kind, inputs, [passed, cs.vec(increments), cs.vec(coordinates)])


def _turn_corrections(
    kind: Kind, link: _Link | None, N: cs.SX, w: cs.SX, turns: cs.SX, before: cs.SX, turned_before: cs.SX
) -> tuple[cs.SX, cs.SX]:
    """Return the corrections of the second node at the stages, (4, 3), before and after turning."""
    corrections = _of_stages(w) @ cs.DM(RADAU.transform).T
    if kind != "element":
        corrections = N @ corrections
    if not link:
        return corrections, corrections
    turned = turned_before + link.forth(cs.vertcat(before, corrections), turns)
    return corrections, N @ (N.T @ turned) if kind == "base" else turned


@lru_cache
def modal_velocities_of_base(modes: int) -> cs.Function:
    """Derive the Function (B_0, motion of the base) -> its part of the modal velocities at the stages (3 m,)."""
    B, base = _columns(NODE * modes, 3 * VALUES)
    velocity = cs.reshape(base, 3 * NODE, STAGES)[NODE : 2 * NODE, :]
    return cs.Function("modal_velocities", [B, base], [cs.densify(cs.vec(_modal_velocities(B, velocity, base)))])


def _modal_velocities(B: cs.SX, velocity: cs.SX, base: cs.SX) -> cs.SX:
    """Return B_k^T R^T v_k (m, 3)."""
    return cs.reshape(B, NODE, -1).T @ _turn(velocity, _clamp_turn(base), -1.0)


def _clamp_turn(base: cs.SX) -> cs.SX:
    """Return cosine and sine of the clamp for both pairs of a node at the stages (4, 3)."""
    return cs.repmat(cs.reshape(base, 3 * NODE, STAGES)[2:NODE, :], 2, 1)


def _reduce(kind: Kind, modes: int) -> cs.Function:
    """Derive the Function of ``Links.reduce``.

    The carried values come from beyond the second node: the forces of the next link on it, the sum of all forces behind
    it, its turned residual from the next link, and the eliminated residuals of the next node.
    """
    carried, modal = cs.SX.sym("carried", 4 * VALUES), cs.SX.sym("modal", modes, STAGES)
    forces, further, turns, outer, B = _columns(2 * VALUES, VALUES, VALUES, 3 * BLOCK, NODE * modes)
    l, supports, base = _columns(1, 2 * BLOCK, 3 * VALUES)
    beyond, total, turned, eliminated = (_of_stages(x) for x in cs.vertsplit(carried, VALUES))
    N, _ = _support_matrices(supports)
    link = _Link.of(kind, l)

    on_link, before = cs.reshape(forces, LINK, STAGES), cs.SX.zeros(NODE, STAGES)
    residuals = on_link[NODE:, :] + _of_stages(further) + beyond
    residuals += _turn(cs.reshape(B, NODE, modes) @ modal, _clamp_turn(base), 1.0)
    if link:
        total += residuals
        before, residuals = cs.vertsplit(link.back(total, turns), NODE)
        residuals += turned
    if kind != "element":
        residuals = N.T @ residuals
    solved = elimination.reduce(residuals @ cs.DM(np.linalg.inv(RADAU.transform)).T, outer, eliminated)
    passed = cs.vertcat(*map(cs.vec, (on_link[:NODE, :], total, before, solved)))
    columns = [forces, further, turns, outer, B, l, *([] if kind == "element" else [supports])]
    return _function("reduce", kind, [carried, *columns, cs.vec(modal), base], [passed, cs.vec(solved)])


def _extrapolate(kind: Kind) -> cs.Function:
    """Derive the Function of ``Links.extrapolate``; carried is the motion of the first node, and its continuation."""
    carried, instants = cs.SX.sym("carried", NODE * (STAGES + 1) + VALUES), STAGES + 1
    motion, l, supports = _columns(NODE * instants, 1, 2 * BLOCK)
    weights, base = cs.SX.sym("weights", STAGES, STAGES), cs.SX.sym("base", 3 * VALUES)
    first, second = (cs.reshape(x, NODE, instants) for x in (carried[:-VALUES], motion))
    N, G = _support_matrices(supports)
    link = _Link.of(kind, l)

    changes = second[:, 1:] - cs.repmat(second[:, 0], 1, STAGES)
    continued = cs.repmat(second[:, 0], 1, STAGES) + changes @ weights
    if link:
        slopes = _continued_pairs(link.directions(cs.vertcat(first, second)), weights)
        if kind == "element":
            continued = _of_stages(carried[-VALUES:]) + link.step(slopes)
        else:  # of the first node, the slope alone has a direction
            continued = cs.vertcat(continued[:2, :], slopes[2:, :])
    increments = continued - cs.repmat(second[:, -1], 1, STAGES)
    if kind != "element":
        increments = N @ (N.T @ increments)
        continued = N @ (N.T @ continued) + G @ cs.reshape(base, 3 * NODE, STAGES)[:NODE, :]
    passed = cs.vertcat(motion, cs.vec(continued))
    inputs = [carried, motion, l, *([] if kind == "element" else [supports]), cs.vec(weights), base]
    return _function("extrapolate", kind, inputs, [passed, cs.vec(increments)])


def end() -> cs.Function:
    """Derive the Function of ``Links.end`` for one link."""
    z, v, a, h = _columns(VALUES, NODE, NODE, 1)
    increments, inverse, embedded = _of_stages(z).T, cs.DM(RADAU.inverse), cs.DM(RADAU.embedded).T
    velocities = inverse @ increments / h
    last, real = inverse[-1, :], RADAU.gamma / h
    acceleration = (last @ velocities).T / h - cs.sum2(last) * v / h
    deviation = v / real + (embedded @ increments).T
    rate = real * deviation + a / real + (embedded @ velocities).T - cs.sum2(embedded) * v
    return cs.Function("end", [z, v, a, h], [velocities[-1, :].T, acceleration, deviation, rate], {"cse": True})


@dataclass(frozen=True)
class _Link:
    """A link of length l that turns, with a pair of vectors that determine the step between its nodes.

    From the coordinates of both nodes, ``pair`` (4, 8) gives the vectors that are turned, and ``angles`` those whose
    angles turn them.  Positions enter and leave in units of l.
    """

    l: cs.SX
    pair: cs.DM
    angles: cs.DM
    of_pair: cs.DM

    @staticmethod
    def of(kind: Kind, l: cs.SX) -> _Link | None:
        """Return the link of a kind; None if it does not turn."""
        if kind == "held":
            return None
        if kind == "base":
            second = np.hstack([np.zeros((NODE, NODE)), np.eye(NODE)])
            slope = np.kron(np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]), np.eye(2))
            matrices = second, slope, np.eye(NODE)
        else:
            points = gauss(2)[0].tolist()
            values, span = np.array([hermite_slope(xi, 1.0) for xi in points]), points[1] - points[0]
            step = np.array([[0.5, 0.5], [-1 / span, 1 / span]])
            matrices = np.kron(values, np.eye(2)), np.kron(values, np.eye(2)), np.kron(step, np.eye(2))
        return _Link(l, *(cs.sparsify(cs.DM(matrix)) for matrix in matrices))

    def directions(self, coordinates: cs.SX) -> cs.SX:
        """Return the vectors (4, k) whose angles turn the link, from coordinates of both nodes (8, k)."""
        return self.angles @ self._scale(coordinates, 1 / self.l)

    def forth(self, corrections: cs.SX, turns: cs.SX) -> cs.SX:
        """Return the turned steps (4, 3) between the nodes from the corrections of both (8, 3)."""
        return self.step(_turn(self.pair @ self._scale(corrections, 1 / self.l), turns, 1.0))

    def back(self, total: cs.SX, turns: cs.SX) -> cs.SX:
        """Return the residuals (8, 3) of both nodes from the sums of those beyond the link (4, 3), turned back."""
        pairs = _turn(self.of_pair.T @ self._scale(total, self.l), turns, -1.0)
        return self._scale(self.pair.T @ pairs, 1 / self.l)

    def step(self, pairs: cs.SX) -> cs.SX:
        """Return the steps (4, 3) between the nodes."""
        return self._scale(self.of_pair @ pairs, self.l)

    @staticmethod
    def _scale(vectors: cs.SX, factor: cs.SX) -> cs.SX:
        """Multiply positions by a factor."""
        position = np.tile([1.0, 1.0, 0.0, 0.0], vectors.shape[0] // NODE)
        return cs.repmat(cs.DM(position) * factor + cs.DM(1.0 - position), 1, vectors.shape[1]) * vectors


def _turn(pairs: cs.SX, turns: cs.SX, sign: float) -> cs.SX:
    """Turn the two vectors (x, y, x, y) of each stage, (4, 3), by their angles, or back."""
    rows = []
    for k in (0, 2):
        x, y = pairs[k, :], pairs[k + 1, :]
        cosine, sine = (cs.reshape(turns, NODE, STAGES)[row, :] for row in (k, k + 1))
        rows += [cosine * x - sign * sine * y, sign * sine * x + cosine * y]
    return cs.vertcat(*rows)


def _angles(first: cs.SX, second: cs.SX) -> cs.SX:
    """Return cosines and sines of the angles from two vectors to two others."""
    rows = []
    for k in (0, 2):
        x, y, u, v = first[k], first[k + 1], second[k], second[k + 1]
        cosine, sine = x * u + y * v, x * v - y * u
        size = cs.sqrt(cosine**2 + sine**2)
        rows += [cosine / size, sine / size]
    return cs.vertcat(*rows)


def _continued_pairs(pairs: cs.SX, weights: cs.SX) -> cs.SX:
    """Return two vectors at the stages (4, 3) from those at four instants (4, 4)."""
    rows = []
    for k in (0, 2):
        x, y = pairs[k, 0], pairs[k + 1, 0]
        square = x**2 + y**2
        u, v = pairs[k, 1:], pairs[k + 1, 1:]
        cosine, sine = (x * u + y * v) / square, (x * v - y * u) / square
        size, angle = cs.exp(cs.log(cosine**2 + sine**2) / 2 @ weights), cs.atan2(sine, cosine) @ weights
        c, s = size * cs.cos(angle), size * cs.sin(angle)
        rows += [c * x - s * y, s * x + c * y]
    return cs.vertcat(*rows)


def _of_stages(column: cs.SX) -> cs.SX:
    """Return the numbers of a node (12,) with a column per stage, (4, 3)."""
    return cs.reshape(column, NODE, STAGES)


def _columns(*sizes: int) -> list[cs.SX]:
    return [cs.SX.sym("x", size) for size in sizes]


def _support_matrices(supports: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Return the parts of N and G that belong to the second node of a link, from a column of ``Links._supports``."""
    N, G = (cs.reshape(block, NODE, NODE) for block in cs.vertsplit(supports, BLOCK))
    return N, G


def _function(name: str, kind: Kind, inputs: list[cs.SX], outputs: list[cs.SX]) -> cs.Function:
    dense = [cs.densify(output) for output in outputs]
    return cs.Function(name if kind == "element" else f"{name}_{kind}", inputs, dense, {"cse": True})
