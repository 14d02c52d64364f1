"""Files of measurements as keys of a table: rows and columns, times, and the sensor of a channel."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.records.channel import Recording
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import with_times
from ancf_casadi.records.sensor import Frame, Quantity, Sensor
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
