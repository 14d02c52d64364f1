"""Identifications and provenance: records of the fits behind a model, and of the origin of its document."""

from __future__ import annotations

import datetime
import hashlib
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
import scipy

from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.strict_json import MOST_LEVELS, check_key, check_text, is_finite, place
from ancf_casadi.support.inputs import is_sequence, matches, shown
from ancf_casadi.version import __version__

KINDS = {"frequency_hz": "decay", "matched_hz": "frequency matching", "unknowns": "transient"}
MOST_RESULT_LEVELS = MOST_LEVELS - 4  # of a result, which is four levels deep in a document
TIME = "[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z"
HASH = "[0-9a-f]{64}"
CHUNK = 2**20  # bytes


@dataclass(frozen=True)
class DataFile:
    """Name and hash of a file of measurements.

    Parameters
    ----------
    name : str
        Name of the file, without folders.
    sha256 : str
        SHA-256 of the content, 64 hexadecimal digits.

    Raises
    ------
    InputError
        If the name is empty, or the hash does not have 64 hexadecimal digits.
    """

    name: str
    sha256: str

    def __post_init__(self) -> None:
        """Validate."""
        _check_text(self.name, "name")
        if not matches(self.sha256, HASH):
            raise InputError("must be 64 digits from 0 to 9 and a to f", "sha256")

    @classmethod
    def of(cls, path: str | Path) -> DataFile:
        """Return name and hash of a file.

        Raises
        ------
        InputError
            If the file cannot be read.
        """
        digest = hashlib.sha256()
        if os.path.exists(path) and not os.path.isfile(path):
            raise InputError("is not a file", str(path))
        try:
            with open(path, "rb") as file:
                while chunk := file.read(CHUNK):
                    digest.update(chunk)
        except OSError as error:
            raise InputError(f"cannot be read ({error.strerror or error})", str(path)) from None
        name = os.fsencode(Path(path).name).decode(errors="replace")
        return cls(name, digest.hexdigest())


@dataclass(frozen=True)
class Identification:
    """The result of a fit, kept as plain data.

    Parameters
    ----------
    kind : str
        Kind of the fit: ``decay``, ``transient``, ``frequency matching``, or another word.
    result : mapping
        Values, standard errors, intervals, covariance and warnings, as ``to_dict`` of the fit returns them.  They are
        kept as plain data, with None for numbers that are not finite.
    data : sequence of DataFile
        The files that the fit used.

    Raises
    ------
    InputError
        If the kind is empty, or JSON cannot hold the result.
    """

    kind: str
    result: Mapping[str, Any]
    data: Sequence[DataFile] = ()

    def __post_init__(self) -> None:
        """Validate, and keep plain data."""
        _check_text(self.kind, "kind")
        if not isinstance(self.result, Mapping):
            raise InputError(f"must be a mapping, got {shown(self.result)}", "result")
        if not is_sequence(self.data) or not all(isinstance(file, DataFile) for file in self.data):
            raise InputError(f"must be a sequence of DataFile, got {shown(self.data)}", "data")
        object.__setattr__(self, "result", _plain(self.result, "result"))
        object.__setattr__(self, "data", tuple(self.data))

    @classmethod
    def of(cls, result: Any, *, data: Sequence[str | Path] = ()) -> Identification:
        """Return the identification for a fit, or for the output of a command with ``--json``.

        Parameters
        ----------
        result : object with ``to_dict``, or mapping
            The fit.
        data : sequence of path
            The files that the fit used; their names and hashes are kept.

        Raises
        ------
        InputError
            If ``result`` is not the result of a fit, or a file cannot be read.
        """
        found = result.to_dict() if hasattr(result, "to_dict") else result
        kinds = [kind for key, kind in KINDS.items() if isinstance(found, Mapping) and key in found]
        if not kinds:
            raise InputError(f"is not the result of a fit, which has one of the keys {', '.join(KINDS)}", "result")
        if not is_sequence(data):
            raise InputError(f"must be a sequence of files, got {shown(data)}", "data")
        return cls(kinds[0], found, [DataFile.of(path) for path in data])

    def summary(self) -> str:
        """Return one line: the kind, the files with their hashes, and the values with standard errors."""
        files = [f"{file.name} SHA-256 {file.sha256}" for file in self.data]
        values = [f"{name} {value:.6g} +- {error:.2g}" for name, value, error in _estimates(self.result)]
        return f"{self.kind} ({', '.join([*files, *values])})" if files or values else self.kind


@dataclass(frozen=True)
class Provenance:
    """Origin of a document.

    Parameters
    ----------
    written : str
        Time of writing, UTC, such as ``2025-01-31T12:00:00Z``.
    versions : mapping
        Versions of the programs that were used, by name.
    note : str
        Any further remark.

    Raises
    ------
    InputError
        If the time has another format, or a version or the note is not a text.
    """

    written: str
    versions: Mapping[str, str]
    note: str = ""

    def __post_init__(self) -> None:
        """Validate."""
        try:
            if not re.fullmatch(TIME, self.written):
                raise ValueError
            datetime.datetime.fromisoformat(self.written)
        except (TypeError, ValueError):
            raise InputError("must be a time such as 2025-01-31T12:00:00Z", "written") from None
        if not isinstance(self.versions, Mapping):
            raise InputError(f"must be a mapping, got {shown(self.versions)}", "versions")
        for name, version in self.versions.items():
            _check_text(name, "versions")
            _check_text(version, f"versions.{name}", empty=True)
        _check_text(self.note, "note", empty=True)

    @classmethod
    def of_this(cls, *, note: str = "", written: str | None = None) -> Provenance:
        """Return the provenance with the versions in use, and the present time unless another one is given.

        Raises
        ------
        InputError
            If the time has another format.
        """
        now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        versions = {
            "ancf-casadi": __version__,
            "casadi": cs.CasadiMeta.version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        }
        return cls(now if written is None else written, versions, note)


def _check_text(value: Any, where: str, *, empty: bool = False) -> None:
    """Check that a value is a text that a document can hold."""
    if not isinstance(value, str) or not (value or empty):
        raise InputError(f"must be a text{'' if empty else ', not empty'}, got {shown(value)}", where)
    check_text(value, where)


def _plain(value: Any, where: str, level: int = 1) -> Any:
    """Return the value as JSON can hold it, with None for numbers that are not finite."""
    if level > MOST_RESULT_LEVELS:
        raise InputError(f"has more than {MOST_RESULT_LEVELS} levels", where)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, str):
        check_text(value, where)
        return value
    if isinstance(value, float):
        return value if is_finite(value) else None
    if value is None or isinstance(value, int):
        if value is not None and not is_finite(value):
            raise InputError("is beyond the range of numbers", where)
        return value
    if isinstance(value, Mapping):
        return {_key(key, where): _plain(item, place(where, key), level + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, place(where, index), level + 1) for index, item in enumerate(value)]
    raise InputError(f"must be numbers, texts, lists and objects, got a {type(value).__name__}", where)


def _key(key: Any, where: str) -> str:
    _check_text(key, where, empty=True)
    check_key(key, where)
    return str(key)


def _estimates(result: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """Return name, value and standard error of each quantity for which a result has both."""
    errors = [key for key in result if "_stderr" in key]
    listed = [(key.replace("_stderr", ""), result.get(key.replace("_stderr", "")), result[key]) for key in errors]
    unknowns = result.get("unknowns")
    for unknown in unknowns if isinstance(unknowns, list) else []:
        if isinstance(unknown, Mapping):
            listed.append((str(unknown.get("name")), unknown.get("value"), unknown.get("standard_error")))
    return [
        (name, value, error)
        for name, value, error in listed
        if isinstance(value, int | float) and isinstance(error, int | float)
    ]
