"""Rotation of modal (generic) damping with the clamp.

The matrix B = M Phi of the modal law belongs to a beam whose axis at the clamp is a, |a| = 1.  If the clamped node has
the slope tau, |tau| = 1, the clamp has turned the beam and its modes by the angle from a to tau, with the rotation

    R = [[c, -s], [s, c]],    c = a . tau,    s = a x tau.

R acts on the pairs (x, y) of the positions and of the slopes, which are rows of B, and the damping force is

    Q = R B diag(d) B^T R^T e_t.

The velocities e_t remain those in the laboratory frame: external damping resists motion relative to the still air.
"""

from __future__ import annotations

import casadi as cs

Direction = tuple[float, float] | cs.MX


def turned(vectors: cs.MX, start: Direction, end: Direction) -> cs.MX:
    """Return the columns of ``vectors``, with their pairs (x, y) turned by the angle between two unit vectors.

    From a to tau, this multiplies by R; from tau to a, by R^T.
    """
    cosine, sine = start[0] * end[0] + start[1] * end[1], start[0] * end[1] - start[1] * end[0]
    rotation = cs.blockcat([[cosine, -sine], [sine, cosine]])
    return cs.reshape(rotation @ cs.reshape(vectors, 2, -1), *vectors.shape)
