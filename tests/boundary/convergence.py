"""Errors of the second frequency for each support against the number of elements."""

import numpy as np

from ancf_casadi import Clamp, Guide, Pin, Roller
from tests.boundary.frequencies import omegas
from tests.boundary.unit_beam import unit_beam

MESHES = (8, 16, 32)
HELD = {  # supports, and (omega L^2 (mu/E I)^(1/2))^(1/2) of the second mode that is not rigid
    "Clamp, Clamp": ((Clamp(0.0), Clamp(1.0)), 7.853204624095838),
    "Pin, Pin": ((Pin(0.0), Pin(1.0)), 2 * np.pi),
    "Clamp, Roller": ((Clamp(0.0), Roller(1.0)), 7.068582745628732),
    "Clamp, Guide across": ((Clamp(0.0), Guide(1.0, (0.0, 1.0))), 5.4978039190008355),
    "Pin, Guide across": ((Pin(0.0), Guide(1.0, (0.0, 1.0))), 3 * np.pi / 2),
    "none": ((), 7.853204624095838),
}


def errors(name):
    """Return the relative error of omega on each mesh; with E A = 1e6, rounding stays far below."""
    supports, root = HELD[name]
    return np.array([omegas(unit_beam(n, axial=1e6, supports=supports), 2)[1] / root**2 - 1 for n in MESHES])


def order(found):
    """Return the order of convergence between the two finest meshes."""
    return float(np.log2(found[-2] / found[-1]))
