"""Initial state of a motion.

At the start, a beam at rest under gravity, a flow and the load at its tip at this instant, or straight as
manufactured, moves with its clamp as one rigid body.  With the velocity v_0 of the clamp and its angular velocity w,

    r_t = v_0 + w (z x (r - r_0)),        tau_t = w (z x tau),

so that a base motion that begins with a velocity causes no impact on the clamp.  With the start ``impact`` the beam is
at rest instead, and the clamp strikes it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Literal, get_args

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.excitation import Excitation
from ancf_casadi.dynamics.placed_load import TIP, equilibrium_under
from ancf_casadi.dynamics.tolerance import check_speed
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.mechanics.strain import axial_strain
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import is_choice, shown
from ancf_casadi.vibration.equilibrium import Equilibrium

Start = Literal["equilibrium", "straight", "impact"]
AT_REST = ("equilibrium", "impact")  # starts in the shape at rest

ROUNDED_STRAIN = 1e-12  # strain that rounding of the coordinates may cause
START_TOLERANCE = 1e-6  # deviation of a state from its base, relative to length, unit slope and largest velocity
LOAD_NAMES = ("force_x", "force_y", "moment")  # N, N, N m
START_LOAD_NAMES = (*LOAD_NAMES, *(f"{name}_rate" for name in LOAD_NAMES))


def initial_state(
    model: Model,
    excitation: Excitation,
    start: Start | Equilibrium | State,
    place: PointLoad | None = TIP,
    further: Sequence[LineLoad] = (),
) -> State:
    """Return the initial state of a motion under the first piece of its excitation, and further loads."""
    if isinstance(start, State):
        _check_state(model, excitation.at(start.time), start)
        return start
    if isinstance(start, Equilibrium):
        if start.model != model:
            raise InputError("the equilibrium belongs to another model", "start")
        if not (start.stable or model.has_short_elements):
            warnings.warn(
                "the start is an unstable equilibrium, so rounding decides when and to which side the beam leaves it; "
                "start from static_equilibrium(model), which is stable, or from a State beside it",
                stacklevel=5,
            )
    elif not is_choice(start, get_args(Start)):
        names = ", ".join(get_args(Start))
        raise InputError(f"must be one of {names}, an Equilibrium or a State, got {shown(start)}", "start")
    node, velocity, _, load = np.split(excitation.at(0.0), [NODE, 2 * NODE, 3 * NODE])
    check_clamp(model, node)
    if isinstance(start, Equilibrium):
        coordinates = start.coordinates
    else:
        straight = start == "straight"
        coordinates = model.straight if straight else equilibrium_under(model, load, place, further).coordinates
    if start == "impact":
        return State(coordinates, np.zeros(model.size))
    moving = rigid_motion(model)(coordinates, velocity).full().ravel()
    return State(coordinates, model.whole(model.of_free(moving), velocity))


def base_of_start(model: Model, start: Start | Equilibrium | State) -> BaseMotion:
    """Return the clamp of a motion whose base is not given: fixed at its place in a state, or at the origin."""
    if not isinstance(start, State) or start.coordinates.shape != (model.size,):
        return FixedBase()
    x, y, *_ = start.coordinates[:NODE].tolist()
    return FixedBase((x, y), _rotation(model, start.coordinates))


def check_clamp(model: Model, node: Array) -> None:
    """Refuse a base motion that begins with a clamped node (4,) away from that of the beam at rest."""
    if _distance(model, model.straight, node) > START_TOLERANCE:
        raise InputError(
            f"begins with the clamp at {_point(node)} m, turned by {_rotation(model, node):.6g} rad, but the beam "
            "starts with its clamp at the origin, along its axis; measure the motion from there, change the axis of "
            "the beam, or start from a State",
            "base",
        )


def rigid_motion(model: Model) -> cs.Function:
    """(coordinates, velocity of the clamped node) -> velocities of a beam that moves with it as a rigid body."""
    e, velocity = cs.MX.sym("e", model.size), cs.MX.sym("velocity", NODE)
    nodes = cs.reshape(e, NODE, -1)
    x, y = nodes[2, 0], nodes[3, 0]
    turn = (x * velocity[3] - y * velocity[2]) / (x * x + y * y)
    arms = nodes - cs.vertcat(nodes[:2, 0], 0.0, 0.0)
    turning = cs.vertcat(-arms[1, :], arms[0, :], -arms[3, :], arms[2, :])
    moved = turn * turning + cs.vertcat(velocity[:2], 0.0, 0.0)
    return cs.Function("rigid_motion", [e, velocity], [cs.vec(moved)])


def _check_state(model: Model, excitation: Array, state: State) -> None:
    """Refuse a state that does not fit the model, stretches the beam, or disagrees with the excitation (16,)."""
    for name, vector in (("coordinates", state.coordinates), ("velocities", state.velocities)):
        if vector.shape != (model.size,) or not np.isfinite(vector).all():
            raise InputError(f"the {name} must be {model.size} finite numbers", "start")
    strain = np.abs(axial_strain(model.gauss_slopes(state.coordinates), "engineering")).max()
    if strain > 0.01:  # largest axial strain of a given state; an equilibrium needs no check
        raise InputError(
            f"stretches the beam by {100 * strain:.1f} %, which sets off axial waves; bend it without stretching, "
            "as modes.state(mode, amplitude) and static_equilibrium with a tip load do",
            "start",
        )
    _warn_of_uneven_stretch(model, state)
    node, velocity = excitation[:NODE], excitation[NODE : 2 * NODE]
    check_speed(model, np.abs(state.velocities).max(), "in the state", "start")
    if _distance(model, state.coordinates, node) > START_TOLERANCE:
        raise InputError(
            f"the clamp of the state is at {_point(state.coordinates)}, that of the base motion at {_point(node)} at "
            f"{state.time:g} s, or its direction differs; give the base motion that led to the state and the time of "
            "the state, or no base to hold the clamp where it is",
            "start",
        )
    difference = np.abs(state.velocities[:NODE] - velocity).max()
    if difference > START_TOLERANCE * max(np.abs(state.velocities).max(), np.abs(velocity).max()):
        raise InputError(
            f"the clamp of the state has the velocity {_point(state.velocities)} m/s, the base motion "
            f"{_point(velocity)} m/s at {state.time:g} s, which is an impact; give the base motion that led to the "
            "state and the time of the state",
            "start",
        )


def _warn_of_uneven_stretch(model: Model, state: State) -> None:
    """Warn if axial waves will take the steps of a motion: if stretch that nothing holds has more energy than bending.

    Supports hold an even strain of each span; weight and swing, forces of m (|g| + v^2/L), hold some unevenness.
    """
    beam, slopes = model.beam, model.gauss_slopes(state.coordinates)
    width, thickness, _, modulus = model.properties
    lengths, stiffness = np.repeat(beam.element_lengths / 2, 2), np.repeat(modulus * width * thickness, 2)
    strain = axial_strain(slopes, "engineering")
    places = np.array([s for index in range(beam.elements) for s in model.gauss_points(index)])
    spans = np.searchsorted(np.sort([support.point for support in beam.supports]), places)  # number at each place
    means = np.bincount(spans, lengths * strain) / np.maximum(np.bincount(spans, lengths), np.finfo(float).tiny)
    held_force = beam.mass * (math.hypot(*beam.gravity) + np.abs(state.velocities).max() ** 2 / beam.length)
    deviation = np.abs(strain - means[spans])
    uneven = np.maximum(deviation - held_force / stiffness - ROUNDED_STRAIN, 0.0)
    strain_energy = float(model.strain_energy(state.coordinates, model.properties))
    bending_energy = strain_energy - float(stiffness * lengths @ strain**2) / 2
    if float(stiffness * lengths @ uneven**2) / 2 > abs(bending_energy):
        warnings.warn(
            f"the start stretches the beam unevenly, by up to {100 * uneven.max():.2g} %, as a linear mode shape does: "
            "axial waves take most of the steps; start from modes.state(mode, amplitude), which bends the beam only",
            stacklevel=6,
        )


def _distance(model: Model, coordinates: Array, node: Array) -> float:
    """Return the largest difference of a clamp from a node (4,), relative to the length of the beam and unit slope."""
    length = model.beam.length
    return float((np.abs(coordinates[:NODE] - node) / np.array([length, length, 1.0, 1.0])).max())


def _rotation(model: Model, node: Array) -> float:
    """Return the angle from the axis of the beam to the slope of its clamp, rad."""
    (ax, ay), (slope_x, slope_y) = model.beam.axis, node[2:NODE].tolist()
    return math.atan2(ax * slope_y - ay * slope_x, ax * slope_x + ay * slope_y)


def _point(values: Array) -> str:
    return f"({values[0] + 0.0:.6g}, {values[1] + 0.0:.6g})"  # no negative zero
