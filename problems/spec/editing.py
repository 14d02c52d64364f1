"""A study that is changed one value at a time: its TOML text keeps its comments and the order of its lines."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import tomlkit
from tomlkit.items import AbstractTable, AoT, Item, Table

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import read_bytes
from ancf_casadi.support.inputs import is_sequence, shown
from ancf_casadi.support.specs import value_place
from problems.spec.file import StudyFile

Place = tuple[str | int, ...]  # of a value: its table, its number if there are several, from 0, its key, and so on


@dataclass(frozen=True, eq=False)
class EditedStudy:
    """A study as tables and as text; relative names of files start at the folder of its path."""

    file: StudyFile
    text: str

    @classmethod
    def of(cls, path: str) -> EditedStudy:
        """Read a study; one table [damping] becomes the first of several."""
        study = cls(StudyFile.of(path, required=set()), read_bytes(path).decode("utf-8-sig"))
        if not isinstance(study.value(("damping",)), dict):
            return study
        document: Any = tomlkit.parse(study.text)
        law, laws = document["damping"], tomlkit.aot()
        laws.append(law if isinstance(law, Table) else law.unwrap())
        document["damping"] = laws
        return study.with_text(document.as_string())

    def value(self, place: Place) -> Any:
        """Return a value; None if there is none."""
        return value_at(self.file.tables, place)

    def with_value(self, place: Place, value: Any) -> EditedStudy:
        """Return the study with another value; None removes it, and the number behind the last item adds one."""
        *way, last = place
        document: Any = tomlkit.parse(self.text)
        document.setdefault(place[0], tomlkit.aot() if isinstance(place[1], int) else tomlkit.table())
        kind: Any = list if isinstance(last, int) else dict
        if not isinstance(container := value_at(document, tuple(way)), kind):
            where = value_place(self.file.where(str(place[0])), place[1:])
            raise InputError("belongs to a table, and none stands there", where)
        if value is not None:
            _set_item(container, last, value)
        elif isinstance(last, int) and len(container) == 1 and len(way) > 1:
            return self.with_value(tuple(way), [])  # without tables [[beam.supports]], the default holds
        elif value_at(container, (last,)) is not None:
            del container[last]
        if document[place[0]] == []:
            del document[place[0]]
        return self.with_text(document.as_string())

    def scaled(self, place: Place, factor: float) -> EditedStudy:
        """Return the study with a number, or all numbers of a list, times a factor, in six digits."""
        value = self.value(place)
        numbers = [float(f"{factor * item:.6g}") for item in (value if isinstance(value, list) else [value])]
        return self.with_value(place, numbers if isinstance(value, list) else numbers[0])

    def with_text(self, text: str) -> EditedStudy:
        """Return the study of another text."""
        try:
            return EditedStudy(replace(self.file, tables=tomllib.loads(text)), text)
        except ValueError as error:
            raise InputError(f"is not TOML ({error})", self.file.path) from None


def value_at(tables: Any, place: Place) -> Any:
    """Return the value at a place in tables; None if there is none."""
    value = tables
    for step in place:
        try:
            value = value[step]
        except (LookupError, TypeError):
            return None
    return value


def toml_value(value: Any) -> str:
    """Return a value of TOML in one line; a key without a value is left out."""
    return _item(value).as_string()


def parse_value(text: str) -> Any:
    """Return the value of TOML that a text states; None for an empty one."""
    try:
        return tomlkit.value(text.strip()).unwrap() if text.strip() else None
    except ValueError:
        raise InputError(f"must be a value of TOML, such as 5e-3 or [0.0, -1.0], got {shown(text)}") from None


def _item(value: Any) -> Item:
    """Return a value as it stands in one line of TOML, a number in its shortest form."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        for key, entry in value.items():
            if entry is not None:
                table.append(key, _item(entry))
        return table
    if is_sequence(value):
        array = tomlkit.array()
        array.extend(map(_item, value))
        return array
    short = f"{value:g}" if isinstance(value, float) else ""
    return tomlkit.value(short) if {".", "e"} & {*short} and float(short) == value else tomlkit.item(value)


def _set_item(container: Any, key: str | int, value: Any) -> None:
    """Set a value of a table, or of a list; new keys of a table stand before the comments at its end."""
    if isinstance(container, AoT):
        if key == len(container):
            container.append(tomlkit.table().add(tomlkit.nl()))
        table = container[int(key)]
        for name in [*table]:
            del table[name]
        for name, entry in value.items():
            _set_item(table, name, entry)
    elif isinstance(container, list) and key == len(container):
        container.append(_item(value))
    elif isinstance(container, AbstractTable) and key not in container:
        body, comments = container.value.body, []
        while body and body[-1][0] is None:
            comments.append(body.pop())
        container.append(str(key), _item(value))
        body.extend(reversed(comments))
    else:
        container[key] = _item(value)
