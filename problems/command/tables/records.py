"""The tables of a fit to measured motion: [[records]] with files and sensors, and [fit] with the unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.start import Start
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import is_sequence, located, shown, whole
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.command.tables.base import read_base
from problems.command.tables.damping import read_terms, total
from problems.command.tables.release import read_release
from problems.command.tables.study import Study, checked
from problems.transient.marker_record import MarkerRecord

KEYS = """\
  [[records]]   file; channels = [{column = "x", direction = [1, 0]}, ...]: for
                each its column (name or number), sensor ("position",
                "displacement", "velocity", "acceleration", "slope", "strain",
                "force", "moment"), point (m; default: the tip), direction,
                frame ("inertial" or "body"), unit;
                a key beside channels holds for all channels;
                time, time_unit, rate; from, to (s);
                base, release, start: if they differ from [base], [release]
  [fit]         properties (of "width", "thickness", "density",
                "elastic_modulus"), base_amplitude (true or false),
                load (of "force_x", "force_y", "moment" and their _rate),
                fixed (names of parameters of the law), bounds = {NAME = [LOW,
                HIGH]}, robust (true or false), tolerance;
                laws = [[1], [1, 2]]: for compare-laws, the tables [[damping]]
                of each law (default: each alone, and all together)
"""
SENSOR = {"point", "direction", "frame"}
CHANNEL = {"column", "sensor", "unit", *SENSOR}
READING = {"time", "time_unit", "rate"}
RECORD = {"channels", "from", "to", "base", "release", "start", *CHANNEL, *READING}
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
    records : tuple of MarkerRecord
        The measurements.
    settings : mapping
        Other arguments of ``fit_transient``.
    """

    model: Model
    damping: DampingLaw
    laws: tuple[DampingLaw, ...]
    records: tuple[MarkerRecord, ...]
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
    tables, where = study.several("records"), study.where("records")
    if not tables:
        raise InputError("there are none; name the files to fit", where)
    records = tuple(_record(study, table, source.model, where) for table in tables)
    with located(study.where("fit")):
        laws = _laws(fit["laws"], terms) if "laws" in fit else _usual_laws(terms, law)
    return Motions(source.model, law, laws, records, {key: fit[key] for key in FIT & fit.keys()})


def _laws(given: Any, terms: Sequence[DampingLaw]) -> tuple[DampingLaw, ...]:
    """Return the sums of the terms with the given numbers, from 1."""
    if not is_sequence(given) or not given or not all(is_sequence(numbers) and numbers for numbers in given):
        raise InputError(f"must be a list of lists of numbers, such as [[1], [1, 2]], got {shown(given)}", "laws")
    laws = [total([terms[whole(number, "laws", 1, len(terms)) - 1] for number in numbers]) for numbers in given]
    return tuple(law for law in laws if law is not None)


def _usual_laws(terms: Sequence[DampingLaw], law: DampingLaw) -> tuple[DampingLaw, ...]:
    return (*terms, law) if len(terms) > 1 else (law,)


def _record(study: Study, table: Any, model: Model, where: str) -> MarkerRecord:
    given = checked(table, {"file"}, RECORD, where)
    path = study.file(given["file"], f"{where}: file")
    shared = {key: given[key] for key in CHANNEL & given.keys()}
    listed = given.get("channels", [{}])
    if not is_sequence(listed) or not listed:
        raise InputError(f"must be a list of tables, got {shown(listed)}", f"{where}: channels")
    reading = {key: given[key] for key in READING & given.keys()}
    channels = []
    for k, channel in enumerate(listed, start=1):
        own = checked(channel, set(), CHANNEL, f"{where}: channels: {k}")
        with located(f"{where}: channels: {k}" if "channels" in given else where):
            channels.append(_channel(path, shared | own, reading, given))
    base, start = _base(study, given, where), _start(study, given, model, where)
    with located(where):
        return _motion(channels, base, start)


def _channel(path: Any, given: Mapping[str, Any], reading: Mapping[str, Any], cut: Mapping[str, Any]) -> Measurement:
    own = {key: given[key] for key in SENSOR & given.keys()}
    sensor = Sensor(given.get("sensor", "position"), **own)
    record = Measurement.from_file(
        path, given.get("column"), unit=given.get("unit"), sensor=sensor, progress=True, **reading
    )
    return record.cut(cut.get("from"), cut.get("to"))


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


def _motion(channels: Sequence[Measurement], base: BaseMotion | None, start: Start | Equilibrium) -> MarkerRecord:
    """Return the record of pairs of channels, x and y of each point."""
    time = channels[0].time
    points, pairs = [], []
    for x, y in zip(channels[::2], channels[1::2], strict=True):
        points += [] if x.sensor.point is None else [x.sensor.point]
        pairs.append(np.column_stack([x.values, y.values]))
    return MarkerRecord(time - time[0], np.stack(pairs, axis=1), points or None, base, start)
