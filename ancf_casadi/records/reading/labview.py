"""Files of LabVIEW: LVM text files through lvm-read, and TDMS files, which DIAdem writes too, through nptdms.

lvm-read gets the text instead of the file: from a file, it would read a pickled copy beside it, and leave one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.arrays import MOST_CHANNELS
from ancf_casadi.records.reading.libraries import library, readable
from ancf_casadi.records.reading.text.reader import decoded
from ancf_casadi.records.reading.worker import MOST_DATA_BYTES
from ancf_casadi.records.unit_names import unit_in_name
from ancf_casadi.records.units import parse_unit
from ancf_casadi.support.arrays import Array


def read_lvm(path: Path) -> Contents:
    """Read the channels of an LVM file; refuse one with several segments."""
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


def read_tdms(path: Path) -> Contents:
    """Read the channels of a TDMS file; those with a waveform increment have their own times."""
    nptdms = library("nptdms", "TDMS")
    notes: list[str] = []
    channels: list[RecordedChannel] = []
    with readable(str(path), "TDMS"), open(path, "rb") as stream, nptdms.TdmsFile.open(stream) as file:
        found = [channel for group in file.groups() for channel in group.channels()]
        size = path.stat().st_size
        if len(found) > MOST_CHANNELS:
            raise InputError(f"has more than {MOST_CHANNELS} channels", str(path))
        for item in found:
            name = item.name if len(file.groups()) == 1 else f"{item.group_name}/{item.name}"
            if item.dtype is None or item.dtype.kind not in "fiuM":
                notes.append(f"{name!r} has no numbers, and is left out")
                continue
            if len(item) * item.dtype.itemsize > min(size * 2, MOST_DATA_BYTES):
                raise InputError("declares more samples than it holds; it is damaged", f"{path}: {name}")
            channels.append(_channel(len(channels) + 1, name, item))
    return Contents(tuple(channels), tuple(notes))


def _channel(number: int, name: str, item: Any) -> RecordedChannel:
    values = np.asarray(item[:])
    if values.dtype.kind == "M":
        seconds = (values - values[0]) / np.timedelta64(1, "s") if len(values) else values.astype(float)
        return RecordedChannel(number, name, np.asarray(seconds, dtype=float), "s", parse_unit("s"))
    written = str(item.properties.get("unit_string", "")).strip()
    symbol, unit = (written, parse_unit(written)) if written else unit_in_name(item.name)
    step = item.properties.get("wf_increment")
    time = None
    if isinstance(step, float | int) and np.isfinite(step) and step > 0:
        offset = item.properties.get("wf_start_offset", 0.0)
        start = float(offset) if isinstance(offset, float | int) and np.isfinite(offset) else 0.0
        time = start + float(step) * np.arange(len(values), dtype=float)
    return RecordedChannel(number, name, np.array(values, dtype=float), symbol, unit, time)
