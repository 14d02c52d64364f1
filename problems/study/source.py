"""The file of a study, from which the kinds of parts read their tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.inputs import check_keys, is_sequence, located, number, shown
from problems.schema.beam import law_of, read_beam
from problems.schema.file import StudyFile
from problems.study.part import Outcome, Terms


@dataclass(frozen=True)
class BeamChoice:
    """The beam of a part: that of the file, or the one that an earlier part has found.

    Parameters
    ----------
    given : Beam
        The beam of the file.
    part : str
        Name of the part; the beam of the file if empty.
    """

    given: Beam
    part: str = ""

    @property
    def needs(self) -> tuple[str, ...]:
        """Name of the part, if there is one."""
        return (self.part,) if self.part else ()

    def beam(self, found: Mapping[str, Outcome]) -> Beam:
        """Return the beam.

        Raises
        ------
        InputError
            If the part has found none.
        """
        if not self.part:
            return self.given
        beam = found[self.part].beam
        if beam is None:
            raise InputError(f"the part {self.part!r} finds no beam; name a part of the kind match", "beam")
        return beam


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
    title: str
    terms: Terms

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts that find terms."""
        return tuple(term["part"] for term in self.terms if "part" in term)

    def of(self, found: Mapping[str, Outcome]) -> Terms:
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

    def beam_choice(self, given: Mapping[str, Any], where: str) -> BeamChoice:
        """Return the beam of a part, which the key ``beam`` may take from an earlier part."""
        with located(where):
            return BeamChoice(self.model.beam, text_of(given, "beam", ""))

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
        check_keys(table, {"name", "terms"}, {"title"}, where)
        name, title, terms = table["name"], table.get("title", table["name"]), table["terms"]
        if not isinstance(name, str) or not name.isidentifier() or name in found:
            raise InputError(f"must be made of letters, digits and _, and differ, got {shown(name)}", f"{where}: name")
        if not isinstance(title, str):
            raise InputError(f"must be a text, got {shown(title)}", f"{where}: {name}: title")
        if not isinstance(terms, list) or not all(isinstance(term, dict) for term in terms):
            raise InputError(f"must be a list of tables, got {shown(terms)}", f"{where}: {name}: terms")
        for term in terms:
            if not isinstance(term.get("part", ""), str):
                raise InputError(f"must be the name of a part, got {shown(term['part'])}", f"{where}: {name}: part")
        found[name] = LawChoice(name, title, tuple(terms))
    return tuple(found.values())


def text_of(table: Mapping[str, Any], key: str, default: str) -> str:
    """Return a text from a table.

    Raises
    ------
    InputError
        If it is not a text.
    """
    value = table.get(key, default)
    if not isinstance(value, str):
        raise InputError(f"must be a text, got {shown(value)}", key)
    return value


def texts_of(table: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Return a list of texts from a table; empty if the key is missing.

    Raises
    ------
    InputError
        If it is not a list of texts.
    """
    value = table.get(key, [])
    if not is_sequence(value) or not all(isinstance(item, str) for item in value):
        raise InputError(f"must be a list of texts, got {shown(value)}", key)
    return tuple(value)


def printed_numbers(table: Mapping[str, Any], columns: Mapping[str, int | None]) -> dict[str, tuple[float | None, ...]]:
    """Return the printed numbers of a part by column, from its key ``printed``; nan stands for a missing number.

    Parameters
    ----------
    table : mapping
        The table of the part.
    columns : mapping of str to int or None
        Number of rows of each column that may be given; None if only the finding of the part tells.

    Raises
    ------
    InputError
        If a name is no column, or a value is not a list with one number per row.
    """
    given = table.get("printed", {})
    if not isinstance(given, dict):
        raise InputError(f"must be a table, got {shown(given)}", "printed")
    found = {}
    for name, values in given.items():
        if name not in columns:
            raise InputError(f"must be one of {', '.join(columns)}, got {shown(name)}", "printed")
        if not is_sequence(values):
            raise InputError(f"must be a list of numbers, got {shown(values)}", f"printed: {name}")
        if len(values) != (columns[name] or len(values)):
            raise InputError(f"has {len(values)} values for {columns[name]} rows", f"printed: {name}")
        found[name] = tuple(None if value != value else number(value, f"printed: {name}") for value in values)
    return found
