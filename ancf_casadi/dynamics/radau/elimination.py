"""Block elimination for the matrices of Newton's method, node by node from the tip of the beam.

The matrices A couple each node to its neighbours only.  With 4x4 blocks D on the diagonal, B in the rows of a node for
the next one and C in those of the next one for it, elimination from the tip and substitution from the base,

    P_k = (D_k - B_k P_k+1 C_k)^-1,    f_k = r_k - B_k P_k+1 f_k+1,    x_k = P_k (f_k - C_k-1 x_k-1),

solve A x = r.  A matrix s^2 M + s D + K with positive definite M and K needs no pivots: some rotation of the complex
plane makes its real part positive definite.  If K is so indefinite that a P_k becomes inaccurate, Newton's method
converges slowly, and the step becomes shorter.

A real and a complex system are solved side by side.  The four numbers of a node in the real one, then the real and the
imaginary parts of those in the complex one, are three columns; complex matrices are pairs of real ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ancf_casadi.mechanics.nodes import NODE

BLOCK = NODE**2  # entries of a block
LINK = 2 * NODE  # coordinates of the two nodes that a link joins
SYSTEMS = (slice(0, 1), slice(1, 3))  # columns of the real system, and of the complex one

Complex = list[cs.SX]  # the real part of a matrix, or its real and imaginary parts


def eliminate() -> cs.Function:
    """Return the Function of a link that eliminates its second node.

    (matrices beyond, K, D, M, rates) -> matrices beyond, (B_k P_k+1), (P_k, C_k-1), for A = s^2 M + s D + K.

    K, D and M (64,) are those of the link; the rates are s of the real system, and its real and imaginary part in the
    complex one.  The matrices beyond a node are B, C and the first block of the next link, and P of its second node.
    """
    k, d, m = (cs.SX.sym(name, LINK, LINK) for name in "kdm")
    beyond, rates = cs.SX.sym("beyond", 12 * BLOCK), cs.SX.sym("rates", 3)
    gamma, real, imaginary = cs.vertsplit(rates)
    systems: list[Complex] = [
        [k + gamma * d + gamma**2 * m],
        [k + real * d + (real**2 - imaginary**2) * m, imaginary * d + 2 * real * imaginary * m],
    ]
    carried, outer, inner = [], [], []
    first, second = slice(0, NODE), slice(NODE, LINK)
    for matrix, (b, c, block_of_next, p) in zip(systems, _matrices(beyond, 4), strict=True):
        bp = _times(b, p)
        block = [x[second, second] + y for x, y in zip(matrix, block_of_next, strict=True)]
        inverse = _inverse(_minus(block, _times(bp, c)))
        to_next, from_next = [x[first, second] for x in matrix], [x[second, first] for x in matrix]
        carried.append([to_next, from_next, [x[first, first] for x in matrix], inverse])
        outer.append([bp])
        inner.append([inverse, from_next])
    inputs = [beyond, *(cs.vec(x) for x in (k, d, m)), rates]
    outputs = [_column(blocks) for blocks in (carried, outer, inner)]
    return cs.Function("eliminate", inputs, outputs, {"cse": True})


def reduce(r: cs.SX, outer: cs.SX, beyond: cs.SX) -> cs.SX:
    """Return f_k (4, 3) from r_k, the second output of ``eliminate`` (48,), and f_k+1."""
    columns = [_minus(_components(r, system), _times(bp, _components(beyond, system)))
               for system, (bp,) in zip(SYSTEMS, _matrices(outer, 1), strict=True)]  # fmt: skip
    return cs.horzcat(*(x for column in columns for x in column))


def substitute(f: cs.SX, inner: cs.SX, before: cs.SX) -> cs.SX:
    """Return x_k (4, 3) from f_k, the third output of ``eliminate`` (96,), and x_k-1."""
    columns = [_times(p, _minus(_components(f, system), _times(c, _components(before, system))))
               for system, (p, c) in zip(SYSTEMS, _matrices(inner, 2), strict=True)]  # fmt: skip
    return cs.horzcat(*(x for column in columns for x in column))


def _components(vectors: cs.SX, columns: slice) -> Complex:
    return cs.horzsplit(vectors[:, columns])


def _matrices(column: cs.SX, count: int) -> list[list[Complex]]:
    """Return the real and the complex blocks in a column, as many of each."""
    blocks = iter([cs.reshape(block, NODE, NODE) for block in cs.vertsplit(column, BLOCK)])
    return [[[next(blocks) for _ in range(components)] for _ in range(count)] for components in (1, 2)]


def _column(systems: Sequence[Sequence[Complex]]) -> cs.SX:
    """Return blocks as a column, as ``_matrices`` takes it."""
    return cs.densify(cs.vertcat(*(cs.vec(x) for blocks in systems for block in blocks for x in block)))


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
        if len(a) == 1:
            return [1 / a[0]]
        norm = a[0] ** 2 + a[1] ** 2
        return [a[0] / norm, -a[1] / norm]
    first, last = slice(0, size // 2), slice(size // 2, size)
    a11, a12, a21, a22 = ([x[i, j] for x in a] for i in (first, last) for j in (first, last))
    inverse = _inverse(a11)
    a21_inverse, inverse_a12 = _times(a21, inverse), _times(inverse, a12)
    schur = _inverse(_minus(a22, _times(a21_inverse, a12)))
    below, beside = _times(schur, a21_inverse), _times(inverse_a12, schur)
    above = [x + y for x, y in zip(inverse, _times(inverse_a12, below), strict=True)]
    return [cs.blockcat([[p, -q], [-r, s]]) for p, q, r, s in zip(above, beside, below, schur, strict=True)]
