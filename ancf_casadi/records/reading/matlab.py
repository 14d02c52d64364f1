"""MATLAB files: version 4 to 7 through SciPy, version 7.3 and other HDF5 files through h5py.

Vectors and matrices of numbers are read; structures, cells, objects and links to other files are left out.
"""

from __future__ import annotations

from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents
from ancf_casadi.records.reading.arrays import array_contents
from ancf_casadi.records.reading.isolated import read_isolated


def read_matlab(path: Path) -> Contents:
    """Read the numeric variables of a MATLAB file of version 4 to 7.

    Raises
    ------
    InputError
        If the file is damaged, or declares more data than it holds.
    """
    arrays, properties = read_isolated("matlab", "scipy", path, "MATLAB")
    return array_contents(arrays.items(), properties["notes"])


def read_hdf5(path: Path) -> Contents:
    """Read the numeric data sets of a MATLAB file of version 7.3, or of any HDF5 file.

    Raises
    ------
    InputError
        If h5py is missing, the file is damaged, or it declares more data than it holds.
    """
    arrays, properties = read_isolated("hdf5", "h5py", path, "HDF5")
    if not arrays:
        raise InputError("has no data sets of numbers", str(path))
    return array_contents(arrays.items(), properties["notes"])
