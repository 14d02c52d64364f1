"""The excitation of a beam, motion of the clamped node and load at the tip, in smooth pieces, and their time segments.

The excitation has 16 components: position, velocity and acceleration of the clamped node, (4,) each, which carry the
base motion, the force (2,) and moment at the tip, and the place of a force that travels, else 0.  It is symbolic in the
time and in the parameters b of the base motion.

Each smooth piece is divided into segments that end at samples of the result.  After each segment, progress is shown and
Ctrl-C takes effect.  If a run is interrupted or fails, the finished segments are kept.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, Piece, pieces_between
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.dynamics.tip_load import HarmonicLoad, TipLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array

NO_LOAD = HarmonicLoad((0.0, 0.0), 1.0)
EXCITATION = 3 * NODE + LOAD_SIZE + 1  # components of the excitation
ENERGIES = 3  # lost to damping, work of the base, work of the load
SEGMENTS = 25  # per piece; a restart of IDAS costs about a hundred small steps
MOST_SAMPLES = 250  # in a segment
SAME_TIME = 1e-9  # instants are the same if they differ by less than this fraction of a sampling interval or step


@dataclass(frozen=True, eq=False)
class Excitation:
    """The excitation between two instants, where it is smooth."""

    model: Model
    base: Piece
    load: Piece
    begin: float  # s
    end: float  # s
    parameters: Array  # b of the base motion, (m,)

    @property
    def largest_step(self) -> float:
        """Largest step of an integrator that misses no event, s."""
        return min(self.base.largest_step, self.load.largest_step)

    @cached_property
    def function(self) -> cs.Function:
        """(t) -> the excitation, (16,)."""
        t = cs.MX.sym("t")
        return _expand(cs.Function("excitation", [t], [self._expression(t, cs.MX(cs.DM(self.parameters)))]))

    @cached_property
    def node(self) -> cs.Function:
        """(t) -> position and slope of the clamped node, (4,)."""
        t = cs.MX.sym("t")
        return _expand(cs.Function("node", [t], [self._expression(t, cs.MX(cs.DM(self.parameters)))[:NODE]]))

    @cached_property
    def clamp(self) -> cs.Function:
        """(t) -> displacement (m, two components) and rotation (rad) of the clamp, their rates and accelerations."""
        t = cs.MX.sym("t")
        return cs.Function("clamp", [t], [with_rates(cs.densify(self.base.at(t, cs.MX(cs.DM(self.parameters)))), t)])

    def at(self, time: float) -> Array:
        """Return the excitation, (16,), at a time."""
        return np.asarray(self.function(time).full().ravel())

    def jacobian(self, time: float) -> Array:
        """Return the derivatives of the excitation with respect to b, (16, m), at a time."""
        return np.asarray(self.jacobians(np.array([time]))[0])

    def jacobians(self, times: Array) -> Array:
        """Return the derivatives of the excitation with respect to b, (k, 16, m), at times (k,)."""
        count = self.parameters.size
        if not (times.size and count):
            return np.zeros((times.size, EXCITATION, count))
        jacobians = self._derivatives[0](times[None, :], self.parameters).full()  # side by side
        return np.asarray(jacobians.reshape(EXCITATION, times.size, count).swapaxes(0, 1))

    def derivatives(self, times: Array) -> Array:
        """Return the clamped node and the time derivative of its acceleration, (k, 16), at times (k,)."""
        if not times.size:
            return np.zeros((0, EXCITATION))
        return np.asarray(self._derivatives[1](times[None, :], self.parameters).full().T)

    def segments(self, origin: float, rate: float) -> Iterator[Segment]:
        """Divide the piece, whose ends may lie between two samples, into time segments that end at samples.

        The first sample is at ``origin``, the start of the motion; the others follow at the given rate (1/s).
        """
        first = math.ceil((self.begin - origin) * rate - SAME_TIME)
        last = math.floor((self.end - origin) * rate + SAME_TIME)
        if first > last:
            yield Segment(self.begin, self.end - self.begin, 1, 0)
            return
        if origin + first / rate - self.begin > SAME_TIME / rate:
            yield Segment(self.begin, origin + first / rate - self.begin, 1, 1)
        size = min(max(1, math.ceil((self.end - self.begin) * rate / SEGMENTS)), MOST_SAMPLES)
        for k in range(first, last, size):
            points = min(size, last - k)
            yield Segment(origin + k / rate, points / rate, points, points, first=k == 0)
        if self.end - origin - last / rate > SAME_TIME / rate:
            yield Segment(origin + last / rate, self.end - origin - last / rate, 1, 0)

    @cached_property
    def _derivatives(self) -> tuple[cs.Function, cs.Function]:
        t, b = cs.MX.sym("t"), cs.MX.sym("b", self.parameters.size)
        values = self._expression(t, b)
        jerk = cs.densify(cs.jacobian(values[2 * NODE : 3 * NODE], t))
        return (
            cs.Function("excitation_jacobian", [t, b], [cs.jacobian(values, b)]),
            cs.Function("clamp_derivatives", [t, b], [cs.vertcat(values[: 3 * NODE], jerk)]),
        )

    def _expression(self, t: cs.MX, b: cs.MX) -> cs.MX:
        node = clamped_node(self.model, self.base.at(t, b), t)
        load = cs.densify(self.load.at(t, cs.MX(0, 1)))
        return cs.vertcat(node, load, cs.MX.zeros(EXCITATION - node.numel() - load.numel()))


def excitation_pieces(
    model: Model, base: BaseMotion, load: TipLoad | None, begin: float, end: float, b: Array | None = None
) -> list[Excitation]:
    """Return the excitation between two instants (s), piece by piece; b are the parameters of the base, if changed."""
    moving, loading = (pieces_between(motion.pieces(), begin, end) for motion in (base, load or NO_LOAD))
    instants = [begin]
    for instant in sorted(last for *_, last in (*moving, *loading)):
        # of the time considered; pieces of base and load that end so close together end together
        if instant - instants[-1] > 1e-9 * (end - begin):
            instants.append(instant)
    instants[-1] = end
    values = np.array([parameter.value for parameter in base.parameters]) if b is None else b
    pieces = []
    for first, last in itertools.pairwise(instants):
        overlapping = [
            next(piece for piece, _, piece_end in motion if (first + last) / 2 <= piece_end)
            for motion in (moving, loading)
        ]
        pieces.append(Excitation(model, overlapping[0], overlapping[1], first, last, values))
    return pieces


def sample_excitation(pieces: Sequence[Excitation]) -> tuple[Array, Array]:
    """Return instants throughout a motion, (k,), s, and the excitation there, (k, 16)."""
    instants = [np.linspace(piece.begin, piece.end, 1001) for piece in pieces]
    values = [piece.function(times[None, :]).full().T for piece, times in zip(pieces, instants, strict=True)]
    return np.concatenate(instants), np.vstack(values)


def clamped_node(model: Model, displacement: cs.MX, t: cs.MX) -> cs.MX:
    """Return position, velocity and acceleration of the clamped node, (12,), for a clamp moved by (x, y, angle) (t)."""
    x, y, angle = cs.vertsplit(cs.densify(displacement))
    ax, ay = model.beam.axis
    node = cs.vertcat(x, y, cs.cos(angle) * ax - cs.sin(angle) * ay, cs.sin(angle) * ax + cs.cos(angle) * ay)
    return with_rates(node, t)


def _expand(function: cs.Function) -> cs.Function:
    """Return a Function in scalar operations, which are faster, if it has them: splines do not."""
    with contextlib.suppress(RuntimeError):
        return function.expand()
    return function


def with_rates(x: cs.MX, t: cs.MX) -> cs.MX:
    """Return x, x_t and x_tt, one below the other."""
    x_t = cs.densify(cs.jacobian(x, t))
    return cs.vertcat(x, x_t, cs.densify(cs.jacobian(x_t, t)))


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
