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
    """A free decay of the mode, and the separate fit of this decay."""

    label: str
    record: Measurement  # from the release on
    model: DecayModel
    unknown_names: tuple[str, ...]  # unknowns of the curve, in the order of the model
    separate_fit: DecayFit
    step: float  # resolution of the record, 0 if its values are not rounded

    def rounding(self, values: Mapping[str, float]) -> Array:
        """Return the errors (m, 4) of rounding, for values of the unknowns by name."""
        unknown_values = np.array([values[name] for name in self.unknown_names])
        return rounding_curves(self.model, unknown_values, self.record, self.step, self.separate_fit.residual_rms)

    def curve(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the decay (m,) for unknowns by name, in the unit of the sensor."""
        return self.model.curve(self.record.time, *(unknowns[name] for name in self.unknown_names))


@dataclass(frozen=True, eq=False)
class DecayBlock(Block):
    """Free decays of one mode."""

    decays: tuple[ModeDecay, ...]
    weights: SeriesWeights = field(kw_only=True)

    @property
    def lengths(self) -> list[list[int]]:
        """Number of samples of each decay."""
        return [[len(decay.record.time)] for decay in self.decays]

    @property
    def times(self) -> Array:
        """Times of the samples after the release, s."""
        return np.concatenate([decay.record.time for decay in self.decays])

    @property
    def negligible(self) -> float:
        """Norm of the rounding errors."""
        return float(np.hypot.reduce([
            least_deviation(decay.record) / std * len(decay.record.time) ** 0.5
            for decay, std in zip(self.decays, self.weights.deviations.tolist(), strict=True)
        ]))  # fmt: skip

    @property
    def systematic(self) -> float:
        """Root mean square of the rounding of the records to floating-point numbers, in standard deviations."""
        errors = np.array([rounding_error([decay.record]) for decay in self.decays])
        return self.weights.root_mean_square(errors) / math.sqrt(len(errors))

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name, in standard deviations."""
        pairs = zip(self.decays, self.weights.deviations.tolist(), strict=True)
        residuals: cs.MX = cs.vertcat(
            *((decay.curve(unknowns) - cs.DM(decay.record.values)) / std for decay, std in pairs)
        )
        return residuals

    def unexplained(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the unexplained share of each oscillation, root mean square; white noise does not count."""
        shares = []
        for decay, residuals in zip(self.decays, self.weights.split(fitted.residuals), strict=True):
            motion = float(np.var(decay.record.values + residuals))
            power = oscillating_power(decay.record.time, residuals, decay.separate_fit.frequency / 2)
            shares.append((decay.label, math.sqrt(power / (motion + power))))
        return shares

    def account(self, fitted: Fitted) -> Account:
        """Return size and residual of each decay, and the notes of its separate fit."""
        lines, notes, data = [], [], []
        for decay, residuals in zip(self.decays, self.weights.split(fitted.residuals), strict=True):
            unit, separate_fit, residual_rms = decay.record.sensor.unit, decay.separate_fit, root_mean_square(residuals)
            lines.append(
                f"{decay.label}: decay from {separate_fit.release_time:g} s on ({separate_fit.release_reason}), "
                f"{len(decay.record.time)} samples, residual {residual_rms:.3g} {unit}".rstrip()
            )
            notes += [f"{decay.label}: {note}" for note in separate_fit.notes]
            data.append(
                {"record": decay.label, "samples": len(decay.record.time), "residual_rms": residual_rms, "unit": unit}
            )
        return Account(lines, notes, {"kind": "decay", "records": data})

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return measured and computed decays."""
        residuals, errors = self.weights.split(fitted.residuals), self.weights.split(fitted.errors)
        stds = self.weights.deviations.tolist()
        return [
            PredictedChannel(
                decay.label,
                decay.record.sensor.unit,
                decay.record.values,
                decay.record.values + residual,
                error,
                decay.record.time,
                TIME_AXIS,
                std,
            )
            for decay, residual, error, std in zip(self.decays, residuals, errors, stds, strict=True)
        ]


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

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the changes (m,) for unknowns by name, in standard deviations."""
        changes: cs.MX = smooth_steps([unknowns[name] for name in self.terms.names])
        return changes / float(self.weights.deviations[0])

    def account(self, fitted: Fitted) -> Account:
        """Return an empty account: all smooth laws have this prior, and results do not mention it."""
        return Account()

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return no channels: nothing was measured."""
        return []


def smoothness_block(terms: SmoothTerms) -> SmoothnessBlock:
    """Return the prior of a smooth law with its first standard deviation."""
    count = len(terms.names)
    weights = SeriesWeights(
        np.array([count]), np.array([terms.first]), np.array([terms.least]), groups=((0,),), known=(False,)
    )
    return SmoothnessBlock(terms, weights=weights)


def least_deviation(record: Measurement) -> float:
    """Return the standard deviation of residuals that rounding alone explains."""
    rounding = rounding_error([record]) * math.sqrt(len(record.time))
    return math.hypot(NOISE_FREE * float(np.std(record.values)), rounding)


def decay_block(decays: Sequence[ModeDecay]) -> DecayBlock:
    """Return decays as a block; its first weights follow from the residuals of the separate fits."""
    # the noise of fewer samples is smaller
    shares = [round(decay.separate_fit.fitted_samples / decay.separate_fit.samples, 3) for decay in decays]
    groups = alike((decay.record.sensor.quantity, share) for decay, share in zip(decays, shares, strict=True))
    floors = np.array([least_deviation(decay.record) for decay in decays])
    lengths = np.array([len(decay.record.time) for decay in decays])
    weights = SeriesWeights(lengths, deviations=floors, floors=floors, groups=groups, known=(False,) * len(groups))
    residuals = [np.array([decay.separate_fit.residual_rms]) for decay in decays]
    return DecayBlock(tuple(decays), weights=weights.improved(residuals))


def mode_decay(
    number: int, record: Measurement, separate_fit: DecayFit, model: DecayModel, law_names: Sequence[str]
) -> ModeDecay:
    """Return a decay with its separate fit; the names of the unknowns of its release end with its number."""
    names = tuple(name if name in law_names else f"{name}_{number}" for name in separate_fit.fit.names)
    label = record.name or f"decay {number}"
    model = replace(model, sensor=record.sensor)
    return ModeDecay(label, fitted_samples(record, separate_fit), model, names, separate_fit, resolution(record.values))


def release_unknowns(decay: ModeDecay, law_names: Sequence[str]) -> list[Unknown]:
    """Return the unknowns of a release and its record, with the values of the separate fit."""
    pairs = zip(decay.unknown_names, decay.separate_fit.fit.unknowns, strict=True)
    return [
        replace(unknown, name=name, guess=decay.separate_fit.fit[unknown.name])
        for name, unknown in pairs
        if unknown.name not in law_names
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeCurveBlock(ResponseBlock):
    """Measured response curves of one mode; the names of the unknowns begin with those of the laws."""

    model: DecayModel  # laws of the mode, without an equilibrium
    law_names: tuple[str, ...]
    constants: tuple[str, ...]  # name of the modal constant of each record
    given_constants: Mapping[str, float]  # given modal constants by name

    systematic = 10 * POINTS_CLOSE  # error of the closest points: without noise, it ends the fit

    @cached_property
    def curves(self) -> list[cs.Function]:
        """The curve of each record; other weights share them."""
        if self.before:
            return list(self.before.curves)
        return [response_curve(self.model, record, len(self.law_names)) for record in self.records]

    @cached_property
    def last_derivatives(self) -> list[Array]:
        """Derivatives of the last motions of each record by the unknowns, (m, 3, k)."""
        return []

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        all_values = {**self.given_constants, **values}
        results = [
            closest_motions(curve, record, points, np.array([all_values[name] for name in (*self.law_names, constant)]))
            for curve, record, points, constant in zip(
                self.curves, self.records, self.measured(values), self.constants, strict=True
            )
        ]
        self.last_derivatives[:] = [derivatives for _, derivatives in results]
        return [motions for motions, _ in results]

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        sensitivities, names = [], self.names
        for derivatives, constant in zip(self.last_derivatives, self.constants, strict=True):
            sensitivity = np.zeros((*derivatives.shape[:2], len(names)))
            for k, name in enumerate((*self.law_names, constant)):
                if name in names:
                    sensitivity[:, :, names.index(name)] = derivatives[:, :, k]
            sensitivities.append(sensitivity)
        return sensitivities


def mode_curve_block(
    model: DecayModel,
    records: Sequence[ResponseRecord],
    law_names: Sequence[str],
    constant_names: Mapping[str, str],
    modal_constant: float | None,
) -> ModeCurveBlock:
    """Return response curves as a block with first weights; ``constant_names`` has one name per unit of levels."""
    constants = tuple(constant_names[record.excitation_unit] for record in records)
    estimated_constants = tuple(dict.fromkeys(constants)) if modal_constant is None else ()
    weights = first_weights(records)
    return ModeCurveBlock(
        tuple(enumerate(records, start=1)),
        (*law_names, *estimated_constants),
        weights=replace(weights, floors=np.full(len(weights.lengths), LEAST_FACTOR)),
        model=model,
        law_names=tuple(law_names),
        constants=constants,
        given_constants={} if modal_constant is None else dict.fromkeys(constants, modal_constant),
    )


def constant_unit(motion_unit: str, excitation_unit: str) -> str:
    """Return the unit of a modal constant: force per mass and level; none for a motion of the base in m."""
    if excitation_unit in BASE_MOTIONS:
        return "" if motion_unit == "m" else f"{motion_unit or '1'}/m"
    if excitation_unit == "N" and motion_unit == "m":
        return "1/kg"
    return f"{motion_unit or '1'}/(s^2 {excitation_unit})"
