"""Display of objects and results: one line in a shell, tables for a terminal, a notebook and CSV, and JSON.

A subclass of ``Displayed`` has a ``repr`` of one line.  A subclass of ``Reported`` also has text, HTML, a file and a
figure, which follow from its table, its plain data and the name of its drawing function.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
import reprlib
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from html import escape
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import Figure, drawing
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import instances

REPORT_WIDTH = 100  # columns of a report on a terminal
MAX_CHARACTERS = 180  # characters of an object on one line

CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
FORMULA = re.compile(r"[=+\-@\t\r].")  # start of a cell that a spreadsheet may evaluate

Cell = str | float | int | None


class Displayed:
    """Base class of public objects, with a ``repr`` of one line: the name of the class and a summary."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Set ``__repr__`` on the subclass, so that ``dataclass`` does not generate another one."""
        super().__init_subclass__(**keywords)
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return the object on one line."""
        text = " ".join(self._summary().split())
        limit = MAX_CHARACTERS - len(type(self).__name__)
        return f"{type(self).__name__}({text if len(text) <= limit else f'{text[: limit - 3]}...'})"

    def _summary(self) -> str:
        """Return the content in a few words; by default, the fields that differ from their defaults."""
        content: Any = self
        values = [
            (declared, getattr(self, declared.name)) for declared in (fields(content) if is_dataclass(content) else ())
        ]
        return ", ".join(
            f"{declared.name}={BRIEF.repr(value)}" for declared, value in values if not _is_default(declared, value)
        )


BRIEF: Any = reprlib.Repr()  # numbers to six digits, arrays by their shape, other values shortened
BRIEF.maxtuple = BRIEF.maxlist = BRIEF.maxdict = 6
BRIEF.maxstring, BRIEF.maxother = 60, MAX_CHARACTERS
BRIEF.repr_float = BRIEF.repr_float64 = lambda value, level: f"{value:.6g}"
BRIEF.repr_ndarray = lambda value, level: f"array{value.shape}"


def _is_default(declared: Field[Any], value: Any) -> bool:
    default = declared.default if declared.default_factory is MISSING else declared.default_factory()
    return type(value) is type(default) and not isinstance(value, np.ndarray) and bool(value == default)


@dataclass(frozen=True)
class Table(Displayed):
    """A table with a title and notes."""

    name: str  # short name or label, used for files
    title: str
    columns: Sequence[str]  # column heads with units
    rows: Sequence[Sequence[Cell]]  # cells: text, numbers, or None for an empty cell
    notes: Sequence[str] = ()  # remarks below the table
    errors: Mapping[str, Sequence[float | None]] = field(default_factory=dict)  # standard errors, by column head
    printed: Mapping[str, Sequence[float | None]] = field(default_factory=dict)  # printed numbers, by column head
    source: str = "printed"  # origin of the printed numbers
    digits: int = 6  # significant digits of a number on a page

    def text(self) -> str:
        """Return the table for a terminal, numbers to six digits."""
        cells = [list(self.columns), *([_cell_text(cell) for cell in row] for row in self.rows)]
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
        rule = "-" * len(lines[0])
        return "\n".join([self.title, rule, lines[0], rule, *lines[1:], *(f"  {note}" for note in self.notes)])

    def csv(self) -> str:
        """Return the table as CSV, numbers to all digits."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([[_plain_cell(cell) for cell in row] for row in (self.columns, *self.rows)])
        return out.getvalue()

    def _summary(self) -> str:
        return f"{self.name!r}, {len(self.rows)} rows, columns {', '.join(self.columns)}"

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        head = "".join(f"<th>{escape(cell)}</th>" for cell in self.columns)
        rows = ["".join(f"<td>{escape(_cell_text(cell))}</td>" for cell in row) for row in self.rows]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        caption = f"<caption>{escape(self.title)}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{notes}"


class Reported(Displayed, ABC):
    """Base class of results: text and HTML, JSON, a file, and a figure."""

    _drawing: ClassVar[str]  # module and name of the function that draws results by label
    _comparing: ClassVar[str] = ""  # of the function for several results, if it differs

    @abstractmethod
    def table(self) -> Table:
        """Return the most important numbers."""

    def tables(self) -> tuple[Table, ...]:
        """Return the tables of the report."""
        return (self.table(),)

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON, with its ``kind``."""

    def report(self) -> str:
        """Return the tables and the warnings as text."""
        tables = "\n\n".join(table.text() for table in self.tables())
        return "\n".join([tables, *(f"  note: {warning}" for warning in self._warnings)])

    def figure(self, *others: Any, labels: Sequence[str] = ()) -> Figure:
        """Draw the result together with others of its kind.

        Parameters
        ----------
        *others : results
            Results of the same kind; a ``Trajectory`` and a ``ReducedTrajectory`` are of one kind.
        labels : sequence of str
            Names of this result and the others in the legend; their numbers, from 1, if not given.

        Raises
        ------
        InputError
            If a result is of another kind, or there is not one label for each.
        """
        return self._draw_figure(others, labels)

    def save(self, path: str | Path) -> None:
        """Write the data of ``to_dict`` to a JSON file; raise an ``InputError`` if it cannot be written."""
        write_file(check_file(path), to_json(self.to_dict()))

    @property
    def _warnings(self) -> Sequence[str]:
        return getattr(self, "warnings", ())

    def _repr_html_(self) -> str:
        """Return the table and the warnings for a notebook."""
        return self.table()._repr_html_() + "".join(f"<p>note: {escape(note)}</p>" for note in self._warnings)

    def _draw_figure(self, others: Sequence[Any], labels: Sequence[str], **options: Any) -> Figure:
        """Return the figure of results by label."""
        figure: Figure = self._make_drawing((others and self._comparing) or self._drawing, others, labels, **options)
        return figure

    def _make_drawing(self, name: str, others: Sequence[Any], labels: Sequence[str], **options: Any) -> Any:
        """Return what the function of a module and name draws of the results by label."""
        unfit = [other for other in others if getattr(other, "_drawing", None) != self._drawing]
        if unfit:
            raise InputError(f"a {type(self).__name__} cannot be drawn with a {type(unfit[0]).__name__}", "figure")
        results = [self, *others]
        numbers = [str(k) for k in range(1, len(results) + 1)] if others else [""]
        names = instances(labels, "labels", str, minimum=0) or numbers
        if not len(set(names)) == len(names) == len(results):
            raise InputError(f"must be {len(results)} different names", "labels")
        return drawing(name)(dict(zip(names, results, strict=True)), **options)


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, such as ``1 mode`` or ``5 modes``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def spread(values: ArrayLike, unit: str) -> str:
    """Return the smallest and the largest value with their unit, such as ``1.85 to 88.6 Hz``."""
    ends = dict.fromkeys(f"{end(values):.4g}" for end in (np.min, np.max)) if np.size(values) else ["no"]
    return f"{' to '.join(ends)} {unit}".rstrip()


def with_error(value: float, error: float, unit: str = "") -> str:
    """Return a value with its standard error, such as ``10.0013 +- 0.00026 Hz``, with the same decimals."""
    return f"{to_width(value, error)} +- {error:.2g} {unit}".rstrip()


def to_width(value: float, width: float, digits: int = 2) -> str:
    """Return a value rounded to some digits of its error or interval width; to six digits without a finite width."""
    if not (math.isfinite(width) and width > 0.0 and value):
        return f"{value:.6g}"
    return f"{value:.{min(17, max(3, digits + math.ceil(math.log10(abs(value) / width))))}g}"


def finite_or_none(value: float) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def finite(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain data for JSON, dicts and lists nested, with None for numbers that are not finite."""
    return {key: _finite(value) for key, value in data.items()}


def to_json(value: Any) -> str:
    """Return plain data, lists and dicts nested, as JSON text; numbers that are not finite become null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False) + "\n"


def printable(text: str) -> str:
    """Return a text with control characters escaped, so that a terminal does not execute them."""
    return CONTROLS.sub(lambda match: ascii(match[0])[1:-1], text)


def wrap_report(text: str) -> str:
    """Fold long lines of a report, except rows of tables, at spaces and indent them by two more columns."""
    lines: list[str] = []
    width = 0  # of the last table
    for line in text.split("\n"):
        width = len(line) if set(line) == {"-"} else width
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        fold = textwrap.TextWrapper(REPORT_WIDTH, "", indent, break_long_words=False, break_on_hyphens=False).wrap
        lines += [line] if len(line) <= REPORT_WIDTH or len(line) == width else fold(line)
    return "\n".join(lines)


def _cell_text(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _plain_cell(cell: Cell) -> str | float | int:
    """Return a cell for CSV; an apostrophe prevents that a spreadsheet evaluates a text as a formula."""
    if isinstance(cell, str) and FORMULA.match(cell):
        try:
            float(cell)
        except ValueError:
            return f"'{cell}"
    return "" if cell is None else cell


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return finite(value)
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
