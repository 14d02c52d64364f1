"""Reading a study from a TOML file: the table [study], the laws, and the steps in the order of the document.

A table [[steps]] declares a step.  A file without such tables has the steps that its other tables suggest: the beam and
its modes, the decays, the match, the simulation, the steady vibration, and the plan.  A fit to measured motion comes
first, and the beam is the one that it identifies.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import is_sequence, shown
from ancf_casadi.support.specs import convert
from problems.spec.file import StudyFile
from problems.study.kinds.beam import BeamProperties, Match, ModesOfBeam
from problems.study.kinds.decays import Decays
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.motion import Comparison, MotionFit, PlanStep, SimulationStep
from problems.study.kinds.rayleigh import Rayleigh
from problems.study.kinds.response import ResponseStep
from problems.study.kinds.transients import Transients
from problems.study.results import file_name
from problems.study.step import LawChoice, Step, Study

STEPS = (BeamProperties, ModesOfBeam, Decays, Rayleigh, Match, SimulationStep, ResponseStep, MotionFit, Comparison,
         Transients, PlanStep)  # fmt: skip
KINDS: dict[str, type[Step]] = {step.kind: step for step in STEPS}  # in the order of the help
SUGGESTED_KEYS = {  # kinds of steps that a table suggests
    "beam": ("beam", "modes"), "decays": ("decays",), "match": ("match",), "simulation": ("simulation",),
    "response": ("response",), "records": ("motion",), "curves": ("motion",), "statics": ("motion",),
    "frequencies": ("motion",), "candidates": ("plan",),
}  # fmt: skip
STEP_KINDS = {"fit": "motion", "compare": "comparison"}  # kinds by the names that users give to steps
STUDY_TABLES = {"study", "timing", "versions", "data"}  # other keys of results.json


def read_study(source: str | Path | StudyFile, names: Sequence[str] = ()) -> Study:
    """Read a study: all steps, or those that are named, by their name or kind, with what they need."""
    file = source if isinstance(source, StudyFile) else StudyFile.of(str(source), required=set())
    study = convert(file.tables.get("study", {}), Study, file.where("study"))
    study = replace(study, title=study.title or Path(file.path).stem, file=file, laws=_laws(file))
    where = file.where("steps")
    tables = _named_tables(file.several("steps") or _suggest_steps(file, names), where)
    chosen = [step for name in names for step in _choose_steps(name, tables, file.path)] or list(tables)
    if not tables:
        raise InputError("defines no step; add [beam], [[decays]] or [[steps]]", file.path)
    steps: dict[str, Step] = {}
    while missing := [name for name in chosen if name not in steps]:
        for name in missing:
            steps[name] = _step(study, tables[name], name, where)
            chosen += [needed for needed in steps[name].needs if needed in tables]
    steps = {name: steps[name] for name in tables if name in steps}  # in the order of the document
    _check_needs(steps, where)
    _check_labels(steps, where)
    beam = study.model.beam if any("" in step.needs for step in steps.values()) else None
    return replace(study, steps=tuple(steps.values()), beam=beam)


def _suggest_steps(file: StudyFile, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the steps that the tables of a file suggest; the beam is the one that a fit identifies, if it is run."""
    kinds = [kind for name in SUGGESTED_KEYS if name in file.tables for kind in SUGGESTED_KEYS[name]]
    kinds = list(dict.fromkeys(kinds))
    if "motion" not in kinds or (names and "motion" not in {STEP_KINDS.get(name, name) for name in names}):
        return [{"kind": kind} for kind in kinds]
    kinds.sort(key=lambda kind: kind != "motion")
    return [{"kind": kind} | ({"beam": "motion"} if kind in SUGGESTED_KEYS["beam"] else {}) for kind in kinds]


def _laws(file: StudyFile) -> dict[str, LawChoice]:
    """Return the laws of the tables [[laws]] by name."""
    where = file.where("laws")
    laws: dict[str, LawChoice] = {}
    for table in file.several("laws"):
        law = convert(table, LawChoice, where)
        if not law.name.isidentifier() or law.name in laws:
            raise InputError(f"must be made of letters, digits and _, and differ, got {shown(law.name)}",
                             f"{where}: name")  # fmt: skip
        for term in law.terms:
            if "part" in term:
                raise InputError('the key is now step = "STEP"', f"{where}: {law.name}: part")
            if not isinstance(term.get("step", ""), str):
                raise InputError(f"must be the name of a step, got {shown(term['step'])}", f"{where}: {law.name}: step")
        laws[law.name] = law if law.title else replace(law, title=law.name)
    return laws


def _named_tables(tables: Sequence[Any], where: str) -> dict[str, dict[str, Any]]:
    """Return the tables of steps by the names of the steps."""
    named: dict[str, dict[str, Any]] = {}
    for table in tables:
        kind = table.get("kind") if isinstance(table, dict) else None
        if not isinstance(kind, str) or kind not in KINDS:
            raise InputError(f"kind must be one of {', '.join(KINDS)}, got {shown(kind)}", where)
        free = next(name for k in itertools.count(1) if (name := f"{kind}_{k}" if k > 1 else kind) not in named)
        name = table.get("name", free)
        if not isinstance(name, str) or not name.isidentifier() or name in STUDY_TABLES:
            taken = ", ".join(sorted(STUDY_TABLES))
            raise InputError(
                f"must be made of letters, digits and _, and not one of {taken}, got {shown(name)}", f"{where}: name"
            )
        if name in named:
            raise InputError(f"{name!r} is taken by an earlier step; choose another one", f"{where}: name")
        named[name] = table
    return named


def _choose_steps(name: str, tables: dict[str, dict[str, Any]], path: str) -> list[str]:
    """Return the names of the steps of a name or kind, which may be a new step of this kind."""
    kind = STEP_KINDS.get(name, name)
    names = [step for step, table in tables.items() if name == step or kind == table["kind"]]
    if not names and kind not in KINDS:
        choices = ", ".join(dict.fromkeys([*tables, *STEP_KINDS]))
        raise InputError(f"there is no step {shown(name)}; steps are {choices}", path)
    if not names:
        tables[kind] = {"kind": kind}
    return names or [kind]


def _step(study: Study, table: dict[str, Any], name: str, where: str) -> Step:
    kind = KINDS[table["kind"]]
    place = f"{where}: {name}"
    keys = {"title": kind.heading, **_with_laws(table, study, place), "name": name}
    del keys["kind"]
    return replace(convert(keys, kind, place).prepare(study, place), printed_by=study.printed_by, where=place)


def _with_laws(plain_table: Any, study: Study, where: str) -> dict[str, Any]:
    """Return a table, also within the list of its runs, with laws in place of their names."""
    table: dict[str, Any] = dict(convert(plain_table, dict[str, Any], where))
    if is_sequence(table.get("laws")):
        table["laws"] = [study.law_choice(name, f"{where}: laws") for name in table["laws"]]
    if is_sequence(runs := table.get("runs", "")):
        places = [f"{where}: runs: {k}" for k in range(1, 1 + len(runs))]
        table["runs"] = [
            convert(_with_laws(run, study, place), RequestedRun, place) for run, place in zip(runs, places, strict=True)
        ]
    return table


def _check_needs(steps: Mapping[str, Step], where: str) -> None:
    """Check that the steps that others need exist, and that no step needs itself through others."""
    for name, step in steps.items():
        for needed in step.needs:
            if needed and needed not in steps:
                raise InputError(f"needs the step {needed!r}, which does not exist", f"{where}: {name}")
    try:
        TopologicalSorter({name: step.needs for name, step in steps.items()}).prepare()
    except CycleError as error:
        raise InputError(f"the steps {', '.join(sorted(set(error.args[1])))} need each other", where) from None


def _check_labels(steps: Mapping[str, Step], where: str) -> None:
    """Check that the labels of tables and figures differ, also as names of files."""
    taken: set[str] = set()
    for name, step in steps.items():
        for label in (*step.tables, *step.figures):
            if not file_name(label) or file_name(label) in taken:
                raise InputError(f"a label must have letters or digits, and differ, got {shown(label)}",
                                 f"{where}: {name}")  # fmt: skip
            taken.add(file_name(label))
