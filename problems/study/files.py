"""The files that the tables of a study name, and their hashes: a result is kept as long as they stay the same."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

from problems.tables.study import Study as StudyFile

NAMING = ("file", "document")  # keys whose value is the name of a file


def digests_of(file: StudyFile, tables: Any) -> tuple[tuple[str, str], ...]:
    """Return name and hash of each file that tables name, in the order of the names.

    Parameters
    ----------
    file : StudyFile
        The study file, to whose folder the names are relative.
    tables : dict or list
        The tables.
    """
    names = sorted(set(_named(tables)))
    return tuple((name, _digest(file, name)) for name in names)


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
        with open(file.file(name, file.path), "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError:
        return ""
