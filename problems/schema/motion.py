"""The tables of a motion: [base] of the clamp, [load] at the tip, and [release], the load before time 0.

Those of a simulation also have [simulation] with its settings, and [markers] with points to output.  The table
[response] is the steady vibration of the beam under harmonic excitation, over a range of frequencies.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad, MovingForce, SampledLoad, TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import read_recording
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.tracing import CURVE_POINTS, MOST_CURVE_POINTS, frequency_response
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys, located, physical, shown, unit_vector, whole
from ancf_casadi.vibration.statics import static_equilibrium
from problems.schema.beam import DAMPED_HELP, read_damped
from problems.schema.table import Positive, StudyFile, made, read, told

MOTION_KEYS = """\
  [base]        harmonic: amplitude (m), frequency (Hz), stop (s), direction,
                stop_at ("rest" or "once"), ramp (cycles in which the
                amplitude grows from 0)
                sweep: the same with frequencies = [FIRST, LAST] (Hz)
                sampled: file, with the columns (name or number) x, y and
                rotation, of which one is enough; time, unit, time_unit,
                names_row, skip_rows, leave_out, sample_rate (1/s)
                fixed: displacement (m), rotation (rad)
  [load]        force and moment at the tip, in the laboratory frame
                harmonic: force (N), moment (N m), frequency (Hz), stop (s),
                ramp (cycles)
                sampled: time = [0, 5], force = [[1, 0], [1, 0]], moment; or
                file, with the columns force_x, force_y and moment, of which
                one is enough; time, unit, time_unit,
                names_row, skip_rows, leave_out, sample_rate (1/s)
                moving: force (N), speed (m/s), point (m), begin (s), end (m)
  [release]     the load that holds the beam until time 0: tip_force (N),
                tip_moment (N m)
"""
TIMES = ("time", "time_unit", "sample_rate")
READING = (*TIMES, "names_row", "skip_rows", "leave_out")  # keys that say how to read a file
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
        times = {key: given.get(key) for key in TIMES}
        return read_recording(
            path, progress=True, layout=TableLayout.of({key: given.get(key) for key in READING}), **times
        )


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


RESPONSE_MODES = 8  # of the reduced model, if the beam has as many
RESPONSE_TOLERANCE = 1e-4  # few harmonics suffice for it, even under friction

Levels = Positive | Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=20)]


class ResponseTable(Struct, frozen=True):
    """Keys of the table [response]; 0 stands for what is not given."""

    frequencies: Annotated[tuple[Positive, Positive], Meta(description="[FROM, TO], Hz")]
    base_amplitudes: Annotated[Levels, Meta(description="m, one number or several levels")] = ()
    tip_forces: Annotated[Levels, Meta(description="N, instead of base_amplitudes")] = ()
    direction: tuple[float, float] = (1.0, 0.0)
    model: Literal["reduced", "full"] = "reduced"
    modes: Annotated[int, Meta(ge=1, description=f"of the reduced model, {RESPONSE_MODES}")] = 0
    points: Annotated[int, Meta(ge=2, le=MOST_CURVE_POINTS, description=f"least number on a curve, {CURVE_POINTS}")] = (
        CURVE_POINTS
    )
    tolerance: Annotated[
        float, Meta(gt=0.0, le=0.01, description=f"error of each motion relative to its size, {RESPONSE_TOLERANCE:g}")
    ] = RESPONSE_TOLERANCE


RESPONSE_HELP = DAMPED_HELP + told("[response]", "steady vibration: {}", ResponseTable) + MARKERS_KEYS


@dataclass(frozen=True, eq=False)
class ResponseTask:
    """The arguments of ``frequency_response`` from a file, one curve per level of the excitation."""

    model: Model
    damping: DampingLaw | None
    table: ResponseTable
    modes: int  # of the reduced model; 0 for the full beam
    markers: Mapping[str, float]  # arc length of each point to output, m

    @property
    def driven(self) -> str:
        """Place of the excitation, "base" or "tip"."""
        return "base" if self.table.base_amplitudes else "tip"

    @property
    def levels(self) -> tuple[float, ...]:
        """Amplitudes of the excitation: of the base, m, or of the force at the tip, N."""
        levels = self.table.base_amplitudes or self.table.tip_forces
        return levels if isinstance(levels, tuple) else (levels,)

    @cached_property
    def body(self) -> Model | ReducedModel:
        """The full beam, or its reduced model with the damping law."""
        return reduce_model(self.model, modes=self.modes, damping=self.damping) if self.modes else self.model

    @property
    def unit(self) -> str:
        """Unit of the levels."""
        return "m" if self.driven == "base" else "N"

    def excitation(self, level: float) -> dict[str, Any]:
        """Return the excitation of a level as the argument ``base`` or ``load`` of ``frequency_response``."""
        start, direction = self.table.frequencies[0], unit_vector(self.table.direction, "direction")
        if self.driven == "base":
            return {"base": HarmonicBase(level, start, direction=direction)}
        return {"load": HarmonicLoad((level * direction[0], level * direction[1]), start)}

    def curve(self, level: float) -> ResponseCurve:
        """Return the response curve of a level."""
        return frequency_response(
            self.body,
            self.table.frequencies,
            damping=None if self.modes else self.damping,  # a reduced model has its law
            points=self.table.points,
            tolerance=self.table.tolerance,
            **self.excitation(level),
        )


def read_response(given: str | StudyFile) -> ResponseTask:
    """Read a beam, its damping, and its harmonic excitation over a range of frequencies."""
    file = StudyFile.of(given)
    source, where = read_damped(file), file.where("response")
    table = read(file.needed("response"), ResponseTable, where)
    first, last = table.frequencies
    if first == last:
        raise InputError(f"must be [FROM, TO], two different values, got {first:g} twice", f"{where}: frequencies")
    unit_vector(table.direction, f"{where}: direction")
    if bool(table.base_amplitudes) == bool(table.tip_forces):
        raise InputError("give either base_amplitudes (m) or tip_forces (N)", f"{where}: base_amplitudes")
    modes, markers = _modes(table, source.model, f"{where}: modes"), read_markers(file, source.model)
    return ResponseTask(source.model, source.damping, table, modes, markers)


def _modes(table: ResponseTable, model: Model, where: str) -> int:
    """Return the number of modes of the reduced model; 0 for the full beam."""
    most = model.freedoms
    if table.model == "full":
        if table.modes:
            raise InputError("belongs to the reduced model; leave it out", where)
        return 0
    return whole(table.modes, where, 1, most) if table.modes else min(RESPONSE_MODES, most // 2)
