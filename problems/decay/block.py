"""Free decays as a block of a fit, and the prior of smooth laws as another.

Each decay has its own amplitude, phase and equilibrium at the release, and shares the laws of the mode with the others;
or it is the sum of several modes.  The decays of one kind of sensor share the standard deviation of their noise.

After the fit, its covariance allows for what residuals need not show: the rounding of the record to the resolution of
its sensor, and differences between the estimates from late parts of a record and from the rest (``agreement``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from itertools import pairwise
from operator import add
from typing import Self

import casadi as cs
import numpy as np

from ancf_casadi.decay.smooth import SmoothTerms, smooth_steps
from ancf_casadi.decay.spectrum import oscillating_power
from ancf_casadi.estimation.agreement import allowing_for_errors, allowing_for_later_starts
from ancf_casadi.estimation.block import Account, Block, Computed, Fitted, SeriesWeights, alike
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel
from ancf_casadi.support.arrays import Array, Mask, root_mean_square
from problems.decay.free_decay import FreeDecay

LATER_STARTS = (0.25, 0.5, 0.75)  # shares of the information before a later start, for which errors allow
DAMPING = ("zeta", "eta1", "eta2", "eta0")  # unknowns whose information divides the record, the first that is free


@dataclass(frozen=True, eq=False)
class DecayBlock(Block):
    """Free decays, with values of the unknowns that a fit holds."""

    decays: tuple[FreeDecay, ...]
    held_values: Mapping[str, float] = field(default_factory=dict)
    weights: SeriesWeights = field(kw_only=True)

    closed_form = True
    settled = 0.01  # (test_a_prior_one_standard_error_away_moves_the_estimates_as_one_more_measurement_would)

    @classmethod
    def of(cls, decays: Sequence[FreeDecay], held_values: Mapping[str, float] | None = None) -> Self:
        """Return decays as a block with the least standard deviations."""
        groups = alike((decay.record.sensor.quantity, decay.share) for decay in decays)  # fewer samples have less noise
        floors = np.array([decay.least_deviation for decay in decays])
        lengths = np.array([len(decay.fitted.time) for decay in decays])
        weights = SeriesWeights(lengths, floors, floors, groups, known=(False,) * len(groups))
        return cls(tuple(decays), held_values or {}, weights=weights)

    def with_noise(self, residuals: Sequence[Array], *, robust: bool = False) -> Self:
        """Return the block with the standard deviations of residuals of each decay, in the unit of its sensor."""
        return replace(self, weights=self.weights.improved(residuals, robust=robust), before=self)

    def less_curve(self, values: Mapping[str, float]) -> Self:
        """Return the block with the bands of what its curves, for values of the unknowns by name, leave of records."""
        decays = (decay.reduced(decay.share, values) for decay in self.decays)
        return replace(self, decays=tuple(decays), before=None)

    @property
    def lengths(self) -> list[list[int]]:
        """Number of samples of each decay."""
        return [[len(decay.fitted.time)] for decay in self.decays]

    @property
    def times(self) -> Array:
        """Times of the samples after the release, s."""
        return np.concatenate([decay.fitted.time for decay in self.decays])

    @property
    def negligible(self) -> float:
        """Norm of the rounding errors."""
        return math.sqrt(sum(self.series)) * self.weights.root_mean_square(self.weights.floors)

    @property
    def systematic(self) -> float:
        """Root mean square of the rounding of the records to floating-point numbers, in standard deviations."""
        errors = np.array([decay.rounding for decay in self.decays])
        return self.weights.root_mean_square(errors) / math.sqrt(len(errors))

    @cached_property
    def _misfits(self) -> cs.Function:
        """Function from the unknowns by name to the residuals (m,) in the units of the sensors, for all weights."""
        if self.before:
            misfits: cs.Function = self.before._misfits
            return misfits
        names = list(dict.fromkeys(name for decay in self.decays for mode in decay.modes for name in mode.names))
        unknowns = {name: cs.MX.sym(name) for name in names}
        curves = [
            reduce(add, (mode.curve(decay.fitted.time, unknowns) for mode in decay.modes)) for decay in self.decays
        ]
        measured = cs.DM(np.concatenate([decay.fitted.values for decay in self.decays]))
        inputs, residuals = list(unknowns.values()), cs.vertcat(*curves) - measured
        return cs.Function("misfits", inputs, [residuals], names, ["residuals"])

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name, in standard deviations."""
        names = self._misfits.name_in()
        inputs = [unknowns[name] if name in unknowns else cs.MX(self.held_values[name]) for name in names]
        return self._misfits.call(inputs, True, False)[0] * cs.DM(self.factors)  # inlined

    def misfits(self, values: Mapping[str, float]) -> list[Array]:
        """Return the residuals of each decay, in the unit of its sensor, for values of the unknowns by name."""
        residuals = self._misfits(*(values[name] for name in self._misfits.name_in())).full().ravel()
        return np.split(residuals, np.cumsum(self.series)[:-1])

    def rows(self, fitted: Fitted) -> list[slice]:
        """Return the residuals of each decay among all of a fit."""
        return [slice(*ends) for ends in pairwise((fitted.rows.start + np.cumsum([0, *self.series])).tolist())]

    def allowing(self, fitted: Fitted) -> Fit:
        """Return the fit with a covariance that allows for rounding and for the scatter between later starts.

        Neither is known of a decay of several modes.
        """
        if any(len(decay.modes) > 1 for decay in self.decays):
            return fitted.fit
        fit, series = fitted.fit, self.rows(fitted)
        errors = np.zeros((len(fit.residuals), 4 * len(series)))
        noise_free = fitted.scale * self.negligible / math.sqrt(len(fit.residuals))
        deviations = zip(self.decays, self.weights.deviations.tolist(), series, strict=True)
        for k, (decay, std, rows) in enumerate(deviations):
            unit = fitted.scale / std  # of the residuals of a fit, per that of the sensor
            rms = root_mean_square(fit.residuals[rows]) / unit
            errors[rows, 4 * k : 4 * k + 4] = unit * decay.rounding_errors({**self.held_values, **fitted.values}, rms)
        fit = allowing_for_errors(fit, errors) if errors.any() else fit
        if not fit.residual_rms > noise_free:
            return fit
        return allowing_for_later_starts(fit, [late_residuals(fit, series, share) for share in LATER_STARTS])

    @property
    def labels(self) -> list[str]:
        """Name of each decay."""
        return [decay.record.name or f"decay {number}" for number, decay in enumerate(self.decays, start=1)]

    def unexplained_shares(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return the unexplained share of each oscillation, root mean square; white noise does not count."""
        shares = []
        for label, decay, residuals in zip(self.labels, self.decays, self.weights.split(fitted.residuals), strict=True):
            motion = float(np.var(decay.fitted.values + residuals))
            power = oscillating_power(decay.fitted.time, residuals, decay.guess.ω / (4 * math.pi))
            shares.append((label, math.sqrt(power / (motion + power))))
        return shares

    def account(self, fitted: Fitted) -> Account:
        """Return size and residual of each decay, and the limitations of its record."""
        lines, notes, data = [], [], []
        for label, decay, residuals in zip(self.labels, self.decays, self.weights.split(fitted.residuals), strict=True):
            unit, samples, residual_rms = decay.record.sensor.unit, len(residuals), root_mean_square(residuals)
            lines.append(
                f"{label}: decay from {decay.release_time:g} s on ({decay.guess.reason}), {samples} samples, residual "
                f"{residual_rms:.3g} {unit}".rstrip()
            )
            notes += [f"{label}: {note}" for note in decay.notes]
            data.append({"record": label, "samples": samples, "residual_rms": residual_rms, "unit": unit})
        return Account(lines, notes, {"kind": "decay", "records": data})

    def channels(self, fitted: Fitted | Computed) -> list[PredictedChannel]:
        """Return measured and computed decays."""
        residuals, errors = self.weights.split(fitted.residuals), self.weights.split(fitted.errors)
        records, deviations = [decay.fitted for decay in self.decays], self.weights.deviations.tolist()
        return [
            PredictedChannel(label, y.sensor.unit, y.values, y.values + residual, error, y.time, TIME_AXIS, std)
            for label, y, residual, error, std in zip(self.labels, records, residuals, errors, deviations, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class SmoothnessBlock(Block):
    """Prior of a smooth law: its changes from one amplitude to the next are normal, and as large as they show.

    Without it, the law follows the noise that hides the end of a record, and swings between the amplitudes of curves.
    """

    terms: SmoothTerms
    weights: SeriesWeights = field(kw_only=True)

    stated = True  # no noise of a record
    prior = True
    closed_form = True
    negligible = 0.0
    settled = 0.1  # (test_a_smooth_frequency_does_not_swing_between_the_levels)

    @classmethod
    def of(cls, terms: SmoothTerms) -> Self:
        """Return the prior of a smooth law with its first standard deviation."""
        count, deviation, floor = (
            np.array([value]) for value in (len(terms.names), terms.first_deviation, terms.least_deviation)
        )
        return cls(terms, weights=SeriesWeights(count, deviation, floor, groups=((0,),), known=(False,)))

    @property
    def lengths(self) -> list[list[int]]:
        """One value per change."""
        return [[1] * len(self.terms.names)]

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the changes (m,) for unknowns by name, in standard deviations."""
        changes: cs.MX = smooth_steps([unknowns[name] for name in self.terms.names])
        return changes / float(self.weights.deviations[0])

    def reweight(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the root mean square of the changes, also in a robust fit."""
        return super().reweight(residuals, robust=False)

    def allowing(self, fitted: Fitted) -> Fit:
        """Return a fit that says nothing of stated standard deviations, unless an unknown has a prior that states one.

        That of the changes follows from them.
        """
        fit = fitted.fit
        if any(unknown.prior for unknown in fit.unknowns):
            return fit
        return replace(fit, noise=replace(fit.noise, p_value=math.nan))

    def account(self, fitted: Fitted) -> Account:
        """Return an empty account: all smooth laws have this prior, and results do not mention it."""
        return Account()

    def channels(self, fitted: Fitted | Computed) -> list[PredictedChannel]:
        """Return no channels: nothing was measured."""
        return []


def late_residuals(fit: Fit, decays: Sequence[slice], share: float) -> Mask:
    """Return a mask of the residuals of each record after a share of its information on the damping."""
    mask = np.zeros(len(fit.residuals), dtype=bool)
    damping_unknowns = (k for prefix in DAMPING for k, name in enumerate(fit.names) if name.startswith(prefix))
    column = next((k for k in damping_unknowns if not fit.active_bounds[k]), 0)
    for rows in decays:
        information = np.cumsum(fit.jacobian[rows, column] ** 2)
        mask[rows] = information >= share * information[-1]
    return mask
