"""The cells of a table in text: splitting lines into cells, and cells into numbers, gaps, times and words."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ancf_casadi.records.reading.text.stamps import is_stamp
from ancf_casadi.support.arrays import Array

Kind = Literal["number", "gap", "stamp", "word"]

CELL_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?"),
}
GAPS = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "#nv", "missing", "nan(ind)", "-nan"})
COMMENTS = ("#", "%", "//", "!", "*")
NUMBER_CHARACTERS = frozenset("0123456789+-.eE")


@dataclass(frozen=True)
class Dialect:
    """Writing of numbers and columns.

    Parameters
    ----------
    delimiter : str
        Character between the columns; a space stands for any run of spaces and tabs.
    decimal : str
        Decimal point or comma.
    """

    delimiter: str
    decimal: str

    def split(self, line: str) -> list[str]:
        """Return the cells of a line."""
        if '"' in line:
            try:
                rows = list(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))
            except csv.Error:
                return [line.strip()]
            cells = [cell.strip() for cell in rows[0]] if rows else []
            return [cell for cell in cells if cell] if self.delimiter == " " else cells
        return line.split() if self.delimiter == " " else [cell.strip() for cell in line.split(self.delimiter)]

    def kind(self, cell: str) -> Kind:
        """Return what a cell holds."""
        if CELL_NUMBER[self.decimal].fullmatch(cell):
            return "number"
        if cell.casefold() in GAPS:
            return "gap"
        return "stamp" if is_stamp(cell) else "word"

    def numbers(self, cells: Sequence[str]) -> tuple[Array, int | None]:
        """Return the numbers in cells, nan for gaps, and the index of the first cell that is neither."""
        if self.decimal == ",":
            dotted = [cell.replace(",", ".") for cell in cells]
            plain = not any("." in cell for cell in cells)
        else:
            dotted, plain = list(cells), True
        if plain and NUMBER_CHARACTERS.issuperset("".join(dotted)):
            try:
                values = np.array(dotted, dtype=float)
            except ValueError:  # an empty cell, or a fault
                pass
            else:
                if np.isfinite(values).all():
                    return values, None
        return self._one_by_one(cells)

    def _one_by_one(self, cells: Sequence[str]) -> tuple[Array, int | None]:
        values, fault = np.full(len(cells), np.nan), None
        for index, cell in enumerate(cells):
            kind = self.kind(cell.strip())
            if kind == "number":
                values[index] = float(cell.replace(self.decimal, "."))
            if kind in ("stamp", "word") or np.isinf(values[index]):
                values[index] = np.nan
                fault = index if fault is None else fault
        return values, fault


def is_comment(line: str) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def uncommented(line: str) -> str:
    """Return a line without the characters that mark it as a comment."""
    return line.strip().lstrip("#%/!*").strip()
