"""Decay fits as problems of the one loop (``ancf_casadi.estimation.solve``), with their starts and their results.

A fit starts from the first guess or from the track of amplitude and phase (``starting_values``), whichever has the
smaller residuals, and if it does not converge, from the other one.  With several records, the one with the largest
amplitude gives the starting values of the mode.  Smooth laws also start from the fit of simpler laws.

A long record is fitted twice: in the band of the mode (``free_decay``), and again less the curve of the first fit, or
only less the curve of another law.  Outliers would spread, so that a robust fit takes all samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import casadi as cs
import numpy as np

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.smooth import MIDDLE, SMOOTH_DAMPING, SMOOTH_FREQUENCY, smooth_nodes
from ancf_casadi.estimation.agreement import DISAGREE
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import FitSolution, fitted_once, solve
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, with_guesses
from ancf_casadi.exceptions import FitError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from problems.decay.block import DAMPING, DecayBlock, SmoothnessBlock
from problems.decay.free_decay import NOISE_FREE, DecayMode, FreeDecay, cut_at_release, needed_share
from problems.decay.laws import DecayModel, Law, evaluate, with_priors
from problems.decay.limitations import GROWS
from problems.decay.result import DecayFit
from problems.decay.starting_values import amplitude_span, select_frequency_law, starting_values

GROWING = (-0.999, 0.999)  # bounds of a damping ratio that may be negative
NO_PRIORS: Priors = {}
SIMPLER_LAWS: Sequence[FrequencyLaw] = ("constant", "linear", "quadratic", "logarithmic")  # than a smooth frequency
SIMPLER_LAW: Law = "friction"  # than a smooth damping ratio: it may rise and fall


def fit_record(
    record: Measurement,
    model: DecayModel,
    *,
    release_time: float | None = None,
    robust: bool = False,
    priors: Priors = NO_PRIORS,
) -> DecayFit:
    """Fit one free decay; see ``fit_one_mode``."""
    check_instance(record, "records", Measurement)
    return fit_one_mode([cut_at_release(record, release_time)], model, robust=robust, priors=priors)[0]


def fit_one_mode(
    decays: Sequence[FreeDecay],
    requested: DecayModel,
    *,
    robust: bool = False,
    priors: Priors = NO_PRIORS,
    other_fit: DecayFit | None = None,
) -> tuple[DecayFit, ...]:
    """Fit several free decays of one mode at once; the model takes their sensor.

    ``other_fit``, the fit of one record by another law, replaces the first fit of a long record.
    """
    decays = [decay.about(requested.rest) for decay in decays]
    reference = max(decay.guess.amplitude for decay in decays)
    model = replace(requested, reference=reference, sensor=decays[0].record.sensor)
    if model.smooth:
        model = replace(model, span=amplitude_span(decays))
    other_modes, other_estimates = (other_fit.decay.modes, other_fit.fit.estimates) if other_fit else ((), {})
    share = 1.0 if robust else needed_share(decays)
    decays = [replace(decay, modes=other_modes).reduced(share, other_estimates) for decay in decays]
    problem, starts = decay_problem(model, decays, robust=robust, priors=priors, other_estimates=other_estimates)
    solution = _solve(problem, starts, twice=share < 1.0 and not other_fit)
    results = []
    for decay, rows in _fitted_decays(solution):
        notes = (*decay.notes, *_growth_warnings(decay, solution.fit))
        release = decay.release_time if decay.guess.reason == "given" else None
        refit = partial(fit_record, model=requested, release_time=release, robust=robust, priors=priors)
        results.append(DecayFit(solution.fit, replace(decay, notes=notes), rows, again=refit))
    return tuple(results)


def fit_several_modes(modes: Sequence[DecayFit], t: Array, y: Array) -> tuple[DecayFit, ...]:
    """Return the fits of modes, known from fits alone, at once to values y at times t (s) from the release on."""
    first, unknowns, decay_modes = modes[0].decay, list[Unknown](), []
    for number, mode in enumerate(modes, start=1):
        mode_unknowns = with_guesses([mode.fit.unknowns[k] for k in mode.indices], mode.fit.estimates)
        mode_unknowns = [replace(unknown, name=f"{unknown.name}_{number}") for unknown in mode_unknowns]
        decay_modes.append(DecayMode(mode.model, tuple(unknown.name for unknown in mode_unknowns)))
        unknowns += mode_unknowns
    guess = replace(first.guess, ω=2 * math.pi * max(mode.frequency for mode in modes))  # which decides on the band
    record = Measurement(t - t[0], y, sensor=first.record.sensor)
    decay = replace(first, record=record, guess=guess, modes=tuple(decay_modes))
    share = needed_share([decay])
    block = DecayBlock.of([decay.reduced(share, {unknown.name: unknown.guess for unknown in unknowns})])
    advice = "fit fewer modes, or check the time of the release"
    problem = FitProblem((block,), tuple(unknowns), most_unexplained=1.0, advice=advice)
    solution = _solve(problem, twice=share < 1.0)
    ((decay, rows),) = _fitted_decays(solution)
    return tuple(replace(mode, fit=solution.fit, decay=decay, rows=rows, mode=k) for k, mode in enumerate(modes))


def _solve(problem: FitProblem, starts: Sequence[Mapping[str, float]] = ({},), *, twice: bool) -> FitSolution:
    """Solve a problem of decays; if ``twice``, again with the bands of what the curves of the solution leave."""
    solution = solve(problem, starts, compare=False)
    if not twice:
        return solution
    problem, estimates = solution.problem, solution.fit.estimates
    blocks = (block.less_curve(estimates) if isinstance(block, DecayBlock) else block for block in problem.blocks)
    unknowns = with_guesses(problem.unknowns, estimates)
    return solve(replace(problem, blocks=tuple(blocks), unknowns=tuple(unknowns)))


def decay_problem(
    model: DecayModel,
    decays: Sequence[FreeDecay],
    *,
    robust: bool = False,
    priors: Priors = NO_PRIORS,
    other_estimates: Mapping[str, float] = MappingProxyType({}),
) -> tuple[FitProblem, list[dict[str, float]]]:
    """Return the problem of decays of one mode, and its starts by their residuals.

    These are the guesses, the track of amplitude and phase, and the track with ``other_estimates``.  For smooth laws,
    the latter are the fit of simpler laws.  The residuals of the best start give the first standard deviations.
    """
    largest = int(np.argmax([decay.guess.amplitude for decay in decays]))
    unknowns = model.mode_unknowns(decays[largest].guess)
    law_names = tuple(unknown.name for unknown in unknowns)
    tracked_values = [starting_values(model, decay) for decay in decays]
    tracked, with_modes = dict(tracked_values[largest]), []
    for k, decay in enumerate(decays):
        suffix = f"_{k + 1}" if len(decays) > 1 else ""
        release_unknowns = [replace(u, name=u.name + suffix) for u in model.release_unknowns(decay.guess)]
        names = (*law_names, *(unknown.name for unknown in release_unknowns))
        unknowns += release_unknowns
        with_modes.append(replace(decay, modes=(DecayMode(model, names),)))
        tracked |= {name + suffix: value for name, value in tracked_values[k].items()}
    unknowns = with_priors(unknowns, priors, model)
    if model.smooth:
        other_estimates = _simpler_estimates(model, decays)
    start_values = [{}, tracked, *([{**tracked, **other_estimates}] if other_estimates else [])]
    block = DecayBlock.of(with_modes)
    block, starts = _order_starts(block, [with_guesses(unknowns, values) for values in start_values], robust=robust)
    problem = FitProblem(
        (block, *map(SmoothnessBlock.of, model.smooth)),
        tuple(unknowns),
        robust,
        most_unexplained=1.0,
        advice="check the time of the release, fit a law with fewer terms, or use robust=True if there are outliers",
    )
    return problem, starts


def _order_starts(
    block: DecayBlock, guesses: Sequence[Sequence[Unknown]], *, robust: bool
) -> tuple[DecayBlock, list[dict[str, float]]]:
    """Return the block with the noise of the best start, and the starts by name, those with smaller residuals first."""
    starts = [{unknown.name: unknown.guess for unknown in unknowns} for unknowns in guesses]
    residuals = [block.misfits(start) for start in starts]
    misfits = [sum(float(of_decay @ of_decay) for of_decay in of_start) for of_start in residuals]
    order = np.argsort(misfits, kind="stable")
    return block.with_noise(residuals[order[0]], robust=robust), [starts[k] for k in order]


def _fitted_decays(solution: FitSolution) -> list[tuple[FreeDecay, slice]]:
    """Return the decays of a solution, and their residuals among all."""
    pairs = [(block, fitted) for block, fitted in solution.fitted_blocks if isinstance(block, DecayBlock)]
    return [pair for block, fitted in pairs for pair in zip(block.decays, block.rows(fitted), strict=True)]


def _growth_warnings(decay: FreeDecay, fit: Fit) -> tuple[str, ...]:
    """Return a warning if a fit ends at its least damping because the oscillation of a record grows."""
    (mode,) = decay.modes
    damping = [k for k, name in enumerate(fit.names) if name in DAMPING]
    if not all(fit.values[k] == fit.lower[k] >= 0.0 for k in damping):
        return ()
    problem, starts = decay_problem(replace(mode.model, law="linear", ratio_bounds=GROWING), [decay])
    try:
        growing_fit = fitted_once(replace(problem, unknowns=tuple(with_guesses(problem.unknowns, starts[0]))))
    except FitError:
        return ()
    index = growing_fit.names.index("zeta")
    # without noise, rounding alone may seem to grow
    min_growth = NOISE_FREE / (decay.guess.ω * decay.record.time[-1])
    if not growing_fit.intervals(1 - DISAGREE)[index, 1] < -min_growth:
        return ()
    return (
        f"{GROWS}, by a damping ratio of about {growing_fit.values[index]:.2g}: it is no free decay; "
        "give a release after the growth, or the linear law with ratio_bounds below 0",
    )


def _simpler_estimates(model: DecayModel, decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Return values for smooth laws: those of the fit of the simplest frequency law that the largest decay shows."""
    largest = max(decays, key=lambda decay: decay.guess.amplitude)
    (simpler, *_) = simpler_models(model, (select_frequency_law(largest, SIMPLER_LAWS),))
    try:
        solution = solve(*decay_problem(simpler, decays), compare=False)
    except FitError:
        return {}
    (decay, _), *_ = _fitted_decays(solution)
    x = [cs.MX(solution.fit[name]) for name in decay.modes[0].names]
    at_nodes = simpler.against_amplitude(smooth_nodes(model.reference, model.span), *x)
    values = smooth_values(model, *map(evaluate, at_nodes))
    return {**solution.fit.estimates, **values}


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
