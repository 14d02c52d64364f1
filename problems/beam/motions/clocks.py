"""The sampling times of a record, and the load at the tip at these times, which may be shifted by unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.tip_load import LOAD_SIZE, TipLoad
from ancf_casadi.support.arrays import Array
from problems.beam.motions.record import MotionRecord


@dataclass(frozen=True, eq=False)
class Clocks:
    """The distinct series of sampling times of a record.

    Parameters
    ----------
    times : list of array
        Times of each series, s.
    channels : list of int
        The series of each channel.
    """

    times: list[Array]
    channels: list[int]

    @staticmethod
    def of(record: MotionRecord) -> Clocks:
        """Return the sampling times of a record; channels with an unknown offset have a series of their own."""
        times: list[Array] = []
        shared: list[bool] = []
        places = []
        for channel in record.own_channels:
            own = channel.measurement.time
            same = [k for k, one in enumerate(times) if shared[k] and np.array_equal(one, own)]
            if not same or channel.offset:
                same = [len(times)]
                times.append(own)
                shared.append(channel.offset is None)
            places.append(same[0])
        return Clocks(times, places)

    @cached_property
    def index(self) -> Any:
        """The series of each sample."""
        return np.repeat(np.arange(len(self.times)), [one.size for one in self.times])


def load_at(load: TipLoad | None, times: Array, shift: cs.MX) -> cs.MX:
    """Return a load at the tip, (3, s), at times that are shifted."""
    if load is None:
        return cs.MX.zeros(LOAD_SIZE, times.size)
    t = cs.MX.sym("t")
    *others, last = load.pieces()
    value = last.at(t, cs.MX(0, 1))
    for piece in reversed(others):
        value = cs.if_else(t <= piece.end, piece.at(t, cs.MX(0, 1)), value)
    return cs.Function("load", [t], [cs.densify(value)]).map(times.size)(cs.DM(times).T + shift)


def offsets(series: Sequence[Array]) -> list[int]:
    """Return the first place of each series, and the number of all samples."""
    return [0, *np.cumsum([one.size for one in series]).tolist()]
