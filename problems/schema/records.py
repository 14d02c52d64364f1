"""The tables of a fit of a beam: its measurements, one table each, and [fit] with the unknowns.

[[records]] are motions in files, [[curves]] response curves in files or as numbers, [[statics]] static tests and
[[frequencies]] natural frequencies, both as numbers.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from inspect import signature
from typing import Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.spec import sum_laws
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.model_document import Document
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import ConfigurationSpec
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import LAYOUT_KEYS, TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import array, check_keys, is_sequence, located, shown, whole
from ancf_casadi.support.specs import convert
from problems.beam.curves.record import ResponseRecord
from problems.beam.motions.record import Camera, Channel, MotionRecord
from problems.beam.values.records import FrequencyRecord, StaticRecord
from problems.schema.beam import DAMPED_HELP, read_damped, term_of
from problems.schema.motion import MOTION_KEYS, READING, read_measured, read_motion
from problems.schema.table import StudyFile, made

RECORD_KEYS = """\
  [[records]]   one table per measured motion; channels = [{column = "x",
                direction = [1, 0]}, ...]: a list of sensors, each with file,
                column (name or number), sensor ("position", "displacement",
                "velocity", "acceleration", "slope", "strain", "force" or
                "moment"), point (m; default: the tip), direction, frame
                ("inertial" or "body"), gravity (true or false: whether an
                accelerometer feels it), distance (m, of a strain gauge from
                the neutral axis), unit, time, time_unit, sample_rate (1/s), begin, end (s),
                names_row (line with the names), skip_rows (lines to leave out),
                leave_out (columns to leave out),
                std (standard deviation), offset (bounds of an unknown time
                offset, s), zero (bounds of an unknown reading at rest);
                a key beside channels holds for all channels;
                release_time (s, or bounds [LOW, HIGH]): start of the motion
                in the times of the file;
                camera = {scale, rotation, origin}: bounds of an unknown view;
                base, load, release, start: if they differ from the tables;
                name in reports
  [[predictions]]
                records to predict with the estimates; the same keys
  [[curves]]    steady vibration: file, and if its names do not tell them the
                columns frequency, column (amplitude), phase, level, and unit,
                phase_unit, level_unit, imaginary (column of imaginary parts),
                names_row, skip_rows, leave_out as above; or frequencies (Hz), values
                (amplitudes), phases (rad), levels; base = {amplitude (m),
                direction} or load = {force (N), moment (N m)} at level 1 (if
                not given: [base] or [load]; else levels in N are a force in x
                at the tip, and those in m or m/s^2 motions of the base in x);
                sweep ("up" or "down"), control ("excitation" or "response"),
                amplitude_std, phase_std, level_std; sensor ("displacement" if
                neither it nor a unit is given), point, direction, ...: as above
  [[statics]]   beam at rest under loads: loads = [{mass = 1e-3}, ...], one
                table for each case or a list of tables: mass (kg), or force
                (N) and moment (N m), and point (m); values of the cases, std,
                sensor ("displacement"), point, direction, ... as above, or
                channels = [{sensor = "slope", values = [0.1, ...]}, ...];
                tared (true or false: whether all sensors read 0 without loads)
  [[frequencies]]
                natural frequencies: frequencies (Hz), std (Hz), modes (from 1)
                a measurement in another configuration of the beam has length
                (m), axis, tip_mass (kg), clamp_stiffness (N m/rad), supports,
                attachments: lists of tables as those of [beam]
  [fit]         unknowns (properties such as "elastic_modulus", "tip_mass",
                "thickness[1:5]"; "base_amplitude"; "start_force_x",
                "start_force_y", "start_moment" and their _rate),
                fixed (names of parameters of the law), bounds = {NAME = [LOW,
                HIGH]}, priors = {NAME = [MEAN, STD]} (or [MEDIAN,
                RELATIVE STD, "log-normal"]), robust (true or false),
                tolerance;
                laws = [[1], [1, 2]]: for compare-laws and plan --laws, the
                tables [[damping]] of each law (default: each alone, and all together)
"""
MODE_CURVES_HELP = """\
Tables of CURVES.toml, in SI units:
  [[curves]]    one table per response curve: file (with columns of frequency,
                amplitude, phase and level), or frequencies (Hz), values
                (amplitudes of the sensor), phases (rad), levels;
                excitation_unit of the levels ("N", "V", or "m", "m/s", "m/s^2"
                of the base; not needed if the file tells it), relative (true
                if the sensor moves with the base), sweep ("up" or "down"),
                control ("excitation" or "response"), sensor ("displacement" if
                not given, "velocity", "acceleration", "strain"),
                amplitude_std, phase_std, level_std, name
"""
RECORDS_HELP = DAMPED_HELP + MOTION_KEYS + RECORD_KEYS
SENSOR = {"point", "direction", "frame", "gravity", "distance"}
NUMBERS = ("frequencies", "statics", "curves")  # tables of values, each made on its own
CURVE_NUMBERS = {"frequencies", "values", "phases", "levels"}
CURVE_MADE = {"sensor", "model", "notes"}  # of other keys
CURVE_READING = {"file", "column", "frequency", "level", "phase", "unit", "level_unit", "phase_unit", *LAYOUT_KEYS}
UNKNOWN_KEYS = {"std", "offset", "zero"}
CONFIGURATION = set(ConfigurationSpec.__struct_fields__)
CHANNEL = {"file", "column", "unit", "sensor", "begin", "end", *SENSOR, *READING, *UNKNOWN_KEYS}
RECORD = {"channels", "name", "release_time", "camera", "base", "load", "release", "start", *CHANNEL, *CONFIGURATION}
FIT = {"unknowns", "fixed", "bounds", "priors", "robust", "tolerance"}  # of ``fit_beam``


@dataclass(frozen=True)
class Measurements:
    """Measurements of a beam, and what to estimate from them."""

    model: Model  # with guesses of its properties
    damping: DampingLaw | None  # with guesses of its parameters
    laws: tuple[DampingLaw, ...]  # to compare
    records: tuple[MotionRecord | FrequencyRecord | StaticRecord | ResponseRecord, ...]
    predictions: tuple[MotionRecord, ...]  # to predict, not to fit
    settings: Mapping[str, Any]  # other arguments of ``fit_beam``


def read_measurements(given: str | StudyFile) -> Measurements:
    """Read a beam, its damping, measurements, and the unknowns of a fit to them."""
    file = StudyFile.of(given)
    source = read_damped(file)
    fit, where = file.tables.get("fit", {}), file.where("fit")
    check_keys(fit, set(), {*FIT, "laws"}, where)
    law = source.damping
    if law is None and (file.several("records") or file.several("curves")):
        raise InputError("the table is missing; its parameters are the unknowns", file.where("damping"))
    if not any(file.several(name) for name in NUMBERS):
        file.needed("records", f"it names the file to fit; or add {', '.join(f'[[{name}]]' for name in NUMBERS)}")
    laws = read_laws(file, source)
    records, predictions = (
        [_record(file, table, source.model, file.where(name)) for table in file.several(name)]
        for name in ("records", "predictions")
    )
    readers: tuple[Callable[[Any, Model, str], Any], ...] = (_frequencies, _static, partial(_curve, file))
    others = [
        reader(table, source.model, file.where(name))
        for name, reader in zip(NUMBERS, readers, strict=True)
        for table in file.several(name)
    ]
    settings = {key: fit[key] for key in FIT & fit.keys()}
    return Measurements(source.model, law, laws, (*records, *others), tuple(predictions), settings)


def configuration(given: Mapping[str, Any], model: Model, where: str) -> Model:
    """Return the beam in the configuration of a table."""
    spec = convert({key: given[key] for key in CONFIGURATION & given.keys()}, ConfigurationSpec, where)
    with located(where):
        return Model(model.beam.with_(**spec.changes()), model.measures) if spec.given() else model


def _frequencies(given: Any, model: Model, where: str) -> FrequencyRecord:
    check_keys(given, {"frequencies"}, {"std", "modes", *CONFIGURATION}, where)
    own = {key: given[key] for key in given.keys() - CONFIGURATION}
    return made(own, FrequencyRecord, where, model=configuration(given, model, where))


def _static(given: Any, model: Model, where: str) -> StaticRecord:
    keys = {"values", "std", "sensor", *SENSOR}
    check_keys(given, {"loads"}, {"channels", "tared", "name", *keys, *CONFIGURATION}, where)
    loads = load_cases(given["loads"], f"{where}: loads")
    sensors, columns, deviations = [], [], []
    for own, place in channels_of(given, keys, where):
        check_keys(own, {"values"}, keys, place)
        sensors.append(table_sensor(own, "displacement", place))
        with located(place):
            values, std = (array(own.get(key, math.nan), key, finite=False) for key in ("values", "std"))
            if values.shape != (len(loads),):
                raise InputError(f"must be a list with one value per load case, {len(loads)}", "values")
            if std.shape not in ((), values.shape):
                raise InputError(f"must be one number, or one per load case, {len(loads)}", "std")
        columns.append(values)
        deviations.append(np.broadcast_to(std, values.shape))
    std = np.column_stack(deviations)
    with located(where):
        return StaticRecord(
            configuration(given, model, where),
            loads,
            np.column_stack(columns),
            sensors,
            None if np.isnan(std).all() else std,
            **{key: given[key] for key in {"tared", "name"} & given.keys()},
        )


def load_cases(given: Any, where: str) -> list[list[PointLoad]]:
    """Return the loads of each case, each a weight or a force and moment."""
    if not is_sequence(given):
        raise InputError(f"must be a list of tables, got {shown(given)}", where)
    return [
        [
            made(table, PointLoad.hung if isinstance(table, dict) and "mass" in table else PointLoad, f"{where}: {k}")
            for table in (case if is_sequence(case) else [case])
        ]
        for k, case in enumerate(given, start=1)
    ]


def read_curves(name: str) -> list[ResponseRecord]:
    """Read the response curves of a file, which needs no beam."""
    file = StudyFile.of(name, required={"curves"})
    return [_curve(file, table, None, file.where("curves")) for table in file.several("curves")]


def _curve(file: StudyFile, given: Any, model: Model | None, where: str) -> ResponseRecord:
    read = isinstance(given, dict) and "file" in given
    required = {"file"} if read else {"frequencies", "values"}
    arguments = {name for name in signature(ResponseRecord).parameters} - CURVE_NUMBERS - CURVE_MADE
    arguments |= CURVE_READING if read else CURVE_NUMBERS
    check_keys(given, required, {*arguments, "sensor", *SENSOR, *(CONFIGURATION if model else ())}, where)
    own = {key: given[key] for key in arguments & given.keys()}
    if model is not None:
        own_model = configuration(given, model, where)
        own |= excitation_of(file, given, where) | {"model": None if own_model is model else own_model}
    if not read:
        return made(own, ResponseRecord, where, sensor=table_sensor(given, "displacement", where))
    path = file.beside(own.pop("file"), f"{where}: file")
    if "sensor" in given or SENSOR & given.keys():
        own["sensor"] = table_sensor(given, "displacement", where)
    if model is None:
        own.setdefault("excitation_unit", "")
    with located(where):
        layout = TableLayout.of({key: own.pop(key, None) for key in LAYOUT_KEYS})
        return ResponseRecord.from_file(path, layout=layout, progress=True, **own)


def excitation_of(file: StudyFile, given: Mapping[str, Any], where: str) -> dict[str, HarmonicBase | HarmonicLoad]:
    """Return base or load of a curve, at level 1: those of its table, or else of the file."""
    kinds: tuple[tuple[str, Callable[..., HarmonicBase | HarmonicLoad], set[str]], ...] = (
        ("base", HarmonicBase, {"amplitude", "direction"}),
        ("load", HarmonicLoad, {"force", "moment"}),
    )
    found: dict[str, HarmonicBase | HarmonicLoad] = {}
    for name, kind, keys in kinds:
        table, place = given.get(name), f"{where}: {name}"
        if table is None and not {"base", "load"} & given.keys() and name in file.tables:
            table, place = file.tables[name], file.where(name)
            table = {key: table[key] for key in keys & set(table)} if isinstance(table, dict) else table
        if table is not None:  # its frequency has no effect
            found[name] = made(table, kind, place, keys, frequency=1.0)
    return found


def read_laws(file: StudyFile, source: Document) -> tuple[DampingLaw, ...]:
    """Return the laws to compare: the sums of terms that [fit] numbers from 1, or each term, and the law with all."""
    law, given = source.damping, file.tables.get("fit", {}).get("laws")
    terms = [term_of(table, source.model, file.where("damping")) for table in file.several("damping")]
    if given is None:
        return tuple(one for one in ((*terms, law) if len(terms) > 1 else (law,)) if one is not None)
    with located(file.where("fit")):
        if not is_sequence(given) or not given or not all(is_sequence(numbers) and numbers for numbers in given):
            raise InputError(f"must be a list of lists of numbers, such as [[1], [1, 2]], got {shown(given)}", "laws")
        laws = [sum_laws([terms[whole(number, "laws", 1, len(terms)) - 1] for number in numbers]) for numbers in given]
    return tuple(one for one in laws if one is not None)


def channels_of(given: Mapping[str, Any], keys: set[str], where: str) -> list[tuple[dict[str, Any], str]]:
    """Return the table of each channel, with the keys that hold for all, and its place."""
    listed = given.get("channels", [{}])
    if not is_sequence(listed) or not listed:
        raise InputError(f"must be a list of tables, got {shown(listed)}", f"{where}: channels")
    shared = {key: given[key] for key in keys & given.keys()}
    found = []
    for k, channel in enumerate(listed, start=1):
        place = f"{where}: channels: {k}" if "channels" in given else where
        check_keys(channel, set(), keys, place)
        found.append((shared | channel, place))
    return found


def _record(file: StudyFile, given: Any, model: Model, where: str) -> MotionRecord:
    check_keys(given, set(), RECORD, where)
    own_model = configuration(given, model, where)
    channels = []
    recordings: dict[str, Recording] = {}
    for own, place in channels_of(given, CHANNEL, where):
        key = repr([own.get(name) for name in ("file", *READING)])  # channels of one file are read at once
        if key not in recordings:
            check_keys(own, {"file"}, CHANNEL, place)
            _check_made(file, own["file"], place)
            recordings[key] = read_measured(file, own, place)
        channels.append(_channel(recordings[key], own, place))
    if {"release", "start"} <= given.keys():
        raise InputError("is given by the release; leave it out", f"{where}: start")
    settings = {key: given[key] for key in {"name", "release_time"} & given.keys()}
    if "camera" in given:
        settings["camera"] = made(given["camera"], Camera, f"{where}: camera")
    settings |= read_motion(file, given, own_model, where)
    with located(where):
        return MotionRecord(channels, model=None if own_model is model else own_model, **settings)


def _check_made(file: StudyFile, name: Any, where: str) -> None:
    """Check that a file exists that the simulation of the same study can make."""
    path = file.beside(name, f"{where}: file")
    if "simulation" in file.tables and path.suffix.lower() == ".csv" and not path.exists():
        command = f"ancf-casadi simulate {shlex.quote(file.path)} --out {shlex.quote(str(path))}"
        raise InputError(f"does not exist; if it is to hold the motion of [simulation], run: {command}", str(path))


def _channel(recording: Recording, given: Mapping[str, Any], where: str) -> Channel:
    """Return a sensor with its record."""
    unknown = {key: given[key] for key in UNKNOWN_KEYS & given.keys()}
    sensor = table_sensor(given, "position", where)
    with located(where):
        record = Measurement.from_recording(recording, given.get("column"), unit=given.get("unit"), sensor=sensor)
        return Channel(record.cut(given.get("begin"), given.get("end")), **unknown)


def table_sensor(given: Mapping[str, Any], quantity: str, where: str) -> Sensor:
    """Return the sensor of a table, which may leave out its quantity."""
    with located(where):
        return Sensor(given.get("sensor", quantity), **{key: given[key] for key in SENSOR & given.keys()})
