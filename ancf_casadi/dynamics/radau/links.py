"""The links of a beam, and the passes of the integrator along them.

A pass takes the links (``link``) one after the other, from the base to the tip or back, and carries a few numbers from
each to the next.  It is compiled for ``ELEMENTS_PER_CALL`` links per call; its Functions depend neither on the mesh nor
on the numbers of the beam, so one library serves all.  An iteration of Newton's method takes three passes:

    advance       to the tip: turns the last corrections forth; increments, motion and turns of the stages,
    reduce        to the base: sums up the forces, turns the residuals back, and eliminates node after node,
    substitute    to the tip: the next corrections.

Vectors have a column per link, with the numbers of its second node: four coordinates, stage by stage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import ELEMENTS_PER_CALL, Make, map_elements, side_by_side
from ancf_casadi.dynamics.radau.elimination import BLOCK, LINK
from ancf_casadi.dynamics.radau.link import VALUES, Kind, end, link_function, modal_velocities_of_base
from ancf_casadi.dynamics.radau.tableau import STAGES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Index

TO_BASE = ("eliminate", "reduce")  # passes from the tip to the base
ALIKE = ("eliminate", "substitute")  # passes that are the same along links of all kinds
# the rows B_k of the modal law, turned back to a clamp along x: of the base, (4 m,), and of the links, (4 m, links)
Projection = tuple[cs.MX, cs.MX]
Iterate = tuple[cs.MX, cs.MX, cs.MX]  # corrections dW, turns and increments Z, (12, links) each
# number of the last inputs that links share
SHARED = {"advance": 2, "reduce": 2, "substitute": 0, "eliminate": 1, "update": 1, "extrapolate": 2}


@dataclass(frozen=True, eq=False)
class Links:
    """The links of a beam, and the passes along them, under the damping of a number of modes."""

    model: Model
    make: Make
    modes: int

    @property
    def count(self) -> int:
        """Number of links."""
        return self.model.size // NODE - 1

    @cached_property
    def kind(self) -> Kind:
        """The kind of the elements of the beam."""
        beyond = slice(NODE * (self.model.root + 1), None)
        return "held" if (self.model.weights[beyond] != 1.0).any() else "element"

    @cached_property
    def _lengths(self) -> cs.DM:
        """Length of each link, (1, links), m."""
        lengths = self.model.beam.element_lengths
        return cs.DM(np.concatenate([lengths[: self.model.root], lengths])).T

    @cached_property
    def _supports(self) -> cs.DM:
        """The parts of N and G for the second node of each link, (32, links)."""
        model, rows = self.model, np.zeros((self.model.size, NODE))
        moved = np.flatnonzero(model.weights)
        rows[moved, model.first_moved[model.free_of[moved]] % NODE] = model.weights[moved]
        blocks = [matrix.reshape(-1, NODE, NODE)[1:] for matrix in (rows, model.whole_of_base)]
        return cs.DM(np.hstack([block.transpose(0, 2, 1).reshape(self.count, -1) for block in blocks])).T

    def places(self, free: cs.MX) -> cs.MX:
        """Return N q for q (N,), as columns of the second nodes of the links, (4, links)."""
        return cs.reshape(
            free if self.model.held_at_base_alone else self.model.with_fixed_base(free)[NODE:, :], NODE, -1
        )

    def free(self, places: cs.MX) -> cs.MX:
        """Return q (N,) from N q as columns of the links."""
        return self.model.of_free(cs.vertcat(cs.MX(NODE, 1), cs.vec(places)))

    def advance(
        self, iterate: Iterate, q: cs.MX, v: cs.MX, h: cs.MX, base: cs.MX, reference: cs.MX, projection: Projection
    ) -> list[cs.MX]:
        """Return increments, turns, coordinates, velocities and accelerations of both nodes, and modal velocities.

        The motion of both nodes at each stage is (24, links), the modal velocities are (m, 3).  ``base`` (12, 3) is the
        motion of the base at the stages, and ``reference`` (4, nodes) the configuration of the matrices.
        """
        of_base, of_links = projection
        columns = [*iterate, self.places(q), self.places(v), reference[:, 1:], of_links]
        velocities_of_base = modal_velocities_of_base(self.modes)(of_base, cs.vec(base))
        first = cs.vertcat(cs.MX.zeros(2 * VALUES), cs.vec(base), reference[:, 0], velocities_of_base)
        *motion, modal = self._pass("advance", first, columns, [h, cs.vec(base)])
        return [*motion, cs.reshape(modal[:, -1], self.modes, STAGES)]

    def update(self, iterate: Iterate, q: cs.MX, base: cs.MX) -> list[cs.MX]:
        """Return the increments of ``advance`` and the coordinates, (12, links), from those of the base (4, 3)."""
        return self._pass("update", cs.MX.zeros(2 * VALUES), [*iterate, self.places(q)], [cs.vec(base)])

    def reduce(
        self,
        forces: cs.MX,
        further: cs.MX,
        turns: cs.MX,
        outer: cs.MX,
        modal: cs.MX,
        base: cs.MX,
        projection: Projection,
    ) -> cs.MX:
        """Return the eliminated residuals (12, links), real, then complex numbers of each node.

        ``forces`` (24, links) act on both nodes of a link, ``further`` (12, links) on the second, and ``modal`` (m, 3)
        on the modes, at all stages.
        """
        columns = forces, further, turns, outer, projection[1]
        return self._pass("reduce", cs.MX.zeros(4 * VALUES), columns, [cs.vec(modal), cs.vec(base)])[0]

    def substitute(self, eliminated: cs.MX, inner: cs.MX) -> cs.MX:
        """Return the solution (12, links) of the real and the complex system."""
        return self._pass("substitute", cs.MX.zeros(VALUES), [eliminated, inner])[0]

    def factors(self, k: cs.MX, d: cs.MX, m: cs.MX, rates: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return the factors of s^2 M + s D + K, from the matrices of each link as columns (64, links)."""
        outer, inner = self._pass("eliminate", cs.MX.zeros(12 * BLOCK), [k, d, m], [rates])
        return outer, inner

    def extrapolate(self, motion: cs.MX, weights: cs.MX, base: cs.MX) -> cs.MX:
        """Extrapolate a motion in the logarithms of the slopes, and return the increments (12, links) since its end.

        ``motion`` (16, nodes) are coordinates at four instants.  Column i of ``weights`` (3, 3) holds the weights, at
        stage i, of the logarithms from the first instant to each other one; ``base`` (12, 3) is the motion of the base.
        """
        first = cs.vertcat(motion[:, 0], cs.vec(base[:NODE, :]))
        return self._pass("extrapolate", first, [motion[:, 1:]], [cs.vec(weights), cs.vec(base)])[0]

    def end(self, increments: cs.MX, v: cs.MX, a: cs.MX, h: cs.MX) -> list[cs.MX]:
        """Return velocities and accelerations at the end of a step, and the embedded deviation and its rate.

        All are (4, links), from Z and from v and a (N,) at the start.
        """
        columns = increments, self.places(v), self.places(a), cs.repmat(h, 1, self.count)
        return map_elements(self._functions["end"], *columns)

    def matrices(self, entries: cs.MX, unit: float = 0.0) -> cs.MX:
        """Return the matrices of the links as columns (64, links), which add up to N^T A N at four places per node.

        ``entries`` are those of all elements, as in ``Model.entries``.  Coordinates that are held have ``unit`` on the
        diagonal.
        """
        model = self.model
        if model.held_at_base_alone and not model.root and len(model.groups) == 1:
            return cs.reshape(entries, LINK**2, -1)
        indices, rows, columns, products = model.free_entries
        rows, columns = model.first_moved[rows], model.first_moved[columns]
        link = np.maximum(rows, columns) // NODE - 1
        row, column = rows - NODE * link, columns - NODE * link
        target = LINK**2 * link + LINK * column + row
        diagonal = np.zeros(LINK**2 * self.count)
        held_rows = np.setdiff1d(np.arange(NODE, model.size), model.first_moved)
        diagonal[LINK**2 * (held_rows // NODE - 1) + (LINK + 1) * (NODE + held_rows % NODE)] = unit
        incidence = cs.DM.triplet(target.tolist(), indices.tolist(), cs.DM(products), diagonal.size, entries.numel())
        return cs.reshape(incidence @ entries + cs.DM(diagonal), LINK**2, -1)

    @cached_property
    def _seconds(self) -> Index:
        """The places, in values at both nodes of the links (24, links), of those at the second ones, (links, 3, 4)."""
        return np.arange(LINK * STAGES * self.count).reshape(self.count, STAGES, 2, NODE)[:, :, 1]

    @cached_property
    def _in_whole(self) -> Index:
        """The places, in values at all nodes (4 n + 4, 3), of those at both nodes of the links, (links, 3, 8)."""
        link, stage, row = np.indices((self.count, STAGES, LINK))
        return np.asarray(row + NODE * link + self.model.size * stage)

    def whole(self, base: cs.MX, ends: cs.MX) -> cs.MX:
        """Return values at all nodes, (4 n + 4, 3), from those of the base, (4, 3), and of both nodes of each link."""
        return cs.vertcat(base, _pick(ends, self._seconds.transpose(1, 0, 2), NODE * self.count))

    def pairs(self, values: cs.MX) -> cs.MX:
        """Return values at both nodes of each link (8, links) from those at all nodes (4 n + 4,)."""
        return _pick(values, NODE * np.arange(self.count)[:, None] + np.arange(LINK), LINK)

    def last_turns(self, turns: cs.MX) -> cs.MX:
        """Return the turns to the last stage, in place of those to all stages."""
        places = VALUES * np.arange(self.count)[:, None] + VALUES - NODE + np.tile(np.arange(NODE), STAGES)
        return _pick(turns, places, VALUES)

    def sum_at_nodes(self, ends: cs.MX) -> cs.MX:
        """Return the sums at all nodes (4 n + 4, 3) of values at both nodes of the links (24, links)."""
        target, size = self._in_whole.ravel().tolist(), self.model.size * STAGES
        places = cs.DM.triplet(target, [*range(len(target))], cs.DM.ones(len(target)), size, len(target))
        return cs.reshape(places @ cs.vec(ends), self.model.size, STAGES)

    def ends(self, base: cs.MX, free: cs.MX) -> cs.MX:
        """Return values at both nodes of each link (24, links) from those of the base (4, 3) and the free (N, 3)."""
        model = self.model
        if not model.held_at_base_alone:
            return _pick(model.whole(free, base), self._in_whole, LINK * STAGES)
        stage, row = np.divmod(self._in_whole, model.size)
        behind = NODE * STAGES + model.freedoms * stage + row - NODE
        places = np.where(row < NODE, NODE * stage + row, behind)  # no rows are stacked: that would transpose them
        return _pick(cs.vertcat(cs.vec(base), cs.vec(free)), places, LINK * STAGES)

    def node_by_node(self, values: cs.MX) -> cs.MX:
        """Return columns (12, nodes) from values at some nodes, (4 nodes, 3)."""
        if not values.nnz():
            return cs.MX.zeros(VALUES, values.size1() // NODE)
        return _pick(values, np.argsort(_stage_order(values.size1() // NODE)), VALUES)

    def _pass(self, name: str, carried: cs.MX, columns: Sequence[cs.MX], shared: Sequence[cs.MX] = ()) -> list[cs.MX]:
        """Evaluate a Function of all links, one after the other, and return its results side by side."""
        back, root = name in TO_BASE, 0 if self.kind == "held" or name in ALIKE else self.model.root
        segments: list[tuple[Kind, slice]] = [("base", slice(root)), (self.kind, slice(root, None))][not root :]
        by_segment = []
        for kind, links in segments[::-1] if back else segments:
            along = [x[:, links] if root else x for x in columns]
            mesh = [] if name in ALIKE else [self._lengths, *([] if kind == "element" else [self._supports])]
            mesh_columns = [x[:, links] for x in mesh]
            if kind == "base":
                carried, *results = link_function(name, kind, self.modes)(carried, *along, *mesh_columns, *shared)
            else:
                carried, *results = self._along(name, carried, along, mesh_columns, shared)
            by_segment.append(results)
        ordered = by_segment[::-1] if back else by_segment
        return [cs.horzcat(*results) for results in zip(*ordered, strict=True)]

    def _along(
        self,
        name: str,
        carried: cs.MX,
        columns: Sequence[cs.MX],
        mesh_columns: Sequence[Any],
        shared: Sequence[cs.MX],
    ) -> list[cs.MX]:
        """Evaluate a compiled Function for all links of a segment, and return what it carries, and its results.

        Further links fill the last call.  They follow the tip; in ``reduce`` they carry no forces, so that the base
        receives the sums of the real links only.  ``eliminate`` inverts their matrices; there they precede the base.
        """
        function, back, before = self._functions[name], name in TO_BASE, name == "eliminate"
        count = columns[0].size2()
        if filling_count := -count % ELEMENTS_PER_CALL:
            copied = slice(1) if before else slice(count - 1, count)
            filling = [cs.repmat(x[:, copied], 1, filling_count) for x in (*columns, *mesh_columns)]
            if name == "reduce":
                filling[: len(columns)] = [cs.MX.zeros(x.shape) for x in filling[: len(columns)]]
            pairs = zip((*columns, *mesh_columns), filling, strict=True)
            padded = [cs.horzcat(*((added, x) if before else (x, added))) for x, added in pairs]
        else:
            padded = [*columns, *mesh_columns]
        calls = list(zip(*(cs.horzsplit(x, ELEMENTS_PER_CALL) for x in padded), strict=True))
        by_call = []
        for arguments in calls[:: -1 if back else 1]:
            carried, *results = function(carried, *arguments, *shared)
            by_call.append(results)
        joined = [cs.horzcat(*results) for results in zip(*by_call[:: -1 if back else 1], strict=True)]
        real_links = slice(filling_count, None) if before else slice(count)
        return [carried, *(x[:, real_links] if filling_count else x for x in joined)]

    @cached_property
    def _functions(self) -> dict[str, cs.Function]:
        """The compiled Functions of ``ELEMENTS_PER_CALL`` links, by name."""
        links = {name: link_function(name, "element" if name in ALIKE else self.kind, self.modes) for name in SHARED}
        chained = [_chain(links[name], shared, back=name in TO_BASE) for name, shared in SHARED.items()]
        alone = side_by_side(end(), is_diff_in=[False] * 4)
        return dict(zip([*SHARED, "end"], self.make([*chained, alone]), strict=True))


def _chain(link: cs.Function, shared: int, *, back: bool) -> cs.Function:
    """Return the Function of ``ELEMENTS_PER_CALL`` links that passes the first input from link to link."""
    sizes = [link.size1_in(k) for k in range(link.n_in())]
    first_shared = len(sizes) - shared
    carried = cs.MX.sym("carried", sizes[0])
    columns = [cs.MX.sym(f"x{k}", sizes[k], ELEMENTS_PER_CALL) for k in range(1, first_shared)]
    alike = [cs.MX.sym(f"x{k}", sizes[k]) for k in range(first_shared, len(sizes))]
    passed, by_link = carried, []
    for k in range(ELEMENTS_PER_CALL)[:: -1 if back else 1]:
        passed, *results = link(passed, *(x[:, k] for x in columns), *alike)
        by_link.append(results)
    outputs = [cs.horzcat(*results) for results in zip(*by_link[:: -1 if back else 1], strict=True)]
    undifferentiated = {"is_diff_in": [False] * len(sizes)}
    return cs.Function(link.name(), [carried, *columns, *alike], [passed, *outputs], undifferentiated)


def _stage_order(nodes: int) -> Index:
    """Return the places, in columns (12, nodes), of the values of all nodes stage by stage."""
    return np.arange(VALUES * nodes).reshape(nodes, STAGES, NODE).transpose(1, 0, 2).ravel()


def _pick(x: cs.MX, places: Index, rows: int) -> cs.MX:
    """Return entries of x as a matrix with ``rows`` rows; places count down the columns, in x and in the result."""
    return cs.reshape(cs.vec(cs.densify(x)).nz[places.ravel().tolist()], rows, -1)
