"""TDMS files of LabVIEW and DIAdem, through nptdms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.arrays import MOST_CHANNELS
from ancf_casadi.records.reading.libraries import library, readable
from ancf_casadi.records.reading.worker import MOST_DATA_BYTES
from ancf_casadi.records.unit_names import unit_in_name
from ancf_casadi.records.units import parse_unit


def read_tdms(path: Path) -> Contents:
    """Read the channels of a TDMS file; those with a waveform increment have their own times.

    Raises
    ------
    InputError
        If nptdms is missing, or the file is damaged.
    """
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
