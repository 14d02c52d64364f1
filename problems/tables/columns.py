"""Columns of a file that a table names: one per component of a base motion or a load, all at the same times."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import Recording, read_recording
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import located
from problems.tables.study import Study, checked

READING = ("time", "time_unit", "rate")  # keys that say how to read a file


def read_file(study: Study, given: Mapping[str, Any], where: str) -> Recording:
    """Read the file that a table names, with its keys ``READING``.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    path = study.file(given["file"], f"{where}: file")
    with located(where):
        return read_recording(path, progress=True, **{key: given.get(key) for key in READING})


def read_columns(
    study: Study, table: Any, quantities: Mapping[str, Quantity], where: str
) -> tuple[Array, dict[str, Array]]:
    """Return the times (s) and the components, in SI units; a component without a column is zero.

    Parameters
    ----------
    study : Study
        The file with the table.
    table : dict
        ``file``, the columns by component (name or number from 1), and how to read them; a ``unit`` holds for the
        components of the first quantity.
    quantities : mapping
        Quantity of each component.
    where : str
        Place of the table, for messages.

    Raises
    ------
    InputError
        If no column is named, a column cannot be read, or their times differ.
    """
    given = checked(table, {"file"}, {*quantities, "unit", *READING}, where)
    named = [name for name in quantities if name in given]
    if not named:
        raise InputError(f"name at least one of the columns {', '.join(quantities)}", where)
    recording = read_file(study, given, where)
    first = next(iter(quantities.values()))
    columns = {}
    for name in named:
        unit = given.get("unit") if quantities[name] == first else None
        with located(f"{where}: {name}"):
            columns[name] = Measurement.from_recording(
                recording, given[name], unit=unit, sensor=Sensor(quantities[name])
            )
    time = columns[named[0]].time
    for name in named[1:]:
        if not np.array_equal(columns[name].time, time):
            raise InputError(
                f"has other times or gaps than {named[0]}; give all columns at the same times", f"{where}: {name}"
            )
    return time, {name: columns[name].values if name in columns else np.zeros(len(time)) for name in quantities}
