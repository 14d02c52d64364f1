"""Time segments between integrator restarts, and the solution on each segment.

Each smooth piece of the base motion is divided into segments that end at samples of the result.  After each segment,
progress is shown and Ctrl-C takes effect; the solution on the finished segments is kept if a run is interrupted or
fails.  Both integrators take an ``InitialValueProblem`` and yield one ``SegmentSolution`` per segment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.support.arrays import Array

CLOSE = 1e-9  # of a sampling interval; instants nearer than that are the same


@dataclass(frozen=True)
class Segment:
    """A segment of time.

    Parameters
    ----------
    start, length : float
        Its start and length, s.
    points : int
        Number of instants at equal intervals, the start not among them, that end it.
    samples : int
        How many of them, from the first, are instants of the result.
    first : bool
        Whether the start is an instant of the result too, the first.
    """

    start: float
    length: float
    points: int
    samples: int
    first: bool = False

    @property
    def end(self) -> float:
        """Its end, s."""
        return self.start + self.length

    @property
    def instants(self) -> Array:
        """Its start and its points, (points + 1,), s."""
        return self.start + self.length * np.arange(self.points + 1) / self.points

    @property
    def kept(self) -> slice:
        """Which of ``instants`` are instants of the result."""
        return slice(0 if self.first else 1, self.samples + 1)


@dataclass(frozen=True, eq=False)
class SegmentSolution:
    """What an integrator finds on a segment.

    Parameters
    ----------
    coordinates, velocities : array (k, 4 n + 4)
        Nodal coordinates and their rates at its samples.
    forces : array (k, 4)
        Generalized force of the base on the clamped node.
    energies : array (k, 2)
        Energy lost to damping and work of the base since its start, J.
    end : State
        The state at its end.
    end_energies : array (2,)
        The energies at its end.
    segment : Segment
        The time segment.
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


@dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """The motion on a smooth piece of the base motion, or on its rest, as an integrator takes it.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    clamp : Function
        (t) -> position, velocity and acceleration of the clamped node, (12,).
    start : State
        The state at the start of the first segment.
    segments : sequence of Segment
        Consecutive time segments.
    tolerance : float
        Local error of the positions relative to the length of the beam, and of the slopes relative to 1/2.
    largest_step : float
        Largest step, s.
    options : mapping
        Options of CasADi's IDAS interface; Radau has none.
    """

    equations: Equations
    clamp: cs.Function
    start: State
    segments: Sequence[Segment]
    tolerance: float
    largest_step: float = math.inf
    options: Mapping[str, Any] = field(default_factory=dict)


def cut(begin: float, end: float, origin: float, rate: float, size: int) -> Iterator[Segment]:
    """Cut the time from begin to end at samples, ``size`` samples a segment; the ends may lie between two samples.

    Samples are taken from ``origin`` on, the start of the motion, at a rate per second.
    """
    first, last = math.ceil((begin - origin) * rate - CLOSE), math.floor((end - origin) * rate + CLOSE)
    if first > last:
        yield Segment(begin, end - begin, 1, 0)
        return
    if origin + first / rate - begin > CLOSE / rate:
        yield Segment(begin, origin + first / rate - begin, 1, 1)
    for k in range(first, last, size):
        points = min(size, last - k)
        yield Segment(origin + k / rate, points / rate, points, points, first=k == 0)
    if end - origin - last / rate > CLOSE / rate:
        yield Segment(origin + last / rate, end - origin - last / rate, 1, 0)
