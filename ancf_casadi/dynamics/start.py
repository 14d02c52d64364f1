"""Setup of a motion: excitation and its limits, samples, initial state, and the default tolerance.

``set_up`` makes the checks and the setup that ``simulate`` and ``motion`` share.

At the start, a beam at rest under gravity, a flow and the load at its tip at this instant, or straight as
manufactured, moves with its clamp as one rigid body.  With the velocity v_0 of the clamp and its angular velocity w,

    r_t = v_0 + w (z x (r - r_0)),        tau_t = w (z x tau),

so that a base motion that begins with a velocity causes no impact on the clamp.  With the start ``impact`` the beam is
at rest instead, and the clamp strikes it.

Tolerance.  An integrator with the local error tau relative to the length L of the beam damps a small motion of
amplitude A, and shifts its frequency, by amounts that depend on tau L/A alone.  Three causes move the beam:

    the base, by the larger of its travel and L times its rotation,
    the start, by a tenth of the larger of the distance from rest under gravity and the first load, and v/w_1, v the
        velocity relative to the clamp: a release sets all modes in motion, and fast modes soon lose their phase,
    the load, by the static deflection under its largest change since the start (under all of it if it travels), or, if
        it changes for a short time, by that under w_1 times its impulse,

with w_1 = 1.8751^2 (E I/mu)^1/2/L^2 of the mean section.  If only one of them moves the beam, A is its travel.  If
several do, A is the smallest travel, but at least a tenth of the largest, so that a fast small motion on top of a slow
large one is resolved too.  At a resonance the travel is larger than expected, and the result more accurate than
required.  The tolerances below keep the error of the tip under 1e-4 of its travel for 6 s, numerical damping under 1e-5
and the frequency within 3e-5 in the first five modes (``docs/accuracy.md``).

An excitation beyond the limits would keep an integrator busy for minutes before it fails, so that it is refused before
the first step.  The limits are far beyond experiments: a gantry travels some tens of lengths of its beam.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import NoneType
from typing import Literal, get_args

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.equations import Equations, as_it_is
from ancf_casadi.dynamics.excitation import SAME_TIME, Excitation, excitation_pieces
from ancf_casadi.dynamics.placed_load import TIP, equilibrium_under
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import axial_strain
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, is_one_of, physical, shown
from ancf_casadi.vibration.equilibrium import Equilibrium

Start = Literal["equilibrium", "straight", "impact"]

MOST_TRAJECTORY_SAMPLES = 2e6  # coordinates and velocities take 2.7 GB at 20 elements
START_TOLERANCE = 1e-6  # deviation of a state from its base, relative to length, unit slope and largest velocity
LOAD_NAMES = ("force_x", "force_y", "moment")  # N, N, N m
START_LOAD_NAMES = (*LOAD_NAMES, *(f"{name}_rate" for name in LOAD_NAMES))
TOLERANCE_PER_TRAVEL = {"idas": 6e-8, "radau": 2e-5}  # per expected travel A/L
LARGEST_TOLERANCE = {"idas": 1e-9, "radau": 3e-7}  # limits for large motion
SMALLEST_TOLERANCE = {"idas": 1e-10, "radau": 1e-12}  # limits set by rounding
NEGLIGIBLE = 1e-6  # A/L below which a cause is taken not to move the beam
PART_OF_START = 0.1  # of the travel of a start that counts
LEAST_OF_LARGEST = 0.1  # smallest expected travel, relative to the largest travel
MOST_LENGTHS = 1000.0  # of travel of the clamp, and of deflection under the load by the theory of small deflections
MOST_WAVE_SPEEDS = 10.0  # of velocity; a body that meets another at one wave speed is stretched by its own length


@dataclass(frozen=True, eq=False)
class MotionSetup:
    """Setup of a motion."""

    equations: Equations
    base: BaseMotion
    load: TipLoad | None
    pieces: Sequence[Excitation]  # smooth pieces of base and load, from the first to the last sample
    checked: tuple[Array, Array]  # instants throughout the motion (k,), s, and the excitation there (k, 16)
    start: State  # the initial state
    sample_rate: float  # 1/s
    times: Array  # the samples (k,), s

    @cached_property
    def travel(self) -> float:
        """The expected travel, relative to the length of the beam."""
        equations = self.equations
        flow = equations.law.loads(equations.model.beam)
        return expected_travel(equations.model, *self.checked, self.start, equations.place, flow)


def set_up(
    model: Model,
    *,
    duration: float,
    damping: DampingLaw | None,
    base: BaseMotion | None,
    load: TipLoad | None,
    sample_rate: float,
    start: Start | Equilibrium | State,
    make: Callable[[cs.Function], cs.Function] = as_it_is,
) -> MotionSetup:
    """Check the arguments, those of ``simulate``, and return the setup of the motion; ``make`` as of ``Equations``."""
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(base, "base", BaseMotion, NoneType)
    check_instance(load, "load", TipLoad, NoneType)
    check_instance(start, "start", str, Equilibrium, State)
    duration, sample_rate = physical(duration, "duration"), physical(sample_rate, "sample_rate")
    base = _base_of(model, start) if base is None else base
    load = None if load is None else load.along(model.beam)
    law, place = RayleighDamping() if damping is None else damping, TIP if load is None else load.place
    equations = Equations(model, law, make, place)
    times = _sample_times(duration, sample_rate, start.time if isinstance(start, State) else 0.0)
    begin, end = float(times[0]), float(times[-1])
    if load is not None and load.begin >= end:
        raise InputError(
            f"begins at {load.begin:g} s, after the end of the motion at {end:g} s; its times are those of the motion",
            "load",
        )
    pieces = excitation_pieces(model, base, load, begin, end)
    return MotionSetup(
        equations=equations,
        base=base,
        load=load,
        pieces=pieces,
        checked=checked_excitation(model, pieces),
        start=initial_state(model, pieces[0], start, place, law.loads(model.beam)),
        sample_rate=sample_rate,
        times=times,
    )


def _sample_times(duration: float, sample_rate: float, origin: float) -> Array:
    """Return the instants of the samples, s, from ``origin`` on."""
    if duration * sample_rate > MOST_TRAJECTORY_SAMPLES:
        raise InputError(
            f"{duration * sample_rate:.3g} samples are more than {MOST_TRAJECTORY_SAMPLES:.0e}", "sample_rate"
        )
    times = origin + np.arange(math.floor(duration * sample_rate + SAME_TIME) + 1) / sample_rate
    if len(times) < 2:
        raise InputError(f"must be at least one sampling interval, {1 / sample_rate:g} s, got {duration:g}", "duration")
    return times


def _base_of(model: Model, start: Start | Equilibrium | State) -> BaseMotion:
    """Return a clamp that is fixed at its place in a given state, or at the origin."""
    if not isinstance(start, State) or start.coordinates.shape != (model.size,):
        return FixedBase()
    x, y, *_ = start.coordinates[:NODE].tolist()
    return FixedBase((x, y), _rotation(model, start.coordinates))


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
    elif not is_one_of(start, get_args(Start)):
        known = ", ".join(get_args(Start))
        raise InputError(f"must be one of {known}, an Equilibrium or a State, got {shown(start)}", "start")
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
    for name, given in (("coordinates", state.coordinates), ("velocities", state.velocities)):
        if given.shape != (model.size,) or not np.isfinite(given).all():
            raise InputError(f"the {name} must be {model.size} finite numbers", "start")
    strain = np.abs(axial_strain(model.gauss_slopes(state.coordinates), "engineering")).max()
    if strain > 0.01:  # largest axial strain of a given state; an equilibrium needs no check
        raise InputError(
            f"stretches the beam by {100 * strain:.1f} %, which sets off axial waves; bend it without stretching, "
            "as static_equilibrium with a tip load does",
            "start",
        )
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


def default_tolerance(method: str, travel: float) -> float:
    """Return the tolerance of ``idas`` or ``radau`` for an expected travel (relative to the length)."""
    wanted, smallest = TOLERANCE_PER_TRAVEL[method] * travel, SMALLEST_TOLERANCE[method]
    largest = LARGEST_TOLERANCE[method]
    return largest if travel < NEGLIGIBLE else min(max(wanted, smallest), largest)


def expected_travel(
    model: Model,
    times: Array,
    excitations: Array,
    start: State,
    place: PointLoad | None = TIP,
    further: Sequence[LineLoad] = (),
) -> float:
    """Return the expected travel of a motion, relative to the length of the beam, from the excitations (k, 16)."""
    length = model.beam.length
    position, slope, velocity = excitations[:, :2], excitations[:, 2:NODE], excitations[0, NODE : 2 * NODE]
    travel = np.linalg.norm(position - position[0], axis=1).max()
    turn = np.abs(np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])) - math.atan2(slope[0, 1], slope[0, 0])).max()
    rest, nodes = _rest(model, excitations[0], place, further), start.coordinates.reshape(-1, NODE)[:, :2]
    distance = np.linalg.norm(nodes - rest, axis=1).max()
    arms = nodes - position[0]
    spin = slope[0, 0] * velocity[3] - slope[0, 1] * velocity[2]
    rigid = velocity[:2] + spin * np.column_stack([-arms[:, 1], arms[:, 0]])
    swing = np.linalg.norm(start.velocities.reshape(-1, NODE)[:, :2] - rigid, axis=1).max() / _first_frequency(model)
    loads = excitations[:, 3 * NODE :]
    loaded = deflection(model, times, loads if place is None else loads - loads[0])
    causes = max(travel, length * turn) / length, PART_OF_START * max(distance, swing) / length, loaded
    smallest = min((cause for cause in causes if cause >= NEGLIGIBLE), default=0.0)
    return float(max(smallest, LEAST_OF_LARGEST * max(causes)) if smallest else max(causes))


def _rest(model: Model, excitation: Array, place: PointLoad | None, further: Sequence[LineLoad]) -> Array:
    """Return the node positions (k, 2) at rest under gravity and the loads; straight if there is no equilibrium."""
    turned = Model(model.beam.with_(axis=(float(excitation[2]), float(excitation[3]))), model.measures)
    try:
        coordinates = equilibrium_under(turned, excitation[3 * NODE :], place, further).coordinates
    except EquilibriumError:
        coordinates = turned.straight
    return np.asarray(coordinates.reshape(-1, NODE)[:, :2] + excitation[:2])


def checked_excitation(model: Model, pieces: Sequence[Excitation]) -> tuple[Array, Array]:
    """Return instants throughout a motion, (k,), s, and the excitation there, (k, 16), after a check of its size."""
    instants = [np.linspace(piece.begin, piece.end, 1001) for piece in pieces]
    values = [piece.function(own[None, :]).full().T for piece, own in zip(pieces, instants, strict=True)]
    times, excitations = np.concatenate(instants), np.vstack(values)
    length, clamp = model.beam.length, excitations[:, : 3 * NODE]
    finite = np.isfinite(clamp).all(axis=1)
    if not finite.all():
        raise InputError(f"its position, velocity or acceleration is not finite at {times[~finite][0]:g} s", "base")
    travel = np.hypot(*(clamp[:, :2] - clamp[0, :2]).T)
    if travel.max() > MOST_LENGTHS * length:
        raise InputError(
            f"moves the clamp by {travel.max():.3g} m until {times[travel.argmax()]:g} s, but the beam is {length:g} m "
            f"long; at most {MOST_LENGTHS:g} lengths are possible. Check the unit",
            "base",
        )
    velocity = clamp[:, NODE : 2 * NODE]
    speed = np.hypot(velocity[:, 0], velocity[:, 1]) + length * np.hypot(velocity[:, 2], velocity[:, 3])
    check_speed(model, float(speed.max()), f"at {times[speed.argmax()]:g} s", "base")
    load = excitations[:, 3 * NODE :]
    bent = max(deflection(model, times, load - load[0]), deflection(model, times, np.broadcast_to(load[0], load.shape)))
    if not bent <= MOST_LENGTHS:
        raise InputError(
            f"would bend the beam by {bent:.3g} of its lengths, if the deflection were small; at most {MOST_LENGTHS:g} "
            "are possible. Check the unit",
            "load",
        )
    return times, excitations


def check_speed(model: Model, speed: float, at: str, where: str) -> None:
    """Refuse a velocity, m/s, of more than ten times that of longitudinal waves in the beam, (E/rho)^1/2."""
    _, _, density, modulus = model.properties
    waves = math.sqrt(float((modulus / density).max()))
    if not speed <= MOST_WAVE_SPEEDS * waves:
        raise InputError(
            f"moves at {speed:.3g} m/s {at}, more than {MOST_WAVE_SPEEDS:g} times as fast as longitudinal waves in the "
            f"beam, {waves:.3g} m/s. Check the unit",
            where,
        )


def deflection(model: Model, times: Array, loads: Array) -> float:
    """Return the small deflection of the tip under a load (k, 3) that begins at once, relative to the length."""
    length, frequency = model.beam.length, _first_frequency(model)
    stiffness, _ = _mean_section(model)
    bending = np.hypot(loads[:, 0], loads[:, 1]) * length / 3 + np.abs(loads[:, 2]) / 2
    return float(min(bending.max(), frequency * np.trapezoid(bending, times)) * length / stiffness)


def _first_frequency(model: Model) -> float:
    """Return w_1 of the mean section, rad/s."""
    stiffness, line_density = _mean_section(model)
    return 1.8751040687**2 * math.sqrt(stiffness / line_density) / model.beam.length**2  # beta_1 L of a cantilever


def _mean_section(model: Model) -> tuple[float, float]:
    """Return E I, N m^2, and mu, kg/m, of the mean section."""
    width, thickness, density, modulus = model.properties.mean(axis=1).tolist()
    return modulus * width * thickness**3 / 12, density * width * thickness
