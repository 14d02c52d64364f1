"""Protection of files that this package did not write."""

from __future__ import annotations

from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import opened


def check_ours(path: Path, beginning: str) -> None:
    """Check that a file is new, or begins like the files that this package writes.

    Raises
    ------
    InputError
        If the file exists and begins otherwise.
    """
    if not path.exists():
        return
    try:
        with opened(path) as file:
            ours = file.read(len(beginning)) == beginning.encode()
    except InputError:
        ours = False
    if not ours:
        raise InputError("already exists, and was not written by this export; choose another path", str(path))
