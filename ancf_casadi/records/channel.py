"""The channels of a file: their names, their units as written, their numbers, and their times."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.units import Unit, names_time
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import check_instance, shown
from ancf_casadi.support.tables import Displayed, plural

COUNTER_NAME = re.compile(
    r"(?:sub|frames?|samples?|scans?|index|row|record|point|count(?:er)?|bildnummer)?[ _.#-]*"
    r"(?:frames?|samples?|scans?|points?|sequence|index|number|num|no|nr|n|#|id|count(?:er)?|idx)\.?",
    re.IGNORECASE,
)
PATH = re.compile(r"[\w\[\]]+(?:\.[\w\[\]]+)+")
FREQUENCY_NAME = re.compile(
    r"f|hz|(?:.*[ _-])?(?:freq|frequency|frequencies|frequenz|fréquence|frecuencia)", re.IGNORECASE
)


@dataclass(frozen=True, eq=False)
class RecordedChannel(Displayed):
    """One column of a file, or one channel of a measuring system."""

    number: int  # number of the column in the file, from 1
    name: str
    values: Array  # in the unit of the file; nan marks a gap
    symbol: str = ""  # unit as written in the file; empty if there is none
    unit: Unit | None = None  # None if there is no unit, or it is unknown
    time: Array | None = None  # time of each value, s, if the file states it
    fault: str = ""  # reason why the column cannot be used; empty if there is none
    reference: str = ""  # of a frequency response function: its input, if the file names it

    @property
    def label(self) -> str:
        """Number and name, for messages."""
        return f"{self.number} {shown(self.name)}"

    def _summary(self) -> str:
        return f"{self.label}, {plural(len(self.values), 'sample')}"


@dataclass(frozen=True, eq=False)
class Recording(Displayed):
    """The channels of a file.

    Parameters
    ----------
    path : str
        Path of the file.
    channels : tuple of RecordedChannel
        The channels without the time, each with its values as written, its unit and its times.
    notes : tuple of str
        Decisions of the reader of which the user should be aware.
    lines : ndarray, optional
        Line of each row in a text file.
    step : float, optional
        Time between samples, s, if the file states it beside the columns.
    time_fault : str
        Reason why the times that the file states cannot be used; empty if there is none.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import Measurement, read_recording
    >>> _ = Path("run.csv").write_text('''t (s);x (mm);force (N)
    ... 0,0;1,5;0,20
    ... 0,1;1,4;0,18
    ... ''')
    >>> recording = read_recording("run.csv")
    >>> recording.channel("x (mm)").values
    array([1.5, 1.4])
    >>> Measurement.from_recording(recording, "force (N)").sensor.quantity
    'force'
    """

    path: str
    channels: tuple[RecordedChannel, ...]
    notes: tuple[str, ...] = ()
    lines: Index | None = None
    step: float | None = None
    time_fault: str = ""

    @property
    def name(self) -> str:
        """Name of the file."""
        return Path(self.path).name

    @property
    def time(self) -> Array:
        """Times of the samples, s; channels that do not share them raise an ``InputError``."""
        times = [channel.time for channel in self.channels if channel.time is not None]
        if not times or any(time is not times[0] and not np.array_equal(time, times[0]) for time in times[1:]):
            raise InputError("its channels have times of their own; use the time of a channel", self.path)
        return times[0]

    @property
    def measured(self) -> list[RecordedChannel]:
        """The channels with measured values that can be read, without times and counters."""
        return [c for c in self.channels if not (c.fault or is_time(c) or is_counter(c))]

    def channel(self, column: str | int | None = None) -> RecordedChannel:
        """Return the channel with a name or number, or the only one with measured values; it must be usable."""
        if column is not None:
            channel = find_channel(self.channels, column, "--column", self.path)
        else:
            values = [c for c in self.channels if not is_time(c) and not is_counter(c)]
            usable = self.measured or values or list(self.channels)
            if not usable:
                raise InputError("has no column of values", self.path)
            if len(usable) > 1:
                widest = f" ({widest_channel(self.measured).label} has the widest range)" if self.measured else ""
                raise InputError(
                    f"has {len(usable)} columns of values, {list_labels(usable)}; choose with --column{widest}",
                    self.path,
                )
            (channel,) = usable
        refuse_fault(channel, self.path)
        return channel

    def place(self, row: int) -> str:
        """Return the place of a row in the file, for messages."""
        return f"sample {row + 1}" if self.lines is None else f"line {self.lines[row]}"

    def _summary(self) -> str:
        samples = max((len(channel.values) for channel in self.channels), default=0)
        return f"{self.name!r}, {plural(len(self.channels), 'channel')}, {plural(samples, 'sample')}"


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
    raise InputError(f"{option} {shown(wanted)}: {fault}; there are {list_labels(channels)}", path)


def refuse_fault(channel: RecordedChannel, path: str) -> None:
    """Raise an ``InputError`` for a channel that cannot be used."""
    if channel.fault:
        raise InputError(channel.fault, f"{path}: column {channel.label}")


def widest_channel(channels: Iterable[RecordedChannel]) -> RecordedChannel:
    """Return the channel whose values have the widest range."""
    return max(channels, key=lambda channel: float(np.nanmax(channel.values) - np.nanmin(channel.values)))


def list_labels(channels: Sequence[RecordedChannel]) -> str:
    """Return numbers and names of channels, for messages."""
    shortened = ", ".join(channel.label for channel in channels[:8])
    return f"{shortened}, ... ({len(channels)} in all)" if len(channels) > 8 else shortened


def _last_name(name: str) -> str:
    """Return the name, or the last component of a path such as ``run[2].time``."""
    return name.rpartition(".")[2] if PATH.fullmatch(name) else name.strip()


def is_time(channel: RecordedChannel) -> bool:
    """Return whether the name or the unit of a channel denotes times."""
    return bool(channel.unit and channel.unit.quantity == "time") or names_time(_last_name(channel.name))


def is_frequency(channel: RecordedChannel) -> bool:
    """Return whether the name or the unit of a channel denotes frequencies."""
    if channel.unit or channel.symbol:
        return bool(channel.unit and channel.unit.quantity == "frequency")
    if FREQUENCY_NAME.fullmatch(_last_name(channel.name)) is None:
        return False
    values = channel.values[np.isfinite(channel.values)]  # f may be a force as well
    return bool((values >= 0.0).all()) and (
        bool((np.diff(values) >= 0.0).all()) or bool((np.diff(values) <= 0.0).all())
    )


def is_counter(channel: RecordedChannel) -> bool:
    """Return whether a channel counts the samples or the frames."""
    named = COUNTER_NAME.fullmatch(_last_name(channel.name)) is not None and not channel.symbol
    numbers = channel.values[np.isfinite(channel.values)]
    return named and bool(np.all(numbers == np.floor(numbers)))


def unit_notes(channels: Sequence[RecordedChannel]) -> tuple[str, ...]:
    """Return a note on the channels without a unit, if there are any."""
    bare = [channel for channel in channels if not (channel.symbol or channel.fault or is_counter(channel))]
    return (f"no unit is given for {list_labels(bare)}; SI units are assumed",) if bare else ()
