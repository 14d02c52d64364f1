"""The record of one sensor over time, from arrays or a CSV file.

The first column of a CSV file has the times, the others have displacements.  The first line may name the columns.  A
column whose name ends in ``_ms`` or ``_mm`` is in ms or mm, any other in s or m.

NumPy reads a file of plain numbers in blocks of lines.  Any other file, with quoted cells, a column of text or a fault,
is read row by row, so that an error message can name the line.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_path
from ancf_casadi.support.inputs import check_instance, located, physical

MAXIMUM_BYTES = 2**30
BLOCK = 100_000  # lines per block
PLAIN = b"0123456789+-.eE, \t\r\n"
PER_UNIT = {"ms": 1e-3, "mm": 1e-3}


@dataclass(frozen=True, eq=False, init=False)
class Measurement:
    """What one sensor measured over time.

    Parameters
    ----------
    time : array_like
        Times, s, increasing; they need not be equally spaced.  Stored as a read-only array.
    values : array_like
        Value at each time, in the SI unit of the sensor; nan marks a gap, and its sample is left out.  Stored as a
        read-only array.
    name : str
        Source of the record, for reports.
    sensor : Sensor
        What the sensor measures, and where; a displacement of the tip if not given.

    Raises
    ------
    InputError
        If the arrays are not vectors of finite numbers of one length, at least 2, or the times do not increase.
    """

    time: Array
    values: Array
    name: str
    sensor: Sensor

    def __init__(self, time: ArrayLike, values: ArrayLike, name: str = "", sensor: Sensor | None = None) -> None:
        """Validate, and store read-only copies."""
        check_instance(sensor, "sensor", Sensor, NoneType)
        times, measured = _series(time, "time"), _series(values, "values", gaps=True)
        if len(times) != len(measured):
            raise InputError(f"has {len(measured)} values for {len(times)} times", "values")
        present = ~np.isnan(measured)
        object.__setattr__(self, "time", _read_only(times[present]))
        object.__setattr__(self, "values", _read_only(measured[present]))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "sensor", sensor or Sensor())
        if len(self.time) < 2:
            raise InputError(f"needs at least 2 samples, got {len(self.time)}", "time")
        steps = np.diff(self.time)
        if steps.min() <= 0.0:
            first = int(np.argmax(steps <= 0.0))
            before, after = self.time[first], self.time[first + 1]
            raise InputError(f"must increase, but sample {first + 2} ({after:g} s) follows {before:g} s", "time")
        physical(self.time[-1] - self.time[0], "time")

    @classmethod
    def from_csv(cls, path: str | Path, column: str | None = None, *, progress: bool = False) -> Measurement:
        """Read a CSV file.

        Parameters
        ----------
        path : str or Path
            CSV file.
        column : str, optional
            Name of the displacement column; if not given, the file must have two columns.
        progress : bool
            Whether to show a progress bar on a terminal if reading takes more than a second.

        Raises
        ------
        InputError
            If the file cannot be read or is not a table of numbers (the message names the line), if there is no such
            column, or as in ``Measurement``.
        """
        check_path(path, "path")
        rows = _rows(Path(path))
        line, header = next(rows, (0, []))
        if not header:
            raise InputError("has no rows", str(path))
        named = not any(_is_number(cell) for cell in header)
        names = [cell.strip() for cell in header] if named else [f"column {i + 1}" for i in range(len(header))]
        chosen = _choose(names, column, str(path))
        above = [] if named else [_pair(header, chosen, len(names), f"{path}, line {line}")]
        below = _plain_numbers(Path(path), chosen, len(names), progress)
        if below is None:
            below = np.array([_pair(row, chosen, len(names), f"{path}, line {line}") for line, row in rows])
        time, displacement = np.concatenate([np.reshape(part, (-1, 2)) for part in (above, below)]).T
        if not len(time):
            raise InputError("has no rows below its header", str(path))
        with located(str(path)):
            return cls(time * _unit(names[0]), displacement * _unit(names[chosen]), Path(path).name)


def _series(values: ArrayLike, where: str, *, gaps: bool = False) -> Array:
    try:
        series = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError("must be a vector of numbers", where) from None
    if series.ndim != 1:
        raise InputError(f"must be a vector, got an array of shape {series.shape}", where)
    usable = np.isfinite(series) | (np.isnan(series) & gaps)
    if not usable.all():
        first = int(np.argmin(usable))
        raise InputError(f"must be finite; sample {first + 1} is {series[first]}", where)
    return series


def _read_only(series: Array) -> Array:
    series.flags.writeable = False
    return series


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each row of a CSV file that is not blank."""
    try:
        if not path.is_file():
            raise InputError("is not a file", str(path))
        if path.stat().st_size > MAXIMUM_BYTES:
            raise InputError(
                f"is larger than {MAXIMUM_BYTES >> 20} MB; shorten the record, or leave out samples", str(path)
            )
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            for row in reader:
                if any(cell.strip() for cell in row):
                    yield reader.line_num, row
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", str(path)) from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError("is not a CSV file (text, with commas between the columns)", str(path)) from None


def _plain_numbers(path: Path, chosen: int, width: int, progress: bool) -> Array | None:
    """Return times and displacements (n, 2) below the first row; None unless all cells are finite numbers."""
    blocks = [np.empty((0, 2))]
    try:
        with (
            open(path, "rb") as file,
            io.TextIOWrapper(file, encoding="utf-8-sig", newline="") as text,
            tqdm(
                total=path.stat().st_size, disable=None if progress else True, delay=1.0, leave=False,
                unit="B", unit_scale=True, desc=path.name,
            ) as bar,
        ):  # fmt: skip
            next(row for row in csv.reader(text) if any(cell.strip() for cell in row))
            while lines := list(islice(text, BLOCK)):
                filled = [line for line in lines if line.strip()]
                if "".join(filled).encode().translate(None, PLAIN):
                    return None
                block = np.loadtxt(filled, delimiter=",", ndmin=2) if filled else np.empty((0, width))
                if block.shape[1] != width:
                    return None
                blocks.append(block[:, [0, chosen]])
                bar.update(file.tell() - bar.n)
    except (ValueError, OSError):
        return None
    table = np.concatenate(blocks)
    return table if np.isfinite(table).all() else None


def _choose(names: list[str], column: str | None, where: str) -> int:
    """Return the position of the displacement column."""
    if column is None:
        if len(names) != 2:
            raise InputError(
                f"has {len(names)} columns; needs a time and a displacement, or the name of the displacement", where
            )
        return 1
    if names[1:].count(column) != 1:
        raise InputError(
            f"has {names[1:].count(column)} displacement columns named '{column}'; there are {', '.join(names[1:])}",
            where,
        )
    return names.index(column, 1)


def _pair(row: list[str], chosen: int, width: int, where: str) -> tuple[float, float]:
    """Return the time and the displacement in a row."""
    if len(row) != width:
        raise InputError(f"has {len(row)} columns where the first line has {width}", where)
    for cell in (row[0], row[chosen]):
        if not (_is_number(cell) and math.isfinite(float(cell))):
            raise InputError(f"{cell.strip()[:40]!r} is not a finite number", where)
    return float(row[0]), float(row[chosen])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _unit(name: str) -> float:
    """Return the factor to SI units from the name of a column."""
    return PER_UNIT.get(name.rpartition("_")[2], 1.0)
