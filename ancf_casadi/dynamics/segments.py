"""Time segments between integrator restarts, and the solution on each segment.

Each smooth piece of the excitation, base motion and tip load, is divided into segments that end at samples of the
result.  After each segment, progress is shown and Ctrl-C takes effect.  If a run is interrupted or fails, the finished
segments are kept.  Both integrators yield one ``SegmentSolution`` per segment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.support.arrays import Array

ENERGY_STATES = 3  # integrated with the motion: lost to damping, work of the base, work of the tip load
SAME_TIME = 1e-9  # instants are the same if they differ by less than this fraction of a sampling interval or step


@dataclass(frozen=True)
class Segment:
    """A time segment."""

    start: float  # s
    length: float  # s
    points: int  # number of instants at equal intervals after the start; the last is the end
    samples: int  # number of these instants, counted from the first, that are samples of the result
    first: bool = False  # whether the start is also a sample of the result, the first one

    @property
    def end(self) -> float:
        """End, s."""
        return self.start + self.length

    @property
    def instants(self) -> Array:
        """Start and points, (points + 1,), s."""
        return self.start + self.length * np.arange(self.points + 1) / self.points

    @property
    def kept(self) -> slice:
        """Indices of the samples of the result in ``instants``."""
        return slice(0 if self.first else 1, self.samples + 1)


@dataclass(frozen=True, eq=False)
class SegmentSolution:
    """The solution on a segment, at its k samples."""

    coordinates: Array  # (k, 4 n + 4)
    velocities: Array  # (k, 4 n + 4)
    forces: Array  # generalized force of the base on the clamped node, (k, 4)
    energies: Array  # lost to damping, work of base and of tip load since the start of the segment, (k, 3), J
    end: State  # the state at the end of the segment
    end_energies: Array  # the energies there, (3,), J
    segment: Segment
    steps: int  # of the integrator


def divide(begin: float, end: float, origin: float, rate: float, size: int) -> Iterator[Segment]:
    """Divide [begin, end] into segments of ``size`` samples; ``begin`` and ``end`` may lie between two samples.

    The first sample is at ``origin``, the start of the motion; the others follow at the given rate (1/s).
    """
    first, last = math.ceil((begin - origin) * rate - SAME_TIME), math.floor((end - origin) * rate + SAME_TIME)
    if first > last:
        yield Segment(begin, end - begin, 1, 0)
        return
    if origin + first / rate - begin > SAME_TIME / rate:
        yield Segment(begin, origin + first / rate - begin, 1, 1)
    for k in range(first, last, size):
        points = min(size, last - k)
        yield Segment(origin + k / rate, points / rate, points, points, first=k == 0)
    if end - origin - last / rate > SAME_TIME / rate:
        yield Segment(origin + last / rate, end - origin - last / rate, 1, 0)
