"""Options of the commands that read records: the columns and units of a file, and the part of it to use.

Records over time and over frequency have options of their own.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any, get_args

from ancf_casadi.decay.release import find_release
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import LAYOUT_KEYS, TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Quantity, Sensor
from ancf_casadi.support.inputs import located
from problems.command.output import comma_numbers, finite, positive_count

MOST_LINES = 100_000  # lines that an option may leave out


def add_record_options(parser: argparse.ArgumentParser, *, part: bool = True) -> None:
    """Add the options that say how to read a file, and those that choose a ``part`` of the record."""
    group = parser.add_argument_group("reading the file")
    group.add_argument(
        "--column", type=column, metavar="NAME|N", help="column of the values, by its name or its number from 1"
    )
    group.add_argument("--time", type=column, metavar="NAME|N", help="column of the times, likewise")
    group.add_argument("--unit", help="unit of the values, such as mm, g or m/s^2, if the file does not say it")
    group.add_argument("--time-unit", metavar="UNIT", help="unit of the times, such as ms, if the file does not say it")
    group.add_argument("--sample-rate", type=finite, metavar="HZ", help="samples per second of a file without times")
    add_layout_options(group, without="imaginary")
    group.add_argument(
        "--sensor",
        choices=get_args(Quantity),
        metavar="QUANTITY",
        help=f"what was measured: {', '.join(get_args(Quantity))} (default: as the unit tells)",
    )
    if not part:
        return
    group = parser.add_argument_group("choosing the part to fit")
    group.add_argument("--begin", type=finite, metavar="S", help="leave out what is before this time (s)")
    group.add_argument("--end", type=finite, metavar="S", help="leave out what is after this time (s)")
    group.add_argument(
        "--decimate",
        type=positive_count,
        metavar="N",
        help="keep every N-th sample from the release on, after a filter against aliasing, which takes 13 of those at "
        "either end",
    )
    group.add_argument(
        "--release-time",
        type=comma_numbers,
        metavar="S",
        help="time at which the free decay starts (s; default: detected); with several files S,S,... gives one each",
    )


def add_spectral_options(parser: argparse.ArgumentParser, *, level: bool) -> None:
    """Add the options that say how to read a file with values over frequency, with the ``level`` of an excitation."""
    group = parser.add_argument_group("reading the file")
    columns = {"column": "amplitudes or real parts", "frequency": "frequencies", "phase": "phases"}
    for name, values in (columns | ({"level": "levels of the excitation"} if level else {})).items():
        text = f"column of the {values}, by its name or its number from 1, if its name does not tell it"
        group.add_argument(f"--{name}", type=column, metavar="NAME|N", help=text)
    group.add_argument("--unit", help="unit of the values, such as mm, g or mm/N, if the file does not say it")
    group.add_argument("--phase-unit", choices=("deg", "rad"), help="unit of the phases, if the file does not say it")
    add_layout_options(group)
    if level:
        group.add_argument("--level-unit", metavar="UNIT", help="unit of the levels, such as N or g, likewise")


def add_layout_options(group: argparse._ArgumentGroup, without: str = "") -> None:
    """Add the options that are the fields of ``TableLayout``, except ``without``."""
    kinds: dict[str, Callable[[str], Any]] = {
        "names_row": positive_count, "skip_rows": line_numbers, "leave_out": columns, "imaginary": column,
    }  # fmt: skip
    for declared in fields(TableLayout):
        if declared.name != without:
            group.add_argument(f"--{declared.name.replace('_', '-')}", type=kinds[declared.name], **declared.metadata)


def read_record(path: str, options: argparse.Namespace) -> Measurement:
    """Read a file with the options of the command, and cut out the part to use."""
    record = Measurement.from_file(
        path,
        options.column,
        time=options.time,
        unit=options.unit,
        time_unit=options.time_unit,
        sample_rate=options.sample_rate,
        sensor=None if options.sensor is None else Sensor(options.sensor),
        layout=TableLayout.of(vars(options)),
        progress=True,
    )
    with located(f"{path}: --begin, --end"):
        record = record.cut(options.begin, options.end)
    if options.decimate is None:
        return record
    if options.release_time is not None:
        raise InputError("the record begins after the release with --decimate; give --begin", "--release-time")
    released = record.cut(record.time[find_release(record.time, record.values).index])
    with located(f"{path}: --decimate"):
        return released.decimated(options.decimate)


def column(text: str) -> str | int:
    """Return the name of a column, or its number from 1."""
    return int(text) if text.isdecimal() else text


def columns(text: str) -> tuple[str | int, ...]:
    """Return names or numbers of columns, separated by commas."""
    return tuple(column(name) for name in text.split(","))


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
    given: tuple[float, ...] | None = options.release_time
    if given is None:
        return [None] * count
    if len(given) not in (1, count):
        raise InputError(f"has {len(given)} times for {count} files; give one, or one for each", "--release-time")
    return list(given * (count if len(given) == 1 else 1))


def check_no_record_options(options: argparse.Namespace, instead: str) -> None:
    """Refuse the options of a record where there is none, and say what to do ``instead``."""
    for name in [
        *"column time unit time_unit sample_rate sensor begin end decimate release_time".split(),
        *LAYOUT_KEYS,
    ]:
        if getattr(options, name, None) is not None:
            raise InputError(f"belongs to the file of a record; {instead}", f"--{name.replace('_', '-')}")
