"""Planned records: experiments of any kind, described without measured values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, check_instance, flag, instances, physical, positive_array
from ancf_casadi.support.tables import Displayed
from problems.beam.curves.record import TIP_DISPLACEMENT, ResponseRecord
from problems.beam.motions.marker_record import MarkerRecord
from problems.beam.motions.record import Bounds, Channel, MotionRecord
from problems.beam.values.records import FrequencyRecord, PropertyRecord, StaticRecord

MOST_SAMPLES = 1e6  # largest number of samples of a planned motion

Template = MotionRecord | ResponseRecord | PropertyRecord
R = TypeVar("R", bound=Template)


@dataclass(frozen=True, eq=False)
class PlannedRecord(Displayed):
    """An experiment that could be done: what is measured and how well, without values.

    The class methods describe one of each kind.  A record that exists stands for its repetition.

    Parameters
    ----------
    template : MotionRecord, MarkerRecord, ResponseRecord, StaticRecord or FrequencyRecord
        The record; ``plan`` puts computed values in place of its own.
    cost : float
        Cost of the experiment, in any unit that all candidates share.

    Raises
    ------
    InputError
        If the template is no record, or the cost is not positive.

    Examples
    --------
    >>> from ancf_casadi import HarmonicBase, Sensor
    >>> from problems import PlannedRecord
    >>> base = HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> PlannedRecord.motion(Sensor("displacement"), duration=10.0, sample_rate=100.0, std=1e-4, base=base, cost=2.0)
    PlannedRecord(motion, 1 channel, 1001 samples, HarmonicBase(amplitude=0.005, frequency=1.9), cost 2)
    """

    template: Template
    cost: float = 1.0

    def __post_init__(self) -> None:
        """Validate."""
        if isinstance(self.template, MarkerRecord):
            object.__setattr__(self, "template", self.template.motion_record)
        check_instance(self.template, "template", MotionRecord, ResponseRecord, StaticRecord, FrequencyRecord)
        object.__setattr__(self, "cost", physical(self.cost, "cost"))

    @classmethod
    def motion(
        cls,
        sensors: Sensor | Sequence[Sensor],
        *,
        duration: float,
        sample_rate: float,
        std: ArrayLike | None = None,
        offset: Bounds | None = None,
        zero: Bounds | None = None,
        cost: float = 1.0,
        **settings: Any,
    ) -> Self:
        """Describe a motion: sensors that are read at equal intervals.

        Parameters
        ----------
        sensors : Sensor or sequence of Sensor
            The sensors.
        duration, sample_rate : float
            Length of the record, s, and samples per second.
        std : float or array_like, optional
            Standard deviation of the noise of all sensors, or of each, in their units; that of the same sensor in an
            earlier fit if not given.
        offset, zero : (float, float), optional
            Bounds of unknown time offsets and readings at rest, of each sensor, as in ``Channel``.
        cost : float
            Cost of the experiment.
        **settings
            Other arguments of ``MotionRecord``: ``base``, ``start``, ``release_time``, ``camera``, ``load``, ``model``.

        Raises
        ------
        InputError
            If a number is not positive, or as in ``MotionRecord``.
        """
        all_sensors = (sensors,) if isinstance(sensors, Sensor) else instances(sensors, "sensors", Sensor)
        duration, sample_rate = physical(duration, "duration"), physical(sample_rate, "sample_rate")
        if duration * sample_rate > MOST_SAMPLES:
            raise InputError(f"{duration * sample_rate:.3g} samples are too many; lower it, or sample_rate", "duration")
        time = np.arange(1 + round(duration * sample_rate)) / sample_rate
        stds = [None] * len(all_sensors) if std is None else positive_array(std, "std", (len(all_sensors),)).tolist()
        channels = [
            Channel(Measurement(time, time, sensor=sensor), std, offset, zero)
            for sensor, std in zip(all_sensors, stds, strict=True)
        ]
        return cls(MotionRecord(channels, **settings), cost)

    @classmethod
    def response(
        cls, frequencies: ArrayLike, *, sensor: Sensor = TIP_DISPLACEMENT, phases: bool = True, cost: float = 1.0,
        **settings: Any,
    ) -> Self:  # fmt: skip
        """Describe a response curve: steady vibration at several frequencies.

        Where several motions are possible, the one of least amplitude is meant, which begins at rest.

        Parameters
        ----------
        frequencies : array_like
            Frequencies of the excitation, Hz.
        sensor : Sensor
            The sensor.
        phases : bool
            Whether phases are measured too.
        cost : float
            Cost of the experiment.
        **settings
            Other arguments of ``ResponseRecord``: ``base`` or ``load``, ``levels``, ``control``, ``amplitude_std``,
            ``phase_std``, ``level_std``, ``model``.

        Raises
        ------
        InputError
            As in ``ResponseRecord``.
        """
        f = array(frequencies, "frequencies")
        unmeasured_phases = np.zeros(f.shape) if flag(phases, "phases") else None
        return cls(ResponseRecord(f, np.ones(f.shape), unmeasured_phases, sensor, **settings), cost)

    @classmethod
    def static(
        cls, model: Model, loads: Sequence[PointLoad | Sequence[PointLoad]], sensors: Sensor | Sequence[Sensor], *,
        std: ArrayLike, tared: bool = False, cost: float = 1.0,
    ) -> Self:  # fmt: skip
        """Describe a static test: readings of a beam at rest under loads.

        Parameters
        ----------
        model, loads, sensors, tared
            As in ``StaticRecord``.
        std : float or array_like
            Standard deviation of the readings: one for all, one per sensor, or one for each value.
        cost : float
            Cost of the experiment.

        Raises
        ------
        InputError
            As in ``StaticRecord``.
        """
        count = 1 if isinstance(sensors, Sensor) else len(instances(sensors, "sensors", Sensor))
        cases = len(instances(loads, "loads", object))
        return cls(StaticRecord(model, loads, np.ones((cases, count)), sensors, std, tared), cost)

    @classmethod
    def natural_frequencies(cls, model: Model, modes: Sequence[int], *, std: ArrayLike, cost: float = 1.0) -> Self:
        """Describe a measurement of natural frequencies.

        Parameters
        ----------
        model, modes
            As in ``FrequencyRecord``.
        std : float or array_like
            Standard deviation of the frequencies, Hz.
        cost : float
            Cost of the experiment.

        Raises
        ------
        InputError
            As in ``FrequencyRecord``.
        """
        return cls(FrequencyRecord(model, np.ones(len(instances(modes, "modes", object))), std, modes), cost)

    @property
    def kind(self) -> str:
        """Kind of the record: motion, response, static or frequency."""
        return type(self.template).__name__.removesuffix("Record").lower()

    def _summary(self) -> str:
        return f"{self.kind}, {self.template._summary()}, cost {self.cost:g}"


def with_values(template: R, values: Array) -> R:
    """Return a record with other values in the order of its residuals; those of a response are (m, 3) with levels."""
    record: Any = template
    if isinstance(record, ResponseRecord):
        record = replace(record, values=values[:, 0], phases=None if record.phases is None else values[:, 1])
    elif isinstance(record, FrequencyRecord):
        record = replace(record, frequencies=values)
    elif isinstance(record, StaticRecord):
        readings = np.full(np.size(record.values), np.nan)
        readings[record.present] = values
        record = replace(record, values=readings.reshape(np.shape(record.values)))
    elif isinstance(record, MotionRecord):
        ends = np.cumsum([channel.measurement.time.size for channel in record.own_channels])[:-1]
        channels = zip(record.own_channels, np.split(values, ends), strict=True)
        record = replace(
            record, channels=[replace(c, measurement=replace(c.measurement, values=y)) for c, y in channels]
        )
    return cast("R", record)
