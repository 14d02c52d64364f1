"""A blade in a uniform flow, computed for the reference case of this name in ``references.json``."""

import numpy as np

from ancf_casadi import LineLoad, Model
from ancf_casadi.vibration.assembly import Position, Structure
from ancf_casadi.vibration.equilibrium import neighbouring_equilibrium
from tests.boundary.unit_beam import unit_beam


def blade_in_uniform_flow(n):
    """The drag is a follower load, constant in each element, whose size follows from the slopes by iteration.

    Its logarithm changes by up to seven times its error, so a fifth of the error is taken away at a time.
    """
    model, ends = Model(unit_beam(n, axis=(0.0, 1.0))), np.linspace(0.0, 1.0, n + 1)
    middle = np.array([model.slope_interpolation(s) for s in (ends[:-1] + ends[1:]) / 2])
    rest, drag, found = Position.of(model.straight), np.ones(n), []
    for cauchy in (1.0, 5.0, 10.0, 50.0, 100.0):
        change = np.ones(n)
        while abs(change).max() > 1e-7:
            spans = zip(drag.tolist(), ends[:-1].tolist(), ends[1:].tolist(), strict=True)
            loads = [LineLoad((0.0, -size), begin, end, follower=True) for size, begin, end in spans]
            rest = neighbouring_equilibrium(Structure.of(model, loads), rest)
            slopes = middle @ rest.coordinates
            cosines = slopes[:, 1] / np.linalg.norm(slopes, axis=1)
            change = np.log(cauchy * cosines**2 / drag)
            drag = drag * np.exp(change / 5)
        x, y, *slope = rest.coordinates[-4:]
        found.append((x, y, np.arctan2(*slope), (cosines**3).mean()))
    return found
