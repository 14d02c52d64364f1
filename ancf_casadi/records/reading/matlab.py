"""MATLAB files: version 5 to 7 through SciPy, version 7.3 and other HDF5 files through h5py.

Vectors and matrices of numbers are read; structures, cells and objects are left out.  The sizes that the file declares
are checked before anything is read.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents
from ancf_casadi.records.reading.arrays import array_contents
from ancf_casadi.records.reading.libraries import check_unpacked, library, readable

NUMERIC = {
    "double": 8, "single": 4, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "int64": 8,
    "uint64": 8,
}  # fmt: skip
MOST_VARIABLES = 10_000


def read_matlab(path: Path) -> Contents:
    """Read the numeric variables of a MATLAB file of version 5 to 7.

    Raises
    ------
    InputError
        If the file is damaged, or declares more data than it holds.
    """
    from scipy.io import loadmat, whosmat  # slow to import, and rarely needed

    notes: list[str] = []
    with readable(str(path), "MATLAB"):
        wanted: list[str] = []
        size = 0
        for name, shape, kind in whosmat(str(path), appendmat=False):
            if kind in NUMERIC:
                wanted.append(name)
                size += math.prod(int(n) for n in shape) * NUMERIC[kind]
            else:
                notes.append(f"{name!r} is a {kind}, and is left out; save its fields as variables")
        check_unpacked(size, path.stat().st_size, str(path))
        found = loadmat(str(path), variable_names=wanted, appendmat=False) if wanted else {}
        arrays = [(name, np.asarray(found[name])) for name in wanted if name in found]
    return array_contents(arrays, notes)


def read_hdf5(path: Path) -> Contents:
    """Read the numeric data sets of a MATLAB file of version 7.3, or of any HDF5 file.

    Raises
    ------
    InputError
        If h5py is missing, the file is damaged, or it declares more data than it holds.
    """
    h5py = library("h5py", "MATLAB 7.3 and HDF5")
    arrays: list[tuple[str, NDArray[Any]]] = []
    notes: list[str] = []
    with readable(str(path), "HDF5"), h5py.File(path, "r") as file:
        found: list[Any] = []

        def visit(_: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset):
                found.append(item)
            return True if len(found) > MOST_VARIABLES else None

        file.visititems(visit)
        total = 0
        for item in found:
            name = item.name.strip("/")
            if name.startswith("#refs#") or item.attrs.get("MATLAB_class", b"") == b"char":
                continue
            if item.dtype.kind not in "fiu" or item.shape is None or item.external or item.is_virtual:
                notes.append(f"{name!r} has no numbers of its own, and is left out")
                continue
            total += item.size * item.dtype.itemsize
            check_unpacked(total, path.stat().st_size, str(path))
            arrays.append((name.replace("/", "."), np.asarray(item[()])))
    if not arrays:
        raise InputError("has no data sets of numbers", str(path))
    return array_contents(arrays, notes)
