"""Recordings: all channels of a file with their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.time_axis import find_channel, is_counter, is_time, listed, timed_channels
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Displayed, counted


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
        Decisions of the reader that the user should know.

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

    def channel(self, column: str | int | None = None) -> RecordedChannel:
        """Return the channel with a name or number, or the only one with measured values; it must be usable."""
        if column is not None:
            found = find_channel(self.channels, column, "--column", self.path)
        else:
            values = [c for c in self.channels if not is_time(c) and not is_counter(c)]
            usable = [channel for channel in values if not channel.fault] or values or list(self.channels)
            if len(usable) != 1:
                what = f"has {len(usable)} columns of values, {listed(usable)}" if usable else "has no column of values"
                raise InputError(f"{what}; choose with --column" if usable else what, self.path)
            (found,) = usable
        if found.fault:
            raise InputError(found.fault, f"{self.path}: column {found.label}")
        return found

    def _summary(self) -> str:
        samples = max((len(own.values) for own in self.channels), default=0)
        return f"{self.name!r}, {counted(len(self.channels), 'channel')}, {counted(samples, 'sample')}"


def read_recording(
    path: str | Path,
    *,
    time: str | int | None = None,
    time_unit: str | None = None,
    sample_rate: float | None = None,
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
    contents = read_contents(path, progress=progress)
    return recording_of(contents, path, time=time, time_unit=time_unit, sample_rate=sample_rate)


@np.errstate(all="ignore")  # a file may hold any numbers; what overflows is refused as not finite
def recording_of(
    contents: Contents,
    path: str | Path,
    *,
    time: str | int | None = None,
    time_unit: str | None = None,
    sample_rate: float | None = None,
) -> Recording:
    """Return the channels of a file with their times; as ``read_recording``, for contents that have been read."""
    notes: tuple[str, ...] = ()
    if time is None and sample_rate is None and any(channel.time is not None for channel in contents.channels):
        channels = tuple(map(_timed, contents.channels))
    else:
        channels, notes = timed_channels(contents, str(path), time=time, time_unit=time_unit, sample_rate=sample_rate)
    return Recording(str(path), channels, contents.notes + notes + unit_notes(channels))


def unit_notes(channels: Sequence[RecordedChannel]) -> tuple[str, ...]:
    """Return a note of the channels without a unit, if there are any."""
    bare = [channel for channel in channels if not (channel.symbol or channel.fault or is_counter(channel))]
    return (f"no unit is given for {listed(bare)}; SI units are assumed",) if bare else ()


def _timed(channel: RecordedChannel) -> RecordedChannel:
    """Return a channel of a file that gives times, with a fault if its own times cannot be used."""
    if channel.time is None:
        return replace(channel, fault=channel.fault or "has no times; give the sampling rate with --sample-rate")
    steps = np.diff(channel.time)
    rising = len(channel.time) == len(channel.values) and np.isfinite(steps).all() and (steps > 0.0).all()
    return channel if rising else replace(channel, time=None, fault=channel.fault or "has times that do not increase")
