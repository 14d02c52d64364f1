"""Natural frequencies of beams with supports, masses and springs, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.
"""

import numpy as np
import scipy.linalg

from ancf_casadi import (
    Clamp,
    Model,
    Pin,
    PointMass,
    Roller,
    RotationalSpring,
    Spring,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.mechanics.nodes import NODE
from tests.boundary.unit_beam import AXIAL, unit_beam


def omegas(beam, count, **loads):
    """Return the lowest frequencies above 0 under loads of ``static_equilibrium``, rad/s."""
    model = Model(beam)
    rest = static_equilibrium(model, **loads)
    found = natural_modes(model, count=count + 3, equilibrium=rest).angular_frequencies
    return found[found > 0.0][:count]


def freq_clamped_clamped(n):
    return omegas(unit_beam(n, supports=(Clamp(0.0), Clamp(1.0))), 4)


def freq_pinned_pinned(n):
    return omegas(unit_beam(n, supports=(Pin(0.0), Pin(1.0))), 4)


def freq_free_free(n):
    return omegas(unit_beam(n, supports=()), 4)


def freq_cantilever_mid_mass(n):
    return omegas(unit_beam(n, attachments=(PointMass(0.5, 1.0),)), 4)


def freq_pp_mid_mass(n):
    return omegas(unit_beam(n, supports=(Pin(0.0), Pin(1.0)), attachments=(PointMass(0.5, 1.0),)), 4)


def freq_tip_spring(n):
    return [omegas(unit_beam(n, attachments=(Spring(1.0, (0.0, k)),)), 2) for k in (1.0, 10.0, 100.0)]


def freq_clamped_pinned_rotary_inertia(n):
    wheel = PointMass(1.0, 0.0, rotary_inertia=1.0)
    return omegas(unit_beam(n, supports=(Clamp(0.0), Pin(1.0)), attachments=(wheel,)), 2)


def freq_pp_mid_spring(n):
    return omegas(unit_beam(n, supports=(Pin(0.0), Pin(1.0)), attachments=(Spring(0.5, (0.0, 100.0)),)), 4)


def freq_rotational_springs(n):
    springs = RotationalSpring(0.0, 10.0), RotationalSpring(1.0, 10.0)
    return omegas(unit_beam(n, supports=(Pin(0.0), Pin(1.0)), attachments=springs), 4)


def freq_free_on_springs(n):
    springs = Spring(0.0, (0.0, 50.0)), Spring(1.0, (0.0, 50.0))
    return omegas(unit_beam(n, supports=(), attachments=springs), 4)


def freq_winkler(n):
    """The foundation is a spring at every node, with the weights of Simpson's rule; n is even."""
    weights = np.resize([2.0, 4.0], n + 1) / (3 * n)
    weights[-1] /= 2
    springs = [Spring(k / n, (0.0, 100.0 * weights[k])) for k in range(1, n + 1)]
    return omegas(unit_beam(n, attachments=springs), 4)


def freq_axial_cc(n):
    """The far clamp sits away from its place without load."""
    tensions = -2 * np.pi**2, 4 * np.pi**2, 400.0
    pairs = [(Clamp(0.0), Clamp(1.0, displacement=(tension / AXIAL, 0.0))) for tension in tensions]
    return [omegas(unit_beam(n, supports=pair), 3) for pair in pairs]


def freq_axial_pp(n):
    """A dead force pulls at a roller."""
    beam = unit_beam(n, supports=(Pin(0.0), Roller(1.0)))
    return [omegas(beam, 3, tip_force=(tension, 0.0)) for tension in (-(np.pi**2) / 2, np.pi**2, 100.0)]


def freq_stepped_cantilever(n):
    thickness = np.sqrt(12 / AXIAL) * np.repeat([1.0, 0.5], n // 2)
    return omegas(unit_beam(n, thickness=thickness.tolist()), 4)


def freq_taper(n):
    """Each element has the section at its middle."""
    middle, thickness = (np.arange(n) + 0.5) / n, np.sqrt(12 / AXIAL)
    thin, thinner, narrow = 1 - 0.5 * middle, 1 - 0.75 * middle, 1 - 0.5 * middle
    tapers = [{"thickness": (thickness * ratio).tolist()} for ratio in (thin, thinner)] + [{"width": narrow.tolist()}]
    return [omegas(unit_beam(n, **taper), 3) for taper in tapers]


def freq_hinged_hanging(n):
    hanging = {"supports": (Pin(0.0),), "axis": (0.0, -1.0)}
    return [omegas(unit_beam(n, gravity=(0.0, -gamma), **hanging), 3) for gamma in (10.0, 1000.0)]


def freq_chain(n, gamma=1e8):
    """Weight of gamma E I/L^3, and as stiff axially as a chain."""
    beam = unit_beam(n, axial=1e5 * AXIAL, supports=(Pin(0.0),), axis=(0.0, -1.0), gravity=(0.0, -gamma))
    return omegas(beam, 4) / np.sqrt(gamma)


def freq_rotating_lag(n):
    """From the matrices of the model, in the frame that turns at W, as the toolkit has no modes about steady rotation.

    With the turned coordinates e the motion is M e_tt + 2 W M J e_t + Q_e(e) - W^2 M e = 0, J a turn by 90 degrees.
    """
    model, found = Model(unit_beam(n)), []
    p, free = model.properties, slice(NODE, model.size)
    mass, turn = model.mass(p).full(), np.kron(np.eye(model.size // 2), [[0.0, -1.0], [1.0, 0.0]])
    for speed in (1.0, 3.0, 5.0, 8.0, 12.0):
        e, correction = model.straight.copy(), np.ones(1)
        while abs(correction).max() > 1e-12:
            unbalance = model.elastic_force(e, p).full().ravel() - speed**2 * mass @ e
            stiffness = (model.tangent_stiffness(e, p).full() - speed**2 * mass)[free, free]
            correction = np.linalg.solve(stiffness, unbalance[free])
            e[free] -= correction
        coriolis = (2 * speed * mass @ turn)[free, free]
        none, one = np.zeros_like(stiffness), np.eye(len(stiffness))
        first = np.block([[none, one], [-stiffness, -coriolis]])
        second = np.block([[one, none], [none, mass[free, free]]])
        found.append(np.sort(scipy.linalg.eigvals(np.linalg.solve(second, first)).imag))
    return [values[values > 0.0][:3] for values in found]
