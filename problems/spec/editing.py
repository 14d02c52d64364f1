"""A study that is changed one value at a time: its TOML text keeps comments and order wherever it can.

Where a value stands in the text is found by its line.  If the text that this gives does not hold the changed tables and
nothing else, as after a value of several lines, all tables are written anew.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
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
from ancf_casadi.support.inputs import is_sequence, shown
from problems.spec.beam import DampedBeam
from problems.spec.file import StudyFile

HEADER = re.compile(r"\s*\[\[?\s*([\w-]+)\s*\]\]?\s*(?:#.*)?$")
Place = tuple[str | int, ...]  # of a value: its table, its number if there are several, from 0, and its key


@dataclass(frozen=True, eq=False)
class EditedStudy:
    """A study as tables and as text; relative names of files start at the folder of its path."""

    file: StudyFile
    text: str

    @classmethod
    def of(cls, path: str) -> EditedStudy:
        """Read a study; one table [damping] becomes the first of several."""
        study = cls(StudyFile.of(path, required=set()), read_bytes(path).decode())
        law = study.file.tables.get("damping")
        return study.with_value(("damping",), [law]) if isinstance(law, dict) else study

    def value(self, place: Place) -> Any:
        """Return a value; None if there is none."""
        return value_at(self.file.tables, place)

    def with_value(self, place: Place, value: Any) -> EditedStudy:
        """Return the study with another value; None removes it, and the number behind the last table adds a table."""
        value = None if value is None else parse_value(toml_value(value))  # of the types that TOML has
        tables = with_item(self.file.tables, place, value)
        text = _edit(self.text, place, value)
        if not _holds(text, tables):
            text = toml_text(tables)
        return EditedStudy(replace(self.file, tables=tables), text)

    def with_guess(self, name: str, factor: float) -> EditedStudy | None:
        """Return the study with the guess of an unknown of its fit times a factor; None if no key has this guess."""
        beam = DampedBeam.of(self.file)
        law = beam.damping if beam.laws else None
        terms = [(k, term, j) for k, term in enumerate(beam.laws) for j in range(len(term.parameters))]
        for parameter, (k, term, j) in zip(law.parameters if law else (), terms, strict=True):
            if parameter.name == name:
                values = [parameter.value for parameter in term.parameters]
                values[j] = rounded(values[j] * factor)
                guess, changed = (msgspec.to_builtins(law_spec(law, beam.model))
                                  for law in (term, term.with_parameters(values)))  # fmt: skip
                return self._with_known(("damping", k), {key: v for key, v in changed.items() if v != guess[key]})
        for key in (name, *changed_properties(name)):
            if isinstance(value := self.value(("beam", key)), int | float | list):
                numbers = [rounded(factor * item) for item in (value if isinstance(value, list) else [value])]
                return self.with_value(("beam", key), numbers if isinstance(value, list) else numbers[0])
        return None

    def _with_known(self, place: Place, values: Mapping[str, Any]) -> EditedStudy | None:
        """Return the study with other values of keys that a table has; None if it has not all of them."""
        study = self
        for key, value in values.items():
            if self.value((*place, key)) is None:
                return None
            study = study.with_value((*place, key), value)
        return study


def rounded(value: float) -> float:
    """Return a value that a user has chosen on a scale, in six digits."""
    return float(f"{value:.6g}")


def has_beam(path: str) -> bool:
    """Return whether a file is a study with a beam."""
    return Path(path).suffix.lower() == ".toml" and "beam" in read_toml(path)


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


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML; tables within them stand in one line."""
    blocks, lines = [], []
    for name, value in tables.items():
        if isinstance(value, dict):
            blocks.append(_block(f"[{name}]", value))
        elif value and is_sequence(value) and all(isinstance(item, dict) for item in value):
            blocks += [_block(f"[[{name}]]", item) for item in value]
        else:
            lines.append(f"{name} = {toml_value(value)}\n")
    return "\n".join([*(["".join(lines)] if lines else []), *blocks])


def toml_value(value: Any) -> str:
    """Return a value of TOML in one line; a key without a value is left out."""
    if isinstance(value, Mapping):
        entries = [f"{_key(key)} = {toml_value(item)}" for key, item in value.items() if item is not None]
        return f"{{{', '.join(entries)}}}"
    if is_sequence(value):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    short = f"{value:g}" if isinstance(value, float) else ""
    return short if {".", "e"} & {*short} and float(short) == value else str(value)


def parse_value(text: str) -> Any:
    """Return the value of TOML that a text states; None for an empty one."""
    if not text.strip():
        return None
    try:
        tables = tomllib.loads(f"value = {text}")
    except ValueError:
        tables = {}
    if list(tables) != ["value"]:
        raise InputError(f"must be a value of TOML, such as 5e-3 or [0.0, -1.0], got {shown(text)}")
    return tables["value"]


def _block(header: str, table: Mapping[str, Any]) -> str:
    return "".join([header + "\n", *(f"{_key(key)} = {toml_value(value)}\n" for key, value in table.items())])


def _key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key, ensure_ascii=False)


def _edit(text: str, place: Place, value: Any) -> str:
    """Return a text with another line for the value at a place, a line more or less, or a table more or less."""
    lines = [*text.splitlines(keepends=True)]
    name, number, key = place if len(place) == 3 else (place[0], 0, place[-1])
    headers = [k for k, line in enumerate(lines) if HEADER.match(line)] + [len(lines)]
    sections = [(a, b) for a, b in pairwise(headers) if HEADER.match(lines[a])[1] == name]  # type: ignore[index]
    if isinstance(key, int):
        begin, end = sections[key] if key < len(sections) else (len(lines), len(lines))
        block = [] if value is None else ["\n" * (key >= len(sections)), _block(f"[[{name}]]", value), "\n"]
        return "".join([*lines[:begin], *block, *lines[end:]])
    if not isinstance(number, int) or number >= len(sections):
        return text
    begin, end = sections[number]
    entry = re.compile(rf"(\s*{re.escape(key)}\s*=\s*)(.*?)(\s*(?:#.*)?)$", re.DOTALL)
    entries = [k for k in range(begin + 1, end) if re.match(r"\s*[\w-]+\s*=", lines[k])]
    k = next((k for k in entries if entry.match(lines[k])), None)
    line = "" if value is None else f"{key} = {toml_value(value)}\n"
    if k is None:
        lines.insert(entries[-1] + 1 if entries else begin + 1, line)
    else:
        lines[k] = entry.sub(lambda match: match[1] + toml_value(value) + match[3], lines[k]) if line else ""
    return "".join(lines)


def _holds(text: str, tables: Mapping[str, Any]) -> bool:
    """Return whether a text is TOML that holds tables and nothing else."""
    try:
        return tomllib.loads(text) == tables
    except ValueError:
        return False
