"""The tables of a beam: [beam], or a JSON document with a beam and its damping, and [[damping]], the terms of a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

from msgspec import Meta

from ancf_casadi.damping import DampingLaw, ModalDamping, SumOfLaws
from ancf_casadi.damping.spec import LawSpec, sum_laws
from ancf_casadi.export.model_document import Document, read_document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import Spec, convert
from ancf_casadi.vibration.modes import natural_modes
from problems.spec.file import StudyFile, is_document


class DocumentName(Spec, frozen=True):
    """Or a beam with its damping in a JSON document."""

    document: Annotated[str, Meta(description='"BEAM.json", beside this file')]


@dataclass(frozen=True)
class DampedBeam:
    """A beam and the tables of its damping law, of which a modal law needs the natural modes."""

    source: Document  # the beam, with the damping law of a document unless the file has its own
    terms: tuple[LawSpec, ...]  # tables [[damping]]
    where: str  # place of the tables

    @classmethod
    def of(cls, file: StudyFile) -> DampedBeam:
        """Convert the tables of a file, and check them without solving for modes."""
        source, where = read_beam(file), file.where("damping")
        if "damping" in file.tables:
            source = replace(source, damping=None)
        terms = tuple(convert(table, LawSpec, where) for table in file.several("damping"))
        for term in terms:
            term.check(source.model, where)
        return cls(source, terms, where)

    @property
    def model(self) -> Model:
        """The beam."""
        return self.source.model

    @property
    def undamped(self) -> bool:
        """True if there is no damping law."""
        return not self.terms and self.source.damping is None

    @cached_property
    def laws(self) -> tuple[DampingLaw, ...]:
        """The laws of the tables."""
        return tuple(term.law(self.model, self.where) for term in self.terms)

    @property
    def damping(self) -> DampingLaw | None:
        """The sum of the laws of the tables, or the law of the document."""
        return sum_laws(self.laws) or self.source.damping

    def damping_on(self, model: Model) -> DampingLaw | None:
        """Return the damping law of another beam; modal laws take the modes of that beam."""
        law = self.source.damping
        laws = law.laws if isinstance(law, SumOfLaws) else [law] if law else []
        modal = [ModalDamping(natural_modes(model, count=len(law.ratios)), law.ratios)
                 if isinstance(law, ModalDamping) else law for law in laws]  # fmt: skip
        return sum_laws([*(term.law(model, self.where) for term in self.terms), *modal])


def read_beam(source: str | StudyFile) -> Document:
    """Read the beam of a TOML file, or the JSON document that holds it with its damping."""
    file = StudyFile.of(source)
    table, where = file.require("beam"), file.where("beam")
    if isinstance(table, dict) and "document" in table:
        name = convert(table, DocumentName, where).document
        with error_prefix("" if is_document(file.path) else f"{where}: document"):
            return read_document(file.beside(name))
    spec = convert(table, BeamSpec, where)
    with error_prefix(where):
        return Document(Model(spec.beam()))


def read_damped_beam(source: str | StudyFile) -> Document:
    """Read a beam and its damping; the damping of a document holds unless the file has its own."""
    beam = DampedBeam.of(StudyFile.of(source))
    return replace(beam.source, damping=beam.damping)


def make_law(terms: Sequence[Any], model: Model, where: str) -> DampingLaw | None:
    """Return the sum of terms given as tables [[damping]]; None if there are none."""
    specs: list[LawSpec] = [convert(table, LawSpec, where) for table in terms]
    return sum_laws([spec.law(model, where) for spec in specs])
