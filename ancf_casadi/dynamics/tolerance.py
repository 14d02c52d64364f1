"""Default tolerances from the expected motion.

An integrator with the local error tau relative to the length L of the beam damps a small motion of amplitude A, and
shifts its frequency, by amounts that depend on tau L/A alone.  Three causes move the beam:

    the base, by the larger of its travel and L times its rotation,
    the start, by a tenth of the larger of the distance from rest under gravity and the first load, and v/w_1, v the
        velocity relative to the clamp: a release sets all modes in motion, and fast modes soon lose their phase,
    the load, by the static deflection under its largest change since the start, or, if it changes for a short time, by
        that under w_1 times its impulse,

with w_1 = 1.8751^2 (E I/mu)^1/2/L^2 of the mean section.  If only one of them moves the beam, A is its travel.  If
several do, A is the smallest travel, but at least a tenth of the largest, so that a fast small motion on top of a slow
large one is resolved too.  At a resonance the travel is larger than expected, and the result more accurate than
required.  The tolerances below keep the error of the tip under 1e-4 of its travel for 6 s, numerical damping under 1e-5
and the frequency within 3e-5 in the first five modes (``docs/accuracy.md``).
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.dynamics.tip_load import equilibrium_under
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

IDAS_PER_TRAVEL, RADAU_PER_TRAVEL = 6e-8, 2e-5  # tolerance per expected travel A/L
IDAS_LARGEST, RADAU_LARGEST = 1e-9, 3e-7  # limits for large motion
IDAS_SMALLEST, RADAU_SMALLEST = 1e-10, 1e-12  # limits set by rounding
NEGLIGIBLE = 1e-6  # A/L below which a cause is taken not to move the beam
PART_OF_START = 0.1  # of the travel of a start that counts
LEAST_OF_LARGEST = 0.1  # smallest expected travel, relative to the largest travel
FIRST_ROOT = 1.8751040687  # beta_1 L of a cantilever


def idas_tolerance(travel: float) -> float:
    """Return the tolerance of IDAS for an expected travel (relative to the length)."""
    return IDAS_LARGEST if travel < NEGLIGIBLE else min(max(IDAS_PER_TRAVEL * travel, IDAS_SMALLEST), IDAS_LARGEST)


def radau_tolerance(travel: float) -> float:
    """Return the tolerance of Radau for an expected travel (relative to the length)."""
    return RADAU_LARGEST if travel < NEGLIGIBLE else min(max(RADAU_PER_TRAVEL * travel, RADAU_SMALLEST), RADAU_LARGEST)


def expected_travel(model: Model, times: Array, excitations: Array, start: State) -> float:
    """Return the expected travel of a motion, relative to the length of the beam.

    Parameters
    ----------
    model : Model
        The beam.
    times : array (k,)
        Instants of the motion, s.
    excitations : array (k, 15)
        The excitation at these instants.
    start : State
        The initial state.
    """
    length = model.beam.length
    position, slope, velocity = excitations[:, :2], excitations[:, 2:NODE], excitations[0, NODE : 2 * NODE]
    travel = np.linalg.norm(position - position[0], axis=1).max()
    turn = np.abs(np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])) - math.atan2(slope[0, 1], slope[0, 0])).max()
    rest, nodes = _rest(model, excitations[0]), start.coordinates.reshape(-1, NODE)[:, :2]
    distance = np.linalg.norm(nodes - rest, axis=1).max()
    arms = nodes - position[0]
    spin = slope[0, 0] * velocity[3] - slope[0, 1] * velocity[2]
    rigid = velocity[:2] + spin * np.column_stack([-arms[:, 1], arms[:, 0]])
    swing = np.linalg.norm(start.velocities.reshape(-1, NODE)[:, :2] - rigid, axis=1).max() / _first_frequency(model)
    loaded = _deflection(model, times, excitations[:, 3 * NODE :])
    causes = max(travel, length * turn) / length, PART_OF_START * max(distance, swing) / length, loaded
    smallest = min((cause for cause in causes if cause >= NEGLIGIBLE), default=0.0)
    return float(max(smallest, LEAST_OF_LARGEST * max(causes)) if smallest else max(causes))


def _rest(model: Model, excitation: Array) -> Array:
    """Return the node positions (k, 2) at rest under gravity and the load; straight if there is no equilibrium."""
    turned = Model(model.beam.with_(axis=(float(excitation[2]), float(excitation[3]))), model.measures)
    try:
        coordinates = equilibrium_under(turned, excitation[3 * NODE :]).coordinates
    except EquilibriumError:
        coordinates = turned.straight
    return np.asarray(coordinates.reshape(-1, NODE)[:, :2] + excitation[:2])


def _deflection(model: Model, times: Array, loads: Array) -> float:
    """Return the travel of the tip under a load (k, 3), relative to the length of the beam."""
    length, frequency, changes = model.beam.length, _first_frequency(model), loads - loads[0]
    stiffness, _ = _mean_section(model)
    bending = np.linalg.norm(changes[:, :2], axis=1) * length / 3 + np.abs(changes[:, 2]) / 2
    return float(min(bending.max(), frequency * np.trapezoid(bending, times)) * length / stiffness)


def _first_frequency(model: Model) -> float:
    """Return w_1 of the mean section, rad/s."""
    stiffness, line_density = _mean_section(model)
    return FIRST_ROOT**2 * math.sqrt(stiffness / line_density) / model.beam.length**2


def _mean_section(model: Model) -> tuple[float, float]:
    """Return E I, N m^2, and mu, kg/m, of the mean section."""
    width, thickness, density, modulus = model.properties.mean(axis=1).tolist()
    return modulus * width * thickness**3 / 12, density * width * thickness
