"""Free decays and response curves of one mode as blocks of a fit.

Each decay has its own amplitude, phase and equilibrium at the release, and shares the laws of the mode.  The decays of
one kind of sensor share the standard deviation of their noise.  A long record is reduced to the band of the mode, as by
``fit_decay``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.decay.smooth import SmoothTerms, smooth_steps
from ancf_casadi.decay.spectrum import oscillating_power
from ancf_casadi.estimation.block import Account, Block, Fitted, SeriesWeights, alike
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import resolution
from ancf_casadi.support.arrays import Array, root_mean_square
from problems.beam.curves.points import POINTS_CLOSE, CurvePoints
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.beam.curves.response_block import ResponseBlock, first_weights
from problems.decay.laws import DecayModel
from problems.decay.limitations import NOISE_FREE
from problems.decay.result import DecayFit
from problems.decay.solution import fitted_samples, rounding_curves, rounding_error
from problems.mode.oscillator import closest_motions, response_curve

# factor on standard deviations below which rounding hides the closest points (test_known_values_are_recovered...)
LEAST_FACTOR = 1e-4


@dataclass(frozen=True, eq=False)
class ModeDecay:
    """A free decay of the mode, and its fit alone."""

    label: str
    decay: Measurement  # from the release on, as it is fitted
    model: DecayModel
    names: tuple[str, ...]  # unknowns of the curve, in the order of the model
    alone: DecayFit
    step: float  # to which the record was rounded, 0 if it was not

    def rounding(self, values: Mapping[str, float]) -> Array:
        """Return the errors (m, 4) of rounding, for values of the unknowns by name."""
        own = np.array([values[name] for name in self.names])
        return rounding_curves(self.model, own, self.decay, self.step, self.alone.residual_rms)

    def curve(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the decay (m,) for unknowns by name, in the unit of the sensor."""
        return self.model.curve(self.decay.time, *(given[name] for name in self.names))


@dataclass(frozen=True, eq=False)
class DecayBlock(Block):
    """Free decays of one mode."""

    decays: tuple[ModeDecay, ...]
    weights: SeriesWeights = field(kw_only=True)

    @property
    def lengths(self) -> list[list[int]]:
        """Number of samples of each decay."""
        return [[len(one.decay.time)] for one in self.decays]

    @property
    def times(self) -> Array:
        """Times of the samples after the release, s."""
        return np.concatenate([one.decay.time for one in self.decays])

    @property
    def negligible(self) -> float:
        """Norm of the rounding errors."""
        return float(np.hypot.reduce([
            least_deviation(one.decay) / std * len(one.decay.time) ** 0.5
            for one, std in zip(self.decays, self.weights.deviations.tolist(), strict=True)
        ]))  # fmt: skip

    @property
    def systematic(self) -> float:
        """Root mean square of the rounding of the records to floating-point numbers, in standard deviations."""
        errors = np.array([rounding_error([one.decay]) for one in self.decays])
        return self.weights.root_mean_square(errors) / math.sqrt(len(errors))

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name, in standard deviations."""
        pairs = zip(self.decays, self.weights.deviations.tolist(), strict=True)
        parts: cs.MX = cs.vertcat(*((one.curve(given) - cs.DM(one.decay.values)) / std for one, std in pairs))
        return parts

    def unexplained(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the share of each oscillation, root mean square, that the curve leaves; white noise is none."""
        shares = []
        for decay, residuals in zip(self.decays, self.weights.split(fitted.residuals), strict=True):
            motion = float(np.var(decay.decay.values + residuals))
            power = oscillating_power(decay.decay.time, residuals, decay.alone.frequency / 2)
            shares.append((decay.label, math.sqrt(power / (motion + power))))
        return shares

    def account(self, fitted: Fitted) -> Account:
        """Return size and residual of each decay, and what its own fit says of the record."""
        parts = [root_mean_square(rest) for rest in self.weights.split(fitted.residuals)]
        lines, notes, data = [], [], []
        for one, rest in zip(self.decays, parts, strict=True):
            unit, alone = one.decay.sensor.unit, one.alone
            lines.append(
                f"{one.label}: decay from {alone.release_time:g} s on ({alone.release_reason}), "
                f"{len(one.decay.time)} samples, residual {rest:.3g} {unit}".rstrip()
            )
            notes += [f"{one.label}: {note}" for note in alone.notes]
            data.append({"record": one.label, "samples": len(one.decay.time), "residual_rms": rest, "unit": unit})
        return Account(lines, notes, {"kind": "decay", "records": data})

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return measured and computed decays."""
        found, errors = [], np.split(fitted.errors, np.cumsum([len(one.decay.time) for one in self.decays])[:-1])
        parts = self.weights.split(fitted.residuals)
        for one, rest, error, std in zip(self.decays, parts, errors, self.weights.deviations.tolist(), strict=True):
            y = one.decay.values
            found.append(PredictedChannel(one.label, one.decay.sensor.unit, y, y + rest, std * error, one.decay.time,
                                          TIME_AXIS, std))  # fmt: skip
        return found


@dataclass(frozen=True, eq=False)
class SmoothnessBlock(Block):
    """Prior of a smooth law: its changes from one amplitude to the next are normal, and as large as they show.

    Without it, the law swings between the amplitudes of the records.
    """

    terms: SmoothTerms
    weights: SeriesWeights = field(kw_only=True)

    stated = True  # no noise of a record
    negligible = 0.0

    @property
    def lengths(self) -> list[list[int]]:
        """One value per change."""
        return [[1] * len(self.terms.names)]

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the changes (m,) for unknowns by name, in standard deviations."""
        changes: cs.MX = smooth_steps([given[name] for name in self.terms.names])
        return changes / float(self.weights.deviations[0])

    def account(self, fitted: Fitted) -> Account:
        """Return nothing: a result says nothing of a prior that all smooth laws have."""
        return Account()

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return no channels: nothing was measured."""
        return []


def smoothness_block(terms: SmoothTerms) -> SmoothnessBlock:
    """Return the prior of a smooth law with the standard deviation to begin with."""
    count = len(terms.names)
    weights = SeriesWeights(
        np.array([count]), np.array([terms.first]), np.array([terms.least]), groups=((0,),), known=(False,)
    )
    return SmoothnessBlock(terms, weights=weights)


def least_deviation(decay: Measurement) -> float:
    """Return the standard deviation below which the residuals of a decay are rounding."""
    rounding = rounding_error([decay]) * math.sqrt(len(decay.time))
    return math.hypot(NOISE_FREE * float(np.std(decay.values)), rounding)


def decay_block(decays: Sequence[ModeDecay]) -> DecayBlock:
    """Return decays as a block, whose first weights are the residuals of each decay alone."""
    # the noise of fewer samples is smaller
    shares = [round(one.alone.fitted_samples / one.alone.samples, 3) for one in decays]
    groups = alike((one.decay.sensor.quantity, share) for one, share in zip(decays, shares, strict=True))
    floors = np.array([least_deviation(one.decay) for one in decays])
    own = np.maximum([one.alone.residual_rms for one in decays], floors)
    deviations = own.copy()
    for group in map(list, groups):
        deviations[group] = np.sqrt(np.mean(own[group] ** 2))
    weights = SeriesWeights(
        lengths=np.array([len(one.decay.time) for one in decays]),
        deviations=deviations,
        floors=floors,
        groups=groups,
        known=(False,) * len(groups),
    )
    return DecayBlock(tuple(decays), weights=weights)


def mode_decay(
    number: int, record: Measurement, alone: DecayFit, model: DecayModel, shared: Sequence[str]
) -> ModeDecay:
    """Return a decay as its fit alone used it; the names of the unknowns of its release end with its number."""
    names = tuple(name if name in shared else f"{name}_{number}" for name in alone.fit.names)
    label = record.name or f"decay {number}"
    return ModeDecay(label, fitted_samples(record, alone), replace(model, sensor=record.sensor), names, alone,
                     resolution(record.values))  # fmt: skip


def release_unknowns(decay: ModeDecay, shared: Sequence[str]) -> list[Unknown]:
    """Return the unknowns of a release and its record, from the fit alone."""
    pairs = zip(decay.names, decay.alone.fit.unknowns, strict=True)
    return [replace(one, name=name, guess=decay.alone.fit[one.name]) for name, one in pairs if one.name not in shared]


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeCurveBlock(ResponseBlock):
    """Measured response curves of one mode; the names of the unknowns begin with those of the laws."""

    model: DecayModel  # laws of the mode, without an equilibrium
    law_names: tuple[str, ...]
    constants: tuple[str, ...]  # name of the modal constant of each record
    known: Mapping[str, float]  # modal constants that are given, by name

    systematic = 10 * POINTS_CLOSE  # error of the closest points: without noise, it ends the fit

    @cached_property
    def curves(self) -> list[cs.Function]:
        """The curve of each record; other weights share them."""
        if self.before:
            return list(self.before.curves)
        return [response_curve(self.model, record, len(self.law_names)) for record in self.records]

    @cached_property
    def last(self) -> list[Array]:
        """Derivatives of the last motions of each record by the unknowns, (m, 3, k)."""
        return []

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        given, rows = {**self.known, **values}, zip(self.curves, self.records, self.measured(values), strict=True)
        found = [
            closest_motions(*row, np.array([given[name] for name in (*self.law_names, constant)]))
            for row, constant in zip(rows, self.constants, strict=True)
        ]
        self.last[:] = [by_x for _, by_x in found]
        return [motions for motions, _ in found]

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        found, names = [], self.names
        for by_x, constant in zip(self.last, self.constants, strict=True):
            change = np.zeros((*by_x.shape[:2], len(names)))
            for k, name in enumerate((*self.law_names, constant)):
                if name in names:
                    change[:, :, names.index(name)] = by_x[:, :, k]
            found.append(change)
        return found


def curves_of_mode(
    model: DecayModel,
    curves: Sequence[ResponseRecord],
    law_names: Sequence[str],
    names: Mapping[str, str],
    known: float | None,
) -> ModeCurveBlock:
    """Return response curves as a block with first weights; ``names`` has the modal constant of each unit of levels."""
    constants = tuple(names[one.excitation_unit] for one in curves)
    free = tuple(dict.fromkeys(constants)) if known is None else ()
    weights = first_weights(curves)
    return ModeCurveBlock(
        tuple(enumerate(curves, start=1)),
        (*law_names, *free),
        weights=replace(weights, floors=np.full(len(weights.lengths), LEAST_FACTOR)),
        model=model,
        law_names=tuple(law_names),
        constants=constants,
        known={} if known is None else dict.fromkeys(constants, known),
    )


def constant_unit(motion_unit: str, excitation_unit: str) -> str:
    """Return the unit of a modal constant: force per mass and level; none for a motion of the base in m."""
    if excitation_unit in BASE_MOTIONS and motion_unit == "m":
        return ""
    force = {"m": "m", "m/s": "m", "m/s^2": "m"}.get(excitation_unit)
    if force:
        return f"{motion_unit or '1'}/{force}"
    if excitation_unit == "N" and motion_unit == "m":
        return "1/kg"
    return f"{motion_unit or '1'}/(s^2 {excitation_unit})"
