"""Reading of a file, and the time of each sample: a column of times or of frame numbers, or the sampling rate.

By default, the time is the column with a name or a unit of time; without names, it is the only column that increases in
equal steps, or the only one that increases at all.  If several columns qualify, the user must choose.  So it is where a
column of times contradicts the times of a waveform, or where its steps agree with a stated rate in another unit only;
any other rate that contradicts a column is told in a note.
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
    list_labels,
    refuse_fault,
    unit_notes,
)
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.units import MAX_STEP, Unit, known_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, physical, shown

SAME_STEP = 0.01  # relative difference of a stated step from the median or the mean step of a column that agrees
MIN_EQUAL_SHARE = 0.9  # share of positive or of equal steps in a column of times
FIRST_DATE, LAST_DATE = 2e4, 1e6  # days since 1900 or since the year 0, as workbooks and MATLAB count
MIN_SAMPLES = 30  # longer records with long steps must state the unit of their times
SECONDS, OTHER_UNITS = known_unit("s", ""), ("ms", "us", "ns", "min", "h")
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
        Rows and columns of the file that the reader cannot recognise.
    progress : bool
        Whether to show a progress bar on a terminal if reading takes more than a second.

    Raises
    ------
    InputError
        If the file cannot be read, or its times are ambiguous or do not increase; the message names the remedy.

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
    recording = read_contents(path, layout=layout, progress=progress)
    return with_times(recording, time=time, time_unit=time_unit, sample_rate=sample_rate)


@np.errstate(all="ignore")  # a file may hold any numbers; what overflows is refused as not finite
def with_times(
    recording: Recording,
    *,
    time: str | int | None,
    time_unit: str | None,
    sample_rate: float | None,
) -> Recording:
    """Give the channels of a file their times, and remove the column of times; see ``read_recording``."""
    if time is None and sample_rate is None and any(channel.time is not None for channel in recording.channels):
        _check_clocks(recording)
        recording = replace(recording, channels=tuple(map(_check_times, recording.channels)))
    else:
        unit = None if time_unit is None else known_unit(time_unit, "time_unit")
        if unit and unit.quantity != "time":
            raise InputError(f"{unit.symbol!r} is a unit of {unit.quantity}, not of time", "time_unit")
        by_file = time is None and not _has_time(recording)
        if by_file and sample_rate is None and recording.time_fault:
            raise InputError(f"{recording.time_fault}; give the sampling rate with --sample-rate", recording.path)
        file_step = recording.step if by_file else None
        if sample_rate is None and file_step is None:
            recording = _from_column(recording, time, unit)
        elif sample_rate is None and file_step is not None:
            recording = _from_rate(recording, 1.0 / file_step, time)
        else:
            recording = _from_rate(recording, physical(sample_rate, "sample_rate"), time)
    return replace(recording, notes=recording.notes + unit_notes(recording.channels))


def _check_clocks(recording: Recording) -> None:
    """Check that no column of times contradicts the times that the file states for a channel of the same length."""
    for clock in _clocks(recording):
        for channel in recording.channels:
            if channel.time is None or len(channel.time) != len(clock.values) or len(channel.time) < 2:
                continue
            if not _agrees(clock, float(np.median(np.diff(channel.time)))):
                raise InputError(
                    f"differs from the times that the file states for {channel.label}; choose it with --time, or leave "
                    "it out with --leave-out",
                    f"{recording.path}: column {clock.label}",
                )


def _clocks(recording: Recording) -> list[RecordedChannel]:
    """Return the columns of times that change."""
    times = [c for c in recording.channels if is_time(c) and (c.unit is None or c.unit.quantity == "time")]
    return [channel for channel in times if not _constant(channel.values)]


def _agrees(clock: RecordedChannel, step: float, unit: Unit | None = None) -> bool:
    """Return whether a column has a step, s; its times are in ``unit``, by default in that of the file, or in s."""
    steps = (unit or clock.unit or SECONDS).factor * np.diff(clock.values)
    steps = steps[np.isfinite(steps)]
    return any(abs(usual - step) <= SAME_STEP * step for usual in (np.median(steps), np.mean(steps)) if len(steps))


def _check_times(channel: RecordedChannel) -> RecordedChannel:
    """Return a channel of a file with times, with a fault if its times are missing or do not increase."""
    if channel.time is None:
        return replace(channel, fault=channel.fault or "has no times; give the sampling rate with --sample-rate")
    steps = np.diff(channel.time)
    rising = len(channel.time) == len(channel.values) and np.isfinite(steps).all() and (steps > 0.0).all()
    return channel if rising else replace(channel, time=None, fault=channel.fault or "has times that do not increase")


def _from_column(recording: Recording, time: str | int | None, unit: Unit | None) -> Recording:
    """Take the times from a column, by default the one that ``_find_time_column`` finds."""
    if time is None and unit is None:
        recording = _with_joined_time(recording)
    channels, path = recording.channels, recording.path
    channel = _find_time_column(recording) if time is None else find_channel(channels, time, "--time", path)
    refuse_fault(channel, path)
    if unit is None and is_counter(channel):
        raise InputError("counts samples, not seconds; give --sample-rate", f"{path}: column {channel.label}")
    seconds, notes = _seconds(channel, unit, path)
    if recording.step is not None and not _agrees(channel, recording.step, unit):
        rate = f"the rate of {1.0 / recording.step:g} 1/s that the file states"
        possible = [symbol for symbol in OTHER_UNITS if _agrees(channel, recording.step, known_unit(symbol, ""))]
        if possible and not unit and not channel.unit:
            raise InputError(
                f"has no unit, and agrees with {rate} in {possible[0]}, not in s; give the unit with --time-unit",
                f"{path}: column {channel.label}",
            )
        notes += (f"column {channel.label} has another step than {rate}",)
    return _on_times(recording, channel, seconds, notes)


def _from_rate(recording: Recording, rate: float, time: str | int | None) -> Recording:
    """Give the channels their times from the sampling rate, by frame numbers if a single column has them.

    Frame numbers keep the gaps of missing frames.
    """
    counters = [channel for channel in recording.channels if is_counter(channel) and _increases(channel.values)]
    if time is not None:
        counters = [find_channel(recording.channels, time, "--time", recording.path)]
    notes = tuple(
        f"column {clock.label} has other times, and does not count"
        for clock in _clocks(recording)
        if clock not in counters and not _agrees(clock, 1.0 / rate)
    )
    if len(counters) == 1:
        counter = counters[0]
        if counter.unit:
            raise InputError(
                f"column {counter.label} has times in {counter.symbol}; leave out --sample-rate, or --time",
                recording.path,
            )
        refuse_fault(counter, recording.path)
        numbers = counter.values[np.isfinite(counter.values)]
        if not numbers.size:
            raise InputError("has no numbers", f"{recording.path}: column {counter.label}")
        seconds = (counter.values - numbers[0]) / rate
        return _on_times(recording, counter, seconds, (f"times from column {counter.label} at {rate:g} 1/s", *notes))
    seconds = np.arange(max((len(channel.values) for channel in recording.channels), default=0)) / rate
    channels = tuple(replace(channel, time=seconds[: len(channel.values)]) for channel in recording.channels)
    notes = *recording.notes, f"times from the sampling rate, {rate:g} 1/s", *notes
    return replace(recording, channels=channels, notes=notes)


def _find_time_column(recording: Recording) -> RecordedChannel:
    """Return the column of times; an error asks for a choice if it is ambiguous."""
    channels, path = recording.channels, recording.path
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
        even = [channel for channel in rising if _has_equal_steps(channel.values)]
        candidates = even or rising
        if len(candidates) == 1:
            return candidates[0]
    if candidates:
        raise InputError(
            f"the time may be column {' or '.join(c.label for c in candidates[:4])}; choose with --time", path
        )
    raise InputError(
        f"no column is clearly the time (there are {list_labels(channels)}); name one with --time, {RATE_ADVICE}", path
    )


def _has_time(recording: Recording) -> bool:
    """Return whether a column holds times, so that the sampling step that the file states is not needed."""
    return len(recording.channels) > 1 and bool(_clocks(recording))


def _with_joined_time(recording: Recording) -> Recording:
    """Return the channels of a file with one time instead of two columns of whole seconds and their fractions."""
    channels = recording.channels
    named = [channel for channel in channels if is_time(channel) or JOINED_NAME.search(channel.name)]
    pairs = [(clock, fraction) for clock in named for fraction in channels if fraction is not clock]
    for clock, fraction in pairs:
        digits = _fraction_digits(clock.values, fraction.values)
        if clock.fault or fraction.fault or digits is None:
            continue
        seconds = (clock.values - clock.values[0]) + fraction.values / 10.0**digits
        time = replace(clock, name=f"{clock.name} + {fraction.name}", values=seconds, symbol="s", unit=SECONDS)
        joined = tuple(time if channel is clock else channel for channel in channels if channel is not fraction)
        note = f"times from columns {clock.label}, whole seconds, and {fraction.label}, their fractions"
        return replace(recording, channels=joined, notes=(*recording.notes, note))
    return recording


def _fraction_digits(seconds: Array, fraction: Array) -> int | None:
    """Return the digits of fractions of a second, 0, 3, 6 or 9; None if the columns are not seconds and fractions."""
    if len(seconds) != len(fraction) or len(seconds) < 3 or not np.isfinite([seconds, fraction]).all():
        return None
    carries, falls = np.diff(seconds), np.diff(fraction) < 0.0
    if (seconds != np.floor(seconds)).any() or (carries < 0.0).any() or not falls.any() or (carries[falls] < 1.0).any():
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
    return len(steps) > 0 and bool(np.mean(steps > 0.0) >= MIN_EQUAL_SHARE)


def _has_equal_steps(values: Array) -> bool:
    steps = np.diff(values)
    usual = np.nanmedian(steps)
    # steps within 5 % of the median are equal
    return bool(np.mean(np.abs(steps - usual) <= 0.05 * usual) >= MIN_EQUAL_SHARE)


def _seconds(channel: RecordedChannel, unit: Unit | None, path: str) -> tuple[Array, tuple[str, ...]]:
    """Return the values of a time column in s, and notes."""
    where = f"{path}: column {channel.label}"
    time_unit = unit or channel.unit
    if time_unit is None and channel.symbol:
        raise InputError(
            f"the unit {shown(channel.symbol)} is not understood; give the unit of the time with --time-unit", where
        )
    if time_unit and time_unit.quantity != "time":
        raise InputError(
            f"is in {time_unit.symbol}, a unit of {time_unit.quantity}, and is no time; choose another with --time",
            where,
        )
    largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
    if time_unit is None and largest > 1e11:  # s; times beyond it must be in another unit
        raise InputError("has no unit, and its numbers are too large for s; give the unit with --time-unit", where)
    span = float(np.nanmax(channel.values, initial=-np.inf) - np.nanmin(channel.values, initial=np.inf))
    # such a small span relative to the values is a record of an hour at most
    if time_unit is None and FIRST_DATE < largest < LAST_DATE and span < 1e-6 * largest:
        raise InputError("has no unit, and may count days; give the unit with --time-unit", where)
    step = float(np.nanmedian(np.diff(channel.values), axis=None)) if len(channel.values) >= MIN_SAMPLES else 0.0
    if time_unit is None and step >= MAX_STEP:
        raise InputError(
            f"has no unit, and steps of {step:g} s are long for a vibration; give the unit with --time-unit", where
        )
    factor = time_unit.factor if time_unit else 1.0
    notes: tuple[str, ...] = () if time_unit else (f"column {channel.label} has no unit; its times are taken in s",)
    values = channel.values
    if largest * factor > 1e9:  # s; times beyond it count from 1970
        values = values - values[np.argmax(~np.isnan(values))]
        notes += ("times count from the first sample",)
    return np.asarray(factor * values), notes


def _on_times(recording: Recording, axis: RecordedChannel, seconds: Array, notes: tuple[str, ...]) -> Recording:
    """Return the other channels at the rows with a time; the times must increase."""
    rows = np.flatnonzero(np.isfinite(seconds))
    omitted = len(seconds) - len(rows)
    if omitted:
        seconds = seconds[rows]
        notes += (f"{omitted} rows without a time are left out",)
    steps = np.diff(seconds)
    if len(steps) and not steps.min() > 0.0:
        first = int(np.argmax(~(steps > 0.0)))
        row, previous = recording.place(int(rows[first + 1])), recording.place(int(rows[first]))
        repeated = "repeats" if steps[first] == 0.0 else "is earlier than"
        leave_out = "remove the row" + (f" (--skip-rows {row.split()[1]})" if recording.lines is not None else "")
        advice = (
            f"{leave_out}, or sort the rows"
            if len(np.unique(seconds)) == len(seconds)
            else leave_out
            if np.count_nonzero(steps <= 0.0) < 3
            else f"name another column with --time, {RATE_ADVICE}"
        )
        raise InputError(
            f"the time {seconds[first + 1]:.9g} s {repeated} that of {previous}; {advice}", f"{recording.path}, {row}"
        )
    channels = []
    for channel in recording.channels:
        if channel.number == axis.number:
            continue
        values, fault = channel.values, channel.fault
        if omitted and len(values) == len(axis.values):
            values = values[rows]
        if not fault and len(values) != len(seconds):
            fault = f"has {len(values)} values for {len(seconds)} times"
        channels.append(replace(channel, values=values, time=seconds, fault=fault))
    return Recording(recording.path, tuple(channels), recording.notes + notes)
