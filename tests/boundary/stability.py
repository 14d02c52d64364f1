"""Critical loads and damped modes, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.
"""

import numpy as np
from scipy.optimize import bisect

from ancf_casadi import (
    Clamp,
    Dashpot,
    Guide,
    LineLoad,
    Model,
    Pin,
    PointLoad,
    PointMass,
    RayleighDamping,
    Roller,
    critical_load,
    damped_modes,
    static_equilibrium,
)
from ancf_casadi.vibration.statics import primary_equilibrium
from tests.boundary.unit_beam import AXIAL, unit_beam

PUSH = PointLoad((-1.0, 0.0))
FOLLOWING = PointLoad((-1.0, 0.0), follower=True)


def smallest(beam, load, largest, damping=None, steps=20):
    """Return the smallest multiple of a load at which the beam is unstable."""
    return critical_load(Model(beam), [load], damping, largest_factor=largest, steps=steps)


def pairs(beam, count, damping=None):
    """Return real and imaginary parts of the lowest eigenvalues."""
    found = damped_modes(Model(beam), damping, count=count).eigenvalues
    return np.column_stack([found.real, found.imag])


def euler_buckling(n):
    """Cantilever, two hinges, two clamps, and a clamp below an end that shifts aside without turning."""
    ends = [(Clamp(0.0),), (Pin(0.0), Roller(1.0)), (Clamp(0.0), Guide(1.0))]
    factors = [smallest(unit_beam(n, supports=held), PUSH, 60.0).factor for held in ends]

    def buckles(push):
        """Whether the last column is unstable; its end moves along the beam by push/E A and no further."""
        end = Guide(1.0, (0.0, 1.0), displacement=(-push / AXIAL, 0.0))
        return not primary_equilibrium(Model(unit_beam(n, supports=(Clamp(0.0), end))), ()).stable

    return [*factors, bisect(lambda push: buckles(push) - 0.5, 1.0, 20.0, xtol=1e-9)]


def self_weight_buckling(n):
    """The weight is a dead load along the beam."""
    weight = LineLoad((-1.0, 0.0))
    ends = [(Clamp(0.0),), (Pin(0.0), Roller(1.0)), (Clamp(0.0), Roller(1.0)), (Clamp(0.0), Guide(1.0))]
    return [smallest(unit_beam(n, supports=held), weight, 100.0).factor for held in ends]


def beck_column(n):
    model = Model(unit_beam(n))
    flutter = smallest(unit_beam(n), FOLLOWING, 25.0)
    below = static_equilibrium(model, loads=[FOLLOWING.scaled(10.0)])
    growing = flutter.modes.eigenvalues[flutter.modes.eigenvalues.real.argmax()]
    omegas = 2 * np.pi * damped_modes(model, count=2, equilibrium=below).frequencies
    return [flutter.factor, growing.imag, *omegas]


def pfluger_column(n):
    tips = [(PointMass(1.0, ratio),) for ratio in (0.1, 0.5, 1.0, 2.0)]
    return [smallest(unit_beam(n, attachments=tip), FOLLOWING, 25.0).factor for tip in tips]


def beck_with_internal_damping(n):
    laws = [RayleighDamping(beta=eta) for eta in (0.001, 0.01, 0.1)]
    return [smallest(unit_beam(n), FOLLOWING, 25.0, law).factor for law in laws]


def tip_dashpot_weak(n):
    return pairs(unit_beam(n, attachments=(Dashpot(1.0, (0.0, 0.5)),)), 3)


def tip_dashpot_strong(n):
    return pairs(unit_beam(n, attachments=(Dashpot(1.0, (0.0, 5.0)),)), 3)


def kelvin_voigt_pp(n):
    return pairs(unit_beam(n, supports=(Pin(0.0), Pin(1.0))), 3, RayleighDamping(alpha=0.5, beta=1e-3))
