"""The durable form of a beam: a JSON document with its damping law, its identifications and its provenance.

A document is data: reading it runs no code from the file.  The model that is read equals the one that was written, to
the last bit.  ``structs`` describes its layout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType
from typing import Any

import msgspec

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.damping.spec import law_spec
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.identification import Identification, Provenance
from ancf_casadi.export.structs import (
    DOCUMENT_FORMAT,
    DOCUMENT_VERSION,
    DocumentSpec,
    IdentificationSpec,
    ProvenanceSpec,
    parse_document,
)
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec, StrainMeasuresSpec, model_from
from ancf_casadi.support.files import check_file, place, read_json, write_file
from ancf_casadi.support.inputs import check_instance, error_prefix, instances
from ancf_casadi.support.specs import convert
from ancf_casadi.support.tables import to_json


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
            identifications=convert(self.identifications, tuple[IdentificationSpec, ...]),
            provenance=convert(self.provenance, ProvenanceSpec),
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
        layout = parse_document(data)
        model = model_from(layout.beam, layout.strain_measures, "$")
        law = None if layout.damping is None else layout.damping.law(model, "$.damping")
        identifications = []
        for k, item in enumerate(layout.identifications):
            with error_prefix(place("$.identifications", k)):
                identifications.append(Identification(item.result, item.data))
        with error_prefix("$.provenance"):
            provenance = Provenance(**layout.provenance.set_fields())
        return Document(model, law, identifications, provenance)


def _check_mesh(law: DampingLaw | None, model: Model) -> None:
    """Refuse a law with modes of another mesh."""
    for term in law.laws if isinstance(law, SumOfLaws) else ():
        _check_mesh(term, model)
    if isinstance(law, ModalDamping) and law.modes.model.size != model.size:
        raise InputError("belong to a beam with another number of elements", "damping: modes")
