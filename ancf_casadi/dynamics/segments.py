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
    """A time segment.

    Parameters
    ----------
    start, length : float
        Start and length, s.
    points : int
        Number of instants at equal intervals after the start; the last is the end.
    samples : int
        Number of these instants, counted from the first, that are samples of the result.
    first : bool
        Whether the start is also a sample of the result, the first one.
    """

    start: float
    length: float
    points: int
    samples: int
    first: bool = False

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
    """The solution on a segment.

    Parameters
    ----------
    coordinates, velocities : array (k, 4 n + 4)
        Nodal coordinates and velocities at the samples.
    forces : array (k, 4)
        Generalized force of the base on the clamped node at the samples.
    energies : array (k, 3)
        Energy lost to damping, work of the base and work of the tip load since the start of the segment, J, at the
        samples.
    end : State
        The state at the end of the segment.
    end_energies : array (3,)
        The energies at the end of the segment.
    segment : Segment
        The segment.
    steps : int
        Steps of the integrator.
    """

    coordinates: Array
    velocities: Array
    forces: Array
    energies: Array
    end: State
    end_energies: Array
    segment: Segment
    steps: int


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
