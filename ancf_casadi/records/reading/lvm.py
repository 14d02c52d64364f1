"""LVM text files of LabVIEW, through lvm-read.

The library gets the text instead of the file: from a file, it would read a pickled copy beside it, and leave one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.libraries import library, readable
from ancf_casadi.records.reading.text.blocks import decoded
from ancf_casadi.records.unit_names import unit_in_name
from ancf_casadi.records.units import parse_unit
from ancf_casadi.support.arrays import Array


def read_lvm(path: Path) -> Contents:
    """Read the channels of an LVM file with one segment.

    Raises
    ------
    InputError
        If lvm-read is missing, the file is damaged, or it has several segments.
    """
    lvm_read = library("lvm_read", "LVM")
    with readable(str(path), "LVM"):
        found = lvm_read.read_str(decoded(path.read_bytes()))
        if found["Segments"] != 1:
            raise InputError(f"has {found['Segments']} segments; save each in a file of its own", str(path))
        return Contents(tuple(_channels(found, found[0])))


def _channels(header: Mapping[str, Any], segment: Mapping[str, Any]) -> list[RecordedChannel]:
    names = [str(name) for name in segment["Channel names"]]
    data = np.asarray(segment["data"], dtype=float)
    if data.ndim != 2:
        raise InputError("has no rows of numbers")
    columns = {name: data[:, k] for k, name in enumerate(names[: data.shape[1]]) if name != "Comment"}
    layout = str(header.get("X_Columns", "One"))
    symbols = [str(text).strip() for text in segment.get("Y_Unit_Label", [])]
    channels: list[RecordedChannel] = []
    shared: Array | None = None
    own: Array | None = None
    for k, name in enumerate(names[: data.shape[1]]):
        if name == "Comment":
            continue
        if name == "X_Value":
            own = data[:, k]
            shared = own if shared is None else shared
            continue
        place = len(channels)
        time = own if layout == "Multi" else shared
        if time is None:
            time = _even(segment, place, len(data))
        written = symbols[place] if place < len(symbols) else ""
        symbol, unit = (written, parse_unit(written)) if written else unit_in_name(name)
        channels.append(RecordedChannel(place + 1, name, columns[name], symbol, unit, time))
    return channels


def _even(segment: Mapping[str, Any], place: int, count: int) -> Array | None:
    """Return times from X0 and Delta_X of a channel."""
    steps: Sequence[float] = segment.get("Delta_X", [])
    starts: Sequence[float] = segment.get("X0", [])
    if place >= len(steps) or not np.isfinite(steps[place]) or not steps[place] > 0:
        return None
    start = float(starts[place]) if place < len(starts) and np.isfinite(starts[place]) else 0.0
    return start + float(steps[place]) * np.arange(count, dtype=float)
