"""Positions of several points of a beam at common times, as a camera measures them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.state import State
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.inputs import array, check_instance, numbers, physical
from ancf_casadi.support.tables import Displayed, plural, spread
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.beam.motions.record import FEWEST_SAMPLES, Bounds, Camera, Channel, MotionRecord


@dataclass(frozen=True, eq=False)
class MarkerRecord(Displayed):
    """Measured positions of points on a beam: a ``MotionRecord`` with x and y of each point as channels.

    Parameters
    ----------
    time : array_like (k,)
        Times, s, increasing.
    positions : array_like (k, m, 2) or (k, 2)
        Positions of m points, or of one, in the laboratory frame, m; its origin is the clamp at rest.  A sample that is
        nan is missing.
    points : sequence of float
        Arc lengths of the points from the clamp, m; the tip if not given.
    base, start, release_time, camera, load, model, name
        As in ``MotionRecord``.

    Raises
    ------
    InputError
        If there are fewer than 10 samples, the times do not increase, the sizes of the arrays do not match, a value is
        not finite, nothing moves, or as in ``MotionRecord``.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import MarkerRecord
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> x = 0.02 * np.cos(12.0 * time)
    >>> middle, tip = (np.column_stack([a * x, 0 * x - y]) for a, y in ((0.4, 0.25), (1.0, 0.5)))
    >>> record = MarkerRecord(time, np.stack([middle, tip], axis=1), points=[0.25, 0.5])
    >>> [channel.label for channel in record.motion_record.own_channels]
    ['position x, 250 mm', 'position y, 250 mm', 'position x, 500 mm', 'position y, 500 mm']
    """

    time: ArrayLike
    positions: ArrayLike
    points: Sequence[float] | None = None
    base: BaseMotion | None = None
    start: Start | Equilibrium | State = "equilibrium"
    release_time: float | Bounds = 0.0
    camera: Camera | None = None
    load: TipLoad | None = None
    model: Model | None = None
    name: str = ""

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        if self.points is not None:
            object.__setattr__(self, "points", numbers(self.points, "points"))
        time, positions = array(self.time, "time"), array(self.positions, "positions", finite=False)
        if time.ndim != 1 or time.size < FEWEST_SAMPLES:
            raise InputError(f"needs at least {FEWEST_SAMPLES} samples", "time")
        physical(abs(time[-1] - time[0]), "time")
        if positions.ndim == 2:
            positions = positions[:, None, :]
        count = 1 if self.points is None else len(self.points)
        if positions.shape != (time.size, count, 2):
            raise InputError(f"must have the shape {(time.size, count, 2)}, got {positions.shape}", "positions")
        if np.isinf(positions).any() or np.isnan(positions).all():
            raise InputError("must be finite, or nan where a sample is missing", "positions")
        columns = positions.reshape(time.size, -1).T
        if not any(np.ptp(column[np.isfinite(column)]) for column in columns if np.isfinite(column).any()):
            raise InputError("are constant; nothing moves", "positions")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "positions", positions)
        _ = self.motion_record

    @cached_property
    def motion_record(self) -> MotionRecord:
        """The record as one of two channels for each point."""
        places = (None,) if self.points is None else self.points
        channels = []
        for k, place in enumerate(places):
            for direction, values in zip(((1.0, 0.0), (0.0, 1.0)), np.asarray(self.positions)[:, k].T, strict=True):
                sensor = Sensor("position", place, direction)
                channels.append(Channel(Measurement(self.time, values, sensor=sensor)))
        shared = self.base, self.start, self.release_time, self.camera, self.load, self.model, self.name
        return MotionRecord(channels, *shared)

    def _summary(self) -> str:
        points = 1 if self.points is None else len(self.points)
        name = f"{self.name!r}, " if self.name else ""
        return f"{name}{plural(points, 'point')}, {plural(np.size(self.time), 'sample')}, {spread(self.time, 's')}"


def motion_record(record: Any) -> MotionRecord:
    """Return a record of any kind as a motion record; a Measurement is released from rest on a fixed base at time 0."""
    check_instance(record, "records", MotionRecord, MarkerRecord, Measurement)
    if isinstance(record, Measurement):
        return MotionRecord([record])
    return record if isinstance(record, MotionRecord) else record.motion_record
