"""The residuals between measured records and the motion of the nonlinear beam, as functions of the unknowns.

A sensor c (``derivatives.reading``) reads h_c(t_i; theta, P, b, F) in the motion for the parameters theta of the
damping law, the properties P of the elements, the amplitude b of the base motion, and the load F, with its rate of
change, that holds the beam until it is released.  With the zero z_c of the sensor, the weighted residuals
(``weights``) are

    G (h_c(t_i) + z_c - y_ci)/s_c

record by record and channel by channel.  The motion is integrated once for all channels of a record, and sampled at the
times of each.  Only the model is differentiated: records are never integrated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.reading import SampledMotion, orders_of
from ancf_casadi.dynamics.derivatives.runs import Runs
from ancf_casadi.dynamics.derivatives.sensitivity import Problem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.tip_load import LOAD, TipLoad
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.interrupts import delayed_interrupts
from problems.transient.motion_record import Channel, MotionRecord
from problems.transient.unknowns import Evidence, amplitude_name, load_name, loads
from problems.transient.weights import Weights

PATIENCE = 20.0  # most steps of a run, relative to the first run
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-4,
    "ipopt.compl_inf_tol": 1e-7,
    "ipopt.max_iter": 50,
    "ipopt.accept_after_max_steps": 3,  # halvings; of shorter steps, the integration error hides the decrease
    "ipopt.watchdog_shortened_iter_trigger": 1,  # then take full steps, judged by the gradient
    "ipopt.mu_init": 1e-4,  # small, so that bounds do not push a good guess away
    "ipopt.bound_mult_init_method": "mu-based",
}


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


@dataclass(frozen=True, eq=False)
class TransientProblem:
    """Measured motions, and the model that is fitted to them.

    Parameters
    ----------
    model : Model
        The beam.
    records : tuple of MotionRecord
        The measurements.
    damping : DampingLaw
        The law.
    load : tuple of str
        Unknown components of the tip load at the start.
    tolerance : float
        Tolerance of the integration.
    weights : Weights
        The weights of the channels.
    evidence : tuple of Evidence
        Further measurements of the beam.
    """

    model: Model
    records: tuple[MotionRecord, ...]
    damping: DampingLaw
    load: tuple[str, ...]
    tolerance: float
    weights: Weights
    evidence: tuple[Evidence, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the problem without its Functions, which the receiving process derives again."""
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def runs(self) -> list[Runs]:
        """Return the motion of each record, differentiable by the unknowns."""
        return [Runs(self._motion(record), PATIENCE) for record in self.records]

    def readings(self, motions: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the computed readings of each channel of each record, (k, 1) each.

        Parameters
        ----------
        motions : sequence of Function
            The motions of the records, from ``runs``.
        given : mapping
            Unknowns by name.
        """
        found = []
        for k, (record, motion) in enumerate(zip(self.records, motions, strict=True)):
            clocks = Clocks.of(record)
            shifts = self._shifts(k, record, clocks, given)
            samples = cs.horzsplit(self._samples(k, record, motion, shifts, given), _offsets(clocks.times))
            pairs = zip(samples, shifts, clocks.times, strict=True)
            sampled = [self._sampled(part, load_at(record.load, own, shift), given) for part, shift, own in pairs]
            for j, (channel, series) in enumerate(zip(record.own_channels, clocks.channels, strict=True)):
                zero = given.get(f"zero_{k + 1}_{j + 1}", cs.MX(0.0))
                found.append((self._reading(k, channel, sampled[series], given) + zero).T)
        return found

    def residuals(self, motions: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the weighted residuals, record by record and channel by channel, then those of the evidence.

        Parameters
        ----------
        motions, given
            As in ``readings``.
        """
        parts = []
        computed = self.readings(motions, given)
        for channel, own, factor in zip(self.channels, computed, self.weights.factors.tolist(), strict=True):
            rest = own - cs.DM(channel.measurement.values)
            if channel.sensor.quantity == "slope":  # the same angle, however often the beam turned
                rest = cs.atan2(cs.sin(rest), cs.cos(rest))
            parts.append(factor * rest)
        return cs.vertcat(*parts, *(self.weights.scale * one.residuals(given) for one in self.evidence))

    def residuals_at(self, values: Mapping[str, float]) -> Array:
        """Return the residuals for values of the unknowns by name, from one integration of each record, (m,)."""
        runs = self.runs()
        motions = [one.function() for one in runs]
        residuals = self.residuals(motions, {name: cs.MX(value) for name, value in values.items()})
        with delayed_interrupts():
            found = np.asarray(cs.evalf(residuals)).ravel()
        for one in runs:
            one.forget()
        return found

    @property
    def series(self) -> list[int]:
        """Lengths of the series of residuals, in the order of ``residuals``; the values of the evidence are single."""
        sizes = [channel.measurement.time.size for channel in self.channels]
        return sizes + [1] * self._pieces_of_evidence

    @property
    def times(self) -> Array:
        """Times of the residuals on the clocks of their records, s; zero for the evidence."""
        own = [channel.measurement.time for channel in self.channels]
        return np.concatenate([*own, np.zeros(self._pieces_of_evidence)])

    @property
    def rows(self) -> list[Mask]:
        """Residuals of each record among all."""
        sizes = [sum(one.measurement.time.size for one in record.own_channels) for record in self.records]
        owner = np.repeat(np.arange(len(sizes) + 1), [*sizes, self._pieces_of_evidence])
        return [owner == k for k in range(len(sizes))]

    @property
    def _pieces_of_evidence(self) -> int:
        """Number of values of the evidence."""
        return sum(len(one.deviations) for one in self.evidence if one.deviations is not None)

    @property
    def channels(self) -> list[Channel]:
        """The channels of all records."""
        return [channel for record in self.records for channel in record.own_channels]

    @cached_property
    def equations(self) -> Equations:
        """The equation of motion."""
        return Equations(self.model, self.damping)

    def _motion(self, record: MotionRecord) -> Problem:
        clocks = Clocks.of(record)
        times = np.concatenate(clocks.times)
        return Problem(
            equations=self.equations,
            base=record.own_base,
            load=record.load,
            start=record.start,
            times=times if record.has_unknown_times else times - record.release_bounds[0] + record.origin,
            tolerance=self.tolerance,
            held=bool(self.load),
            orders=max(orders_of(channel.sensor) for channel in record.own_channels),
            clocks=clocks.index if record.has_unknown_times else clocks.index[:0],
            span=(record.origin, record.end),
        )

    def _shifts(self, k: int, record: MotionRecord, clocks: Clocks, given: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the times that lead from the clock of each series to that of the base motion, s."""
        release = given.get(f"release_{k + 1}", cs.MX(sum(record.release_bounds) / 2))
        shifts = [record.origin - release] * len(clocks.times)
        for j, series in enumerate(clocks.channels):
            if f"offset_{k + 1}_{j + 1}" in given:
                shifts[series] = shifts[series] - given[f"offset_{k + 1}_{j + 1}"]
        return shifts

    def _samples(
        self, k: int, record: MotionRecord, motion: cs.Function, shifts: Sequence[cs.MX], given: Mapping[str, cs.MX]
    ) -> cs.MX:
        """Return coordinates, and velocities and accelerations where needed, at all samples of a record."""
        theta = [given.get(own.name, cs.MX(own.value)) for own in self.damping.parameters]
        b = [given.get(amplitude_name(k, own.name), cs.MX(own.value)) for own in record.own_base.parameters]
        inputs = [cs.vertcat(cs.MX(0, 1), *theta), cs.vertcat(cs.MX(0, 1), *b), self._properties(given)]
        if self.load:
            inputs.append(cs.vertcat(*(given.get(load_name(k, name), cs.MX(p)) for name, p in loads(record))))
        if record.has_unknown_times:
            inputs.append(cs.vertcat(*shifts))
        return motion(*inputs)

    def _properties(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the properties of the elements, (4, n)."""
        rows = zip(PROPERTIES, self.model.properties.tolist(), strict=True)
        return cs.vertcat(*(given.get(name, cs.MX(1.0)) * cs.DM(row).T for name, row in rows))

    def _sampled(self, samples: cs.MX, load: cs.MX, given: Mapping[str, cs.MX]) -> SampledMotion:
        """Return samples (orders N, s) of a motion under a load (3, s) at the tip for the sensors."""
        parts = cs.vertsplit(samples, self.model.size)
        e, e_t, e_tt = [*parts, *[cs.MX(0, samples.size2())] * (3 - len(parts))]
        theta = [given.get(own.name, cs.MX(own.value)) for own in self.damping.parameters]
        parameters = self.equations.given(
            properties=cs.vec(self._properties(given)), law=cs.vertcat(cs.MX(0, 1), *theta)
        )
        return SampledMotion(self.equations, e, e_t, e_tt, load, parameters)

    def _reading(self, k: int, channel: Channel, sampled: SampledMotion, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the readings of a channel, without its zero, (1, s)."""
        camera = self.records[k].camera
        if camera is None or channel.sensor.quantity != "position":
            return sampled.read(channel.sensor)
        scale, turn, *origin = (given.get(f"{name}_{k + 1}", cs.MX(guess)) for name, _, guess, _ in camera.unknowns)
        x, y = (sampled.read(Sensor("position", channel.sensor.point, axis)) for axis in ((1.0, 0.0), (0.0, 1.0)))
        seen = scale * (cs.cos(turn) * x - cs.sin(turn) * y), scale * (cs.sin(turn) * x + cs.cos(turn) * y)
        dx, dy = channel.sensor.unit_direction
        return dx * (origin[0] + seen[0]) + dy * (origin[1] + seen[1])


def load_at(load: TipLoad | None, times: Array, shift: cs.MX) -> cs.MX:
    """Return a load at the tip, (3, s), at times that are shifted."""
    if load is None:
        return cs.MX.zeros(LOAD, times.size)
    t = cs.MX.sym("t")
    *others, last = load.pieces()
    value = last.at(t, cs.MX(0, 1))
    for piece in reversed(others):
        value = cs.if_else(t <= piece.end, piece.at(t, cs.MX(0, 1)), value)
    return cs.Function("load", [t], [cs.densify(value)]).map(times.size)(cs.DM(times).T + shift)


def _offsets(series: Sequence[Array]) -> list[int]:
    """Return the first place of each series, and the number of all samples."""
    return [0, *np.cumsum([one.size for one in series]).tolist()]
