"""The durable form of a beam: a JSON document with its damping law, its identifications and its provenance.

A document is data: reading it runs no code from the file.  The model that is read equals the one that was written, to
the last bit.  ``structs`` describes its layout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import NoneType
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET
from msgspec.structs import asdict

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.identification import Identification, Provenance
from ancf_casadi.export.structs import (
    COEFFICIENT_LAWS,
    DOCUMENT_FORMAT,
    DOCUMENT_VERSION,
    BeamData,
    DocumentData,
    EquilibriumData,
    IdentificationData,
    LawData,
    ModalData,
    ModesData,
    ProvenanceData,
    StrainMeasuresData,
    SumData,
    data_of,
    read,
)
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import PART_KINDS, table_of, with_parts
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, place, read_json, write_file
from ancf_casadi.support.inputs import check_instance, instances, located
from ancf_casadi.support.tables import to_json
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes


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
        found = instances(self.identifications, "identifications", Identification, least=0)
        object.__setattr__(self, "identifications", found)
        _check_mesh(self.damping, self.model)

    def to_dict(self) -> dict[str, Any]:
        """Return the document as plain data; a damping law that it cannot hold raises an ``InputError``."""
        data = DocumentData(
            format=DOCUMENT_FORMAT,
            schema=DOCUMENT_VERSION,
            beam=beam_data(self.model.beam),
            strain_measures=data_of(self.model.measures, StrainMeasuresData),
            damping=None if self.damping is None else law_data(self.damping, self.model),
            identifications=tuple(data_of(found, IdentificationData) for found in self.identifications),
            provenance=data_of(self.provenance, ProvenanceData),
        )
        found: dict[str, Any] = msgspec.to_builtins(data)
        return found


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
    with located(str(path)):
        found = read(data)
        model = model_from(found.beam, found.strain_measures, "$")
        law = None if found.damping is None else law_from(found.damping, model, "$.damping")
        identifications = []
        for k, item in enumerate(found.identifications):
            with located(place("$.identifications", k)):
                identifications.append(Identification(item.result, item.data))
        with located("$.provenance"):
            provenance = Provenance(**asdict(found.provenance))
        return Document(model, law, identifications, provenance)


def _check_mesh(law: DampingLaw | None, model: Model) -> None:
    """Refuse a law with modes of another mesh."""
    for term in law.laws if isinstance(law, SumOfLaws) else ():
        _check_mesh(term, model)
    if isinstance(law, ModalDamping) and law.modes.model.size != model.size:
        raise InputError("belong to a beam with another number of elements", "damping: modes")


def beam_data(beam: Beam) -> BeamData:
    """Return the fields of a beam."""
    given: dict[str, Any] = {one.name: getattr(beam, one.name) for one in fields(beam)}
    if not beam.prestress:
        del given["prestress"]  # so that documents stay as they were
    for name in PART_KINDS:
        tables = [table_of(part) for part in given[name]]
        given[name] = [{key: None if own == math.inf else own for key, own in one.items()} for one in tables]
    return data_of(given, BeamData)


def law_data(law: DampingLaw, model: Model) -> LawData:
    """Return the fields of a damping law, for a document that holds a model; refuse a law without a layout."""
    if isinstance(law, ModalDamping):
        return ModalData(tuple(law.ratios), tuple(law.frequencies or ()), _modes_data(law.modes, model))
    if isinstance(law, SumOfLaws):
        return SumData(tuple(law_data(term, model) for term in law.laws))
    for data, kind in COEFFICIENT_LAWS.items():
        if isinstance(law, kind):
            return data_of(law, data)
    known = ", ".join([*(kind.__name__ for kind in COEFFICIENT_LAWS.values()), ModalDamping.__name__])
    message = f"a {type(law).__name__} cannot be written to a document; only {known} and their sums can"
    raise InputError(message, "damping")


def beam_from(data: BeamData) -> Beam:
    """Return the beam of its fields; refuse values that make no beam."""
    given = {name: value for name, value in asdict(data).items() if value is not UNSET}
    for name in PART_KINDS:
        tables: list[dict[str, Any]] = msgspec.to_builtins(given[name])
        given[name] = [{key: math.inf if own is None else own for key, own in one.items()} for one in tables]
    return Beam(**with_parts(given))


def model_from(beam: BeamData, measures: StrainMeasuresData, where: str) -> Model:
    """Return the model that a document holds at a place; refuse values that make no beam."""
    with located(place(where, "beam")):
        known = beam_from(beam)
    with located(place(where, "strain_measures")):
        return Model(known, StrainMeasures(**asdict(measures)))


def law_from(data: LawData, model: Model, where: str) -> DampingLaw:
    """Return the damping law that a document holds at a place, beside a model; refuse values that make no law."""
    if isinstance(data, SumData):
        at = place(where, "laws")
        return SumOfLaws(tuple(law_from(term, model, place(at, k)) for k, term in enumerate(data.laws)))
    if isinstance(data, ModalData):
        modes = _modes_from(data.modes, model, place(where, "modes"))
        with located(where):
            return ModalDamping(modes, data.ratios, frequencies=data.frequencies)
    with located(where):
        return COEFFICIENT_LAWS[type(data)](**asdict(data))


def _modes_data(modes: Modes, model: Model) -> ModesData:
    rest, own = modes.equilibrium, modes.model != model
    if rest.loads:
        raise InputError("refer to an equilibrium under loads away from the tip, which a document cannot hold", "modes")
    return ModesData(
        frequencies=tuple(modes.frequencies.tolist()),
        shapes=tuple(map(tuple, modes.shapes.T.tolist())),
        equilibrium=EquilibriumData(tuple(rest.coordinates.tolist()), rest.tip_force, rest.tip_moment),
        beam=beam_data(modes.model.beam) if own else UNSET,
        strain_measures=data_of(modes.model.measures, StrainMeasuresData) if own else UNSET,
    )


def _modes_from(data: ModesData, model: Model, where: str) -> Modes:
    if data.beam is not UNSET and data.strain_measures is not UNSET:
        model = model_from(data.beam, data.strain_measures, where)
    at, count = place(where, "shapes"), len(data.frequencies)
    if len(data.shapes) != count:
        raise InputError(f"has {len(data.shapes)} shapes for {count} frequencies", at)
    shapes = [_coordinates(shape, model, place(at, k)) for k, shape in enumerate(data.shapes)]
    rest = data.equilibrium
    coordinates = _coordinates(rest.coordinates, model, f"{where}.equilibrium.coordinates")
    equilibrium = Equilibrium(model, coordinates, rest.tip_force, rest.tip_moment)
    return Modes(equilibrium, np.array(data.frequencies), np.ascontiguousarray(np.array(shapes).T))


def _coordinates(values: tuple[float, ...], model: Model, where: str) -> Array:
    if len(values) != model.size:
        raise InputError(f"has {len(values)} values for {model.size} coordinates", where)
    return np.array(values)
