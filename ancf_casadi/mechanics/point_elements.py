"""Springs, dashpots and masses at the nodes of a beam, as elements.

The base is a node of its own, with position r_b and slope tau_b.  A point of the base, where the node (r, tau) of the
beam is without load, has the position

    p = r_b + alpha tau_b + beta n_b,    n_b = tau_b turned by 90 degrees,

with constants alpha and beta, m.  The attachments contribute

    spring              U = 1/2 (k_x d_x^2 + k_y d_y^2),    d = r - p,
    torsional spring    U = 1/2 k theta^2,                  theta = angle from tau_b to tau, less that without load,
    dashpot             Q = c_x d_x,t, c_y d_y,t            on the beam,
    mass                T = 1/2 m r_t^2 + 1/2 J tau_t^2,    weight m g.

The rotary inertia J is that of a slope of length 1, which only rotates.  A mass is a point, so neither drag nor
friction acts on it.

Length of the slopes.  The axial strains at the two Gauss points of all elements do not change if all slopes become
longer by the same amount while the nodes stay.  A clamp or a guide fixes this amount; where no support does, the
element

    slope length        U = 1/2 E A l (|tau| - 1)^2

does, at one node.  It takes part in no stretching or bending of the beam.
"""

from __future__ import annotations

from functools import cache

import casadi as cs

from ancf_casadi.mechanics.element import ELEMENT_PROPERTIES, Element, derived_element, symbols


def _relative_position(e: cs.SX, alpha: cs.SX, beta: cs.SX) -> cs.SX:
    """Return d (2,), linear in e = (r_b, tau_b, r, tau)."""
    base, slope, position, _ = cs.vertsplit(e, 2)
    return position - base - alpha * slope - beta * cs.vertcat(-slope[1], slope[0])


@cache
def spring() -> Element:
    """Derive the Functions of a spring for e = (r_b, tau_b, r, tau) and p = (alpha, beta, x, y, k)."""
    e, e_t, p = symbols(8, 5)
    elongation = cs.dot(_relative_position(e, p[0], p[1]), p[2:4])
    return derived_element((e, e_t, p), cs.SX([0, 0, 1, 0, 0, 0, 1, 0]), (elongation, p[4]))


@cache
def dashpot() -> Element:
    """Derive the Functions of a dashpot; as ``spring``, with the coefficient c (N s/m) in place of k."""
    e, e_t, p = symbols(8, 5)
    elongation_rate = cs.dot(_relative_position(e_t, p[0], p[1]), p[2:4])
    force = p[4] * cs.gradient(elongation_rate, e_t) * elongation_rate
    return derived_element((e, e_t, p), cs.SX([0, 0, 1, 0, 0, 0, 1, 0]), dashpot=force)


@cache
def rotational_spring() -> Element:
    """Derive the Functions of a torsional spring for e = (r_b, tau_b, r, tau).

    Its properties are cosine and sine of the angle from the axis of the beam to the slope without load, the axis, and
    the stiffness k, N m/rad.
    """
    e, e_t, p = symbols(8, 5)
    cosine, sine, *axis, stiffness = cs.vertsplit(p)

    def turn(slope: cs.SX) -> cs.SX:
        return cs.vertcat(cosine * slope[0] - sine * slope[1], sine * slope[0] + cosine * slope[1])

    base, slope = turn(e[2:4]), e[6:8]
    theta = cs.atan2(base[0] * slope[1] - base[1] * slope[0], cs.dot(base, slope))
    straight = cs.vertcat(0, 0, *axis, 0, 0, turn(cs.vertcat(*axis)))
    return derived_element((e, e_t, p), straight, (theta, stiffness))


@cache
def slope_length() -> Element:
    """Derive the Functions of the element that fixes the length of the slopes, for e = (r, tau)."""
    e, e_t, p = symbols(4, ELEMENT_PROPERTIES)
    width, thickness, _, elastic_modulus, l, *axis = cs.vertsplit(p)
    sigma = cs.norm_2(e[2:]) - 1
    return derived_element((e, e_t, p), cs.vertcat(0, 0, *axis), (sigma, elastic_modulus * width * thickness * l))


@cache
def point_mass() -> Element:
    """Derive the Functions of a mass m (kg), its only property, at a node with coordinates e = (r, tau)."""
    e, e_t, m = symbols(4, 1)
    position = cs.DM([[1, 0], [0, 1], [0, 0], [0, 0]])  # r = position^T e
    return derived_element((e, e_t, m), cs.SX.zeros(4), mass=m * position @ position.T, gravity=m * position)


@cache
def rotary_inertia() -> Element:
    """Derive the Functions of a moment of inertia J (kg m^2), its only property, at a node with e = (r, tau)."""
    e, e_t, inertia = symbols(4, 1)
    slope = cs.DM([[0, 0], [0, 0], [1, 0], [0, 1]])
    return derived_element((e, e_t, inertia), cs.SX([0, 0, 1, 0]), mass=inertia * slope @ slope.T)
