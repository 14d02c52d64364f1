"""Readings of sensors on a beam at rest, as functions of its coordinates.

They are those of a motion (``dynamics.derivatives.reading``) without velocities; a displacement is the change from rest
without the loads.  Force F and moment M that the clamp exerts on the beam follow from the generalized forces
f = Q_e - Q_g on the clamped coordinates (r_0, tau_0): F = (f_1, f_2) and M = tau_0 x (f_3, f_4), because a rotation of
the clamp by dtheta turns tau_0 by dtheta (-tau_y, tau_x).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.vibration.assembly import structure_properties

STATIC_QUANTITIES = ("position", "displacement", "slope", "strain", "force", "moment")


def readings(model: Model, sensors: Sequence[Sensor]) -> cs.Function:
    """Return (e, f, properties) -> the readings of k sensors, and their Jacobians by e, f and the properties.

    f are the generalized forces on the clamped coordinates, (4,); the properties those of the beam, (4 n + 2,), in the
    order of ``structure_properties``.

    Raises
    ------
    InputError
        If a sensor reads nothing at rest, has its direction in the frame of the body, or is not on the beam.
    """
    e, f, properties = (
        cs.MX.sym("e", model.size),
        cs.MX.sym("f", NODE),
        cs.MX.sym("p", structure_properties(model).size),
    )
    rows = cs.reshape(properties[: model.properties.size], model.beam.elements, -1).T
    forces, still = cs.vertcat(f, cs.MX(model.size - NODE, 1)), cs.MX.zeros(model.size)
    motion = SampledMotion(model, rows, e, still, still, lambda: forces)
    y = cs.vertcat(*(_reading(motion, sensor) for sensor in sensors))
    jacobians = [cs.densify(cs.jacobian(y, x)) for x in (e, f, properties)]
    return cs.Function("readings", [e, f, properties], [cs.densify(y), *jacobians])


def place(model: Model, sensor: Sensor) -> float:
    """Return the arc length of a sensor, m."""
    return model.beam.length if sensor.point is None else sensor.point


def _reading(motion: SampledMotion, sensor: Sensor) -> cs.MX:
    if sensor.quantity not in STATIC_QUANTITIES:
        raise InputError(
            f"{sensor.quantity} has no reading at rest; use one of {', '.join(STATIC_QUANTITIES)}", "sensors"
        )
    if sensor.frame != "inertial":
        raise InputError("the direction must be in the laboratory (frame='inertial') at rest", "sensors")
    return motion.read(sensor)
