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


def turned(vectors: cs.MX, axis: tuple[float, float], slope: cs.MX) -> cs.MX:
    """Return R times each pair (x, y) in the columns of ``vectors``, with the axis a and the clamped slope tau (2,)."""
    (x, y), (slope_x, slope_y) = axis, cs.vertsplit(slope)
    cosine, sine = x * slope_x + y * slope_y, x * slope_y - y * slope_x
    rotation = cs.blockcat([[cosine, -sine], [sine, cosine]])
    return cs.reshape(rotation @ cs.reshape(vectors, 2, -1), *vectors.shape)
