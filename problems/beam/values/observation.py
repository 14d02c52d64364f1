"""Readings of sensors on a beam at rest, as functions of its coordinates.

With r = S e at the arc length s of a sensor, unit direction d, and t = r'(s) the tangent,

    position, displacement    d . r;  a displacement is the change from rest without the loads,
    slope                     angle from the axis of the beam to t, positive counterclockwise,
    strain                    eps - z kappa at the distance z along the normal, half the thickness if not given,
    force, moment             d . F and M that the clamp exerts on the beam.

F and M follow from the generalized forces f = Q_e - Q_g on the clamped coordinates (r_0, tau_0): F = (f_1, f_2) and
M = tau_0 x (f_3, f_4), because a rotation of the clamp by dtheta turns tau_0 by dtheta (-tau_y, tau_x).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.accurate_strain import axial_strains_near, curvature_at
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
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
    y = cs.vertcat(*(_reading(model, sensor, e, f, properties) for sensor in sensors))
    jacobians = [cs.densify(cs.jacobian(y, x)) for x in (e, f, properties)]
    return cs.Function("readings", [e, f, properties], [cs.densify(y), *jacobians])


def place(model: Model, sensor: Sensor) -> float:
    """Return the arc length of a sensor, m."""
    return model.beam.length if sensor.point is None else sensor.point


def _reading(model: Model, sensor: Sensor, e: cs.MX, f: cs.MX, properties: cs.MX) -> cs.MX:
    if sensor.quantity not in STATIC_QUANTITIES:
        raise InputError(
            f"{sensor.quantity} has no reading at rest; use one of {', '.join(STATIC_QUANTITIES)}", "sensors"
        )
    if sensor.frame != "inertial":
        raise InputError("the direction must be in the laboratory (frame='inertial') at rest", "sensors")
    s, axis = place(model, sensor), model.beam.axis
    d = cs.DM(sensor.unit_direction)
    match sensor.quantity:
        case "position" | "displacement":
            return cs.dot(d, cs.DM(model.interpolation(s)) @ e)
        case "force":
            return cs.dot(d, f[:2])
        case "moment":
            return axis[0] * f[3] - axis[1] * f[2]

    def at(matrix: Array) -> tuple[cs.MX, cs.MX]:
        x, y = cs.vertsplit(cs.DM(matrix) @ e)
        return x, y

    if sensor.quantity == "slope":
        x, y = at(model.slope_interpolation(s))
        return cs.atan2(axis[0] * y - axis[1] * x, axis[0] * x + axis[1] * y)
    thickness = properties[PROPERTIES.index("thickness") * model.beam.elements + model.element_at(s)]
    z = thickness / 2 if sensor.distance is None else sensor.distance
    axial = sum(weight * eps for weight, _, eps in axial_strains_near(model, s, at))
    strain: cs.MX = axial - z * curvature_at(model, s, at)
    return strain
