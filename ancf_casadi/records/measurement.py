"""The record of one sensor over time, from arrays or a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Recording, unit_notes
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.processing import (
    amplitude_spectrum,
    band_pass,
    decimate,
    quality_warnings,
    sampling_step,
    without_line,
)
from ancf_casadi.records.recording import read_recording
from ancf_casadi.records.sensor import Sensor, assign_sensor
from ancf_casadi.records.units import known_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, drawing
from ancf_casadi.support.inputs import LARGEST_TIME, array, check_instance, error_prefix, number, physical, whole
from ancf_casadi.support.tables import Displayed, plural, spread

MIN_SAMPLES = 30  # new samples of a record that can be decimated: the length of the filter


@dataclass(frozen=True, eq=False, init=False)
class Measurement(Displayed):
    """Record of one sensor over time.

    Parameters
    ----------
    time : array_like
        Times, s, increasing; they need not be equally spaced.  Stored as a read-only array.
    values : array_like
        Value at each time, in the SI unit of the sensor; nan marks a gap, and its sample is left out.  Stored as a
        read-only array.
    name : str
        Source of the record, for reports.
    sensor : Sensor
        Quantity and place of the sensor; a displacement of the tip if not given.
    notes : sequence of str
        Decisions of the reader of a file, which a fit repeats among its warnings.

    Raises
    ------
    InputError
        If the arrays are not vectors of finite numbers of one length, at least 2, or the times do not increase.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement, Sensor
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time), name="laser")
    >>> record.sensor.quantity, record.sensor.unit
    ('displacement', 'm')
    >>> strain = Measurement(time, 1e-4 * np.cos(12.0 * time), sensor=Sensor("strain", point=0.01))
    """

    time: Array
    values: Array
    name: str
    sensor: Sensor
    notes: tuple[str, ...]

    def __init__(
        self,
        time: ArrayLike,
        values: ArrayLike,
        name: str = "",
        sensor: Sensor | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        """Validate, and store read-only copies."""
        check_instance(sensor, "sensor", Sensor, NoneType)
        times, measured = _series(time, "time"), _series(values, "values", gaps=True)
        if len(times) != len(measured):
            raise InputError(f"has {len(measured)} values for {len(times)} times", "values")
        present = ~np.isnan(measured)
        object.__setattr__(self, "time", _read_only(times[present]))
        object.__setattr__(self, "values", _read_only(measured[present]))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "sensor", sensor or Sensor())
        object.__setattr__(self, "notes", tuple(notes))
        if len(self.time) < 2:
            raise InputError(f"needs at least 2 samples, got {len(self.time)}", "time")
        steps = np.diff(self.time)
        if steps.min() <= 0.0:
            first = int(np.argmax(steps <= 0.0))
            before, after = self.time[first], self.time[first + 1]
            raise InputError(f"must increase, but sample {first + 2} ({after:g} s) follows {before:g} s", "time")
        physical(self.time[-1] - self.time[0], "time")

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        column: str | int | None = None,
        *,
        time: str | int | None = None,
        unit: str | None = None,
        time_unit: str | None = None,
        sample_rate: float | None = None,
        sensor: Sensor | None = None,
        layout: TableLayout = NO_LAYOUT,
        progress: bool = False,
    ) -> Measurement:
        """Read one channel of a file.

        Parameters
        ----------
        path : str or Path
            File in any format that ``read_recording`` reads.
        column : str or int, optional
            Name or number (from 1) of the column with the values; not needed if there is only one.
        time, time_unit, sample_rate, layout, progress
            See ``read_recording``.
        unit : str, optional
            Unit of the values, such as ``mm``, in place of that in the file; without either, the SI unit of the sensor.
        sensor : Sensor, optional
            Quantity and place of the sensor; if not given, the unit determines the quantity, and values without a unit
            are displacements.

        Raises
        ------
        InputError
            As in ``read_recording`` and ``Measurement``; or if the column is ambiguous, or its unit is unknown or does
            not fit the sensor.

        Examples
        --------
        >>> from pathlib import Path
        >>> from ancf_casadi import Measurement
        >>> _ = Path("decay.csv").write_text('''time [s],tip [mm]
        ... 0.00,12.1
        ... 0.01,11.8
        ... 0.02,10.9
        ... ''')
        >>> Measurement.from_file("decay.csv").values.round(4)  # m
        array([0.0121, 0.0118, 0.0109])
        """
        recording = read_recording(
            path, time=time, time_unit=time_unit, sample_rate=sample_rate, layout=layout, progress=progress
        )
        return cls.from_recording(recording, column, unit=unit, sensor=sensor)

    @classmethod
    @np.errstate(all="ignore")  # a value that overflows is refused as not finite
    def from_recording(
        cls,
        recording: Recording,
        column: str | int | None = None,
        *,
        unit: str | None = None,
        sensor: Sensor | None = None,
    ) -> Measurement:
        """Return one channel of a recording; arguments and errors are those of ``from_file``."""
        check_instance(recording, "recording", Recording)
        check_instance(sensor, "sensor", Sensor, NoneType)
        stated_unit = None if unit is None else known_unit(unit, "unit")
        channel = recording.channel(column)
        with error_prefix(f"{recording.path}: column {channel.label}"):
            if channel.time is None:
                raise InputError("has no times; give the sampling rate with --sample-rate")
            scale, measured = assign_sensor(channel, stated_unit, sensor)
            values = channel.values if scale == 1.0 else scale * channel.values
            unit_notes_of_all = unit_notes(recording.channels)
            notes = [note for note in recording.notes if note not in unit_notes_of_all]
            notes += () if stated_unit else unit_notes([channel])
            if measured.quantity == "signal":
                notes.append(
                    f"column {channel.label} is in {measured.unit or 'its unit'}, without a scale: sizes hold for this "
                    "sensor only; frequency and linear damping do not need one"
                )
            return cls(channel.time, values, recording.name, measured, [f"{recording.name}: {note}" for note in notes])

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Notes of the reader, and faults such as clipping; a fit repeats them."""
        return (*self.notes, *quality_warnings(self.time, self.values))

    def cut(self, begin: float | None = None, end: float | None = None) -> Measurement:
        """Return the record from ``begin`` to ``end`` (s, both included; the ends of the record by default).

        Raises
        ------
        InputError
            If fewer than two samples remain.

        Examples
        --------
        >>> from ancf_casadi import Measurement
        >>> record = Measurement([0.0, 0.1, 0.2, 0.3], [0.0, 0.01, 0.02, 0.01])
        >>> record.cut(0.1, 0.2).values
        array([0.01, 0.02])
        """
        first = self.time[0] if begin is None else number(begin, "begin")
        last = self.time[-1] if end is None else number(end, "end")
        inside = (self.time >= first) & (self.time <= last)
        if np.count_nonzero(inside) < 2:
            raise InputError(
                f"from {first:g} to {last:g} s there are {np.count_nonzero(inside)} samples of a record from "
                f"{self.time[0]:g} to {self.time[-1]:g} s; needs at least 2",
                "cut",
            )
        return self._with(self.time[inside], self.values[inside])

    def decimated(self, factor: int) -> Measurement:
        """Return the record with every ``factor``-th sample, after a low-pass filter without phase shift.

        The filter passes frequencies up to 40 % of the new sampling rate.  The first and last 13 new samples, which
        would need samples beyond the record, are left out.  Cut the record at a release first, as the option
        ``--decimate`` does: a smoothed release biases the fit by many standard errors.

        Raises
        ------
        InputError
            If the record is not evenly sampled, or has fewer than 30 samples per unit of the factor.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> time = np.arange(10_000) / 5000.0
        >>> record = Measurement(time, 0.02 * np.cos(12.0 * time))
        >>> record.decimated(10).time.size
        974
        """
        whole(factor, "factor", 1)
        if factor == 1:
            return self
        if len(self.time) < MIN_SAMPLES * factor:
            raise InputError(
                f"{len(self.time)} samples are too few; needs {MIN_SAMPLES} per unit of the factor", "factor"
            )
        self._step()
        values, first = decimate(self.values, factor)
        return self._with(self.time[first::factor][: len(values)], values)

    def filtered(self, low: float | None = None, high: float | None = None) -> Measurement:
        """Return the record after a band-pass filter without phase shift, between two frequencies (Hz).

        Amplitudes within the band change by less than 1e-4; frequencies below half of ``low`` and above 1.5 ``high``
        are suppressed by 80 dB.  The first and last 5 periods of ``low`` and of ``high``, which would need samples
        beyond the record, are left out.  A fit needs no filter against noise, and hardly gains from one.

        Raises
        ------
        InputError
            If the record is not evenly sampled or too short, or the frequencies are not in order below half the rate.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> time = np.arange(5000) / 500.0
        >>> hum = 0.01 * np.sin(2 * np.pi * 50.0 * time)
        >>> record = Measurement(time, 0.02 * np.cos(12.0 * time) + hum).filtered(high=10.0)
        >>> bool(np.abs(record.values - 0.02 * np.cos(12.0 * record.time)).max() < 1e-5)
        True
        """
        half_rate = 0.5 / self._step()
        limits = [None if limit is None else physical(limit, "band") / half_rate for limit in (low, high)]
        stated_limits = [limit for limit in limits if limit is not None]
        if not stated_limits or stated_limits != sorted(stated_limits) or stated_limits[-1] >= 1.0:
            raise InputError(f"give low, high or both, in order and below half the rate, {half_rate:g} Hz", "band")
        values, first = band_pass(self.values, *limits)
        if len(values) < 2:
            raise InputError("the record is shorter than the filter, 10 periods of low and of high", "band")
        return self._with(self.time[first : first + len(values)], values)

    def spectrum(self) -> tuple[Array, Array]:
        """Return frequencies, Hz, and amplitudes, in the unit of the sensor, of the sines in the record.

        The record is multiplied by a Hann window, which widens each line to four steps of the frequency.

        Raises
        ------
        InputError
            If the record is not evenly sampled.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi import Measurement
        >>> time = np.arange(1000) / 100.0
        >>> frequencies, amplitudes = Measurement(time, 0.02 * np.sin(2 * np.pi * 5.0 * time)).spectrum()
        >>> round(float(frequencies[amplitudes.argmax()]), 3), round(float(amplitudes.max()), 4)
        (5.0, 0.02)
        """
        self._step()
        return amplitude_spectrum(self.time, self.values)

    def _step(self) -> float:
        """Return the time between samples, s; refuse uneven ones."""
        with error_prefix(self.name or "record"):
            return sampling_step(self.time)

    def _with(self, time: Array, values: Array) -> Measurement:
        """Return another record of the same sensor."""
        return Measurement(time, values, self.name, self.sensor, self.notes)

    def detrended(self) -> Measurement:
        """Return the record without its least-squares straight line, such as the drift of a sensor.

        Examples
        --------
        >>> from ancf_casadi import Measurement
        >>> record = Measurement([0.0, 1.0, 2.0, 3.0], [0.1, 0.3, 0.1, 0.3])
        >>> record.detrended().values.round(2)
        array([-0.04,  0.12, -0.12,  0.04])
        """
        return self._with(self.time, without_line(self.time, self.values))

    def figure(self) -> Figure:
        """Draw the record over time."""
        label = f"{self.sensor.quantity}, {self.sensor.unit}" if self.sensor.unit else self.sensor.quantity
        return drawing("ancf_casadi.figures.records.record_figure")(label, self.time, self.values, self.name)

    def _summary(self) -> str:
        phrases = (repr(self.name), plural(len(self.time), "sample"), spread(self.time, "s"), self.sensor.quantity)
        return ", ".join((*phrases[not self.name :], *filter(None, [self.sensor.unit])))


def _series(values: ArrayLike, where: str, *, gaps: bool = False) -> Array:
    series = array(values, where, finite=False)
    if series.ndim != 1:
        raise InputError(f"must be a vector, got an array of shape {series.shape}", where)
    usable = np.isfinite(series) | (np.isnan(series) & gaps)
    beyond = usable & (np.abs(series) > LARGEST_TIME) & gaps  # of times, the span is checked
    if beyond.any():
        first = int(np.argmax(beyond))
        raise InputError(f"sample {first + 1}, {series[first]:g}, is beyond {LARGEST_TIME:g}; check the unit", where)
    if not usable.all():
        first = int(np.argmin(usable))
        raise InputError(f"must be finite; sample {first + 1} is {series[first]}", where)
    return series


def _read_only(series: Array) -> Array:
    series.flags.writeable = False
    return series
