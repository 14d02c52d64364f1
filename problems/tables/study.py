"""A TOML file with its tables, and the checks that all tables share."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import read_toml
from ancf_casadi.support.inputs import check_keys, shown

TABLES = {
    "beam",
    "match",
    "damping",
    "base",
    "load",
    "release",
    "simulation",
    "response",
    "markers",
    "records",
    "predictions",
    "fit",
    "study",
    "parts",
    "laws",
    "decays",
}


@dataclass(frozen=True)
class Study:
    """The tables of a TOML file.

    Parameters
    ----------
    path : str
        Name of the file.
    tables : mapping
        Content of the file.
    """

    path: str
    tables: Mapping[str, Any]

    @classmethod
    def read(cls, path: str, required: Set[str] = frozenset({"beam"})) -> Study:
        """Read a TOML file with the table [beam] and others.

        Parameters
        ----------
        path : str
            Name of the file.
        required : set of str
            Names of tables that must be there.

        Raises
        ------
        InputError
            If the file cannot be read, is a JSON document, or lacks a table or has an unknown one.
        """
        if is_document(path):
            raise InputError(
                f'a document holds only beam and damping; write a TOML file with [beam] document = "{Path(path).name}"',
                path,
            )
        tables = read_toml(path)
        check_keys(tables, set(required), TABLES, path)
        return cls(path, tables)

    def where(self, name: str) -> str:
        """Return the place of a table, for messages."""
        return f"{self.path}: [{name}]"

    def table(self, name: str, required: set[str], optional: set[str]) -> dict[str, Any]:
        """Return a table that the command needs.

        Raises
        ------
        InputError
            If it is missing, is no table, or its keys are not those.
        """
        if name not in self.tables:
            raise InputError("the table is missing; --help lists its keys", self.where(name))
        return checked(self.tables[name], required, optional, self.where(name))

    def several(self, name: str) -> list[Any]:
        """Return the tables of one name, [name] or several [[name]]; none if there is no such table.

        Raises
        ------
        InputError
            If the value is neither a table nor a list.
        """
        given = self.tables.get(name, [])
        if isinstance(given, dict):
            return [given]
        if not isinstance(given, list):
            raise InputError(f"must be a table [{name}], or several [[{name}]]", self.path)
        return given

    def file(self, name: Any, where: str) -> Path:
        """Return the path of a file that a table names, relative to the folder of this file.

        Raises
        ------
        InputError
            If the name is not a text.
        """
        if not isinstance(name, str):
            raise InputError(f"must be the name of a file, got {shown(name)}", where)
        return Path(self.path).parent / name


def is_document(path: str) -> bool:
    """Return whether a file is a JSON document, by its name."""
    return Path(path).suffix.lower() == ".json"


def checked(table: Any, required: set[str], optional: set[str], where: str) -> dict[str, Any]:
    """Return a table whose keys are known and complete.

    Raises
    ------
    InputError
        If it is no table, or its keys are not those.
    """
    check_keys(table, required, optional, where)
    found: dict[str, Any] = table
    return found
