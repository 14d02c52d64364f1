r"""Reading of tables in plain text: comma, semicolon, tab or spaces, with or without names, units and metadata.

The file is read in blocks of complete lines, which end in ``\n``, whatever the file uses.  UTF-16 is converted to
UTF-8; UTF-8 and Latin-1 stay bytes, because the numbers are the same in both.  The layout of the table follows from the
first lines (``dialect``, ``header``).  NumPy then reads blocks of plain numbers.  A block with quoted cells, words,
times, comments or a fault is split in Python, so that an error can name the line.
"""

from __future__ import annotations

import codecs
import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from tqdm import tqdm

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.reading.text.cells import (
    GAPS,
    OVERRANGE,
    Dialect,
    clock_seconds,
    is_comment,
    iso_nanoseconds,
    over_midnight,
)
from ancf_casadi.records.reading.text.dialect import TableHead, find_table
from ancf_casadi.records.reading.text.header import Head, blank_above_names, mask_unlikely, read_heading, sampling_step
from ancf_casadi.records.units import parse_unit
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.tables import plural, printable

BLOCK_BYTES = 4 * 2**20  # bytes
MAX_LINE_BYTES = 2**20  # bytes
MARKS = (
    (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32-le"), (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # fmt: skip
CLOCKS = "; write times as 2024-05-17T09:30:00.125, as 09:30:00.125, or in s"
DIGIT_BYTES = b"0123456789+-eE \t\n"
NUMBER_BYTES = {".": DIGIT_BYTES + b".", ",": DIGIT_BYTES + b","}


def text_blocks(file: BinaryIO, path: Path, *, progress: bool = False) -> Iterator[bytes]:
    """Yield blocks of complete lines of text; a line has at most 1 MiB."""
    with tqdm(
        total=path.stat().st_size, disable=None if progress else True, delay=1.0, leave=False,
        unit="B", unit_scale=True, desc=printable(path.name),
    ) as bar:  # fmt: skip
        encoding, mark = _encoding(file.read(4096))
        file.seek(mark)
        decoder = None if encoding == "utf-8" else codecs.getincrementaldecoder(encoding)(errors="replace")
        incomplete_line = b""
        while content := file.read(BLOCK_BYTES):
            bar.update(len(content))
            block = incomplete_line + (decoder.decode(content).encode(errors="replace") if decoder else content)
            if b"\0" in block:
                raise InputError("is not text, and no other format that is known", str(path))
            end = 1 + max(block.rfind(b"\n"), block.rfind(b"\r", 0, -1))  # a final \r may belong to \r\n
            incomplete_line = block[end:]
            if len(incomplete_line) > MAX_LINE_BYTES:
                raise InputError(f"has a line of more than {MAX_LINE_BYTES >> 20} MiB, and is no table", str(path))
            if end:
                yield _plain_ends(block[:end])
        if incomplete_line:
            yield _plain_ends(incomplete_line)


def decode_text(block: bytes) -> str:
    """Return a block as text: UTF-8, or Latin-1 if it is not UTF-8."""
    try:
        return block.decode()
    except UnicodeDecodeError:
        return block.decode("latin-1")


def _encoding(start: bytes) -> tuple[str, int]:
    """Return the encoding of a file, and the length of its byte-order mark."""
    for mark, encoding in MARKS:
        if start.startswith(mark):
            return encoding, len(mark)
    half = len(start) // 2
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        # more than 80 % zeros among every other byte mean UTF-16 without a byte-order mark
        if half > 3 and start[first::2].count(0) > 0.8 * half and not start[1 - first :: 2].count(0):
            return encoding, 0
    return "utf-8", 0


def _plain_ends(block: bytes) -> bytes:
    return block.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in block else block


def read_text(file: BinaryIO, path: Path, layout: TableLayout = NO_LAYOUT, *, progress: bool = False) -> Recording:
    """Read a table in plain text; an error names the line of a row with too few or too many cells."""
    blocks = _without_rows(text_blocks(file, path, progress=progress), layout.skip_rows)
    first = next(blocks, b"")
    lines, numbers = _first_lines(first)
    table = find_table(blank_above_names(lines, numbers, layout.names_row), numbers, str(path))
    above = list(zip(numbers[: table.first], lines[: table.first], strict=True))
    heading, step = read_heading(above, table, str(path), layout.names_row), sampling_step([line for _, line in above])
    skipped = numbers[table.first] - 1
    body = first.split(b"\n", skipped)[skipped]
    reader = _Reader(table, str(path))
    line, block = skipped + 1, body
    for following in blocks:
        reader.read(block, line)
        line, block = line + block.count(b"\n"), following
    reader.read(reader.without_text(block, line), line)
    return mask_unlikely(reader.contents(heading, step))


def _without_rows(blocks: Iterator[bytes], skipped: Sequence[int]) -> Iterator[bytes]:
    """Yield blocks in which the lines to leave out are empty."""
    first = 1
    for block in blocks:
        count = block.count(b"\n")
        inside = [line - first for line in skipped if first <= line <= first + count]
        if inside:
            lines = block.split(b"\n")
            for k in inside:
                lines[k] = b""
            block = b"\n".join(lines)
        first += count
        yield block


def _first_lines(block: bytes) -> tuple[list[str], list[int]]:
    """Return the first lines as text, with their numbers; a line break within quotes does not end a line."""
    start = block[:200_000]  # bytes, enough to recognise the table
    if len(start) < len(block):
        end = max(start.rfind(b"\n"), len(b"\n".join(block.split(b"\n", 4)[:4])))  # four lines at least
        start = block[:end]
    physical = decode_text(start).split("\n")[:1000]
    lines: list[str] = []
    numbers: list[int] = []
    k = 0
    while k < len(physical):
        # up to three lines may form one row with quoted line breaks
        count = next((n for n in (1, 2, 3) if "\n".join(physical[k : k + n]).count('"') % 2 == 0), 1)
        lines.append(" ".join(physical[k : k + count]))
        numbers.append(k + 1)
        k += count
    return lines, numbers


@dataclass(eq=False)
class _Reader:
    """The rows read so far."""

    table: TableHead
    path: str
    blocks: list[Array] = field(default_factory=list)
    lines: list[Index] = field(default_factory=list)
    faults: dict[int, str] = field(default_factory=dict)
    first_stamps: dict[int, int] = field(default_factory=dict)
    overrange: dict[int, int] = field(default_factory=dict)  # number of such samples by column
    notes: list[str] = field(default_factory=list)

    def read(self, block: bytes, line: int) -> None:
        """Read a block of complete lines, the first of which has the number ``line``."""
        values = self._plain(block)
        if values is None:
            self._cells(block, line)
        elif len(values):
            self.blocks.append(values)
            self.lines.append(np.arange(line, line + len(values), dtype=np.int32))

    def without_text(self, block: bytes, line: int) -> bytes:
        """Return the last block without the lines of words at its end, such as ``END``."""
        lines = decode_text(block).rstrip().split("\n")
        count = len(lines)
        while count and (not lines[count - 1].strip() or _is_text(lines[count - 1], self.table.dialect)):
            count -= 1
        first = next((k for k in range(count, len(lines)) if lines[k].strip()), None)
        if first is None:
            return block
        self.notes.append(
            f"line {line + first}, {lines[first].strip()[:40]!r}, and the lines below: not numbers, left out"
        )
        return block[: sum(len(text_line) + 1 for text_line in block.split(b"\n")[:count])]

    def _plain(self, block: bytes) -> Array | None:
        """Return the numbers (rows, width) of a block; None unless all cells are numbers or empty."""
        delimiter, decimal = self.table.dialect.delimiter, self.table.dialect.decimal
        if delimiter == decimal or "stamp" in self.table.kinds:
            return None
        if block.translate(None, NUMBER_BYTES[decimal] + delimiter.encode()):
            return None
        if decimal == ",":
            block = block.replace(b",", b".")
        if delimiter != " ":
            block = _fill_gaps(block, delimiter.encode())
        text = block.decode("ascii").rstrip("\n")
        if not text.strip() or "\n\n" in text or text[0] == "\n":
            return None
        try:
            values = np.loadtxt(
                text.split("\n"), delimiter=None if delimiter == " " else delimiter, ndmin=2, comments=None
            )
        except ValueError:
            return None
        usable = values.shape[1] == self.table.width and not np.isinf(values).any()
        return values if usable and len(values) == text.count("\n") + 1 else None

    def _cells(self, block: bytes, line: int) -> None:
        text = decode_text(block)
        columns = _columns(text, self.table.dialect, self.table.width)
        if columns is not None:
            self._add(columns, range(line, line + len(columns[0])))
            return
        rows: list[list[str]] = []
        lines: list[int] = []
        width = self.table.width
        for number, cells in _rows(text, self.table.dialect, line):
            while len(cells) > width and not cells[-1]:
                cells.pop()
            if len(cells) != width:
                fault = f"has {plural(len(cells), 'column')} where the table has {width}; complete or remove the line"
                raise InputError(fault, f"{self.path}, line {number}")
            rows.append(cells)
            lines.append(number)
        if rows:
            self._add(list(zip(*rows, strict=True)), lines)

    def _add(self, columns: Sequence[Sequence[str]], lines: Sequence[int]) -> None:
        self.blocks.append(np.column_stack([self._column(k, cells, lines) for k, cells in enumerate(columns)]))
        self.lines.append(np.array(lines, dtype=np.int32))

    def _column(self, k: int, cells: Sequence[str], lines: Sequence[int]) -> Array | ComplexArray:
        kind = self.table.kinds[k]
        if kind == "word":
            advice = CLOCKS if ":" in cells[0] else ""
            self.faults.setdefault(k, f"has words, such as {cells[0][:40]!r} in line {lines[0]}, not numbers{advice}")
            return np.full(len(cells), np.nan)
        if kind == "stamp":
            values, fault = self._stamps(k, cells)
        elif kind == "complex":
            return self._complex(k, cells, lines)
        else:
            values, fault = self.table.dialect.numbers(cells)
        if np.isnan(values).any():
            self.overrange[k] = self.overrange.get(k, 0) + sum(cell.strip().casefold() in OVERRANGE for cell in cells)
        if fault is not None:
            expected = "a time" if kind == "stamp" else "a finite number"
            self.faults.setdefault(k, f"line {lines[fault]}: {cells[fault].strip()[:40]!r} is not {expected}")
        return values

    def _complex(self, k: int, cells: Sequence[str], lines: Sequence[int]) -> ComplexArray:
        values, fault = self.table.dialect.complex_numbers(cells)
        if fault is not None:
            self.faults.setdefault(k, f"line {lines[fault]}: {cells[fault].strip()[:40]!r} is not a complex number")
        return values

    def _stamps(self, k: int, cells: Sequence[str]) -> tuple[Array, int | None]:
        """Return the times in cells, s, and None; or nan, and the index of a cell without a time."""
        clock = clock_seconds(cells)
        if clock is not None:
            return clock, None
        stamps = iso_nanoseconds(cells)
        if stamps is not None:
            return np.asarray(1e-9 * (stamps - self.first_stamps.setdefault(k, int(stamps[0])))), None
        fault = next((i for i, cell in enumerate(cells) if self.table.dialect.kind(cell) != "stamp"), 0)
        return np.full(len(cells), np.nan), fault

    def contents(self, heading: Sequence[Head], step: float | None) -> Recording:
        """Return the columns."""
        if not self.blocks:
            raise InputError("has no rows of numbers; needs a table with a row per sample", self.path)
        channels: list[RecordedChannel] = []
        imaginary: list[RecordedChannel] = []
        for k, (name, symbol, unit) in enumerate(heading):
            values = np.concatenate([block[:, k] for block in self.blocks])
            fault = self.faults.get(k, "")
            if self.table.kinds[k] == "complex":
                channels.append(RecordedChannel(k + 1, f"{name} real", values.real, symbol, unit, fault=fault))
                number = self.table.width + len(imaginary) + 1
                imaginary.append(RecordedChannel(number, f"{name} imag", values.imag, symbol, unit, fault=fault))
                continue
            values = values.real
            if self.table.kinds[k] == "gap" and np.isnan(values).all():
                continue
            if self.table.kinds[k] == "stamp":
                values = values if k in self.first_stamps else over_midnight(values)
                symbol, unit = "s", parse_unit("s")
            channels.append(RecordedChannel(k + 1, name, values, symbol, unit, fault=fault))
        notes = [
            f"{count} samples of column {heading[k][0]!r} are beyond the range, and are gaps"
            for k, count in self.overrange.items()
            if count
        ]
        lines = np.concatenate(self.lines)
        return Recording(self.path, (*channels, *imaginary), (*self.notes, *notes), lines, step)


def _is_text(line: str, dialect: Dialect) -> bool:
    """Return whether a line has words and no number."""
    cells = dialect.split(line)
    numbers = {dialect.kind(cell) for cell in cells} & {"number", "stamp", "complex"}
    return not numbers and any(cell.casefold() not in GAPS for cell in cells) and not is_comment(line)


def _fill_gaps(block: bytes, delimiter: bytes) -> bytes:
    """Return a block with nan in each empty cell."""
    for pair in (delimiter * 2, delimiter * 2, delimiter + b"\n", b"\n" + delimiter):  # twice: pairs can overlap
        if pair in block:
            block = block.replace(pair, pair[:1] + b"nan" + pair[1:])
    if block.startswith(delimiter):
        block = b"nan" + block
    return block + b"nan" if block.endswith(delimiter) else block


def _columns(text: str, dialect: Dialect, width: int) -> list[list[str]] | None:
    """Return the cells of each column, much faster than row by row; None if a row has quotes, gaps or comments."""
    if '"' in text or dialect.delimiter == " ":
        return None
    lines = text.removesuffix("\n").split("\n")
    between = width - 1
    if any(line.count(dialect.delimiter) != between or not line.strip() or is_comment(line) for line in lines):
        return None
    cells = dialect.delimiter.join(lines).split(dialect.delimiter)
    return [cells[k::width] for k in range(width)]


def _rows(text: str, dialect: Dialect, line: int) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each row that is neither blank nor a comment.

    Only ``csv``, which is slow, understands separators and line breaks in quotes; it numbers a row by its last line.
    """
    if '"' in text and dialect.delimiter != " ":
        reader = csv.reader(io.StringIO(text), delimiter=dialect.delimiter, skipinitialspace=True)
        try:
            for row in reader:
                if any(cell.strip() for cell in row) and not is_comment(row[0]):
                    yield line + reader.line_num - 1, [cell.strip() for cell in row]
        except csv.Error:
            raise InputError(f"line {line + reader.line_num}: has quotes that do not close") from None
        return
    for number, row_text in enumerate(text.split("\n"), line):
        if row_text.strip() and not is_comment(row_text):
            cells = dialect.split(row_text)
            if any(cells):
                yield number, cells
