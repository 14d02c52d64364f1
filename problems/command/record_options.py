"""Options of the commands that read records: keys of the tables of a record, and the part of it to use."""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Callable, Mapping
from typing import Any

from msgspec import inspect as types

from ancf_casadi.decay.release import find_release
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import alternatives, listed_fields
from problems.command.output import add_options, comma_numbers, finite, option_values, positive_count
from problems.spec.record_files import ChannelSpec, SensorSpec

MOST_LINES = 100_000  # lines that an option may leave out
READING_KEYS = ("column", "time", "unit", "time_unit", "sample_rate")
FILE_KEYS = (*READING_KEYS, "names_row", "skip_rows", "leave_out")
RECORD_KEYS = (*FILE_KEYS, "sensor", "begin", "end", "decimate", "release_time")


def add_keys(parser: Any, table: type, *names: str) -> None:
    """Add keys of a declared table as options."""
    declared = {field.encode_name: field for field in listed_fields(table)}
    for name in names:
        kind = declared[name].type
        text = (kind.extra_json_schema or {}).get("description", "") if isinstance(kind, types.Metadata) else ""
        arguments = _argument(alternatives(kind), text)
        parser.add_argument(f"--{name.replace('_', '-')}", **arguments)


def _argument(kinds: tuple[types.Type, ...], text: str) -> dict[str, Any]:
    """Return the type of an option as the arguments of ``add_argument``."""
    kind: Callable[[str], Any]
    present: dict[type, Any] = {type(kind): kind for kind in kinds}
    if literal := present.get(types.LiteralType):
        return {"choices": literal.values, "metavar": "NAME", "help": text or f"one of {', '.join(literal.values)}"}
    if items := present.get(types.VarTupleType):
        named = types.StrType in map(type, alternatives(items.item_type))
        kind, metavar = (columns, "NAME|N,...") if named else (line_numbers, "N,N-M,...")
    elif types.StrType in present:
        kind, metavar = str, "NAME|N" if types.IntType in present else "UNIT"
    else:
        kind, metavar = (positive_count, "N") if types.IntType in present else (finite, "NUMBER")
    return {"type": kind, "metavar": metavar, "help": text}


def add_record_options(parser: argparse.ArgumentParser, *, for_fit: bool = True) -> None:
    """Add the options that say how to read a file, and those that choose the part to fit."""
    group = parser.add_argument_group("reading the file")
    add_keys(group, ChannelSpec, *FILE_KEYS)
    add_keys(group, SensorSpec, "sensor")
    if not for_fit:
        return
    group = parser.add_argument_group("choosing the part to fit")
    add_keys(group, ChannelSpec, "begin", "end")
    decimate = "keep every N-th sample from the release on; the filter against aliasing takes 13 of those at either end"
    release = "start of the free decay, s, if not to be detected; with several files S,S,... gives one each"
    add_options(group, decimate=(positive_count, "N", decimate), release_time=(comma_numbers, "S", release))


def read_record(path: str, options: argparse.Namespace) -> Measurement:
    """Read a file with the options of the command, and cut out the part to use."""
    sensor = None if options.sensor is None else Sensor(options.sensor)
    reading = {"layout": TableLayout.of(vars(options)), **option_values(options, READING_KEYS)}
    record = Measurement.from_file(path, sensor=sensor, progress=True, **reading)
    with error_prefix(f"{path}: --begin, --end"):
        record = record.cut(options.begin, options.end)
    if options.decimate is None:
        return record
    if options.release_time is not None:
        raise InputError("the record begins after the release with --decimate; give --begin", "--release-time")
    released = record.cut(record.time[find_release(record.time, record.values).index])
    with error_prefix(f"{path}: --decimate"):
        return released.decimated(options.decimate)


def columns(text: str) -> tuple[str, ...]:
    """Return names or numbers of columns, separated by commas; a name with commas is in quotation marks, as in CSV."""
    return tuple(next(csv.reader([text], skipinitialspace=True)))


def line_numbers(text: str) -> tuple[int, ...]:
    """Return the numbers in a list such as ``1-5,17``."""
    ranges = [re.fullmatch(r"0*([1-9]\d{0,8})(?:-0*([1-9]\d{0,8}))?", item.strip()) for item in text.split(",")]
    bounds = [(int(match[1]), int(match[2] or match[1])) for match in ranges if match]
    total = sum(end - begin + 1 for begin, end in bounds)
    if len(bounds) < len(ranges) or any(end < begin for begin, end in bounds) or total > MOST_LINES:
        raise argparse.ArgumentTypeError(f"must be lines such as 1-5,17, {MOST_LINES} at most, got {text!r}")
    return tuple(line for begin, end in bounds for line in range(begin, end + 1))


def releases(options: argparse.Namespace, count: int) -> list[float | None]:
    """Return the release time of each of ``count`` files, None where it is to be detected."""
    times: tuple[float, ...] | None = options.release_time
    if times is None:
        return [None] * count
    if len(times) not in (1, count):
        raise InputError(f"has {len(times)} times for {count} files; give one, or one for each", "--release-time")
    return list(times * (count if len(times) == 1 else 1))


def given_options(options: argparse.Namespace, *names: str) -> dict[str, bool]:
    """Return whether each option is given."""
    return {f"--{name.replace('_', '-')}": getattr(options, name) is not None for name in names}


def refuse_combinations(excluded: Mapping[str, tuple[bool, str, Mapping[str, bool]]]) -> None:
    """Refuse options that do not go together.

    Each option in ``excluded`` has three entries: whether it is given, what it does, and the settings that do not go
    with it, each with whether it is present.
    """
    for option, (chosen, action, settings) in excluded.items():
        for name, present in settings.items():
            if chosen and present:
                raise InputError(f"{action}; it does not go with {name}", option)
