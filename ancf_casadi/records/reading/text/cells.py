"""The cells of a table in text: splitting lines into cells, and cells into numbers, gaps, times and words.

ISO 8601 stamps (``2024-05-17T09:30:00.125``, also with a space, ``Z`` or an offset such as ``+02:00``) count in
seconds from the first one.  Clock times (``09:30:00.125``, or minutes and seconds ``30:00.125``) count from midnight;
one that falls by more than half a day belongs to the next day.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray, Index

CLOCK = re.compile(r"(?:(\d{1,3}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d*)?)")
ISO = re.compile(r"(\d{4}-\d{2}-\d{2})[T ](\d{2}:\d{2}(?::\d{2})?(?:[.,]\d{1,9})?) ?(Z|UTC|[+-]\d{2}(?::?\d{2})?)?")
HALF_DAY = 43_200.0  # s
Kind = Literal["number", "complex", "gap", "stamp", "word"]

CELL_NUMBER = {
    ".": re.compile(r"[+\-\u2212]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][+\-\u2212]?\d+)?"),
    ",": re.compile(r"[+\-\u2212]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][+\-\u2212]?\d+)?"),
}
PLAIN_CHARACTERS = str.maketrans("dD\N{MINUS SIGN}", "ee-")  # exponents of Fortran, the minus sign of word processors
GAPS = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "#nv", "missing", "nan(ind)", "-nan"})
OVERRANGE = frozenset({
    *(sign + name for sign in ("", "+", "-") for name in ("∞", "inf", "infinity", "1.#inf", "1.#inf00")),
    "overrange", "overflow", "overload", "ovrflw", "ovl", "ol", "clipped",
})  # fmt: skip
CELL_COMPLEX = re.compile(r"\(?([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([+-])\s*([\d.,]+(?:[eE][+-]?\d+)?)\s*\*?[ij]\)?")
COMMENTS = ("#", "%", "//", "!", "*")
NUMBER_CHARACTERS = frozenset("0123456789+-.eE")


def is_stamp(cell: str) -> bool:
    """Return whether a cell has a date with a time, or a clock time that is not ambiguous."""
    clock = CLOCK.fullmatch(cell)
    if clock:
        return clock[1] is not None or not clock[3].isdigit()  # 12:30 may be hours or minutes
    return ISO.fullmatch(cell) is not None


def iso_nanoseconds(cells: Sequence[str]) -> Index | None:
    """Return nanoseconds since 1970 of ISO stamps; None if one is invalid."""
    uniform = _uniform_stamps(cells)
    if uniform is not None:
        return uniform
    matches = [ISO.fullmatch(cell.strip()) for cell in cells]
    if not all(matches):
        return None
    stamp_matches = [match for match in matches if match]
    texts = [f"{match[1]}T{match[2].replace(',', '.')}" for match in stamp_matches]
    offsets = {match[3] or "" for match in stamp_matches}
    try:
        stamps: Index = np.array(texts, dtype="datetime64[ns]").astype(np.int64)
    except ValueError:
        return None
    if len(offsets) > 1:  # the clock changed, or zones are mixed
        stamps = stamps - np.array([_offset(match[3] or "") for match in stamp_matches], dtype=np.int64)
    return stamps


def _uniform_stamps(cells: Sequence[str]) -> Index | None:
    """Return nanoseconds since 1970 of stamps with the same format, much faster; None if the formats differ."""
    first = ISO.fullmatch(cells[0])
    if not first or "," in cells[0]:
        return None
    length, end, size = first.end(2), cells[0][first.end(2) :], len(cells[0])
    if any(len(cell) != size or not cell.endswith(end) for cell in cells):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns of an offset from UTC within a stamp
            return np.asarray(np.array([cell[:length] for cell in cells], dtype="datetime64[ns]").astype(np.int64))
    except (ValueError, UserWarning):
        return None


def clock_seconds(cells: Sequence[str]) -> Array | None:
    """Return seconds since midnight of clock times; None if one is invalid."""
    matches = [CLOCK.fullmatch(cell.strip()) for cell in cells]
    if not all(matches):
        return None
    times = [(int(match[1] or 0), int(match[2]), float(match[3].replace(",", "."))) for match in matches if match]
    hours, minutes, seconds = np.array(times).T
    return np.asarray(3600.0 * hours + 60.0 * minutes + seconds)


def over_midnight(seconds: Array) -> Array:
    """Return clock times with a day added at each midnight."""
    nights = np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -HALF_DAY)])
    return np.asarray(seconds + 2 * HALF_DAY * nights)


def _offset(text: str) -> int:
    """Return the nanoseconds of an offset from UTC."""
    digits = text[1:].replace(":", "")
    if not digits.isdigit():
        return 0
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:] or 0)
    return (-1 if text[0] == "-" else 1) * seconds * 10**9


@dataclass(frozen=True)
class Dialect:
    """Writing of numbers and columns."""

    delimiter: str  # character between the columns; a space stands for any run of spaces and tabs
    decimal: str  # decimal point or comma

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
        if cell.casefold() in GAPS or cell.casefold() in OVERRANGE:
            return "gap"
        if CELL_COMPLEX.fullmatch(cell):
            return "complex"
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
        values, fault = np.full(len(cells), np.nan), None
        for index, cell in enumerate(cells):
            kind = self.kind(cell.strip())
            if kind == "number":
                values[index] = float(cell.replace(self.decimal, ".").translate(PLAIN_CHARACTERS))
            if kind in ("stamp", "word", "complex") or np.isinf(values[index]):
                values[index] = np.nan
                fault = index if fault is None else fault
        return values, fault

    def complex_numbers(self, cells: Sequence[str]) -> tuple[ComplexArray, int | None]:
        """Return the numbers in cells such as ``(1e-3-4e-4j)`` or ``1 - 2i``, as ``numbers`` does."""
        matches = [CELL_COMPLEX.fullmatch(cell.strip()) for cell in cells]
        real, fault = self.numbers([match[1] if match else cell for match, cell in zip(matches, cells, strict=True)])
        imaginary, imaginary_fault = self.numbers([match[2] + match[3] if match else "0" for match in matches])
        return real + 1j * imaginary, imaginary_fault if fault is None else fault


def is_comment(line: str) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def strip_comment(line: str) -> str:
    """Return a line without the characters that mark it as a comment."""
    return line.strip().lstrip("#%/!*").strip()
