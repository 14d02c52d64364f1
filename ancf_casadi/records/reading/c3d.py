"""C3D files of motion capture, through ezc3d: the coordinates of markers, and analog channels.

The header declares the number of frames, points and analog samples; it is checked against the size of the file before
the library allocates memory for them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.reading.libraries import read_in_process
from ancf_casadi.records.units import parse_unit
from ancf_casadi.support.arrays import Array

C3D_BLOCK = 512  # bytes
ENDIANNESS = {84: "<", 85: "<", 86: ">"}  # by the processor that wrote the file: Intel, DEC, MIPS


def read_c3d(path: Path) -> Recording:
    """Read markers and analog channels of a C3D file; a marker that is not seen is a gap."""
    _check_sizes(path)
    arrays, properties = read_in_process("c3d", "ezc3d", path, "C3D")
    points, analogs = arrays["points"], arrays["analogs"]
    channels: list[RecordedChannel] = []
    if points.size:
        time = _time(points.shape[2], properties["POINT RATE"], str(path))
        symbol = next((str(text).strip() for text in properties["POINT UNITS"]), "")
        labels = _labels(properties["POINT LABELS"], points.shape[1], "marker")
        for j, label in enumerate(labels):
            for axis, values in zip("xyz", points[:, j], strict=True):
                number = len(channels) + 1
                channels.append(RecordedChannel(number, f"{label} {axis}", values, symbol, parse_unit(symbol), time))
    if analogs.size:
        time = _time(analogs.shape[1], properties["ANALOG RATE"], str(path))
        labels = _labels(properties["ANALOG LABELS"], len(analogs), "analog")
        symbols = [*(str(text).strip() for text in properties["ANALOG UNITS"]), *[""] * len(analogs)]
        for label, values, symbol in zip(labels, analogs, symbols[: len(analogs)], strict=True):
            channels.append(RecordedChannel(len(channels) + 1, label, values, symbol, parse_unit(symbol), time))
    return Recording(str(path), tuple(channels))


def _labels(labels_in_file: Sequence[object], count: int, default: str) -> list[str]:
    labels = [str(label).strip() for label in labels_in_file][:count]
    return [label or f"{default} {k + 1}" for k, label in enumerate([*labels, *[""] * (count - len(labels))])]


def _time(samples: int, rates: Sequence[float], path: str) -> Array | None:
    """Return the times of samples at the rate of the file; None if it has none."""
    rate = float(rates[0]) if rates else 0.0
    if not np.isfinite(rate) or rate < 0.0:
        raise InputError(f"has the sampling rate {rate:g} 1/s; it is damaged", path)
    return np.arange(samples, dtype=float) / rate if rate > 1e-30 else None


def _check_sizes(path: Path) -> None:
    """Check the sizes in the header against the size of the file."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        header = file.read(C3D_BLOCK)
        if len(header) < C3D_BLOCK or header[1] != 0x50 or not header[0]:
            raise InputError("has no C3D header", str(path))
        file.seek(C3D_BLOCK * (header[0] - 1))
        section = file.read(4)
    order = ENDIANNESS.get(section[3]) if len(section) == 4 else None
    if order is None:
        raise InputError("has no C3D parameters", str(path))
    points, analogs, first, last = struct.unpack(f"{order}4H", header[2:10])
    data = struct.unpack(f"{order}H", header[16:18])[0]
    frames = max(0, last - first + 1)
    if last < first or frames * (4 * points + analogs) * 2 > size - C3D_BLOCK * (data - 1):
        raise InputError("declares more frames than it holds; it is damaged", str(path))
