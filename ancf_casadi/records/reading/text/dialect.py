"""Recognition of a table in text: the delimiter, the decimal sign, and the first row of numbers.

Each combination of delimiter and decimal sign splits the first lines of the file into cells.  The table is the longest
run of lines with the same number of cells, at least one of which is a number or a time.  The combination with the
smallest share of words in the table wins, and then the one with the most rows of the usual kinds of cells.  Two
combinations without words are ambiguous, and refused; a comma between two whole numbers may separate columns or
decimals, and other evidence must decide:

- ``0,05`` has a zero that no separate whole number would have, and is a decimal comma;
- a header with fewer names than cells contradicts the comma as delimiter;
- ``1,234`` in every cell with a comma may be thousands as well as decimals.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.reading.text.cells import Dialect, Kind, is_comment

DIALECTS = tuple(
    Dialect(delimiter, decimal)
    for delimiter, decimal in (
        ("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), (",", ","), (" ", "."), (" ", ","), ("|", "."),
    )
)  # fmt: skip
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+")
MANY_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d*|[+-]?\d{1,3}(?:\.\d{3})+,\d*|[+-]?\d{1,3}(?:[ ']\d{3})+")
AMBIGUOUS_COMMA = re.compile(r"[+-]?[\d,]+(?:[eE][+-]?\d+)?")
LEADING_ZERO = re.compile(r"0\d+")
SEPARATORS = "write the columns with semicolons or tabs between them, or the decimals with points"


@dataclass(frozen=True)
class TableHead:
    """A table in the first lines of a file."""

    dialect: Dialect  # separators and marks of its cells
    first: int  # index of its first row among the lines
    rows: list[list[str]]  # cells of its rows among the lines
    kinds: tuple[Kind, ...]  # content of most cells of each column

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.kinds)

    @property
    def words(self) -> float:
        """Share of columns of words."""
        return self.kinds.count("word") / self.width

    @property
    def usual_rows(self) -> int:
        """Number of rows with numbers in the columns of numbers."""
        return sum(_fits([self.dialect.kind(cell) for cell in row], self.kinds) for row in self.rows)


def find_table(lines: Sequence[str], numbers: Sequence[int], path: str) -> TableHead:
    """Return the table in the first lines of a file, with their line numbers; an ambiguity raises an ``InputError``."""
    text = "".join(lines)
    possible = [dialect for dialect in DIALECTS if dialect.delimiter in {*text, " "} and dialect.decimal in text + "."]
    runs = [run for dialect in possible if (run := _longest_run(dialect, lines))]
    if not runs:
        raise InputError("has no rows of numbers; needs a table with a row per sample", path)
    best = min(runs, key=lambda run: (run.words, run.width == 1, -run.usual_rows))
    _check_commas(best, numbers, path)
    rival = next((run for run in runs if _rivals(run, best)), None)
    if rival:
        line = lines[best.first].strip()[:40]
        raise InputError(f"line {numbers[best.first]}: the commas in {line!r} are ambiguous; {SEPARATORS}", path)
    return best


def _longest_run(dialect: Dialect, lines: Sequence[str]) -> TableHead | None:
    """Return the longest table in a dialect; None if there is no row of numbers."""
    split = [[] if is_comment(line) or not line.strip() else dialect.split(line) for line in lines]
    kinds = [[dialect.kind(cell) for cell in cells] for cells in split]
    runs: list[tuple[int, int]] = []  # first line, number of rows
    width, first, count = 0, 0, 0
    for index, row_kinds in enumerate(kinds):
        if not row_kinds:
            continue
        if len(row_kinds) == width and _is_data(row_kinds):
            count += 1
        else:
            runs.append((first, count))
            count = int(_is_data(row_kinds))
            width, first = len(row_kinds) * count, index
    runs.append((first, count))
    start, count = max(runs, key=lambda run: run[1])
    if not count:
        return None
    width = len(kinds[start])
    row_indices = [k for k in range(start, len(lines)) if len(kinds[k]) == width][:count]
    while len(row_indices) > 1 and _is_heading(kinds[row_indices[0]], kinds[row_indices[1]]):
        row_indices, start = row_indices[1:], row_indices[1]
    usual_kinds = tuple(_usual_kind([kinds[k][column] for k in row_indices]) for column in range(width))
    first = next((k for k in range(start) if len(kinds[k]) == width and _fits(kinds[k], usual_kinds)), start)
    rows = [split[k] for k in range(first, len(lines)) if len(split[k]) == width]
    return TableHead(dialect, first, rows, usual_kinds)


def _is_data(kinds: Sequence[Kind]) -> bool:
    return not {"number", "stamp", "complex"}.isdisjoint(kinds)


def _usual_kind(kinds: Sequence[Kind]) -> Kind:
    """Return the kind of most cells of a column; ``gap`` only if all cells are gaps."""
    possible: tuple[Kind, ...] = ("number", "complex", "stamp", "word")
    counts = {kind: kinds.count(kind) for kind in possible}
    commonest = max(counts, key=lambda kind: counts[kind])
    return commonest if counts[commonest] else "gap"


def _fits(kinds: Sequence[Kind], usual: Sequence[Kind]) -> bool:
    """Return whether a row has numbers in the columns of numbers."""
    pairs = [(kind, expected) for kind, expected in zip(kinds, usual, strict=True) if expected in ("number", "stamp")]
    return any(kind == expected for kind, expected in pairs) and all(
        kind in (expected, "gap") for kind, expected in pairs
    )


def _is_heading(kinds: Sequence[Kind], below: Sequence[Kind]) -> bool:
    """Return whether a row has a word above each number of the next row."""
    above = [kind for kind, next_kind in zip(kinds, below, strict=True) if next_kind == "number"]
    return bool(above) and set(above) == {"word"}


def _rivals(run: TableHead, best: TableHead) -> bool:
    """Return whether another interpretation of the commas explains the table as well."""
    if (run.dialect.delimiter == ",") == (best.dialect.delimiter == ","):
        return False
    return run.width > 1 and run.words <= best.words and len(run.rows) >= len(best.rows)


def _check_commas(run: TableHead, numbers: Sequence[int], path: str) -> None:
    """Check that commas and points can be read in one way only."""
    cells = [cell for row in run.rows for cell in row]
    where = f"{path}, line {numbers[run.first]}"
    if run.dialect.decimal == ",":
        decimals = [cell for cell in cells if "," in cell and AMBIGUOUS_COMMA.fullmatch(cell)]
        if decimals and all(THOUSANDS.fullmatch(cell) for cell in decimals):
            raise InputError(
                f"the comma in {decimals[0]!r} may separate thousands or decimals; write decimal points", where
            )
    if any(kind == "word" for kind in run.kinds):
        grouped = next((cell for cell in cells if MANY_THOUSANDS.fullmatch(cell)), None)
        if grouped:
            raise InputError(f"{grouped!r} has a separator of thousands; write numbers without it", where)
    if run.dialect == Dialect(",", ".") and any(LEADING_ZERO.fullmatch(cell) for row in run.rows for cell in row[1:]):
        raise InputError(f"its commas may separate columns or decimals; {SEPARATORS}", where)
