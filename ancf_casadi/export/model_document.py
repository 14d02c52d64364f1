"""The durable form of a beam: a JSON document with its damping law, its identifications and its provenance.

A document is data: reading it runs no code from the file.  The model that is read equals the one that was written, to
the last bit.  ``DocumentSpec`` describes its layout, with one specification for each of its objects:

    {"format": "ancf-casadi", "schema": 1,
     "beam": {...}, "strain_measures": {...},      ``mechanics.spec``: SI units, one value per element
     "damping": {...} or null,                     ``damping.spec``: the key ``law`` names the law
     "identifications": [...],                     results of fits, and the files that they were made from
     "provenance": {...}}                          time, versions of the programs, and a note

``schema`` returns the layout as a JSON Schema (draft 2020-12).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType
from typing import Any, Final, Literal

import msgspec

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.damping.spec import LawSpec, law_spec
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.identification import Identification, Provenance
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec, StrainMeasuresSpec, model_from
from ancf_casadi.support.files import check_file, read_json, write_file
from ancf_casadi.support.inputs import check_instance, error_prefix, instances, shown
from ancf_casadi.support.specs import Spec, convert
from ancf_casadi.support.tables import to_json

DOCUMENT_FORMAT: Final = "ancf-casadi"
DOCUMENT_VERSION: Final = 1  # of the layout: it changes when the meaning of a key does


class DocumentSpec(Spec, frozen=True):
    """A beam with its damping law and its identifications; SI units, and no key twice in an object."""

    format: Literal["ancf-casadi"]
    schema: Literal[1]
    beam: BeamSpec
    strain_measures: StrainMeasuresSpec
    damping: LawSpec | None
    identifications: tuple[Identification, ...]
    provenance: Provenance


@dataclass(frozen=True, eq=False)
class Document:
    """A beam with its damping law and its identifications.

    Parameters
    ----------
    model : Model
        The beam and its strain measures.
    damping : DampingLaw, optional
        The law, or the sum of several; no damping if not given.
    identifications : sequence of Identification
        Results of the fits behind the model and its damping law.
    provenance : Provenance
        Origin of the document; the present time and versions if not given.

    Raises
    ------
    InputError
        If a part has another type, or the law belongs to a beam with another number of elements.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import Document
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> document = Document(Model(beam), RayleighDamping(alpha=0.2))
    >>> list(document.to_dict())
    ['format', 'schema', 'beam', 'strain_measures', 'damping', 'identifications', 'provenance']
    """

    model: Model
    damping: DampingLaw | None = None
    identifications: Sequence[Identification] = ()
    provenance: Provenance = field(default_factory=Provenance.of_this)

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.model, "model", Model)
        check_instance(self.damping, "damping", DampingLaw, NoneType)
        check_instance(self.provenance, "provenance", Provenance)
        identifications = instances(self.identifications, "identifications", Identification, minimum=0)
        object.__setattr__(self, "identifications", identifications)
        _check_mesh(self.damping, self.model)

    def to_dict(self) -> dict[str, Any]:
        """Return the document as plain data; a damping law that it cannot hold raises an ``InputError``."""
        layout = DocumentSpec(
            format=DOCUMENT_FORMAT,
            schema=DOCUMENT_VERSION,
            beam=BeamSpec.of(self.model.beam),
            strain_measures=convert(self.model.measures, StrainMeasuresSpec),
            damping=None if self.damping is None else law_spec(self.damping, self.model),
            identifications=tuple(self.identifications),
            provenance=self.provenance,
        )
        data: dict[str, Any] = msgspec.to_builtins(layout)
        return data


def write_document(path: str | Path, document: Document) -> None:
    """Write a document.

    Raises
    ------
    InputError
        If a document cannot hold the damping law, or the file cannot be written.

    Examples
    --------
    >>> import json
    >>> from pathlib import Path
    >>> from ancf_casadi import Beam, Model
    >>> from ancf_casadi.export import Document, write_document
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> write_document("beam.json", Document(Model(beam)))
    >>> json.loads(Path("beam.json").read_text())["beam"]["length"]
    0.5
    """
    check_instance(document, "document", Document)
    write_file(check_file(path), to_json(document.to_dict()))


def read_document(path: str | Path) -> Document:
    """Read a document.

    Raises
    ------
    InputError
        If the file cannot be read or is no document; the message names the file and the place in it.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import Document, read_document, write_document
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> write_document("beam.json", Document(Model(beam), RayleighDamping(alpha=0.2)))
    >>> document = read_document("beam.json")
    >>> document.model.beam == beam, document.damping
    (True, RayleighDamping(alpha=0.2))
    """
    data = read_json(path)
    with error_prefix(str(path)):
        layout = _parse(data)
        model = model_from(layout.beam, layout.strain_measures, "$")
        law = None if layout.damping is None else layout.damping.law(model, "$.damping")
        return Document(model, law, layout.identifications, layout.provenance)


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


def _parse(data: dict[str, Any]) -> DocumentSpec:
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


def _check_mesh(law: DampingLaw | None, model: Model) -> None:
    """Refuse a law with modes of another mesh."""
    for term in law.laws if isinstance(law, SumOfLaws) else ():
        _check_mesh(term, model)
    if isinstance(law, ModalDamping):
        law.check_nodes(model, "damping: modes")
