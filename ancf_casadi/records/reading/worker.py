"""Reading by compiled libraries, in a process of its own.

A damaged file can crash SciPy, h5py or ezc3d with the whole process, or make them allocate or loop without end.  This
file therefore also runs as a script, with limits of memory and time, and imports nothing of the toolkit, so that it
starts quickly.  It prints one line of JSON, with names, shapes and properties, and then the numbers as 8-byte floats.
``libraries`` is the other side.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_DATA_BYTES = 2**30  # bytes that the data of a file may take
MOST_ITEMS = 10_000
NUMERIC = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
Found = tuple[list[tuple[str, NDArray[Any]]], dict[str, Any]]  # named arrays, and properties


class Unusable(Exception):
    """The reason why a file is refused."""


def check_unpacked(size: int, packed: int) -> None:
    """Refuse ``size`` bytes of data that a file of ``packed`` bytes cannot hold, or of more than 1 GiB."""
    if size > 1100 * packed:  # unpacked bytes per byte of a compressed file; deflate reaches 1032
        raise Unusable(f"declares {size} bytes of data, which its {packed} bytes cannot hold; it is damaged")
    if size > MOST_DATA_BYTES:
        raise Unusable(f"unpacks to more than {MOST_DATA_BYTES >> 20} MB; shorten the record")


def matlab(path: str) -> Found:
    """Return the numeric variables of a MATLAB file of version 4 to 7."""
    from scipy.io import loadmat, whosmat

    wanted: list[str] = []
    notes: list[str] = []
    size = 0
    for name, shape, kind in whosmat(path, appendmat=False):
        if kind in NUMERIC and len(wanted) < MOST_ITEMS:
            wanted.append(name)
            size += math.prod(int(n) for n in shape) * np.dtype(kind).itemsize
        else:
            notes.append(f"{name!r} is a {kind}, and is left out; save its fields as variables")
    check_unpacked(size, os.path.getsize(path))
    found = loadmat(path, variable_names=wanted, appendmat=False) if wanted else {}
    return [(name, found[name]) for name in wanted if name in found], {"notes": notes}


def hdf5(path: str) -> Found:
    """Return the numeric data sets of a MATLAB file of version 7.3, or of any HDF5 file."""
    h5py = importlib.import_module("h5py")

    arrays: list[tuple[str, NDArray[Any]]] = []
    notes: list[str] = []
    with h5py.File(path, "r") as file:
        found: list[Any] = []

        def visit(_: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset):
                found.append(item)
            return True if len(found) >= MOST_ITEMS else None

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
            check_unpacked(total, os.path.getsize(path))
            arrays.append((name.replace("/", "."), item[()]))
    return arrays, {"notes": notes}


def c3d(path: str) -> Found:
    """Return the points (3, markers, frames), nan where not seen, and the analog channels of a C3D file."""
    ezc3d = importlib.import_module("ezc3d")

    file = ezc3d.c3d(path)
    points = np.array(file["data"]["points"][:3], dtype=float)
    points[:, file["data"]["meta_points"]["residuals"][0] < 0.0] = np.nan
    properties = {
        f"{group} {name}": np.ravel(file["parameters"].get(group, {}).get(name, {}).get("value", [])).tolist()
        for group in ("POINT", "ANALOG")
        for name in ("RATE", "UNITS", "LABELS")
    }
    return [("points", points), ("analogs", file["data"]["analogs"][0])], properties


READERS: Mapping[str, Callable[[str], Found]] = {"matlab": matlab, "hdf5": hdf5, "c3d": c3d}


def limit(path: str) -> None:
    """Limit memory and processor time of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    size = os.path.getsize(path)
    memory = min((2**30) + 64 * size, 6 * 2**30)  # bytes for the library, beside 64 per byte of the file
    seconds = 3 + size // (2**21)  # processor time: a base, and 2 MB/s, which a slow library reads
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def main(arguments: Sequence[str]) -> int:
    """Read a file, and print what was found; or print the reason for a refusal, and return 1."""
    kind, path = arguments
    limit(path)
    try:
        arrays, properties = READERS[kind](path)
        arrays = [(name, array) for name, array in arrays if array.dtype.kind in "fiu"]
    except Unusable as error:
        print(json.dumps({"refused": str(error)}))
        return 1
    except Exception as error:  # whatever the library raises, the file cannot be read
        print(json.dumps({"unreadable": " ".join(str(error).split())[:80] or type(error).__name__}))
        return 1
    heads = [(name, array.shape) for name, array in arrays]
    sys.stdout.buffer.write(json.dumps({"arrays": heads, **properties}).encode() + b"\n")
    for _, array in arrays:
        sys.stdout.buffer.write(np.ascontiguousarray(array, dtype="<f8").tobytes())
    sys.stdout.buffer.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
