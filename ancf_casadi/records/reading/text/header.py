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
from dataclasses import replace

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.reading.text.cells import is_comment, uncommented
from ancf_casadi.records.reading.text.dialect import SEPARATORS, TableHead
from ancf_casadi.records.units import Unit, names_time, parse_unit, unit_in_name, unit_of
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.tables import counted

BRACKETED = re.compile(r"[(\[{<][^()\[\]{}<>]*[)\]}>]")
NONE = frozenset({"", "-", "--", "[]", "()", "[-]", "(-)", "1", "none"})
ABOUT_UNITS = re.compile(r"\b(?:units?|einheit(?:en)?|unités?|unidad(?:es)?)\b", re.IGNORECASE)
LEAST_LIKELIHOOD = 0.6  # likelihood of a point that counts
LIKELIHOOD = re.compile(r"(.*[^\s_.])[ _.]+(?:likelihood|score|confidence|conf)", re.IGNORECASE | re.DOTALL)
COORDINATE = re.compile(r"(.*[^\s_.])[ _.]+[xyz](?:[ _(\[].*)?", re.IGNORECASE | re.DOTALL)
Head = tuple[str, str, Unit | None]  # name of a column, its unit as written, and the meaning of the unit


def read_heading(above: Sequence[tuple[int, str]], table: TableHead, path: str) -> list[Head]:
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
    return [(name, symbol or doubtful, unit) for name, symbol, unit in heading]


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
        raise InputError(
            f"has {counted(len(cells), 'column')} where the table has {table.width}; remove the line", where
        )
    twice = table.dialect.delimiter == "," and len(cells) > 1 and table.width == 2 * len(cells)
    if not named and twice:
        raise InputError(f"names {len(cells)} columns, but the rows have {table.width} cells; {SEPARATORS}", where)


def _heading(rows: list[list[str]], table: TableHead) -> list[Head]:
    """Return names and units from the rows that head the table."""
    numbered = [f"column {k + 1}" for k in range(table.width)]
    if not rows:
        return [(name, "", None) for name in numbered]
    tracks = _pose_heading(rows)
    if tracks:
        return tracks
    written = _units_row(rows)
    names = numbered if written is not None and len(rows) == 1 else [row for row in rows if row is not written][-1]
    names = [name or default for name, default in zip(names, numbered, strict=True)]
    symbols = ["" if cell in NONE else cell.strip("()[]{}<>").strip() for cell in written or [""] * table.width]
    return [(name, *unit_of(symbol, name)) for name, symbol in zip(names, symbols, strict=True)]


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


def _pose_heading(rows: Sequence[Sequence[str]]) -> list[Head]:
    """Return names and units of the columns below a DeepLabCut header; empty if the rows are none."""
    if len(rows) < 2 or rows[-1][0].casefold() != "coords":
        return []
    parts = [row for row in rows if row[0].casefold() in ("individuals", "bodyparts", "coords")]
    names = ["frame", *(" ".join(cells) for cells in zip(*(row[1:] for row in parts), strict=True))]
    return [(name, "px", parse_unit("px")) if COORDINATE.fullmatch(name) else (name, "", None) for name in names]


def without_unlikely(found: Recording) -> Recording:
    """Return the columns with gaps where the likelihood of a point is low, and without the likelihoods."""
    usable = [(LIKELIHOOD.fullmatch(channel.name), channel) for channel in found.channels if not channel.fault]
    tracks = {match[1].casefold() for channel in found.channels if (match := COORDINATE.fullmatch(channel.name))}
    likelihoods = {stem: channel for match, channel in usable if match and (stem := match[1].casefold()) in tracks}
    if not likelihoods:
        return found
    masked: list[RecordedChannel] = []
    points = 0
    for channel in found.channels:
        match = COORDINATE.fullmatch(channel.name)
        likelihood = likelihoods.get(match[1].casefold()) if match else None
        if likelihood and not channel.fault:
            doubtful = ~(likelihood.values >= LEAST_LIKELIHOOD)
            points += int(np.sum(doubtful & ~np.isnan(channel.values)))
            channel = replace(channel, values=np.where(doubtful, np.nan, channel.values))
        if channel not in likelihoods.values():
            masked.append(channel)
    note = f"{points} coordinates with a likelihood below {LEAST_LIKELIHOOD:g} are gaps"
    return replace(found, channels=tuple(masked), notes=(*found.notes, note))
