"""Default tolerances from the expected motion.

An integrator with the local error tau relative to the length L of the beam damps a small motion of amplitude A, and
shifts its frequency, by amounts that depend on tau L/A alone.  Three causes move the beam:

    the base, by the larger of its travel and L times its rotation,
    the start, by the larger of the distance from rest under gravity and the first load, and v/w_1, v the velocity
        relative to the clamp,
    the load, by the static deflection under its largest change since the start (under all of it if it travels), or, if
        it changes for a short time, by that under w_1 times its impulse,

with w_1 = 1.8751^2 (E I/mu)^1/2/L^2 of the mean section.  If only one of them moves the beam, A is its travel.  If
several do, A is the smallest travel, but at least a tenth of the largest, so that a fast small motion on top of a slow
large one is resolved too.  At a resonance the travel is larger than expected, and the result more accurate than
required.  The tolerances below keep the error of the tip under 1e-4 of its travel for 6 s, numerical damping under 1e-5
and the frequency within 3e-5 in the first five modes (``docs/accuracy.md``).  A release sets all modes in motion, of
which the fast ones soon lose their phase: the error is then 5e-4 of the travel, less than records show, and the first
mode keeps its damping ratio within 1e-6 and its frequency within 1e-6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.dynamics.placed_load import TIP, coordinates_at_rest
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.loads import LineLoad, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array

TOLERANCE_PER_TRAVEL = {"idas": 6e-8, "radau": 2e-5}  # per expected travel A/L
LARGEST_TOLERANCE = {"idas": 1e-9, "radau": 1e-6}  # limits for large motion
SMALLEST_TOLERANCE = {"idas": 1e-10, "radau": 1e-12}  # limits set by rounding
NEGLIGIBLE = 1e-6  # A/L below which a cause is taken not to move the beam
LEAST_OF_LARGEST = 0.1  # smallest expected travel, relative to the largest travel


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
    *,
    from_rest: bool = False,
) -> float:
    """Return the expected travel of a motion, relative to the length of the beam, from the excitations (k, 16).

    ``from_rest`` says that the start is the equilibrium under gravity and the first load.
    """
    length = model.beam.length
    position, slope, velocity = excitations[:, :2], excitations[:, 2:NODE], excitations[0, NODE : 2 * NODE]
    travel = np.linalg.norm(position - position[0], axis=1).max()
    turn = np.abs(np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])) - math.atan2(slope[0, 1], slope[0, 0])).max()
    nodes = start.coordinates.reshape(-1, NODE)[:, :2]
    rest_positions = nodes if from_rest else _rest(model, excitations[0], place, further)
    distance = np.linalg.norm(nodes - rest_positions, axis=1).max()
    arms = nodes - position[0]
    spin = slope[0, 0] * velocity[3] - slope[0, 1] * velocity[2]
    rigid = velocity[:2] + spin * np.column_stack([-arms[:, 1], arms[:, 0]])
    swing = np.linalg.norm(start.velocities.reshape(-1, NODE)[:, :2] - rigid, axis=1).max() / _first_frequency(model)
    loads = excitations[:, 3 * NODE :]
    loaded = deflection(model, times, loads if place is None else loads - loads[0])
    causes = max(travel, length * turn) / length, max(distance, swing) / length, loaded
    smallest = min((cause for cause in causes if cause >= NEGLIGIBLE), default=0.0)
    return float(max(smallest, LEAST_OF_LARGEST * max(causes)) if smallest else max(causes))


def _rest(model: Model, excitation: Array, place: PointLoad | None, further: Sequence[LineLoad]) -> Array:
    """Return the node positions (k, 2) at rest under gravity and the loads; straight if there is no equilibrium."""
    turned = Model(model.beam.with_(axis=(float(excitation[2]), float(excitation[3]))), model.measures)
    try:
        coordinates = coordinates_at_rest(turned, excitation[3 * NODE :], place, further)
    except EquilibriumError:
        coordinates = turned.straight_at_support
    return np.asarray(coordinates.reshape(-1, NODE)[:, :2] + excitation[:2])


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
