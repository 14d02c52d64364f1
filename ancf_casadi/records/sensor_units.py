"""The unit of a channel and the quantity of a sensor: which belong together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.records.units import Unit
from ancf_casadi.support.inputs import shown

SENSOR_QUANTITIES: Mapping[str, tuple[Quantity, ...]] = MappingProxyType(
    {
        "length": ("displacement", "position"),
        "velocity": ("velocity",),
        "acceleration": ("acceleration",),
        "angle": ("slope",),
        "strain": ("strain",),
        "force": ("force",),
        "moment": ("moment",),
    }
)  # quantity of a unit -> quantities of sensors, the usual one first


def sensor_of(channel: RecordedChannel, given: Unit | None, sensor: Sensor | None) -> tuple[float, Sensor]:
    """Return the factor of a channel to SI units, and its sensor.

    Parameters
    ----------
    channel : RecordedChannel
        The channel.
    given : Unit or None
        Unit that the caller gives in place of that in the file.
    sensor : Sensor or None
        The sensor; if None, the unit tells the quantity.

    Raises
    ------
    InputError
        If the unit is not understood, or does not fit the sensor.
    """
    unit = given or channel.unit
    if unit is None:
        if channel.symbol:
            raise InputError(f"the unit {shown(channel.symbol)} is not understood; give the unit with --unit")
        return 1.0, sensor or Sensor()
    fitting = SENSOR_QUANTITIES.get(unit.quantity, ())
    if not fitting:
        raise InputError(
            f"is in {unit.symbol}, a unit of {unit.quantity}, which no sensor measures; "
            "give the scale with --unit, such as '0.25 mm'"
        )
    if sensor is None:
        return unit.factor, Sensor(quantity=fitting[0])
    if sensor.quantity not in fitting:
        raise InputError(
            f"is in {unit.symbol}, a unit of {unit.quantity}, but the sensor measures {sensor.quantity}; "
            "give the unit with --unit, or the quantity with --sensor"
        )
    return unit.factor, sensor
