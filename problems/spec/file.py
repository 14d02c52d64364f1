"""A TOML file that was read: its tables, their places in messages, and the files that they name."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import opened, read_toml
from ancf_casadi.support.inputs import check_keys
from ancf_casadi.support.specs import convert, keys_of

FILE_TABLES = set(
    "beam match damping base load release simulation response markers records frequencies predictions fit study parts"
    " laws decays statics curves plan candidates".split()
)  # fmt: skip
NAMING = ("file", "document")  # keys whose value is the name of a file


def convert_groups(table: Any, where: str, *kinds: Any, shared: Set[str] = frozenset()) -> Any:
    """Return a table as one object of each kind, whose keys stand side by side; refuse other keys but shared ones."""
    check_keys(table, set(), {key for kind in kinds for key in keys_of(kind)} | shared, where)
    return tuple(convert({key: table[key] for key in keys_of(kind) & table.keys()}, kind, where) for kind in kinds)


@dataclass(frozen=True)
class StudyFile:
    """The tables of a TOML file."""

    path: str
    tables: Mapping[str, Any]
    digests: tuple[tuple[str, str], ...] = ()  # of ``only`` some tables: name and hash of each file that they name

    @classmethod
    def of(cls, given: str | StudyFile, required: Set[str] = frozenset({"beam"})) -> StudyFile:
        """Read a TOML file by its name, with the tables that must be there; a file that was read stays as it is."""
        if isinstance(given, StudyFile):
            return given
        tables = {"beam": {"document": Path(given).name}} if is_document(given) else read_toml(given)
        check_keys(tables, set(required), FILE_TABLES, given)
        return cls(given, tables)

    def where(self, name: str) -> str:
        """Return the place of a table, for messages."""
        return f"{self.path}: [{name}]"

    def needed(self, name: str, why: str = "run --keys lists its keys") -> Any:
        """Return a table that the command needs."""
        if name not in self.tables:
            raise InputError(f"the table is missing; {why}", self.where(name))
        return self.tables[name]

    def several(self, name: str) -> list[Any]:
        """Return the tables of one name, [name] or several [[name]]; none if there is no such table."""
        given = self.tables.get(name, [])
        if isinstance(given, dict):
            return [given]
        if not isinstance(given, list):
            raise InputError(f"must be a table [{name}], or several [[{name}]]", self.path)
        return given

    def beside(self, name: str) -> Path:
        """Return the path of a file that a table names, relative to the folder of this file."""
        return Path(self.path).parent / name

    def only(self, names: Set[str]) -> StudyFile:
        """Return the file with the tables of the given names alone, as far as they are there, and with their hashes."""
        tables = {name: table for name, table in self.tables.items() if name in names}
        return StudyFile(self.path, tables, tuple((name, self._digest(name)) for name in sorted(set(_named(tables)))))

    def _digest(self, name: str) -> str:
        """Return the hash of a file, or an empty one if it cannot be read, which the reader of the table reports."""
        try:
            with opened(self.beside(name)) as content:
                return hashlib.file_digest(content, "sha256").hexdigest()
        except InputError:
            return ""


NO_FILE = StudyFile("", {})


def _named(tables: Any) -> Iterator[str]:
    """Yield the names of files in tables."""
    if isinstance(tables, dict):
        for key, value in tables.items():
            if key in NAMING and isinstance(value, str):
                yield value
            else:
                yield from _named(value)
    elif isinstance(tables, list):
        for value in tables:
            yield from _named(value)


def is_document(path: str) -> bool:
    """Return whether a file is a JSON document, by its name."""
    return Path(path).suffix.lower() == ".json"
