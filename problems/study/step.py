"""Steps of a study, and their findings.

A study is a list of steps in the order of its document.  A step is declared by its heading, labels and settings, and
has one function, which is written from top to bottom: it runs its expensive computations through ``compute``, and
returns its finding, with numbers, tables and figures.

A later step may need the finding of an earlier one: its beam, or the terms of its damping law.
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
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.specs import UNLISTED, convert
from ancf_casadi.support.tables import Cell, Reported, Table
from problems.spec.beam import read_beam
from problems.spec.file import NO_FILE, StudyFile
from problems.study.compute import Compute
from problems.study.drawing import Drawing, render

Terms = tuple[dict[str, Any], ...]  # tables [[damping]], the terms of one law
Printed = Mapping[str, Sequence[float | None]]  # printed numbers by column


@dataclass(frozen=True)
class Finding:
    """Results of a step: those that later steps may need, and the tables and figures that show them."""

    data: Any  # the numbers for ``results.json``: SI units, ratios as fractions
    tables: tuple[Table, ...] = ()  # in the order of the document
    figures: tuple[Drawing, ...] = ()  # likewise
    warnings: tuple[str, ...] = ()  # limitations of the results
    text: str = ""  # report for a terminal, if it says more than the tables
    files: dict[str, bytes] = field(default_factory=dict)  # content of further files of the results, by name
    beam: BeamSpec | None = None  # the beam that the step has identified, in a form that can be kept
    terms: Terms = ()  # the damping law that it has found, as tables [[damping]]
    guess: BeamSpec | None = None  # the beam before a fit that has identified some of its properties
    errors: dict[str, float] | None = None  # standard errors of these, SI units, by name
    frequency_errors: tuple[float, ...] = ()  # those of the natural frequencies of the identified beam, Hz
    name: str = ""  # of its step, once that has run
    times: Mapping[str, float] = field(default_factory=dict)  # of the computations when they ran, s, by key

    @classmethod
    def of(
        cls,
        result: Reported,
        caption: str,
        formats: Sequence[str],
        draw: Callable[[], Figure] | None = None,
        **others: Any,
    ) -> Self:
        """Return the numbers, tables, figure, warnings and report of a result, or others in place of some."""
        fields: dict[str, Any] = {
            "data": result.to_dict(),
            "tables": result.tables(),
            "figures": (render(caption, draw or result.figure, formats),),
            "warnings": tuple(getattr(result, "warnings", ())),
            "text": result.report(),
        }
        return cls(**fields | others)

    def beside_print(self, *printed: Mapping[str, Sequence[float | None] | None]) -> Self:
        """Return the finding with the printed numbers of its first tables, by head; a column may have none."""
        by_head = [{head: numbers for head, numbers in table.items() if numbers} for table in printed]
        tables = [replace(table, printed=numbers) for table, numbers in zip(self.tables, by_head, strict=False)]
        return replace(self, tables=(*tables, *self.tables[len(printed) :]))

    @property
    def seconds(self) -> float:
        """Computing time, s."""
        return sum(self.times.values(), 0.0)


NO_FINDING = Finding(None)
Findings = Mapping[str, Finding]  # by the name of their step


@dataclass(frozen=True)
class LawChoice:
    """A damping law, whose terms may be those that an earlier step has found."""

    name: str
    terms: Annotated[Terms, Meta(description='tables [[damping]], or {step = "STEP"}')]
    title: str = ""  # in figures

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the steps that find terms."""
        return tuple(term["step"] for term in self.terms if "step" in term)

    def resolve(self, findings: Findings) -> LawChoice:
        """Return the law with terms in place of references."""
        for name in self.needs:
            if not findings[name].terms:
                raise InputError(f"the step {name!r} finds no damping law", f"[laws]: {self.name}")
        terms: list[dict[str, Any]] = []
        for term in self.terms:  # other keys beside ``step`` override those of the terms that the step has found
            overriding = {key: value for key, value in term.items() if key != "step"}
            terms += [other | overriding for other in findings[term["step"]].terms] if "step" in term else [term]
        return replace(self, terms=tuple(terms))


def join_findings(data: Any, findings: Sequence[Finding], **others: Any) -> Finding:
    """Return the tables, figures, warnings and reports of several findings as one."""
    together = {
        name: tuple(item for finding in findings for item in getattr(finding, name))
        for name in ("tables", "figures", "warnings")
    }
    return Finding(data, **{**together, "text": "\n\n".join(finding.text for finding in findings), **others})


def printed_numbers(table: Printed, columns: Mapping[str, int], where: str) -> Printed:
    """Return the printed numbers of a step by column, from its key ``printed``; None for one that is nan there.

    ``columns`` holds the number of rows of each column that may be given.
    """
    for name, values in table.items():
        if name not in columns:
            raise InputError(f"must be one of {', '.join(columns)}, got {shown(name)}", f"{where}: printed")
        if len(values) != columns[name]:
            raise InputError(f"has {len(values)} values for {columns[name]} rows", f"{where}: printed: {name}")
    return {name: [None if number != number else number for number in values] for name, values in table.items()}


def study_table(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    *notes: str,
    errors: Mapping[str, Sequence[float | None]] | None = None,
) -> Table:
    """Return a table of a study, numbers to four digits, or to those that their standard errors, by head, support."""
    return Table("", title, heads, list(rows), notes, errors or {}, digits=4)


@dataclass(frozen=True, kw_only=True)
class Step:
    """Base class of the kinds of steps; each kind is final, and the help shows the first line about it.

    The fields are the keys of a table [[steps]] of a TOML file, but those that are ``UNLISTED``.
    """

    kind: ClassVar[str]  # as in the table of a TOML file
    heading: ClassVar[str]  # title of a step that gives none
    naming: ClassVar[tuple[str, ...]] = ()  # keys that name steps; an empty ``beam`` stands for that of the file
    reading: ClassVar[Set[str]] = frozenset()  # tables of the file that its computations read

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
    where: Annotated[str, UNLISTED] = ""  # its place in the file, for messages
    file: Annotated[StudyFile, UNLISTED] = NO_FILE  # with the tables that its computations read

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with what it takes from its study; messages call its place ``where``."""
        return replace(self, file=study.file.only(self.reading)) if self.reading else self

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the steps whose findings it needs; an empty name stands for the beam of the file."""
        named = [name for key in self.naming if (name := getattr(self, key)) or key == "beam"]
        laws = [name for law in getattr(self, "laws", ()) for name in law.needs]
        return tuple(dict.fromkeys((*named, *laws)))

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the finding, given the findings of the steps that it needs."""
        raise NotImplementedError

    def beam_in(self, findings: Findings) -> Beam:
        """Return the beam of the file, or of the step that the key ``beam`` names."""
        name: str = getattr(self, "beam", "")
        beam = findings[name].beam
        if beam is None:
            raise InputError(
                f"the step {name!r} finds no beam; name one of the kind match or motion", f"{self.where}: beam"
            )
        return beam.beam()


@dataclass(frozen=True)
class Study:
    """A study, with its steps in the order of the document.

    The keys of the table [study] are those that are not ``UNLISTED``.
    """

    title: str = ""
    steps: Annotated[tuple[Step, ...], UNLISTED] = ()
    text: str = ""  # introduction, paragraphs separated by empty lines
    source: Annotated[str, Meta(description="a reference")] = ""  # of the work that the study follows
    printed_by: Annotated[str, Meta(description="origin of printed numbers")] = "printed"
    seed: Annotated[int, UNLISTED] = 0  # of all random numbers
    file: Annotated[StudyFile, UNLISTED] = NO_FILE
    laws: Annotated[Mapping[str, LawChoice], UNLISTED] = field(default_factory=dict)  # the tables [[laws]] by name
    beam: Annotated[Beam | None, UNLISTED] = None  # of the file, if a step needs it

    @cached_property
    def model(self) -> Model:
        """The beam of the file."""
        if "beam" not in self.file.tables:
            raise InputError("the table is missing; this step needs a beam", self.file.where("beam"))
        model = read_beam(self.file).model
        if model.measures != StrainMeasures():
            raise InputError(
                "the document has strain measures that this step does not support; use the defaults",
                self.file.where("beam"),
            )
        return model

    def law_choice(self, name: Any, where: str) -> LawChoice:
        """Return a law by its name."""
        if not isinstance(name, str) or name not in self.laws:
            raise InputError(f"there is no law {shown(name)}; [[laws]] names them", where)
        for term in self.laws[name].terms:
            if "step" not in term:
                convert(term, LawSpec, f"{where}: {name}").check(self.model, f"{where}: {name}")
        return self.laws[name]

    def shorten(self) -> Study:
        """Return the study of a quick look, without the steps that it leaves out, and without those that need them."""
        steps = {step.name: step for step in self.steps if step.quick}
        while missing := [name for name, step in steps.items() if not set(step.needs) <= {"", *steps}]:
            steps = {name: step for name, step in steps.items() if name not in missing}
        return replace(self, steps=tuple(steps.values()))
