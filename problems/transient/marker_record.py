"""Measured large motion of a beam: positions of points on it over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, check_instance, numbers, physical
from ancf_casadi.vibration.equilibrium import Equilibrium

EVEN = 1e-6  # largest deviation of a sample from even spacing, in sampling intervals


@dataclass(frozen=True, eq=False)
class MarkerRecord:
    """Measured positions of points on a beam.

    Parameters
    ----------
    time : array_like (k,)
        Times, s, from 0 at equal intervals.
    positions : array_like (k, m, 2) or (k, 2)
        Positions of m points, or of one, in the laboratory frame, m; its origin is the clamp at rest.
    points : sequence of float
        Arc lengths of the points from the clamp, m; the tip if not given.
    base : BaseMotion, optional
        Motion of the clamp; fixed if not given.
    start : str, Equilibrium or State
        Start of the motion, as for ``simulate``.

    Raises
    ------
    InputError
        If there are fewer than 10 samples, the times do not begin with 0 or are not evenly spaced, the sizes of the
        arrays do not match, a value is not finite, or nothing moves.
    """

    time: ArrayLike
    positions: ArrayLike
    points: Sequence[float] | None = None
    base: BaseMotion | None = None
    start: Start | Equilibrium | State = "equilibrium"

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        if self.points is not None:
            object.__setattr__(self, "points", numbers(self.points, "points"))
        check_instance(self.base, "base", BaseMotion, NoneType)
        check_instance(self.start, "start", str, Equilibrium, State)
        time, positions = (array(getattr(self, name), name) for name in ("time", "positions"))
        if time.ndim != 1 or time.size < 10:
            raise InputError("needs at least 10 samples", "time")
        step = (time[-1] - time[0]) / (time.size - 1)
        if not step > 0.0 or time[0] != 0.0 or np.abs(time - step * np.arange(time.size)).max() > EVEN * step:
            raise InputError("must begin with 0 and continue at equal intervals; resample the record", "time")
        physical(time[-1], "time")
        if positions.ndim == 2:
            positions = positions[:, None, :]
        count = 1 if self.points is None else len(self.points)
        if positions.shape != (time.size, count, 2):
            raise InputError(f"must have the shape {(time.size, count, 2)}, got {positions.shape}", "positions")
        if not np.ptp(positions, axis=0).any():
            raise InputError("are constant; nothing moves", "positions")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "positions", positions)

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(np.asarray(self.time)[-1])

    @property
    def sample_rate(self) -> float:
        """Sampling rate, 1/s."""
        return (np.size(self.time) - 1) / self.duration

    @property
    def columns(self) -> Array:
        """Measured coordinates, x and y of each point, (2 m, k)."""
        return np.reshape(self.positions, (np.size(self.time), -1)).T

    @property
    def own_base(self) -> BaseMotion:
        """Motion of the clamp; fixed if none was given."""
        return FixedBase() if self.base is None else self.base

    def points_on(self, beam: Beam) -> Sequence[float]:
        """Return the arc lengths of the points, m."""
        return (beam.length,) if self.points is None else self.points
