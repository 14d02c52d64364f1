"""Recognition of the format of a file, and the choice of its reader."""

from __future__ import annotations

from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents
from ancf_casadi.records.reading.text import read_text
from ancf_casadi.support.files import check_path

MOST_BYTES = 2**30


def read_contents(path: str | Path, *, progress: bool = False) -> Contents:
    """Read all columns of a file.

    Raises
    ------
    InputError
        If the file cannot be read, is larger than 1 GiB, or is in no known format.
    """
    check_path(path, "path")
    file = Path(path)
    try:
        if not file.is_file():
            raise InputError("is not a file", str(path))
        if file.stat().st_size > MOST_BYTES:
            raise InputError(
                f"is larger than {MOST_BYTES >> 20} MB; shorten the record, or leave out samples", str(path)
            )
        return read_text(file, progress=progress)
    except (OSError, ValueError) as error:  # a name with a null character raises ValueError
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", str(path)) from None
