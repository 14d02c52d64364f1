"""Block elimination for the matrices of Newton's method, node by node along the beam.

The matrices couple each node to its neighbours only.  With 4x4 blocks D on the diagonal, B on its right and C below it,

    P_i = (D_i - L_i-1 B_i-1)^-1,    L_i = C_i P_i,    f_i = r_i - L_i-1 f_i-1,    x_i = P_i (f_i - B_i x_i+1)

solves the system with right-hand side r.  A matrix s^2 M + s D + K with positive definite M and K needs no pivots: some
rotation of the complex plane makes its real part positive definite.  If K is so indefinite that a P_i becomes
inaccurate, Newton's method converges slowly, and the step becomes shorter.

A part B diag(d) B^T of the damping adds s V diag(d) V^T, of low rank, to the matrix A, by Woodbury's identity:

    x = y - W T V^T y,    y = A^-1 r,    W = A^-1 V,    T = s diag(d) (1 + V^T W s diag(d))^-1.

Complex numbers are pairs of real ones.  Vectors have one column for a real system, and two for the real and imaginary
parts in a complex one.  The Functions of a node depend neither on the mesh nor on the law, so one library serves all.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import ELEMENTS_PER_CALL
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Index, Layout

BLOCK_ENTRIES = NODE**2
BLOCKS = 3 * BLOCK_ENTRIES  # entries of D, B and C of a node, or of P, B and L

Complex = list[cs.SX]  # the real part of a matrix, or its real and imaginary parts


@dataclass(frozen=True, eq=False)
class Elimination:
    """Solution of systems with a real or a complex matrix A + s V diag(d) V^T, for four coordinates per node."""

    parts: int  # 1 for a real matrix, 2 for a complex one
    free: int  # number of coordinates N, four per node
    rank: int  # number of columns of V, m
    make: Callable[[cs.Function], cs.Function]  # compiles a Function, or leaves it to the virtual machine

    @cached_property
    def layout(self) -> Layout:
        """Layout of the factors: P, B and L of each node, V, W and T."""
        nodes, rows, columns = self.free // NODE, self.parts * self.free, self.parts * self.rank
        sizes = {"blocks": self.parts * BLOCKS * nodes, "v": self.free * self.rank}
        return Layout.of(**sizes, w=rows * columns, t=columns**2)

    def factors(self, blocks: cs.MX, v: cs.MX, coefficients: cs.MX, s: complex) -> cs.MX:
        """Return the factors as a vector, from D, B and C of each node, V (N, m), d (m,) and s.

        ``blocks`` (48 parts, N/4) has the real parts of all three blocks of a node, then the imaginary parts.
        """
        solved = _along(self._nodes[0], blocks)
        if not self.rank:
            return cs.vec(solved)
        none = [cs.MX(self.free, 1)] * (self.parts - 1)
        solutions = [self._solve(solved, cs.horzcat(column, *none)) for column in cs.horzsplit(v)]
        w = self._as_real([cs.horzcat(*columns) for columns in zip(*map(cs.horzsplit, solutions), strict=True)])
        d = self._as_real([cs.diag(coefficients) * part for part in (s.real, s.imag)[: self.parts]])
        inner = cs.MX.eye(d.shape[0]) + cs.vertcat(*(v.T @ rows for rows in cs.vertsplit(w, self.free))) @ d
        return cs.vertcat(*map(cs.vec, (solved, v, w, cs.solve(inner.T, d.T, "qr").T)))

    def solve(self, factors: cs.MX, right: cs.MX) -> cs.MX:
        """Return the solution (N, parts) for a right-hand side (N, parts)."""
        blocks, v, w, t = cs.vertsplit(factors, self.layout.offsets)
        solution = self._solve(cs.reshape(blocks, self.parts * BLOCKS, -1), right)
        if not self.rank:
            return solution
        v, w, t = (cs.reshape(x, -1, columns * self.rank) for x, columns in ((v, 1), (w, self.parts), (t, self.parts)))
        return solution - cs.reshape(w @ (t @ cs.vec(v.T @ solution)), *solution.shape)

    def _solve(self, blocks: cs.MX, right: cs.MX) -> cs.MX:
        """Return the solution without the part of low rank."""
        columns = cs.vertcat(*(cs.reshape(part, NODE, -1) for part in cs.horzsplit(right)))
        forward, backward = self._nodes[1:]
        solution = _along(backward, _along(forward, columns, blocks), blocks, back=True)
        return cs.horzcat(*map(cs.vec, cs.vertsplit(solution, NODE)))

    def _as_real(self, parts: list[cs.MX]) -> cs.MX:
        """Return a matrix, or the real matrix that multiplies real above imaginary parts as a complex one does."""
        return parts[0] if self.parts == 1 else cs.blockcat([[parts[0], -parts[1]], [parts[1], parts[0]]])

    @cached_property
    def _nodes(self) -> tuple[cs.Function, ...]:
        return tuple(map(self.make, _node_functions(self.parts)))


@functools.cache
def _node_functions(parts: int) -> tuple[cs.Function, ...]:
    """(carried, columns of each node, ...) -> carried, result, for elimination, and forward and back substitution."""
    kind, size = "real" if parts == 1 else "complex", parts * NODE
    blocks, factors = cs.SX.sym("blocks", parts * BLOCKS), cs.SX.sym("factors", parts * BLOCKS)
    previous, carried, right = (cs.SX.sym("x", length) for length in (parts * BLOCK_ENTRIES, size, size))
    (d, b, c), (before,) = _split(blocks, BLOCK_ENTRIES, 3), _split(previous, BLOCK_ENTRIES, 1)
    inverse = _inverse(_minus(d, before))
    beyond = _times(c, inverse)
    p, b_, l = _split(factors, BLOCK_ENTRIES, 3)
    (last,), (r,) = _split(carried, NODE, 1), _split(right, NODE, 1)
    f, x = _minus(r, last), _times(p, _minus(r, _times(b_, last)))
    return (
        _chained(f"eliminate_{kind}", [previous, blocks], [_joined(_times(beyond, b)), _joined(inverse, b, beyond)]),
        _chained(f"forward_{kind}", [carried, right, factors], [_joined(_times(l, f)), _joined(f)]),
        _chained(f"backward_{kind}", [carried, right, factors], [_joined(x)] * 2, back=True),
    )


def _split(column: cs.SX, length: int, count: int) -> list[Complex]:
    """Return the matrices in a column, which holds the real parts of all of them, then the imaginary parts."""
    pieces = [cs.reshape(piece, NODE, -1) for piece in cs.vertsplit(column, length)]
    return [pieces[k::count] for k in range(count)]


def node_blocks(model: Model, entries: cs.MX, unit: float = 1.0) -> cs.MX:
    """Return D, B and C of each node, (48, nodes), as sums of element matrices (entries as in ``Model.entries``)."""
    kept, rows, columns, products = model.free_entries
    places = node_places(model)
    rows, columns = places[rows], places[columns]
    row, column = rows // NODE, columns // NODE
    block = np.where(row == column, 0, np.where(row < column, 1, 2))
    target = BLOCKS * np.minimum(row, column) + BLOCK_ENTRIES * block + NODE * (columns % NODE) + rows % NODE
    if not model.is_selection:
        weights = np.zeros(entries.numel())
        weights[kept] = products
        entries = entries * cs.DM(weights)
    padded, total = cs.vertcat(entries, 0.0), cs.MX(BLOCKS * (model.size // NODE - 1), 1)
    held = np.setdiff1d(np.arange(model.size - NODE), places)
    if held.size:
        diagonal = np.zeros(total.numel())
        diagonal[BLOCKS * (held // NODE) + (NODE + 1) * (held % NODE)] = unit
        total = cs.MX(cs.DM(diagonal))
    while target.size:  # each place takes an entry of one element after the other
        found, first = np.unique(target, return_index=True)
        sources = np.full(total.numel(), entries.numel())
        sources[found] = kept[first]
        total += padded.nz[sources.tolist()]
        target, kept = np.delete(target, first), np.delete(kept, first)
    return cs.reshape(total, BLOCKS, -1)


def node_places(model: Model) -> Index:
    """Return the place of each free coordinate in a vector with four places per node beyond the base, (N,)."""
    return model.first_moved - NODE


def _chained(name: str, inputs: list[cs.SX], outputs: list[cs.SX], *, back: bool = False) -> cs.Function:
    """Return the Function of ``ELEMENTS_PER_CALL`` nodes that passes the first input from node to node."""
    one = cs.Function(name, inputs, [cs.densify(output) for output in outputs], {"cse": True})
    carried = cs.MX.sym("carried", one.size1_in(0))
    columns = [cs.MX.sym(f"x{k}", one.size1_in(k), ELEMENTS_PER_CALL) for k in range(1, one.n_in())]
    passed, results = carried, []
    for j in range(ELEMENTS_PER_CALL)[:: -1 if back else 1]:
        passed, result = one(passed, *(x[:, j] for x in columns))
        results.append(result)
    options = {"is_diff_in": [False] * one.n_in()}
    return cs.Function(name, [carried, *columns], [passed, cs.horzcat(*results[:: -1 if back else 1])], options)


def _along(function: cs.Function, *columns: cs.MX, back: bool = False) -> cs.MX:
    """Evaluate a Function from ``_chained`` for any number of nodes; copies of the last one fill the last call."""
    count = columns[0].size2()
    padded = [cs.horzcat(x, cs.repmat(x[:, -1], 1, -count % ELEMENTS_PER_CALL)) for x in columns]
    carried, results = cs.MX.zeros(function.size1_in(0)), []
    calls = list(zip(*(cs.horzsplit(x, ELEMENTS_PER_CALL) for x in padded), strict=True))
    for arguments in calls[:: -1 if back else 1]:
        carried, result = function(carried, *arguments)
        results.append(result)
    return cs.horzcat(*results[:: -1 if back else 1])[:, :count]


def _joined(*matrices: Complex) -> cs.SX:
    """Return matrices as a column, as ``_split`` takes it."""
    return cs.SX(cs.vertcat(*(cs.vec(part) for parts in zip(*matrices, strict=True) for part in parts)))


def _minus(a: Complex, b: Complex) -> Complex:
    return [x - y for x, y in zip(a, b, strict=True)]


def _times(a: Complex, b: Complex) -> Complex:
    if len(a) == 1:
        return [a[0] @ b[0]]
    return [a[0] @ b[0] - a[1] @ b[1], a[0] @ b[1] + a[1] @ b[0]]


def _inverse(a: Complex) -> Complex:
    """Return the inverse, by that of the leading block and of its Schur complement."""
    size = a[0].shape[0]
    if size == 1:
        norm = a[0] ** 2 + a[-1] ** 2
        return [1 / a[0]] if len(a) == 1 else [a[0] / norm, -a[1] / norm]
    first, last = slice(0, size // 2), slice(size // 2, size)
    a11, a12, a21, a22 = ([x[i, j] for x in a] for i in (first, last) for j in (first, last))
    inverse = _inverse(a11)
    left, right = _times(a21, inverse), _times(inverse, a12)
    schur = _inverse(_minus(a22, _times(left, a12)))
    below, beside = _times(schur, left), _times(right, schur)
    above = _minus(inverse, [-x for x in _times(right, below)])
    return [cs.blockcat([[p, -q], [-r, s]]) for p, q, r, s in zip(above, beside, below, schur, strict=True)]
