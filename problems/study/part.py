"""Parts of a study: one step each, with its numbers, tables and figures.

A study is a list of parts in the order of its document.  A part states tasks, which are independent of each other and
may run in any process, and makes a finding of their results.  Both are functions of plain data, so that the runner can
keep every result under a key made from its inputs (``runner``) and take it up again when a study is interrupted.

A later part may need an earlier one: its beam, or the terms of its damping law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self

from msgspec import Meta

from ancf_casadi.damping.spec import LawSpec
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.inputs import is_sequence, number, shown, whole
from ancf_casadi.support.specs import UNLISTED, convert
from ancf_casadi.support.tables import Cell, Table
from problems.spec.beam import read_beam
from problems.spec.file import NO_FILE, StudyFile
from problems.study.drawing import Drawing

Terms = tuple[dict[str, Any], ...]  # tables [[damping]], the terms of one law
Printed = dict[str, Any]  # printed numbers by column


@dataclass(frozen=True)
class Task:
    """A computation on plain data whose result is kept."""

    function: Callable[..., Any]  # function of a module; its return annotation is the type of the result
    inputs: tuple[Any, ...]  # its arguments: numbers, texts, arrays, frozen dataclasses
    cost: float = 1.0  # expected computing time, s, to start the longest task first


@dataclass(frozen=True)
class Finding:
    """Results of a part: those that later parts may need, and the tables and figures that show them."""

    data: Any  # the numbers for ``results.json``: SI units, ratios as fractions
    tables: tuple[Table, ...] = ()  # in the order of the document
    figures: tuple[Drawing, ...] = ()  # likewise
    warnings: tuple[str, ...] = ()  # limitations of the results
    text: str = ""  # report for a terminal, if it says more than the tables
    files: dict[str, bytes] = field(default_factory=dict)  # content of further files of the results, by name
    beam: BeamSpec | None = None  # the beam that the part has found, as results are kept
    terms: Terms = ()  # the damping law that it has found, as tables [[damping]]
    guess: BeamSpec | None = None  # the beam before a fit that has identified some of its properties
    errors: dict[str, float] | None = None  # standard errors of these, SI units, by name
    frequency_errors: tuple[float, ...] = ()  # those of the natural frequencies of the identified beam, Hz
    name: str = ""  # of its part, once that has run
    times: Mapping[str, float] = field(default_factory=dict)  # of the tasks and of the finding when they ran, s, by key

    def needed_later(self) -> Finding:
        """Return the finding without what shows it, which no other part needs."""
        return replace(self, tables=(), figures=(), warnings=(), text="", files={}, times={})

    @property
    def tasks(self) -> int:
        """Number of different tasks."""
        return len(self.times) - 1

    @property
    def seconds(self) -> float:
        """Computing time of the tasks and of the finding, s."""
        return sum(self.times.values())


Found = Mapping[str, Finding]  # findings, without tables and figures, by the name of their part


@dataclass(frozen=True)
class LawChoice:
    """A damping law of a table [[laws]], whose terms may be those that an earlier part has found."""

    name: str
    terms: Annotated[Terms, Meta(description='tables [[damping]], or {part = "PART"}')]
    title: str = ""  # in figures

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts that find terms."""
        return tuple(term["part"] for term in self.terms if "part" in term)

    def of(self, found: Found) -> Terms:
        """Return the terms without references."""
        for name in self.needs:
            if not found[name].terms:
                raise InputError(f"the part {name!r} finds no damping law", f"[laws]: {self.name}")
        terms: list[dict[str, Any]] = []
        for term in self.terms:  # other keys beside ``part`` override those of the terms that the part has found
            own = {key: value for key, value in term.items() if key != "part"}
            terms += [other | own for other in found[term["part"]].terms] if "part" in term else [term]
        return tuple(terms)


def printed_numbers(given: Printed, columns: Mapping[str, int], where: str) -> Printed:
    """Return the printed numbers of a part by column, from its key ``printed``; nan stands for a missing number.

    ``columns`` holds the number of rows of each column that may be given.
    """
    found = {}
    for name, values in given.items():
        place = f"{where}: printed"
        if name not in columns:
            raise InputError(f"must be one of {', '.join(columns)}, got {shown(name)}", place)
        if not is_sequence(values):
            raise InputError(f"must be a list of numbers, got {shown(values)}", f"{place}: {name}")
        if len(values) != columns[name]:
            raise InputError(f"has {len(values)} values for {columns[name]} rows", f"{place}: {name}")
        found[name] = tuple(None if value != value else number(value, f"{place}: {name}") for value in values)
    return found


@dataclass(frozen=True, kw_only=True)
class Part:
    """Base class of the kinds of parts; each kind is final.

    The fields are the keys of a table [[parts]] of a TOML file, but those that are ``UNLISTED``.
    """

    kind: ClassVar[str]  # as in the table of a TOML file
    about: ClassVar[str]  # what it shows, for the help; {} stands for its keys
    heading: ClassVar[str]  # title of a part that gives none
    naming: ClassVar[tuple[str, ...]] = ()  # keys that name parts; an empty ``beam`` stands for that of the file
    reading: ClassVar[Set[str]] = frozenset()  # tables of the file that its tasks read

    name: Annotated[str, Meta(description="its key in results.json")] = ""
    title: str = ""
    text: Annotated[str, Meta(description="paragraphs")] = ""
    section: Annotated[str, Meta(description="title of a section that begins here")] = ""
    notes: Annotated[tuple[str, ...], Meta(description="below its tables")] = ()
    tables: Annotated[tuple[str, ...], Meta(description="their labels")] = ()
    figures: Annotated[tuple[str, ...], Meta(description="their labels")] = ()
    draw: Annotated[bool, Meta(description="with figures")] = True
    quick: Annotated[bool, Meta(description="in a quick look too")] = True
    printed_by: Annotated[str, UNLISTED] = "printed"  # origin of the printed numbers
    given: Annotated[StudyFile, UNLISTED] = NO_FILE  # with the tables that its tasks read

    def checked(self, study: Study, where: str) -> Self:
        """Return the part with what it takes from its study; messages call its place ``where``."""
        return replace(self, given=study.file.only(self.reading)) if self.reading else self

    def shortened(self) -> Self:
        """Return the part of a quick look, with short simulations."""
        return self

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts whose findings it needs; an empty name stands for the beam of the file."""
        named = [name for key in self.naming if (name := getattr(self, key)) or key == "beam"]
        laws = [name for law in getattr(self, "laws", ()) for name in law.needs]
        return tuple(dict.fromkeys((*named, *laws)))

    def tasks(self, found: Found) -> tuple[Task, ...]:
        """Return the tasks of the part, given the findings of the parts that it needs."""
        return ()

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        """Return the finding, given the results of the tasks in their order; by default what the only task finds."""
        only: Finding
        (only,) = results
        return only

    def beam_in(self, found: Found) -> Beam:
        """Return the beam of the file, or of the part that the key ``beam`` names."""
        name: str = getattr(self, "beam", "")
        data = found[name].beam
        if data is None:
            raise InputError(f"the part {name!r} finds no beam; name a part of the kind match", "beam")
        return data.beam()

    def table(
        self,
        title: str,
        heads: Sequence[str],
        rows: Iterable[Sequence[Cell]],
        *notes: str,
        errors: Mapping[str, Sequence[float | None]] | None = None,
        printed: Mapping[str, Sequence[float | None] | None] | None = None,
    ) -> Table:
        """Return a table that names the origin of its printed numbers; they and standard errors are by head."""
        numbers = {head: values for head, values in (printed or {}).items() if values}
        return Table("", title, heads, list(rows), notes, errors or {}, numbers, self.printed_by)


@dataclass(frozen=True)
class Study:
    """A study: the keys of the table [study], its file with what all parts share, and the parts in their order."""

    title: str = ""
    parts: Annotated[tuple[Part, ...], UNLISTED] = ()
    text: str = ""  # introduction, paragraphs separated by empty lines
    source: Annotated[str, Meta(description="a reference")] = ""  # of the work that the study follows
    printed_by: Annotated[str, Meta(description="origin of printed numbers")] = "printed"
    seed: Annotated[int, Meta(ge=0)] = 0  # of all random numbers
    file: Annotated[StudyFile, UNLISTED] = NO_FILE
    laws: Annotated[tuple[LawChoice, ...], UNLISTED] = ()  # the tables [[laws]]
    beam: Annotated[Beam | None, UNLISTED] = None  # of the file, if a part needs it

    @cached_property
    def model(self) -> Model:
        """The beam of the file."""
        if "beam" not in self.file.tables:
            raise InputError("the table is missing; this part needs a beam", self.file.where("beam"))
        model = read_beam(self.file).model
        if model.measures != StrainMeasures():
            raise InputError(
                "the document has strain measures that this part does not support; use the defaults",
                self.file.where("beam"),
            )
        return model

    def law_choice(self, name: Any, where: str) -> LawChoice:
        """Return a law by its name."""
        for law in self.laws:
            if law.name == name:
                for term in law.terms:
                    if "part" not in term:
                        spec = convert(term, LawSpec, f"{where}: {name}")
                        whole(len(getattr(spec, "ratios", ())), f"{where}: {name}: ratios", 0, self.model.freedoms)
                return law
        raise InputError(f"there is no law {shown(name)}; [[laws]] names them", where)

    def shortened(self) -> Study:
        """Return the study of a quick look, without the parts that it leaves out, and without those that need them."""
        kept: dict[str, Part] = {part.name: part.shortened() for part in self.parts if part.quick}
        while missing := [name for name, part in kept.items() if not set(part.needs) <= {"", *kept}]:
            kept = {name: part for name, part in kept.items() if name not in missing}
        return replace(self, parts=tuple(kept.values()))
