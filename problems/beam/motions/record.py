"""Measured large motion of a beam: the records of any sensors in one experiment.

The instants of a motion count from its start, the release of the beam or the start of its base motion.  A channel with
the times t_i sees the motion at

    t_i - release - offset,

where ``release`` is the start of the motion on the clock of the record, and ``offset`` the lead of the channel's own
clock.  Before its start the beam is at rest under the load that holds it.  A camera sees a point r at

    origin + scale R(rotation) r,

in the laboratory frame with the clamp at rest as the origin.  Release, offsets, the view of the camera and the zero of
a channel may be unknown within bounds; the guess is then the middle.

Accelerations, forces and moments jump at the start, and where a base motion ends; velocities have a kink there.  If its
time is unknown, a sample of theirs that may be on either side of a jump is left out: otherwise the residuals, or their
derivatives, would jump with the unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import NoneType
from typing import Any

import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import check_instance, is_sequence, number, positive, shown, two_numbers
from ancf_casadi.support.tables import Displayed, plural
from ancf_casadi.vibration.equilibrium import Equilibrium

FEWEST_SAMPLES = 10  # samples of a record
JUMPING = ("velocity", "acceleration", "force", "moment")

Bounds = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Channel(Displayed):
    """The record of one sensor, and the unknowns of this sensor.

    Parameters
    ----------
    measurement : Measurement
        The record of the sensor.
    std : float, optional
        Standard deviation of its noise, in the unit of the sensor; if not given, the fit finds it.
    offset : (float, float), optional
        Bounds of the unknown time by which the clock of the sensor is ahead of that of the record, s; no offset if not
        given.
    zero : (float, float), optional
        Bounds of the unknown reading of the sensor for a true value of 0.  If not given, this is 0; for a displacement,
        whose origin is not known, it is estimated without bounds.

    Raises
    ------
    InputError
        If the standard deviation is not positive, or bounds are not two numbers in order.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement, Sensor
    >>> from problems import Channel
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> sensor = Sensor("acceleration", point=0.25, direction=(1.0, 0.0))
    >>> record = Measurement(time, 3.0 * np.cos(12.0 * time), sensor=sensor)
    >>> Channel(record, offset=(-5e-3, 5e-3)).label  # the clock may be 5 ms ahead or behind
    'acceleration x, 250 mm'
    """

    measurement: Measurement
    std: float | None = None
    offset: Bounds | None = None
    zero: Bounds | None = None

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.measurement, "measurement", Measurement)
        if self.std is not None:
            positive(self.std, "std")
        for name in ("offset", "zero"):
            _keep_bounds(self, name)

    @property
    def sensor(self) -> Sensor:
        """The sensor."""
        return self.measurement.sensor

    @property
    def label(self) -> str:
        """Quantity, direction and place: ``acceleration x, tip``."""
        return f"{self.sensor.quantity} {self.sensor.label}"


@dataclass(frozen=True)
class Camera(Displayed):
    """Bounds of the unknown view of a camera, for the channels of a record that are positions.

    Parameters
    ----------
    scale : (float, float), optional
        Bounds of the scale; 1 if not given.
    rotation : (float, float), optional
        Bounds of the rotation of the picture, counterclockwise, rad; 0 if not given.
    origin : ((float, float), (float, float)), optional
        Bounds of x and of y of the picture of the clamp at rest, m; (0, 0) if not given.

    Raises
    ------
    InputError
        If bounds are not two numbers in order, or a scale is not positive.

    Examples
    --------
    >>> import math
    >>> from problems import Camera
    >>> tilt = math.radians(1)
    >>> camera = Camera(scale=(0.98, 1.02), rotation=(-tilt, tilt))
    >>> [name for name, bounds, *_ in camera.unknowns if bounds]
    ['camera_scale', 'camera_rotation']
    """

    scale: Bounds | None = None
    rotation: Bounds | None = None
    origin: tuple[Bounds, Bounds] | None = None

    def __post_init__(self) -> None:
        """Validate."""
        for name in ("scale", "rotation"):
            _keep_bounds(self, name)
        if self.scale is not None:
            positive(self.scale[0], "scale")
        if self.origin is not None:
            if not is_sequence(self.origin) or len(self.origin) != 2:
                raise InputError(f"must be two pairs of bounds, of x and of y, got {shown(self.origin)}", "origin")
            x, y = (pair(bounds, "origin") for bounds in self.origin)
            object.__setattr__(self, "origin", (x, y))

    @property
    def unknowns(self) -> tuple[tuple[str, Bounds | None, float, str], ...]:
        """Name, bounds (None if known), guess and unit of scale, rotation, x and y of the origin."""
        x, y = self.origin or (None, None)
        unknowns = (
            ("camera_scale", self.scale, 1.0, ""),
            ("camera_rotation", self.rotation, 0.0, "rad"),
            ("camera_x", x, 0.0, "m"),
            ("camera_y", y, 0.0, "m"),
        )
        return tuple(
            (name, limits, sum(limits) / 2 if limits else usual, unit) for name, limits, usual, unit in unknowns
        )


@dataclass(frozen=True, eq=False)
class MotionRecord(Displayed):
    """Records of several sensors in one experiment.

    Parameters
    ----------
    channels : sequence of Channel or Measurement
        The sensors, each with its own times.
    base : BaseMotion, optional
        Motion of the clamp; fixed if not given.
    start : str, Equilibrium or State
        Start of the motion, as for ``simulate``.
    release_time : float or (float, float)
        Start of the motion on the clock of the record, s: the release, or the start of the base motion; two numbers are
        the bounds of an unknown release.  Samples before it show the beam at rest.
    camera : Camera, optional
        The unknown view of the camera that measured the positions; positions are those in the laboratory if not given.
    load : TipLoad, optional
        Measured force and moment at the tip, on the clock of the base motion; none if not given.
    model : Model, optional
        The beam in the configuration of the experiment, such as with another mass at the tip; that of the fit if not
        given.
    name : str
        Name in reports.

    Raises
    ------
    InputError
        If there are fewer than 10 samples, nothing moves, bounds are not two numbers in order, samples are before a
        start within a motion, or the load begins after the end.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import HarmonicBase, Measurement, Sensor
    >>> from problems import MotionRecord
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> laser, gauge = Sensor("displacement", point=0.4), Sensor("strain", point=0.01)
    >>> swing = np.sin(12.0 * time)
    >>> records = [Measurement(time, 0.02 * swing, sensor=laser), Measurement(time, 1e-4 * swing, sensor=gauge)]
    >>> record = MotionRecord(records, base=HarmonicBase(amplitude=5e-3, frequency=1.9))
    >>> [channel.label for channel in record.own_channels]
    ['displacement x, 400 mm', 'strain 10 mm']
    """

    channels: Sequence[Channel | Measurement]
    base: BaseMotion | None = None
    start: Start | Equilibrium | State = "equilibrium"
    release_time: float | Bounds = 0.0
    camera: Camera | None = None
    load: TipLoad | None = None
    model: Model | None = None
    name: str = ""

    def __post_init__(self) -> None:
        """Validate, and keep channels."""
        check_instance(self.name, "name", str)
        check_instance(self.model, "model", Model, NoneType)
        if not is_sequence(self.channels) or not len(self.channels):
            raise InputError("must be a sequence of Channel or Measurement; put it in a list", "channels")
        for channel in self.channels:
            check_instance(channel, "channels", Channel, Measurement)
        check_instance(self.base, "base", BaseMotion, NoneType)
        check_instance(self.start, "start", str, Equilibrium, State)
        check_instance(self.camera, "camera", Camera, NoneType)
        check_instance(self.load, "load", TipLoad, NoneType)
        release = (
            pair(self.release_time, "release_time")
            if is_sequence(self.release_time)
            else number(self.release_time, "release_time")
        )
        object.__setattr__(self, "release_time", release)
        channels = (channel if isinstance(channel, Channel) else Channel(channel) for channel in self.channels)
        object.__setattr__(self, "channels", tuple(map(self._without_jumps, channels)))
        self._check_times()
        if self.camera and not any(channel.sensor.quantity == "position" for channel in self.own_channels):
            raise InputError("there are no positions for it; give the channels of the camera as positions", "camera")

    @property
    def own_channels(self) -> tuple[Channel, ...]:
        """The sensors."""
        return tuple(channel for channel in self.channels if isinstance(channel, Channel))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the readers of files, and faults of the channels."""
        return tuple(dict.fromkeys(text for channel in self.own_channels for text in channel.measurement.warnings))

    @property
    def own_base(self) -> BaseMotion:
        """Motion of the clamp; fixed if none was given."""
        return FixedBase() if self.base is None else self.base

    @property
    def release_bounds(self) -> Bounds:
        """Bounds of the release, s; equal if it is known."""
        return self.release_time if isinstance(self.release_time, tuple) else (self.release_time, self.release_time)

    @property
    def has_unknown_times(self) -> bool:
        """True if the release, or an offset of a channel, is unknown."""
        return isinstance(self.release_time, tuple) or any(channel.offset for channel in self.own_channels)

    @property
    def origin(self) -> float:
        """Start of the motion on the clock of the base motion, s."""
        return self.start.time if isinstance(self.start, State) else 0.0

    @property
    def end(self) -> float:
        """Last instant of the motion that a channel may see, s, on the clock of the base motion."""
        ends = [channel.measurement.time[-1] - (channel.offset or (0.0, 0.0))[0] for channel in self.own_channels]
        return self.origin + float(max(ends)) - self.release_bounds[0]

    @property
    def earliest(self) -> float:
        """First instant that a channel may see, s, from the start of the motion."""
        begins = [channel.measurement.time[0] - (channel.offset or (0.0, 0.0))[1] for channel in self.own_channels]
        return float(min(begins)) - self.release_bounds[1]

    def _without_jumps(self, channel: Channel) -> Channel:
        """Return a channel without the samples that may be on either side of a jump of its readings."""
        (early, late), (least_offset, largest_offset) = self.release_bounds, channel.offset or (0.0, 0.0)
        if channel.sensor.quantity not in JUMPING or late + largest_offset == early + least_offset:
            return channel
        measurement = channel.measurement
        ends = [piece.end for piece in self.own_base.pieces() if math.isfinite(piece.end)]
        first, last = (
            measurement.time - shift + self.origin for shift in (late + largest_offset, early + least_offset)
        )
        clear = np.all([(last < jump) | (first > jump) for jump in (self.origin, *ends)], axis=0)
        if np.count_nonzero(clear) < 2:
            raise InputError(
                f"leave too few samples of {channel.label} that are certain; narrow the bounds", "release_time"
            )
        return replace(
            channel,
            measurement=Measurement(
                measurement.time[clear], measurement.values[clear], measurement.name, measurement.sensor
            ),
        )

    def _check_times(self) -> None:
        count = sum(channel.measurement.time.size for channel in self.own_channels)
        if count < FEWEST_SAMPLES:
            raise InputError(f"needs at least {FEWEST_SAMPLES} samples, got {count}", "channels")
        if not any(np.ptp(channel.measurement.values) for channel in self.own_channels):
            raise InputError("are constant; nothing moves", "channels")
        if not self.end > self.origin:
            raise InputError(
                "must be before the last sample; give the start of the motion on the record's clock", "release_time"
            )
        if isinstance(self.start, State) and self.earliest < 0.0:
            raise InputError(
                "a State has no rest before it, but a sample is, or may be, before the release; cut the record there",
                "start",
            )
        if self.load is not None and self.load.begin >= self.end:
            raise InputError(
                f"begins at {self.load.begin:g} s, after the end of the motion at {self.end:g} s; its times are "
                "those of the motion",
                "load",
            )

    def _summary(self) -> str:
        samples = sum(len(channel.measurement.time) for channel in self.own_channels)
        name = f"{self.name!r}, " if self.name else ""
        return f"{name}{plural(len(self.channels), 'channel')}, {plural(samples, 'sample')}, {self.own_base!r}"


def record_titles(numbered: Sequence[tuple[int, MotionRecord]]) -> list[str]:
    """Return the title of each record, the beginning of the labels of its channels: its name, or its number."""
    several = len(numbered) > 1
    titles = [record.name or f"record {k}" * (several or k > 1) for k, record in numbered]
    return [f"{title}, " if title else "" for title in titles]


def channel_labels(numbered: Sequence[tuple[int, MotionRecord]]) -> list[str]:
    """Return a distinct label of each channel of records: its name if the measurement has one."""
    labels = []
    for title, (_, record) in zip(record_titles(numbered), numbered, strict=True):
        for channel in record.own_channels:
            name = channel.measurement.name
            labels.append(f"{title}{name}: {channel.label}" if name else f"{title}{channel.label}")
    return [f"{label} ({labels[:k].count(label) + 1})" if labels.count(label) > 1 else label
            for k, label in enumerate(labels)]  # fmt: skip


def pair(bounds: Any, where: str) -> Bounds:
    """Return bounds (lower, upper), two finite numbers in order."""
    lower, upper = two_numbers(bounds, where, finite=True)
    if not lower < upper:
        raise InputError(f"the lower bound {lower:g} is not below the upper {upper:g}", where)
    return lower, upper


def _keep_bounds(record: Channel | Camera, name: str) -> None:
    """Validate bounds that may be missing, and keep them as a pair."""
    bounds = getattr(record, name)
    if bounds is not None:
        object.__setattr__(record, name, pair(bounds, name))
