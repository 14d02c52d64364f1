"""The tables of a fit to measured motion: [[records]] with files and sensors, and [fit] with the unknowns."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import Recording
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import check_keys, is_sequence, located, shown, whole
from problems.schema.beam import DAMPED_HELP, read_damped, read_terms, total
from problems.schema.file import StudyFile
from problems.schema.motion import KEYS as MOTION_KEYS
from problems.schema.motion import READING, read_base, read_load, read_measured, read_release
from problems.schema.table import made
from problems.transient.motion_record import Camera, Channel, MotionRecord

KEYS = """\
  [[records]]   one table per measured motion; channels = [{column = "x",
                direction = [1, 0]}, ...]: a list of sensors, each with file,
                column (name or number), sensor ("position", "displacement",
                "velocity", "acceleration", "slope", "strain", "force" or
                "moment"), point (m; default: the tip), direction, frame
                ("inertial" or "body"), gravity (true or false: whether an
                accelerometer feels it), distance (m, of a strain gauge from
                the neutral axis), unit, time, time_unit, rate, from, to (s),
                noise (standard deviation), offset (bounds of an unknown time
                offset, s), zero (bounds of an unknown reading at rest);
                a key beside channels holds for all channels;
                release_time (s, or bounds [LOW, HIGH]): start of the motion
                in the times of the file;
                camera = {scale, rotation, origin}: bounds of an unknown view;
                base, load, release, start: if they differ from the tables
  [[predictions]]
                records to predict with the estimates; the same keys, and
                tip_mass (kg)
  [fit]         properties (of "width", "thickness", "density",
                "elastic_modulus"), base_amplitude (true or false),
                load (of "force_x", "force_y", "moment" and their _rate),
                fixed (names of parameters of the law), bounds = {NAME = [LOW,
                HIGH]}, robust (true or false), tolerance;
                laws = [[1], [1, 2]]: for compare-laws, the tables [[damping]]
                of each law (default: each alone, and all together)
"""
RECORDS_HELP = DAMPED_HELP + MOTION_KEYS + KEYS
SENSOR = {"point", "direction", "frame", "gravity", "distance"}
UNKNOWN = {"noise", "offset", "zero"}
CHANNEL = {"file", "column", "unit", "sensor", "from", "to", *SENSOR, *READING, *UNKNOWN}
RECORD = {"channels", "release_time", "camera", "base", "load", "release", "start", *CHANNEL}
FIT = {"properties", "base_amplitude", "load", "fixed", "bounds", "robust", "tolerance"}  # of ``fit_transient``


@dataclass(frozen=True)
class Motions:
    """Measured motions of a beam, and what to estimate from them.

    Parameters
    ----------
    model : Model
        The beam, with guesses of its properties.
    damping : DampingLaw
        The law, with guesses of its parameters.
    laws : tuple of DampingLaw
        The laws to compare.
    records : tuple of MotionRecord
        The measurements.
    predictions : tuple of (MotionRecord, float or None)
        Records to predict, each with the mass at the tip (kg) if it differs from that of the beam.
    settings : mapping
        Other arguments of ``fit_transient``.
    """

    model: Model
    damping: DampingLaw
    laws: tuple[DampingLaw, ...]
    records: tuple[MotionRecord, ...]
    predictions: tuple[tuple[MotionRecord, float | None], ...]
    settings: Mapping[str, Any]


def read_motions(given: str | StudyFile) -> Motions:
    """Read a beam, its damping, measured motions, and the unknowns of a fit to them.

    Raises
    ------
    InputError
        If a table is missing, a key or value cannot be used, or a file cannot be read.
    EquilibriumError
        If there is no equilibrium under the load of a release.
    """
    file = StudyFile.of(given)
    source = read_damped(file)
    fit, where = file.tables.get("fit", {}), file.where("fit")
    check_keys(fit, set(), {*FIT, "laws"}, where)
    law = source.damping
    if law is None:
        raise InputError("the table is missing; its parameters are the unknowns", file.where("damping"))
    if not file.several("records"):
        file.needed("records", "it names the file to fit")
    with located(where):
        laws = _laws(fit.get("laws"), read_terms(file, source.model), law)
    records, predictions = (
        [_record(file, table, source.model, file.where(name), keys) for table in file.several(name)]
        for name, keys in (("records", RECORD), ("predictions", RECORD | {"tip_mass"}))
    )
    masses = [table.get("tip_mass") for table in file.several("predictions")]
    settings = {key: fit[key] for key in FIT & fit.keys()}
    return Motions(source.model, law, laws, tuple(records), tuple(zip(predictions, masses, strict=True)), settings)


def _laws(given: Any, terms: Sequence[DampingLaw], law: DampingLaw) -> tuple[DampingLaw, ...]:
    """Return the sums of the terms with the given numbers, from 1; if not given, each term, and their sum."""
    if given is None:
        return (*terms, law) if len(terms) > 1 else (law,)
    if not is_sequence(given) or not given or not all(is_sequence(numbers) and numbers for numbers in given):
        raise InputError(f"must be a list of lists of numbers, such as [[1], [1, 2]], got {shown(given)}", "laws")
    laws = [total([terms[whole(number, "laws", 1, len(terms)) - 1] for number in numbers]) for numbers in given]
    return tuple(law for law in laws if law is not None)


def _record(file: StudyFile, given: Any, model: Model, where: str, keys: set[str]) -> MotionRecord:
    check_keys(given, set(), keys, where)
    shared = {key: given[key] for key in CHANNEL & given.keys()}
    listed = given.get("channels", [{}])
    if not is_sequence(listed) or not listed:
        raise InputError(f"must be a list of tables, got {shown(listed)}", f"{where}: channels")
    channels = []
    recordings: dict[str, Recording] = {}
    for k, channel in enumerate(listed, start=1):
        place = f"{where}: channels: {k}" if "channels" in given else where
        check_keys(channel, set(), CHANNEL, place)
        own = shared | channel
        key = repr([own.get(name) for name in ("file", *READING)])  # channels of one file are read at once
        if key not in recordings:
            check_keys(own, {"file"}, CHANNEL, place)
            _check_made(file, own["file"], place)
            recordings[key] = read_measured(file, own, place)
        channels.append(_channel(recordings[key], own, place))
    if {"release", "start"} <= given.keys():
        raise InputError("is given by the release; leave it out", f"{where}: start")
    settings = {name: given[key] for name, key in {"start": "start", "release": "release_time"}.items() if key in given}
    if "camera" in given:
        settings["camera"] = made(given["camera"], Camera, f"{where}: camera")
    readers: dict[str, Callable[[Any, str], Any]] = {
        "base": partial(read_base, file),
        "load": partial(read_load, file),
        "release": partial(read_release, model),
    }
    for name, reader in readers.items():  # of the record, or of the file
        table, place = (given[name], f"{where}: {name}") if name in given else (file.tables.get(name), file.where(name))
        argument = "start" if name == "release" else name
        if table is not None and argument not in settings:
            settings[argument] = reader(table, place)
    with located(where):
        return MotionRecord(channels, **settings)


def _check_made(file: StudyFile, name: Any, where: str) -> None:
    """Check that a file exists that the simulation of the same study can make."""
    path = file.beside(name, f"{where}: file")
    if "simulation" in file.tables and path.suffix.lower() == ".csv" and not path.exists():
        command = f"ancf-casadi simulate {shlex.quote(file.path)} --out {shlex.quote(str(path))}"
        raise InputError(f"does not exist; if it is to hold the motion of [simulation], run: {command}", str(path))


def _channel(recording: Recording, given: Mapping[str, Any], where: str) -> Channel:
    """Return a sensor with its record."""
    settings = {key: given[key] for key in SENSOR & given.keys()}
    unknown = {key: given[key] for key in UNKNOWN & given.keys()}
    with located(where):
        sensor = Sensor(given.get("sensor", "position"), **settings)
        record = Measurement.from_recording(recording, given.get("column"), unit=given.get("unit"), sensor=sensor)
        return Channel(record.cut(given.get("from"), given.get("to")), **unknown)
