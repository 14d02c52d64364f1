"""Initial state of a motion.

At the start, a beam at rest under gravity, a flow and the load at its tip at this instant, or straight as
manufactured at its first support, moves with its clamp as one rigid body.  With the velocity v_0 of the clamp and its
angular velocity w,

    r_t = v_0 + w (z x (r - r_0)),        tau_t = w (z x tau),

so that a base motion that begins with a velocity causes no impact on the clamp.  With the start ``impact`` the beam is
at rest instead, and the clamp strikes it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.excitation import Excitation
from ancf_casadi.dynamics.placed_load import coordinates_at_rest
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.vibration.equilibrium import Equilibrium

Start = Literal["equilibrium", "straight", "impact"]
AT_REST = ("equilibrium", "impact")  # starts in the shape at rest

LOAD_NAMES = ("force_x", "force_y", "moment")  # N, N, N m
START_LOAD_NAMES = (*LOAD_NAMES, *(f"{name}_rate" for name in LOAD_NAMES))


def initial_state(equations: Equations, excitation: Excitation, start: Start | Equilibrium | State) -> State:
    """Return the initial state of a motion under the first piece of its excitation."""
    if isinstance(start, State):
        return start
    model = equations.model
    _, velocity, _, load = np.split(excitation.at(0.0), [NODE, 2 * NODE, 3 * NODE])
    if isinstance(start, Equilibrium):
        coordinates = start.coordinates
    elif start == "straight":
        coordinates = model.straight_at_support
    else:
        coordinates = coordinates_at_rest(model, load, equations.place, equations.flow)
    if start == "impact":
        return State(coordinates, np.zeros(model.size))
    velocities = model.rigid_motion(coordinates, velocity).full().ravel()
    return State(coordinates, model.whole(model.of_free(velocities), velocity))
