"""The tables of a fit to measured motion: [[records]] with files and sensors, and [fit] with the unknowns."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.start import Start
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import Recording
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import is_sequence, located, shown, whole
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.tables.base import read_base
from problems.tables.columns import READING, read_file
from problems.tables.damping import read_terms, total
from problems.tables.load import read_load
from problems.tables.release import read_release
from problems.tables.study import Study, checked
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
SENSOR = {"point", "direction", "frame", "gravity", "distance"}
UNKNOWN = {"noise", "offset", "zero"}
CHANNEL = {"file", "column", "unit", "sensor", "from", "to", *SENSOR, *READING, *UNKNOWN}
RECORD = {"channels", "release_time", "camera", "base", "load", "release", "start", *CHANNEL}
CAMERA = {"scale", "rotation", "origin"}
FIT = {"properties", "base_amplitude", "load", "fixed", "bounds", "robust", "tolerance"}


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


def motions(study: Study, source: Document) -> Motions:
    """Return the measured motions of a beam with its damping.

    Raises
    ------
    InputError
        If a table is missing, a key or value cannot be used, or a file cannot be read.
    EquilibriumError
        If there is no equilibrium under the load of a release.
    """
    fit = study.table("fit", set(), {*FIT, "laws"}) if "fit" in study.tables else {}
    terms = read_terms(study, source.model)
    law = total(terms) or source.damping
    if law is None:
        raise InputError("the table is missing; its parameters are the unknowns", study.where("damping"))
    if not study.several("records"):
        raise InputError("the table is missing; it names the file to fit", study.where("records"))
    with located(study.where("fit")):
        laws = _laws(fit["laws"], terms) if "laws" in fit else _usual_laws(terms, law)
    records = [_record(study, table, source.model, study.where("records")) for table in study.several("records")]
    predictions = []
    for table in study.several("predictions"):
        own = {key: value for key, value in table.items() if key != "tip_mass"} if isinstance(table, dict) else table
        mass = table["tip_mass"] if own != table else None
        predictions.append((_record(study, own, source.model, study.where("predictions")), mass))
    settings = {key: fit[key] for key in FIT & fit.keys()}
    return Motions(source.model, law, laws, tuple(records), tuple(predictions), settings)


def _laws(given: Any, terms: Sequence[DampingLaw]) -> tuple[DampingLaw, ...]:
    """Return the sums of the terms with the given numbers, from 1."""
    if not is_sequence(given) or not given or not all(is_sequence(numbers) and numbers for numbers in given):
        raise InputError(f"must be a list of lists of numbers, such as [[1], [1, 2]], got {shown(given)}", "laws")
    laws = [total([terms[whole(number, "laws", 1, len(terms)) - 1] for number in numbers]) for numbers in given]
    return tuple(law for law in laws if law is not None)


def _usual_laws(terms: Sequence[DampingLaw], law: DampingLaw) -> tuple[DampingLaw, ...]:
    return (*terms, law) if len(terms) > 1 else (law,)


def _record(study: Study, table: Any, model: Model, where: str) -> MotionRecord:
    given = checked(table, set(), RECORD, where)
    shared = {key: given[key] for key in CHANNEL & given.keys()}
    listed = given.get("channels", [{}])
    if not is_sequence(listed) or not listed:
        raise InputError(f"must be a list of tables, got {shown(listed)}", f"{where}: channels")
    channels = []
    files: dict[str, Recording] = {}
    for k, channel in enumerate(listed, start=1):
        place = f"{where}: channels: {k}" if "channels" in given else where
        own = shared | checked(channel, set(), CHANNEL, place)
        key = repr([own.get(name) for name in ("file", *READING)])  # channels of one file are read at once
        if key not in files:
            named = checked(own, {"file"}, CHANNEL, place)
            _check_made(study, named["file"], place)
            files[key] = read_file(study, named, place)
        channels.append(_channel(files[key], own, place))
    base, start = _base(study, given, where), _start(study, given, model, where)
    settings = {"release": given["release_time"]} if "release_time" in given else {}
    if "load" in given:
        settings["load"] = read_load(study, given["load"], f"{where}: load")
    elif "load" in study.tables:
        settings["load"] = read_load(study, study.tables["load"], study.where("load"))
    if "camera" in given:
        view = checked(given["camera"], set(), CAMERA, f"{where}: camera")
        with located(f"{where}: camera"):
            settings["camera"] = Camera(**view)
    with located(where):
        return MotionRecord(channels, base, start, **settings)


def _check_made(study: Study, name: Any, where: str) -> None:
    """Check that a file exists that the simulation of the same study can make."""
    path = study.file(name, f"{where}: file")
    if "simulation" in study.tables and path.suffix.lower() == ".csv" and not path.exists():
        command = f"ancf-casadi simulate {shlex.quote(study.path)} --out {shlex.quote(str(path))}"
        raise InputError(f"does not exist; if it is to hold the motion of [simulation], run: {command}", str(path))


def _channel(recording: Recording, given: Mapping[str, Any], where: str) -> Channel:
    """Return a sensor with its record."""
    settings = {key: given[key] for key in SENSOR & given.keys()}
    unknown = {key: given[key] for key in UNKNOWN & given.keys()}
    with located(where):
        sensor = Sensor(given.get("sensor", "position"), **settings)
        record = Measurement.from_recording(recording, given.get("column"), unit=given.get("unit"), sensor=sensor)
        return Channel(record.cut(given.get("from"), given.get("to")), **unknown)


def _base(study: Study, given: Mapping[str, Any], where: str) -> BaseMotion | None:
    if "base" in given:
        return read_base(study, given["base"], f"{where}: base")
    return read_base(study, study.tables["base"], study.where("base")) if "base" in study.tables else None


def _start(study: Study, given: Mapping[str, Any], model: Model, where: str) -> Start | Equilibrium:
    if {"release", "start"} <= given.keys():
        raise InputError("is given by the release; leave it out", f"{where}: start")
    if "release" in given:
        return read_release(given["release"], model, f"{where}: release")
    if "start" in given:
        start: Start = given["start"]
        return start
    if "release" in study.tables:
        return read_release(study.tables["release"], model, study.where("release"))
    return "equilibrium"
