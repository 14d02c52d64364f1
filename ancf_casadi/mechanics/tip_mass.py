"""The mass at the tip: one more element, with a single node.

A mass m has the inertia m r_tt and the weight m g.  It is a point, so neither drag nor friction acts on it.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs

from ancf_casadi.mechanics.element import Element, derived_element


@lru_cache(maxsize=1)
def tip_mass() -> Element:
    """Derive the Functions of a mass m (kg), its only property, at a node with coordinates e = (r, tau)."""
    e, e_t, m = cs.SX.sym("e", 4), cs.SX.sym("e_t", 4), cs.SX.sym("m")
    position = cs.DM([[1, 0], [0, 1], [0, 0], [0, 0]])  # r = position^T e
    return derived_element(
        inputs=(e, e_t, m),
        straight=cs.SX.zeros(4),
        strains=cs.SX(0, 1),
        weights=cs.SX(0, 1),
        mass=m * position @ position.T,
        line_mass=cs.SX.zeros(4, 4),
        gravity=m * position,
    )
