"""The tables of a plan: [plan] with its goal and budget, [[candidates]], and [fit] with the unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from msgspec import UNSET, Meta, UnsetType
from msgspec.structs import replace

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.start import Start
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import ConfigurationSpec
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import located, shown
from ancf_casadi.support.specs import Pair, Positive, Spec, convert
from problems.beam.curves.record import Control
from problems.planning.comparison import PlannedComparison, plan_comparison
from problems.planning.experiments import plan
from problems.planning.record import PlannedRecord
from problems.planning.result import Plan
from problems.spec.beam import read_damped
from problems.spec.file import StudyFile, convert_groups
from problems.spec.help import table_help
from problems.spec.motion import read_motion
from problems.spec.records import (
    BaseLevelSpec,
    FitSpec,
    LoadLevelSpec,
    LoadSpec,
    SensorSpec,
    Table,
    Values,
    channel_groups,
    excitation,
    load_cases,
    other_model,
    read_laws,
)


class PlanSpec(Spec, frozen=True):
    """The goal of a plan, and its budget."""

    budget: Annotated[Positive, Meta(description="largest sum of the costs of the best list")] = 4.0
    goal: Annotated[str, Meta(description='"D", "A" or the name of an unknown')] = "D"
    laws: Annotated[bool, Meta(description="probabilities to tell the laws apart instead of errors")] = False
    most_each: Annotated[int, Meta(ge=1, description="largest number of records of one candidate")] | None = None


class CandidateSpec(Spec, frozen=True):
    """An experiment that could be done."""

    name: str | UnsetType = UNSET
    cost: Positive = 1.0


class PlannedChannelSpec(Spec, frozen=True):
    """A sensor at a point or several, and its noise."""

    std: Annotated[float, Meta(description="standard deviation")]
    points: Annotated[tuple[float, ...], Meta(description="m, one channel at each")] = ()

    def sensors(self, sensor: SensorSpec, where: str) -> list[Sensor]:
        """Return the sensor at each of the points."""
        at_points = [replace(sensor, point=point) for point in self.points] or [sensor]
        return [one.make("displacement", where) for one in at_points]


class PlannedMotionSpec(Spec, frozen=True):
    """A motion."""

    duration: Annotated[Positive, Meta(description="s")]
    sample_rate: Annotated[Positive, Meta(description="1/s")]
    channels: Annotated[tuple[Table, ...], Meta(min_length=1, description="[{KEYS OF A CHANNEL}, ...]")] = ()
    release_time: Annotated[float | Pair, Meta(description="s, or its bounds")] = 0.0
    offset: Annotated[Pair | None, Meta(description="bounds, s")] = None
    zero: Annotated[Pair | None, Meta(description="bounds")] = None
    base: Table | UnsetType = UNSET
    load: Table | UnsetType = UNSET
    release: Table | UnsetType = UNSET
    start: Annotated[Start | UnsetType, Meta(description="these four if they differ from the tables")] = UNSET


class PlannedStaticSpec(Spec, frozen=True):
    """A static test."""

    loads: Annotated[
        tuple[LoadSpec | tuple[LoadSpec, ...], ...], Meta(description="[{mass (kg) or force (N), point}, ...]")
    ]
    channels: Annotated[tuple[Table, ...], Meta(min_length=1, description="[{KEYS OF A CHANNEL}, ...]")] = ()
    tared: bool = False


class PlannedFrequenciesSpec(Spec, frozen=True):
    """Natural frequencies."""

    modes: tuple[int, ...]
    std: Annotated[Values, Meta(description="Hz")]


class PlannedCurveSpec(Spec, frozen=True):
    """A response curve."""

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz")]
    base: Annotated[BaseLevelSpec | UnsetType, Meta(description="{amplitude (m), direction}")] = UNSET
    load: Annotated[LoadLevelSpec | UnsetType, Meta(description="{force (N), moment (N m)}")] = UNSET
    phases: bool = True
    levels: tuple[float, ...] | UnsetType = UNSET
    control: Control | UnsetType = UNSET
    amplitude_std: Values | UnsetType = UNSET
    phase_std: Values | UnsetType = UNSET
    level_std: Values | UnsetType = UNSET


PLAN_KEYS = table_help("[plan]", "{}", PlanSpec) + table_help(
    "[[candidates]]",
    "an experiment that could be done: {}, {}, and a motion: {}; or a static test: {}; keys of a channel of both: {}, "
    "{}; or natural frequencies: {}; or a response curve: {}",
    CandidateSpec, ConfigurationSpec, PlannedMotionSpec, PlannedStaticSpec, PlannedChannelSpec, SensorSpec,
    PlannedFrequenciesSpec, PlannedCurveSpec,
)  # fmt: skip
PLAN_TABLES = {"beam", "damping", "base", "load", "release", "candidates", "fit", "plan"}


@dataclass(frozen=True)
class PlanTask:
    """The arguments of ``plan`` from a file, and what its result is asked for."""

    model: Model
    damping: DampingLaw | None
    laws: tuple[DampingLaw, ...]  # to tell apart
    candidates: Mapping[str, PlannedRecord]
    settings: Mapping[str, Any]  # other arguments of ``plan``
    table: PlanSpec
    file: StudyFile

    def planned(self) -> Plan:
        """Return the plan."""
        with located(self.file.where("fit")):
            return plan(self.model, self.candidates, self.damping, **self.settings)

    def compared(self) -> PlannedComparison:
        """Return the probabilities that the candidates tell the laws apart."""
        with located(self.file.where("fit")):
            return plan_comparison(self.model, self.candidates, self.laws, **self.settings)

    def chosen(self, found: Plan) -> dict[str, Any]:
        """Return goal and budget, the best list with its standard errors, and the best shares, for JSON."""
        table = self.table
        with located(self.file.where("plan")):
            best = found.best(table.budget, table.goal, table.most_each)
            shares = found.shares(table.budget, table.goal)
        errors = {"standard_errors": found.errors_of(best), "shares": shares}
        return {"goal": table.goal, "budget": table.budget, "best": best, **errors}


def read_plan(given: str | StudyFile) -> PlanTask:
    """Read a beam with guesses, its damping, and the experiments that could be done."""
    file = StudyFile.of(given)
    source, where = read_damped(file), file.where("candidates")
    file.needed("candidates", "each names an experiment that could be done")
    candidates: dict[str, PlannedRecord] = {}
    for k, table in enumerate(file.several("candidates"), start=1):
        name = table.get("name", f"candidate {k}") if isinstance(table, dict) else ""
        if not isinstance(name, str) or name in candidates:
            raise InputError(f"must be a text that no other candidate has, got {shown(name)}", f"{where}: name")
        candidates[name] = _candidate(file, table, source.model, f"{where}: {name}")
    fit = convert(file.tables.get("fit", {}), FitSpec, file.where("fit"))
    settings = {key: value for key, value in fit.given().items() if key in ("unknowns", "fixed", "priors")}
    table = convert(file.tables.get("plan", {}), PlanSpec, file.where("plan"))
    return PlanTask(source.model, source.damping, read_laws(file, fit, source), candidates, settings, table, file)


def _candidate(file: StudyFile, table: Any, model: Model, where: str) -> PlannedRecord:
    """Return the experiment of a table, of a kind that its keys tell."""
    keys = set(table) if isinstance(table, dict) else set()
    kinds = {"duration": _motion, "loads": _static, "modes": _frequencies, "frequencies": _curve}
    for key, reader in kinds.items():
        if key in keys:
            return reader(file, table, model, where)
    raise InputError(
        "needs duration (a motion), loads (a static test), modes, or frequencies (a response curve)", where
    )


def _motion(file: StudyFile, table: Any, model: Model, where: str) -> PlannedRecord:
    (candidate, configuration, motion), channels = channel_groups(
        table, where, (CandidateSpec, ConfigurationSpec, PlannedMotionSpec), (PlannedChannelSpec, SensorSpec)
    )
    own_model = other_model(model, configuration, where)
    sensors, std = _sensors(channels)
    arguments = read_motion(file, motion.given(), own_model or model, where)
    for name in ("duration", "sample_rate", "release_time", "offset", "zero"):
        arguments[name] = getattr(motion, name)
    with located(where):
        return PlannedRecord.motion(sensors, std=std, model=own_model, cost=candidate.cost, **arguments)


def _static(file: StudyFile, table: Any, model: Model, where: str) -> PlannedRecord:
    (candidate, configuration, static), channels = channel_groups(
        table, where, (CandidateSpec, ConfigurationSpec, PlannedStaticSpec), (PlannedChannelSpec, SensorSpec)
    )
    sensors, std = _sensors(channels)
    beam = other_model(model, configuration, where) or model
    with located(where):
        loads = load_cases(static.loads)
        return PlannedRecord.static(beam, loads, sensors, std=std, tared=static.tared, cost=candidate.cost)


def _frequencies(file: StudyFile, table: Any, model: Model, where: str) -> PlannedRecord:
    candidate, configuration, planned = convert_groups(
        table, where, CandidateSpec, ConfigurationSpec, PlannedFrequenciesSpec
    )
    beam = other_model(model, configuration, where) or model
    with located(where):
        return PlannedRecord.natural_frequencies(beam, planned.modes, std=planned.std, cost=candidate.cost)


def _curve(file: StudyFile, table: Any, model: Model, where: str) -> PlannedRecord:
    candidate, configuration, curve, sensor = convert_groups(
        table, where, CandidateSpec, ConfigurationSpec, PlannedCurveSpec, SensorSpec
    )
    arguments = curve.given() | excitation(file, curve, where) | {"model": other_model(model, configuration, where)}
    with located(where):
        return PlannedRecord.response(sensor=sensor.make("displacement", ""), cost=candidate.cost, **arguments)


def _sensors(channels: Any) -> tuple[list[Sensor], list[float]]:
    """Return the sensors of all channels and their standard deviations."""
    sensors, std = [], []
    for (channel, sensor), place in channels:
        at_points = channel.sensors(sensor, place)
        sensors += at_points
        std += [channel.std] * len(at_points)
    return sensors, std
