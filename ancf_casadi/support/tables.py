"""Results as tables for a terminal and for CSV, and as JSON."""

from __future__ import annotations

import csv
import io
import json
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

WIDTH = 100  # columns of a report on a terminal

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """A table with a title and notes.

    Parameters
    ----------
    name : str
        Short name, used for files.
    title : str
        Title of the table.
    columns : sequence of str
        Column heads with units.
    rows : sequence of sequences
        Cells: text, numbers, or None for an empty cell.
    notes : sequence of str
        Remarks below the table.
    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()

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
        writer.writerow(self.columns)
        writer.writerows([["" if cell is None else cell for cell in row] for row in self.rows])
        return out.getvalue()


def to_json(value: Any) -> str:
    """Return plain data as JSON text; numbers that are not finite become null.

    Parameters
    ----------
    value : dict, list, str, float, int, bool or None
        The data, lists and dicts nested.
    """
    return json.dumps(_finite(value), indent=2, allow_nan=False) + "\n"


def wrapped(text: str) -> str:
    """Return a report with its long lines folded at spaces; the rest of a line is indented by two more columns."""
    return "\n".join(part for line in text.split("\n") for part in _wrapped(line))


def _wrapped(line: str) -> list[str]:
    if len(line) <= WIDTH:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _shown(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
