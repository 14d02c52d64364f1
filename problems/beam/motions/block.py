"""Measured motions of the beam as a block of a fit.

A sensor c (``derivatives.reading``) reads h_c(t_i; theta, P, b, F) in the motion for the parameters theta of the
damping law, the properties P of the beam, the amplitude b of the base motion, and the load F, with its rate of change,
that holds the beam until it is released.  With the zero z_c of the sensor and its standard deviation s_c (``weights``),
the residuals are

    (h_c(t_i) + z_c - y_ci)/s_c

record by record and channel by channel.  Each record is one motion, integrated once for all of its channels, and
sampled at the times of each.  Channels with the same times share a series of samples; one with an unknown offset has a
series of its own.  ``weights`` has the accuracy of the integration.  Only the model is differentiated: no record is
integrated.  A trial that takes ``MOST_STEP_RATIO`` times the steps of the first run is abandoned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Self

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.derivatives.differentiable import Runs
from ancf_casadi.dynamics.derivatives.reading import SampledMotion, derivative_orders
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.dynamics.derivatives.tangent import MotionRun
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.estimation.block import Account, Block, Computed, Fitted, SeriesWeights
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.refinement import DOUBTS, LARGEST_SHIFT
from ancf_casadi.mechanics.mesh_limits import largest_bend
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array, Index, root_mean_square
from ancf_casadi.support.tables import finite_or_none
from problems.beam.mesh import split_law, split_model, split_record
from problems.beam.motions.record import Channel, MotionRecord, channel_labels, record_titles
from problems.beam.motions.weights import (
    ACCURATE,
    CHECK_RATIO,
    ERROR_ORDER,
    LEAST_ORDER,
    MODEL_STD,
    MOST_VISIBLE,
    RATIO,
    TIGHTEST,
    TYPICAL,
    coarse_or_wanted,
    first_weights,
    third_differences,
    tighter,
)
from problems.beam.properties import property_owners
from problems.beam.unknowns import base_name, load_name, loads

MOST_STEP_RATIO = 20.0  # most steps of a run, relative to the first run


@dataclass(frozen=True, eq=False)
class MotionBlock(Block):
    """Measured motions of a beam in one configuration."""

    model: Model
    numbered: tuple[tuple[int, MotionRecord], ...]  # from 1, as in the names of unknowns that are their own
    damping: DampingLaw
    first: Mapping[str, float]  # first values of the unknown properties by name, SI units
    load: tuple[str, ...]  # unknown components of the tip load at the start
    tolerance: float  # of the integration
    weights: SeriesWeights = field(kw_only=True)  # of the channels
    wanted: float | None = None  # the tolerance of the fit; None if its error shows which is needed
    expected: Array | None = None  # error of the residuals (m,) to expect after that at a larger tolerance
    coarser: float = 0.0  # that tolerance; 0 if there is none

    @property
    def records(self) -> Sequence[MotionRecord]:
        """The measurements."""
        return [record for _, record in self.numbered]

    @property
    def sensors(self) -> list[Channel]:
        """The channels of all records."""
        return [channel for record in self.records for channel in record.own_channels]

    @property
    def lengths(self) -> list[list[int]]:
        """Number of samples of each channel of each record."""
        return [[channel.measurement.time.size for channel in record.own_channels] for record in self.records]

    @property
    def times(self) -> Array:
        """Times of the residuals on the clocks of their records, s."""
        return np.concatenate([channel.measurement.time for channel in self.sensors])

    @property
    def systematic(self) -> float:
        """Root mean square of the systematic error of the records."""
        return self.weights.root_mean_square(self.weights.floors)

    @property
    def negligible(self) -> float:
        """Norm of the integration error of all readings."""
        # effect of an undetermined combination of unknowns, in units of the tolerance times the travel
        return 3.0 * self.tolerance * math.sqrt(sum(self.series)) * self.systematic / MODEL_STD

    @property
    def inaccuracy(self) -> float:
        """Norm of the integration error of all readings that fits may leave: the check of the error includes it."""
        return 2.0 * self.negligible

    @property
    def jacobian_error(self) -> float:
        """Largest error of the Jacobian relative to its change since the coarser tolerance."""
        decrease = float((self.tolerance / self.coarser) ** LEAST_ORDER)
        return decrease / (1.0 - decrease)

    @property
    def accurate(self) -> Self:
        """The same motions at a small tolerance."""
        return self if self.tolerance <= ACCURATE else replace(self, tolerance=ACCURATE, before=self)

    @cached_property
    def equations(self) -> Equations:
        """The equations of motion, before the properties change."""
        return self.before.equations if self.before else Equations(self.model, self.damping)

    @cached_property
    def _motions(self) -> list[tuple[Runs, cs.Function]]:
        """The last run of each record, and the motion as a differentiable Function; other weights share both."""
        if self.before and self.before.tolerance == self.tolerance:
            return list(self.before._motions)
        runs = [Runs(_problem(self, record), MOST_STEP_RATIO) for record in self.records]
        return [(run, run.function()) for run in runs]

    @property
    def failure(self) -> str:
        """Reason why a motion could not be computed."""
        return next((f"the last motion tried: {run.failure}" for run, _ in self._motions if run.failure), "")

    @property
    def possible_cause(self) -> str:
        """A record that begins long after the start of its motion."""
        for number, record in self.numbered:
            if record.earliest > record.end - record.origin - record.earliest:
                return (
                    f"record {number} begins {record.earliest:.4g} s after the start of its motion; if the motion "
                    "starts later, give release_time on the clock of the record"
                )
        return ""

    def close(self) -> None:
        """Forget the last runs, which are large."""
        for run, _ in self._motions:
            run.forget()
        for name in ("_finer", "rough"):
            if name in self.__dict__:  # it was used
                self.__dict__[name].close()

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals, record by record and channel by channel."""
        residuals, computed = [], self._readings(unknowns)
        for channel, reading, deviation in zip(self.sensors, computed, self.weights.deviations.tolist(), strict=True):
            difference = reading - cs.DM(channel.measurement.values)
            if channel.sensor.quantity == "slope":  # the same angle, however often the beam turned
                difference = cs.atan2(cs.sin(difference), cs.cos(difference))
            residuals.append(difference / deviation)
        all_residuals: cs.MX = cs.vertcat(*residuals)
        return all_residuals

    def _readings(self, unknowns: Mapping[str, cs.MX]) -> list[cs.MX]:
        """Return the computed readings of each channel of each record, (k, 1) each."""
        readings = []
        law = cs.vertcat(
            cs.MX(0, 1),
            *(unknowns.get(parameter.name, cs.MX(parameter.value)) for parameter in self.damping.parameters),
        )
        properties, lumped = _properties(self, unknowns)
        parameters = self.equations.parameters_with(properties=cs.vec(properties), law=law, lumped=lumped)
        for (number, record), (runs, motion) in zip(self.numbered, self._motions, strict=True):
            times, series = _clocks(record)
            shifts = _shifts(number, record, series, unknowns)
            base = [
                unknowns.get(base_name(parameter.name, number), cs.MX(parameter.value))
                for parameter in record.own_base.parameters
            ]
            inputs = [law, cs.vertcat(cs.MX(0, 1), *base), properties]
            if _has_lumped(self):
                inputs.append(lumped)
            if self.load:
                inputs.append(
                    cs.vertcat(*(unknowns.get(load_name(name, number), cs.MX(p)) for name, p in loads(record)))
                )
            if record.has_unknown_times:
                inputs.append(cs.vertcat(*shifts))
            ends = [0, *np.cumsum([instants.size for instants in times]).tolist()]
            sampled = []
            rows = runs.problem.rows.tolist()
            places = cs.DM(cs.Sparsity.triplet(self.model.size, len(rows), rows, [*range(len(rows))]))
            for samples, shift, own_times in zip(cs.horzsplit(motion(*inputs), ends), shifts, times, strict=True):
                orders = [places @ of_order for of_order in cs.vertsplit(samples, len(rows))]
                e, e_t, e_tt = [*orders, *[cs.MX(0, samples.size2())] * (3 - len(orders))]
                load = _load_at(record.load, own_times, shift)
                sampled.append(SampledMotion.of(_at_load(self.equations, record), e, e_t, e_tt, load, parameters))
            for j, (channel, place) in enumerate(zip(record.own_channels, series, strict=True), start=1):
                zero = unknowns.get(f"zero_{number}_{j}", cs.MX(0.0))
                readings.append((_channel_reading(number, record, channel, sampled[place], unknowns) + zero).T)
        return readings

    def reweight(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the standard deviations that residuals show; a first tolerance is refined anyway."""
        if self._will_be_refined or (not robust and len(self.weights.groups) == 1):  # one for all does not matter
            return None
        better = super().reweight(residuals, robust=robust)
        if better is None or self.expected is None:
            return better
        return replace(better, expected=self.expected * better.factors / self.factors)

    @property
    def _will_be_refined(self) -> bool:
        """True if the tolerance is the first one; a fit refines it, because only a second one shows the error of J."""
        return self.expected is None and self.tolerance > (self.wanted or TIGHTEST)

    @cached_property
    def _finer(self) -> Self:
        """The same motions at the next smaller tolerance."""
        ratio = CHECK_RATIO if self.coarser and not self.wanted else RATIO
        tolerance = max(self.tolerance / ratio, TIGHTEST / RATIO)
        if self.wanted and self.wanted < self.tolerance:
            tolerance = coarse_or_wanted(tolerance, self.wanted)
        return replace(self, tolerance=tolerance, before=self)

    def error(self, values: Mapping[str, float], residuals: Array, small: Callable[[Array], bool]) -> Array:
        """Return the error of residuals, from a coarser run, or one at a smaller tolerance."""
        if self.expected is not None and small(self.expected):
            return self.expected
        change = self._finer.residuals_at(values) - residuals
        return np.asarray(change / (1.0 - _decrease(self, self._finer)))

    def margin(self, error: Array) -> float:
        """Return by how much an error of the least order exceeds the expected one, relative to it."""
        if error is self.expected:
            return 0.0
        return (1.0 - _decrease(self, self._finer)) / (1.0 - _decrease(self, self._finer, LEAST_ORDER)) - 1.0

    def doubt(self, error: Array) -> float:
        """Return the part of an error that another tolerance does not show: the motion at the smaller one has errors.

        Errors at two tolerances have similar sizes and spectra, but different phases.
        """
        return root_mean_square(error) * (TYPICAL if error is self.expected else _decrease(self, self._finer))

    def refine(self, shift: float, error: Array) -> Self | None:
        """Return the block with a smaller tolerance; the first is not the last."""
        visible = 0.0 if error is self.expected else root_mean_square(error) / MOST_VISIBLE
        excess = max(shift / LARGEST_SHIFT, visible)
        needed = math.isfinite(excess) and (self.expected is None or excess > 1.0)
        if self.tolerance <= (self.wanted or TIGHTEST) or not (self.wanted or needed):
            return None
        finer, tolerance = self._finer, tighter(self.tolerance, excess)
        if not self.wanted and (finer.tolerance < TIGHTEST or (self.coarser and tolerance < finer.tolerance / 2)):
            finer = replace(self, tolerance=min(tolerance, max(finer.tolerance, TIGHTEST)), before=self)
        reduction = _decrease(self, finer, LEAST_ORDER)
        return replace(finer, expected=reduction * error, before=finer, coarser=self.tolerance)

    @cached_property
    def rough(self) -> Self:
        """The same motions, at a tolerance whose error those on two meshes share."""
        return replace(self, tolerance=self.wanted or max(self.tolerance, self.coarser / RATIO), before=self)

    def largest_bend(self, values: Mapping[str, float]) -> float:
        """Return the largest bend of an element at the steps of the motions, rad."""
        self.rough.residuals_at(values)
        last_runs = [runs.last for runs, _ in self.rough._motions]
        return max(
            [largest_bend(self.model, _coordinates(self.model, run)) for run in last_runs if run], default=math.nan
        )

    def split(self) -> Self:
        """Return the same motions with each element in two halves."""
        fine = split_model(self.model)
        numbered = tuple((number, split_record(record, self.model, fine)) for number, record in self.numbered)
        return replace(self, model=fine, numbered=numbered, damping=split_law(self.damping), before=None)

    def channels(self, fitted: Fitted | Computed) -> list[PredictedChannel]:
        """Return measured and computed readings of each channel."""
        residuals, errors = (self.weights.split(standardised) for standardised in (fitted.residuals, fitted.errors))
        of_records = zip(record_titles(self.numbered), self.records, strict=True)
        titles = [title for title, record in of_records for _ in record.own_channels]
        labels, deviations = channel_labels(self.numbered), self.weights.deviations.tolist()
        rows = zip(labels, self.sensors, residuals, errors, titles, deviations, strict=True)
        return [
            PredictedChannel(
                label,
                channel.sensor.unit,
                channel.measurement.values,
                channel.measurement.values + residual,
                error,
                channel.measurement.time,
                TIME_AXIS,
                noise,
                float(np.std(channel.measurement.values)),
                diagram=f"{title}{channel.sensor.quantity}",
            )
            for label, channel, residual, error, title, noise in rows
        ]

    def predict_record(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return the readings of the record at the estimates of a fit; the mean error of displacements is zero."""
        prediction = super().predict_record(fit, kind)
        channels = [
            replace(
                predicted_channel, predicted=predicted_channel.predicted - float(np.mean(predicted_channel.residuals))
            )
            if sensor_channel.sensor.quantity == "displacement"
            else predicted_channel
            for predicted_channel, sensor_channel in zip(prediction.channels, self.sensors, strict=True)
        ]
        return replace(prediction, channels=tuple(channels))

    def unexplained_shares(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the unexplained share of the motion in each record, root mean square; white noise does not count.

        The channels of a record count in units of their noise.
        """
        shares, deviations = [], self.weights.deviations.tolist()
        readings = iter(zip(self.sensors, self.channels(fitted), deviations, strict=True))
        for number, record in self.numbered:
            motion = unexplained = 0.0
            for sensor_channel, channel, deviation in islice(readings, len(record.own_channels)):
                white = float(np.sum(third_differences(sensor_channel) ** 2))
                unexplained += max(float(np.sum(channel.residuals**2)) - white, 0.0) / deviation**2
                motion += channel.predicted.size * float(np.var(channel.predicted)) / deviation**2
            shares.append((record.name or f"record {number}", math.sqrt(unexplained / ((motion + unexplained) or 1.0))))
        return shares

    def account(self, fitted: Fitted) -> Account:
        """Return residuals and noise of each channel, and the effect of the integration error."""
        channels, worst = self.channels(fitted), float(np.abs(fitted.shifts).max())
        explained = {name: 1.0 - share**2 for name, share in self.unexplained_shares(fitted)}
        lines = [
            *(f"{name}: {100 * share:.4g} % of the motion explained" for name, share in explained.items()),
            f"integrated at the tolerance {self.tolerance:.1e}; the integration error shifts no estimate by more than "
            f"{worst:.2g} standard errors",
        ]
        if len(self.weights.groups) > 1:
            lines += [
                f"{channel.name}: root mean square residual {channel.rms_error:.3g} {channel.unit}".rstrip()
                + f", weighted by 1/{channel.noise:.3g}"
                for channel in channels
            ]
        lines.append(
            f"the standard errors allow for a systematic error of {MODEL_STD:.0e} of the travel of each channel"
        )
        data = {
            "kind": "motion",
            "records": [{"record": name, "explained_share": share} for name, share in explained.items()],
            "channels": [
                {"channel": channel.name, "unit": channel.unit, "std": channel.noise, "rms_error": channel.rms_error}
                for channel in channels
            ],
            "tolerance": self.tolerance,
            "integration_shifts": [finite_or_none(shift) for shift in fitted.shifts.tolist()],
        }
        return Account(lines, self._limitations(fitted, worst), data)

    def _limitations(self, fitted: Fitted, worst: float) -> list[str]:
        """Return the warning about the integration error."""
        if math.isnan(worst):
            return [
                f"the integration error at the tolerance {self.tolerance:.1e} could not be checked: its effect on the "
                "estimates is unknown"
            ]
        if worst <= DOUBTS * LARGEST_SHIFT:
            return []
        name = fitted.fit.names[int(np.abs(fitted.shifts).argmax())]
        advice = "let the fit select the tolerance" if self.tolerance > TIGHTEST else "shorten the record"
        return [
            f"the integration error at the tolerance {self.tolerance:.1e} shifts {name} by {worst:.2g} standard "
            f"errors; {advice}"
        ]


def motion_block(
    model: Model,
    numbered: Sequence[tuple[int, MotionRecord]],
    damping: DampingLaw,
    first: Mapping[str, float],
    *,
    load: tuple[str, ...] = (),
    tolerance: float = ACCURATE,
    wanted: float | None = None,
    robust: bool = False,
) -> MotionBlock:
    """Return motions as a block with first weights."""
    weights = first_weights([record for _, record in numbered], robust=robust)
    return MotionBlock(model, tuple(numbered), damping, first, load, tolerance, wanted, weights=weights)


def sensor_noise(blocks: Sequence[Block]) -> dict[Sensor, float]:
    """Return the standard deviation of the noise of each sensor of the motions among blocks."""
    motions = [block for block in blocks if isinstance(block, MotionBlock)]
    pairs = [zip(block.sensors, block.weights.deviations.tolist(), strict=True) for block in motions]
    return {channel.sensor: deviation for of_block in pairs for channel, deviation in of_block}


def _decrease(block: MotionBlock, finer: MotionBlock, order: float = ERROR_ORDER) -> float:
    """Return the integration error of finer motions relative to that of motions."""
    return float((finer.tolerance / block.tolerance) ** order)


def _problem(block: MotionBlock, record: MotionRecord) -> SensitivityProblem:
    """Return the motion of a record with its derivatives."""
    series = _clocks(record)[0]
    times, places = np.concatenate(series), np.repeat(np.arange(len(series)), [instants.size for instants in series])
    return SensitivityProblem(
        equations=_at_load(block.equations, record),
        base=record.own_base,
        load=None if record.load is None else record.load.along(block.model.beam),
        start=record.start,
        times=times if record.has_unknown_times else times - record.release_bounds[0] + record.origin,
        tolerance=block.tolerance,
        held=bool(block.load),
        orders=max(derivative_orders(channel.sensor) for channel in record.own_channels),
        clocks=places if record.has_unknown_times else places[:0],
        span=(record.origin, record.end),
        lumped=_has_lumped(block),
        rows=_sampled_rows(block, record),
    )


def _sampled_rows(block: MotionBlock, record: MotionRecord) -> Index:
    """Return the coordinates on which the sensors of a record depend."""
    equations, size = block.equations, block.model.size
    e, e_t, e_tt = motion = [cs.MX.sym(name, size) for name in ("e", "e_t", "e_tt")]
    load = cs.MX.sym("load", LOAD_SIZE)
    sampled = SampledMotion.of(equations, e, e_t, e_tt, load, cs.MX(cs.DM(equations.parameters)))
    of_channels = [_channel_reading(1, record, channel, sampled, {}) for channel in record.own_channels]
    readings = cs.Function("readings", [cs.vertcat(*motion), load], [cs.vertcat(*of_channels)])
    columns = readings.jac_sparsity(0, 0).get_triplet()[1]
    return np.unique(np.array(columns) % size)


def _at_load(equations: Equations, record: MotionRecord) -> Equations:
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
        channel_times = channel.measurement.time
        same = [k for k, instants in enumerate(times) if shared[k] and np.array_equal(instants, channel_times)]
        if not same or channel.offset:
            same = [len(times)]
            times.append(channel_times)
            shared.append(channel.offset is None)
        places.append(same[0])
    return times, places


def _shifts(number: int, record: MotionRecord, series: Sequence[int], unknowns: Mapping[str, cs.MX]) -> list[cs.MX]:
    """Return the times that lead from the clock of each series to that of the base motion, s."""
    release = unknowns.get(f"release_{number}", cs.MX(sum(record.release_bounds) / 2))
    shifts = [record.origin - release] * (max(series) + 1)
    for j, place in enumerate(series, start=1):
        if f"offset_{number}_{j}" in unknowns:
            shifts[place] = shifts[place] - unknowns[f"offset_{number}_{j}"]
    return shifts


def _has_lumped(block: MotionBlock) -> bool:
    """Return whether a lumped property of the beam is unknown."""
    return bool(set(block.first) & set(block.model.lumped))


def _properties(block: MotionBlock, unknowns: Mapping[str, cs.MX]) -> tuple[cs.MX, cs.MX]:
    """Return the properties of the elements, (4, n), and the lumped ones that the beam has."""
    values, owners = block.model.properties, property_owners(block.model.beam, tuple(block.first))
    factors = [*(unknowns[name] / first for name, first in block.first.items()), cs.MX(1.0)]  # last: for the place -1
    rows = owners[: values.size].reshape(values.shape)
    scaled = [
        cs.DM(of_elements).T * (cs.horzcat(*(factors[k] for k in row)) if row.max() >= 0 else factors[-1])
        for of_elements, row in zip(values, rows, strict=True)
    ]
    pairs = zip(block.model.lumped.values(), owners[values.size :].tolist(), strict=True)
    lumped = [value * factors[k] for value, k in pairs]
    return cs.vertcat(*scaled), cs.vertcat(cs.MX(0, 1), *lumped)


def _coordinates(model: Model, run: MotionRun) -> Array:
    """Return the coordinates at the steps of a motion, (s, size)."""
    free = np.concatenate([passage.steps.q for passage in run.passages])
    base = [passage.excitation.derivatives(passage.steps.instants[:-1])[:, :NODE] for passage in run.passages]
    return model.whole(free.T, np.concatenate(base).T).T


def _load_at(load: TipLoad | None, times: Array, shift: cs.MX) -> cs.MX:
    """Return a load at the tip, (3, s), at times that are shifted."""
    if load is None:
        return cs.MX.zeros(LOAD_SIZE, times.size)
    t = cs.MX.sym("t")
    *earlier_pieces, last = load.pieces()
    value = last.at(t, cs.MX(0, 1))
    for piece in reversed(earlier_pieces):
        value = cs.if_else(t <= piece.end, piece.at(t, cs.MX(0, 1)), value)
    return cs.Function("load", [t], [cs.densify(value)[:LOAD_SIZE]]).map(times.size)(cs.DM(times).T + shift)


def _channel_reading(
    number: int, record: MotionRecord, channel: Channel, sampled: SampledMotion, unknowns: Mapping[str, cs.MX]
) -> cs.MX:
    """Return the readings of a channel, without its zero, (1, s); positions as the camera sees them."""
    camera = record.camera
    if camera is None or channel.sensor.quantity != "position":
        return sampled.read(channel.sensor)
    scale, turn, *origin = (unknowns.get(f"{name}_{number}", cs.MX(guess)) for name, _, guess, _ in camera.unknowns)
    x, y = (sampled.read(Sensor("position", channel.sensor.point, axis)) for axis in ((1.0, 0.0), (0.0, 1.0)))
    in_picture = scale * (cs.cos(turn) * x - cs.sin(turn) * y), scale * (cs.sin(turn) * x + cs.cos(turn) * y)
    dx, dy = channel.sensor.unit_direction
    return dx * (origin[0] + in_picture[0]) + dy * (origin[1] + in_picture[1])
