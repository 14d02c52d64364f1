"""Default tolerances from the motion that is to be expected.

An integrator with the local error tau relative to the length L of the beam damps a small motion of amplitude A, and
shifts its frequency, by amounts that depend on tau L/A alone.  Two things move the beam:

    its base, by the larger of its travel and L times its rotation,
    its start, by the larger of its distance from rest under gravity and v/w_1, v the velocity relative to the clamp,

with w_1 = 1.8751^2 (E I/mu)^1/2/L^2 of the mean section.  The travel A that is expected is the larger of the two; where
both move the beam, it is the smaller, but a tenth of the larger at least, so that a fast small motion is followed
on a slow large one.  A resonance travels farther and is then more accurate than asked for.  The shares below keep
numerical damping under 1e-5 and the frequency within 3e-5 in the first five modes (``docs/accuracy.md``).
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import static_equilibrium

IDAS_SHARE, RADAU_SHARE = 6e-8, 2e-5  # tolerance over expected travel
IDAS_LARGEST, RADAU_LARGEST = 1e-9, 3e-7
IDAS_SMALLEST, RADAU_SMALLEST = 1e-10, 1e-12  # that rounding allows
NOTHING = 1e-6  # of the length: a travel that counts as none
LEAST_SHARE = 0.1  # of the larger of two motions
FIRST_ROOT = 1.8751040687  # beta_1 L of a cantilever


def idas_tolerance(travel: float) -> float:
    """Return the tolerance that IDAS needs for an expected travel (relative to the length); it may be out of reach."""
    return IDAS_LARGEST if travel < NOTHING else min(IDAS_SHARE * travel, IDAS_LARGEST)


def radau_tolerance(travel: float) -> float:
    """Return the tolerance of Radau for an expected travel (relative to the length)."""
    return RADAU_LARGEST if travel < NOTHING else min(max(RADAU_SHARE * travel, RADAU_SMALLEST), RADAU_LARGEST)


def expected_travel(model: Model, clamps: Array, start: State) -> float:
    """Return the travel that is to be expected of a motion, relative to the length of the beam.

    Parameters
    ----------
    model : Model
        The beam.
    clamps : array (k, 12)
        Position, velocity and acceleration of the clamped node at instants of the motion.
    start : State
        The state at its start.
    """
    length = model.beam.length
    position, slope, rates = clamps[:, :2], clamps[:, 2:NODE], clamps[0, NODE : 2 * NODE]
    travel = np.linalg.norm(position - position[0], axis=1).max()
    turn = np.abs(np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])) - math.atan2(slope[0, 1], slope[0, 0])).max()
    rest, nodes = _rest(model, clamps[0]), start.coordinates.reshape(-1, NODE)[:, :2]
    distance = np.linalg.norm(nodes - rest, axis=1).max()
    arms = nodes - position[0]
    spin = slope[0, 0] * rates[3] - slope[0, 1] * rates[2]
    rigid = rates[:2] + spin * np.column_stack([-arms[:, 1], arms[:, 0]])
    swing = np.linalg.norm(start.velocities.reshape(-1, NODE)[:, :2] - rigid, axis=1).max() / _first_frequency(model)
    smaller, larger = sorted((max(travel, length * turn) / length, max(distance, swing) / length))
    return float(larger if smaller < NOTHING else max(smaller, LEAST_SHARE * larger))


def _rest(model: Model, clamp: Array) -> Array:
    """Return the positions of the nodes (k, 2) at rest under gravity in a clamp (12,); straight if there is no rest."""
    turned = Model(model.beam.with_(axis=(float(clamp[2]), float(clamp[3]))), model.measures)
    try:
        coordinates = static_equilibrium(turned).coordinates
    except EquilibriumError:
        coordinates = turned.straight
    return np.asarray(coordinates.reshape(-1, NODE)[:, :2] + clamp[:2])


def _first_frequency(model: Model) -> float:
    """Return w_1 of the mean section, rad/s."""
    width, thickness, density, modulus = model.properties.mean(axis=1).tolist()
    stiffness, line_density = modulus * width * thickness**3 / 12, density * width * thickness
    return float(FIRST_ROOT**2 * math.sqrt(stiffness / line_density) / model.beam.length**2)
