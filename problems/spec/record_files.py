"""Files of measurements as keys of a table: rows and columns, times, and the sensor of a channel."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import with_times
from ancf_casadi.records.sensor import Frame, Quantity, Sensor, assign_sensor
from ancf_casadi.records.units import known_unit, mass_factor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import Pair, Positive, Spec
from problems.spec.file import StudyFile

ColumnName = str | int  # name of a column, or its number from 1


class RecordFile(Spec, frozen=True, kw_only=True):
    """A file of measurements, with the rows and columns that its reader cannot tell by itself."""

    file: str
    names_row: Annotated[int | None, Meta(description="line with the names of the columns, from 1")] = None
    skip_rows: Annotated[tuple[int, ...], Meta(description="lines to leave out")] = ()
    leave_out: Annotated[tuple[ColumnName, ...], Meta(description="columns to leave out")] = ()

    def contents(self, file: StudyFile, where: str) -> Recording:
        """Return the columns of the file, beside that of a study; it is opened once."""
        with error_prefix(where):
            return file.record_files.recording(str(file.beside(self.file)), TableLayout.of(self.set_fields()))


class FileSpec(RecordFile, frozen=True, kw_only=True):
    """A file of measurements, and its times."""

    time: Annotated[ColumnName | None, Meta(description="column of the times")] = None
    time_unit: Annotated[str | None, Meta(description="unit of the times, if the file does not say it")] = None
    sample_rate: Annotated[float | None, Meta(description="1/s, for a file without times")] = None

    def recording(self, file: StudyFile, where: str) -> Recording:
        """Return the columns of the file with their times."""
        contents = self.contents(file, where)
        with error_prefix(where):
            return with_times(contents, time=self.time, time_unit=self.time_unit, sample_rate=self.sample_rate)


class ColumnSpec(FileSpec, frozen=True, kw_only=True):
    """A column of a file of measurements."""

    column: Annotated[ColumnName | None, Meta(description="column of the values, by name or number from 1")] = None
    unit: Annotated[str | None, Meta(description="unit of the values, if the file does not say it")] = None
    begin: Annotated[float | None, Meta(description="leave out what is before, s")] = None
    end: Annotated[float | None, Meta(description="leave out what is after, s")] = None

    def measurement(self, file: StudyFile, where: str, sensor: Sensor | None = None) -> Measurement:
        """Return the values over time."""
        recording = self.recording(file, where)
        with error_prefix(where):
            record = Measurement.from_recording(recording, self.column, unit=self.unit, sensor=sensor)
            return record.cut(self.begin, self.end)


class ChannelSpec(ColumnSpec, frozen=True, kw_only=True):
    """A channel of a motion, and what is not known of it."""

    std: Annotated[Positive | None, Meta(description="standard deviation")] = None
    offset: Annotated[Pair | None, Meta(description="bounds of an unknown time offset, s")] = None
    zero: Annotated[Pair | None, Meta(description="bounds of an unknown reading at rest")] = None


class CurveFileSpec(RecordFile, frozen=True, kw_only=True):
    """A file with a curve, and its columns, if their names do not tell them."""

    frequency: Annotated[ColumnName | None, Meta(description="column of frequencies")] = None
    column: Annotated[ColumnName | None, Meta(description="column of amplitudes or real parts")] = None
    phase: Annotated[ColumnName | None, Meta(description="column of phases")] = None
    level: ColumnName | None = None
    imaginary: Annotated[ColumnName | None, Meta(description="column of imaginary parts")] = None
    unit: Annotated[str | None, Meta(description="unit of the values, such as mm, g or mm/N")] = None
    phase_unit: Annotated[str | None, Meta(description="deg or rad")] = None
    level_unit: str | None = None


class StaticColumnSpec(Spec, frozen=True, kw_only=True):
    """A column of a file with the readings of a static test, one case per row."""

    column: Annotated[ColumnName, Meta(description="column of the values, by name or number from 1")]
    unit: Annotated[str | None, Meta(description="unit of the values, if the file does not say it")] = None
    std: Annotated[float | str, Meta(description="standard deviation, or the column with it")] = math.nan

    def values_and_std(self, contents: Recording, sensor: Sensor) -> tuple[Array, Array]:
        """Return the readings, nan where there is a gap, and their standard deviations, in SI units."""
        values = si_column(contents, self.column, "column", None, self.unit, sensor)
        if isinstance(self.std, str):
            return values, si_column(contents, self.std, "std", len(values), self.unit, sensor)
        return values, np.full(len(values), self.std)


LOAD_SENSORS = {"force": Sensor("force"), "moment": Sensor("moment"), "point": Sensor("position")}


def si_column(
    contents: Recording, column: ColumnName, key: str, count: int | None, unit: str | None, sensor: Sensor | None = None
) -> Array:
    """Return the column that a key of a table names, in the SI unit of a sensor or, without a sensor, of the load."""
    with error_prefix(key):
        channel = contents.channel(column)
        with error_prefix(f"{contents.path}: column {channel.label}"):
            stated_unit = channel.unit if unit is None else known_unit(unit, "unit")
            if stated_unit is None and (sensor is None or sensor.unit):
                raise InputError(
                    "has no unit that is known; write it in the name of the column or, for readings, masses and "
                    "forces, give the key unit"
                )
            if count not in (None, len(channel.values)):
                raise InputError(f"has {len(channel.values)} rows, but the readings have {count}")
            if sensor is None and (gaps := np.flatnonzero(~np.isfinite(channel.values))).size:
                raise InputError("has no number, and each case needs its load", contents.place(int(gaps[0])))
            if key == "mass" and stated_unit:
                return channel.values * mass_factor(stated_unit)
            return channel.values * assign_sensor(channel, stated_unit, sensor or LOAD_SENSORS[key])[0]


class SensorSpec(Spec, frozen=True):
    """The quantity that a sensor measures, its point and its direction."""

    sensor: Quantity | UnsetType = UNSET
    point: Annotated[float | None, Meta(description="m, the tip if not given")] = None
    direction: Pair = (1.0, 0.0)
    frame: Frame = "inertial"
    gravity: Annotated[bool, Meta(description="whether an accelerometer feels it")] = False
    distance: Annotated[float | None, Meta(description="m, of a strain gauge from the neutral axis")] = None

    def make(self, quantity: Quantity, where: str) -> Sensor:
        """Return the sensor; ``quantity`` is what it measures if the table does not say."""
        arguments = self.set_fields()
        with error_prefix(where):
            return Sensor(arguments.pop("sensor", quantity), **arguments)
