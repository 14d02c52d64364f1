"""The table [base]: the motion of the clamp, of one of four kinds that its keys tell apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.support.inputs import located, shown, vector
from problems.command.tables.study import Study, checked

KEYS = """\
  [base]        harmonic: amplitude (m), frequency (Hz), stop (s), direction,
                stop_at ("rest" or "once")
                sweep: the same with frequencies = [FIRST, LAST] (Hz)
                sampled: file, with the columns (name or number) x, y and
                rotation, of which one is enough; time, unit, time_unit, rate
                fixed: displacement (m), rotation (rad)
"""
OSCILLATION = {"amplitude", "frequency", "frequencies", "stop", "direction", "stop_at"}
AXES = ("x", "y", "rotation")
FILE = {"time", "unit", "time_unit", "rate"}


def read_base(study: Study, table: Any, where: str) -> BaseMotion:
    """Return the motion of the clamp that a table describes.

    Raises
    ------
    InputError
        If the keys belong to no kind of motion, a value cannot be used, or a file cannot be read.
    """
    keys = set(table) if isinstance(table, dict) else set()
    if "file" in keys:
        return _sampled(study, checked(table, {"file"}, {*AXES, *FILE}, where), where)
    if "frequencies" in keys:
        given = checked(table, {"amplitude", "frequencies", "stop"}, OSCILLATION - {"frequency"}, where)
        with located(where):
            return SweepBase(**(given | {"frequencies": vector(given["frequencies"], "frequencies")}))
    if keys and keys <= {"displacement", "rotation"}:
        with located(where):
            return FixedBase(**table)
    given = checked(table, {"amplitude", "frequency"}, OSCILLATION - {"frequencies"}, where)
    with located(where):
        return HarmonicBase(**given)


def _sampled(study: Study, table: dict[str, Any], where: str) -> SampledBase:
    """Return the motion in the columns of a file; a direction without a column is at rest."""
    path = study.file(table["file"], f"{where}: file")
    given = [axis for axis in AXES if axis in table]
    if not given:
        raise InputError("name at least one of the columns x, y and rotation", where)
    settings = {key: table[key] for key in FILE & table.keys()}
    columns = {}
    for axis in given:
        quantity: Quantity = "slope" if axis == "rotation" else "position"
        own = {key: value for key, value in settings.items() if key != "unit" or quantity == "position"}
        with located(f"{where}: {axis}"):
            columns[axis] = Measurement.from_file(path, table[axis], sensor=Sensor(quantity), **own)
    time = columns[given[0]].time
    for axis in given[1:]:
        if not np.array_equal(columns[axis].time, time):
            raise InputError(f"has other times or gaps than {given[0]}; give all columns at the same times",
                             f"{where}: {axis}")  # fmt: skip
    values = [columns[axis].values if axis in columns else np.zeros(len(time)) for axis in AXES]
    with located(f"{where}: {shown(table['file'])}"):
        return SampledBase(time, np.column_stack(values[:2]), values[2])
