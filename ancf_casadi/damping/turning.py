"""Rotation of generic damping with the clamp.

The matrix B = M Phi of the generic law belongs to a beam that starts along its axis a, |a| = 1.  Where the clamped node
has the slope tau, |tau| = 1, the clamp has turned the beam and its modes by the angle from a to tau,

    R = [[c, -s], [s, c]],    c = a . tau,    s = a x tau.

R acts on each position and each slope, which are pairs (x, y) of B's rows, and the damping force is

    Q = R B diag(d) B^T R^T e_t.

The rates e_t remain those of the laboratory frame: external damping is motion against the still air.
"""

from __future__ import annotations

import casadi as cs

Direction = tuple[float, float] | cs.MX


def turned(vectors: cs.MX, start: Direction, end: Direction) -> cs.MX:
    """Return the pairs (x, y) in the columns of ``vectors``, turned by the angle from one unit vector to another.

    From a to tau this is multiplication by R, from tau to a by R^T.
    """
    cosine, sine = start[0] * end[0] + start[1] * end[1], start[0] * end[1] - start[1] * end[0]
    rotation = cs.blockcat([[cosine, -sine], [sine, cosine]])
    return cs.reshape(rotation @ cs.reshape(vectors, 2, -1), *vectors.shape)
