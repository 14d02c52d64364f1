"""MATLAB, HDF5 and NumPy files: named arrays of numbers, each of which gives one or more columns.

MATLAB files of version 4 to 7 are read by SciPy, version 7.3 and other HDF5 files by h5py.  The fields of structs are
named by their path, attributes of HDF5 give units and sampling rates, and complex arrays give columns ``real`` and
``imag``.  A single number such as ``fs`` or ``dt``, or the attribute of a rate, holds for the columns of its struct or
group; one in a struct without columns, such as ``info``, for those of the struct around it.  Cells, objects and links
to other files are left out, and pickled objects of NumPy are refused.  Each NumPy array is checked before it is read:
its header must declare the size that the archive has for it.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording, is_time
from ancf_casadi.records.reading.libraries import library_errors, read_in_process
from ancf_casadi.records.reading.worker import check_data_size, real_parts
from ancf_casadi.records.units import Unit, column_unit, parse_unit, sampling_unit, step_between_samples

MAX_CHANNELS = 10_000
STEP_NAMES = {"dt", "deltat", "ts", "tstep", "timestep", "tinc", "tinterval", "xincrement", "sampleinterval"}
EQUAL_STEPS = 1e-3  # relative difference of steps that agree, such as 1/60 s and 0.01667 s
RATE_NAMES = {"fs", "fsamp", "sr", "rate", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "fps"}


@np.errstate(all="ignore")  # extended precision may hold larger numbers
def columns_recording(
    path: Path,
    arrays: Iterable[tuple[str, NDArray[Any]]],
    notes: Iterable[str] = (),
    units: Mapping[str, str] = MappingProxyType({}),
    rates: Mapping[str, float] = MappingProxyType({}),
) -> Recording:
    """Return named arrays as columns: vectors, and matrices along their longer side; notes name arrays left out.

    ``rates`` are sampling rates, 1/s, by the path of their array or group.
    """
    channels: list[RecordedChannel] = []
    arrays_of_channels: list[str] = []
    remarks = list(notes)
    steps = [(place, f"rate {rate:g}", step_between_samples(rate, "frequency")) for place, rate in rates.items()]
    for name, array in real_parts(arrays):
        values = np.squeeze(array)
        stamps = values.dtype.kind == "M"
        if stamps:
            try:
                values = seconds_from_first(values)
            except (TypeError, OverflowError):  # years and months have no length; attoseconds overflow
                remarks.append(f"the dates in {name!r} cannot be converted to seconds, and are left out")
                continue
            remarks.append(f"the dates in {name!r} are converted to seconds from the first")
        if values.dtype.kind not in "fiu" or values.ndim > 2:
            remarks.append(f"{name!r} is not a real vector or matrix, and is left out")
            continue
        if values.ndim == 0:
            if stated := _stated_step(name, float(values), units.get(name, "")):
                steps.append(stated)
            else:
                remarks.append(f"{name!r} is a single number, {float(values):g}, and is left out")
            continue
        columns = values[:, None] if values.ndim == 1 else values if values.shape[0] >= values.shape[1] else values.T
        if len(channels) + columns.shape[1] > MAX_CHANNELS:
            remarks.append(f"{name!r} has too many columns, and is left out")
            continue
        symbol, unit = ("s", parse_unit("s")) if stamps else column_unit(units.get(name, ""), name)
        for k, column in enumerate(columns.T, 1):
            label = name if columns.shape[1] == 1 else f"{name}[{k}]"
            channels.append(RecordedChannel(len(channels) + 1, label, np.array(column, dtype=float), symbol, unit))
            arrays_of_channels.append(name)
    return _with_steps(Recording(str(path), tuple(channels), tuple(remarks)), arrays_of_channels, steps)


def seconds_from_first(dates: NDArray[Any]) -> NDArray[Any]:
    """Return dates of NumPy as seconds from the first one."""
    return (dates - dates.ravel()[0]) / np.timedelta64(1, "s") if dates.size else dates.astype(float)


def _stated_step(name: str, value: float, symbol: str) -> tuple[str, str, float] | None:
    """Return place, text and s, nan if in doubt, of a step such as ``dt`` or ``run.Fs``; None for other numbers."""
    place, _, field = name.rpartition(".")
    word, unit = field.casefold().replace("_", ""), sampling_unit(symbol)
    quantity = "time" if word in STEP_NAMES else "frequency" if word in RATE_NAMES else ""
    if not quantity or not 0.0 < value < np.inf:
        return None
    step = np.nan if symbol and not unit else step_between_samples(value, quantity, unit)
    return place, f"{name} = {value:g} {symbol}".rstrip(), step


def _with_steps(
    recording: Recording, arrays_of_channels: Sequence[str], steps: Sequence[tuple[str, str, float]]
) -> Recording:
    """Give each channel, a part of an array, the step that is stated at its place or at the nearest one around it."""
    occupied = {"", *(place for name in arrays_of_channels for place in _places(name))}
    steps_at: dict[str, dict[str, float]] = {}
    for stated_at, text, step in steps:
        place = next(filter(occupied.__contains__, _places(stated_at)))
        steps_at.setdefault(place, {})[text] = step
    nearest = [next(filter(steps_at.__contains__, _places(name)), None) for name in arrays_of_channels]
    agreed = [0.0 if place is None else _common_step(steps_at[place]) for place in nearest]
    if len(set(agreed)) < 2:
        texts = ", ".join(text for stated in steps_at.values() for text in stated)
        fault = f"the time between samples is in doubt ({texts})" if texts and not any(agreed) else ""
        return replace(recording, step=next(iter(agreed), 0.0) or None, time_fault=fault)
    if any(map(is_time, recording.channels)):
        return recording
    channels = tuple(
        replace(channel, time=step * np.arange(len(channel.values), dtype=float)) if step else channel
        for channel, step in zip(recording.channels, agreed, strict=True)
    )
    rates = ", ".join(f"{1.0 / step:g}" for step in dict.fromkeys(agreed) if step)
    return replace(
        recording, channels=channels, notes=(*recording.notes, f"times from the sampling rates, {rates} 1/s")
    )


def _places(path: str) -> Iterator[str]:
    """Yield a path and those around it, up to that of the file, which is empty."""
    while path:
        yield path
        path = path.rpartition(".")[0]
    yield ""


def _common_step(stated: Mapping[str, float]) -> float:
    """Return the step in all statements, s; 0 if it is in doubt."""
    steps = list(stated.values())
    return steps[0] if np.ptp(steps) <= EQUAL_STEPS * steps[0] else 0.0


def read_matlab(path: Path) -> Recording:
    """Read the numeric variables of a MATLAB file of version 4 to 7."""
    arrays, properties = read_in_process("matlab", "scipy", path, "MATLAB")
    return columns_recording(path, arrays.items(), properties["notes"])


def read_hdf5(path: Path) -> Recording:
    """Read the numeric data sets of a MATLAB file of version 7.3, or of any HDF5 file."""
    arrays, properties = read_in_process("hdf5", "h5py", path, "HDF5")
    if not arrays:
        raise InputError("has no data sets of numbers", str(path))
    return columns_recording(path, arrays.items(), properties["notes"], properties["units"], properties["rates"])


def read_npz(file: BinaryIO, path: Path) -> Recording:
    """Read the arrays of an ``.npz`` file."""
    arrays: list[tuple[str, NDArray[Any]]] = []
    notes: list[str] = []
    with library_errors(str(path), "NPZ"), zipfile.ZipFile(file) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        if not members:
            raise InputError("is a ZIP archive without NumPy arrays; export the data as CSV", str(path))
        check_data_size(sum(member.file_size for member in members), path.stat().st_size)
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as content:
                array = _array(cast(BinaryIO, content), member.file_size, f"{path}: {name}")
            if array is None:
                notes.append(f"{name!r} holds Python objects, and is left out")
            else:
                arrays.append((name, array))
    return columns_recording(path, arrays, notes)


def read_npy(file: BinaryIO, path: Path) -> Recording:
    """Read the array of an ``.npy`` file."""
    with library_errors(str(path), "NPY"):
        array = _array(file, path.stat().st_size, str(path))
        if array is None:
            raise InputError("holds Python objects, which are not read; save arrays of numbers", str(path))
    return columns_recording(path, [("values", array)])


def read_wav(file: BinaryIO, path: Path) -> Recording:
    """Read the channels of a sound, as fractions of full scale, with its sampling rate."""
    from scipy.io import wavfile  # slow to import

    with library_errors(str(path), "WAV"):
        rate, samples = wavfile.read(io.BytesIO(file.read()))
    values = np.asarray(samples, dtype=float).reshape(len(samples), -1)
    if samples.dtype.kind == "u":
        values = values / 128.0 - 1.0  # 8 bits
    elif samples.dtype.kind == "i":
        values = values / -float(np.iinfo(samples.dtype).min)
    full_scale, time = Unit("full scale", "fraction", 1.0), np.arange(len(values)) / rate
    channels = [
        RecordedChannel(k, f"channel {k}", column, full_scale.symbol, full_scale, time)
        for k, column in enumerate(values.T, start=1)
    ]
    return Recording(str(path), tuple(channels), (f"times from the sampling rate in the file, {rate:g} 1/s",))


def _array(file: BinaryIO, size: int, place: str) -> NDArray[Any] | None:
    """Return the array in a file of ``size`` bytes; None if it has Python objects."""
    content = file.read(size)
    if len(content) != size:
        raise InputError("is shorter than the archive says; it is damaged", place)
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.hasobject:
        return None
    if math.prod(shape) * dtype.itemsize != size - stream.tell():
        raise InputError("declares another size than it has; it is damaged", place)
    stream.seek(0)
    return np.asarray(npy.read_array(stream, allow_pickle=False))
