"""The file of a study, from which the kinds of parts read their tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.inputs import is_sequence, number, shown
from problems.schema.beam import law_of, read_beam
from problems.schema.file import StudyFile
from problems.schema.table import read
from problems.study.part import Found, Terms

Printed = dict[str, Any]  # printed numbers by column


@dataclass(frozen=True)
class LawChoice:
    """A damping law of a table [[laws]], whose terms may be those that an earlier part has found.

    Parameters
    ----------
    name, title : str
        Name in the file, and title in figures.
    terms : tuple of dict
        Its tables [[damping]]; ``{part = "NAME"}`` stands for the terms of a part.
    """

    name: str
    terms: Annotated[Terms, Meta(description='tables [[damping]], or {part = "PART"}')]
    title: str = ""

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts that find terms."""
        return tuple(term["part"] for term in self.terms if "part" in term)

    def of(self, found: Found) -> Terms:
        """Return the terms without references.

        Raises
        ------
        InputError
            If a part has found none.
        """
        for name in self.needs:
            if not found[name].terms:
                raise InputError(f"the part {name!r} finds no damping law", f"[laws]: {self.name}")
        terms: list[dict[str, Any]] = []
        for term in self.terms:  # other keys beside ``part`` override those of the terms that the part has found
            own = {key: value for key, value in term.items() if key != "part"}
            terms += [other | own for other in found[term["part"]].terms] if "part" in term else [term]
        return tuple(terms)


@dataclass(frozen=True)
class Source:
    """The file of a study, and what all parts share.

    Parameters
    ----------
    file : StudyFile
        The tables.
    laws : tuple of LawChoice
        The tables [[laws]].
    seed : int
        Seed of random numbers.
    """

    file: StudyFile
    laws: tuple[LawChoice, ...]
    seed: int

    @cached_property
    def model(self) -> Model:
        """The beam of the file.

        Raises
        ------
        InputError
            If there is none, or it comes from a document with strain measures other than the defaults.
        """
        if "beam" not in self.file.tables:
            raise InputError("the table is missing; this part needs a beam", self.file.where("beam"))
        model = read_beam(self.file).model
        if model.measures != StrainMeasures():
            raise InputError(
                "the document has strain measures that this part does not support; use the defaults",
                self.file.where("beam"),
            )
        return model

    @property
    def most_modes(self) -> int:
        """Number of modes of the beam.

        Raises
        ------
        InputError
            If there is no beam.
        """
        count: int = self.model.size - self.model.free.start
        return count

    def law_choice(self, name: Any, where: str) -> LawChoice:
        """Return a law by its name.

        Raises
        ------
        InputError
            If there is no such law.
        """
        for law in self.laws:
            if law.name == name:
                law_of([term for term in law.terms if "part" not in term], self.model, f"{where}: {name}")  # check
                return law
        raise InputError(f"there is no law {shown(name)}; [[laws]] names them", where)


def read_laws(file: StudyFile) -> tuple[LawChoice, ...]:
    """Return the laws of the tables [[laws]].

    Raises
    ------
    InputError
        If a key or value cannot be used, or two laws have one name.
    """
    where = file.where("laws")
    found: dict[str, LawChoice] = {}
    for table in file.several("laws"):
        law = read(table, LawChoice, where)
        if not law.name.isidentifier() or law.name in found:
            raise InputError(f"must be made of letters, digits and _, and differ, got {shown(law.name)}",
                             f"{where}: name")  # fmt: skip
        for term in law.terms:
            if not isinstance(term.get("part", ""), str):
                raise InputError(f"must be the name of a part, got {shown(term['part'])}", f"{where}: {law.name}: part")
        found[law.name] = law if law.title else replace(law, title=law.name)
    return tuple(found.values())


def printed_numbers(given: Printed, columns: Mapping[str, int | None], where: str) -> Printed:
    """Return the printed numbers of a part by column, from its key ``printed``; nan stands for a missing number.

    Parameters
    ----------
    given : dict
        The numbers as they are in the file.
    columns : mapping of str to int or None
        Number of rows of each column that may be given; None if only the finding of the part tells.
    where : str
        Place of the part, for messages.

    Raises
    ------
    InputError
        If a name is no column, or a value is not a list with one number per row.
    """
    found = {}
    for name, values in given.items():
        place = f"{where}: printed"
        if name not in columns:
            raise InputError(f"must be one of {', '.join(columns)}, got {shown(name)}", place)
        if not is_sequence(values):
            raise InputError(f"must be a list of numbers, got {shown(values)}", f"{place}: {name}")
        if len(values) != (columns[name] or len(values)):
            raise InputError(f"has {len(values)} values for {columns[name]} rows", f"{place}: {name}")
        found[name] = tuple(None if value != value else number(value, f"{place}: {name}") for value in values)
    return found
