"""Results as text and files: tables for a terminal and for CSV, JSON, and files that are never half-written."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """A table with a title and notes.

    Parameters
    ----------
    name : str
        Short name, for files.
    title : str
        What it shows.
    columns : sequence of str
        Heads, with units.
    rows : sequence of sequences
        Cells: text, numbers, or None where there is nothing.
    notes : sequence of str
        What to know about it.
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
    """Return plain data as JSON text; what is not finite becomes null.

    Parameters
    ----------
    value : dict, list, str, float, int, bool or None
        The data, nested.
    """
    return json.dumps(_finite(value), indent=2, allow_nan=False) + "\n"


def check_folder(path: str | Path) -> Path:
    """Check that a folder can be written or made, before any work is done and without touching it.

    Raises
    ------
    InputError
        If it is a file, or it cannot be written.
    """
    folder = Path(path)
    existing = folder.absolute()
    while not os.path.exists(existing):  # a name that is too long is not there either
        existing = existing.parent
    if not existing.is_dir():
        raise InputError("is not a folder", str(existing))
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError("cannot be written", str(existing))
    return folder


def check_file(path: str | Path) -> Path:
    """Check that a file can be written, before any work is done and without touching it.

    Raises
    ------
    InputError
        If it is a folder, a device or a pipe, or its folder cannot be written.
    """
    target = Path(path)
    check_folder(Path(os.path.realpath(target)).parent)
    if os.path.isdir(target):
        raise InputError("is a folder", str(target))
    if os.path.exists(target) and not os.path.isfile(target):
        raise InputError("is a device or a pipe; name a file", str(target))
    return target


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file as a whole: it is complete under its name, or not there; folders are made.

    A symbolic link stays one, and what it points to is written.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    check_file(path)
    named, path = path, Path(os.path.realpath(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
            os.chmod(draft, 0o644)
            os.replace(draft, path)
        except BaseException:
            os.unlink(draft)
            raise
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", str(named)) from None


def remove_file(path: Path) -> None:
    """Remove a file, if there is one.

    Raises
    ------
    InputError
        If it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot be removed ({error.strerror or error})", str(path)) from None


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
