"""Sensors: the quantity that a record holds, its unit, and the place and direction of the measurement on the beam."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel
from ancf_casadi.records.units import UNITS, Unit
from ancf_casadi.support.inputs import check_instance, choice, flag, number, shown, vector
from ancf_casadi.support.tables import Displayed

Quantity = Literal[
    "position", "displacement", "velocity", "acceleration", "slope", "strain", "force", "moment", "signal"
]  # fmt: skip
Frame = Literal["inertial", "body"]

SENSOR_UNITS: Mapping[Quantity, str] = {
    "position": "m",
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "slope": "rad",
    "strain": "",
    "force": "N",
    "moment": "N m",
    "signal": "",
}
IN_BODY_FRAME = ("velocity", "acceleration", "force")
AT_CLAMP = ("force", "moment")
# quantities of sensors, the default first, for each quantity of units with another name
OTHER_NAMES: Mapping[str, tuple[Quantity, ...]] = {"length": ("displacement", "position"), "angle": ("slope",)}
QUANTITY_WORDS: Mapping[Quantity, str] = {
    "acceleration": "acc accel acceleration accelerometer beschleunigung beschl accx accy accz ax ay az",
    "velocity": "vel velocity geschwindigkeit vitesse vibrometer ldv vx vy vz",
    "strain": "strain gauge dms dehnung eps epsilon",
    "force": "force kraft fx fy fz",
    "slope": "angle slope winkel rotation phase roll pitch yaw",
}
QUANTITY_OF = {word: quantity for quantity, words in QUANTITY_WORDS.items() for word in words.split()}
DEVICES = {"accelerometer", "vibrometer", "ldv", "gauge", "dms"}  # may have converted what they measure
WEIGHED = {"load", "last", "mass", "masse", "weight", "gewicht"}  # with these names, g may be grams


@dataclass(frozen=True)
class Sensor(Displayed):
    """A sensor on a beam.

    Parameters
    ----------
    quantity : str
        ``position`` (a coordinate in the laboratory), ``displacement`` (its change from an unknown origin),
        ``velocity``, ``acceleration``, ``slope`` (the rotation of the cross-section from the axis of the straight beam,
        counterclockwise), ``strain`` (on the surface), ``force`` and ``moment`` (of the base on the beam at the clamp,
        the moment counterclockwise), ``signal`` (a reading without a scale, such as volts or pixels, of a decay).
    point : float, optional
        Arc length of the sensor from the clamp, m; the tip if not given.  Forces and moments are those at the clamp.
    direction : (float, float)
        Direction of a position, displacement, velocity, acceleration or force; any length.
    frame : {"inertial", "body"}
        Frame of ``direction``: the laboratory, or the cross-section, where (1, 0) is the tangent of the beam and (0, 1)
        its normal, a quarter turn counterclockwise from the tangent.
    gravity : bool
        Whether an acceleration is a - g, the reading of an accelerometer that responds to constant acceleration
        (capacitive or piezoresistive, DC-coupled).  At rest, with g downwards, its vertical axis reads +9.81 m/s^2.
        Piezoelectric accelerometers read changes only: give False.
    distance : float, optional
        Distance of a strain gauge from the neutral axis along the normal, m; half the thickness of the beam if not
        given.  It is negative on the other surface.
    signal_unit : str
        Unit of a signal, as results print it.

    Raises
    ------
    InputError
        If a name is unknown, the point is negative or away from the clamp of a force, the direction has no length, or a
        setting does not belong to the quantity.

    Examples
    --------
    >>> from ancf_casadi import Sensor
    >>> laser = Sensor("displacement", point=0.4, direction=(1.0, 0.0))
    >>> accelerometer = Sensor("acceleration", frame="body", direction=(0.0, 1.0), gravity=True)
    >>> gauge = Sensor("strain", point=0.02)
    >>> laser.unit, accelerometer.unit, laser.label
    ('m', 'm/s^2', 'x, 400 mm')
    """

    quantity: Quantity = "displacement"
    point: float | None = None
    direction: tuple[float, float] = (1.0, 0.0)
    frame: Frame = "inertial"
    gravity: bool = False
    distance: float | None = None
    signal_unit: str = ""

    def __post_init__(self) -> None:
        """Validate."""
        choice(self.quantity, get_args(Quantity), "quantity")
        choice(self.frame, get_args(Frame), "frame")
        flag(self.gravity, "gravity")
        if self.point is not None and number(self.point, "point") < 0.0:
            raise InputError(f"must be 0 or more, got {self.point:g}", "point")
        if self.point and self.quantity in AT_CLAMP:
            raise InputError(f"a {self.quantity} is that at the clamp, got a sensor at {self.point:g} m", "point")
        object.__setattr__(self, "direction", vector(self.direction, "direction"))
        if not any(self.direction):
            raise InputError("must have a length, got (0, 0)", "direction")
        if self.frame == "body" and self.quantity not in IN_BODY_FRAME:
            raise InputError(f"must be 'inertial' for a {self.quantity}", "frame")
        if self.gravity and self.quantity != "acceleration":
            raise InputError(f"belongs to accelerations, not to a {self.quantity}", "gravity")
        check_instance(self.signal_unit, "signal_unit", str)
        if self.signal_unit and self.quantity != "signal":
            raise InputError(f"belongs to signals, not to a {self.quantity}", "signal_unit")
        if self.distance is not None:
            number(self.distance, "distance")
            if self.quantity != "strain":
                raise InputError(f"belongs to strains, not to a {self.quantity}", "distance")

    @property
    def unit(self) -> str:
        """SI unit of the record; that of a signal."""
        return self.signal_unit or SENSOR_UNITS[self.quantity]

    @property
    def unit_direction(self) -> tuple[float, float]:
        """The direction with the length 1."""
        x, y = self.direction
        length = math.hypot(x, y)
        return x / length, y / length

    @property
    def label(self) -> str:
        """Direction and place of the sensor in a legend: ``x, tip``."""
        place = "clamp" if self.quantity in AT_CLAMP else "tip" if self.point is None else f"{1e3 * self.point:.4g} mm"
        if self.quantity in ("slope", "strain", "moment", "signal"):
            return place
        first, second = ("tangent", "normal") if self.frame == "body" else ("x", "y")
        x, y = self.unit_direction
        simple = {(1.0, 0.0): first, (0.0, 1.0): second, (-1.0, 0.0): f"-{first}", (0.0, -1.0): f"-{second}"}
        return f"{simple.get((x, y), f'{x:.3g} {first} {y:+.3g} {second}')}, {place}"

    @property
    def derivatives(self) -> int:
        """Number of time derivatives from the motion to the record: 1 for velocity, 2 for acceleration."""
        return {"velocity": 1, "acceleration": 2}.get(self.quantity, 0)

    @property
    def motion_unit(self) -> str:
        """Unit of the motion whose derivative is measured: m for velocity and acceleration."""
        return "m" if self.derivatives else self.unit


def assign_sensor(channel: RecordedChannel, stated_unit: Unit | None, sensor: Sensor | None) -> tuple[float, Sensor]:
    """Return the factor of a channel to the unit of its sensor, and the sensor.

    Without a ``stated_unit``, the unit is that of the file.  Without a sensor, the unit determines the quantity, or
    without a unit the name; a unit that no sensor of a beam has, such as V or px, makes a signal.  An unknown unit, one
    that does not fit the sensor, or one of the file that the name contradicts, as in ``Force (g)``, raises an
    ``InputError``.
    """
    unit = stated_unit or channel.unit
    if sensor is not None and sensor.quantity == "signal":
        factor, symbol = _signal(unit) if unit else (1.0, sensor.signal_unit or channel.symbol)
        return factor, replace(sensor, signal_unit=symbol)
    if unit is None:
        if channel.symbol:
            raise InputError(
                f"the unit {shown(channel.symbol)} is not understood; give the unit with --unit, or --sensor signal"
            )
        return 1.0, sensor or Sensor(_quantity_in_name(channel.name))
    quantities = _quantities(unit)
    if sensor is None:
        if stated_unit is None and contradicts(channel.name, unit):
            raise InputError(
                f"is in {unit.symbol}, a unit of {unit.quantity}, which its name contradicts; give the unit with "
                "--unit, such as gf for a force in grams, or the quantity with --sensor"
            )
        if quantities:
            return unit.factor, Sensor(quantity=quantities[0])
        factor, symbol = _signal(unit)
        return factor, Sensor("signal", signal_unit=symbol)
    if sensor.quantity not in quantities:
        raise InputError(
            f"is in {unit.symbol}, a unit of {unit.quantity}, but the sensor measures {sensor.quantity}; give the unit "
            "or the scale with --unit, such as '0.25 mm', or the quantity with --sensor"
        )
    return unit.factor, sensor


def _signal(unit: Unit) -> tuple[float, str]:
    """Return the factor to the unit of a quantity without prefix, if there is one, and the symbol of that unit."""
    if unit.quantity == "time":
        raise InputError(f"is in {unit.symbol}, a unit of time, which no sensor measures; name another with --column")
    si_symbol = next((symbol for symbol, factor in UNITS.get(unit.quantity, {}).items() if factor == 1.0), "")
    return (unit.factor, si_symbol) if si_symbol else (1.0, unit.symbol)


def _quantities(unit: Unit) -> tuple[Quantity, ...]:
    """Return the quantities of sensors that a unit measures, the default first."""
    return OTHER_NAMES.get(unit.quantity) or tuple(name for name in SENSOR_UNITS if name == unit.quantity)


def contradicts(name: str, unit: Unit) -> bool:
    """Return whether the name of a column denotes another quantity of a sensor than its unit."""
    words, quantities = _words(name), _quantities(unit)
    named = {QUANTITY_OF[word] for word in words if word in QUANTITY_OF and word not in DEVICES}
    grams = unit.quantity == "acceleration" and unit.symbol.endswith("g") and not WEIGHED.isdisjoint(words)
    return bool(quantities) and (bool(named) or grams) and named.isdisjoint(quantities)


def _quantity_in_name(name: str) -> Quantity:
    """Return the quantity in the name of a column without a unit, such as ``Acc`` or ``strain 1``."""
    return next((QUANTITY_OF[word] for word in _words(name) if word in QUANTITY_OF), "displacement")


def _words(name: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", name.casefold())
