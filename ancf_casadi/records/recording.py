"""Reading of a file, and the time of each sample: a column of times or of frame numbers, or the sampling rate.

Without a choice by the caller, the time is the column that is named so or has a unit of time; without names, it is the
only column that increases in equal steps, or the only one that increases at all.  Any doubt is refused.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import (
    RecordedChannel,
    Recording,
    find_channel,
    is_counter,
    is_frequency,
    is_time,
    listed,
    unit_notes,
)
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.units import Unit, known_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, physical, shown

LEAST_EQUAL_SHARE = 0.9  # share of steps upwards, or of equal steps, that tells a column of times
FIRST_DATE, LAST_DATE = 2e4, 1e6  # days since 1900 or since the year 0, as workbooks and MATLAB count
LEAST_SAMPLES, LONGEST_STEP = 30, 1.0  # times of so many samples without a unit with such steps, s, are asked for
SECONDS = known_unit("s", "")
JOINED_NAME = re.compile(r"sec|time|zeit|stamp|epoch", re.IGNORECASE)  # of the column of whole seconds
RATE_ADVICE = "or give the sampling rate with --sample-rate"


def read_recording(
    path: str | Path,
    *,
    time: str | int | None = None,
    time_unit: str | None = None,
    sample_rate: float | None = None,
    layout: TableLayout = NO_LAYOUT,
    progress: bool = False,
) -> Recording:
    """Read a file of measurements.

    Parameters
    ----------
    path : str or Path
        The file.
    time : str or int, optional
        Name or number (from 1) of the column with the times; needed only if the reader cannot find it.
    time_unit : str, optional
        Unit of the times, such as ``ms``, in place of that in the file.
    sample_rate : float, optional
        Samples per second, for a file without times; ``time`` may then name a column of frame numbers.
    layout : TableLayout
        Rows and columns of the file that the reader cannot tell by itself.
    progress : bool
        Whether to show a progress bar on a terminal if reading takes more than a second.

    Raises
    ------
    InputError
        If the file cannot be read, or its times are not clear or do not increase; the message names the remedy.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import read_recording
    >>> _ = Path("run.txt").write_text('''frame  x_mm  y_mm
    ... 1  1.5  -2.0
    ... 2  1.4  -2.1
    ... 3  1.2  -2.3
    ... ''')
    >>> recording = read_recording("run.txt", time="frame", sample_rate=100.0)
    >>> [channel.name for channel in recording.channels], recording.time
    (['x_mm', 'y_mm'], array([0.  , 0.01, 0.02]))
    """
    check_instance(layout, "layout", TableLayout)
    found = read_contents(path, layout=layout, progress=progress)
    return with_times(found, time=time, time_unit=time_unit, sample_rate=sample_rate)


@np.errstate(all="ignore")  # a file may hold any numbers; what overflows is refused as not finite
def with_times(
    found: Recording,
    *,
    time: str | int | None = None,
    time_unit: str | None = None,
    sample_rate: float | None = None,
) -> Recording:
    """Return the channels of a file with their times, and without the column of the times; as ``read_recording``."""
    if time is None and sample_rate is None and any(channel.time is not None for channel in found.channels):
        found = replace(found, channels=tuple(map(_timed, found.channels)))
    else:
        unit = None if time_unit is None else known_unit(time_unit, "time_unit")
        if unit and unit.quantity != "time":
            raise InputError(f"{unit.symbol!r} is a unit of {unit.quantity}, not of time", "time_unit")
        stated = found.step if time is None and not _has_time(found) else None
        if sample_rate is None and stated is None:
            found = _from_column(found, time, unit)
        elif sample_rate is None and stated is not None:
            found = _from_rate(found, 1.0 / stated, time)
        else:
            found = _from_rate(found, physical(sample_rate, "sample_rate"), time)
    return replace(found, notes=found.notes + unit_notes(found.channels))


def _timed(channel: RecordedChannel) -> RecordedChannel:
    """Return a channel of a file that gives times, with a fault if its own times cannot be used."""
    if channel.time is None:
        return replace(channel, fault=channel.fault or "has no times; give the sampling rate with --sample-rate")
    steps = np.diff(channel.time)
    rising = len(channel.time) == len(channel.values) and np.isfinite(steps).all() and (steps > 0.0).all()
    return channel if rising else replace(channel, time=None, fault=channel.fault or "has times that do not increase")


def _from_column(found: Recording, time: str | int | None, unit: Unit | None) -> Recording:
    """Return times from a column."""
    if time is None and unit is None:
        found = _with_joined_time(found)
    channel = _chosen(found) if time is None else find_channel(found.channels, time, "--time", found.path)
    if channel.fault:
        raise InputError(channel.fault, f"{found.path}: column {channel.label}")
    if unit is None and is_counter(channel):
        raise InputError("counts samples, not seconds; give --sample-rate", f"{found.path}: column {channel.label}")
    seconds, notes = _seconds(channel, unit, found.path)
    return _on_times(found, channel, seconds, notes)


def _from_rate(found: Recording, rate: float, time: str | int | None) -> Recording:
    """Return times from the sampling rate, and from frame numbers if there are any."""
    counters = [channel for channel in found.channels if is_counter(channel) and _increases(channel.values)]
    if time is not None:
        counters = [find_channel(found.channels, time, "--time", found.path)]
    if len(counters) == 1:
        counter = counters[0]
        if counter.unit:
            raise InputError(
                f"column {counter.label} has times in {counter.symbol}; leave out --sample-rate, or --time", found.path
            )
        seconds = (counter.values - counter.values[0]) / rate
        return _on_times(found, counter, seconds, (f"times from column {counter.label} at {rate:g} 1/s",))
    seconds = np.arange(max((len(channel.values) for channel in found.channels), default=0)) / rate
    channels = tuple(replace(own, time=seconds[: len(own.values)]) for own in found.channels)
    return replace(found, channels=channels, notes=(*found.notes, f"times from the sampling rate, {rate:g} 1/s"))


def _chosen(found: Recording) -> RecordedChannel:
    """Return the column that must be the time."""
    channels, path = found.channels, found.path
    named = [channel for channel in channels if is_time(channel)]
    if len(named) > 1:
        named = [channel for channel in named if not _constant(channel.values)]  # such as the date
        exact = [channel for channel in named if channel.unit and channel.unit.quantity == "time"]
        named = exact if len(exact) == 1 else named
    if len(named) == 1 and len(channels) > 1:
        return named[0]
    candidates = named
    if not named and any(is_frequency(channel) for channel in channels):
        raise InputError(
            "has values over frequency, not over time; read it by FrfRecord.from_file (fit-frf), or "
            "ResponseRecord.from_file ([[curves]] of a study; without a beam fit-mode)",
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


def _has_time(found: Recording) -> bool:
    """Return whether a column must be the time, beside a step between samples in the file."""
    return (
        any(is_time(channel) and not _constant(channel.values) for channel in found.channels)
        and len(found.channels) > 1
    )


def _with_joined_time(found: Recording) -> Recording:
    """Return the channels of a file with one time instead of two columns of whole seconds and their fractions."""
    named = [channel for channel in found.channels if is_time(channel) or JOINED_NAME.search(channel.name)]
    pairs = [(whole, fraction) for whole in named for fraction in found.channels if fraction is not whole]
    for whole, fraction in pairs:
        digits = _fraction_digits(whole.values, fraction.values)
        if whole.fault or fraction.fault or digits is None:
            continue
        seconds = (whole.values - whole.values[0]) + fraction.values / 10.0**digits
        time = replace(whole, name=f"{whole.name} + {fraction.name}", values=seconds, symbol="s", unit=SECONDS)
        channels = tuple(time if channel is whole else channel for channel in found.channels if channel is not fraction)
        note = f"times from columns {whole.label}, whole seconds, and {fraction.label}, their fractions"
        return replace(found, channels=channels, notes=(*found.notes, note))
    return found


def _fraction_digits(whole: Array, fraction: Array) -> int | None:
    """Return the digits of the fractions of a second, 0, 3, 6 or 9; None unless two columns split the time so."""
    if len(whole) != len(fraction) or len(whole) < 3 or not (np.isfinite(whole).all() and np.isfinite(fraction).all()):
        return None
    carries, falls = np.diff(whole), np.diff(fraction) < 0.0
    if (whole != np.floor(whole)).any() or (carries < 0.0).any() or not falls.any() or (carries[falls] < 1.0).any():
        return None
    if (carries == 0.0).sum() < 2 or fraction.min() < 0.0:
        return None
    digits = next((digits for digits in (0, 3, 6, 9) if fraction.max() < 10.0**digits), None)
    if digits is None or fraction.max() < 0.5 * 10.0**digits:
        return None
    steps = carries + np.diff(fraction) / 10.0**digits
    return digits if (steps > 0.0).all() else None


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
    step = float(np.nanmedian(np.diff(channel.values), axis=None)) if len(channel.values) >= LEAST_SAMPLES else 0.0
    if given is None and step >= LONGEST_STEP:
        raise InputError(
            f"has no unit, and steps of {step:g} s are long for a vibration; give the unit with --time-unit", where
        )
    factor = given.factor if given else 1.0
    notes: tuple[str, ...] = () if given else (f"column {channel.label} has no unit; its times are taken in s",)
    values = channel.values
    if largest * factor > 1e9:  # s; times beyond it count from 1970
        values = values - values[np.argmax(~np.isnan(values))]
        notes += ("times count from the first sample",)
    return np.asarray(factor * values), notes


def _on_times(found: Recording, axis: RecordedChannel, seconds: Array, notes: tuple[str, ...]) -> Recording:
    """Return the other channels at the rows that have a time, if the times increase."""
    rows = np.flatnonzero(np.isfinite(seconds))
    left_out = len(seconds) - len(rows)
    if left_out:
        seconds = seconds[rows]
        notes += (f"{left_out} rows without a time are left out",)
    steps = np.diff(seconds)
    if len(steps) and not steps.min() > 0.0:
        first = int(np.argmax(~(steps > 0.0)))
        row, before = found.place(int(rows[first + 1])), found.place(int(rows[first]))
        repeated = "repeats" if steps[first] == 0.0 else "is earlier than"
        leave_out = "remove the row" + (f" (--skip-rows {row.split()[1]})" if found.lines is not None else "")
        advice = (
            f"{leave_out}, or sort the rows"
            if len(np.unique(seconds)) == len(seconds)
            else leave_out
            if np.count_nonzero(steps <= 0.0) < 3
            else f"name another column with --time, {RATE_ADVICE}"
        )
        raise InputError(
            f"the time {seconds[first + 1]:.9g} s {repeated} that of {before}; {advice}", f"{found.path}, {row}"
        )
    channels = []
    for channel in found.channels:
        if channel.number == axis.number:
            continue
        values, fault = channel.values, channel.fault
        if left_out and len(values) == len(axis.values):
            values = values[rows]
        if not fault and len(values) != len(seconds):
            fault = f"has {len(values)} values for {len(seconds)} times"
        channels.append(replace(channel, values=values, time=seconds, fault=fault))
    return Recording(found.path, tuple(channels), found.notes + notes)
