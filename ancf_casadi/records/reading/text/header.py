"""Names and units above a table in text, and the tracks of points that they name.

The rows directly above the numbers that have as many cells as the table hold the names and, if there are two or more,
the units.  A comment can be such a row, as in the files that ``numpy.savetxt`` writes.  Everything further up is
metadata.  A unit counts only if it is certain; a doubtful one is kept as text, so that it is asked for.

Programs that track body parts or markers in videos, such as DeepLabCut and SLEAP, give the likelihood of each point.
DeepLabCut writes the rows ``scorer``, ``individuals`` (if there are several), ``bodyparts`` and ``coords`` above the
numbers; coordinates are in pixels, and the first column counts the frames.  In any table, a column such as
``tip_likelihood`` or ``tip.score`` belongs to the columns ``tip_x`` and ``tip_y``.  A point whose likelihood is below
``LEAST_LIKELIHOOD`` is a gap.

References
----------
A. Mathis et al., DeepLabCut: markerless pose estimation of user-defined body parts with deep learning, Nature
Neuroscience 21 (2018); the limit 0.6 is its default.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.text.cells import is_comment, uncommented
from ancf_casadi.records.reading.text.dialect import SEPARATORS, TableHead
from ancf_casadi.records.unit_names import names_time, unit_in_name
from ancf_casadi.records.units import Unit, parse_unit
from ancf_casadi.support.inputs import shown

BRACKETED = re.compile(r"[(\[{<][^()\[\]{}<>]*[)\]}>]")
NONE = frozenset({"", "-", "--", "[]", "()", "[-]", "(-)", "1", "none"})
ABOUT_UNITS = re.compile(r"\b(?:units?|einheit(?:en)?|unités?|unidad(?:es)?)\b", re.IGNORECASE)
LEAST_LIKELIHOOD = 0.6  # likelihood of a point that counts
LIKELIHOOD = re.compile(r"(.*[^\s_.])[ _.]+(?:likelihood|score|confidence|conf)", re.IGNORECASE | re.DOTALL)
COORDINATE = re.compile(r"(.*[^\s_.])[ _.]+[xyz](?:[ _(\[].*)?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Heading:
    """Name and unit of each column.

    Parameters
    ----------
    names : tuple of str
        Name of each column.
    symbols : tuple of str
        Unit of each as written; empty if there is none.
    units : tuple of Unit or None
        Meaning of each unit; None if there is none, or if it is not understood.
    """

    names: tuple[str, ...]
    symbols: tuple[str, ...]
    units: tuple[Unit | None, ...]


def read_heading(above: Sequence[tuple[int, str]], table: TableHead, path: str) -> Heading:
    """Return names and units from the lines above a table, given with their numbers; refuse rows of another width."""
    filled = [(number, line) for number, line in above if line.strip()]
    rows: list[list[str]] = []
    below = 0
    while filled and len(rows) < 4:
        number, line = filled[-1]
        cells = _cells(line, table)
        if cells is None or (rows and number < below - 1):
            break
        rows.insert(0, cells)
        filled.pop()
        below = number
    for number, line in filled:
        if not is_comment(line):
            _check_metadata(line, table, f"{path}, line {number}", named=bool(rows))
    heading = _heading(rows, table)
    about = next((line for _, line in filled if ABOUT_UNITS.search(line)), None)
    if about is None and not rows and filled and BRACKETED.search(filled[-1][1]):
        about = filled[-1][1]
    if about is None:
        return heading
    doubtful = shown(uncommented(about))
    return Heading(heading.names, tuple(symbol or doubtful for symbol in heading.symbols), heading.units)


def _cells(line: str, table: TableHead) -> list[str] | None:
    """Return the cells of a line that heads the table; None if it does not."""
    text = uncommented(line) if is_comment(line) else line.rstrip("\n")
    cells = table.dialect.split(text)
    if table.dialect.delimiter == " " and len(cells) != table.width:
        cells = re.split(r"\s{2,}|\t", text.strip())
        if len(cells) != table.width:
            cells = _with_units(text.split())
    if len(cells) == table.width - 1 and table.kinds[-1] == "gap":
        cells.append("")
    while len(cells) > table.width and not cells[-1]:
        cells.pop()
    if len(cells) != table.width or any(table.dialect.kind(cell) == "number" and cell != "1" for cell in cells):
        return None
    return cells if any(cells) else None


def _with_units(words: Sequence[str]) -> list[str]:
    """Return words with each unit in brackets joined to the word before it."""
    joined: list[str] = []
    for word in words:
        if joined and (BRACKETED.fullmatch(word) or joined[-1].count("(") > joined[-1].count(")")):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined


def _check_metadata(line: str, table: TableHead, where: str, *, named: bool) -> None:
    """Check that a line above the table is no row of it."""
    cells = table.dialect.split(line)
    kinds = {table.dialect.kind(cell) for cell in cells}
    if kinds <= {"number", "gap", "stamp"} and kinds & {"number", "stamp"}:
        raise InputError(f"has {_columns(len(cells))} where the table has {table.width}; remove the line", where)
    twice = table.dialect.delimiter == "," and len(cells) > 1 and table.width == 2 * len(cells)
    if not named and twice:
        raise InputError(f"names {len(cells)} columns, but the rows have {table.width} cells; {SEPARATORS}", where)


def _columns(count: int) -> str:
    return f"{count} column{'' if count == 1 else 's'}"


def _heading(rows: list[list[str]], table: TableHead) -> Heading:
    """Return names and units from the rows that head the table."""
    numbered = [f"column {k + 1}" for k in range(table.width)]
    if not rows:
        return Heading(tuple(numbered), ("",) * table.width, (None,) * table.width)
    tracks = pose_names(rows)
    if tracks:
        return Heading(*tracks, tuple(map(parse_unit, tracks[1])))
    written = _units_row(rows)
    names = numbered if written is not None and len(rows) == 1 else [row for row in rows if row is not written][-1]
    names = [name or default for name, default in zip(names, numbered, strict=True)]
    found = [unit_in_name(name) for name in names]
    if written is None:
        return Heading(tuple(names), tuple(text for text, _ in found), tuple(unit for _, unit in found))
    symbols, units = [], []
    for cell, (text, unit) in zip(written, found, strict=True):
        plain = "" if cell in NONE else cell.strip("()[]{}<>").strip()
        symbols.append(plain or text)
        units.append(parse_unit(plain) if plain else unit)
    return Heading(tuple(names), tuple(symbols), tuple(units))


def _units_row(rows: list[list[str]]) -> list[str] | None:
    """Return the row with the units: the one whose cells are most often units; of two other rows, the lower one."""
    for row in reversed(rows):
        filled = [cell for cell in row if cell not in NONE]
        units = [cell for cell in filled if parse_unit(cell) or BRACKETED.fullmatch(cell)]
        if filled and 2 * len(units) >= len(filled) and (len(rows) > 1 or len(units) == len(row)):
            return row
    if len(rows) == 1 or any(names_time(cell) or unit_in_name(cell)[1] for cell in rows[-1]):
        return None
    return rows[-1]


def pose_names(rows: Sequence[Sequence[str]]) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return names and units of the columns below a DeepLabCut header; None if the rows are none."""
    if len(rows) < 2 or rows[-1][0].casefold() != "coords":
        return None
    parts = [row for row in rows if row[0].casefold() in ("individuals", "bodyparts", "coords")]
    names = ["frame", *(" ".join(cells) for cells in zip(*(row[1:] for row in parts), strict=True))]
    return tuple(names), tuple("px" if COORDINATE.fullmatch(name) else "" for name in names)


def without_unlikely(contents: Contents) -> Contents:
    """Return the columns with gaps where the likelihood of a point is low, and without the likelihoods."""
    likelihoods = {}
    for channel in contents.channels:
        match = LIKELIHOOD.fullmatch(channel.name)
        if match and not channel.fault:
            likelihoods[match[1].casefold()] = channel
    tracks = {match[1].casefold() for channel in contents.channels if (match := COORDINATE.fullmatch(channel.name))}
    likelihoods = {stem: channel for stem, channel in likelihoods.items() if stem in tracks}
    if not likelihoods:
        return contents
    masked: list[RecordedChannel] = []
    points = 0
    for channel in contents.channels:
        match = COORDINATE.fullmatch(channel.name)
        likelihood = likelihoods.get(match[1].casefold()) if match else None
        if likelihood and not channel.fault:
            doubtful = ~(likelihood.values >= LEAST_LIKELIHOOD)
            points += int(np.sum(doubtful & ~np.isnan(channel.values)))
            channel = replace(channel, values=np.where(doubtful, np.nan, channel.values))
        if channel not in likelihoods.values():
            masked.append(channel)
    note = f"{points} coordinates with a likelihood below {LEAST_LIKELIHOOD:g} are gaps"
    return Contents(tuple(masked), (*contents.notes, note), contents.lines)
