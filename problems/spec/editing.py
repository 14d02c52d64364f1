"""A study that is changed one value at a time: its TOML text keeps its comments and the order of its lines."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec

from ancf_casadi.damping.spec import law_spec
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.lumped import changed_properties
from ancf_casadi.support.files import read_bytes, read_toml
from ancf_casadi.support.inputs import error_prefix, is_sequence, shown
from ancf_casadi.support.specs import value_place
from problems.spec.beam import DampedBeam
from problems.spec.file import StudyFile

HEADER = re.compile(r"\s*\[\[?\s*([\w-]+)\s*\]\]?\s*(?:#.*)?$")
ENTRY = re.compile(r"\s*([\w-]+)\s*=")
Place = tuple[str | int, ...]  # of a value: its table, its number if there are several, from 0, its key, and so on


@dataclass(frozen=True, eq=False)
class EditedStudy:
    """A study as tables and as text; relative names of files start at the folder of its path."""

    file: StudyFile
    text: str

    @classmethod
    def of(cls, path: str) -> EditedStudy:
        """Read a study; one table [damping] becomes the first of several."""
        file, text = StudyFile.of(path, required=set()), read_bytes(path).decode()
        if isinstance(law := file.tables.get("damping"), dict):
            text = re.sub(r"^\s*\[\s*damping\s*\]", "[[damping]]", text, flags=re.MULTILINE)
            file = replace(file, tables={**file.tables, "damping": [law]})
        return cls(file, text)

    def value(self, place: Place) -> Any:
        """Return a value; None if there is none."""
        return value_at(self.file.tables, place)

    def with_value(self, place: Place, value: Any) -> EditedStudy:
        """Return the study with another value; None removes it, and the number behind the last table adds a table."""
        with error_prefix(self.file.path):
            tables = with_item(self.file.tables, place, value)
        tables = {name: table for name, table in tables.items() if table != [] or name != place[0]}
        entry = place[: 3 if isinstance(place[1], int) else 2]  # that lines of the text hold
        removed = value is None and entry == place
        text = _with_lines(self.text, entry, None if removed else value_at(tables, entry))
        written = _parse(text)
        if _plain(written) != _plain(tables):
            where = value_place(self.file.where(str(place[0])), place[1:])
            raise InputError(
                "stands in the file where it cannot be changed; write it below the name of its table", where
            )
        return EditedStudy(replace(self.file, tables=written), text)

    def scaled(self, place: Place, factor: float) -> EditedStudy:
        """Return the study with a number, or all numbers of a list, times a factor, in six digits."""
        value = self.value(place)
        numbers = [float(f"{factor * item:.6g}") for item in (value if isinstance(value, list) else [value])]
        return self.with_value(place, numbers if isinstance(value, list) else numbers[0])


def guess_places(file: StudyFile, names: Sequence[str]) -> dict[str, Place]:
    """Return where the guesses of unknowns of a fit stand in its study, by name, as far as they do."""
    beam = DampedBeam.of(file)
    entries: list[Place] = []
    for k, law in enumerate(beam.laws):
        values = [parameter.value for parameter in law.parameters]
        spec = msgspec.to_builtins(law_spec(law, beam.model))
        for j, value in enumerate(values):
            changed = law.with_parameters([*values[:j], 0.5 * value, *values[j + 1 :]])
            entries.append(("damping", k, *_difference(spec, msgspec.to_builtins(law_spec(changed, beam.model)))))
    parameters = beam.damping.parameters if beam.damping and entries else ()
    places = [(parameter.name, entry) for parameter, entry in zip(parameters, entries, strict=True)]
    places += [(name, ("beam", key)) for name in names for key in (name, *changed_properties(name))]
    return {name: place for name, place in reversed(places) if name in names and value_at(file.tables, place)}


def has_beam(files: Sequence[str]) -> bool:
    """Return whether files are one study with a beam."""
    return len(files) == 1 and Path(files[0]).suffix.lower() == ".toml" and "beam" in read_toml(files[0])


def value_at(tables: Any, place: Place) -> Any:
    """Return the value at a place in tables; None if there is none."""
    value = tables
    for step in place:
        try:
            value = value[step]
        except (LookupError, TypeError):
            return None
    return value


def with_item(tables: Mapping[str, Any], place: Place, value: Any) -> dict[str, Any]:
    """Return tables with another value at a place; None removes it, and the number behind the last item adds one."""
    changed = deepcopy(dict(tables))
    container: Any = changed
    for step, following in pairwise(place):
        if isinstance(container, dict) and step not in container:
            container[step] = {} if isinstance(following, str) else []
        container = value_at(container, (step,))
    last: Any = place[-1]
    if not isinstance(container, dict | list):
        raise InputError("belongs to a table, and none stands there", ": ".join(map(str, place)))
    if isinstance(container, list):
        container[last : last + 1] = [] if value is None else [value]
    elif value is None:
        container.pop(last, None)
    else:
        container[last] = value
    return changed


def toml_value(value: Any) -> str:
    """Return a value of TOML in one line; a key without a value is left out."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(_entries(value))}}}"
    if is_sequence(value):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    short = f"{value:g}" if isinstance(value, float) else ""
    return short if {".", "e"} & {*short} and float(short) == value else str(value)


def parse_value(text: str) -> Any:
    """Return the value of TOML that a text states; None for an empty one."""
    tables = _parse(f"value = {text}") if text.strip() else {"value": None}
    if [*tables] != ["value"]:
        raise InputError(f"must be a value of TOML, such as 5e-3 or [0.0, -1.0], got {shown(text)}")
    return tables["value"]


def _with_lines(text: str, place: Place, value: Any) -> str:
    """Return a text with other lines for a table of several, (name, number), or an entry; None removes them."""
    lines = f"{text.rstrip()}\n".splitlines(keepends=True)
    headers = [k for k, line in enumerate(lines) if HEADER.match(line)] + [len(lines)]
    sections = [section for section in pairwise(headers) if HEADER.sub(r"\1", lines[section[0]]).strip() == place[0]]
    number, key = (place[1] if isinstance(place[1], int) else 0), place[-1]
    begin, end = sections[number] if number < len(sections) else (len(lines), len(lines))
    if isinstance(key, int):
        table = [] if value is None else [f"[[{place[0]}]]", *_entries(value), ""]
        return "".join([*lines[:begin], "\n" * (begin == len(lines)), *(f"{line}\n" for line in table), *lines[end:]])
    entries = {name: (first, last) for name, first, last in _entry_lines(lines, begin + 1, end)}
    following = max((last for _, last in entries.values()), default=begin + 1)
    first, last = entries.get(key, (following, following))
    comment = re.search(r"\s*#.*", lines[first]) if last == first + 1 else None
    line = f"{key} = {toml_value(value)}{comment[0].rstrip() if comment else ''}\n"
    return "".join([*lines[:first], "" if value is None else line, *lines[last:]])


def _entry_lines(lines: Sequence[str], begin: int, end: int) -> Iterator[tuple[str, int, int]]:
    """Yield the key of each entry of a table, its first line, and the line behind its last one."""
    k = begin
    while k < end:
        match, last = ENTRY.match(lines[k]), k + 1
        if match:
            last = next((j for j in range(k + 1, end + 1) if _parse("".join(lines[k:j]))), k + 1)
            yield match[1], k, last
        k = last


def _parse(text: str) -> dict[str, Any]:
    """Return the tables of a text; none if it is not TOML."""
    try:
        return tomllib.loads(text)
    except ValueError:
        return {}


def _plain(tables: Mapping[str, Any]) -> str:
    """Return tables as a text that is the same for the same values, even for nan, in any order."""
    return json.dumps(tables, sort_keys=True, default=str)


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in table.items() if value is not None]


def _difference(first: Any, second: Any) -> Place:
    """Return the place of the value that differs in plain data."""
    if not isinstance(first, dict | list | tuple):
        return ()
    steps = first if isinstance(first, dict) else range(len(first))
    step = next(step for step in steps if first[step] != second[step])
    return (step, *_difference(first[step], second[step]))
