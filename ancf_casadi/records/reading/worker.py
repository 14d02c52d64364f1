"""Reading by compiled libraries, in a separate process.

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
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_DATA_BYTES = 2**30  # of the data in a file
MAX_ITEMS = 10_000
NUMERIC = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
UNIT_ATTRIBUTE = re.compile(r"units?|unit_string|y[ _]?units?", re.IGNORECASE)
RATE_ATTRIBUTE = re.compile(r"(?:sampl(?:e|ing)[ _]?)(?:rate|freq|frequency)(?:[ _]?\(?hz\)?)?|fs", re.IGNORECASE)
GAP_ATTRIBUTES, SCALES = ("_FillValue", "missing_value"), ("scale_factor", "add_offset")  # of NetCDF
FileContents = tuple[list[tuple[str, NDArray[Any]]], dict[str, Any]]  # named arrays, and properties


class UnusableFileError(Exception):
    """The reason why a file is refused."""


def check_data_size(size: int, packed: int) -> None:
    """Check that a file of ``packed`` bytes can hold ``size`` bytes of data, at most 1 GiB."""
    if size > 1100 * packed:  # unpacked bytes per byte of a compressed file; deflate reaches 1032
        raise UnusableFileError(f"declares {size} bytes of data, which its {packed} bytes cannot hold; it is damaged")
    if size > MAX_DATA_BYTES:
        raise UnusableFileError(f"unpacks to more than {MAX_DATA_BYTES >> 20} MB; shorten the record")


def real_parts(arrays: Iterable[tuple[str, NDArray[Any]]]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays, with real and imaginary part of complex ones as two."""
    for name, array in arrays:
        fields = array.dtype.names
        if array.dtype.kind == "c":
            yield from ((f"{name} real", array.real), (f"{name} imag", array.imag))
        elif fields in (("real", "imag"), ("r", "i")):  # complex numbers of HDF5
            yield from zip((f"{name} real", f"{name} imag"), (array[field] for field in fields), strict=True)
        else:
            yield name, array


def matlab(path: str) -> FileContents:
    """Return the numeric variables of a MATLAB file of version 4 to 7, and the numeric fields of its structs."""
    from scipy.io import loadmat, whosmat

    wanted: list[str] = []
    notes: list[str] = []
    size = 0
    for name, shape, kind in whosmat(path, appendmat=False):
        if kind in NUMERIC | {"struct"} and len(wanted) < MAX_ITEMS:
            wanted.append(name)
            size += math.prod(int(n) for n in shape) * (8 if kind == "struct" else np.dtype(kind).itemsize)
        else:
            notes.append(f"{name!r} is a {kind}, and is left out; save its content as variables")
    check_data_size(size, os.path.getsize(path))
    variables = loadmat(path, variable_names=wanted, appendmat=False) if wanted else {}
    arrays = [item for name in wanted if name in variables for item in struct_fields(name, variables[name])][:MAX_ITEMS]
    check_data_size(sum(array.nbytes for _, array in arrays), os.path.getsize(path))
    return arrays, {"notes": notes}


def struct_fields(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the numeric arrays in a struct or struct array of MATLAB, each with its path, such as ``run[2].tip``."""
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names is None:
        if value.dtype.kind in "fiuc":
            yield name, value
        return
    for k, element in enumerate(value.ravel(), start=1):
        path = name if value.size == 1 else f"{name}[{k}]"
        for field in value.dtype.names:
            yield from struct_fields(f"{path}.{field}", element[field])


def hdf5(path: str) -> FileContents:
    """Return the numeric data sets of a MATLAB file of version 7.3, or of any HDF5 file, with units and rates."""
    h5py = importlib.import_module("h5py")

    arrays: list[tuple[str, NDArray[Any]]] = []
    notes: list[str] = []
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    with h5py.File(path, "r") as file:
        data_sets: list[tuple[str, Any]] = []

        def visit(_: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset) and not item.name.startswith("/#refs#"):
                data_sets.extend(_elements(file, item, h5py))
            return True if len(data_sets) >= MAX_ITEMS else None

        file.visititems(visit)
        total = 0
        for name, item in data_sets[:MAX_ITEMS]:
            if item.attrs.get("MATLAB_class", b"") == b"char":
                continue
            is_complex = item.dtype.names in (("real", "imag"), ("r", "i")) or item.dtype.kind == "c"
            if (
                (item.dtype.kind not in "fiu" and not is_complex)
                or item.shape is None
                or item.external
                or item.is_virtual
            ):
                notes.append(f"{name!r} holds no numbers itself, and is left out")
                continue
            total += item.size * item.dtype.itemsize
            check_data_size(total, os.path.getsize(path))
            columns = dict(real_parts([(name, _unpack(item))]))
            arrays += columns.items()
            if unit := _attribute(item, UNIT_ATTRIBUTE, str):
                units |= dict.fromkeys(columns, unit)
            for place, owner in (
                *dict.fromkeys(columns, item).items(),
                (name.rpartition(".")[0], item.parent),
                ("", file),
            ):
                if rate := _attribute(owner, RATE_ATTRIBUTE, float):
                    rates[place] = rate
    return arrays, {"notes": notes, "units": units, "rates": rates}


def _unpack(item: Any) -> NDArray[Any]:
    """Return the numbers of a data set as its attributes explain them: gaps, and a scale of packed numbers."""
    values: NDArray[Any] = item[()]
    packing = {
        name: float(np.asarray(item.attrs[name]).item()) for name in (*GAP_ATTRIBUTES, *SCALES) if name in item.attrs
    }
    if not packing or values.dtype.kind not in "fiu":
        return values
    numbers = np.asarray(values, dtype=float)
    numbers[np.isin(numbers, [packing[name] for name in GAP_ATTRIBUTES if name in packing])] = np.nan
    return np.asarray(numbers * packing.get("scale_factor", 1.0) + packing.get("add_offset", 0.0))


def _elements(file: Any, item: Any, h5py: Any) -> list[tuple[str, Any]]:
    """Return a data set with its path; for a field of a MATLAB struct array, the data sets to which it refers."""
    name = item.name.strip("/").replace("/", ".")
    inside, _, field = name.rpartition(".")
    if h5py.check_ref_dtype(item.dtype) is None or not inside or item.attrs.get("MATLAB_class", b"") == b"cell":
        return [(name, item)]
    if item.size > MAX_ITEMS or item.external or item.is_virtual:
        return [(name, item)]
    targets = [(k, file[reference]) for k, reference in enumerate(np.ravel(item[()]), start=1) if reference]
    return [(f"{inside}[{k}].{field}", target) for k, target in targets if isinstance(target, h5py.Dataset)]


def _attribute(item: Any, names: re.Pattern[str], kind: type[Any]) -> Any:
    """Return the text or positive number of an attribute; None if there is none."""
    for name in item.attrs:
        if not names.fullmatch(name):
            continue
        value = np.ravel(item.attrs[name])
        if len(value) != 1:
            continue
        if kind is float and value.dtype.kind in "fiu" and 0.0 < float(value[0]) < math.inf:
            return float(value[0])
        text = value[0].decode("utf-8", "replace") if isinstance(value[0], bytes) else value[0]
        if kind is str and isinstance(text, str):
            return text.strip()
    return None


def c3d(path: str) -> FileContents:
    """Return the points (3, markers, frames), nan in frames without the marker, and the analog channels."""
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


READERS: Mapping[str, Callable[[str], FileContents]] = {"matlab": matlab, "hdf5": hdf5, "c3d": c3d}


def limit(path: str) -> None:
    """Limit memory and processor time of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    size = os.path.getsize(path)
    memory = min((2**30) + 64 * size, 6 * 2**30)  # bytes for the library, beside 64 per byte of the file
    seconds = 3 + size // (2**21)  # processor time: a base, and 2 MB/s, which a slow library reads
    for kind, maximum in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (maximum if hard == resource.RLIM_INFINITY else min(maximum, hard), hard))


def main(arguments: Sequence[str]) -> int:
    """Read a file and print its contents; or print the reason for a refusal, and return 1."""
    kind, path = arguments
    limit(path)
    try:
        arrays, properties = READERS[kind](path)
        arrays = [(name, array) for name, array in real_parts(arrays) if array.dtype.kind in "fiu"]
    except UnusableFileError as error:
        print(json.dumps({"refused": str(error)}))
        return 1
    except Exception as error:  # whatever the library raises, the file cannot be read
        print(json.dumps({"unreadable": " ".join(str(error).split())[:80] or type(error).__name__}))
        return 1
    shapes = [(name, array.shape) for name, array in arrays]
    sys.stdout.buffer.write(json.dumps({"arrays": shapes, **properties}).encode() + b"\n")
    for _, array in arrays:
        sys.stdout.buffer.write(np.ascontiguousarray(array, dtype="<f8").tobytes())
    sys.stdout.buffer.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
