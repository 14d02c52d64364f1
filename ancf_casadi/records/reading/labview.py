"""Files of LabVIEW: LVM text files through lvm-read, and TDMS files, which DIAdem writes too, through nptdms.

lvm-read gets lines instead of the file, because it would read and write a pickled copy beside the file.  It stores each
number as an object, and therefore gets them block by block, each below the header.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.reading.arrays import MAX_CHANNELS, seconds_from_first
from ancf_casadi.records.reading.libraries import library_errors
from ancf_casadi.records.reading.text.reader import decode_text, text_blocks
from ancf_casadi.records.reading.worker import MAX_DATA_BYTES
from ancf_casadi.records.units import column_unit, parse_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.optional import library

END_OF_HEADER = "***End_of_Header***"  # of the file, and of each segment


def read_lvm(file: BinaryIO, path: Path) -> Recording:
    """Read the channels of an LVM file; refuse one with several segments."""
    lvm_read = library("lvm_read", "LVM files need it")
    header: list[str] = []
    blocks: list[Array] = []
    segments = 0
    with library_errors(str(path), "LVM"):
        for block in text_blocks(file, path):
            lines = [f"{line}\n" for line in decode_text(block).removesuffix("\n").split("\n")]
            # the first marker ends the header of the file, each further one that of a segment
            segments += sum(line.startswith(END_OF_HEADER) for line in lines) - (not header)
            end = next((k for k, line in enumerate(lines, start=1) if line.startswith("X_Value")), len(lines))
            header, lines = header or lines[:end], lines[0 if header else end :]
            contents = lvm_read.read_lines([*header, *lines], _separator(header))
            segments = max(segments, contents["Segments"])
            if segments > 1:
                raise InputError(f"has {segments} segments; save each in a file of its own", str(path))
            blocks.append(np.asarray(contents[0]["data"], dtype=float))
        return Recording(str(path), tuple(_channels(contents, contents[0], _stack_rows(blocks))))


def _separator(header: Sequence[str]) -> str:
    """Return the character between the columns: the one behind the word ``Separator``; a tab if there is none."""
    line = next((line for line in header if line.startswith("Separator")), "")
    return line.strip()[9:10] or "\t"


def _stack_rows(blocks: Sequence[Array]) -> Array:
    """Return the rows of blocks, the shorter ones with nan at their ends."""
    if any(block.ndim != 2 for block in blocks):
        raise InputError("has no rows of numbers")
    width = max(block.shape[1] for block in blocks)
    data = np.full((sum(map(len, blocks)), width), np.nan)
    first = 0
    for block in blocks:
        data[first : first + len(block), : block.shape[1]] = block
        first += len(block)
    return data


def _channels(header: Mapping[str, Any], segment: Mapping[str, Any], data: Array) -> list[RecordedChannel]:
    names = [str(name) for name in segment["Channel names"]]
    layout = str(header.get("X_Columns", "One"))
    symbols = [str(text).strip() for text in segment.get("Y_Unit_Label", [])]
    over_time = all(str(text).strip().lower() in ("", "time") for text in segment.get("X_Dimension", []))
    channels: list[RecordedChannel] = []
    first_x_values: Array | None = None
    x_values: Array | None = None
    for k, name in enumerate(names[: data.shape[1]]):
        if name == "Comment":
            continue
        if name == "X_Value":
            x_values = data[:, k] if over_time else None
            first_x_values = x_values if first_x_values is None else first_x_values
            continue
        place = len(channels)
        time = x_values if layout == "Multi" else first_x_values
        if time is None and over_time:
            starts, steps = (dict(enumerate(segment.get(key, []))) for key in ("X0", "Delta_X"))
            time = _even(starts.get(place), steps.get(place), len(data))
        written = symbols[place] if place < len(symbols) else ""
        channels.append(RecordedChannel(place + 1, name, data[:, k], *column_unit(written, name), time))
    return channels


def _even(start: Any, step: Any, count: int) -> Array | None:
    """Return evenly spaced values, such as times; None if the file gives no increment."""
    if not isinstance(step, float | int) or not np.isfinite(step) or not step > 0:
        return None
    has_start = isinstance(start, float | int) and np.isfinite(start)
    return (float(start) if has_start else 0.0) + float(step) * np.arange(count, dtype=float)


def read_tdms(stream: BinaryIO, path: Path) -> Recording:
    """Read the channels of a TDMS file; those with a waveform increment have their own times."""
    nptdms = library("nptdms", "TDMS files need it")
    notes: list[str] = []
    channels: list[RecordedChannel] = []
    starts: list[Any] = []
    with library_errors(str(path), "TDMS"), nptdms.TdmsFile.open(stream) as file:
        tdms_channels = [channel for group in file.groups() for channel in group.channels()]
        size = path.stat().st_size
        if len(tdms_channels) > MAX_CHANNELS:
            raise InputError(f"has more than {MAX_CHANNELS} channels", str(path))
        for channel in tdms_channels:
            name = channel.name if len(file.groups()) == 1 else f"{channel.group_name}/{channel.name}"
            if channel.dtype is None or channel.dtype.kind not in "fiuM":  # M: times
                notes.append(f"{name!r} has no numbers, and is left out")
                continue
            stored_bytes = getattr(channel.data_type, "size", None) or channel.dtype.itemsize  # before it is scaled
            if len(channel) * stored_bytes > 2 * size:
                raise InputError("declares more samples than it holds; it is damaged", f"{path}: {name}")
            if len(channel) * channel.dtype.itemsize > MAX_DATA_BYTES:
                raise InputError(f"has more than {MAX_DATA_BYTES >> 20} MB; shorten the record", f"{path}: {name}")
            channels.append(_channel(len(channels) + 1, name, channel))
            starts.append(channel.properties.get("wf_start_time"))
    return Recording(str(path), _on_one_clock(channels, starts), tuple(notes))


def _on_one_clock(channels: Sequence[RecordedChannel], starts: Sequence[Any]) -> tuple[RecordedChannel, ...]:
    """Return waveforms with times from the earliest start, if all state the instant of their start."""
    timed = [k for k, channel in enumerate(channels) if channel.time is not None]
    instants = {
        k: int(np.datetime64(starts[k], "ns").astype(np.int64))
        for k in timed
        if isinstance(starts[k], np.datetime64 | datetime)
    }
    if len(instants) < len(timed) or not instants:
        return tuple(channels)
    first = min(instants.values())
    delays = {k: 1e-9 * (instant - first) for k, instant in instants.items()}
    return tuple(
        replace(channel, time=channel.time + delays[k]) if channel.time is not None and delays[k] else channel
        for k, channel in enumerate(channels)
    )


def _channel(number: int, name: str, item: Any) -> RecordedChannel:
    values = np.asarray(item[:])
    if values.dtype.kind == "M":
        return RecordedChannel(number, name, np.asarray(seconds_from_first(values), dtype=float), "s", parse_unit("s"))
    written = str(item.properties.get("unit_string", "")).strip()
    time = _even(item.properties.get("wf_start_offset"), item.properties.get("wf_increment"), len(values))
    unit = parse_unit(str(item.properties.get("wf_xunit_string", "")).strip() or "s")
    time = unit.factor * time if time is not None and unit and unit.quantity == "time" else None
    return RecordedChannel(number, name, np.array(values, dtype=float), *column_unit(written, item.name), time)
