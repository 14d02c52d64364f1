"""Response curves in files: the arguments of a ``ResponseRecord``.

The columns are told by their names (``over_frequency``).  A column of forces beside another amplitude is the level of
the excitation, even if no word says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, Literal

import numpy as np

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel
from ancf_casadi.records.over_frequency import (
    SpectralContents,
    SpectralFunction,
    functions_of,
    read_spectral,
    sine_amplitudes,
)
from ancf_casadi.records.recording import unit_notes
from ancf_casadi.records.sensor import Sensor, sensor_of
from ancf_casadi.records.time_axis import listed
from ancf_casadi.records.units import Unit, known_unit
from ancf_casadi.response.harmonic_balance.drive import beam_drive
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, located

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


@np.errstate(all="ignore")  # a file may hold any numbers; those that are not finite are left out
def read_curve(
    path: str | Path,
    column: str | int | None,
    *,
    frequency: str | int | None,
    level: str | int | None,
    phase: str | int | None,
    unit: str | None,
    level_unit: str | None,
    phase_unit: str | None,
    sensor: Sensor | None,
    base: HarmonicBase | None,
    load: HarmonicLoad | None,
    excitation_unit: ExcitationUnit | None,
    progress: bool,
) -> dict[str, Any]:
    """Return the arguments of the ``ResponseRecord`` of a file; see ``ResponseRecord.from_file``."""
    check_instance(sensor, "sensor", Sensor, NoneType)
    own_unit, level_own = (
        None if text is None else known_unit(text, name) for text, name in ((unit, "unit"), (level_unit, "level_unit"))
    )
    found = read_spectral(path, frequency, progress=progress)
    found = found.only("--level", ["level"], level).only("--phase", ["phase"], phase)
    found = found.only("--column", ["amplitude", "real", ""], column)
    told = _told_levels(found)
    if told is not None:
        found = found.only("--level", ["level"], told.number)
    function = _only_one(functions_of(found, phase_unit), found.path)
    with located(f"{path}: column {function.channel.label}"):
        factor, read_by = _reading(function.channel, own_unit, sensor, for_beam=excitation_unit is None)
    values = factor * function.values
    notes = [*found.notes, *(() if own_unit else unit_notes([function.channel]))]
    levels, quantity, present = None, "", np.isfinite(found.frequencies) & np.isfinite(values)
    if told is not None:
        own = level_own or told.unit
        levels, quantity = sine_amplitudes(told) * (own.factor if own else 1.0), own.quantity if own else ""
        notes += () if own else unit_notes([told])
        present &= np.isfinite(levels)
        levels = levels[present]
    if not present.any():
        raise InputError("has no row with a frequency and an amplitude", found.path)
    if not present.all():
        notes.append(f"{int((~present).sum())} rows with a gap are left out")
    frequencies = found.frequencies[present]
    with located(str(path)):
        if excitation_unit is None:
            base, load, levels = _excitation(frequencies, levels, quantity, base, load)
        else:
            excitation_unit = _level_unit(quantity, excitation_unit)
    return {
        "frequencies": frequencies,
        "values": values[present],
        "sensor": read_by,
        "base": base,
        "load": load,
        "levels": levels,
        "name": Path(path).name,
        "excitation_unit": excitation_unit or "",
        "notes": tuple(f"{Path(path).name}: {note}" for note in notes),
    }


def _only_one(functions: Sequence[SpectralFunction], path: str) -> SpectralFunction:
    if not functions:
        raise InputError("has no column of amplitudes", path)
    if len(functions) > 1:
        columns = listed([one.channel for one in functions])
        raise InputError(f"has {len(functions)} columns of amplitudes, {columns}; choose with --column", path)
    return functions[0]


def _told_levels(found: SpectralContents) -> RecordedChannel | None:
    """Return the column of the levels: the one that says so, or the only one of forces beside other amplitudes."""
    told = [channel for part, channel in found.columns if part == "level"]
    sizes = [channel for part, channel in found.columns if part in ("", "amplitude", "real")]
    if not told and len(sizes) > 1:
        told = [channel for channel in sizes if channel.unit and channel.unit.quantity == "force"]
    if len(told) > 1:
        raise InputError(f"the level may be column {listed(told)}; choose with --level", found.path)
    return told[0] if told else None


def _reading(
    channel: RecordedChannel, given: Unit | None, sensor: Sensor | None, *, for_beam: bool
) -> tuple[float, Sensor]:
    """Return the factor of the amplitudes to SI units, and the sensor; volts count as a strain without a beam."""
    unit = given or channel.unit
    if unit and unit.quantity == "voltage" and sensor is None:
        if for_beam:
            raise InputError("the reading is in V, which no sensor of a beam has; give its scale", "unit")
        return unit.factor, Sensor("strain")
    return sensor_of(channel, unit, sensor)


def _excitation(
    frequencies: Array, levels: Array | None, quantity: str, base: HarmonicBase | None, load: HarmonicLoad | None
) -> tuple[HarmonicBase | None, HarmonicLoad | None, Array | None]:
    """Return base or load at level 1, and the levels as multiples of it."""
    drive = None if base is None and load is None else beam_drive(base, load)
    if drive is None and (levels is None or quantity not in (*RATES, "force")):
        what = "has no levels of the excitation" if levels is None else "has levels that are no motion and no force"
        raise InputError(f"{what}; give the base motion (base) or the tip load (load) that excites the beam")
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


def _level_unit(quantity: str, given: ExcitationUnit) -> ExcitationUnit:
    """Return the SI unit of the levels of a file: that of the file, or the given one if the file has none."""
    found = LEVEL_UNITS.get(quantity, given)
    if not found:
        raise InputError("does not tell the unit of its levels", "excitation_unit")
    if given not in ("", found):
        raise InputError(f"is {given}, but the levels of the file are in {found}", "excitation_unit")
    return found
