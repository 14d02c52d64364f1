"""Reading a study from a TOML file: the table [study], the laws, and the parts in the order of the document.

A file without [[parts]] has the parts that its other tables suggest: the beam and its modes, the decays, the match, the
simulation, the steady vibration, and the plan.  A fit to measured motion comes first, and the beam is the one that it
identifies.
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
from problems.study.kinds.experiment import RequestedRun
from problems.study.part import LawChoice, Part, Study
from problems.study.results import file_name

SUGGESTED_KEYS = {  # parts that a table suggests
    "beam": ("beam", "modes"), "decays": ("decays",), "match": ("match",), "simulation": ("simulation",),
    "response": ("response",), "records": ("motion",), "curves": ("motion",), "statics": ("motion",),
    "frequencies": ("motion",), "candidates": ("plan",),
}  # fmt: skip
STEP_KINDS = {"fit": "motion", "compare": "comparison"}  # kinds of parts by the names that users give to steps
STUDY_TABLES = {"study", "timing", "versions", "data"}  # other keys of results.json


def read_study(path: str | Path, kinds: Sequence[type[Part]], steps: Sequence[str] = ()) -> Study:
    """Read a study whose parts are of these kinds: all parts, or the steps that are named with what they need."""
    file = StudyFile.of(str(path), required=set())
    study = convert(file.tables.get("study", {}), Study, file.where("study"))
    study = replace(study, title=study.title or Path(path).stem, file=file, laws=_laws(file))
    known, where = {kind.kind: kind for kind in kinds}, file.where("parts")
    tables = _named_tables(file.several("parts") or _suggested(file, steps), known, where)
    chosen = [name for step in steps for name in _step(step, tables, known, str(path))] or list(tables)
    if not tables:
        raise InputError("has nothing to study; add [beam], [[decays]] or [[parts]]", str(path))
    parts: dict[str, Part] = {}
    while missing := [name for name in chosen if name not in parts]:
        for name in missing:
            part = _part(study, tables[name], known, name, where)
            parts[name] = replace(part, printed_by=study.printed_by)
            chosen += [needed for needed in part.needs if needed in tables]
    parts = {name: parts[name] for name in tables if name in parts}  # in the order of the document
    _check_needs(parts, where)
    _check_labels(parts, where)
    beam = study.model.beam if any("" in part.needs for part in parts.values()) else None
    return replace(study, parts=tuple(parts.values()), beam=beam)


def _suggested(file: StudyFile, steps: Sequence[str]) -> list[dict[str, Any]]:
    """Return the parts that the tables of a file suggest; the beam is the one that a fit identifies, if it is run."""
    kinds = [kind for name in SUGGESTED_KEYS if name in file.tables for kind in SUGGESTED_KEYS[name]]
    kinds = list(dict.fromkeys(kinds))
    if "motion" not in kinds or (steps and "motion" not in {STEP_KINDS.get(step, step) for step in steps}):
        return [{"kind": kind} for kind in kinds]
    kinds.sort(key=lambda kind: kind != "motion")
    return [{"kind": kind} | ({"beam": "motion"} if kind in SUGGESTED_KEYS["beam"] else {}) for kind in kinds]


def _laws(file: StudyFile) -> tuple[LawChoice, ...]:
    """Return the laws of the tables [[laws]]."""
    where = file.where("laws")
    found: dict[str, LawChoice] = {}
    for table in file.several("laws"):
        law = convert(table, LawChoice, where)
        if not law.name.isidentifier() or law.name in found:
            raise InputError(f"must be made of letters, digits and _, and differ, got {shown(law.name)}",
                             f"{where}: name")  # fmt: skip
        for term in law.terms:
            if not isinstance(term.get("part", ""), str):
                raise InputError(f"must be the name of a part, got {shown(term['part'])}", f"{where}: {law.name}: part")
        found[law.name] = law if law.title else replace(law, title=law.name)
    return tuple(found.values())


def _named_tables(tables: Sequence[Any], kinds: Mapping[str, type[Part]], where: str) -> dict[str, dict[str, Any]]:
    """Return the tables of parts by the names of the parts."""
    named: dict[str, dict[str, Any]] = {}
    for table in tables:
        kind = table.get("kind") if isinstance(table, dict) else None
        if not isinstance(kind, str) or kind not in kinds:
            raise InputError(f"kind must be one of {', '.join(kinds)}, got {shown(kind)}", where)
        free = next(name for k in itertools.count(1) if (name := f"{kind}_{k}" if k > 1 else kind) not in named)
        name = table.get("name", free)
        if not isinstance(name, str) or not name.isidentifier() or name in STUDY_TABLES:
            taken = ", ".join(sorted(STUDY_TABLES))
            raise InputError(
                f"must be made of letters, digits and _, and not one of {taken}, got {shown(name)}", f"{where}: name"
            )
        if name in named:
            raise InputError(f"{name!r} is taken by an earlier part; choose another one", f"{where}: name")
        named[name] = table
    return named


def _step(step: str, tables: dict[str, dict[str, Any]], kinds: Mapping[str, type[Part]], path: str) -> list[str]:
    """Return the names of the parts that are a step: those of its name or kind, or a new part of this kind."""
    kind = STEP_KINDS.get(step, step)
    names = [name for name, table in tables.items() if step == name or kind == table["kind"]]
    if not names and kind not in kinds:
        known = ", ".join(dict.fromkeys([*tables, *STEP_KINDS]))
        raise InputError(f"there is no step {shown(step)}; steps are {known}", path)
    if not names:
        tables[kind] = {"kind": kind}
    return names or [kind]


def _part(study: Study, table: dict[str, Any], kinds: Mapping[str, type[Part]], name: str, where: str) -> Part:
    kind = kinds[table["kind"]]
    place = f"{where}: {name}"
    keys = {"title": kind.heading, **_with_laws(table, study, place), "name": name}
    del keys["kind"]
    return convert(keys, kind, place).checked(study, place)


def _with_laws(given: Any, study: Study, where: str) -> dict[str, Any]:
    """Return a table, also within the list of its runs, with laws in place of their names."""
    table: dict[str, Any] = dict(convert(given, dict[str, Any], where))
    if is_sequence(table.get("laws")):
        table["laws"] = [study.law_choice(name, f"{where}: laws") for name in table["laws"]]
    if is_sequence(runs := table.get("runs", "")):
        places = [f"{where}: runs: {k}" for k in range(1, 1 + len(runs))]
        table["runs"] = [
            convert(_with_laws(run, study, place), RequestedRun, place) for run, place in zip(runs, places, strict=True)
        ]
    return table


def _check_needs(parts: Mapping[str, Part], where: str) -> None:
    """Check that the parts that others need exist, and that no part needs itself through others."""
    for name, part in parts.items():
        for needed in part.needs:
            if needed and needed not in parts:
                raise InputError(f"needs the part {needed!r}, which does not exist", f"{where}: {name}")
    try:
        TopologicalSorter({name: part.needs for name, part in parts.items()}).prepare()
    except CycleError as error:
        raise InputError(f"the parts {', '.join(sorted(set(error.args[1])))} need each other", where) from None


def _check_labels(parts: Mapping[str, Part], where: str) -> None:
    """Check that the labels of tables and figures differ, also as names of files."""
    taken: set[str] = set()
    for name, part in parts.items():
        for label in (*part.tables, *part.figures):
            if not file_name(label) or file_name(label) in taken:
                raise InputError(f"a label must have letters or digits, and differ, got {shown(label)}",
                                 f"{where}: {name}")  # fmt: skip
            taken.add(file_name(label))
