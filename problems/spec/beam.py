"""The tables of a beam: [beam], or a JSON document with a beam and its damping, and [[damping]], the terms of a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from msgspec import Meta

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.damping.spec import FrictionSpec, LawSpec, ModalSpec, QuadraticSpec, RayleighSpec, sum_laws
from ancf_casadi.export.model_document import Document, read_document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import AttachmentSpec, BeamSpec, SupportSpec
from ancf_casadi.support.inputs import located
from ancf_casadi.support.specs import Spec, convert
from ancf_casadi.vibration.modes import natural_modes
from problems.spec.file import StudyFile, is_document
from problems.spec.help import table_help, tagged_help


class DocumentName(Spec, frozen=True):
    """A beam in a JSON document."""

    document: Annotated[str, Meta(description='"BEAM.json", beside this file')]


PROPERTY_KEYS = table_help(
    "[beam]",
    "{}; a property is one number, or a list with one value per element; supports = []: a free beam.  Or only {}: a "
    "JSON document with a beam and its damping",
    BeamSpec,
    DocumentName,
)
PART_KEYS = tagged_help("[[beam.supports]]", SupportSpec) + tagged_help("[[beam.attachments]]", AttachmentSpec)
DAMPING_KEYS = tagged_help("[[damping]]", RayleighSpec | QuadraticSpec | FrictionSpec | ModalSpec)
BEAM_KEYS = PROPERTY_KEYS + PART_KEYS + DAMPING_KEYS


def read_beam(given: str | StudyFile) -> Document:
    """Read the beam of a TOML file, or a JSON document (a name that ends in ``.json``) with a beam and its damping."""
    if isinstance(given, str) and is_document(given):
        return read_document(given)
    file = StudyFile.of(given)
    table, where = file.needed("beam"), file.where("beam")
    if isinstance(table, dict) and "document" in table:
        name = convert(table, DocumentName, where).document
        with located(f"{where}: document"):
            return read_document(file.beside(name))
    spec = convert(table, BeamSpec, where)
    with located(where):
        return Document(Model(spec.beam()))


def read_damped(given: str | StudyFile) -> Document:
    """Read a beam and its damping; the damping of a document holds unless the file has its own."""
    if isinstance(given, str) and is_document(given):
        return read_document(given)
    file = StudyFile.of(given)
    source = read_beam(file)
    if "damping" not in file.tables:
        return source
    return replace(source, damping=law_of(file.several("damping"), source.model, file.where("damping")))


def damping_on(given: str | StudyFile, model: Model) -> DampingLaw | None:
    """Return the damping of a file on another beam than that of the file; modal laws take the modes of that beam."""
    file = StudyFile.of(given)
    if "damping" in file.tables:
        return law_of(file.several("damping"), model, file.where("damping"))
    return sum_laws(
        [
            ModalDamping(natural_modes(model, count=len(term.ratios)), term.ratios)
            if isinstance(term, ModalDamping)
            else term
            for term in terms_of(read_beam(file).damping)
        ]
    )


def terms_of(law: DampingLaw | None) -> tuple[DampingLaw, ...]:
    """Return the terms of a law that ``law_of`` has summed."""
    return law.laws if isinstance(law, SumOfLaws) else () if law is None else (law,)


def law_of(terms: Sequence[Any], model: Model, where: str) -> DampingLaw | None:
    """Return the sum of terms given as tables [[damping]]; None if there are none."""
    return sum_laws([term_of(table, model, where) for table in terms])


def term_of(table: Any, model: Model, where: str) -> DampingLaw:
    """Return the law of one table [[damping]]."""
    spec: LawSpec = convert(table, LawSpec, where)
    return spec.law(model, where)
