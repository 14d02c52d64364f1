"""Free decays as a block of a fit, and the prior of smooth laws as another.

Each decay has its own amplitude, phase and equilibrium at the release, and shares the laws of the mode with the others;
or it is the sum of several modes.  The decays of one kind of sensor share the standard deviation of their noise.

A long record with even times is reduced to the band of its modes by a projection on its slowest cosines
(``ancf_casadi.records.processing``), which keeps estimates and standard errors.  The curve of a first fit is subtracted
before the projection, because the slope of the decay at the release would leave an error there.  Outliers would spread,
so that a robust fit takes all samples.

After the fit, its covariance allows for what residuals need not show: the rounding of the record to the resolution of
its sensor, and differences between the estimates from late parts of a record and from the rest (``agreement``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import pairwise
from operator import add
from typing import Self

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.quantisation import rounding_errors
from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.decay.smooth import SmoothTerms, smooth_steps
from ancf_casadi.decay.spectrum import has_even_steps, oscillating_power
from ancf_casadi.estimation.agreement import allowing_for_errors, allowing_for_later_starts
from ancf_casadi.estimation.block import Account, Block, Fitted, SeriesWeights, alike
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import project_on_cosines, resolution
from ancf_casadi.support.arrays import Array, Mask, root_mean_square
from problems.decay.laws import DecayModel

MIN_REDUCED_LENGTH = 2500  # samples to which a longer record is reduced, if the band of the mode needs no more
REDUCED_PER_PERIOD = 6  # samples that this band needs
LATER_STARTS = (0.25, 0.5, 0.75)  # shares of the information before a later start, for which errors allow
NOISE_FREE = 1e-6  # residual relative to the amplitude, below which there is no noise
DAMPING = ("zeta", "eta1", "eta2", "eta0")  # unknowns whose information divides the record, the first that is free


@dataclass(frozen=True)
class DecayMode:
    """A mode of a decay: its laws, and the names of its unknowns in the fit, in the order of the laws."""

    model: DecayModel
    names: tuple[str, ...]

    def curve(self, time: Array, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the motion at times (s) after the release, in the unit of the sensor, for unknowns by name."""
        return self.model.curve(time, *(unknowns[name] for name in self.names))

    def at(self, time: Array, values: Mapping[str, float]) -> Array:
        """Return the motion for values of the unknowns by name."""
        return np.asarray(cs.evalf(self.curve(time, {name: cs.MX(values[name]) for name in self.names}))).ravel()


@dataclass(frozen=True, eq=False)
class FreeDecay:
    """A free decay: a record from its release on, what a fit uses of it, and its modes."""

    time: Array  # times of the record from the release on, s
    record: Measurement  # all values from the release on, at the times since then
    fitted: Measurement  # those that a fit uses: all of them, or fewer in the band of the modes
    guess: DecayGuess  # of the motion, with the rest position in the unit of the sensor
    modes: tuple[DecayMode, ...] = ()
    notes: tuple[str, ...] = ()  # limitations of the record

    @classmethod
    def of(cls, record: Measurement, guess: DecayGuess) -> Self:
        """Return the decay of a record from the guess of its displacement, velocity or acceleration."""
        time = record.time[guess.release :]
        values = Measurement(time - time[0], record.values[guess.release :], record.name, record.sensor)
        derivatives = record.sensor.derivatives
        amplitude, phase = guess.amplitude / guess.ω**derivatives, guess.phase - derivatives * math.pi / 2
        return cls(time, values, values, replace(guess, amplitude=amplitude, phase=phase), notes=guess.notes)

    @property
    def reason(self) -> str:
        """Reason for the start of the decay."""
        return self.guess.reason

    @property
    def release_time(self) -> float:
        """Time of the release in the record, s."""
        return float(self.time[0])

    @property
    def reduced_share(self) -> float:
        """Number of fitted samples over that of all."""
        return len(self.fitted.time) / len(self.time)

    @property
    def rounding(self) -> float:
        """Systematic error that moves estimates as far as the white noise of rounding to floating-point numbers.

        Numbers with the spacing s have an error of s/12^1/2; residuals may be less, since curves are rounded alike.
        """
        return float(np.spacing(np.abs(self.fitted.values).max())) / math.sqrt(12 * len(self.fitted.time))

    @property
    def least_deviation(self) -> float:
        """Standard deviation of residuals up to which they are no noise."""
        swing = float(np.ptp(self.fitted.values)) / 2
        return math.hypot(NOISE_FREE * swing, self.rounding * math.sqrt(len(self.fitted.time)))

    def at(self, time: Array, values: Mapping[str, float]) -> Array:
        """Return the sum of the modes at times (s) after the release for values of the unknowns by name."""
        return np.asarray(np.sum([mode.at(time, values) for mode in self.modes], axis=0))

    def reduced(self, count: int, curve: Callable[[Array], Array] = np.zeros_like) -> Self:
        """Return the decay fitted as ``count`` samples: a curve, plus the projection of what it leaves."""
        m = len(self.time)
        if count == m:
            return replace(self, fitted=self.record)
        time = (m / count * (np.arange(count) + 0.5) - 0.5) * self.record.time[-1] / (m - 1)
        values = curve(time) + project_on_cosines(self.record.values - curve(self.record.time), count)
        return replace(self, fitted=Measurement(time, values, self.record.name, self.record.sensor))

    def rounding_errors(self, values: Mapping[str, float], residual_rms: float) -> Array:
        """Return the errors (m, 4) of rounding of the record to steps (``quantisation``), 0 if there are none."""
        (mode,), step = self.modes, resolution(self.record.values)
        if not step:
            return np.zeros((len(self.fitted.time), 4))
        motion_count = len(mode.names) - len(REST_TERMS[mode.model.rest])
        swing = DecayMode(replace(mode.model, rest="zero"), mode.names[:motion_count])
        x = (cs.MX(values[name]) for name in mode.names)
        amplitude = np.asarray(cs.evalf(mode.model.amplitude(self.fitted.time, *x))).ravel()
        sensor_amplitude = amplitude * values[mode.names[0]] ** mode.model.sensor.derivatives
        cosine = np.zeros_like(amplitude)
        np.divide(swing.at(self.fitted.time, values), sensor_amplitude, out=cosine, where=sensor_amplitude > 0.0)
        return rounding_errors(sensor_amplitude, cosine, step, residual_rms)


def sample_counts(decays: Sequence[FreeDecay]) -> list[int]:
    """Return the number of samples that a fit needs of each decay: all, if one of them is short or unevenly sampled.

    The samples of all decays become fewer by the same ratio, because a fit takes their noise as equal.
    """
    lengths = [len(decay.time) for decay in decays]
    ratio = max(
        max(MIN_REDUCED_LENGTH, REDUCED_PER_PERIOD * decay.guess.ω * decay.record.time[-1] / (2 * math.pi)) / length
        for decay, length in zip(decays, lengths, strict=True)
    )
    if 2 * ratio >= 1.0 or not all(has_even_steps(decay.record.time) for decay in decays):
        return lengths
    return [math.ceil(ratio * length) for length in lengths]


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
        kinds = list[tuple[str, float]]()  # the noise of fewer samples is smaller
        for decay in decays:
            kind = decay.record.sensor.quantity, decay.reduced_share
            kinds.append(
                next((k for k in kinds if k[0] == kind[0] and math.isclose(k[1], kind[1], rel_tol=1e-3)), kind)
            )
        groups = alike(kinds)
        floors = np.array([decay.least_deviation for decay in decays])
        lengths = np.array([len(decay.fitted.time) for decay in decays])
        weights = SeriesWeights(lengths, floors, floors, groups, known=(False,) * len(groups))
        return cls(tuple(decays), held_values or {}, weights=weights)

    def with_noise(self, residuals: Sequence[Array], *, robust: bool = False) -> Self:
        """Return the block with the standard deviations of residuals of each decay, in the unit of its sensor."""
        return replace(self, weights=self.weights.improved(residuals, robust=robust), before=self)

    def less_curve(self, values: Mapping[str, float]) -> Self:
        """Return the block with the bands of what its curves, for values of the unknowns by name, leave of records."""
        decays = (decay.reduced(len(decay.fitted.time), partial(decay.at, values=values)) for decay in self.decays)
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
                f"{label}: decay from {decay.release_time:g} s on ({decay.reason}), {samples} samples, residual "
                f"{residual_rms:.3g} {unit}".rstrip()
            )
            notes += [f"{label}: {note}" for note in decay.notes]
            data.append({"record": label, "samples": samples, "residual_rms": residual_rms, "unit": unit})
        return Account(lines, notes, {"kind": "decay", "records": data})

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return measured and computed decays."""
        residuals, errors = self.weights.split(fitted.residuals), self.weights.split(fitted.errors)
        columns = zip(self.labels, self.decays, residuals, errors, self.weights.deviations.tolist(), strict=True)
        return [
            PredictedChannel(
                label,
                decay.record.sensor.unit,
                decay.fitted.values,
                decay.fitted.values + residual,
                error,
                decay.fitted.time,
                TIME_AXIS,
                std,
            )
            for label, decay, residual, error, std in columns
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
        count, deviation, floor = (np.array([value]) for value in (len(terms.names), terms.first, terms.least))
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

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
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
