"""The files that the tables of a study name, and their hashes: a result is kept as long as they stay the same."""

from __future__ import annotations

import hashlib
from abc import ABC
from collections.abc import Iterator, Set
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import opened
from problems.schema.file import StudyFile
from problems.schema.table import HIDDEN
from problems.study.part import Part
from problems.study.source import Source

NAMING = ("file", "document")  # keys whose value is the name of a file


@dataclass(frozen=True)
class TablesOfFile:
    """The tables of a study file that a computation reads.

    Parameters
    ----------
    path : str
        Name of the file.
    tables : dict
        The tables.
    digests : tuple of (str, str)
        Name and hash of each file that the tables name, so that a result is not kept when a file changes.
    """

    path: str
    tables: dict[str, Any]
    digests: tuple[tuple[str, str], ...]

    @staticmethod
    def of(source: Source, names: Set[str]) -> TablesOfFile:
        """Return the tables with the given names, as far as they are there."""
        tables = {name: table for name, table in source.file.tables.items() if name in names}
        files = sorted(set(_named(tables)))
        return TablesOfFile(source.file.path, tables, tuple((name, _digest(source.file, name)) for name in files))

    def file(self) -> StudyFile:
        """Return the study file with these tables alone."""
        return StudyFile(self.path, self.tables)


@dataclass(frozen=True, kw_only=True)
class FilePart(Part, ABC):
    """Base class of the parts that read tables of the file as another command does."""

    wanted: ClassVar[Set[str]]  # names of the tables

    given: Annotated[TablesOfFile, HIDDEN] = TablesOfFile("", {}, ())

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with the tables that it reads."""
        self.check(source.file, where)
        return replace(self, given=TablesOfFile.of(source, self.wanted))

    def check(self, file: StudyFile, where: str) -> None:
        """Check the tables of a file.

        Raises
        ------
        InputError
            If a table is missing, a key or value cannot be used, or a file cannot be read.
        """


def _named(tables: Any) -> Iterator[str]:
    if isinstance(tables, dict):
        for key, value in tables.items():
            if key in NAMING and isinstance(value, str):
                yield value
            else:
                yield from _named(value)
    elif isinstance(tables, list):
        for value in tables:
            yield from _named(value)


def _digest(file: StudyFile, name: str) -> str:
    """Return the hash of a file, or an empty one if it cannot be read, which the reader of the table reports."""
    try:
        with opened(file.beside(name, file.path)) as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except InputError:
        return ""
