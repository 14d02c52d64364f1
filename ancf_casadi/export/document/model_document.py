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

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.identification import DataFile, Identification, Provenance
from ancf_casadi.export.document.law_data import law_data, law_from, made, model_data, model_from
from ancf_casadi.export.document.strict_json import list_at, object_at, place, read_json, text_at
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.files import write_file
from ancf_casadi.support.inputs import is_sequence, shown
from ancf_casadi.support.tables import to_json

FORMAT = "ancf-casadi"
SCHEMA = 1


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
        If a part has another type, or the law belongs to a beam with another number of elements.
    """

    model: Model
    damping: DampingLaw | None = None
    identifications: Sequence[Identification] = ()
    provenance: Provenance = field(default_factory=Provenance.of_this)

    def __post_init__(self) -> None:
        """Validate."""
        for name, kind in (("model", Model), ("damping", DampingLaw | None), ("provenance", Provenance)):
            if not isinstance(getattr(self, name), kind):
                raise InputError(f"has another type, {type(getattr(self, name)).__name__}", name)
        found = self.identifications
        if not is_sequence(found) or not all(isinstance(item, Identification) for item in found):
            raise InputError(f"must be a sequence of Identification, got {shown(found)}", "identifications")
        object.__setattr__(self, "identifications", tuple(found))
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
    found: dict[str, Any] = json.loads(files("ancf_casadi.export.document").joinpath("schema.json").read_text())
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
