"""Solution of decay fits: starting values, one least-squares problem for all records or modes, robust rounds.

The fit starts from the first guess or from the track of amplitude and phase (``starting_values``), whichever has the
smaller residuals, and if it does not converge, from the other one.  With several records, the one with the largest
amplitude gives the starting values of the mode.

A long record with even times is reduced to the band of the mode by a projection on its slowest cosines
(``ancf_casadi.records.processing``), which keeps estimates and standard errors.  The curve of a first fit is subtracted
before the projection, because the slope of the decay at the release would leave an error there.  Outliers would spread,
so that a robust fit takes all samples.

A robust fit replaces the squares by the pseudo-Huber loss (``estimation.solver.gauss_newton``).  The residuals of
the previous fit give the noise that sets its threshold.  They also give the weight of priors, whose distances in
standard deviations, times that of the noise, are further residuals; a first fit gives them next to no weight.

References
----------
P. J. Huber, Robust Statistics, Wiley (1981), Section 7.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import DecayGuess, first_guess
from ancf_casadi.decay.outliers import without_outliers
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.quantisation import rounding_errors
from ancf_casadi.decay.rest_position import REST_TERMS
from ancf_casadi.decay.smooth import MIDDLE, SMOOTH_DAMPING, SMOOTH_FREQUENCY, smooth_nodes, smooth_steps
from ancf_casadi.decay.spectrum import has_even_steps
from ancf_casadi.estimation.agreement import DISAGREE, allowing_for_errors, allowing_for_later_starts
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solve import standardised_residuals
from ancf_casadi.estimation.solver.gauss_newton import HUBER, robust_deviation
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, with_guesses
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import project_on_cosines, resolution
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.inputs import check_instance
from problems.decay.laws import DecayModel, Law, with_priors
from problems.decay.limitations import DAMPING, GROWS, NOISE_FREE, late_residuals
from problems.decay.result import DecayFit
from problems.decay.starting_values import amplitude_span, guess_of_displacement, select_frequency_law, starting_values

MIN_REDUCED_LENGTH = 2500  # samples to which a longer record is reduced, if the band of the mode needs no more
REDUCED_PER_PERIOD = 6  # samples that this band needs
LATER_STARTS = (0.25, 0.5, 0.75)  # shares of the information before a later start, for which errors allow
MAX_ITERATIONS = 5  # of the prior of a smooth law
PRIOR_TOLERANCE = 0.1  # relative change of the standard deviations of this prior that ends the iterations
GROWING = (-0.999, 0.999)  # bounds of a damping ratio that may be negative
NO_PRIORS: Priors = {}
SIMPLER_LAWS: Sequence[FrequencyLaw] = ("constant", "linear", "quadratic", "logarithmic")  # than a smooth frequency
SIMPLER_LAW: Law = "friction"  # than a smooth damping ratio: it may rise and fall


def as_record(time: Measurement | ArrayLike, displacement: ArrayLike | None) -> Measurement:
    """Return a record, or times (s) and displacements (m) as a record, without outliers."""
    if isinstance(time, Measurement):
        if displacement is not None:
            raise InputError("is part of the record already; leave it out", "displacement")
        return without_outliers(time)
    if displacement is None:
        raise InputError("is missing; give it after the times, or give a Measurement", "displacement")
    return without_outliers(Measurement(time, displacement))


def fit_record(
    record: Measurement,
    model: DecayModel,
    *,
    release_time: float | None = None,
    robust: bool = False,
    priors: Priors = NO_PRIORS,
) -> DecayFit:
    """Fit one free decay; see ``fit_from``."""
    check_instance(record, "records", Measurement)
    guess = first_guess(record, release_time=release_time, rest=model.rest)
    return fit_records([guess], [record], model, robust, priors=priors)[0]


def fit_records(
    guesses: Sequence[DecayGuess],
    records: Sequence[Measurement],
    model: DecayModel,
    robust: bool = False,
    other_fit: DecayFit | None = None,
    priors: Priors = NO_PRIORS,
) -> tuple[DecayFit, ...]:
    """Fit several free decays of one mode at once, each from its guess; the model takes their sensor.

    ``other_fit``, the fit of one record by another law, replaces the first fit of a long record.
    """
    requested, sensor = model, records[0].sensor
    times = [record.time[guess.release :] for record, guess in zip(records, guesses, strict=True)]
    decays = [after_release(record, guess.release) for record, guess in zip(records, guesses, strict=True)]
    starts = [guess_of_displacement(guess, sensor.derivatives) for guess in guesses]
    model = replace(model, reference=max(guess.amplitude for guess in starts), sensor=sensor)
    if model.smooth:
        model = replace(model, span=amplitude_span(decays, guesses))
    lengths = [len(decay.time) for decay in decays]
    counts = lengths if robust else sample_counts(decays, [guess.ω for guess in guesses])
    curves: Sequence[Callable[[Array], Array]] = [np.zeros_like] * len(decays)
    start = None
    if counts != lengths:  # the curve of a first fit, which has slopes at the ends
        if other_fit is None:
            reduced = [reduce_to_band(*arguments) for arguments in zip(decays, counts, curves, strict=True)]
            fit, columns = _fit_model(model, reduced, starts, robust, priors=priors)
            start, curves = fit.estimates, [decay_curve(model, fit.values[list(indices)]) for indices in columns]
        else:
            curves = [decay_curve(other_fit.model, other_fit.fit.values[list(other_fit.indices)])]
    reduced = [reduce_to_band(*arguments) for arguments in zip(decays, counts, curves, strict=True)]
    other_estimates = other_fit.fit.estimates if other_fit else {}
    fit, columns = _fit_model(model, reduced, starts, robust, start, other_estimates, priors)
    rows_of = [slice(*ends) for ends in pairwise(np.cumsum([0, *counts]).tolist())]
    rounding = []
    for indices, fitted, decay, rows in zip(columns, reduced, decays, rows_of, strict=True):
        residual_rms, step = root_mean_square(fit.residuals[rows]), resolution(decay.values)
        rounding.append(rounding_curves(model, fit.values[list(indices)], fitted, step, residual_rms))
    fit = allow_for_rounding(fit, rows_of, rounding)
    fit = allow_for_late_residuals(fit, rows_of, NOISE_FREE * _largest_swing(model, starts))
    results = []
    for k, (guess, indices, rows) in enumerate(zip(guesses, columns, rows_of, strict=True)):
        residuals = fit.residuals[rows]
        if counts != lengths:
            residuals = decay_curve(model, fit.values[list(indices)])(decays[k].time) - decays[k].values
        notes = (*guess.notes, *_growth_warnings(model, fit, indices, reduced[k], starts[k]))
        release = float(times[k][0]) if guess.reason == "given" else None
        refit = partial(fit_record, model=requested, release_time=release, robust=robust, priors=priors)
        results.append(DecayFit(fit, model, indices, rows, times[k], residuals, guess.reason, notes, again=refit))
    return tuple(results)


def rounding_curves(model: DecayModel, values: Array, decay: Measurement, step: float, residual_rms: float) -> Array:
    """Return the errors (m, 4) of rounding in a decay to steps, 0 if there are none (``rounding_errors``)."""
    if not step:
        return np.zeros((len(decay.time), 4))
    ω, mode_and_release = values[0], len(values) - len(REST_TERMS[model.rest])
    swing = decay_curve(replace(model, rest="zero"), values[:mode_and_release])(decay.time)
    amplitude = cs.evalf(model.amplitude(decay.time, *map(cs.MX, values.tolist()))).full().ravel()
    sensor_amplitude = amplitude * ω**model.sensor.derivatives
    cosine = np.divide(swing, sensor_amplitude, out=np.zeros_like(swing), where=sensor_amplitude > 0.0)
    return rounding_errors(sensor_amplitude, cosine, step, residual_rms)


def allow_for_rounding(fit: Fit, decays: Sequence[slice], errors: Sequence[Array]) -> Fit:
    """Return a fit whose covariance allows for the errors (m, 4) of rounding in its decays, apart from each other."""
    columns = np.zeros((len(fit.residuals), 4 * len(decays)))
    for k, (rows, error) in enumerate(zip(decays, errors, strict=True)):
        columns[rows, 4 * k : 4 * k + 4] = error
    return allowing_for_errors(fit, columns) if columns.any() else fit


def allow_for_late_residuals(fit: Fit, decays: Sequence[slice], max_noise_free: float) -> Fit:
    """Return a fit whose covariance allows for the scatter between estimates from later starts of its decays.

    ``decays`` are the rows of each decay; residuals up to the root mean square ``max_noise_free`` are no noise.
    """
    if not fit.residual_rms > max_noise_free:
        return fit
    return allowing_for_later_starts(fit, [late_residuals(fit, decays, share) for share in LATER_STARTS])


def _growth_warnings(
    model: DecayModel, fit: Fit, columns: Sequence[int], decay: Measurement, guess: DecayGuess
) -> tuple[str, ...]:
    """Return a warning if a fit ends at its least damping because the oscillation of a record grows."""
    damping = [k for k in columns if fit.names[k] in DAMPING]
    if not all(fit.values[k] == fit.lower[k] >= 0.0 for k in damping):
        return ()
    growing_model = replace(model, law="linear", ratio_bounds=GROWING)
    try:
        growing_fit, _ = _fit_model(growing_model, [decay], [guess], robust=False)
    except FitError:
        return ()
    index = growing_fit.names.index("zeta")
    # without noise, rounding alone may seem to grow
    min_growth = NOISE_FREE / (guess.ω * decay.time[-1])
    if not growing_fit.intervals(1 - DISAGREE)[index, 1] < -min_growth:
        return ()
    return (
        f"{GROWS}, by a damping ratio of about {growing_fit.values[index]:.2g}: it is no free decay; "
        "give a release after the growth, or the linear law with ratio_bounds below 0",
    )


def _largest_swing(model: DecayModel, guesses: Sequence[DecayGuess]) -> float:
    """Return the largest amplitude of the records at the release, in the unit of their sensor."""
    return max(guess.amplitude * guess.ω**model.sensor.derivatives for guess in guesses)


def after_release(record: Measurement, release: int) -> Measurement:
    """Return a record from the sample of its release on, with the times (s) since then."""
    time = record.time[release:]
    return Measurement(time - time[0], record.values[release:], sensor=record.sensor)


def fitted_samples(record: Measurement, fit: DecayFit) -> Measurement:
    """Return the samples of a record that its fit used: from the release on, reduced to the band of the mode."""
    decay = after_release(record, len(record.time) - len(fit.time))
    return reduce_to_band(decay, fit.fitted_samples, lambda time: fit.displacement(time + fit.release_time))


def sample_counts(decays: Sequence[Measurement], ω: Sequence[float]) -> list[int]:
    """Return the number of samples that a fit needs of each decay: all, if one of them is short or unevenly sampled.

    The samples of all decays become fewer by the same ratio, because a fit takes their noise as equal.
    """
    needed_counts = [
        max(MIN_REDUCED_LENGTH, REDUCED_PER_PERIOD * frequency * decay.time[-1] / (2 * math.pi))
        for frequency, decay in zip(ω, decays, strict=True)
    ]
    lengths = [len(decay.time) for decay in decays]
    ratio = max(count / length for count, length in zip(needed_counts, lengths, strict=True))
    if 2 * ratio >= 1.0 or not all(has_even_steps(decay.time) for decay in decays):
        return lengths
    return [math.ceil(ratio * length) for length in lengths]


def reduce_to_band(decay: Measurement, count: int, curve: Callable[[Array], Array]) -> Measurement:
    """Return a decay with fewer samples: those of a curve of the time, plus the projected rest."""
    m = len(decay.time)
    if count == m:
        return decay
    time = (m / count * (np.arange(count) + 0.5) - 0.5) * decay.time[-1] / (m - 1)
    return Measurement(
        time, curve(time) + project_on_cosines(decay.values - curve(decay.time), count), sensor=decay.sensor
    )


def decay_curve(model: DecayModel, values: ArrayLike) -> Callable[[Array], Array]:
    """Return the curve for values of its unknowns, as a function of the time (s) after the release."""
    x = [cs.MX(float(value)) for value in np.asarray(values)]
    return lambda time: np.asarray(cs.evalf(model.curve(time, *x))).ravel()


def fit_jointly(modes: Sequence[DecayFit], t: Array, y: Array) -> tuple[DecayFit, ...]:
    """Return the fits of modes, known from fits alone, at once to values y at times t (s) from the release on."""
    unknowns: list[Unknown] = []
    columns = []
    for number, mode in enumerate(modes, start=1):
        columns.append(tuple(range(len(unknowns), len(unknowns) + len(mode.indices))))
        indices = with_guesses([mode.fit.unknowns[i] for i in mode.indices], mode.fit.estimates)
        unknowns += [replace(u, name=f"{u.name}_{number}") for u in indices]
    decay, mode_indices = Measurement(t - t[0], y), list(zip(modes, columns, strict=True))
    (count,) = sample_counts([decay], [2 * np.pi * max(mode.frequency for mode in modes)])
    values = np.array([u.guess for u in unknowns])

    def curves(time: Array) -> list[Array]:
        return [decay_curve(mode.model, values[list(indices)])(time) for mode, indices in mode_indices]

    for _ in range(1 + (count < len(t))):  # with the curves of the first fit, which have slopes at the ends
        fitted = reduce_to_band(decay, count, lambda time: np.asarray(np.sum(curves(time), axis=0)))

        def residuals(*x: cs.MX, decay: Measurement = fitted) -> cs.MX:
            curves = (mode.model.curve(decay.time, *(x[i] for i in indices)) for mode, indices in mode_indices)
            return sum(curves, -cs.MX(cs.DM(decay.values)))

        fit = least_squares(
            residuals,
            unknowns,
            series=[count],
            times=fitted.time,
            advice="fit fewer modes, or check the time of the release",
        )
        values, unknowns = fit.values, with_guesses(unknowns, fit.estimates)
    curve_residuals = np.asarray(np.sum(curves(decay.time), axis=0) - y)
    return tuple(
        replace(mode, fit=fit, indices=indices, rows=slice(0, count), time=t, residuals=curve_residuals)
        for mode, indices in mode_indices
    )


def _simpler_starts(
    model: DecayModel, decays: Sequence[Measurement], guesses: Sequence[DecayGuess]
) -> dict[str, float]:
    """Return starting values under smooth laws: the fit of the simplest frequency law that the largest decay shows."""
    largest = int(np.argmax([guess.amplitude for guess in guesses]))
    (simpler, *_) = simpler_models(model, (select_frequency_law(decays[largest], guesses[largest], SIMPLER_LAWS),))
    try:
        fit, (indices, *_) = _fit_model(simpler, decays, guesses, robust=False)
    except FitError:
        return {}
    x = [cs.MX(value) for value in fit.values[list(indices)]]
    at_nodes = simpler.against_amplitude(smooth_nodes(model.reference, model.span), *x)
    return {**fit.estimates, **smooth_values(model, *(cs.evalf(column).full().ravel() for column in at_nodes))}


def simpler_models(model: DecayModel, frequency_laws: Sequence[FrequencyLaw] = SIMPLER_LAWS) -> list[DecayModel]:
    """Return the models with simpler laws in place of smooth ones."""
    law = SIMPLER_LAW if model.law == "smooth" else model.law
    candidate_laws = frequency_laws if model.frequency_law == "smooth" else (model.frequency_law,)
    return [replace(model, law=law, frequency_law=frequency_law) for frequency_law in candidate_laws]


def smooth_values(model: DecayModel, ratios: Array, frequencies: Array) -> dict[str, float]:
    """Return the unknowns of smooth laws by name, from damping ratios (7,) and frequencies (7,), Hz, at their nodes."""
    values = dict[str, float]()
    for terms, name, at_nodes in (
        (SMOOTH_DAMPING, "zeta", ratios),
        (SMOOTH_FREQUENCY, "omega", 2 * math.pi * frequencies),
    ):
        middle = float(at_nodes[MIDDLE])
        if terms in model.smooth and middle > 0.0:
            changes = np.delete(at_nodes / middle - 1, MIDDLE)
            values |= {name: middle, **dict(zip(terms.names, changes.tolist(), strict=True))}
    return values


def _fit_model(
    model: DecayModel,
    decays: Sequence[Measurement],
    guesses: Sequence[DecayGuess],
    robust: bool,
    start: Mapping[str, float] | None = None,
    other_estimates: Mapping[str, float] = MappingProxyType({}),
    priors: Priors = NO_PRIORS,
) -> tuple[Fit, list[tuple[int, ...]]]:
    """Return the fit of a model, and the positions of the unknowns of each record.

    Unknowns named in ``start`` begin at the values given there, the others at the guesses.  Without ``start``, the fit
    begins at the guesses, at the track of amplitude and phase, or at the track with ``other_estimates``, whichever has
    the smallest residuals.  For smooth laws, the fit of simpler laws gives ``other_estimates``.
    """
    unknowns, columns = _unknowns(model, guesses)
    unknowns = with_priors(unknowns, priors, model)
    prior_residuals = _prior_residuals(model, unknowns)
    term_counts = [len(terms.names) for terms in model.smooth]
    if term_counts and start is None:
        other_estimates = _simpler_starts(model, decays, guesses)
    times, measured = [decay.time for decay in decays], cs.DM(np.concatenate([decay.values for decay in decays]))
    x = cs.MX.sym("x", len(unknowns))
    curve = cs.vertcat(*(model.curve(t, *(x[i] for i in indices)) for t, indices in zip(times, columns, strict=True)))
    curves = cs.Function("curves", [x], [curve], {"always_inline": True})  # built once, and inserted where needed

    smoothness = np.array([terms.first for terms in model.smooth])

    def solve_from(unknowns: Sequence[Unknown], noise: float, huber: float = math.inf) -> Fit:
        sizes = cs.DM(smoothness)

        def residuals(*x: cs.MX) -> cs.MX:
            return cs.vertcat(curves(cs.vertcat(*x)) - measured, noise * prior_residuals(cs.vertcat(*x), sizes))

        return least_squares(residuals, unknowns, huber=huber, deviation=noise, **settings)

    def misfit(unknowns: Sequence[Unknown]) -> float:
        return float(cs.sumsqr(curves([u.guess for u in unknowns]) - measured))

    if start is None:
        starts = [unknowns, with_guesses(unknowns, _track_starts(model, decays, guesses))]
        if other_estimates:
            starts.append(with_guesses(starts[-1], other_estimates))
        starts.sort(key=misfit)
    else:
        starts = [with_guesses(unknowns, start)]
    prior_count = prior_residuals.numel_out()
    settings: dict[str, Any] = {
        "series": [*(len(t) for t in times), *[1] * prior_count],
        "times": np.concatenate([*times, np.zeros(prior_count)]),
        "stated": np.repeat([False, True], [measured.numel(), prior_count]),
        "systematic": rounding_error(decays),
        "advice": "check the time of the release, or fit a law with fewer terms",
    }
    min_noise = NOISE_FREE * _largest_swing(model, guesses)
    simpler_noise = math.sqrt(misfit(starts[0]) / measured.numel()) if term_counts else 0.0  # of a simpler law
    noise = max(simpler_noise, min_noise)
    fit, errors = None, list[FitError]()
    for start_unknowns in starts:
        try:
            fit = solve_from(start_unknowns, noise)  # in which priors hold what the record does not determine
            break
        except FitError as error:
            errors.append(error)
    if fit is None:
        raise errors[0]
    for iteration in range(MAX_ITERATIONS if term_counts else 3 if robust else min(prior_count, 1)):
        residuals = fit.residuals[: measured.numel()]
        if iteration and term_counts:
            changes = np.split(standardised_residuals(fit)[-sum(term_counts) :] / noise, np.cumsum(term_counts)[:-1])
            previous = smoothness
            smoothness = previous * [root_mean_square(change) for change in changes]
            smoothness = np.maximum(smoothness, [terms.least for terms in model.smooth])
            if has_converged(previous, smoothness):
                break
        if robust:
            noise = robust_deviation(residuals)
        else:
            noise = math.sqrt(float(residuals @ residuals) / max(len(residuals) - fit.rank, 1))
        if noise <= min_noise and not term_counts:
            break
        noise = max(noise, min_noise)
        fit = solve_from(with_guesses(fit.unknowns, fit.estimates), noise, HUBER * noise if robust else math.inf)
    return without_smoothness_test(fit), columns


def has_converged(previous: Array, smoothness: Array) -> bool:
    """Return whether the standard deviations of the changes of smooth laws settle, from two rounds of a fit."""
    return bool((np.abs(np.log(smoothness / previous)) < PRIOR_TOLERANCE).all())


def without_smoothness_test(fit: Fit) -> Fit:
    """Return a fit that says nothing of stated standard deviations, unless an unknown has a prior that states one."""
    if any(unknown.prior for unknown in fit.unknowns):
        return fit
    return replace(fit, noise=replace(fit.noise, p_value=math.nan))


def rounding_error(decays: Sequence[Measurement]) -> float:
    """Return the systematic error that moves estimates as far as the white noise of rounding to floating-point numbers.

    Numbers with the spacing s have an error of s/12^1/2; residuals may be less, since curves are rounded alike.
    """
    values = np.concatenate([decay.values for decay in decays])
    return float(np.spacing(np.abs(values).max())) / math.sqrt(12 * len(values))


def _prior_residuals(model: DecayModel, unknowns: Sequence[Unknown]) -> cs.Function:
    """Return the Function from the unknowns to the distances from their priors, in standard deviations.

    Those of the changes of smooth laws, which come last, are a second argument.
    """
    x, smoothness = cs.MX.sym("x", len(unknowns)), cs.MX.sym("smoothness", len(model.smooth))
    residuals = [unknown.prior_residual(x[k]) for k, unknown in enumerate(unknowns) if unknown.prior]
    names = [unknown.name for unknown in unknowns]
    for k, terms in enumerate(model.smooth):
        residuals.append(smooth_steps([x[names.index(name)] for name in terms.names]) / smoothness[k])
    return cs.Function("prior", [x, smoothness], [cs.vertcat(cs.MX(0, 1), *residuals)], {"always_inline": True})


def _unknowns(model: DecayModel, guesses: Sequence[DecayGuess]) -> tuple[list[Unknown], list[tuple[int, ...]]]:
    """Return the unknowns of the mode, then those of each record, and the positions of the unknowns of each record."""
    unknowns = model.mode_unknowns(max(guesses, key=lambda guess: guess.amplitude))
    shared, columns = tuple(range(len(unknowns))), []
    for guess, suffix in zip(guesses, _suffixes(guesses), strict=True):
        release_unknowns = model.release_unknowns(guess)
        columns.append((*shared, *range(len(unknowns), len(unknowns) + len(release_unknowns))))
        unknowns += [replace(u, name=u.name + suffix) for u in release_unknowns]
    return unknowns, columns


def _track_starts(model: DecayModel, decays: Sequence[Measurement], guesses: Sequence[DecayGuess]) -> dict[str, float]:
    """Return starting values by name from the track of each record; the largest record gives those of the mode."""
    record_values = [starting_values(model, decay, guess) for decay, guess in zip(decays, guesses, strict=True)]
    values = dict(record_values[int(np.argmax([guess.amplitude for guess in guesses]))])
    for start, suffix in zip(record_values, _suffixes(guesses), strict=True):
        values |= {name + suffix: value for name, value in start.items()}
    return values


def _suffixes(guesses: Sequence[DecayGuess]) -> list[str]:
    """Return what distinguishes the names of the unknowns of each record."""
    return [f"_{position}" for position in range(1, len(guesses) + 1)] if len(guesses) > 1 else [""]
