"""Names and units above a table in text, and the tracks of points that they name.

Rows directly above the numbers with as many cells as the table hold the names and, if there are two or more, the units.
A comment can be such a row, as in the files that ``numpy.savetxt`` writes.  Lines further up are metadata.  A unit
counts only if it is certain; a doubtful one is kept as text, and the user must state it.  So is a unit that the
metadata state for the whole file, at a column whose name denotes another quantity, such as ``vx`` below ``Units: mm``.

Programs that track body parts or markers in videos, such as DeepLabCut and SLEAP, give the likelihood of each point.
DeepLabCut writes the rows ``scorer``, ``individuals`` (if there are several), ``bodyparts`` and ``coords`` above the
numbers; coordinates are in pixels, and the first column counts the frames.  In any table, a column such as
``tip_likelihood`` or ``tip.score`` belongs to the columns ``tip_x`` and ``tip_y``.  A point whose likelihood is below
``MIN_LIKELIHOOD`` is a gap.  Likelihoods clearly above 1 are in percent.

References
----------
A. Mathis et al., DeepLabCut: markerless pose estimation of user-defined body parts with deep learning, Nature
Neuroscience 21 (2018); the limit 0.6 is its default.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import COUNTER_NAME, RecordedChannel, Recording
from ancf_casadi.records.reading.text.cells import is_comment, strip_comment
from ancf_casadi.records.reading.text.dialect import SEPARATORS, TableHead
from ancf_casadi.records.sensor import contradicts
from ancf_casadi.records.units import (
    Unit,
    column_unit,
    names_time,
    parse_unit,
    sampling_unit,
    step_between_samples,
    unit_in_name,
)
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.tables import plural

BRACKETED = re.compile(r"[(\[{<][^()\[\]{}<>]*[)\]}>]")
NONE = frozenset({"", "-", "--", "[]", "()", "[-]", "(-)", "1", "none", "Value", "Values", "value", "values"})
ABOUT_UNITS = re.compile(r"\b(?:units?|einheit(?:en)?|unités?|unidad(?:es)?)\b", re.IGNORECASE)
STATED_UNIT = re.compile(rf".*(?:{ABOUT_UNITS.pattern})\s*[,;:=\t]?\s*\"?([^\s,;:=\"]+)\"?[\s,;]*", re.IGNORECASE)
AXIS_STATED = re.compile(
    r"([xy])[ -]?axis(?:[ -]units?)?\s*[:=](?:.*\s)?\s*[\"\[(]*([^\s\"\])]+)[\"\])]*", re.IGNORECASE
)
AXIS = re.compile(r"(?:pos(?:ition)?[ _.]*)?[xyz]\d*", re.IGNORECASE)
BEFORE_VALUE = r"\"?\s*(?:\((?:hz|s|sec)\)|\[(?:hz|s|sec)\])?\s*([,;:=\t ])\s*\"?(?=\d)(.*)"
RATE = re.compile(  # the last word in files of Vicon
    r"\"?(?:(?:sampl\w*|camera|capture|data|export|scan)[ _-]?(?:rate|freq(?:uency)?)|frame[ _-]?rate|"
    rf"abtast(?:rate|frequenz)|messrate|fs|fps|trajectories){BEFORE_VALUE}", re.IGNORECASE,
)  # fmt: skip
STEP = re.compile(
    r"\"?(?:(?:sampl\w*|horizontal|time)[ _-]?(?:interval|period|step|increment|cycle)|(?:x[ _-]?)?increment|"
    rf"x[ _-]?incr?|delta[ _]?[xt]|dt|t[ _]?inc|abtastintervall){BEFORE_VALUE}", re.IGNORECASE,
)  # fmt: skip
FREQUENCY = re.compile(rf"\"?frequency{BEFORE_VALUE}", re.IGNORECASE)  # of QTM; with a unit, it may be any frequency
VALUE = re.compile(r"(\d+(?:[.,]\d+)?)\.?(e[+-]?\d+)?\"?(?:$|([ ,;\t]*)[(\[]?([^\s,;\"()\[\]]*)(.*))", re.IGNORECASE)
IN_WORDS = re.compile(r"(?:samples?|frames?)(?: ?(?:/|per) ?s(?:ec(?:onds?)?)?)?", re.IGNORECASE)
MIN_LIKELIHOOD = 0.6  # likelihood of a point that counts
MAX_LIKELIHOOD = 1.5  # largest score of a network that may exceed 1; percent are larger
LIKELIHOOD = re.compile(r"(.*[^\s_.])[ _.]+(?:likelihood|score|confidence|conf)", re.IGNORECASE | re.DOTALL)
COORDINATE = re.compile(r"(.*[^\s_.])[ _.]+[xyz](?:[ _(\[].*)?", re.IGNORECASE | re.DOTALL)
Head = tuple[str, str, Unit | None]  # name of a column, its unit as written, and the meaning of the unit


def read_heading(above: Sequence[tuple[int, str]], table: TableHead, path: str, names_row: int | None) -> list[Head]:
    """Return names and units from the numbered lines above a table; the line ``names_row`` holds the names, if given.

    Without rows of names or units, a row of numbers above the table raises an ``InputError``.
    """
    filled = [(number, line) for number, line in above if line.strip()]
    rows: list[list[str]] = []
    if names_row is not None:
        rows = [cells for number, line in filled if number > names_row and (cells := _cells(line, table))]
        rows.insert(0, _named_row(filled, names_row, table, path))
        filled = [(number, line) for number, line in filled if number < names_row]
    number_below = 0
    while filled and names_row is None and len(rows) < 8:
        number, line = filled[-1]
        cells = _cells(line, table)
        if cells is None or (rows and (number < number_below - 1 or STATED_UNIT.fullmatch(strip_comment(line)))):
            break
        rows.insert(0, _without_numbers(cells, table))
        filled.pop()
        number_below = number
    for number, line in filled:
        if not is_comment(line) and not rows:
            _check_metadata(line, table, f"{path}, line {number}")
    metadata = [strip_comment(line) for _, line in filled]
    matches = [match for text in _statements(metadata) if (match := STATED_UNIT.fullmatch(text.strip()))]
    units = [unit for match in matches if (unit := parse_unit(match[1]))]
    stated = {unit.quantity: unit for unit in units}
    for unit in units:
        if unit.factor != stated.get(unit.quantity, unit).factor:
            del stated[unit.quantity]  # lines that contradict each other state nothing
    heading = _with_marker_names(_heading(rows, table), metadata)
    if (completed := _with_axis_units(heading, metadata)) != heading:
        return completed
    about = next((line for line in metadata if ABOUT_UNITS.search(line)), None)
    sampled = sampling_step([line for _, line in above]) is not None  # so that no column needs to be the time
    if about and stated and (completed := _with_stated_units(heading, stated, shown(about), sampled)) != heading:
        return completed
    if about is None and not rows and filled and BRACKETED.search(filled[-1][1]):
        about = filled[-1][1]
    if about is None:
        return heading
    doubtful = shown(strip_comment(about))
    return [(name, symbol or doubtful, unit) for name, symbol, unit in heading]


def blank_above_names(lines: Sequence[str], numbers: Sequence[int], names_row: int | None) -> list[str]:
    """Return the lines of a file, with empty lines down to the row of the names if it is given."""
    return [
        line if names_row is None or number > names_row else "" for line, number in zip(lines, numbers, strict=True)
    ]


def _named_row(filled: Sequence[tuple[int, str]], names_row: int, table: TableHead, path: str) -> list[str]:
    """Return the cells of the row with the names."""
    line = next((line for number, line in filled if number == names_row), "")
    cells = table.dialect.split(strip_comment(line) if is_comment(line) else line)
    while len(cells) > table.width and not cells[-1]:
        cells.pop()
    if table.dialect.delimiter != " ":
        cells += [""] * (table.width - len(cells))
    if len(cells) != table.width:
        fault = f"has {plural(len(cells), 'name')} for {plural(table.width, 'column')}; name another with --names-row"
        raise InputError(fault, f"{path}, line {names_row}")
    return cells


def _without_numbers(cells: Sequence[str], table: TableHead) -> list[str]:
    return ["" if kind == "gap" and table.dialect.kind(cell) == "number" else cell
            for cell, kind in zip(cells, table.kinds, strict=True)]  # fmt: skip


def _cells(line: str, table: TableHead) -> list[str] | None:
    """Return the cells of a line with names or units of the table; None for any other line."""
    text = strip_comment(line) if is_comment(line) else line.rstrip("\n")
    cells = table.dialect.split(text)
    if table.dialect.delimiter == " " and len(cells) != table.width:
        cells = re.split(r"\s{2,}|\t", text.strip())
        if len(cells) != table.width:
            cells = _with_units(text.split())
    if len(cells) == table.width - 1 and table.kinds[-1] == "gap":
        cells.append("")
    while len(cells) > table.width and not cells[-1]:
        cells.pop()
    if len(cells) != table.width or (table.width == 1 and _has_number(table, text.split())):
        return None
    if _has_number(table, [cell for cell, kind in zip(cells, table.kinds, strict=True) if kind != "gap"]):
        return None
    return cells if any(cells) else None


def _has_number(table: TableHead, cells: Sequence[str]) -> bool:
    return any(table.dialect.kind(cell) == "number" and cell != "1" for cell in cells)


def _statements(lines: Sequence[str]) -> list[str]:
    """Return the texts of metadata in which to look for ``name: value``, the most certain ones first.

    These are whole lines, the pieces between separators, and two neighbouring pieces, in a line or below each other.
    """
    texts = [strip_comment(line).rstrip(",; \t") for line in lines]
    pieces = [re.split(r"\s{2,}|[\t,;]\s*", text) for text in texts]
    below = [(upper, lower) for upper, lower in pairwise(pieces) if len(upper) == len(lower)]
    pairs = [*(pair for cells in pieces for pair in pairwise(cells)),
             *(pair for upper, lower in below for pair in zip(upper, lower, strict=True))]  # fmt: skip
    return [*texts, *(piece for cells in pieces for piece in cells), *(f"{name}: {value}" for name, value in pairs)]


def sampling_step(lines: Sequence[str]) -> float | None:
    """Return the time between samples, s, from a rate, step or increment in the lines above a table.

    The first statement counts, those of a rate first; a number with a unit of time is a step, whatever it is called.
    One whose number or unit is in doubt counts for nothing.
    """
    statements = [statement.strip() for statement in _statements(lines)]
    for pattern, quantity in ((RATE, "frequency"), (STEP, "time"), (FREQUENCY, "frequency")):
        if match := next(filter(None, map(pattern.match, statements)), None):
            step = _stated_step(match[1], match[2], quantity, with_unit=pattern is not FREQUENCY)
            if not np.isnan(step):
                return step
    return None


def _stated_step(separator: str, text: str, quantity: str, *, with_unit: bool) -> float:
    """Return the time between samples, s, from a number at the beginning of a text; nan if it or its unit is in doubt.

    A comma is a decimal one unless commas separate the pieces of the line.
    """
    match = VALUE.match(text.replace(",", ";") if separator == "," else text)
    if not match:
        return np.nan
    digits, exponent, gap, symbol, remainder = match.groups(default="")
    if re.fullmatch(r"\d+,\d{3}", digits):
        return np.nan  # a comma may separate thousands or decimals
    number, unit = float(digits.replace(",", ".") + exponent), sampling_unit(symbol)
    if unit:
        return step_between_samples(number, quantity, unit) if with_unit else np.nan
    # the next piece of the line says something else
    apart = not symbol or set(gap) & set(",;\t")
    words = quantity == "frequency" and IN_WORDS.fullmatch((symbol + remainder).strip())
    return step_between_samples(number, quantity) if apart or words else np.nan


def _with_stated_units(heading: Sequence[Head], stated: Mapping[str, Unit], doubtful: str, sampled: bool) -> list[Head]:
    """Give columns without a unit the unit that the metadata state for their quantity, or else the doubtful text."""
    values = [unit for quantity, unit in stated.items() if quantity != "time"]
    times = [unit.quantity == "time" if unit else names_time(name) for name, _, unit in heading]
    counts = [bool(COUNTER_NAME.fullmatch(name)) for name, _, _ in heading]
    value = values[0] if len(values) == 1 and (sampled or any(times) or counts.count(False) == 1) else None
    units = [
        None if is_counter else stated.get("time") if is_time else value
        for is_counter, is_time in zip(counts, times, strict=True)
    ]
    return [
        (name, symbol, unit)
        if symbol or not stated_unit
        else (name, doubtful, None)
        if contradicts(name, stated_unit)
        else (name, stated_unit.symbol, stated_unit)
        for (name, symbol, unit), stated_unit in zip(heading, units, strict=True)
    ]


def _with_marker_names(heading: list[Head], metadata: Sequence[str]) -> list[Head]:
    """Return the heading of a file from QTM (Qualisys), which lists its markers above X, Y and Z of each, in mm."""
    cells = next((cells for line in metadata if (cells := line.split("\t"))[0] == "MARKER_NAMES"), [])
    names = [f"{marker} {axis}" for marker in cells[1:] if marker for axis in "XYZ"]
    leading = len(heading) - len(names)  # frame and time may precede them
    if not names or leading not in (0, 2):
        return heading
    return [*heading[:leading], *((name, "mm", parse_unit("mm")) for name in names)]


def _with_axis_units(heading: list[Head], metadata: Sequence[str]) -> list[Head]:
    """Give the columns X and Y, or two columns without names, the units in lines such as ``Y-axis: Acceleration g``."""
    matches = [match for text in metadata if (match := AXIS_STATED.fullmatch(text.strip()))]
    stated = {match[1].casefold(): unit for match in matches if (unit := parse_unit(match[2]))}
    names = [name.casefold() for name, _, _ in heading]
    axes = ["x", "y"] if names == ["column 1", "column 2"] else names
    if len(stated) < 2 or any(symbol for _, symbol, _ in heading):
        return heading
    units = [stated.get(axis) for axis in axes]
    return [(head[0], unit.symbol, unit) if unit else head for head, unit in zip(heading, units, strict=True)]


def _with_units(words: Sequence[str]) -> list[str]:
    """Return words with each unit in brackets joined to the word before it."""
    joined: list[str] = []
    for word in words:
        if joined and (BRACKETED.fullmatch(word) or joined[-1].count("(") > joined[-1].count(")")):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined


def _check_metadata(line: str, table: TableHead, where: str) -> None:
    """Check that a line above the table is not one of its rows."""
    cells = table.dialect.split(line)
    kinds = {table.dialect.kind(cell) for cell in cells}
    if kinds <= {"number", "gap", "stamp"} and kinds & {"number", "stamp"}:
        raise InputError(
            f"has {plural(len(cells), 'column')} where the table has {table.width}; remove the line, or "
            "leave it out with --skip-rows",
            where,
        )
    twice = table.dialect.delimiter == "," and len(cells) > 1 and table.width == 2 * len(cells)
    if twice:
        raise InputError(f"names {len(cells)} columns, but the rows have {table.width} cells; {SEPARATORS}", where)


def _heading(rows: list[list[str]], table: TableHead) -> list[Head]:
    """Return names and units from the heading rows of the table."""
    numbered = [f"column {k + 1}" for k in range(table.width)]
    if not rows:
        return [(name, "", None) for name in numbered]
    tracks = _pose_heading(rows)
    if tracks:
        return tracks
    written = _units_row(rows)
    names = _names([row for row in rows if row is not written], table.width)
    symbols = ["" if cell in NONE else cell.strip("()[]{}<>").strip() for cell in written or [""] * table.width]
    counters = [bool(COUNTER_NAME.fullmatch(symbol)) for symbol in symbols]  # such as Sequence in place of a unit
    names = [symbol if counts else name for counts, symbol, name in zip(counters, symbols, names, strict=True)]
    symbols = ["" if counts else symbol for counts, symbol in zip(counters, symbols, strict=True)]
    names = [name or default for name, default in zip(names, numbered, strict=True)]
    return [(name, *column_unit(symbol, name)) for name, symbol in zip(names, symbols, strict=True)]


def _names(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return the names in the lowest of several rows, preceded by the cells above if names are missing or equal.

    A cell above several columns, such as the name of a marker above its coordinates, stands above the first of them.
    """
    if not rows:
        return [""] * width
    names = list(rows[-1])
    for row in reversed(rows[:-1]):
        lowest = [name for name in names if name]
        if len(set(lowest)) == len(lowest) == width:
            break
        spread = list(row)
        for k in range(1, width):
            spread[k] = spread[k] or (spread[k - 1] if names[k] else "")
        joined = [f"{above} {name}".strip() for above, name in zip(spread, names, strict=True)]
        if len(set(joined)) > len(set(names)) or not all(names):
            names = joined
    return names


def _units_row(rows: list[list[str]]) -> list[str] | None:
    """Return the lowest row in which at least half of the cells are units, or else the lower of two rows of words."""
    for row in reversed(rows):
        filled = [cell for cell in row if cell not in NONE and not COUNTER_NAME.fullmatch(cell)]
        units = [cell for cell in filled if parse_unit(cell) or BRACKETED.fullmatch(cell)]
        if filled and 2 * len(units) >= len(filled) and (len(rows) > 1 or len(units) == len(row)):
            return row
    if len(rows) == 1 or any(names_time(cell) or AXIS.fullmatch(cell) or unit_in_name(cell)[1] for cell in rows[-1]):
        return None
    return rows[-1]


def _pose_heading(rows: Sequence[Sequence[str]]) -> list[Head]:
    """Return names and units of the columns below a DeepLabCut header; empty for another header."""
    if len(rows) < 2 or rows[-1][0].casefold() != "coords":
        return []
    name_rows = [row for row in rows if row[0].casefold() in ("individuals", "bodyparts", "coords")]
    names = ["frame", *(" ".join(cells) for cells in zip(*(row[1:] for row in name_rows), strict=True))]
    return [(name, "px", parse_unit("px")) if COORDINATE.fullmatch(name) else (name, "", None) for name in names]


def mask_unlikely(recording: Recording) -> Recording:
    """Return the columns without likelihoods, with gaps in place of points with a low likelihood."""
    usable = [(LIKELIHOOD.fullmatch(channel.name), channel) for channel in recording.channels if not channel.fault]
    tracks = {match[1].casefold() for channel in recording.channels if (match := COORDINATE.fullmatch(channel.name))}
    likelihoods = {stem: channel for match, channel in usable if match and (stem := match[1].casefold()) in tracks}
    if not likelihoods:
        return recording
    largest = max(float(np.nanmax(channel.values, initial=0.0)) for channel in likelihoods.values())
    if largest > 100.0:
        raise InputError(
            f"has likelihoods of points up to {largest:g}, beyond 1 and 100 %; remove them", recording.path
        )
    percent = largest > MAX_LIKELIHOOD
    masked: list[RecordedChannel] = []
    points = 0
    for channel in recording.channels:
        match = COORDINATE.fullmatch(channel.name)
        likelihood = likelihoods.get(match[1].casefold()) if match else None
        if likelihood and not channel.fault:
            doubtful = ~(likelihood.values >= MIN_LIKELIHOOD * (100.0 if percent else 1.0))
            points += int(np.sum(doubtful & ~np.isnan(channel.values)))
            channel = replace(channel, values=np.where(doubtful, np.nan, channel.values))
        if channel not in likelihoods.values():
            masked.append(channel)
    limit = f"{100 * MIN_LIKELIHOOD:g} %" if percent else f"{MIN_LIKELIHOOD:g}"
    note = f"{points} coordinates with a likelihood below {limit} are gaps"
    return replace(recording, channels=tuple(masked), notes=(*recording.notes, note))
