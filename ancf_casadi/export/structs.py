"""Layout of the JSON document: one specification for each of its objects.

    {"format": "ancf-casadi", "schema": 1,
     "beam": {...}, "strain_measures": {...},      ``mechanics.spec``: SI units, one value per element
     "damping": {...} or null,                     ``damping.spec``: the key ``law`` names the law
     "identifications": [...],                     results of fits, and the files that they were made from
     "provenance": {...}}                          time, versions of the programs, and a note

``schema`` returns the layout as a JSON Schema (draft 2020-12).
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta, Struct

from ancf_casadi.damping.spec import LawSpec
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.spec import BeamSpec, StrainMeasuresSpec
from ancf_casadi.support.files import check, open_file
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.specs import Spec, convert

DOCUMENT_FORMAT: Final = "ancf-casadi"
DOCUMENT_VERSION: Final = 1  # of the layout: it changes when the meaning of a key does

NotEmpty = Annotated[str, Meta(min_length=1)]
Hash = Annotated[str, Meta(pattern="^[0-9a-f]{64}$", max_length=64)]  # $ also matches before a last line feed
Time = Annotated[
    str, Meta(pattern="^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z$", max_length=20, description="UTC")
]


class DataFile(Struct, frozen=True, forbid_unknown_fields=True):
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

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi.export import DataFile
    >>> _ = Path("decay.csv").write_text("0.0,1.0")
    >>> file = DataFile.of("decay.csv")
    >>> file.name, file.sha256[:8]
    ('decay.csv', 'f6478e63')
    """

    name: NotEmpty
    sha256: Hash

    def __post_init__(self) -> None:
        """Validate."""
        for key, kind in (("name", NotEmpty), ("sha256", Hash)):
            check(convert(getattr(self, key), kind, key), key)

    @classmethod
    def of(cls, path: str | Path) -> DataFile:
        """Return name and hash of a file; one that cannot be read raises an ``InputError``."""
        digest = hashlib.sha256()
        with open_file(path) as file:
            while chunk := file.read(2**20):  # bytes
                digest.update(chunk)
        name = os.fsencode(Path(path).name).decode(errors="replace")
        return cls(name, digest.hexdigest())


class IdentificationSpec(Spec, frozen=True):
    """The result of a fit: kind, estimates, intervals, covariance, warnings; null is unknown or not finite."""

    result: dict[str, Any]
    data: tuple[DataFile, ...]


class ProvenanceSpec(Spec, frozen=True):
    """Time of writing (UTC), versions of the programs, and a note."""

    written: Time
    versions: dict[str, str]
    note: str


class DocumentSpec(Spec, frozen=True):
    """A beam with its damping law and its identifications; SI units, and no key twice in an object."""

    format: Literal["ancf-casadi"]
    schema: Literal[1]
    beam: BeamSpec
    strain_measures: StrainMeasuresSpec
    damping: LawSpec | None
    identifications: tuple[IdentificationSpec, ...]
    provenance: ProvenanceSpec


def parse_document(data: dict[str, Any]) -> DocumentSpec:
    """Return plain data as a document; an error names the key, such as ``$.damping.laws[0].alpha``."""
    if data.get("format") != DOCUMENT_FORMAT:
        raise InputError(f"must be {DOCUMENT_FORMAT!r}: the file is not a document of this toolkit", "$.format")
    version = data.get("schema")
    if type(version) is not int or version != DOCUMENT_VERSION:
        message = (
            f"must be {DOCUMENT_VERSION}, got {shown(version)}; a document of a later version needs a later release"
        )
        raise InputError(message, "$.schema")
    return convert(data, DocumentSpec, "$")


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document.

    Examples
    --------
    >>> from ancf_casadi.export import schema
    >>> schema()["$schema"]
    'https://json-schema.org/draft/2020-12/schema'
    """
    identifiers = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{DOCUMENT_FORMAT}:document:{DOCUMENT_VERSION}",
    }
    layout = msgspec.json.schema(DocumentSpec)
    for definition in layout["$defs"].values():
        definition["description"] = definition["description"].partition("\n")[0]
    return identifiers | layout
