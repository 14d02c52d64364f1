"""The durable form of a beam: a JSON document with its damping law, its identification and its provenance.

    {"format": "ancf-casadi", "schema": 1,
     "beam": {...}, "strain_measures": {...},      SI units, one value an element where it has several
     "damping": {...} or null,                     see ``law_data``
     "identifications": [...],                     what fits said, with the files they were made from
     "provenance": {...}}                          who wrote it, when, with which versions

It is data and nothing else: reading it runs no code of others, and gives the same model to the last bit.  What is
written follows the JSON Schema that ``schema`` returns, and what that refuses, ``read_document`` refuses too.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
import scipy

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.law_data import law_data, law_from, made, model_data, model_from
from ancf_casadi.export.strict_json import MOST_LEVELS, list_at, object_at, place, read_json, text_at, whole_text
from ancf_casadi.model import Model
from ancf_casadi.report import to_json, write_file
from ancf_casadi.version import __version__

FORMAT = "ancf-casadi"
SCHEMA = 1
KINDS = {"frequency_hz": "decay", "matched_hz": "frequency matching", "unknowns": "transient"}
MOST_RESULT_LEVELS = MOST_LEVELS - 4
TIME = "[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z"
HASH = "[0-9a-f]{64}"
CHUNK = 2**20  # bytes


@dataclass(frozen=True)
class DataFile:
    """A file of measurements that something was identified from.

    Parameters
    ----------
    name : str
        Its name, without folders.
    sha256 : str
        SHA-256 of its content, 64 hexadecimal digits.

    Raises
    ------
    InputError
        If the name is empty, or the hash is none.
    """

    name: str
    sha256: str

    def __post_init__(self) -> None:
        """Validate."""
        if not self.name:
            raise InputError("must not be empty", "name")
        if not re.fullmatch(HASH, self.sha256):
            raise InputError("must be 64 digits from 0 to 9 and a to f", "sha256")

    @classmethod
    def of(cls, path: str | Path) -> DataFile:
        """Return name and hash of a file.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        digest = hashlib.sha256()
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
    """What a fit said, kept as data.

    Parameters
    ----------
    kind : str
        What was identified: ``decay``, ``transient``, ``frequency matching``, or another word.
    result : mapping
        Values, standard errors, intervals, covariance and warnings as the fit's ``to_dict`` gives them; kept as plain
        data, with None for what is not finite.
    data : sequence of DataFile
        The files it was made from.

    Raises
    ------
    InputError
        If the kind is empty, or the result holds what is no data.
    """

    kind: str
    result: Mapping[str, Any]
    data: Sequence[DataFile] = ()

    def __post_init__(self) -> None:
        """Validate, and keep plain data."""
        if not self.kind:
            raise InputError("must not be empty", "kind")
        object.__setattr__(self, "result", _plain(self.result, "result"))
        object.__setattr__(self, "data", tuple(self.data))

    @classmethod
    def of(cls, result: Any, *, data: Sequence[str | Path] = ()) -> Identification:
        """Return what a fit says of itself, or what a command printed of it with ``--json``.

        Parameters
        ----------
        result : object with ``to_dict``, or mapping
            The fit.
        data : sequence of path
            The files it was made from, whose hashes are kept.

        Raises
        ------
        InputError
            If it is no result of a fit, or a file cannot be read.
        """
        found = result.to_dict() if hasattr(result, "to_dict") else result
        kinds = [kind for key, kind in KINDS.items() if isinstance(found, Mapping) and key in found]
        if not kinds:
            raise InputError(f"is no result of an identification, which has one of {', '.join(KINDS)}", "result")
        return cls(kinds[0], found, [DataFile.of(path) for path in data])

    def summary(self) -> str:
        """Return kind, files with their hashes, and values with standard errors, in a line."""
        files = [f"{file.name} SHA-256 {file.sha256}" for file in self.data]
        values = [f"{name} {value:.6g} +- {error:.2g}" for name, value, error in _estimates(self.result)]
        return f"{self.kind} ({', '.join([*files, *values])})"


@dataclass(frozen=True)
class Provenance:
    """Where a document comes from.

    Parameters
    ----------
    written : str
        When it was written, UTC, such as ``2025-01-31T12:00:00Z``.
    versions : mapping
        Version of each program that had a part in it.
    note : str
        Anything else.

    Raises
    ------
    InputError
        If the time is none.
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
        except ValueError:
            raise InputError("must be a time such as 2025-01-31T12:00:00Z", "written") from None

    @classmethod
    def of_this(cls, *, note: str = "", written: str | None = None) -> Provenance:
        """Return the versions at work here, and a time; the present one if none is given.

        Raises
        ------
        InputError
            If the time is none.
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


@dataclass(frozen=True, eq=False)
class Document:
    """A beam with its damping law, and how both were found.

    Parameters
    ----------
    model : Model
        The beam and its strain measures.
    damping : DampingLaw, optional
        The law, or the sum of several.
    identifications : sequence of Identification
        The fits they come from.
    provenance : Provenance
        Where the document comes from; from here and now if not given.

    Raises
    ------
    InputError
        If the law belongs to a beam with another number of elements.
    """

    model: Model
    damping: DampingLaw | None = None
    identifications: Sequence[Identification] = ()
    provenance: Provenance = field(default_factory=Provenance.of_this)

    def __post_init__(self) -> None:
        """Validate."""
        object.__setattr__(self, "identifications", tuple(self.identifications))
        _check_mesh(self.damping, self.model)

    def to_dict(self) -> dict[str, Any]:
        """Return the document as plain data.

        Raises
        ------
        InputError
            If the damping law is none of those of the toolkit.
        """
        return {
            "format": FORMAT,
            "schema": SCHEMA,
            **model_data(self.model),
            "damping": None if self.damping is None else law_data(self.damping, self.model),
            "identifications": [
                {
                    "kind": found.kind,
                    "result": found.result,
                    "data": [{"name": file.name, "sha256": file.sha256} for file in found.data],
                }
                for found in self.identifications
            ],
            "provenance": {
                "written": self.provenance.written,
                "versions": dict(self.provenance.versions),
                "note": self.provenance.note,
            },
        }


def write_document(path: str | Path, document: Document) -> None:
    """Write a document.

    Raises
    ------
    InputError
        If its damping law has no form as data, or the file cannot be written.
    """
    write_file(Path(path), to_json(document.to_dict()))


def read_document(path: str | Path) -> Document:
    """Read a document that ``write_document`` has written, or anyone else.

    Raises
    ------
    InputError
        If the file cannot be read, or anything in it is not what the schema demands; the message says where.
    """
    data = read_json(path)
    try:
        return _document(data)
    except InputError as error:
        raise InputError(str(error), str(path)) from None


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document."""
    found: dict[str, Any] = json.loads(files("ancf_casadi.export").joinpath("schema.json").read_text())
    return found


def _check_mesh(law: DampingLaw | None, model: Model) -> None:
    """Refuse a law with modes of another mesh."""
    for term in law.laws if isinstance(law, SumOfLaws) else ():
        _check_mesh(term, model)
    if isinstance(law, ModalDamping) and law.modes.model.size != model.size:
        raise InputError("belong to a beam with another number of elements", "damping: modes")


def _document(data: dict[str, Any]) -> Document:
    if data.get("format") != FORMAT:
        raise InputError(f"must be {FORMAT!r}: the file is no document of this toolkit", "format")
    if type(data.get("schema")) is not int or data["schema"] != SCHEMA:
        raise InputError(f"must be {SCHEMA}, the version that this release reads; a newer one may read it", "schema")
    keys = {"beam", "strain_measures", "damping", "identifications", "provenance"}
    object_at(data, "", {"format", "schema", *keys})
    model = model_from(data, "")
    law = None if data["damping"] is None else law_from(data["damping"], model, "damping")
    listed = enumerate(list_at(data["identifications"], "identifications"))
    found = [_identification(item, place("identifications", index)) for index, item in listed]
    return Document(model, law, found, _provenance(data["provenance"]))


def _identification(data: Any, where: str) -> Identification:
    object_at(data, where, {"kind", "result", "data"})
    kind, result = text_at(data["kind"], place(where, "kind")), object_at(data["result"], place(where, "result"))
    at = place(where, "data")
    found = [_data_file(item, place(at, index)) for index, item in enumerate(list_at(data["data"], at))]
    return made(lambda: Identification(kind, result, found), where)


def _data_file(data: Any, where: str) -> DataFile:
    object_at(data, where, {"name", "sha256"})
    return made(lambda: DataFile(*(text_at(data[key], key) for key in ("name", "sha256"))), where)


def _provenance(data: Any) -> Provenance:
    where = "provenance"
    object_at(data, where, {"written", "versions", "note"})
    versions = object_at(data["versions"], place(where, "versions"))
    for name, version in versions.items():
        text_at(version, place(place(where, "versions"), name))
    written, note = (text_at(data[key], place(where, key)) for key in ("written", "note"))
    return made(lambda: Provenance(written, versions, note), where)


def _plain(value: Any, where: str, level: int = 1) -> Any:
    """Return what a fit says as JSON can hold it, with None for what is not finite."""
    if level > MOST_RESULT_LEVELS:
        raise InputError(f"has more than {MOST_RESULT_LEVELS} levels", where)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, str):
        return whole_text(value, where)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {whole_text(key, where): _plain(item, place(where, key), level + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, place(where, index), level + 1) for index, item in enumerate(value)]
    raise InputError(f"must be numbers, texts, lists and objects, got a {type(value).__name__}", where)


def _estimates(result: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """Return name, value and standard error of what a result has with both."""
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
