"""Sensors: units, labels, and settings that do not belong together."""

import numpy as np
import pytest

from ancf_casadi import InputError
from ancf_casadi.records.channel import RecordedChannel
from ancf_casadi.records.sensor import Sensor, assign_sensor
from ancf_casadi.records.units import column_unit, known_unit


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


def assigned(name, unit=None, sensor=None):
    channel = RecordedChannel(1, name, np.zeros(3), *column_unit("", name))
    return assign_sensor(channel, unit and known_unit(unit, "unit"), sensor)


@pytest.mark.parametrize(
    "name", ["Force (g)", "Load (g)", "Masse [g]", "Force [mg]", "acc_20_mm", "Kraft [Nm]", "tip mass 5 g"]
)
def test_a_name_that_contradicts_its_unit_is_refused_until_the_user_decides(name):
    with pytest.raises(InputError, match=r"--unit.*--sensor"):
        assigned(name)
    assert assigned(name, "gf")[1] == Sensor("force")
    _, sensor = assigned("Load (g)", sensor=Sensor("acceleration"))
    assert sensor.quantity == "acceleration"


@pytest.mark.parametrize(("name", "factor", "symbol"), [("x (mV)", 1e-3, "V"), ("x [foo]", 1.0, "foo"), ("x", 1.0, "")])
def test_a_signal_keeps_its_place_and_direction_and_takes_the_unit_of_the_file(name, factor, symbol):
    placed = {"point": 0.2, "direction": (0.0, 1.0)}
    assert assigned(name, sensor=Sensor("signal", **placed)) == (factor, Sensor("signal", **placed, signal_unit=symbol))


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("acc of the tip mass (g)", "acceleration"), ("tip (g)", "acceleration"), ("dial gauge (mm)", "displacement"),
        ("Vibrometer [mm]", "displacement"), ("load step 3 x [mm]", "displacement"), ("force at angle 2 (N)", "force"),
        ("mass 1 [m/s^2]", "acceleration"), ("phase", "slope"), ("load 1 (deg)", "slope"), ("Force (V)", "signal"),
    ],
)  # fmt: skip
def test_a_name_with_other_words_does_not_contradict_its_unit(name, quantity):
    assert assigned(name)[1].quantity == quantity
