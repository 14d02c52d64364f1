"""Parts of a study: one step each, with its numbers, tables and figures.

A study is a list of parts in the order of its document.  A part states tasks, which are independent of each other and
may run in any process, and makes a finding of their results.  Both are functions of plain data, so that the runner can
keep every result under a key made from its inputs (``store``) and take it up again when a study is interrupted.

A later part may need an earlier one: its beam, or the terms of its damping law.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from ancf_casadi.mechanics.beam import Beam
from problems.study.data_table import DataTable
from problems.study.drawing import Drawing

Terms = tuple[dict[str, Any], ...]  # tables [[damping]], the terms of one law


@dataclass(frozen=True)
class Effort:
    """Accuracy and length of the simulations of a study, and formats of its figures.

    Parameters
    ----------
    steps_per_period : int
        Least number of integrator steps per period of the excitation.
    driving : float
        Time of excitation relative to the given one.
    window : float
        Length of the fitted decays relative to the default.
    formats : tuple of str
        Formats of the figures.
    """

    steps_per_period: int
    driving: float
    window: float
    formats: tuple[str, ...]


FULL = Effort(steps_per_period=24, driving=1.0, window=1.0, formats=("svg", "png"))
QUICK = Effort(steps_per_period=12, driving=0.05, window=0.3, formats=("svg",))


@dataclass(frozen=True)
class Heading:
    """Place of a part in the document.

    Parameters
    ----------
    name : str
        Key of the part in ``results.json``.
    title : str
        Title of its section.
    text : str
        Paragraphs that introduce it, separated by empty lines.
    tables, figures : tuple of str
        Labels of its tables and figures, such as ``Table 2``; those without a label are numbered.
    notes : tuple of str
        Remarks below its tables, such as known reasons for differences.
    source : str
        Origin of the printed numbers, such as ``paper``.
    section : str
        Title of a section of the document that begins here; none if empty.
    draw : bool
        Whether the document shows its figures.
    quick : bool
        Whether it belongs to a quick look.
    """

    name: str
    title: str
    text: str = ""
    tables: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    source: str = "printed"
    section: str = ""
    draw: bool = True
    quick: bool = True


@dataclass(frozen=True)
class Task:
    """A computation on plain data whose result is kept.

    Parameters
    ----------
    function : callable
        Function of a module; its return annotation is the type of the result.
    inputs : tuple
        Its arguments: numbers, texts, arrays, frozen dataclasses.
    cost : float
        Expected computing time, s, to start the longest task first.
    """

    function: Callable[..., Any]
    inputs: tuple[Any, ...]
    cost: float = 1.0


@dataclass(frozen=True)
class Outcome:
    """Results of a part that later parts may need.

    Parameters
    ----------
    data : dict or list
        The numbers for ``results.json``: SI units, ratios as fractions.
    beam : Beam, optional
        The beam that the part has found.
    terms : tuple of dict
        The damping law that it has found, as tables [[damping]].
    """

    data: Any
    beam: Beam | None = None
    terms: Terms = ()


@dataclass(frozen=True)
class Finding:
    """Results of a part, with the tables and figures that show them.

    Parameters
    ----------
    outcome : Outcome
        The numbers.
    tables : tuple of DataTable
        Tables in the order of the document.
    figures : tuple of Drawing
        Figures in the order of the document.
    warnings : tuple of str
        Limitations of the results.
    """

    outcome: Outcome
    tables: tuple[DataTable, ...] = ()
    figures: tuple[Drawing, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Part(ABC):
    """Base class of the kinds of parts; each kind is final.

    Parameters
    ----------
    heading : Heading
        Its place in the document.
    """

    kind: ClassVar[str]  # as in the table of a TOML file
    numbers: ClassVar[Any]  # type of the data of its outcome, for the schema of results.json

    heading: Heading

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts whose outcomes it needs."""
        return ()

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the tasks of the part, given the outcomes of the parts that it needs."""
        return ()

    @abstractmethod
    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the finding, given the results of the tasks in their order."""


@dataclass(frozen=True)
class Study:
    """A study: its parts in the order of the document.

    Parameters
    ----------
    title : str
        Title of the document.
    parts : tuple of Part
        The parts.
    text : str
        Introduction, paragraphs separated by empty lines.
    source : str
        Reference of the work that the study follows; none if empty.
    seed : int
        Seed of all random numbers.
    """

    title: str
    parts: tuple[Part, ...] = field(default=())
    text: str = ""
    source: str = ""
    seed: int = 0

    def shortened(self) -> Study:
        """Return the study without the parts that a quick look leaves out, and without those that need them."""
        kept: dict[str, Part] = {part.heading.name: part for part in self.parts if part.heading.quick}
        while missing := [name for name, part in kept.items() if not set(part.needs) <= kept.keys()]:
            kept = {name: part for name, part in kept.items() if name not in missing}
        return replace(self, parts=tuple(kept.values()))
