"""Measured motions of the beam as a block of a fit.

A sensor c (``derivatives.reading``) reads h_c(t_i; theta, P, b, F) in the motion for the parameters theta of the
damping law, the properties P of the beam, the amplitude b of the base motion, and the load F, with its rate of change,
that holds the beam until it is released.  With the zero z_c of the sensor and its standard deviation s_c (``weights``),
the residuals are

    (h_c(t_i) + z_c - y_ci)/s_c

record by record and channel by channel.  The motion is integrated once for all channels of a record, and sampled at the
times of each.  Only the model is differentiated: records are never integrated.  ``tolerance`` has the accuracy of the
integration.  A trial that takes ``MOST_STEP_RATIO`` times the steps of the first run is abandoned.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.differentiable import Runs
from ancf_casadi.dynamics.derivatives.reading import SampledMotion, orders_of
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.estimation.block import Account, Block, Evaluation, Fitted
from ancf_casadi.estimation.solve import LARGEST_SHIFT
from ancf_casadi.mechanics.beam import LUMPED
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array, Index, root_mean_square
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.tables import known
from problems.beam.motions.clocks import Clocks, load_at, offsets
from problems.beam.motions.record import Channel, MotionRecord, labels_of
from problems.beam.motions.tolerance import CHECK_RATIO, TIGHTEST, first_tolerance, tighter
from problems.beam.motions.weights import MODEL_STD, Weights, first_weights
from problems.beam.names import base_name, load_name, loads
from problems.beam.properties import Owners

MOST_STEP_RATIO = 20.0  # most steps of a run, relative to the first run


@dataclass(frozen=True, eq=False)
class MotionBlock(Block):
    """Measured motions of a beam in one configuration.

    Parameters
    ----------
    model : Model
        The beam.
    numbered : tuple of (int, MotionRecord)
        The measurements, with their numbers, from 1, in the names of the unknowns that are their own.
    damping : DampingLaw
        The law.
    first : mapping
        First values of the unknown properties by name, SI units.
    load : tuple of str
        Unknown components of the tip load at the start.
    tolerance : float
        Tolerance of the integration.
    weights : Weights
        The weights of the channels.
    adaptive : bool
        Whether the tolerance may become smaller.
    """

    model: Model
    numbered: tuple[tuple[int, MotionRecord], ...]
    damping: DampingLaw
    first: Mapping[str, float]
    load: tuple[str, ...]
    tolerance: float
    weights: Weights
    adaptive: bool = True

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the block without its Functions, which the receiving process derives again."""
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    @property
    def records(self) -> Sequence[MotionRecord]:
        """The measurements."""
        return [record for _, record in self.numbered]

    @property
    def channels(self) -> list[Channel]:
        """The channels of all records."""
        return [channel for record in self.records for channel in record.own_channels]

    @property
    def series(self) -> list[int]:
        """Number of samples of each channel."""
        return [channel.measurement.time.size for channel in self.channels]

    @property
    def times(self) -> Array:
        """Times of the residuals on the clocks of their records, s."""
        return np.concatenate([channel.measurement.time for channel in self.channels])

    @property
    def owners(self) -> Index:
        """Record of each residual."""
        sizes = [sum(one.measurement.time.size for one in record.own_channels) for record in self.records]
        return np.repeat(np.arange(len(sizes)), sizes)

    @property
    def scale(self) -> float:
        """Geometric mean of the standard deviations of the channels."""
        return self.weights.scale

    @property
    def systematic(self) -> float:
        """Root mean square of the systematic error of the records."""
        return self.weights.systematic

    @property
    def negligible(self) -> float:
        """Norm of the integration error of all readings."""
        # effect of an undetermined combination of unknowns, in units of the tolerance times the travel
        return 3.0 * self.tolerance * self.weights.travel

    def evaluation(self, before: Evaluation | None = None) -> MotionEvaluation:
        """Return the motions as differentiable Functions; those of ``before`` serve other weights too."""
        if isinstance(before, MotionEvaluation) and before.block.tolerance == self.tolerance:
            return MotionEvaluation(self, before.runs, before.motions)
        runs = [Runs(self._motion(record), MOST_STEP_RATIO) for record in self.records]
        return MotionEvaluation(self, runs, [one.function() for one in runs])

    def reweighted(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the standard deviations that residuals show."""
        if not (robust or self.weights.improvable):
            return None
        return replace(self, weights=self.weights.improved(residuals, robust=robust))

    def error(self, values: Mapping[str, float], residuals: Array, evaluation: Any) -> Array:
        """Return the error of residuals, from one integration of each record at a smaller tolerance."""
        tight = replace(self, tolerance=self.tolerance / CHECK_RATIO).evaluation()
        found = tight.residuals({name: cs.MX(value) for name, value in values.items()})
        with delayed_interrupts():
            change = np.asarray(cs.evalf(found)).ravel() - residuals
        tight.close()
        return np.asarray(change)

    def refined(self, shift: float) -> Self | None:
        """Return the block with a smaller tolerance."""
        if not self.adaptive or self.tolerance <= TIGHTEST:
            return None
        return replace(self, tolerance=tighter(self.tolerance, shift))

    def readings(self, motions: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the computed readings of each channel of each record, (k, 1) each.

        Parameters
        ----------
        motions : sequence of Function
            The motions of the records.
        given : mapping
            Unknowns by name.
        """
        found = []
        for (number, record), motion in zip(self.numbered, motions, strict=True):
            clocks = Clocks.of(record)
            shifts = self._shifts(number, record, clocks, given)
            samples = cs.horzsplit(self._samples(number, record, motion, shifts, given), offsets(clocks.times))
            pairs = zip(samples, shifts, clocks.times, strict=True)
            sampled = [self._sampled(part, load_at(record.load, own, shift), given) for part, shift, own in pairs]
            for j, (channel, series) in enumerate(zip(record.own_channels, clocks.channels, strict=True)):
                zero = given.get(f"zero_{number}_{j + 1}", cs.MX(0.0))
                found.append((self._reading(number, record, channel, sampled[series], given) + zero).T)
        return found

    def account(self, fitted: Fitted) -> Account:
        """Return residuals and noise of each channel, and the effect of the integration error."""
        residuals, deviations = self.weights.split(fitted.residuals), self.weights.deviations.tolist()
        channels = list(zip(labels_of(self.records), self.channels, deviations, residuals, strict=True))
        worst = float(np.abs(fitted.shifts).max())
        lines = [
            f"integrated at the tolerance {self.tolerance:.1e}; the integration error shifts no estimate by more than "
            f"{worst:.2g} standard errors"
        ]
        if len(self.weights.groups) > 1:
            lines += [
                f"{label}: root mean square residual {root_mean_square(rest):.3g} {one.sensor.unit}".rstrip()
                + f", weighted by 1/{deviation:.3g}"
                for label, one, deviation, rest in channels
            ]
        lines.append(
            f"the standard errors allow for a systematic error of {MODEL_STD:.0e} of the travel of each channel"
        )
        return Account(
            lines,
            self._limitations(fitted, worst),
            {
                "kind": "motion",
                "channels": [
                    {"channel": label, "unit": one.sensor.unit, "std": deviation, "rms_error": root_mean_square(rest)}
                    for label, one, deviation, rest in channels
                ],
                "tolerance": self.tolerance,
                "integration_shifts": [known(shift) for shift in fitted.shifts.tolist()],
            },
        )

    def _limitations(self, fitted: Fitted, worst: float) -> list[str]:
        """Return the warning about the integration error."""
        if math.isnan(worst):
            return [
                f"the integration error at the tolerance {self.tolerance:.1e} could not be checked: its effect on the "
                "estimates is unknown"
            ]
        if worst <= LARGEST_SHIFT:
            return []
        name = fitted.fit.names[int(np.abs(fitted.shifts).argmax())]
        advice = "let the fit select the tolerance" if self.tolerance > TIGHTEST else "shorten the record"
        return [
            f"the integration error at the tolerance {self.tolerance:.1e} shifts {name} by {worst:.2g} standard "
            f"errors; {advice}"
        ]

    @cached_property
    def equations(self) -> Equations:
        """The equation of motion."""
        return Equations(self.model, self.damping)

    @property
    def _lumped(self) -> bool:
        """True if a lumped property of the beam is unknown."""
        return bool(set(self.first) & set(self.model.lumped))

    def _motion(self, record: MotionRecord) -> SensitivityProblem:
        clocks = Clocks.of(record)
        times = np.concatenate(clocks.times)
        return SensitivityProblem(
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
            lumped=self._lumped,
        )

    def _shifts(self, number: int, record: MotionRecord, clocks: Clocks, given: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the times that lead from the clock of each series to that of the base motion, s."""
        release = given.get(f"release_{number}", cs.MX(sum(record.release_bounds) / 2))
        shifts = [record.origin - release] * len(clocks.times)
        for j, series in enumerate(clocks.channels):
            if f"offset_{number}_{j + 1}" in given:
                shifts[series] = shifts[series] - given[f"offset_{number}_{j + 1}"]
        return shifts

    def _samples(
        self,
        number: int,
        record: MotionRecord,
        motion: cs.Function,
        shifts: Sequence[cs.MX],
        given: Mapping[str, cs.MX],
    ) -> cs.MX:
        """Return coordinates, and velocities and accelerations where needed, at all samples of a record."""
        b = [given.get(base_name(own.name, number), cs.MX(own.value)) for own in record.own_base.parameters]
        inputs = [self._law(given), cs.vertcat(cs.MX(0, 1), *b), self._properties(given)]
        if self._lumped:
            inputs.append(self._lumped_values(given))
        if self.load:
            inputs.append(cs.vertcat(*(given.get(load_name(name, number), cs.MX(p)) for name, p in loads(record))))
        if record.has_unknown_times:
            inputs.append(cs.vertcat(*shifts))
        sampled: cs.MX = motion(*inputs)
        return sampled

    def _law(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the parameters of the law."""
        return cs.vertcat(cs.MX(0, 1), *(given.get(own.name, cs.MX(own.value)) for own in self.damping.parameters))

    def _factor(self, k: int, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the factor of an unknown property, by its place in ``first``; 1 for the place -1."""
        if k < 0:
            return cs.MX(1.0)
        name = [*self.first][k]
        return given[name] / self.first[name]

    @cached_property
    def _owners(self) -> Owners:
        return Owners.of(self.model.beam, tuple(self.first))

    def _properties(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the properties of the elements, (4, n)."""
        values = self.model.properties
        rows = self._owners.index[: values.size].reshape(values.shape)
        factors = [cs.horzcat(*(self._factor(k, given) for k in row)) if row.max() >= 0 else cs.MX(1.0) for row in rows]
        return cs.vertcat(*(cs.DM(own).T * factor for own, factor in zip(values, factors, strict=True)))

    def _lumped_values(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the lumped properties that the beam has."""
        places = {name: int(self._owners.index[self.model.properties.size + LUMPED.index(name)]) for name in LUMPED}
        own = (value * self._factor(places[name], given) for name, value in self.model.lumped.items())
        return cs.vertcat(cs.MX(0, 1), *own)

    def _sampled(self, samples: cs.MX, load: cs.MX, given: Mapping[str, cs.MX]) -> SampledMotion:
        """Return samples (orders N, s) of a motion under a load (3, s) at the tip for the sensors."""
        parts = cs.vertsplit(samples, self.model.size)
        e, e_t, e_tt = [*parts, *[cs.MX(0, samples.size2())] * (3 - len(parts))]
        parameters = self.equations.given(
            properties=cs.vec(self._properties(given)), law=self._law(given), lumped=self._lumped_values(given)
        )
        return SampledMotion.of(self.equations, e, e_t, e_tt, load, parameters)

    def _reading(
        self, number: int, record: MotionRecord, channel: Channel, sampled: SampledMotion, given: Mapping[str, cs.MX]
    ) -> cs.MX:
        """Return the readings of a channel, without its zero, (1, s)."""
        camera = record.camera
        if camera is None or channel.sensor.quantity != "position":
            return sampled.read(channel.sensor)
        scale, turn, *origin = (given.get(f"{name}_{number}", cs.MX(guess)) for name, _, guess, _ in camera.unknowns)
        x, y = (sampled.read(Sensor("position", channel.sensor.point, axis)) for axis in ((1.0, 0.0), (0.0, 1.0)))
        seen = scale * (cs.cos(turn) * x - cs.sin(turn) * y), scale * (cs.sin(turn) * x + cs.cos(turn) * y)
        dx, dy = channel.sensor.unit_direction
        return dx * (origin[0] + seen[0]) + dy * (origin[1] + seen[1])


@dataclass(frozen=True, eq=False)
class MotionEvaluation:
    """Motions as differentiable Functions.

    Parameters
    ----------
    block : MotionBlock
        The block.
    runs : list of Runs
        The last run of each record.
    motions : list of Function
        The motion of each record.
    """

    block: MotionBlock
    runs: list[Runs]
    motions: list[cs.Function]

    @property
    def failure(self) -> str:
        """Reason why a motion could not be computed."""
        return next((f"the last motion tried: {one.failure}" for one in self.runs if one.failure), "")

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals, record by record and channel by channel."""
        parts, block = [], self.block
        computed = block.readings(self.motions, given)
        for channel, own, deviation in zip(block.channels, computed, block.weights.deviations.tolist(), strict=True):
            rest = own - cs.DM(channel.measurement.values)
            if channel.sensor.quantity == "slope":  # the same angle, however often the beam turned
                rest = cs.atan2(cs.sin(rest), cs.cos(rest))
            parts.append(rest / deviation)
        found: cs.MX = cs.vertcat(*parts)
        return found

    def close(self) -> None:
        """Forget the last runs, which are large."""
        for one in self.runs:
            one.forget()


def motion_block(
    model: Model,
    numbered: Sequence[tuple[int, MotionRecord]],
    damping: DampingLaw,
    first: Mapping[str, float],
    *,
    load: tuple[str, ...] = (),
    tolerance: float | None = None,
    robust: bool = False,
) -> MotionBlock:
    """Return motions as a block with first weights, integrated as accurately as these require."""
    records = [record for _, record in numbered]
    weights = first_weights(records, robust=robust)
    chosen = first_tolerance(records, weights, model.beam.length) if tolerance is None else tolerance
    return MotionBlock(model, tuple(numbered), damping, first, load, chosen, weights, tolerance is None)
