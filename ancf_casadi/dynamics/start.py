"""The state in which a motion begins.

A beam at rest under gravity, or straight as manufactured, moves with its clamp as one rigid body: with the velocity
v_0 of the clamp and its angular velocity w,

    r_t = v_0 + w (z x (r - r_0)),        tau_t = w (z x tau),

so that no impact acts on the clamp where the base motion begins with a velocity.  An impact is a start of its own.
"""

from __future__ import annotations

import math
from typing import Literal, get_args

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.mechanics.strain import axial_strain
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import shown
from ancf_casadi.vibration.equilibrium import Equilibrium, static_equilibrium

Start = Literal["equilibrium", "straight", "impact"]

LARGEST_STRETCH = 0.01  # axial strain of a given state; that of an equilibrium is balanced
AGREEMENT = (
    1e-6  # of the length (positions), of 1 (slopes) and of the largest velocity: difference of a state and its base
)


def base_of(model: Model, base: BaseMotion | None, start: Start | Equilibrium | State) -> BaseMotion:
    """Return the base motion: as given, or a clamp fixed at the origin, or where a given state has it."""
    if base is not None:
        return base
    if not isinstance(start, State) or start.coordinates.shape != (model.size,):
        return FixedBase()
    x, y, slope_x, slope_y = start.coordinates[:NODE].tolist()
    ax, ay = model.beam.axis
    return FixedBase((x, y), math.atan2(ax * slope_y - ay * slope_x, ax * slope_x + ay * slope_y))


def initial_state(model: Model, clamp: cs.Function, start: Start | Equilibrium | State) -> State:
    """Return the state at the start of a motion.

    Parameters
    ----------
    model : Model
        The beam.
    clamp : Function
        (t) -> position, velocity and acceleration of the clamped node, (12,).
    start : {"equilibrium", "straight", "impact"}, Equilibrium or State
        The start, as of ``simulate``.

    Raises
    ------
    InputError
        If the start is not one of those that ``simulate`` knows, belongs to another model, or is a state that
        stretches the beam or does not agree with the motion of the clamp.
    EquilibriumError
        If there is no equilibrium to start from.
    """
    if isinstance(start, State):
        _check_state(model, clamp(start.time).full().ravel(), start)
        return start
    check_start(model, start)
    rates = clamp(0.0).full().ravel()[NODE : 2 * NODE]
    if isinstance(start, Equilibrium):
        coordinates = start.coordinates
    else:
        coordinates = model.straight if start == "straight" else static_equilibrium(model).coordinates
    if start == "impact":
        return State(coordinates, np.zeros(model.size))
    return State(coordinates, rigid_motion(model)(coordinates, rates).full().ravel())


def check_start(model: Model, start: Start | Equilibrium | State) -> None:
    """Refuse a start of no known kind, or an equilibrium of another model.

    Raises
    ------
    InputError
        If it is one.
    """
    if isinstance(start, Equilibrium):
        if start.model != model:
            raise InputError("the equilibrium belongs to another model", "start")
    elif not isinstance(start, State) and not (isinstance(start, str) and start in get_args(Start)):
        known = ", ".join(get_args(Start))
        raise InputError(f"must be one of {known}, an Equilibrium or a State, got {shown(start)}", "start")


def rigid_motion(model: Model) -> cs.Function:
    """(coordinates, rates of the clamped node) -> rates of a beam that moves as one with the clamped node."""
    e, rates = cs.MX.sym("e", model.size), cs.MX.sym("rates", NODE)
    nodes = cs.reshape(e, NODE, -1)
    x, y = nodes[2, 0], nodes[3, 0]
    turn = (x * rates[3] - y * rates[2]) / (x * x + y * y)
    arms = nodes - cs.vertcat(nodes[:2, 0], 0.0, 0.0)
    turning = cs.vertcat(-arms[1, :], arms[0, :], -arms[3, :], arms[2, :])
    moved = turn * turning + cs.vertcat(rates[:2], 0.0, 0.0)
    return cs.Function("rigid_motion", [e, rates], [cs.vec(moved)])


def _check_state(model: Model, clamp: Array, state: State) -> None:
    """Refuse a state that does not fit the model, stretches the beam, or disagrees with its clamp (12,)."""
    for name, given in (("coordinates", state.coordinates), ("velocities", state.velocities)):
        if given.shape != (model.size,) or not np.isfinite(given).all():
            raise InputError(f"the {name} must be {model.size} finite numbers", "start")
    stretch = np.abs(axial_strain(model.gauss_slopes(state.coordinates), "engineering")).max()
    if stretch > LARGEST_STRETCH:
        raise InputError(
            f"stretches the beam by {100 * stretch:.1f} %, which sets off axial waves; bend it without stretching, "
            "as static_equilibrium with a tip load does",
            "start",
        )
    node, rates, _ = np.split(clamp, 3)
    off = np.abs(state.coordinates[:NODE] - node) / np.array([model.beam.length, model.beam.length, 1.0, 1.0])
    if off.max() > AGREEMENT:
        raise InputError(
            f"the clamp of the state is at {_point(state.coordinates)}, that of the base motion at {_point(node)} at "
            f"{state.time:g} s, or turned against it; give the base motion that led there and the time of the state, "
            "or no base to hold the clamp where it is",
            "start",
        )
    difference = np.abs(state.velocities[:NODE] - rates).max()
    if difference > AGREEMENT * max(np.abs(state.velocities).max(), np.abs(rates).max()):
        raise InputError(
            f"the clamp of the state has the velocity {_point(state.velocities)} m/s, the base motion "
            f"{_point(rates)} m/s at {state.time:g} s, which is an impact; give the base motion that led there and the "
            "time of the state",
            "start",
        )


def _point(values: Array) -> str:
    return f"({values[0] + 0.0:.6g}, {values[1] + 0.0:.6g})"  # no negative zero
