"""Response curves in files: the amplitudes, the sensor that read them, and the levels of the excitation.

The columns are told by their names (``over_frequency``).  A column of forces beside another amplitude is the level of
the excitation, even if no word says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, list_labels
from ancf_casadi.records.over_frequency import (
    SpectralContents,
    SpectralFunction,
)
from ancf_casadi.records.sensor import Sensor, assign_sensor
from ancf_casadi.records.units import Unit
from ancf_casadi.response.harmonic_balance.system import beam_drive
from ancf_casadi.support.arrays import Array

ExcitationUnit = Literal["", "N", "V", "m", "m/s", "m/s^2"]

RATES = {
    "length": 0,
    "velocity": 1,
    "acceleration": 2,
}  # time derivatives of the base motion, by quantity of the levels
LEVEL_UNITS: Mapping[str, ExcitationUnit] = {
    "length": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "force": "N",
    "voltage": "V",
}  # by quantity of the levels
EXCITED_BY = {"m": tuple(RATES), "N": ("force",), "N m": ("moment",)}  # quantities of levels, by unit of the excitation


def only_function(functions: Sequence[SpectralFunction], path: str) -> SpectralFunction:
    """Return the function of a file that has one; refuse a file with none or several."""
    if not functions:
        raise InputError("has no column of amplitudes", path)
    if len(functions) > 1:
        columns = list_labels([function.channel for function in functions])
        raise InputError(f"has {len(functions)} columns of amplitudes, {columns}; choose with --column", path)
    return functions[0]


def level_column(contents: SpectralContents) -> RecordedChannel | None:
    """Return the column of the levels: the one that says so, or the only one of forces beside other amplitudes."""
    levels = [channel for column_kind, channel in contents.columns if column_kind == "level"]
    sizes = [channel for column_kind, channel in contents.columns if column_kind in ("", "amplitude", "real")]
    if not levels and len(sizes) > 1:
        levels = [channel for channel in sizes if channel.unit and channel.unit.quantity == "force"]
    if len(levels) > 1:
        raise InputError(f"the level may be column {list_labels(levels)}; choose with --level", contents.path)
    return levels[0] if levels else None


def amplitude_reading(
    channel: RecordedChannel, unit: Unit | None, sensor: Sensor | None, *, for_beam: bool
) -> tuple[float, Sensor]:
    """Return the factor of the amplitudes to the unit of the sensor, and the sensor; a beam reads no signals."""
    factor, read_by = assign_sensor(channel, unit, sensor)
    if for_beam and read_by.quantity == "signal":
        raise InputError(f"the reading is in {read_by.unit}, which no sensor of a beam has; give its scale", "unit")
    return factor, read_by


def excitation_at_one(
    frequencies: Array, levels: Array | None, quantity: str, base: HarmonicBase | None, load: HarmonicLoad | None
) -> tuple[HarmonicBase | None, HarmonicLoad | None, Array | None]:
    """Return base or load at level 1, and the levels as multiples of it."""
    drive = None if base is None and load is None else beam_drive(base, load)
    if drive is None and (levels is None or quantity not in (*RATES, "force")):
        reason = "has no levels of the excitation" if levels is None else "has levels that are no motion and no force"
        raise InputError(f"{reason}; give the base motion (base) or the tip load (load) that excites the beam")
    if levels is None or not quantity:
        return base, load, levels
    if drive is not None and quantity not in EXCITED_BY[drive.unit]:
        raise InputError(f"holds a {quantity}, but the excitation is in {drive.unit}", "level")
    sizes = levels / (2 * np.pi * frequencies) ** RATES.get(quantity, 0)
    if drive is None:
        usual = float(np.median(sizes))
        if not usual > 0.0:
            raise InputError("must be positive", "level")
        base = HarmonicBase(usual, 1.0) if quantity in RATES else None
        load = HarmonicLoad((usual, 0.0), 1.0) if base is None else None
        drive = beam_drive(base, load)
    return base, load, sizes / drive.amplitude


def si_level_unit(quantity: str, excitation_unit: ExcitationUnit) -> ExcitationUnit:
    """Return the SI unit of the levels of a file: that of the file, or the given one if the file has none."""
    unit = LEVEL_UNITS.get(quantity, excitation_unit)
    if not unit:
        raise InputError(
            "is missing, and the file does not tell the unit of its levels; state it, for a command in a table "
            "[[curves]]",
            "excitation_unit",
        )
    if excitation_unit not in ("", unit):
        raise InputError(f"is {excitation_unit}, but the levels of the file are in {unit}", "excitation_unit")
    return unit
