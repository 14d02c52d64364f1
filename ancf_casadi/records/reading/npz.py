"""NumPy files: ``.npz`` with named arrays, and ``.npy`` with one; pickled objects are refused.

Each array is checked before it is read: its header must declare the size that the archive has for it.
"""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents
from ancf_casadi.records.reading.arrays import array_contents
from ancf_casadi.records.reading.libraries import readable
from ancf_casadi.records.reading.worker import check_unpacked


def read_npz(path: Path) -> Contents:
    """Read the arrays of an ``.npz`` file.

    Raises
    ------
    InputError
        If the file is damaged, or declares more data than it holds.
    """
    arrays: list[tuple[str, NDArray[Any]]] = []
    notes: list[str] = []
    with readable(str(path), "NPZ"), zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        if not members:
            raise InputError("is a ZIP archive without NumPy arrays; export the data as CSV", str(path))
        check_unpacked(sum(member.file_size for member in members), path.stat().st_size)
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                array = _array(cast(BinaryIO, file), member.file_size, f"{path}: {name}")
            if array is None:
                notes.append(f"{name!r} holds Python objects, and is left out")
            else:
                arrays.append((name, array))
    return array_contents(arrays, notes)


def read_npy(path: Path) -> Contents:
    """Read the array of an ``.npy`` file.

    Raises
    ------
    InputError
        If the file is damaged, or holds Python objects.
    """
    with readable(str(path), "NPY"), open(path, "rb") as file:
        array = _array(file, path.stat().st_size, str(path))
        if array is None:
            raise InputError("holds Python objects, which are not read; save arrays of numbers", str(path))
    return array_contents([("values", array)])


def _array(file: BinaryIO, size: int, where: str) -> NDArray[Any] | None:
    """Return the array in a file of ``size`` bytes; None if it has Python objects."""
    content = file.read(size)
    if len(content) != size:
        raise InputError("is shorter than the archive says; it is damaged", where)
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.hasobject:
        return None
    if math.prod(shape) * dtype.itemsize != size - stream.tell():
        raise InputError("declares another size than it has; it is damaged", where)
    stream.seek(0)
    return np.asarray(npy.read_array(stream, allow_pickle=False))
