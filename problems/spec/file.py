"""A TOML file that was read: its tables, their places in messages, and the files that they name."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from msgspec import Struct

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.support.files import read_bytes, read_toml
from ancf_casadi.support.inputs import check_keys
from ancf_casadi.support.specs import convert, table_keys

FILE_TABLES = set(
    "beam match damping base load release simulation response markers records frequencies predictions fit study steps"
    " laws decays statics curves plan candidates".split()
)  # fmt: skip


def convert_groups(table: Any, where: str, *kinds: Any, shared: Set[str] = frozenset()) -> Any:
    """Return a table as one object of each kind, whose keys stand side by side; refuse other keys but shared ones."""
    check_keys(table, set(), {key for kind in kinds for key in table_keys(kind)} | shared, where)
    return tuple(convert({key: table[key] for key in table_keys(kind) & table.keys()}, kind, where) for kind in kinds)


Recordings = dict[tuple[str, TableLayout], Recording]  # contents of files by path and layout


class RecordFiles(Struct, dict=True):
    """The files of measurements that a step has read.

    A copy in another process, and the key of a kept computation, hold their contents.
    """

    contents: Recordings = {}

    @cached_property
    def opened(self) -> Recordings:
        """Contents that the steps of a study share, so that each file is opened once."""
        return {}

    def recording(self, path: str, layout: TableLayout) -> Recording:
        """Return the columns of a file."""
        key = path, layout
        if key not in self.contents:
            if key not in self.opened:
                self.opened[key] = read_contents(path, layout=layout, progress=True)
            self.contents[key] = self.opened[key]
        return self.contents[key]


@dataclass(frozen=True)
class StudyFile:
    """The tables of a TOML file, and the files of measurements that they name."""

    path: str
    tables: Mapping[str, Any]
    document_hash: str = ""  # of the JSON document that ``only`` some tables name
    record_files: RecordFiles = field(default_factory=RecordFiles)

    @classmethod
    def of(cls, source: str | StudyFile, required: Set[str] = frozenset({"beam"})) -> StudyFile:
        """Read a TOML file by its name, with the tables that must be there; a file that was read stays as it is.

        The name of a JSON document stands for a file with that document as its only table.
        """
        if isinstance(source, StudyFile):
            return source
        tables = {"beam": {"document": Path(source).name}} if is_document(source) else read_toml(source)
        if "parts" in tables:
            raise InputError("the table [[parts]] is now [[steps]]", source)
        check_keys(tables, set(required), FILE_TABLES, source)
        return cls(source, tables)

    def where(self, name: str) -> str:
        """Return the place of a table, for messages."""
        return f"{self.path}: [{name}]"

    def require(self, name: str, why: str = "run --keys lists its keys") -> Any:
        """Return a table that the command needs."""
        if name not in self.tables:
            raise InputError(f"the table is missing; {why}", self.where(name))
        return self.tables[name]

    def several(self, name: str) -> list[Any]:
        """Return the tables of one name, [name] or several [[name]]; none if there is no such table."""
        tables = self.tables.get(name, [])
        if isinstance(tables, dict):
            return [tables]
        if not isinstance(tables, list):
            raise InputError(f"must be a table [{name}], or several [[{name}]]", self.path)
        return tables

    def beside(self, name: str) -> Path:
        """Return the path of a file that a table names, relative to the folder of this file."""
        return Path(self.path).parent / name

    @property
    def document(self) -> Path | None:
        """Path of the JSON document that holds the beam; None if the table [beam] does."""
        beam = self.tables.get("beam")
        name = beam.get("document") if isinstance(beam, dict) else None
        return self.beside(name) if isinstance(name, str) else None

    def only(self, names: Set[str]) -> StudyFile:
        """Return the file with the tables of the given names alone, as far as they are there, for a step."""
        tables = {name: table for name, table in self.tables.items() if name in names}
        file = replace(self, tables=tables, record_files=RecordFiles())
        file.record_files.opened = self.record_files.opened
        content = b"" if file.document is None else read_bytes(file.document)
        return replace(file, document_hash=hashlib.sha256(content).hexdigest() if content else "")


NO_FILE = StudyFile("", {})


def is_document(path: str) -> bool:
    """Return whether a file is a JSON document, by its name."""
    return Path(path).suffix.lower() == ".json"
