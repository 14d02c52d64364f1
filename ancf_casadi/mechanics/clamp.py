"""The elastic clamp: a torsional spring between the base and the first node of the beam.

A real clamp yields a little.  With a clamp of torsional stiffness k, the base is a massless node of its own, and the
first node of the beam is free.  With position and slope (r_b, tau_b) of the base, (r_0, tau_0) of the first node, and

    d = r_0 - r_b,        sigma = |tau_0| - |tau_b|,        theta = angle from tau_b to tau_0,

the clamp stores

    U = 1/2 (E A / l) d.d + 1/2 E A l sigma^2 + 1/2 k theta^2.

The first two terms hold the position of the beam and the length of its slope as stiffly as the first element resists
stretching.  The clamp is thus one more element, with strains (d, sigma, theta) and no mass.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as cs

from ancf_casadi.mechanics.element import ELEMENT_PROPERTIES, Element, derived_element


@lru_cache(maxsize=1)
def elastic_clamp() -> Element:
    """Derive the Functions of a clamp.

    Its coordinates are e = (r_b, tau_b, r_0, tau_0); its properties are those of the first element, then the torsional
    stiffness k, N m/rad.
    """
    e, e_t, p = cs.SX.sym("e", 8), cs.SX.sym("e_t", 8), cs.SX.sym("p", ELEMENT_PROPERTIES + 1)
    width, thickness, _, elastic_modulus, l, *axis, stiffness = cs.vertsplit(p)
    base, base_slope, first, slope = cs.vertsplit(e, 2)
    theta = cs.atan2(base_slope[0] * slope[1] - base_slope[1] * slope[0], cs.dot(base_slope, slope))
    sigma = cs.norm_2(slope) - cs.norm_2(base_slope)
    axial = elastic_modulus * width * thickness
    return derived_element(
        inputs=(e, e_t, p),
        straight=cs.vertcat(0, 0, *axis, 0, 0, *axis),
        strains=cs.vertcat(first - base, sigma, theta),
        weights=cs.vertcat(axial / l, axial / l, axial * l, stiffness),
        mass=cs.SX.zeros(8, 8),
        line_mass=cs.SX.zeros(8, 8),
        gravity=cs.SX.zeros(8, 2),
    )
