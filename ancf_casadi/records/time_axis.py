"""The time of each sample of a file: a column of times or of frame numbers, or the sampling rate.

Without a choice by the caller, the time is the column that is named so or has a unit of time; without names, it is the
only column that increases in equal steps, or the only one that increases at all.  Any doubt is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.units import Unit, known_unit, names_time
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, physical, shown

COUNTER_NAME = re.compile(
    r"(?:frames?|samples?|scans?|index|row|record|point|count(?:er)?|bildnummer)?[ _.#-]*"
    r"(?:frames?|samples?|scans?|index|number|num|no|nr|n|#|id|count(?:er)?|idx)\.?",
    re.IGNORECASE,
)
PATH = re.compile(r"[\w\[\]]+(?:\.[\w\[\]]+)+")
FREQUENCY_NAME = re.compile(
    r"f|hz|(?:.*[ _-])?(?:freq|frequency|frequencies|frequenz|fréquence|frecuencia)", re.IGNORECASE
)
LEAST_EQUAL_SHARE = 0.9  # share of steps upwards, or of equal steps, that tells a column of times
FIRST_DATE, LAST_DATE = 2e4, 1e6  # days since 1900 or since the year 0, as workbooks and MATLAB count
RATE_ADVICE = "or give the sampling rate with --sample-rate"


Timed = tuple[tuple[RecordedChannel, ...], tuple[str, ...]]  # channels with times, and decisions to be told


def find_channel(channels: Sequence[RecordedChannel], wanted: object, option: str, path: str) -> RecordedChannel:
    """Return the only channel with a name or number."""
    check_instance(wanted, option, str, Integral)
    named = [channel for channel in channels if channel.name == wanted]
    if not named and isinstance(wanted, str):
        named = [channel for channel in channels if channel.name.casefold() == wanted.strip().casefold()]
    if not named:
        named = [channel for channel in channels if str(channel.number) == str(wanted).strip()]
    if len(named) == 1:
        return named[0]
    fault = f"{len(named)} columns are named {shown(wanted)}; give the number" if named else "there is no such column"
    raise InputError(f"{option} {shown(wanted)}: {fault}; there are {listed(channels)}", path)


def listed(channels: Sequence[RecordedChannel]) -> str:
    """Return numbers and names of channels, for messages."""
    shortened = ", ".join(channel.label for channel in channels[:8])
    return f"{shortened}, ... ({len(channels)} in all)" if len(channels) > 8 else shortened


def _field(name: str) -> str:
    """Return the name, or the last one of a path such as ``run[2].time``."""
    return name.rpartition(".")[2] if PATH.fullmatch(name) else name.strip()


def is_time(channel: RecordedChannel) -> bool:
    """Return whether the name or the unit of a channel tells that it holds times."""
    return bool(channel.unit and channel.unit.quantity == "time") or names_time(_field(channel.name))


def is_frequency(channel: RecordedChannel) -> bool:
    """Return whether the name or the unit of a channel tells that it holds frequencies."""
    if channel.unit or channel.symbol:
        return bool(channel.unit and channel.unit.quantity == "frequency")
    return FREQUENCY_NAME.fullmatch(_field(channel.name)) is not None


def is_counter(channel: RecordedChannel) -> bool:
    """Return whether a channel counts the samples or the frames."""
    whole = COUNTER_NAME.fullmatch(_field(channel.name)) is not None and not channel.symbol
    numbers = channel.values[np.isfinite(channel.values)]
    return whole and bool(np.all(numbers == np.floor(numbers)))


def timed_channels(
    contents: Contents, path: str, *, time: str | int | None, time_unit: str | None, sample_rate: float | None
) -> Timed:
    """Return the channels of a file without the time, each with the times of its samples; see ``read_recording``."""
    unit = None if time_unit is None else known_unit(time_unit, "time_unit")
    if unit and unit.quantity != "time":
        raise InputError(f"{unit.symbol!r} is a unit of {unit.quantity}, not of time", "time_unit")
    if sample_rate is not None:
        return _from_rate(contents, path, physical(sample_rate, "sample_rate"), time)
    channel = _chosen(contents, path) if time is None else find_channel(contents.channels, time, "--time", path)
    if channel.fault:
        raise InputError(channel.fault, f"{path}: column {channel.label}")
    if unit is None and is_counter(channel):
        raise InputError("counts samples, not seconds; give --sample-rate", f"{path}: column {channel.label}")
    seconds, notes = _seconds(channel, unit, path)
    return _on_times(contents, channel, seconds, notes, path)


def _from_rate(contents: Contents, path: str, rate: float, time: str | int | None) -> Timed:
    """Return times from the sampling rate, and from frame numbers if there are any."""
    counters = [channel for channel in contents.channels if is_counter(channel) and _increases(channel.values)]
    if time is not None:
        counters = [find_channel(contents.channels, time, "--time", path)]
    if len(counters) == 1:
        counter = counters[0]
        if counter.unit:
            raise InputError(
                f"column {counter.label} has times in {counter.symbol}; leave out --sample-rate, or --time", path
            )
        seconds = (counter.values - counter.values[0]) / rate
        return _on_times(contents, counter, seconds, (f"times from column {counter.label} at {rate:g} 1/s",), path)
    count = max((len(channel.values) for channel in contents.channels), default=0)
    seconds = np.arange(count) / rate
    channels = tuple(replace(own, time=seconds[: len(own.values)]) for own in contents.channels)
    notes = (f"times from the sampling rate, {rate:g} 1/s",)
    return channels, notes


def _chosen(contents: Contents, path: str) -> RecordedChannel:
    """Return the column that must be the time."""
    channels = contents.channels
    named = [channel for channel in channels if is_time(channel)]
    if len(named) > 1:
        named = [channel for channel in named if not _constant(channel.values)]  # such as the date
        exact = [channel for channel in named if channel.unit and channel.unit.quantity == "time"]
        named = exact if len(exact) == 1 else named
    if len(named) == 1:
        return named[0]
    candidates = named
    if not named and any(is_frequency(channel) for channel in channels):
        raise InputError(
            "has values over frequency, not over time; read it by FrfRecord.from_file (fit-frf), or "
            "ResponseRecord.from_file (fit-response, without a beam fit-mode)",
            path,
        )
    if not named and len(channels) > 1:
        possible = [c for c in channels if not c.fault and not c.unit and not is_counter(c)]
        rising = [channel for channel in possible if _increases(channel.values)]
        even = [channel for channel in rising if _is_even(channel.values)]
        candidates = even or rising
        if len(candidates) == 1:
            return candidates[0]
    if candidates:
        raise InputError(
            f"the time may be column {' or '.join(c.label for c in candidates[:4])}; choose with --time", path
        )
    raise InputError(
        f"no column is clearly the time (there are {listed(channels)}); name one with --time, {RATE_ADVICE}", path
    )


def _constant(values: Array) -> bool:
    return len(values) > 1 and (bool(np.isnan(values).all()) or bool(np.nanmin(values) == np.nanmax(values)))


def _increases(values: Array) -> bool:
    steps = np.diff(values)
    return len(steps) > 0 and bool(np.mean(steps > 0.0) >= LEAST_EQUAL_SHARE)


def _is_even(values: Array) -> bool:
    steps = np.diff(values)
    usual = np.nanmedian(steps)
    # difference of equal steps, relative to the median
    return bool(np.mean(np.abs(steps - usual) <= 0.05 * usual) >= LEAST_EQUAL_SHARE)


def _seconds(channel: RecordedChannel, unit: Unit | None, path: str) -> tuple[Array, tuple[str, ...]]:
    """Return the numbers of a time column in s, and notes."""
    where = f"{path}: column {channel.label}"
    given = unit or channel.unit
    if given is None and channel.symbol:
        raise InputError(
            f"the unit {shown(channel.symbol)} is not understood; give the unit of the time with --time-unit", where
        )
    if given and given.quantity != "time":
        raise InputError(
            f"is in {given.symbol}, a unit of {given.quantity}, and is no time; choose another with --time", where
        )
    largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
    if given is None and largest > 1e11:  # s; times beyond it must be in another unit
        raise InputError("has no unit, and its numbers are too large for s; give the unit with --time-unit", where)
    span = float(np.nanmax(channel.values, initial=-np.inf) - np.nanmin(channel.values, initial=np.inf))
    # span of such times relative to their size: a record of an hour at most
    if given is None and FIRST_DATE < largest < LAST_DATE and span < 1e-6 * largest:
        raise InputError("has no unit, and may count days; give the unit with --time-unit", where)
    factor = given.factor if given else 1.0
    notes: tuple[str, ...] = () if given else (f"column {channel.label} has no unit; its times are taken in s",)
    values = channel.values
    if largest * factor > 1e9:  # s; times beyond it count from 1970
        values = values - values[np.argmax(~np.isnan(values))]
        notes += ("times count from the first sample",)
    return np.asarray(factor * values), notes


def _on_times(contents: Contents, axis: RecordedChannel, seconds: Array, notes: tuple[str, ...], path: str) -> Timed:
    """Return the other channels at the rows that have a time, if the times increase."""
    rows = np.flatnonzero(np.isfinite(seconds))
    left_out = len(seconds) - len(rows)
    if left_out:
        seconds = seconds[rows]
        notes += (f"{left_out} rows without a time are left out",)
    steps = np.diff(seconds)
    if len(steps) and not steps.min() > 0.0:
        first = int(np.argmax(~(steps > 0.0)))
        row, before = contents.place(int(rows[first + 1])), contents.place(int(rows[first]))
        repeated = "repeats" if steps[first] == 0.0 else "is earlier than"
        advice = (
            "remove the row, or sort the rows"
            if np.mean(steps == 0.0) < 1 - LEAST_EQUAL_SHARE
            else f"name another column with --time, {RATE_ADVICE}"
        )
        raise InputError(f"the time {seconds[first + 1]:.9g} s {repeated} that of {before}; {advice}", f"{path}, {row}")
    channels = []
    for channel in contents.channels:
        if channel.number == axis.number:
            continue
        values, fault = channel.values, channel.fault
        if left_out and len(values) == len(axis.values):
            values = values[rows]
        if not fault and len(values) != len(seconds):
            fault = f"has {len(values)} values for {len(seconds)} times"
        channels.append(replace(channel, values=values, time=seconds, fault=fault))
    return tuple(channels), notes
