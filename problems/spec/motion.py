"""The tables of a motion: [base] of the clamp, [load] at the tip, and [release], the load before time 0.

Those of a simulation also have [simulation] with its settings, and [markers] with points to output.  The table
[response] is the steady vibration of the beam under harmonic excitation, over a range of frequencies.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.dynamics.simulation import Method, simulate
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import HarmonicLoad, MovingForce, SampledLoad
from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.tracing import CURVE_POINTS, MOST_CURVE_POINTS, frequency_response
from ancf_casadi.support.inputs import error_prefix, physical, shown, unit_vector, whole
from ancf_casadi.support.specs import Pair, Positive, Spec, convert
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.statics import static_equilibrium
from problems.spec.beam import DampedBeam
from problems.spec.file import StudyFile, convert_groups
from problems.spec.record_files import ColumnName, FileSpec

Maker = Callable[[Model], Any]  # makes an object of a table on a beam


@dataclass(frozen=True)
class StepTables:
    """The tables of a step, converted and checked; its files are opened, and its objects made, when they are read."""

    objects: ClassVar[tuple[str, ...]]  # properties that open files or solve

    file: StudyFile
    beam: DampedBeam

    @property
    def model(self) -> Model:
        """The beam."""
        return self.beam.model

    @property
    def damping(self) -> DampingLaw | None:
        """The damping law."""
        return self.beam.damping

    @classmethod
    def of(cls, source: str | StudyFile) -> Self:
        """Convert the tables of a file."""
        raise NotImplementedError

    def read(self) -> Self:
        """Make the objects of the tables, so that a message has the place of its table."""
        for name in self.objects:
            getattr(self, name)
        return self


class BaseColumns(Spec, frozen=True):
    """Columns of a file with the motion of the base; one is enough."""

    x: ColumnName | None = None
    y: ColumnName | None = None
    rotation: ColumnName | None = None
    unit: Annotated[str | None, Meta(description="of x and y")] = None


class LoadColumns(Spec, frozen=True):
    """Columns of a file with the load at the tip; one is enough."""

    force_x: ColumnName | None = None
    force_y: ColumnName | None = None
    moment: ColumnName | None = None
    unit: Annotated[str | None, Meta(description="of the force")] = None


class LoadValues(Spec, frozen=True):
    """A load at the tip by its values."""

    time: Annotated[tuple[float, ...], Meta(description="s")]
    force: Annotated[tuple[tuple[float, ...] | float, ...], Meta(description="[[X, Y], ...], N")]
    moment: Annotated[tuple[float, ...] | None, Meta(description="N m")] = None
    point: Annotated[float | None, Meta(description="m")] = None
    follower: bool = False


class ReleaseSpec(Spec, frozen=True):
    """The load that holds the beam until time 0."""

    tip_force: Annotated[Pair, Meta(description="N")] = (0.0, 0.0)
    tip_moment: Annotated[float, Meta(description="N m")] = 0.0


class SimulationSpec(Spec, frozen=True):
    """A simulated motion; [markers] has the arc length from the clamp (m) of more points in the output, by name."""

    duration: Annotated[Positive, Meta(description="s")]
    sample_rate: Annotated[Positive | UnsetType, Meta(description="1/s")] = UNSET
    tolerance: Positive | UnsetType = UNSET
    method: Method | UnsetType = UNSET
    start: Start | UnsetType = UNSET


Kinds = Mapping[str, tuple[type, ...]]  # declarations of a table by the first of its keys, and of any other table

BASE_KINDS: Kinds = {
    "": (HarmonicBase,), "frequencies": (SweepBase,), "file": (BaseColumns, FileSpec),
    "displacement": (FixedBase,), "rotation": (FixedBase,),
}  # fmt: skip
LOAD_KINDS: Kinds = {
    "": (HarmonicLoad,), "speed": (MovingForce,), "time": (LoadValues,), "file": (LoadColumns, FileSpec),
}  # fmt: skip
COLUMN_NAMES = ("time", "tip", "base")  # names of columns that are always there


def convert_motion(file: StudyFile, nested: Mapping[str, Any], where: str) -> Callable[[Model], dict[str, Any]]:
    """Convert the tables of a motion to a function, which makes the arguments ``base``, ``load``, ``start`` on a beam.

    They are ``nested`` in the table at a place, or else those of the file.  A nested start holds instead of a release.
    """
    makers: dict[str, Maker] = {}
    for name, converter in {"base": _base, "load": _load, "release": _release}.items():
        table, place = (
            (nested[name], f"{where}: {name}") if name in nested else (file.tables.get(name), file.where(name))
        )
        if table is not None and not (name == "release" and "start" in nested):
            makers[name] = converter(file, table, place)

    def arguments(model: Model) -> dict[str, Any]:
        start = {"start": nested["start"]} if "start" in nested else {}
        return start | {{"release": "start"}.get(name, name): make(model) for name, make in makers.items()}

    return arguments


def table_kind(kinds: Kinds, table: Any) -> tuple[type, ...]:
    """Return the declarations of a table, which its keys tell."""
    keys = table if isinstance(table, dict) else {}
    return next((kind for key, kind in kinds.items() if key in keys), kinds[""])


def _base(file: StudyFile, table: Any, where: str) -> Maker:
    """Convert a base motion."""
    kind, *file_kind = table_kind(BASE_KINDS, table)
    if file_kind:
        return _read_samples(file, table, SampledBase, BaseColumns, ("position", "position", "slope"), where)
    base: Any = convert(table, kind, where)
    return lambda model: base


def _load(file: StudyFile, table: Any, where: str) -> Maker:
    """Convert a load at the tip."""
    kind, *file_kind = table_kind(LOAD_KINDS, table)
    if file_kind:
        return _read_samples(file, table, SampledLoad, LoadColumns, ("force", "force", "moment"), where)
    load: Any = convert(table, kind, where)
    if isinstance(load, LoadValues):
        with error_prefix(where):
            load = SampledLoad(**load.set_fields())
    return lambda model: load


def _release(file: StudyFile, table: Any, where: str) -> Maker:
    """Convert the load before time 0; the motion starts from the equilibrium under it."""
    release = convert(table, ReleaseSpec, where)

    def start(model: Model) -> Equilibrium:
        with error_prefix(where):
            return static_equilibrium(model, **release.set_fields())

    return start


def start_shape(file: StudyFile, model: Model) -> Equilibrium:
    """Return the equilibrium before time 0, under gravity and the table [release], if there is one."""
    table, where = file.tables.get("release"), file.where("release")
    equilibrium: Equilibrium = static_equilibrium(model) if table is None else _release(file, table, where)(model)
    return equilibrium


def _read_samples(
    file: StudyFile, table: Any, kind: Any, columns: type[Spec], quantities: tuple[Quantity, ...], where: str
) -> Maker:
    """Convert an excitation with the times and columns of a file, in SI units; one without a column is zero."""
    source, chosen = convert_groups(table, where, FileSpec, columns)
    names = columns.__struct_fields__[:-1]  # the unit holds for those of the first quantity
    named = {name: column for name in names if (column := getattr(chosen, name)) is not None}
    if not named:
        raise InputError(f"name at least one of the columns {', '.join(names)}", where)

    def excitation(model: Model) -> Any:
        recording = source.recording(file, where)
        records = {}
        for name, quantity in zip(names, quantities, strict=True):
            if name in named:
                unit, sensor = chosen.unit if quantity == quantities[0] else None, Sensor(quantity)
                with error_prefix(f"{where}: {name}"):
                    records[name] = Measurement.from_recording(recording, named[name], unit=unit, sensor=sensor)
        first, *following = records
        for name in following:
            if not np.array_equal(records[name].time, records[first].time):
                message = f"has other times or gaps than {first}; give all columns at the same times"
                raise InputError(message, f"{where}: {name}")
        time = records[first].time
        x, y, turning = (records[name].values if name in records else np.zeros(len(time)) for name in names)
        with error_prefix(where):
            return kind(time, np.column_stack([x, y]), turning)

    return excitation


@dataclass(frozen=True)
class SimulationTables(StepTables):
    """The tables of a simulated motion."""

    objects = ("excitation", "damping")

    settings: Mapping[str, Any]  # arguments of ``simulate``
    motion: Callable[[Model], dict[str, Any]]  # other arguments
    markers: Mapping[str, float]  # arc length of each point to output, m

    @classmethod
    def of(cls, source: str | StudyFile) -> SimulationTables:
        """Convert the tables of a file."""
        file = StudyFile.of(source)
        beam, where = DampedBeam.of(file), file.where("simulation")
        settings = convert(file.require("simulation"), SimulationSpec, where).set_fields()
        _check_size(settings, beam.model, where)
        if "start" in settings and "release" in file.tables:
            raise InputError("is given by the table [release]; leave it out", f"{where}: start")
        return cls(file, beam, settings, convert_motion(file, settings, where), read_markers(file, beam.model))

    @cached_property
    def excitation(self) -> dict[str, Any]:
        """Base, load and start of the motion, as arguments of ``simulate``."""
        return self.motion(self.model)

    @property
    def arguments(self) -> dict[str, Any]:
        """All arguments of ``simulate``."""
        return {"model": self.model, "damping": self.damping, **self.settings, **self.excitation}

    def simulate(self) -> Trajectory:
        """Return the motion."""
        with error_prefix(self.file.where("simulation")):
            return simulate(**self.arguments)


def _check_size(settings: Mapping[str, Any], model: Model, where: str) -> None:
    """Refuse a motion that would fill the memory."""
    rate = settings.get("sample_rate", 1000.0)  # 1/s, the default of ``simulate``
    with error_prefix(where):
        samples = physical(settings["duration"], "duration") * physical(rate, "sample_rate")
    if 2 * 8 * model.size * samples > 5e8:  # bytes of the coordinates and velocities
        raise InputError(
            f"{samples:.3g} samples of {model.beam.elements} elements would take {16 * model.size * samples / 1e9:.2g} "
            "GB; lower sample_rate or duration, or use fewer elements",
            f"{where}: sample_rate",
        )


def read_markers(file: StudyFile, model: Model) -> dict[str, float]:
    """Return the points of the table [markers]: arc length by name, m."""
    where = file.where("markers")
    points = convert(file.tables.get("markers", {}), dict[str, Any], where)
    for name, point in points.items():
        if name in COLUMN_NAMES or not re.fullmatch(r"\w[\w.-]*", name):
            raise InputError(
                f"a name must be made of letters and digits and differ from {', '.join(COLUMN_NAMES)}",
                f"{where}: {shown(name)}",
            )
        with error_prefix(f"{where}: {name}"):
            model.element_at(point)
    return points


RESPONSE_MODES = 8  # of the reduced model, if the beam has as many
RESPONSE_TOLERANCE = 1e-4  # few harmonics suffice for it, even under friction

Levels = Positive | Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=20)]


class ResponseSpec(Spec, frozen=True):
    """Steady vibration over frequency."""

    frequencies: Annotated[tuple[Positive, Positive], Meta(description="[FROM, TO], Hz")]
    base_amplitudes: Annotated[Levels, Meta(description="m, one number or several levels")] = ()
    tip_forces: Annotated[Levels, Meta(description="N, instead of base_amplitudes")] = ()
    direction: Pair = (1.0, 0.0)
    model: Literal["reduced", "full"] = "reduced"
    modes: Annotated[int, Meta(ge=1, description=f"of the reduced model, {RESPONSE_MODES}")] | None = None
    points: Annotated[int, Meta(ge=2, le=MOST_CURVE_POINTS, description=f"least number on a curve, {CURVE_POINTS}")] = (
        CURVE_POINTS
    )
    tolerance: Annotated[
        float, Meta(gt=0.0, le=0.01, description=f"error of each motion relative to its size, {RESPONSE_TOLERANCE:g}")
    ] = RESPONSE_TOLERANCE


@dataclass(frozen=True)
class ResponseTables(StepTables):
    """The arguments of ``frequency_response`` from a file, one curve per level of the excitation."""

    table: ResponseSpec
    modes: int  # of the reduced model; 0 for the full beam
    markers: Mapping[str, float]  # arc length of each point to output, m

    @classmethod
    def of(cls, source: str | StudyFile) -> ResponseTables:
        """Convert the tables of a file."""
        file = StudyFile.of(source)
        beam, where = DampedBeam.of(file), file.where("response")
        table = convert(file.require("response"), ResponseSpec, where)
        first, last = table.frequencies
        if first == last:
            raise InputError(f"must be [FROM, TO], two different values, got {first:g} twice", f"{where}: frequencies")
        unit_vector(table.direction, f"{where}: direction")
        if bool(table.base_amplitudes) == bool(table.tip_forces):
            raise InputError("give either base_amplitudes (m) or tip_forces (N)", f"{where}: base_amplitudes")
        freedoms = beam.model.freedoms
        if table.model == "full":
            if table.modes:
                raise InputError("belongs to the reduced model; leave it out", f"{where}: modes")
            modes = 0
        else:
            modes = whole(table.modes or min(RESPONSE_MODES, freedoms // 2), f"{where}: modes", 1, freedoms)
        return cls(file, beam, table, modes, read_markers(file, beam.model))

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
        return "m" if self.table.base_amplitudes else "N"

    def excitation(self, level: float) -> dict[str, Any]:
        """Return the excitation of a level as the argument ``base`` or ``load`` of ``frequency_response``."""
        start, direction = self.table.frequencies[0], unit_vector(self.table.direction, "direction")
        if self.table.base_amplitudes:
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
