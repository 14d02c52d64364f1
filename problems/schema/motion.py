"""The tables of a motion: [base] of the clamp, [load] at the tip, and [release], the load before time 0.

Those of a simulation also have [simulation] with its settings, and [markers] with points to output.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad, MovingForce, SampledLoad, TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import Recording, read_recording
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys, located, physical, shown
from ancf_casadi.vibration.equilibrium import static_equilibrium
from problems.schema.beam import DAMPED_HELP, read_damped
from problems.schema.table import StudyFile, made

MOTION_KEYS = """\
  [base]        harmonic: amplitude (m), frequency (Hz), stop (s), direction,
                stop_at ("rest" or "once"), ramp (cycles in which the
                amplitude grows from 0)
                sweep: the same with frequencies = [FIRST, LAST] (Hz)
                sampled: file, with the columns (name or number) x, y and
                rotation, of which one is enough; time, unit, time_unit,
                sample_rate (1/s)
                fixed: displacement (m), rotation (rad)
  [load]        force and moment at the tip, in the laboratory frame
                harmonic: force (N), moment (N m), frequency (Hz), stop (s),
                ramp (cycles)
                sampled: time = [0, 5], force = [[1, 0], [1, 0]], moment; or
                file, with the columns force_x, force_y and moment, of which
                one is enough; time, unit, time_unit,
                sample_rate (1/s)
                moving: force (N), speed (m/s), point (m), begin (s), end (m)
  [release]     the load that holds the beam until time 0: tip_force (N),
                tip_moment (N m)
"""
READING = ("time", "time_unit", "sample_rate")  # keys that say how to read a file
AXES: dict[str, Quantity] = {"x": "position", "y": "position", "rotation": "slope"}
COMPONENTS: dict[str, Quantity] = {"force_x": "force", "force_y": "force", "moment": "moment"}
SIMULATION_KEYS = """\
  [simulation]  duration (s), sample_rate (1/s), tolerance,
                method ("auto", "idas" or "radau"),
                start ("equilibrium", "straight" or "impact")
"""
MARKERS_KEYS = """\
  [markers]     NAME = arc length from the clamp (m): points in the output
"""
SIMULATION_HELP = DAMPED_HELP + MOTION_KEYS + SIMULATION_KEYS + MARKERS_KEYS
SETTINGS = {"sample_rate", "start", "method", "tolerance"}
COLUMN_NAMES = ("time", "tip", "base")  # names of columns that are always there


def read_motion(file: StudyFile, given: Mapping[str, Any], model: Model, where: str) -> dict[str, Any]:
    """Return the arguments ``base``, ``load`` and ``start`` of a motion, as far as there are tables.

    They come from the tables within ``given``, whose place is ``where``, or else from those of the file.  A given start
    holds instead of a release.
    """
    found: dict[str, Any] = {"start": given["start"]} if "start" in given else {}
    for name in ("base", "load", "release"):
        table, place = (given[name], f"{where}: {name}") if name in given else (file.tables.get(name), file.where(name))
        if table is None:
            continue
        if name != "release":
            found[name] = _excitation(file, name, table, place)
        elif "start" not in given:  # the equilibrium under the load at the tip that holds the beam
            found["start"] = made(table, static_equilibrium, place, {"tip_force", "tip_moment"}, model=model)
    return found


def _excitation(file: StudyFile, name: str, table: Any, where: str) -> BaseMotion | TipLoad:
    """Return a base or a load, each of one of four kinds that the keys of its table tell apart."""
    keys = set(table) if isinstance(table, dict) else set()
    if "file" in keys:
        time, (x, y, turning) = _columns(file, table, AXES if name == "base" else COMPONENTS, where)
        with located(where):
            return (SampledBase if name == "base" else SampledLoad)(time, np.column_stack([x, y]), turning)
    if name == "load":
        return made(table, SampledLoad if "time" in keys else MovingForce if "speed" in keys else HarmonicLoad, where)
    fixed = keys and keys <= {field.name for field in fields(FixedBase)}
    return made(table, SweepBase if "frequencies" in keys else FixedBase if fixed else HarmonicBase, where)


def read_measured(file: StudyFile, given: Mapping[str, Any], where: str) -> Recording:
    """Read the file that a table names, with its keys ``READING``."""
    path = file.beside(given["file"], f"{where}: file")
    with located(where):
        return read_recording(path, progress=True, **{key: given.get(key) for key in READING})


def _columns(
    file: StudyFile, table: dict[str, Any], quantities: Mapping[str, Quantity], where: str
) -> tuple[Array, list[Array]]:
    """Return the times (s) and the components, in SI units; a component without a column is zero.

    The table gives ``file``, the columns by component (name or number from 1), and how to read them; a ``unit`` holds
    for the components of the first quantity.
    """
    check_keys(table, {"file"}, {*quantities, "unit", *READING}, where)
    named = [name for name in quantities if name in table]
    if not named:
        raise InputError(f"name at least one of the columns {', '.join(quantities)}", where)
    recording = read_measured(file, table, where)
    first = next(iter(quantities.values()))
    columns = {}
    for name in named:
        unit = table.get("unit") if quantities[name] == first else None
        with located(f"{where}: {name}"):
            columns[name] = Measurement.from_recording(
                recording, table[name], unit=unit, sensor=Sensor(quantities[name])
            )
    time = columns[named[0]].time
    for name in named[1:]:
        if not np.array_equal(columns[name].time, time):
            raise InputError(
                f"has other times or gaps than {named[0]}; give all columns at the same times", f"{where}: {name}"
            )
    return time, [columns[name].values if name in columns else np.zeros(len(time)) for name in quantities]


def read_simulation(given: str | StudyFile) -> tuple[dict[str, Any], dict[str, float]]:
    """Read the arguments of ``simulate``, and the points to output: arc length by name, m."""
    file = StudyFile.of(given)
    source, where = read_damped(file), file.where("simulation")
    table = file.needed("simulation")
    check_keys(table, {"duration"}, SETTINGS, where)
    _check_size(table, source.model, where)
    if "start" in table and "release" in file.tables:
        raise InputError("is given by the table [release]; leave it out", f"{where}: start")
    motion = table | read_motion(file, table, source.model, where)
    return {"model": source.model, "damping": source.damping, **motion}, read_markers(file, source.model)


def _check_size(settings: Mapping[str, Any], model: Model, where: str) -> None:
    """Refuse a motion that would fill the memory."""
    rate = settings.get("sample_rate", 1000.0)  # 1/s, the default of ``simulate``
    with located(where):
        samples = physical(settings["duration"], "duration") * physical(rate, "sample_rate")
    if 2 * 8 * model.size * samples > 5e8:  # bytes of the coordinates and velocities
        raise InputError(
            f"{samples:.3g} samples of {model.beam.elements} elements would take {16 * model.size * samples / 1e9:.2g} "
            "GB; lower sample_rate or duration, or use fewer elements",
            f"{where}: sample_rate",
        )


def read_markers(file: StudyFile, model: Model) -> dict[str, float]:
    """Return the points of the table [markers]: arc length by name, m."""
    table, where = file.tables.get("markers", {}), file.where("markers")
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", where)
    for name, point in table.items():
        if name in COLUMN_NAMES or not re.fullmatch(r"\w[\w.-]*", name):
            raise InputError(
                f"a name must be made of letters and digits and differ from {', '.join(COLUMN_NAMES)}",
                f"{where}: {shown(name)}",
            )
        with located(f"{where}: {name}"):
            model.element_at(point)
    return {name: float(point) for name, point in table.items()}
