"""Sensors: units, labels, and settings that do not belong together."""

import pytest

from ancf_casadi import InputError
from ancf_casadi.records.sensor import Sensor


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"quantity": "speed"}, "quantity: must be one of position, displacement"),
        ({"point": -0.1}, "point: must be 0 or more"),
        ({"quantity": "moment", "point": 0.1}, "point: a moment is that at the clamp, got a sensor at 0.1 m"),
        ({"direction": (0.0, 0.0)}, "direction: must have a length"),
        ({"frame": "body"}, "frame: must be 'inertial' for a displacement"),
        ({"gravity": True}, "gravity: belongs to accelerations, not to a displacement"),
        ({"gravity": 1.0}, "gravity: must be True or False"),
        ({"distance": 1e-3}, "distance: belongs to strains"),
        ({"quantity": "strain", "distance": "x"}, "distance: must be a finite number"),
    ],
)
def test_a_sensor_that_makes_no_sense_is_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Sensor(**settings)


@pytest.mark.parametrize(
    ("sensor", "label", "unit"),
    [
        (Sensor(), "x, tip", "m"),
        (Sensor("velocity", 0.1, (0.0, -2.0)), "-y, 100 mm", "m/s"),
        (Sensor("acceleration", direction=(3.0, 4.0), frame="body"), "0.6 tangent +0.8 normal, tip", "m/s^2"),
        (Sensor("strain", 0.05), "50 mm", ""),
        (Sensor("force"), "x, clamp", "N"),
        (Sensor("moment"), "clamp", "N m"),
    ],
)
def test_a_sensor_has_a_label_and_a_unit(sensor, label, unit):
    assert (sensor.label, sensor.unit) == (label, unit)
