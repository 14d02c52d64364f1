"""Display of objects and results: one line in a shell, tables for a terminal, a notebook and CSV, and JSON.

A class that inherits from ``Displayed`` has a ``repr`` of one line.  One that inherits from ``Reported`` also has text,
HTML, a file and a figure, which follow from its table, its plain data and the name of the function that draws it.
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
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import instances

REPORT_WIDTH = 100  # columns of a report on a terminal
MOST_CHARACTERS = 180  # characters of an object on one line

CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
FORMULA = re.compile(r"[=+\-@\t\r].")  # beginning of a cell that a spreadsheet may compute

Cell = str | float | int | None


class Displayed:
    """Base class of public objects, which are shown on one line: the name of the class, and a summary."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Keep the display of a dataclass, which would generate another one."""
        super().__init_subclass__(**keywords)
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return the object on one line."""
        text = " ".join(self._summary().split())
        most = MOST_CHARACTERS - len(type(self).__name__)
        return f"{type(self).__name__}({text if len(text) <= most else f'{text[: most - 3]}...'})"

    def _summary(self) -> str:
        """Return the content in a few words; by default, the fields that differ from their defaults."""
        content: Any = self
        values = [(own, getattr(self, own.name)) for own in (fields(content) if is_dataclass(content) else ())]
        return ", ".join(f"{own.name}={BRIEF.repr(value)}" for own, value in values if not _is_default(own, value))


BRIEF: Any = reprlib.Repr()  # values on one line: numbers to six digits, arrays by their shape, the beginning of others
BRIEF.maxtuple = BRIEF.maxlist = BRIEF.maxdict = 6
BRIEF.maxstring, BRIEF.maxother = 60, MOST_CHARACTERS
BRIEF.repr_float = BRIEF.repr_float64 = lambda value, level: f"{value:.6g}"
BRIEF.repr_ndarray = lambda value, level: f"array{value.shape}"


def _is_default(own: Field[Any], value: Any) -> bool:
    default = own.default if own.default_factory is MISSING else own.default_factory()
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
    digits: Mapping[str, Sequence[int]] = field(default_factory=dict)  # significant digits, by column head

    def text(self) -> str:
        """Return the table for a terminal, numbers to six digits."""
        cells = [list(self.columns), *([_shown(cell) for cell in row] for row in self.rows)]
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
        rows = ["".join(f"<td>{escape(_shown(cell))}</td>" for cell in row) for row in self.rows]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        caption = f"<caption>{escape(self.title)}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{notes}"


class Reported(Displayed, ABC):
    """Base class of results: text and HTML, JSON, a file, and a figure."""

    _drawing: ClassVar[str]  # module and name of the function that draws results by their labels
    _comparing: ClassVar[str] = ""  # of the one that draws several, if it is another

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
        return "\n".join(
            ["\n\n".join(table.text() for table in self.tables()), *(f"  note: {one}" for one in self._warnings)]
        )

    def figure(self, *others: Any, labels: Sequence[str] = ()) -> Figure:
        """Draw the result, and others of its kind over it.

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
        return self._drawn(others, labels)

    def save(self, path: str | Path) -> None:
        """Write the data of ``to_dict`` to a JSON file; one that cannot be written raises an ``InputError``."""
        write_file(check_file(path), to_json(self.to_dict()))

    @property
    def _warnings(self) -> Sequence[str]:
        return getattr(self, "warnings", ())

    def _repr_html_(self) -> str:
        """Return the table and the warnings for a notebook."""
        return self.table()._repr_html_() + "".join(f"<p>note: {escape(note)}</p>" for note in self._warnings)

    def _drawn(self, others: Sequence[Any], labels: Sequence[str], **options: Any) -> Figure:
        """Return the figure of results by label."""
        found: Figure = self._made((others and self._comparing) or self._drawing, others, labels, **options)
        return found

    def _made(self, drawing: str, others: Sequence[Any], labels: Sequence[str], **options: Any) -> Any:
        """Return what a function, ``module.name``, makes of results by label; matplotlib is imported here."""
        strange = [one for one in others if getattr(one, "_drawing", None) != self._drawing]
        if strange:
            raise InputError(f"a {type(self).__name__} cannot be drawn with a {type(strange[0]).__name__}", "figure")
        own = [self, *others]
        numbers = [str(k) for k in range(1, len(own) + 1)] if others else [""]
        names = instances(labels, "labels", str, least=0) or numbers
        if not len(set(names)) == len(names) == len(own):
            raise InputError(f"must be {len(own)} different names", "labels")
        module, name = drawing.rsplit(".", 1)
        return getattr(import_module(module), name)(dict(zip(names, own, strict=True)), **options)


def counted(count: int, noun: str) -> str:
    """Return a number of things, as ``1 mode`` or ``5 modes``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def spread(values: ArrayLike, unit: str) -> str:
    """Return the smallest and the largest of values with their unit, as ``1.85 to 88.6 Hz``."""
    ends = dict.fromkeys(f"{end(values):.4g}" for end in (np.min, np.max)) if np.size(values) else ["no"]
    return f"{' to '.join(ends)} {unit}".rstrip()


def with_error(value: float, error: float, unit: str = "") -> str:
    """Return a value with its standard error, as ``10.0013 +- 0.00026 Hz``: both have the same decimals."""
    return f"{to_width(value, error)} +- {error:.2g} {unit}".rstrip()


def to_width(value: float, width: float, digits: int = 2) -> str:
    """Return a value with some digits of an error or of the width of an interval; six of its own without one."""
    if not (math.isfinite(width) and width > 0.0 and value):
        return f"{value:.6g}"
    return f"{value:.{min(17, max(3, digits + math.ceil(math.log10(abs(value) / width))))}g}"


def known(value: float) -> float | None:
    """Return a number for JSON, None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def finite(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain data for JSON, dicts and lists nested, with None for numbers that are not finite."""
    return {key: _finite(value) for key, value in data.items()}


def to_json(value: Any) -> str:
    """Return plain data, lists and dicts nested, as JSON text; numbers that are not finite become null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False) + "\n"


def printable(text: str) -> str:
    """Return a text with escape sequences in place of control characters, which a terminal would obey."""
    return CONTROLS.sub(lambda match: ascii(match[0])[1:-1], text)


def wrapped(text: str) -> str:
    """Return a report with long lines, but for rows of tables, folded at spaces and indented by two more columns."""
    lines: list[str] = []
    width = 0  # of the last table
    for line in text.split("\n"):
        width = len(line) if set(line) == {"-"} else width
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        fold = textwrap.TextWrapper(REPORT_WIDTH, "", indent, break_long_words=False, break_on_hyphens=False).wrap
        lines += [line] if len(line) <= REPORT_WIDTH or len(line) == width else fold(line)
    return "\n".join(lines)


def _shown(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _plain_cell(cell: Cell) -> str | float | int:
    """Return a cell for CSV; an apostrophe keeps spreadsheets from computing a text as a formula."""
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
