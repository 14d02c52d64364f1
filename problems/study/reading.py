"""Reading a study from a TOML file: the table [study], the laws, and the parts in the order of the document.

A file without [[parts]] has the parts that its other tables suggest: the beam and its modes, the decays, the match, the
simulation, the steady vibration, and the fit to measured motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys, flag, located, shown, whole
from problems.schema.file import StudyFile
from problems.study.document.labels import file_name
from problems.study.kinds.registry import KINDS
from problems.study.part import Heading, Part, Study
from problems.study.source import Source, read_laws, text_of, texts_of

USUAL = {  # parts that a table suggests
    "beam": ("beam", "modes"), "decays": ("decays",), "match": ("match",), "simulation": ("simulation",),
    "response": ("response",), "records": ("motion",),
}  # fmt: skip
STUDY = {"title", "text", "source", "printed_by", "seed"}
HEADING = {"name", "title", "text", "tables", "figures", "notes", "section", "draw", "quick"}
RESERVED = {"study", "timing", "versions", "data"}  # other keys of results.json


def read_study(path: str | Path) -> Study:
    """Read a study.

    Raises
    ------
    InputError
        If the file cannot be read, or a table, key or value cannot be used.
    """
    file = StudyFile.of(str(path), required=set())
    about, where = file.tables.get("study", {}), file.where("study")
    check_keys(about, set(), STUDY, where)
    with located(where):
        title, text, origin, printed_by = (
            text_of(about, key, default)
            for key, default in (("title", Path(path).stem), ("text", ""), ("source", ""), ("printed_by", "printed"))
        )
        seed = whole(about.get("seed", 0), "seed", 0)
    tables = file.several("parts") or [{"kind": kind} for name in USUAL if name in file.tables for kind in USUAL[name]]
    if not tables:
        raise InputError("has nothing to study; add [beam], [[decays]] or [[parts]]", str(path))
    source = Source(file, read_laws(file), seed)
    parts: dict[str, Part] = {}
    for table in tables:
        part = _part(source, table, printed_by, parts)
        parts[part.heading.name] = part
    _check_needs(parts, file.where("parts"))
    _check_labels(parts, file.where("parts"))
    return Study(title, tuple(parts.values()), text, origin, seed)


def _part(source: Source, table: Any, printed_by: str, before: Mapping[str, Part]) -> Part:
    place = source.file.where("parts")
    kind = table.get("kind") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"kind must be one of {', '.join(KINDS)}, got {shown(kind)}", place)
    heading = _heading(table, kind, printed_by, before, place)
    where = f"{place}: {heading.name}"
    given = {key: value for key, value in table.items() if key not in {"kind", *HEADING}}
    return KINDS[kind].read(source, given, heading, where)


def _check_needs(parts: Mapping[str, Part], where: str) -> None:
    """Check that the parts that others need exist, and that no part needs itself through others."""
    for name, part in parts.items():
        for needed in part.needs:
            if needed not in parts:
                raise InputError(f"needs the part {needed!r}, which does not exist", f"{where}: {name}")
    left = dict(parts)
    while ready := [name for name, part in left.items() if not any(needed in left for needed in part.needs)]:
        left = {name: part for name, part in left.items() if name not in ready}
    if left:
        raise InputError(f"the parts {', '.join(left)} need each other", where)


def _check_labels(parts: Mapping[str, Part], where: str) -> None:
    """Check that the labels of tables and figures differ, also as names of files."""
    taken: set[str] = set()
    for name, part in parts.items():
        for label in (*part.heading.tables, *part.heading.figures):
            if not file_name(label) or file_name(label) in taken:
                raise InputError(f"a label must have letters or digits, and differ, got {shown(label)}",
                                 f"{where}: {name}")  # fmt: skip
            taken.add(file_name(label))


def _heading(table: dict[str, Any], kind: str, printed_by: str, before: Mapping[str, Part], where: str) -> Heading:
    with located(where):
        name = text_of(table, "name", _free_name(kind, before))
        if not name.isidentifier() or name in RESERVED:
            taken = ", ".join(sorted(RESERVED))
            raise InputError(
                f"must be made of letters, digits and _, and not one of {taken}, got {shown(name)}", "name"
            )
        if name in before:
            raise InputError(f"{name!r} is taken by an earlier part; choose another one", "name")
        return Heading(
            name=name,
            title=text_of(table, "title", KINDS[kind].title),
            text=text_of(table, "text", ""),
            tables=texts_of(table, "tables"),
            figures=texts_of(table, "figures"),
            notes=texts_of(table, "notes"),
            source=printed_by,
            section=text_of(table, "section", ""),
            draw=flag(table.get("draw", True), "draw"),
            quick=flag(table.get("quick", True), "quick"),
        )


def _free_name(kind: str, before: Mapping[str, Part]) -> str:
    name, number = kind, 1
    while name in before:
        number += 1
        name = f"{kind}_{number}"
    return name
