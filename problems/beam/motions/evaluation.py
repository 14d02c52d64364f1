"""The readings of all sensors in the measured motions of a block, as expressions of the unknowns.

Each record is one motion, integrated once for all of its channels, and sampled at the times of each.  Channels with the
same times share a series of samples; one with an unknown offset has a series of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.differentiable import Runs
from ancf_casadi.dynamics.derivatives.reading import SampledMotion, orders_of
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from problems.beam.motions.record import Channel, MotionRecord
from problems.beam.properties import Owners
from problems.beam.unknowns import base_name, load_name, loads

if TYPE_CHECKING:
    from problems.beam.motions.block import MotionBlock

MOST_STEP_RATIO = 20.0  # most steps of a run, relative to the first run


@dataclass(frozen=True, eq=False)
class MotionEvaluation:
    """Motions as differentiable Functions."""

    block: MotionBlock
    equations: Equations
    runs: list[Runs]  # the last run of each record
    motions: list[cs.Function]  # the motion of each record

    @classmethod
    def of(cls, block: MotionBlock, before: MotionEvaluation | None = None) -> MotionEvaluation:
        """Return the motions of a block, before a run; with the equations of an earlier evaluation, if there is one."""
        equations = before.equations if before else Equations(block.model, block.damping)
        runs = [Runs(_problem(block, equations, record), MOST_STEP_RATIO) for record in block.records]
        return cls(block, equations, runs, [one.function() for one in runs])

    @property
    def failure(self) -> str:
        """Reason why a motion could not be computed."""
        return next((f"the last motion tried: {one.failure}" for one in self.runs if one.failure), "")

    def close(self) -> None:
        """Forget the last runs, which are large."""
        for one in self.runs:
            one.forget()

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals, record by record and channel by channel."""
        parts, block = [], self.block
        computed = self._readings(given)
        for channel, own, deviation in zip(block.sensors, computed, block.weights.deviations.tolist(), strict=True):
            rest = own - cs.DM(channel.measurement.values)
            if channel.sensor.quantity == "slope":  # the same angle, however often the beam turned
                rest = cs.atan2(cs.sin(rest), cs.cos(rest))
            parts.append(rest / deviation)
        found: cs.MX = cs.vertcat(*parts)
        return found

    def _readings(self, given: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the computed readings of each channel of each record, (k, 1) each."""
        block, found = self.block, []
        law = cs.vertcat(cs.MX(0, 1), *(given.get(own.name, cs.MX(own.value)) for own in block.damping.parameters))
        properties, lumped = _properties(block, given)
        parameters = self.equations.given(properties=cs.vec(properties), law=law, lumped=lumped)
        for (number, record), motion in zip(block.numbered, self.motions, strict=True):
            times, series = _clocks(record)
            shifts = _shifts(number, record, series, given)
            base = [given.get(base_name(own.name, number), cs.MX(own.value)) for own in record.own_base.parameters]
            inputs = [law, cs.vertcat(cs.MX(0, 1), *base), properties]
            if _has_lumped(block):
                inputs.append(lumped)
            if block.load:
                inputs.append(cs.vertcat(*(given.get(load_name(name, number), cs.MX(p)) for name, p in loads(record))))
            if record.has_unknown_times:
                inputs.append(cs.vertcat(*shifts))
            ends = [0, *np.cumsum([one.size for one in times]).tolist()]
            sampled = []
            for part, shift, own_times in zip(cs.horzsplit(motion(*inputs), ends), shifts, times, strict=True):
                orders = cs.vertsplit(part, block.model.size)
                e, e_t, e_tt = [*orders, *[cs.MX(0, part.size2())] * (3 - len(orders))]
                load = _load_at(record.load, own_times, shift)
                sampled.append(SampledMotion.of(_loaded(self.equations, record), e, e_t, e_tt, load, parameters))
            for j, (channel, place) in enumerate(zip(record.own_channels, series, strict=True), start=1):
                zero = given.get(f"zero_{number}_{j}", cs.MX(0.0))
                found.append((_seen(number, record, channel, sampled[place], given) + zero).T)
        return found


def _problem(block: MotionBlock, equations: Equations, record: MotionRecord) -> SensitivityProblem:
    """Return the motion of a record with its derivatives."""
    series = _clocks(record)[0]
    times, places = np.concatenate(series), np.repeat(np.arange(len(series)), [one.size for one in series])
    return SensitivityProblem(
        equations=_loaded(equations, record),
        base=record.own_base,
        load=None if record.load is None else record.load.along(block.model.beam),
        start=record.start,
        times=times if record.has_unknown_times else times - record.release_bounds[0] + record.origin,
        tolerance=block.tolerance,
        held=bool(block.load),
        orders=max(orders_of(channel.sensor) for channel in record.own_channels),
        clocks=places if record.has_unknown_times else places[:0],
        span=(record.origin, record.end),
        lumped=_has_lumped(block),
    )


def _loaded(equations: Equations, record: MotionRecord) -> Equations:
    """Return the equations with the load of a record at its place."""
    if record.load is None or record.load.place == equations.place:
        return equations
    return replace(equations, place=record.load.place)


def _clocks(record: MotionRecord) -> tuple[list[Array], list[int]]:
    """Return the distinct series of sampling times of a record, s, and the series of each channel."""
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
    return times, places


def _shifts(number: int, record: MotionRecord, series: Sequence[int], given: Mapping[str, cs.MX]) -> list[cs.MX]:
    """Return the times that lead from the clock of each series to that of the base motion, s."""
    release = given.get(f"release_{number}", cs.MX(sum(record.release_bounds) / 2))
    shifts = [record.origin - release] * (max(series) + 1)
    for j, place in enumerate(series, start=1):
        if f"offset_{number}_{j}" in given:
            shifts[place] = shifts[place] - given[f"offset_{number}_{j}"]
    return shifts


def _has_lumped(block: MotionBlock) -> bool:
    """Return whether a lumped property of the beam is unknown."""
    return bool(set(block.first) & set(block.model.lumped))


def _properties(block: MotionBlock, given: Mapping[str, cs.MX]) -> tuple[cs.MX, cs.MX]:
    """Return the properties of the elements, (4, n), and the lumped ones that the beam has."""
    values, index = block.model.properties, Owners.of(block.model.beam, tuple(block.first)).index
    factors = [*(given[name] / first for name, first in block.first.items()), cs.MX(1.0)]  # the last for the place -1
    rows = index[: values.size].reshape(values.shape)
    scaled = [
        cs.DM(own).T * (cs.horzcat(*(factors[k] for k in row)) if row.max() >= 0 else factors[-1])
        for own, row in zip(values, rows, strict=True)
    ]
    owners = index[values.size :].tolist()
    lumped = [value * factors[k] for value, k in zip(block.model.lumped.values(), owners, strict=True)]
    return cs.vertcat(*scaled), cs.vertcat(cs.MX(0, 1), *lumped)


def _load_at(load: TipLoad | None, times: Array, shift: cs.MX) -> cs.MX:
    """Return a load at the tip, (3, s), at times that are shifted."""
    if load is None:
        return cs.MX.zeros(LOAD_SIZE, times.size)
    t = cs.MX.sym("t")
    *others, last = load.pieces()
    value = last.at(t, cs.MX(0, 1))
    for piece in reversed(others):
        value = cs.if_else(t <= piece.end, piece.at(t, cs.MX(0, 1)), value)
    return cs.Function("load", [t], [cs.densify(value)[:LOAD_SIZE]]).map(times.size)(cs.DM(times).T + shift)


def _seen(
    number: int, record: MotionRecord, channel: Channel, sampled: SampledMotion, given: Mapping[str, cs.MX]
) -> cs.MX:
    """Return the readings of a channel, without its zero, (1, s); positions as the camera sees them."""
    camera = record.camera
    if camera is None or channel.sensor.quantity != "position":
        return sampled.read(channel.sensor)
    scale, turn, *origin = (given.get(f"{name}_{number}", cs.MX(guess)) for name, _, guess, _ in camera.unknowns)
    x, y = (sampled.read(Sensor("position", channel.sensor.point, axis)) for axis in ((1.0, 0.0), (0.0, 1.0)))
    seen = scale * (cs.cos(turn) * x - cs.sin(turn) * y), scale * (cs.sin(turn) * x + cs.cos(turn) * y)
    dx, dy = channel.sensor.unit_direction
    return dx * (origin[0] + seen[0]) + dy * (origin[1] + seen[1])
