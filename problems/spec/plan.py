"""The tables of a plan: [plan] with its goal and budget, [[candidates]], and [fit] with the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

from msgspec import UNSET, Meta, UnsetType
from msgspec.structs import replace

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import ConfigurationSpec
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import error_prefix, shown
from ancf_casadi.support.specs import Pair, Positive, Spec, convert
from problems.planning.comparison import PlannedComparison, plan_comparison
from problems.planning.experiments import plan
from problems.planning.record import PlannedRecord
from problems.planning.result import Plan
from problems.spec.beam import DampedBeam
from problems.spec.file import StudyFile, convert_groups
from problems.spec.motion import StepTables, convert_motion
from problems.spec.record_files import SensorSpec
from problems.spec.records import (
    CurveTestSpec,
    FitSpec,
    LoadsSpec,
    MotionTestSpec,
    StaticTestSpec,
    Values,
    channel_groups,
    excitation,
    law_terms,
    sums_of_laws,
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


class PlannedMotionSpec(MotionTestSpec, frozen=True, kw_only=True):
    """A motion that could be measured."""

    duration: Annotated[Positive, Meta(description="s")]
    sample_rate: Annotated[Positive, Meta(description="1/s")]
    offset: Annotated[Pair | None, Meta(description="bounds, s")] = None
    zero: Annotated[Pair | None, Meta(description="bounds")] = None


class PlannedFrequenciesSpec(Spec, frozen=True):
    """Natural frequencies that could be measured."""

    modes: tuple[int, ...]
    std: Annotated[Values, Meta(description="Hz")]


class PlannedCurveSpec(CurveTestSpec, frozen=True, kw_only=True):
    """A response curve that could be measured."""

    frequencies: Annotated[tuple[float, ...], Meta(description="Hz")]
    phases: bool = True
    levels: tuple[float, ...] | UnsetType = UNSET


PLAN_TABLES = {"beam", "damping", "base", "load", "release", "candidates", "fit", "plan"}


@dataclass(frozen=True)
class PlanTables(StepTables):
    """The arguments of ``plan`` from a file, and what its result is asked for."""

    objects = ("candidates",)

    law_terms: Sequence[Sequence[int]]  # of each law to tell apart, as indices of the tables [[damping]]
    makers: Mapping[str, Callable[[], PlannedRecord]]  # of the candidates
    settings: Mapping[str, Any]  # other arguments of ``plan``
    table: PlanSpec

    @classmethod
    def of(cls, source: str | StudyFile) -> PlanTables:
        """Convert the tables of a file."""
        file = StudyFile.of(source)
        beam, where = DampedBeam.of(file), file.where("candidates")
        file.require("candidates", "each names an experiment that could be done")
        makers: dict[str, Callable[[], PlannedRecord]] = {}
        for k, candidate in enumerate(file.several("candidates"), start=1):
            name = candidate.get("name", f"candidate {k}") if isinstance(candidate, dict) else ""
            if not isinstance(name, str) or name in makers:
                raise InputError(f"must be a text that no other candidate has, got {shown(name)}", f"{where}: name")
            makers[name] = _candidate(file, candidate, beam.model, f"{where}: {name}")
        fit = convert(file.tables.get("fit", {}), FitSpec, file.where("fit"))
        settings = {key: value for key, value in fit.set_fields().items() if key in ("unknowns", "fixed", "priors")}
        table = convert(file.tables.get("plan", {}), PlanSpec, file.where("plan"))
        unused = sorted(file.tables.get("plan", {}).keys() - {"laws"}) if table.laws else ()
        if unused:
            message = "ranks no lists of candidates where laws = true; remove it, or laws = true"
            raise InputError(message, f"{file.where('plan')}: {unused[0]}")
        return cls(file, beam, law_terms(file, fit, beam), makers, settings, table)

    @cached_property
    def candidates(self) -> dict[str, PlannedRecord]:
        """The experiments that could be done."""
        return {name: make() for name, make in self.makers.items()}

    def plan(self) -> Plan:
        """Return the plan."""
        candidates = self.candidates
        with error_prefix(self.file.where("fit")):
            return plan(self.model, candidates, self.damping, **self.settings)

    def compare(self) -> PlannedComparison:
        """Return the probabilities that the candidates tell the laws apart."""
        candidates, laws = self.candidates, sums_of_laws(self.beam, self.law_terms)
        with error_prefix(self.file.where("fit")):
            return plan_comparison(self.model, candidates, laws, **self.settings)

    def choose(self, planned: Plan) -> dict[str, Any]:
        """Return goal and budget, the best list with its standard errors, and the best shares, for JSON."""
        table = self.table
        with error_prefix(self.file.where("plan")):
            best = planned.best(table.budget, table.goal, table.most_each)
            shares = planned.shares(table.budget, table.goal)
        errors = {"standard_errors": planned.errors_of(best), "shares": shares}
        return {"goal": table.goal, "budget": table.budget, "best": best, **errors}


def _candidate(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], PlannedRecord]:
    """Return the experiment of a table, of a kind that its keys tell."""
    keys = set(table) if isinstance(table, dict) else set()
    kinds = {"duration": _motion, "loads": _static, "modes": _frequencies, "frequencies": _curve}
    for key, converter in kinds.items():
        if key in keys:
            return converter(file, table, model, where)
    raise InputError(
        "needs duration (a motion), loads (a static test), modes, or frequencies (a response curve)", where
    )


def _motion(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], PlannedRecord]:
    (candidate, configuration, motion), channels = channel_groups(
        table, where, (CandidateSpec, ConfigurationSpec, PlannedMotionSpec), (PlannedChannelSpec, SensorSpec)
    )
    other_model = configuration.other_model(model, where)
    sensors, std = _sensors(channels)
    excitation_on = convert_motion(file, motion.set_fields(), where)

    def record() -> PlannedRecord:
        arguments = excitation_on(other_model or model)
        for name in ("duration", "sample_rate", "release_time", "offset", "zero"):
            arguments[name] = getattr(motion, name)
        with error_prefix(where):
            return PlannedRecord.motion(sensors, std=std, model=other_model, cost=candidate.cost, **arguments)

    return record


def _static(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], PlannedRecord]:
    (candidate, configuration, static, tests), channels = channel_groups(
        table, where, (CandidateSpec, ConfigurationSpec, StaticTestSpec, LoadsSpec), (PlannedChannelSpec, SensorSpec)
    )
    sensors, std = _sensors(channels)
    beam = configuration.other_model(model, where) or model
    with error_prefix(where):
        record = PlannedRecord.static(beam, tests.cases(), sensors, std=std, tared=static.tared, cost=candidate.cost)
    return lambda: record


def _frequencies(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], PlannedRecord]:
    candidate, configuration, planned = convert_groups(
        table, where, CandidateSpec, ConfigurationSpec, PlannedFrequenciesSpec
    )
    beam = configuration.other_model(model, where) or model
    with error_prefix(where):
        record = PlannedRecord.natural_frequencies(beam, planned.modes, std=planned.std, cost=candidate.cost)
    return lambda: record


def _curve(file: StudyFile, table: Any, model: Model, where: str) -> Callable[[], PlannedRecord]:
    candidate, configuration, curve, sensor = convert_groups(
        table, where, CandidateSpec, ConfigurationSpec, PlannedCurveSpec, SensorSpec
    )
    arguments = curve.set_fields() | excitation(file, curve, where)
    arguments |= {"model": configuration.other_model(model, where), "sensor": sensor.make("displacement", where)}
    with error_prefix(where):
        record = PlannedRecord.response(cost=candidate.cost, **arguments)
    return lambda: record


def _sensors(channels: Any) -> tuple[list[Sensor], list[float]]:
    """Return the sensors of all channels, one at each of their points, and their standard deviations."""
    placed = [(replace(sensor, point=point).make("displacement", place), channel.std)
              for (channel, sensor), place in channels for point in channel.points or (sensor.point,)]  # fmt: skip
    return [sensor for sensor, _ in placed], [std for _, std in placed]
