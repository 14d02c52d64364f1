"""Sensors: the quantity that a record holds, where on the beam it was measured, and in which direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import choice, number, vector

Quantity = Literal[
    "position", "displacement", "velocity", "acceleration", "slope", "strain", "force", "moment"
]  # fmt: skip
Frame = Literal["inertial", "body"]

UNITS: Mapping[Quantity, str] = {
    "position": "m",
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "slope": "rad",
    "strain": "",
    "force": "N",
    "moment": "N m",
}


@dataclass(frozen=True)
class Sensor:
    """A sensor on a beam.

    Parameters
    ----------
    quantity : str
        ``position`` (a coordinate in the laboratory), ``displacement`` (its change), ``velocity``, ``acceleration``,
        ``slope`` (the rotation of the cross-section), ``strain`` (on the surface), ``force`` and ``moment`` (at the
        clamp).
    point : float, optional
        Arc length of the sensor from the clamp, m; the tip if not given.
    direction : (float, float)
        Direction of a position, displacement, velocity, acceleration or force; any length.
    frame : {"inertial", "body"}
        Frame of ``direction``: the laboratory, or the cross-section, where (1, 0) is the tangent of the beam.

    Raises
    ------
    InputError
        If a name is unknown, the point is negative, or the direction has no length.
    """

    quantity: Quantity = "displacement"
    point: float | None = None
    direction: tuple[float, float] = (1.0, 0.0)
    frame: Frame = "inertial"

    def __post_init__(self) -> None:
        """Validate."""
        choice(self.quantity, get_args(Quantity), "quantity")
        choice(self.frame, get_args(Frame), "frame")
        if self.point is not None and number(self.point, "point") < 0.0:
            raise InputError(f"must be 0 or more, got {self.point:g}", "point")
        if not any(vector(self.direction, "direction")):
            raise InputError("must have a length, got (0, 0)", "direction")

    @property
    def unit(self) -> str:
        """SI unit of the record."""
        return UNITS[self.quantity]
