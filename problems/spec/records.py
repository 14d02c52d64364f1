"""The tables of a fit of a beam: its measurements, one table each, and [fit] with the unknowns.

[[records]] are motions in files, [[curves]] response curves and [[statics]] static tests, both in files or as numbers,
[[frequencies]] natural frequencies as numbers.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.damping import DampingLaw
from ancf_casadi.damping.spec import sum_laws
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import HarmonicLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import ConfigurationSpec
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import LAYOUT_KEYS, TableLayout
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys, error_prefix, whole
from ancf_casadi.support.specs import Pair, Positive, Spec, convert, table_keys
from problems.beam.curves.reading import ExcitationUnit
from problems.beam.curves.record import Control, ResponseRecord, Sweep
from problems.beam.fitting import Guesses, compute_guesses, fit_beam
from problems.beam.motions.record import Camera, Channel, MotionRecord
from problems.beam.result import BeamFit
from problems.beam.values.records import FrequencyRecord, StaticRecord
from problems.spec.beam import DampedBeam
from problems.spec.file import StudyFile, convert_groups
from problems.spec.motion import StepTables, convert_motion
from problems.spec.record_files import ChannelSpec, CurveFileSpec, RecordFile, SensorSpec, StaticColumnSpec, si_column

Values = float | tuple[float, ...]  # one number, or one per value
Table = dict[str, Any]
Channels = Annotated[
    tuple[Table, ...], Meta(min_length=1, description="[{keys of a file, sensor, std}, ...] if several")
]


class MotionTestSpec(Spec, frozen=True, kw_only=True):
    """A motion; a key of its channels beside them holds for all."""

    channels: Channels = ()
    release_time: Annotated[float | Pair, Meta(description="start in the times of the record, s, or its bounds")] = 0.0
    base: Table | UnsetType = UNSET
    load: Table | UnsetType = UNSET
    release: Table | UnsetType = UNSET
    start: Annotated[Start | UnsetType, Meta(description="these four if they differ from the tables")] = UNSET


class MotionSpec(MotionTestSpec, frozen=True, kw_only=True):
    """A measured motion, to fit or in [[predictions]]; a key of its channels beside them holds for all."""

    name: str = ""
    camera: Annotated[Table | UnsetType, Meta(description="{scale, rotation, origin}: bounds of an unknown view")] = (
        UNSET
    )


class CurveTestSpec(Spec, frozen=True):
    """The excitation of a curve of steady vibration, and standard deviations."""

    base: Annotated[Table | UnsetType, Meta(description="{amplitude (m), direction} at level 1")] = UNSET
    load: Annotated[Table | UnsetType, Meta(description="{force (N), moment (N m)} at level 1")] = UNSET
    control: Annotated[Control, Meta(description="quantity that was held")] = "excitation"
    amplitude_std: Values | None = None
    phase_std: Values | None = None
    level_std: Values | None = None


class CurveSpec(CurveTestSpec, frozen=True):
    """A curve of steady vibration."""

    name: str | UnsetType = UNSET
    excitation_unit: Annotated[
        ExcitationUnit | UnsetType,
        Meta(
            description="of the levels; without [base] and [load], levels in N are a force in x at the tip, those in m "
            "or m/s^2 motions of the base in x"
        ),
    ] = UNSET
    relative: Annotated[bool, Meta(description="whether the sensor moves with the base")] = False
    sweep: Sweep | None = None


class CurveValuesSpec(Spec, frozen=True):
    """The values of a curve."""

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz")]
    values: Annotated[tuple[float, ...], Meta(description="amplitudes of the sensor")]
    phases: Annotated[tuple[float, ...] | None, Meta(description="rad")] = None
    levels: tuple[float, ...] | None = None


class LoadSpec(Spec, frozen=True):
    """A mass that hangs at a point, or a force and a moment there."""

    mass: Annotated[float | UnsetType, Meta(description="kg")] = UNSET
    force: Annotated[Pair | UnsetType, Meta(description="N")] = UNSET
    moment: Annotated[float | UnsetType, Meta(description="N m")] = UNSET
    point: Annotated[float | None, Meta(description="m")] = None
    follower: Annotated[bool | UnsetType, Meta(description="whether the force turns with the beam")] = UNSET

    def make(self) -> PointLoad:
        """Return the load."""
        if self.mass is UNSET:
            return PointLoad(**self.set_fields())
        if not (self.force is self.moment is self.follower is UNSET):
            raise InputError("give either a mass, or a force and a moment")
        return PointLoad.hung(self.mass, self.point)


class StaticTestSpec(Spec, frozen=True):
    """A static test; a key of its channels beside them holds for all."""

    channels: Channels = ()
    tared: Annotated[bool, Meta(description="whether all sensors read 0 without loads")] = False


class LoadsSpec(Spec, frozen=True):
    """The loads of a static test by case."""

    loads: Annotated[
        tuple[LoadSpec | tuple[LoadSpec, ...], ...],
        Meta(description="one or several by case"),
    ]

    def cases(self) -> list[list[PointLoad]]:
        """Return the loads of each case."""
        cases = []
        for k, case in enumerate(self.loads, start=1):
            with error_prefix(f"loads: {k}"):
                cases.append([load.make() for load in (case if isinstance(case, Sequence) else [case])])
        return cases


class StaticSpec(StaticTestSpec, frozen=True):
    """A measured static test."""

    name: str = "static test"


class StaticValuesSpec(Spec, frozen=True):
    """Readings of a sensor in a static test."""

    values: Annotated[tuple[float, ...], Meta(description="of the cases")]
    std: Values = math.nan

    def values_and_std(self, loads: Sequence[Any], sensor: Sensor) -> Iterator[Array]:
        """Return the readings and their standard deviations, one for each of the loads."""
        for name, entries in (("values", self.values), ("std", self.std)):
            if isinstance(entries, tuple) and len(entries) != len(loads):
                raise InputError(f"has {len(entries)} values for {len(loads)} load cases", name)
        return (np.broadcast_to(entries, len(loads)) for entries in (self.values, self.std))


class LoadColumnsSpec(Spec, frozen=True):
    """A load in each case of a file; a text names the column with its values."""

    mass: Annotated[float | str | UnsetType, Meta(description="kg; no load in rows where it is 0")] = UNSET
    force: Annotated[tuple[float | str, float | str] | UnsetType, Meta(description="N")] = UNSET
    moment: Annotated[float | str | UnsetType, Meta(description="N m")] = UNSET
    point: Annotated[float | str | UnsetType, Meta(description="m")] = UNSET
    follower: Annotated[bool | UnsetType, Meta(description="whether the force turns with the beam")] = UNSET
    unit: Annotated[str | None, Meta(description="of a column of mass or force, if the file does not say it")] = None

    def cases(self, contents: Recording, count: int) -> list[list[PointLoad]]:
        """Return the load of each case, none where the mass is 0."""
        entries = [self.mass, *(self.force if isinstance(self.force, tuple) else ())]
        if self.unit is not None and not any(isinstance(entry, str) for entry in entries):
            raise InputError("is that of a column of mass or force, and none is named; numbers are in kg and N", "unit")

        def values(key: str, entry: Any) -> Any:
            if isinstance(entry, tuple):
                return np.column_stack([values(key, component) for component in entry])
            if not isinstance(entry, str):
                return np.full(count, entry)
            return si_column(contents, entry, key, count, self.unit if key in ("mass", "force") else None)

        columns = {key: values(key, entry).tolist() for key, entry in self.set_fields().items() if key != "unit"}
        cases = []
        for k in range(count):
            load = {key: column[k] for key, column in columns.items()}
            with error_prefix(f"{contents.path}: {contents.place(k)}"):
                cases.append([LoadSpec(**load).make()] if load.get("mass") != 0.0 else [])
        return cases


class StaticFileSpec(RecordFile, frozen=True, kw_only=True):
    """A file with the cases of a static test, one per row."""

    load: Annotated[LoadColumnsSpec | tuple[LoadColumnsSpec, ...], Meta(description="of each case, or several")]

    def cases(self, contents: Recording, count: int) -> list[list[PointLoad]]:
        """Return the loads of each case."""
        loads = self.load if isinstance(self.load, tuple) else (self.load,)
        cases: list[list[PointLoad]] = [[] for _ in range(count)]
        for k, load in enumerate(loads, start=1):
            with error_prefix("load" if load is self.load else f"load: {k}"):
                cases = [case + added for case, added in zip(cases, load.cases(contents, count), strict=True)]
        return cases


class FrequenciesSpec(Spec, frozen=True):
    """Measured natural frequencies."""

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz")]
    std: Annotated[Values | None, Meta(description="Hz")] = None
    modes: Annotated[tuple[int, ...] | None, Meta(description="from 1")] = None
    name: str = "frequencies"


class FitSpec(Spec, frozen=True):
    """The unknowns of a fit, and what is known of them."""

    unknowns: Annotated[
        tuple[str, ...] | UnsetType,
        Meta(
            description='properties such as "elastic_modulus", "tip_mass", "thickness[1:5]"; "base_amplitude"; '
            '"start_force_x", "start_force_y", "start_moment" and their _rate'
        ),
    ] = UNSET
    fixed: Annotated[tuple[str, ...] | UnsetType, Meta(description="parameters of the law that are known")] = UNSET
    bounds: Annotated[Table | UnsetType, Meta(description="{NAME = [LOW, HIGH]}")] = UNSET
    priors: Annotated[
        Table | UnsetType,
        Meta(description='{NAME = [MEAN, STD]}, or [MEDIAN, RELATIVE STD, "log-normal"]'),
    ] = UNSET
    robust: bool | UnsetType = UNSET
    tolerance: Positive | UnsetType = UNSET
    laws: Annotated[
        Annotated[tuple[Annotated[tuple[int, ...], Meta(min_length=1)], ...], Meta(min_length=1)] | UnsetType,
        Meta(description="[[1], [1, 2]]: the tables [[damping]] of each law to compare; each alone, and all together"),
    ] = UNSET


LEVEL_KEYS: dict[str, tuple[Any, set[str]]] = {  # of a harmonic excitation whose frequency has no effect
    "base": (HarmonicBase, {"amplitude", "direction"}), "load": (HarmonicLoad, {"force", "moment"}),
}  # fmt: skip
NUMBERS = ("frequencies", "statics", "curves")  # tables of values, each made on its own
Record = MotionRecord | FrequencyRecord | StaticRecord | ResponseRecord


@dataclass(frozen=True)
class Measurements(StepTables):
    """Measurements of a beam, with guesses of its properties and its damping, and what to estimate from them."""

    objects = ("laws", "records", "predictions")

    law_terms: Sequence[Sequence[int]]  # of each law to compare, as indices of the tables [[damping]]
    fitted: Sequence[Callable[[], Record]]  # make the measurements
    predicted: Sequence[Callable[[], Record]]  # make those to predict, not to fit
    settings: Mapping[str, Any]  # other arguments of ``fit_beam``

    @classmethod
    def of(cls, source: str | StudyFile) -> Measurements:
        """Convert the tables of a file."""
        file = StudyFile.of(source)
        beam = DampedBeam.of(file)
        fit = convert(file.tables.get("fit", {}), FitSpec, file.where("fit"))
        if beam.undamped and (file.several("records") or file.several("curves")):
            raise InputError("the table is missing; its parameters are the unknowns", file.where("damping"))
        if not any(file.several(name) for name in NUMBERS):
            file.require("records", f"it names the file to fit; or add {', '.join(f'[[{name}]]' for name in NUMBERS)}")
        converters = {
            "records": _motion, "frequencies": _frequencies, "statics": _static, "curves": _curve,
            "predictions": _motion,
        }  # fmt: skip
        tables = {
            name: [converter(file, table, beam.model, file.where(name)) for table in file.several(name)]
            for name, converter in converters.items()
        }
        predicted = tables.pop("predictions")
        fitted = [table for several in tables.values() for table in several]
        settings = {key: value for key, value in fit.set_fields().items() if key != "laws"}
        return cls(file, beam, law_terms(file, fit, beam), fitted, predicted, settings)

    @cached_property
    def laws(self) -> tuple[DampingLaw, ...]:
        """The laws to compare."""
        return sums_of_laws(self.beam, self.law_terms)

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """The measurements."""
        return tuple(make() for make in self.fitted)

    @cached_property
    def predictions(self) -> tuple[Record, ...]:
        """Measurements to predict, not to fit."""
        return tuple(make() for make in self.predicted)

    def fit(self) -> BeamFit:
        """Return the fit."""
        with error_prefix(self.file.where("fit")):
            return fit_beam(self.model, self.records, self.damping, **self.settings)

    def guesses(self) -> Guesses:
        """Return the unknowns of the fit, and what their guesses give for the measurements."""
        with error_prefix(self.file.where("fit")):
            return compute_guesses(self.model, self.records, self.damping, **self.settings)


def _frequencies(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], Record]:
    spec, configuration = convert_groups(table, where, FrequenciesSpec, ConfigurationSpec)
    beam = configuration.other_model(model, where) or model
    with error_prefix(where):
        record = FrequencyRecord(beam, **spec.set_fields())
    return lambda: record


def _static(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], Record]:
    in_file = isinstance(table, dict) and "file" in table
    tests_kind, readings_kind = (StaticFileSpec, StaticColumnSpec) if in_file else (LoadsSpec, StaticValuesSpec)
    (spec, tests, configuration), channels = channel_groups(
        table, where, (StaticSpec, tests_kind, ConfigurationSpec), (readings_kind, SensorSpec)
    )
    sensors = [sensor.make("displacement", place) for (_, sensor), place in channels]
    beam = configuration.other_model(model, where) or model

    def read() -> StaticRecord:
        contents, columns = tests.contents(file, where) if in_file else tests.loads, []
        for ((readings, _), place), sensor in zip(channels, sensors, strict=True):
            with error_prefix(place):
                columns.append(readings.values_and_std(contents, sensor))
        values, std = map(np.column_stack, zip(*columns, strict=True))
        with error_prefix(where):
            loads = tests.cases(contents, len(values)) if in_file else tests.cases()
            known_std = None if np.isnan(std).all() else std
            return StaticRecord(beam, loads, values, sensors, known_std, tared=spec.tared, name=spec.name)

    if in_file:
        return read
    record = read()
    return lambda: record


def read_curves(name: str) -> list[ResponseRecord]:
    """Read the response curves of a file, which needs no beam."""
    file = StudyFile.of(name, required={"curves"})
    return [_curve(file, table, None, file.where("curves"))() for table in file.several("curves")]


def _curve(file: StudyFile, table: Any, model: Model | None, where: str) -> Callable[[], ResponseRecord]:
    in_file = isinstance(table, dict) and "file" in table
    kinds = (CurveFileSpec if in_file else CurveValuesSpec, CurveSpec, SensorSpec)
    source, curve, sensor, *configurations = convert_groups(
        table, where, *kinds, *[ConfigurationSpec] * (model is not None)
    )
    arguments = curve.set_fields()
    if model is not None:
        arguments |= excitation(file, curve, where)
        arguments["model"] = configurations[0].other_model(model, where)
    if not in_file or table_keys(SensorSpec) & table.keys():
        arguments["sensor"] = sensor.make("displacement", where)
    if not in_file:
        with error_prefix(where):
            record = ResponseRecord(**source.set_fields(), **arguments)
        return lambda: record
    if model is None:
        arguments.setdefault("excitation_unit", "")
    columns = {key: value for key, value in source.set_fields().items() if key not in (*LAYOUT_KEYS, "file")}

    def read() -> ResponseRecord:
        contents, layout = source.contents(file, where), TableLayout.of(source.set_fields())
        with error_prefix(where):
            return ResponseRecord.from_file(contents, layout=layout, **columns, **arguments)

    return read


def excitation(file: StudyFile, curve: CurveTestSpec, where: str) -> dict[str, HarmonicBase | HarmonicLoad]:
    """Return base or load of a curve, at level 1: those of its table, or else of the file."""
    own_tables = {name: table for name in LEVEL_KEYS if (table := getattr(curve, name)) is not UNSET}
    excitations = {}
    for name, (kind, keys) in LEVEL_KEYS.items():
        table, place = own_tables.get(name), f"{where}: {name}"
        if not own_tables and isinstance(table := file.tables.get(name), dict):
            table, place = {key: table[key] for key in keys & table.keys()}, file.where(name)
        if table is not None:
            check_keys(table, set(), keys, place)
            excitations[name] = convert(table | {"frequency": 1.0}, kind, place)
    return excitations


def law_terms(file: StudyFile, fit: FitSpec, beam: DampedBeam) -> tuple[tuple[int, ...], ...]:
    """Return the terms of each law to compare, which [fit] numbers from 1; else each term, and all together."""
    count = len(beam.terms)
    if fit.laws is UNSET:
        return (*((k,) for k in range(count) if count > 1), tuple(range(count)))
    with error_prefix(file.where("fit")):
        return tuple(tuple(whole(number, "laws", 1, count) - 1 for number in numbers) for numbers in fit.laws)


def sums_of_laws(beam: DampedBeam, terms: Sequence[Sequence[int]]) -> tuple[DampingLaw, ...]:
    """Return the laws with the given terms; the law of a document has all."""
    laws = [sum_laws([beam.laws[k] for k in numbers]) or beam.damping for numbers in terms]
    return tuple(law for law in laws if law is not None)


def channel_groups(
    table: Any, where: str, kinds: Sequence[Any], channel_kinds: Sequence[Any]
) -> tuple[Any, list[tuple[Any, str]]]:
    """Return the table of a record as an object per kind, and each channel likewise, with its place in the file.

    A key of a channel that stands in the table itself holds for all channels.
    """
    keys = {key for kind in channel_kinds for key in table_keys(kind)}
    objects = convert_groups(table, where, *kinds, shared=keys)
    shared = {key: table[key] for key in keys & table.keys()}
    listed = [channel for group in objects for channel in getattr(group, "channels", ())]
    places = [f"{where}: channels: {k}" for k in range(1, 1 + len(listed))] or [where]
    channels = [
        (convert_groups(shared | channel, place, *channel_kinds), place)
        for channel, place in zip(listed or [{}], places, strict=True)
    ]
    return objects, channels


def _motion(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], Record]:
    (motion, configuration), channels = channel_groups(
        table, where, (MotionSpec, ConfigurationSpec), (ChannelSpec, SensorSpec)
    )
    sensors = [sensor.make("position", place) for (_, sensor), place in channels]
    for (channel, _), _ in channels:
        _check_made(file, channel.file)
    if motion.release is not UNSET and motion.start is not UNSET:
        raise InputError("is given by the release; leave it out", f"{where}: start")
    other_model = configuration.other_model(model, where)
    excitation_on = convert_motion(file, motion.set_fields(), where)
    camera = None if motion.camera is UNSET else convert(motion.camera, Camera, f"{where}: camera")

    def read() -> MotionRecord:
        measured = []
        for ((channel, _), place), sensor in zip(channels, sensors, strict=True):
            record = channel.measurement(file, place, sensor)
            with error_prefix(place):
                measured.append(Channel(record, channel.std, channel.offset, channel.zero))
        arguments = excitation_on(other_model or model)
        with error_prefix(where):
            return MotionRecord(
                measured,
                model=other_model,
                name=motion.name,
                release_time=motion.release_time,
                camera=camera,
                **arguments,
            )

    return read


def unsimulated_records(file: StudyFile) -> list[Path]:
    """Return the files of records that do not exist, but that the motion of [simulation] can fill."""
    names = [table.get("file") for table in file.several("records") if isinstance(table, dict)]
    return [file.beside(name) for name in names if isinstance(name, str) and _is_unsimulated(file, name)]


def _is_unsimulated(file: StudyFile, name: str) -> bool:
    path = file.beside(name)
    return "simulation" in file.tables and path.suffix.lower() == ".csv" and not path.exists()


def _check_made(file: StudyFile, name: str) -> None:
    """Check that a file exists that the simulation of the same study can make."""
    if _is_unsimulated(file, name):
        path = file.beside(name)
        command = f"ancf-casadi run {shlex.quote(file.path)} simulation --out {shlex.quote(str(path.parent))}"
        raise InputError(f"does not exist; if it is to hold the motion of [simulation], run: {command}", str(path))
