"""A strip of silicone that is released from a side load, and what sensors on it read."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from ancf_casadi import Beam, Measurement, Model, RayleighDamping, Trajectory, simulate, static_equilibrium
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.vibration.equilibrium import Equilibrium

RATE = 4000.0  # Hz
EVERY = 40  # samples of the motion per sample of a sensor
EDGE = 5  # samples at each end without differences


@dataclass(frozen=True, eq=False)
class Swing:
    """A motion from ``simulate``, and readings that follow from the trajectory alone."""

    model: Model
    start: Equilibrium
    run: Trajectory

    def truth(self, sensor):
        """Return the readings of a sensor at all samples but those at the ends."""
        run, beam = self.run, self.model.beam
        s = beam.length if sensor.point is None else sensor.point
        match sensor.quantity:
            case "position" | "displacement":
                found = run.position(s) @ sensor.unit_direction
            case "velocity":
                found = self._along(run.velocity(s), sensor, s)
            case "acceleration":
                found = self._along(fourth_order(run.velocity(s)) - sensor.gravity * np.array(beam.gravity), sensor, s)
            case "slope":
                found = run.slope(s) - math.atan2(beam.axis[1], beam.axis[0])
            case "strain":
                z = 1e-3 if sensor.distance is None else sensor.distance
                found = run.axial_force(s) / (264e3 * 0.01 * 2e-3) - z * run.curvature(s)
            case "force":
                found = run.clamp_force[:, :2] @ sensor.unit_direction
            case "moment":
                slope, force = run.coordinates[:, 2:4], run.clamp_force[:, 2:]
                found = slope[:, 0] * force[:, 1] - slope[:, 1] * force[:, 0]
        return found[EDGE:-EDGE]

    def measurement(self, sensor, noise=0.0, seed=1):
        """Return the record of a sensor with white noise relative to its standard deviation."""
        values = self.truth(sensor)[::EVERY]
        values = values + noise * values.std() * np.random.default_rng(seed).normal(size=values.shape)
        return Measurement(self.run.time[EDGE:-EDGE][::EVERY], values, sensor=sensor)

    def _along(self, vectors, sensor, s):
        dx, dy = sensor.unit_direction
        if sensor.frame == "inertial":
            return vectors @ np.array([dx, dy])
        angle = self.run.slope(s)
        tangent, normal = (
            np.array(pair).T for pair in ((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle)))
        )
        return (vectors * (dx * tangent + dy * normal)).sum(axis=1)


def fourth_order(values):
    """Return the time derivative by central differences of order 4; not used at the ends."""
    shifted = [np.roll(values, -k, axis=0) for k in (-2, -1, 1, 2)]
    return (shifted[0] - 8 * shifted[1] + 8 * shifted[2] - shifted[3]) * RATE / 12


@pytest.fixture(scope="session")
def swing():
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    model = Model(Beam.uniform(**strip, elements=3))
    start = static_equilibrium(model, tip_force=(0.004, 0.0))
    law = RayleighDamping(alpha=0.5, beta=1e-3)
    settings = {"duration": 0.8, "sample_rate": RATE, "method": "radau", "tolerance": 1e-9}
    return Swing(model, start, simulate(model, damping=law, start=start, **settings))


SENSORS = [
    Sensor("position", 0.15, (1.0, 1.0)),
    Sensor("displacement"),
    Sensor("velocity", 0.1),
    Sensor("velocity", None, (0.0, 1.0), "body"),
    Sensor("acceleration"),
    Sensor("acceleration", None, (0.0, 1.0), "body", gravity=True),
    Sensor("slope"),
    Sensor("strain", 0.03),
    Sensor("strain", 0.03, distance=-0.8e-3),
    Sensor("force", direction=(0.0, 1.0)),
    Sensor("moment"),
]
