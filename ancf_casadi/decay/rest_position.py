"""Rest position of a free decay: the equilibrium about which a mode oscillates, in the unit of the sensor.

    zero        0
    constant    d
    drift       d + v t                              a sensor or a temperature that drifts
    creep       d + (v/k) (1 - exp(-k t))            polymers and joints that yield further after the release

d is the position at the release and v its velocity there.  Creep approaches d + v/k at the rate k; with k = 0 it is a
drift, which is a bound of the unknown, and no special case with m(x) = (1 - exp(-x))/x of ``closed_forms``:

    d + v t m(k t).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypeVar

import casadi as cs

from ancf_casadi.decay.closed_forms import mean_decay

Rest = Literal["zero", "constant", "drift", "creep"]
Time = TypeVar("Time", cs.MX, cs.DM)

REST_TERMS: Mapping[Rest, tuple[str, ...]] = {
    "zero": (),
    "constant": ("offset",),
    "drift": ("offset", "drift"),
    "creep": ("offset", "drift", "creep"),
}


def rest_position(time: Time, terms: Sequence[Time]) -> Time:
    """Return the rest position at times (s) after the release, given values of the unknowns in ``REST_TERMS``."""
    position = 0 * time
    if terms:
        position = position + terms[0]
    if len(terms) > 1:
        position = position + terms[1] * time * (mean_decay(terms[2] * time) if len(terms) > 2 else 1)
    return position
