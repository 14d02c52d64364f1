"""Equilibria of beams under dead loads and displaced supports, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.
"""

import numpy as np
from numpy.polynomial import Chebyshev

from ancf_casadi import Beam, Clamp, LineLoad, Model, Pin, PointLoad, Roller, static_equilibrium
from ancf_casadi.vibration.statics import primary_equilibrium
from tests.boundary.unit_beam import HERE, unit_beam

MONDKAR_POWELL = {"length": 20.0, "width": 1.0, "thickness": 0.125, "elastic_modulus": 30e6, "density": 2.54e-4}
# inch, lb and lb s^2/in^4
FEET, RISE = 12.943, 0.386  # half span and rise of Williams' frame, in
RADIUS, OPENING = 100.0, np.radians(215.0)  # of the deep arch


def section_of(bending, axial):
    """Return width, thickness and elastic modulus of a section with the stiffnesses E I and E A."""
    thickness = np.sqrt(12 * bending / axial)
    return {"width": 1.0, "thickness": thickness, "elastic_modulus": axial / thickness}


def limit_point(load, begin, end):
    """Return the displacement in an interval where the load neither grows nor falls, and the load there."""
    curve = Chebyshev.interpolate(np.vectorize(load), 8, (begin, end))
    (place,) = [x.real for x in curve.deriv().roots() if not x.imag and begin < x.real < end]
    return place, curve(place)


def nodal_force(rest, point):
    """Return the force of supports and loads on the node at a point, (2,)."""
    model = rest.model
    forces = model.elastic_force(rest.coordinates, model.properties).full().ravel()
    return forces[model.nodes_of(point)[:2]]


def bent(rest):
    """Return shortening, deflection and angle of the tip of a beam along x."""
    return 1 - rest.tip[0], rest.tip[1], rest.tip_angle


def tip_moment_rollup(n):
    """With 40 elements, the mesh is unstable in the last case, two turns with 0.31 rad per element."""
    moments = [PointLoad(moment=turns * np.pi) for turns in (0.5, 1.0, 1.5, 2.0, 4.0)]
    return [primary_equilibrium(Model(unit_beam(n)), [moment]).tip for moment in moments]


def dead_tip_force(n):
    model = Model(unit_beam(n))
    return [bent(static_equilibrium(model, tip_force=(0.0, force))) for force in (1.0, 2.0, 5.0, 10.0)]


def follower_tip_force(n):
    cantilever = {"length": 100.0, "density": 1.0, "elements": n, **section_of(3.5e7, 4.2e8)}
    model, found = Model(Beam.uniform(**cantilever, **HERE)), []
    for force in (1e4, 1.5e4, 3e4, 6e4, 1e5, 1.3e5):
        x, y = static_equilibrium(model, loads=[PointLoad((0.0, force), follower=True)]).tip
        found.append((x - 100.0, y))
    return found


def uniform_dead_load(n):
    """The load is the weight."""
    return [bent(static_equilibrium(Model(unit_beam(n, gravity=(0.0, load))))) for load in (1.0, 2.0, 5.0, 10.0)]


def uniform_follower_load(n):
    model, pressures = Model(unit_beam(n)), (2.0, 5.0, 10.0)
    return [bent(static_equilibrium(model, loads=[LineLoad((0.0, load), follower=True)])) for load in pressures]


def inclined_tip_force(n):
    model, found = Model(unit_beam(n)), []
    for degrees in (45.0, 135.0):
        direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        for force in (2.0, 5.0, 10.0):
            rest = static_equilibrium(model, tip_force=tuple(force * direction))
            found.append((*rest.tip, rest.tip_angle))
    return found


def clamped_clamped_centre_force(n):
    model = Model(Beam.uniform(**MONDKAR_POWELL, elements=n, supports=(Clamp(0.0), Clamp(20.0)), **HERE))
    found = []
    for force in (20.0, 100.0, 200.0, 640.0, 1000.0):
        rest = static_equilibrium(model, loads=[PointLoad((0.0, force), point=10.0)])
        found.append((rest.position(10.0)[1], -nodal_force(rest, 0.0)[0]))
    return found


def williams_toggle(n):
    """One half of the frame; a clamp moves the apex down and carries half of the load."""
    length = np.hypot(FEET, RISE)
    half = {"length": length, "density": 1.0, "elements": n, **section_of(9270.0, 1.885e6)}

    def load(w):
        pair = Clamp(0.0), Clamp(length, displacement=(0.0, -w))
        beam = Beam.uniform(**half, supports=pair, axis=(FEET, RISE), gravity=(0.0, 0.0))
        return -2 * nodal_force(static_equilibrium(Model(beam)), length)[1]

    loads = [load(w) for w in np.arange(1, 8) / 10]
    return [*loads, *limit_point(load, 0.2, 0.3), *limit_point(load, 0.35, 0.45)]


def deep_arch_clamped_hinged(n):
    """A roller moves the crown down and carries the load, up to the largest load."""
    length = RADIUS * OPENING
    arch = {
        "length": length,
        "density": 1.0,
        "elements": n,
        "natural_curvature": -1 / RADIUS,
        "axis": (np.cos(OPENING / 2), np.sin(OPENING / 2)),
        "gravity": (0.0, 0.0),
        **section_of(1e6, 1e8),
    }

    def pushed(down):
        held = Clamp(0.0), Roller(length / 2, displacement=(0.0, -down)), Pin(length)
        return static_equilibrium(Model(Beam.uniform(**arch, supports=held)))

    def load(down):
        return -nodal_force(pushed(down), length / 2)[1]

    top, largest = limit_point(load, 112.5, 115.0)
    crown = pushed(top)
    across = crown.position(length / 2)[0] - (crown.model.interpolation(length / 2) @ crown.model.straight)[0]
    return [largest, abs(across), top]


def initially_curved_straightened(n):
    rest = static_equilibrium(Model(unit_beam(n, natural_curvature=3.0)), tip_moment=-3.0)
    return [*rest.tip, rest.tip_angle]
