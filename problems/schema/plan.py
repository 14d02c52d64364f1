"""The tables of a plan: [plan] with its goal and budget, [[candidates]], and [fit] with the unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Annotated, Any

from msgspec import Meta

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import check_keys, located, shown
from problems.beam.curves.record import ResponseRecord
from problems.planning.comparison import PlannedComparison, plan_comparison
from problems.planning.experiments import plan
from problems.planning.record import PlannedRecord
from problems.planning.result import Plan
from problems.schema.beam import DAMPED_HELP, read_damped
from problems.schema.motion import MOTION_KEYS, read_motion
from problems.schema.records import (
    CONFIGURATION,
    FIT,
    SENSOR,
    channels_of,
    configuration,
    excitation_of,
    load_cases,
    read_laws,
    table_sensor,
)
from problems.schema.table import Positive, StudyFile, read, told


@dataclass(frozen=True)
class PlanTable:
    """Keys of the table [plan]."""

    budget: Annotated[Positive, Meta(description="largest sum of the costs of the best list")] = 4.0
    goal: Annotated[str, Meta(description='"D", "A" or the name of an unknown')] = "D"
    most_each: Annotated[int, Meta(ge=1, description="largest number of records of one candidate")] | None = None


PLAN_KEYS = (
    told("[plan]", "{}", PlanTable)
    + """\
  [[candidates]]
                an experiment that could be done: name, cost (1), and
                a motion: duration (s), sample_rate (1/s), std; channels =
                [{sensor = "displacement", point (m), direction, std}, ...] or
                these keys alone, points = [...]: one channel at each;
                release_time (bounds), offset, zero; base, load, release,
                start: if they differ from the tables
                a static test: loads = [{mass (kg) or force (N), point}, ...],
                channels or the keys of one sensor, std
                natural frequencies: modes = [1, 2], std (Hz)
                a response curve: frequencies (Hz), base = {amplitude,
                direction} or load = {force}, phases (true or false),
                amplitude_std, phase_std, level_std, sensor, point, ...
                each may have length, axis, tip_mass, clamp_stiffness,
                supports, attachments
  [fit]         unknowns, fixed, priors, laws: as for the command fit
"""
)
PLAN_TABLES = {"beam", "damping", "base", "load", "release", "candidates", "fit", "plan"}
PLAN_HELP = DAMPED_HELP + MOTION_KEYS + PLAN_KEYS
PLANNED_KEYS = {"name", "cost", *CONFIGURATION}
READING_KEYS = {"sensor", "std", "points", *SENSOR}
NOT_PLANNED = {"values", "model", "name", "notes", "excitation_unit", "relative", "sweep"}  # of a ResponseRecord
PLAN_SETTINGS = {"unknowns", "fixed", "priors"}  # of ``plan`` in [fit]


@dataclass(frozen=True)
class PlanTask:
    """The arguments of ``plan`` from a file, and what its result is asked for."""

    model: Model
    damping: DampingLaw | None
    laws: tuple[DampingLaw, ...]  # to tell apart
    candidates: Mapping[str, PlannedRecord]
    settings: Mapping[str, Any]  # other arguments of ``plan``
    table: PlanTable
    file: StudyFile

    def planned(self, *, jobs: int = 1, progress: bool = False) -> Plan:
        """Return the plan."""
        with located(self.file.where("fit")):
            return plan(self.model, self.candidates, self.damping, jobs=jobs, progress=progress, **self.settings)

    def compared(self, *, jobs: int = 1, progress: bool = False) -> PlannedComparison:
        """Return the probabilities that the candidates tell the laws apart."""
        with located(self.file.where("fit")):
            return plan_comparison(
                self.model, self.candidates, self.laws, jobs=jobs, progress=progress, **self.settings
            )

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
    fit = file.tables.get("fit", {})
    check_keys(fit, set(), {*FIT, "laws"}, file.where("fit"))
    settings = {key: fit[key] for key in PLAN_SETTINGS & fit.keys()}
    table = read(file.tables.get("plan", {}), PlanTable, file.where("plan"))
    return PlanTask(source.model, source.damping, read_laws(file, source), candidates, settings, table, file)


def _candidate(file: StudyFile, given: Any, model: Model, where: str) -> PlannedRecord:
    """Return the experiment of a table, of a kind that its keys tell."""
    keys = set(given) if isinstance(given, dict) else set()
    own = configuration({key: given[key] for key in keys & CONFIGURATION}, model, where)
    settings = {"cost": given["cost"]} if "cost" in keys else {}
    if "duration" in keys:
        return _motion(file, given, own, None if own is model else own, settings, where)
    if "loads" in keys:
        check_keys(given, {"loads"}, {"channels", "tared", *READING_KEYS, *PLANNED_KEYS}, where)
        sensors, std = _sensors(given, where)
        settings |= {key: given[key] for key in {"tared"} & keys}
        loads = load_cases(given["loads"], f"{where}: loads")
        with located(where):
            return PlannedRecord.static(own, loads, sensors, std=std, **settings)
    if "modes" in keys:
        check_keys(given, {"modes", "std"}, PLANNED_KEYS, where)
        with located(where):
            return PlannedRecord.natural_frequencies(own, given["modes"], std=given["std"], **settings)
    if "frequencies" in keys:
        known = set(signature(ResponseRecord).parameters) - NOT_PLANNED
        check_keys(given, {"frequencies"}, {*known, *SENSOR, *PLANNED_KEYS}, where)
        settings |= {key: given[key] for key in (known & keys) - {"sensor"}} | excitation_of(file, given, where)
        sensor = table_sensor(given, "displacement", where)
        with located(where):
            return PlannedRecord.response(sensor=sensor, model=None if own is model else own, **settings)
    raise InputError(
        "needs duration (a motion), loads (a static test), modes, or frequencies (a response curve)", where
    )


def _motion(
    file: StudyFile, given: dict[str, Any], model: Model, own: Model | None, settings: dict[str, Any], where: str
) -> PlannedRecord:
    """Return a planned motion; ``own`` is its model if it is of another configuration."""
    passed = {"duration", "sample_rate", "offset", "zero", "release_time"}
    motion = {"channels", "base", "load", "release", "start"}
    check_keys(given, {"duration", "sample_rate"}, {*motion, *passed, *READING_KEYS, *PLANNED_KEYS}, where)
    sensors, std = _sensors(given, where)
    settings |= {key: given[key] for key in passed & given.keys()} | read_motion(file, given, model, where)
    with located(where):
        return PlannedRecord.motion(sensors, std=std, model=own, **settings)


def _sensors(given: Mapping[str, Any], where: str) -> tuple[list[Sensor], list[Any]]:
    """Return the sensors of a table and their standard deviations; one at each of ``points``."""
    sensors, stds = [], []
    for table, place in channels_of(given, READING_KEYS, where):
        points = table.get("points", [table[key] for key in ("point",) if key in table] or [None])
        if "std" not in table:
            raise InputError("the key 'std' is missing", place)
        for point in points:
            one = {key: value for key, value in table.items() if key not in ("points", "point")}
            sensors.append(table_sensor(one | ({} if point is None else {"point": point}), "displacement", place))
            stds.append(table["std"])
    return sensors, stds
