"""Solution of decay fits: starting values, one least-squares problem for all records, robust rounds, integration.

The fit starts from the first guess or from the track of amplitude and phase (``start``), whichever leaves the smaller
residuals, and if it does not converge, from the other one.  With several records, the one with the largest amplitude
gives the starting values of the mode.

A long record with even times is reduced to the band of the mode by a projection on its slowest cosines
(``ancf_casadi.records.processing``), which keeps estimates and standard errors.  The curve of a first fit is subtracted
before the projection, because the slope of the decay at the release would leave an error there.  Outliers would spread,
so that a robust fit takes all samples.

A robust fit replaces the squares by the pseudo-Huber loss (``ancf_casadi.estimation.solver.loss``).  The residuals of
the previous fit give the noise that sets its threshold.

References
----------
P. J. Huber, Robust Statistics, Wiley (1981), Section 7.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.decay.first_guess import DecayGuess, first_guess
from ancf_casadi.decay.one_mode import longest_step
from ancf_casadi.decay.spectrum import is_even
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.loss import HUBER, noise_of
from ancf_casadi.estimation.solver.unknown import Unknown, started
from ancf_casadi.exceptions import FitError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import projected
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from problems.decay.laws import DECAY_LAWS, DecayModel, FrequencyLaw, Law
from problems.decay.limitations import NOISE_FREE
from problems.decay.result import DecayFit
from problems.decay.start import of_motion, starting_values

RATIO_BOUNDS = (0.0, 0.999)
INTEGRATION_ERROR = 0.5  # standard errors, if all samples had the same error; estimates shift by a tenth of this
MOST_INTEGRATIONS = 3  # most fits of an integrated law, until its step settles
STEP_RATIO = 0.7  # ratio of the required step to the last one, below which the fit is repeated
LEAST_REDUCED_LENGTH = 2500  # samples to which a longer record is reduced, if the band of the mode needs no more
REDUCED_PER_PERIOD = 12  # samples that this band needs
DECAY_ADVICE = "check the time of the release, or fit a law with fewer terms"


def fit_from(
    guesses: Sequence[DecayGuess],
    records: Sequence[Measurement],
    *,
    law: Law,
    frequency_law: FrequencyLaw = "constant",
    offset: bool,
    drift: bool,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    robust: bool = False,
) -> tuple[DecayFit, ...]:
    """Fit several free decays of one mode at once, each from its guess; see ``fit_decays``.

    Raises
    ------
    FitError
        If the fit does not converge.
    """
    sensor = records[0].sensor
    times = [record.time[guess.release :] for record, guess in zip(records, guesses, strict=True)]
    decays = [_decay(record, guess.release) for record, guess in zip(records, guesses, strict=True)]
    guesses = [of_motion(guess, sensor.derivatives) for guess in guesses]
    largest = max(guess.amplitude for guess in guesses)
    model = DecayModel(law, offset, drift, frequency_law, reference=largest, sensor=sensor)
    lengths = [len(decay.time) for decay in decays]
    counts = lengths if robust else _counts(decays, [guess.ω for guess in guesses])
    thinned = [_thinned(decay, count, np.zeros_like) for decay, count in zip(decays, counts, strict=True)]
    if DECAY_LAWS[law].integrated:
        model, fit, columns = _integrate(model, thinned, guesses, ratio_bounds, robust)
    else:
        fit, columns = _match(model, thinned, guesses, ratio_bounds, robust)
    if counts != lengths:  # again, less the curve, which has slopes at the ends
        curves = [_curve(model, fit, own) for own in columns]
        thinned = [_thinned(*one) for one in zip(decays, counts, curves, strict=True)]
        fit, columns = _match(model, thinned, guesses, ratio_bounds, robust, fit.estimates)
    parts = [slice(*ends) for ends in pairwise(np.cumsum([0, *counts]).tolist())]
    residuals = [fit.residuals[rows] for rows in parts]
    if counts != lengths:
        residuals = [
            _curve(model, fit, own)(decay.time) - decay.values for own, decay in zip(columns, decays, strict=True)
        ]
    settings: dict[str, Any] = {
        "law": law,
        "frequency_law": frequency_law,
        "offset": offset,
        "drift": drift,
        "ratio_bounds": ratio_bounds,
        "robust": robust,
    }
    return tuple(
        DecayFit(
            fit,
            model,
            own,
            rows,
            time,
            rest,
            ratio_bounds,
            guess.reason,
            guess.notes,
            again=partial(fit_one, release_time=float(time[0]) if guess.reason == "given" else None, **settings),
        )
        for time, rest, own, rows, guess in zip(times, residuals, columns, parts, guesses, strict=True)
    )


def fit_one(record: Measurement, *, release_time: float | None = None, **settings: Any) -> DecayFit:
    """Fit one free decay; see ``fit_decays``.

    Raises
    ------
    InputError
        If the record is not usable, or nothing in it oscillates.
    FitError
        If the fit does not converge.
    """
    check_instance(record, "records", Measurement)
    guess = first_guess(record, release_time=release_time, offset=settings["offset"], drift=settings["drift"])
    return fit_from([guess], [record], **settings)[0]


def _decay(record: Measurement, release: int) -> Measurement:
    """Return the record from its sample ``release`` on, with times after this sample."""
    time = record.time[release:]
    return Measurement(time - time[0], record.values[release:], record.name, record.sensor)


def _counts(decays: Sequence[Measurement], ω: Sequence[float]) -> list[int]:
    """Return the number of samples that a fit needs of each decay: all, if one of them is short or unevenly sampled.

    The samples of all decays become fewer by the same ratio, because a fit takes their noise as equal.
    """
    needed = [
        max(LEAST_REDUCED_LENGTH, REDUCED_PER_PERIOD * one * decay.time[-1] / (2 * math.pi))
        for one, decay in zip(ω, decays, strict=True)
    ]
    lengths = [len(decay.time) for decay in decays]
    ratio = max(count / length for count, length in zip(needed, lengths, strict=True))
    if 2 * ratio >= 1.0 or not all(is_even(decay.time) for decay in decays):
        return lengths
    return [math.ceil(ratio * length) for length in lengths]


def _thinned(decay: Measurement, count: int, curve: Callable[[Array], Array]) -> Measurement:
    """Return a decay with fewer samples: those of a curve of the time, plus the projected rest."""
    m = len(decay.time)
    if count == m:
        return decay
    time = (m / count * (np.arange(count) + 0.5) - 0.5) * decay.time[-1] / (m - 1)
    return Measurement(time, curve(time) + projected(decay.values - curve(decay.time), count), sensor=decay.sensor)


def _curve(model: DecayModel, fit: Fit, own: Sequence[int]) -> Callable[[Array], Array]:
    """Return the fitted curve of a record, whose unknowns have the positions ``own``, as a function of the time."""
    return lambda time: np.asarray(cs.evalf(model.curve(time, *(cs.MX(fit.values[k]) for k in own)))).ravel()


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least-squares problem of several records.

    Parameters
    ----------
    unknowns : list of Unknown
        Unknowns of the mode, then those of each record, with the first guesses.
    columns : list of tuple of int
        Positions of the unknowns of each record.
    times : list of ndarray
        Times of each record after the release, s.
    measured : list of ndarray
        Measured values at these times, in the unit of the sensor.
    curves : Function
        Unknowns -> fitted values of all records.
    """

    unknowns: list[Unknown]
    columns: list[tuple[int, ...]]
    times: list[Array]
    measured: list[Array]
    curves: cs.Function

    def residuals(self, *x: cs.MX) -> cs.MX:
        """Return the residuals of all records."""
        return self.curves(cs.vertcat(*x)) - cs.DM(np.concatenate(self.measured))


def _problem(
    model: DecayModel, decays: Sequence[Measurement], guesses: Sequence[DecayGuess], ratio_bounds: tuple[float, float]
) -> _Problem:
    """Return the problem; its curves are built once, and inserted wherever they are needed."""
    unknowns = model.shared(max(guesses, key=lambda guess: guess.amplitude), ratio_bounds)
    shared, columns = tuple(range(len(unknowns))), []
    for position, guess in enumerate(guesses, start=1):
        own, suffix = model.own(guess), f"_{position}" if len(decays) > 1 else ""
        columns.append((*shared, *range(len(unknowns), len(unknowns) + len(own))))
        unknowns += [replace(u, name=u.name + suffix) for u in own]
    times, measured = [decay.time for decay in decays], [decay.values for decay in decays]
    x = cs.MX.sym("x", len(unknowns))
    curves = [model.curve(t, *(x[i] for i in own)) for t, own in zip(times, columns, strict=True)]
    function = cs.Function("curves", [x], [cs.vertcat(*curves)], {"always_inline": True})
    return _Problem(unknowns, columns, times, measured, function)


def _match(
    model: DecayModel,
    decays: Sequence[Measurement],
    guesses: Sequence[DecayGuess],
    ratio_bounds: tuple[float, float],
    robust: bool,
    start: Mapping[str, float] | None = None,
) -> tuple[Fit, list[tuple[int, ...]]]:
    """Return the fit, and the positions of the unknowns of each record.

    Unknowns named in ``start`` begin at the values given there, the others at the guesses.  If it is not given, the
    fit starts from the guesses or from the track of amplitude and phase.
    """
    problem = _problem(model, decays, guesses, ratio_bounds)
    if start is None:
        starts = _ordered(problem, started(problem.unknowns, _tracked(model, problem, guesses)))
    else:
        starts = [started(problem.unknowns, start)]
    settings: dict[str, Any] = {
        "gauss_newton": DECAY_LAWS[model.law].integrated,
        "series": [len(t) for t in problem.times],
        "times": np.concatenate(problem.times),
        "advice": DECAY_ADVICE,
    }
    fit = _first_fit(problem, starts, settings)
    for _ in range(3 * robust):  # robust fits, in which the estimate of the noise settles
        noise = noise_of(fit.residuals)
        if noise <= NOISE_FREE * max(guess.amplitude * guess.ω**model.sensor.derivatives for guess in guesses):
            break
        fit = least_squares(problem.residuals, started(fit.unknowns, fit.estimates), huber=HUBER * noise, **settings)
    return fit, problem.columns


def _tracked(model: DecayModel, problem: _Problem, guesses: Sequence[DecayGuess]) -> dict[str, float]:
    """Return starting values by name from the track of each record; the largest record gives those of the mode."""
    names = [u.name for u in problem.unknowns]
    largest = max(range(len(guesses)), key=lambda k: guesses[k].amplitude)
    values: dict[str, float] = {}
    for k, guess in enumerate(guesses):
        found = starting_values(model, problem.times[k], problem.measured[k], guess)
        suffix = f"_{k + 1}" if len(guesses) > 1 else ""
        values |= {name + suffix: value for name, value in found.items()}
        if k == largest:
            values |= found
    return {name: values[name] for name in names if name in values}


def _ordered(problem: _Problem, other: list[Unknown]) -> list[list[Unknown]]:
    """Return the unknowns of a problem and others, those first that leave smaller residuals."""
    y = np.concatenate(problem.measured)
    return sorted(
        [problem.unknowns, other],
        key=lambda start: float(np.sum((problem.curves([u.guess for u in start]).full().ravel() - y) ** 2)),
    )


def _first_fit(problem: _Problem, starts: Sequence[list[Unknown]], settings: Mapping[str, Any]) -> Fit:
    """Return the fit from the first start that leads to one; if none does, raise its first error."""
    errors: list[FitError] = []
    for start in starts:
        try:
            return least_squares(problem.residuals, start, **settings)
        except FitError as error:
            errors.append(error)
    raise errors[0]


def _integrate(
    model: DecayModel,
    decays: Sequence[Measurement],
    guesses: Sequence[DecayGuess],
    ratio_bounds: tuple[float, float],
    robust: bool,
) -> tuple[DecayModel, Fit, list[tuple[int, ...]]]:
    """Return the model with its step, the fit, and the positions of the unknowns of each record.

    The fit of the closed form, Eq. (27), gives the starting values and the accuracy that the integration needs.  If the
    residuals of the integrated law are smaller, they may need a shorter step; the fit is then repeated from its result.
    """
    closed = replace(model, law="quadratic")
    fit, columns = _match(closed, decays, guesses, ratio_bounds, robust)
    found = [closed.values(fit.values[list(own)]) for own in columns]
    guesses = [
        replace(
            guess,
            ω=2 * math.pi * values["frequency"],
            amplitude=values["amplitude"],
            phase=next(fit.values[k] for k in own if fit.names[k].startswith("phase")),
        )
        for guess, own, values in zip(guesses, columns, found, strict=True)
    ]
    frequency, ζ, amplitude = (
        max(values[name] for values in found) for name in ("frequency", "damping_ratio", "amplitude")
    )
    for _ in range(MOST_INTEGRATIONS):
        allowed = INTEGRATION_ERROR * fit.residual_rms / (amplitude * math.sqrt(len(fit.residuals)))
        step = longest_step(2 * math.pi * frequency, ζ, allowed)
        if step > STEP_RATIO * model.longest_step:
            break
        model = replace(model, longest_step=step)
        fit, columns = _match(model, decays, guesses, ratio_bounds, robust, fit.estimates)
    return model, fit, columns
