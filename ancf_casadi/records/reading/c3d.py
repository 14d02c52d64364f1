"""C3D files of motion capture, through ezc3d: the coordinates of markers, and analog channels.

The header declares the number of frames, points and analog samples; it is checked against the size of the file before
the library allocates memory for them.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Channel, Contents
from ancf_casadi.records.reading.libraries import library, readable
from ancf_casadi.records.units import parse_unit
from ancf_casadi.support.arrays import Array

BLOCK = 512  # bytes
ENDIANNESS = {84: "<", 85: "<", 86: ">"}  # by the processor that wrote the file: Intel, DEC, MIPS


def read_c3d(path: Path) -> Contents:
    """Read markers and analog channels of a C3D file; a marker that is not seen is a gap.

    Raises
    ------
    InputError
        If ezc3d is missing, or the file is damaged.
    """
    ezc3d = library("ezc3d", "C3D")
    with readable(str(path), "C3D"):
        _check_sizes(path)
        file = ezc3d.c3d(str(path))
        return Contents((*_markers(file, str(path)), *_analogs(file, str(path))))


def _markers(file: Any, path: str) -> list[Channel]:
    parameters = file["parameters"].get("POINT", {})
    points = np.array(file["data"]["points"][:3], dtype=float)  # 3, markers, frames
    count, frames = points.shape[1:]
    if not count or not frames:
        return []
    points[:, file["data"]["meta_points"]["residuals"][0] < 0.0] = np.nan
    time = _time(frames, parameters, path)
    symbol = _first(parameters, "UNITS").strip()
    labels = _labels(parameters, count, "marker")
    pairs = [(f"{label} {axis}", points[k, j]) for j, label in enumerate(labels) for k, axis in enumerate("xyz")]
    return [Channel(k, name, values, symbol, parse_unit(symbol), time) for k, (name, values) in enumerate(pairs, 1)]


def _analogs(file: Any, path: str) -> list[Channel]:
    parameters = file["parameters"].get("ANALOG", {})
    analogs = np.asarray(file["data"]["analogs"], dtype=float)[0]  # channels, samples
    count, samples = analogs.shape
    if not count or not samples:
        return []
    time = _time(samples, parameters, path)
    symbols = [*map(str, parameters.get("UNITS", {}).get("value", [])), *[""] * count]
    labels = _labels(parameters, count, "analog")
    before = 3 * file["data"]["points"].shape[1]
    return [
        Channel(before + k + 1, label, values, symbol.strip(), parse_unit(symbol), time)
        for k, (label, values, symbol) in enumerate(zip(labels, analogs, symbols[:count], strict=True))
    ]


def _labels(parameters: Any, count: int, default: str) -> list[str]:
    given = [str(label).strip() for label in parameters.get("LABELS", {}).get("value", [])][:count]
    return [label or f"{default} {k + 1}" for k, label in enumerate([*given, *[""] * (count - len(given))])]


def _first(parameters: Any, name: str) -> str:
    values = list(parameters.get(name, {}).get("value", []))
    return str(values[0]) if values else ""


def _time(samples: int, parameters: Any, path: str) -> Array | None:
    """Return the times of samples at the rate of the file; None if it has none."""
    rates = np.ravel(parameters.get("RATE", {}).get("value", []))
    rate = float(rates[0]) if len(rates) else 0.0
    if not np.isfinite(rate) or rate < 0.0:
        raise InputError(f"has the sampling rate {rate:g} 1/s; it is damaged", path)
    return np.arange(samples, dtype=float) / rate if rate > 1e-30 else None


def _check_sizes(path: Path) -> None:
    """Check the sizes in the header against the size of the file."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        header = file.read(BLOCK)
        if len(header) < BLOCK or header[1] != 0x50 or not header[0]:
            raise InputError("has no C3D header", str(path))
        file.seek(BLOCK * (header[0] - 1))
        section = file.read(4)
    order = ENDIANNESS.get(section[3]) if len(section) == 4 else None
    if order is None:
        raise InputError("has no C3D parameters", str(path))
    points, analogs, first, last = struct.unpack(f"{order}4H", header[2:10])
    data = struct.unpack(f"{order}H", header[16:18])[0]
    frames = max(0, last - first + 1)
    if last < first or frames * (4 * points + analogs) * 2 > size - BLOCK * (data - 1):
        raise InputError("declares more frames than it holds; it is damaged", str(path))
