"""Response curves in files: frequency, level of the excitation, amplitude and phase of the reading.

The columns are told by their names (``over_frequency``).  A column of forces beside another amplitude is the level of
the excitation, even if no word says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType

import numpy as np

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
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, located
from ancf_casadi.support.tables import Displayed, counted, spread


@dataclass(frozen=True, eq=False)
class ResponsePoints(Displayed):
    r"""The points of a response curve in a file, in SI units.

    Parameters
    ----------
    name : str
        Name of the file.
    frequencies, amplitudes : array (m,)
        Frequencies of the excitation, Hz, and amplitudes of the reading, in ``unit``.
    phases : array (m,) or None
        Phases of the reading, rad, as the file counts them; None if the file has none.
    levels : array (m,) or None
        Amplitudes of the excitation, in the SI unit of ``level_quantity``; None if the file has none.
    sensor : Sensor or None
        The sensor; None if the reading is in a unit that no sensor has, such as volts.
    unit, level_quantity : str
        Unit of the amplitudes; quantity of the levels, such as ``"force"``, empty without a unit.
    notes : tuple of str
        Decisions of the reader that the user should know.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import read_response
    >>> _ = Path("sweep.csv").write_text("f (Hz),sensor (mV)\n1.8,110\n1.9,520\n")
    >>> read_response("sweep.csv")
    ResponsePoints('sweep.csv', 2 points, 1.8 to 1.9 Hz)
    """

    name: str
    frequencies: Array
    amplitudes: Array
    phases: Array | None
    levels: Array | None
    sensor: Sensor | None
    unit: str
    level_quantity: str
    notes: tuple[str, ...] = ()

    def _summary(self) -> str:
        return f"{self.name!r}, {counted(len(self.frequencies), 'point')}, {spread(self.frequencies, 'Hz')}"


@np.errstate(all="ignore")  # a file may hold any numbers; those that are not finite are left out
def read_response(
    path: str | Path,
    column: str | int | None = None,
    *,
    frequency: str | int | None = None,
    level: str | int | None = None,
    phase: str | int | None = None,
    unit: str | None = None,
    level_unit: str | None = None,
    phase_unit: str | None = None,
    sensor: Sensor | None = None,
    progress: bool = False,
) -> ResponsePoints:
    """Read a response curve: frequency, amplitude, and as far as there are such columns, phase and level.

    Parameters
    ----------
    path : str or Path
        Text table, MATLAB, HDF5 or NPZ file.
    column, frequency, level, phase : str or int, optional
        Names or numbers (from 1) of the columns of amplitudes (or real parts), frequencies, levels and phases; needed
        only if the names in the file do not tell them.
    unit, level_unit, phase_unit : str, optional
        Units of amplitudes, levels and phases, such as ``mm``, ``g`` and ``deg``, in place of those in the file.
    sensor : Sensor, optional
        Quantity and place of the sensor; if not given, the unit tells the quantity.
    progress : bool
        Whether to show a progress bar on a terminal if reading takes more than a second.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or units are not clear, or there is no point.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import read_response
    >>> _ = Path("sweep.csv").write_text('''f (Hz),force (N),tip (mm),phase (deg)
    ... 1.8,0.10,1.1,-12
    ... 1.9,0.10,5.2,-91
    ... ''')
    >>> curve = read_response("sweep.csv")
    >>> curve.amplitudes, curve.phases.round(3), curve.level_quantity
    (array([0.0011, 0.0052]), array([-0.209, -1.588]), 'force')
    """
    check_instance(sensor, "sensor", Sensor, NoneType)
    own_unit, level_own = (
        None if text is None else known_unit(text, name) for text, name in ((unit, "unit"), (level_unit, "level_unit"))
    )
    found = read_spectral(path, frequency, progress=progress)
    found = found.only("--level", ["level"], level).only("--phase", ["phase"], phase)
    found = found.only("--column", ["amplitude", "real", ""], column)
    excitation = _excitation(found)
    if excitation is not None:
        found = found.only("--level", ["level"], excitation.number)
    function = _only_one(functions_of(found, phase_unit), found.path)
    with located(f"{path}: column {function.channel.label}"):
        factor, symbol, read_by = _reading(function.channel, own_unit, sensor)
    values = factor * function.values
    phased = np.iscomplexobj(values)
    notes = [*found.notes, *(() if own_unit else unit_notes([function.channel]))]
    levels, quantity = None, ""
    if excitation is not None:
        own = level_own or excitation.unit
        levels, quantity = sine_amplitudes(excitation) * (own.factor if own else 1.0), own.quantity if own else ""
        notes += () if own else unit_notes([excitation])
    present = np.isfinite(found.frequencies) & np.isfinite(values) & (True if levels is None else np.isfinite(levels))
    if not present.any():
        raise InputError("has no row with a frequency and an amplitude", found.path)
    if not present.all():
        notes.append(f"{int((~present).sum())} rows with a gap are left out")
    return ResponsePoints(
        Path(path).name,
        found.frequencies[present],
        np.abs(values[present]),
        np.angle(values[present]) if phased else None,
        None if levels is None else levels[present],
        read_by,
        symbol,
        quantity,
        tuple(f"{Path(path).name}: {note}" for note in notes),
    )


def _only_one(functions: Sequence[SpectralFunction], path: str) -> SpectralFunction:
    if not functions:
        raise InputError("has no column of amplitudes", path)
    if len(functions) > 1:
        columns = listed([one.channel for one in functions])
        raise InputError(f"has {len(functions)} columns of amplitudes, {columns}; choose with --column", path)
    return functions[0]


def _excitation(found: SpectralContents) -> RecordedChannel | None:
    """Return the column of the levels: the one that says so, or the only one of forces beside other amplitudes."""
    told = [channel for part, channel in found.columns if part == "level"]
    sizes = [channel for part, channel in found.columns if part in ("", "amplitude", "real")]
    if not told and len(sizes) > 1:
        told = [channel for channel in sizes if channel.unit and channel.unit.quantity == "force"]
    if len(told) > 1:
        raise InputError(f"the level may be column {listed(told)}; choose with --level", found.path)
    return told[0] if told else None


def _reading(channel: RecordedChannel, given: Unit | None, sensor: Sensor | None) -> tuple[float, str, Sensor | None]:
    """Return the factor of the amplitudes to SI units, their unit, and the sensor, None for volts and the like."""
    unit = given or channel.unit
    if unit and unit.quantity == "voltage" and sensor is None:
        return unit.factor, "V", None
    factor, found = sensor_of(channel, unit, sensor)
    return factor, found.unit, found
