"""Amplitudes of a decay over time, without the oscillation: read off a screen, an envelope, or a lock-in amplifier.

The damping laws are those of a decay (``laws``): the amplitude A(t) has the same closed form.  Without the frequency,
which linear and quadratic damping do not need, the results are the rates of

    A' = -(c + a A + b A^2),

that is ``friction_rate`` c, ``linear_rate`` a and ``quadratic_rate`` b, and the ``decay_rate`` -A'/A at the first time.
With it, they are the damping ratio and coefficients of ``DecayFit``; the frequency counts as known.

Noise.  Each amplitude has the variance s^2 + (r A)^2, with the fitted A: additive noise s, as of an instrument, and
multiplicative noise r, as of readings on a logarithmic scale.  Both follow from the residuals
(``ancf_casadi.estimation.noise.proportional``); the additive one is taken as zero unless the criterion BIC of the
likelihood needs it, since a few amplitudes determine two badly.  The report states which was assumed.  Since the choice
is uncertain, the standard errors are at least those for variances of any kind (``ancf_casadi.estimation.agreement``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.estimation.agreement import allowing_for_unequal_variances
from ancf_casadi.estimation.block import Account, Block, Computed, Fitted
from ancf_casadi.estimation.fit import Fit, Quantities
from ancf_casadi.estimation.intervals import derived_intervals
from ancf_casadi.estimation.noise.proportional import proportional_variance
from ancf_casadi.estimation.prediction import TIME_AXIS, PredictedChannel, RecordPrediction
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.result import BlocksResult
from ancf_casadi.estimation.solve import solve
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, choice, physical
from problems.decay.laws import DECAY_QUANTITIES, DECAY_TERMS, DecayModel, Law

LEAST_AMPLITUDES = 6
MANY_PERIODS = 1e4  # periods in a record of unknown frequency, which matters only for the last period before a stop
FIRST_DEVIATION = 0.01  # relative, of the first fit
NEGLIGIBLE = 1e-9  # least standard deviation, relative to the first amplitude
AmplitudeLaw = Literal["linear", "quadratic", "friction", "power"]
AMPLITUDE_NAME = re.compile(r"amplitude|\bampl?\b|envelope|ring.?down|magnitude|h.llkurve", re.IGNORECASE)
INSPECTED_PARTS, MOST_RISE = 20, 0.2  # parts of a record, and share of the fall by which their means may rise in all


def is_amplitude_decay(name: str, values: Array) -> bool:
    """Return whether a column is named for amplitudes, and its values are positive and decay without oscillation."""
    if AMPLITUDE_NAME.search(name) is None or len(values) < LEAST_AMPLITUDES or not (values > 0.0).all():
        return False
    means = np.array([segment.mean() for segment in np.array_split(values, min(INSPECTED_PARTS, len(values)))])
    steps = np.diff(means)
    return bool(means[-1] < means[0] / 1.2 and steps[steps > 0.0].sum() < MOST_RISE * (means[0] - means[-1]))


@dataclass(frozen=True, eq=False)
class AmplitudeBlock(Block):
    """Amplitudes (m,) at times (m,), s, from the first one on, under a law with a known frequency."""

    record: Measurement
    model: DecayModel
    ω: float
    deviations: Array  # standard deviations (m,)
    noise: str = "multiplicative"

    closed_form = True
    settled = 0.01

    @property
    def lengths(self) -> list[list[int]]:
        """Number of amplitudes."""
        return [[len(self.record.time)]]

    @property
    def times(self) -> Array:
        """Times since the first amplitude, s."""
        return np.asarray(self.record.time - self.record.time[0])

    @property
    def negligible(self) -> float:
        """Norm of the rounding errors."""
        return math.sqrt(len(self.times)) * NEGLIGIBLE

    @property
    def factors(self) -> Array:
        """Reciprocal standard deviations (m,)."""
        return np.asarray(1 / self.deviations)

    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name, in standard deviations."""
        x = (cs.MX(self.ω), *unknowns.values(), cs.MX(0))
        return (self.model.amplitude(self.times, *x) - cs.DM(self.record.values)) / cs.DM(self.deviations)

    def amplitudes(self, residuals: Array) -> Array:
        """Return the fitted amplitudes (m,) for residuals in standard deviations."""
        return np.asarray(self.record.values + residuals * self.deviations)

    def reweight(self, residuals: Array, *, robust: bool) -> AmplitudeBlock | None:
        """Return the block with the variances that residuals (m,) show; None if they would not change."""
        squares, power = (residuals * self.deviations) ** 2, self.amplitudes(residuals) ** 2
        least_variance = (NEGLIGIBLE * self.record.values[0]) ** 2
        variances = {
            "multiplicative": power * np.mean(squares / power),
            "of both kinds": proportional_variance(squares, power),
        }
        variances = {kind: np.maximum(variance, least_variance) for kind, variance in variances.items()}
        criteria = {kind: float(np.sum(np.log(v) + squares / v)) for kind, v in variances.items()}
        criteria["of both kinds"] += math.log(len(squares))
        noise = min(criteria, key=criteria.__getitem__)
        better = replace(self, deviations=np.sqrt(variances[noise]), noise=noise, before=self)
        return None if self.has_similar_weights(better, self.settled) else better

    def allowing(self, fitted: Fitted) -> Fit:
        """Return the fit with a covariance that allows for noise of another kind than the assumed one."""
        return allowing_for_unequal_variances(fitted.fit)

    def account(self, fitted: Fitted) -> Account:
        """Return the noise at the first and at the last amplitude."""
        shares = self.deviations[[0, -1]] / self.amplitudes(fitted.residuals)[[0, -1]]
        first, last = (f"{100 * share:.2g} %" for share in shares)
        line = f"noise of the amplitudes: {first} of the first, {last} of the last, {self.noise}"
        return Account((line,), data={"noise": self.noise, "deviations": self.deviations[[0, -1]].tolist()})

    def channels(self, fitted: Fitted | Computed) -> Sequence[PredictedChannel]:
        """Return measured and fitted amplitudes."""
        values, unit = self.amplitudes(fitted.residuals), self.record.sensor.unit
        errors = fitted.errors * self.deviations
        return [PredictedChannel("amplitude", unit, self.record.values, values, errors, self.record.time, TIME_AXIS,
                                 self.deviations)]  # fmt: skip


@dataclass(frozen=True, eq=False)
class AmplitudeFit(BlocksResult):
    """Damping identified from amplitudes over time.

    Parameters
    ----------
    solution : FitSolution
        The block of amplitudes with its weights.
    frequency : float or None
        Natural frequency, Hz, which was given; None if it is unknown.

    Examples
    --------
    >>> from problems import fit_decay
    >>> seconds = [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    >>> amplitudes = [0.0300, 0.0221, 0.0174, 0.0139, 0.0116, 0.0096, 0.0082]
    >>> fit = fit_decay(seconds, amplitudes, quantity="amplitude", law="quadratic", frequency=1.9)
    >>> print(f"eta2 = {fit.estimates['eta2']:.2f} +- {fit.standard_errors['eta2']:.2f} 1/m")
    eta2 = 0.79 +- 0.04 1/m
    """

    kind = "amplitudes of a decay"
    _drawing = "ancf_casadi.figures.fits.channels_figure"

    frequency: float | None = None

    @property
    def block(self) -> AmplitudeBlock:
        """The fitted amplitudes."""
        (block,) = self.solution.problem.blocks
        assert isinstance(block, AmplitudeBlock)
        return block

    @property
    def title(self) -> str:
        """The law."""
        frequency = "unknown frequency" if self.frequency is None else f"{self.frequency:g} Hz"
        return f"{self.block.model.law} decay of {len(self.block.times)} amplitudes, {frequency}"

    @property
    def law(self) -> Law:
        """Fitted damping law."""
        return self.block.model.law

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        model, ω, unit = self.block.model, self.block.ω, self.block.model.unit("amplitude")
        if self.frequency is not None:
            skipped = ("frequency", "offset", "drift", "creep")
            chosen = {name: (name, model.unit(name), 1.0) for name in DECAY_QUANTITIES if name not in skipped}
        else:
            rates = {
                "damping_ratio": ("decay_rate", "1/s", ω),
                "eta1": ("linear_rate", "1/s", 0.5),
                "eta2": ("quadratic_rate", f"1/({unit or '1'} s)", 4 * ω / (3 * math.pi)),
                "eta0": ("friction_rate", f"{unit or '1'}/s", 2 / (math.pi * ω)),
                "exponent": ("exponent", "", 1.0),
                "amplitude": ("amplitude", unit, 1.0),
            }
            terms = ("damping_ratio", *DECAY_TERMS[self.law], "amplitude")
            chosen = {name: rates[name] for name in terms if name in rates}
        positions = [list(DECAY_QUANTITIES).index(name) for name in chosen]
        names, units, factors = zip(*chosen.values(), strict=True)

        def quantities(*x: cs.MX) -> cs.MX:
            return cs.DM(factors) * model.quantities(cs.MX(ω), *x, cs.MX(0))[positions]

        return names, units, quantities

    def _ends(self, level: float) -> Array:
        """Return the intervals (q, 2) of all quantities, of which those of the damping are not negative."""
        ends = derived_intervals(self.fit, self.quantities[2], level)
        return ends if self.law == "linear" else np.maximum(ends, 0.0)

    def predict(self, record: Measurement) -> RecordPrediction:
        """Compute the amplitudes at the times of another record of the same decay, and compare."""
        block = replace(self.block, record=_check(record), deviations=FIRST_DEVIATION * record.values, before=None)
        return block.predict_record(self.fit, self.kind)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        return {**super().to_dict(), "law": self.law, "frequency_hz": self.frequency}


def fit_amplitudes(record: Measurement, law: str, frequency: float | None, *, robust: bool = False) -> AmplitudeFit:
    """Fit amplitudes over time; see ``fit_decay``."""
    choice(law, get_args(AmplitudeLaw), "law")
    record = _check(record)
    time, values = record.time - record.time[0], record.values
    slope, level = np.polyfit(time, np.log(values), 1, w=values)
    length, rate, first = float(time[-1]), max(-float(slope), 1e-6 / float(time[-1])), math.exp(level)
    ω = 2 * math.pi * (MANY_PERIODS / length if frequency is None else physical(frequency, "frequency"))
    guess = DecayGuess(0, "given", min(length, 1 / rate), length, ω, rate / ω, first, 0.0, ())
    ends = (-0.999, 0.999) if law == "linear" else (0.0, 0.999)
    model = DecayModel(law, "zero", ratio_bounds=ends, reference=first, sensor=record.sensor)  # type: ignore[arg-type]
    unknowns = (*model.mode_unknowns(guess)[1:], model.release_unknowns(guess)[0])
    block = AmplitudeBlock(record, model, ω, FIRST_DEVIATION * values)
    advice = "leave out amplitudes at the level of the noise, or fit a law with fewer terms"
    problem = FitProblem((block,), unknowns, robust, most_unexplained=1.0, advice=advice)
    solution = solve(problem, compare=False)
    refit = partial(fit_amplitudes, law=law, frequency=frequency, robust=robust)
    return AmplitudeFit(solution.fit, solution, frequency, again=refit)


def _check(record: Measurement) -> Measurement:
    """Return a record of amplitudes, which are enough and positive."""
    check_instance(record, "record", Measurement)
    if len(record.time) < LEAST_AMPLITUDES:
        raise InputError(f"has {len(record.time)} amplitudes; a fit needs at least {LEAST_AMPLITUDES}", "record")
    if not (record.values > 0.0).all():
        first = int(np.argmin(record.values > 0.0))
        raise InputError(
            f"has the value {record.values[first]:g} at {record.time[first]:g} s; amplitudes are positive; fit the "
            "oscillation itself without quantity='amplitude'",
            "record",
        )
    return record
