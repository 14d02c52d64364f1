"""Buckled beams, and their vibration, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.  A support moves an
end of the beam along the axis, and Newton's method starts from a bent shape, so that no imperfection is needed.
"""

import numpy as np
from scipy.optimize import brentq

from ancf_casadi import Clamp, Equilibrium, Model, Pin, Roller, natural_modes
from ancf_casadi.vibration.assembly import Position, Structure
from ancf_casadi.vibration.equilibrium import neighbouring_equilibrium
from tests.boundary.statics import nodal_force
from tests.boundary.unit_beam import AXIAL, unit_beam

RADIUS_OF_GYRATION = AXIAL**-0.5


def turned(model, angles):
    """Return the coordinates of a beam along x whose nodes are turned by some angles, without stretching it."""
    middle = (angles[:-1] + angles[1:]) / 2
    places = np.vstack(
        [np.zeros(2), np.cumsum(np.column_stack([np.cos(middle), np.sin(middle)]), axis=0) / middle.size]
    )
    e = model.straight.copy().reshape(-1, 4)
    e[model.root :] = np.column_stack([places, np.cos(angles), np.sin(angles)])
    return e.ravel()


def settled(model, e):
    """Return the equilibrium next to some coordinates; None if Newton's method does not find it."""
    way = model.with_fixed_base(model.of_free(e)) + model.whole_of_base @ [0.0, 0.0, 1.0, 0.0] - e
    at = neighbouring_equilibrium(Structure.of(model), Position.of(e), support_motion=way)
    return at and Equilibrium(model, at.coordinates, remainder=at.remainder)


def reached(supports, rest, angle, targets):
    """Return the equilibria at which the angle at a point takes some values, as the far support moves towards x = 0."""

    def pushed(x, near):
        return settled(Model(near.model.beam.with_(supports=supports(x))), near.coordinates)

    found, step = [], 0.01
    for target in targets:
        while angle(following := pushed(rest.tip[0] - step, rest) or rest) < target:
            step = step / 2 if following is rest else 1.5 * step
            rest = following
        near, bounds = rest, (following.tip[0], rest.tip[0])
        exact = brentq(lambda x, a=near, b=target: angle(pushed(x, a)) - b, *bounds, xtol=1e-13)
        found.append(pushed(exact, near))
    return found


def elastica_cantilever_axial(n):
    """A roller moves the tip towards the clamp; the force is its reaction."""
    degrees, arc = np.array([20.0, 60.0, 100.0, 140.0, 176.0]), np.linspace(0.0, 1.0, n + 1)

    def supports(x):
        return Clamp(0.0), Roller(1.0, (0.0, 1.0), displacement=(x - 1.0, 0.0))

    shape = turned(Model(unit_beam(n)), 0.3 * np.sin(np.pi / 2 * arc))
    start = settled(Model(unit_beam(n, supports=supports(shape[-4]))), shape)
    rests = reached(supports, start, lambda rest: abs(rest.tip_angle), np.radians(degrees))
    return [(-nodal_force(rest, 1.0)[0] / (np.pi**2 / 4), *rest.tip) for rest in rests]


def elastica_clamped_clamped(n):
    """The far clamp moves; the inflection is at a quarter of the length, and n a multiple of 4."""
    arc = np.linspace(0.0, 1.0, n + 1)

    def supports(x):
        return Clamp(0.0), Clamp(1.0, displacement=(x - 1.0, 0.0))

    def inflection(rest):
        x, y = rest.model.slope_interpolation(0.25) @ rest.coordinates
        return np.arctan2(y, x)

    shape = turned(Model(unit_beam(n)), 0.3 * np.sin(2 * np.pi * arc))
    start = settled(Model(unit_beam(n, supports=supports(shape[-4]))), shape)
    rests = reached(supports, start, inflection, np.radians([20.0, 60.0, 100.0]))
    return [(nodal_force(rest, 0.0)[0] / (4 * np.pi**2), rest.tip[0], rest.position(0.5)[1]) for rest in rests]


def about_buckled(n, ends, critical, slope, rises):
    """Return three frequencies of a beam shortened so that it rises by b radii of gyration, for each b."""
    found, arc = [], np.linspace(0.0, 1.0, n + 1)
    for b in rises:
        rise = b * RADIUS_OF_GYRATION
        shortening = critical / AXIAL + np.pi**2 / 4 * rise**2
        model = Model(unit_beam(n, supports=(ends(0.0), ends(1.0, displacement=(-shortening, 0.0)))))
        rest = settled(model, turned(model, rise * np.pi * slope(np.pi * arc)))
        found.append(natural_modes(model, count=3, equilibrium=rest).angular_frequencies)
    return found


def postbuckled_pp(n):
    return about_buckled(n, Pin, np.pi**2, np.cos, (1.0, 2.0, 4.0, 10.0))


def postbuckled_cc(n):
    return about_buckled(n, Clamp, 4 * np.pi**2, lambda x: np.sin(2 * x), (1.0, 4.0, 10.0))
