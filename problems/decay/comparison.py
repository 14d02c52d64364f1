"""Comparison of decay laws on one free decay: all are fitted to the same samples from one release.

Of all combinations of a damping law, a frequency law and a rest position, those are fitted that lead to the best one:
each damping law with the frequency law that the track of the phase shows (``starting_values``), then each frequency law
with the best damping law, each rest position with both, and so on, until the best combination was compared with all
that differ from it in one choice.  A long record is reduced once, less the best curve so far (``solution``).

Other records that might settle an open choice are the decay of one law from twice the amplitude, over twice the length,
and over the same length but from its end on, each without noise and fitted by the other law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, get_args

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.estimation.criteria import Expectation, expectation
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import fitted_once
from ancf_casadi.estimation.solver.unknown import with_guesses
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import choices
from ancf_casadi.support.interrupts import lasting_interrupts
from problems.decay.block import DecayBlock
from problems.decay.free_decay import FreeDecay, clean_record, cut_at_release
from problems.decay.laws import DAMPING_TERMS, RATIO_BOUNDS, DecayModel, Law
from problems.decay.limitations import refuse_unexplained
from problems.decay.result import DecayFit
from problems.decay.solution import fit_one_mode
from problems.decay.starting_values import select_frequency_law

LAWS_COMPARED: tuple[Law, ...] = ("linear", "quadratic", "friction", "power")
FREQUENCY_LAWS_COMPARED: tuple[FrequencyLaw, ...] = ("constant", "linear", "quadratic", "logarithmic")
RESTS_COMPARED: tuple[Rest, ...] = ("constant", "drift", "creep")
MAX_LAG = 100.0  # lag of the criterion beyond which a law is not tried again beside another law; 10 would be clear
MODEL_CHOICES = ("law", "frequency_law", "rest")  # in which combinations differ


@lasting_interrupts()
def compare_decay_laws(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    laws: Sequence[Law] = LAWS_COMPARED,
    frequency_laws: Sequence[FrequencyLaw] = FREQUENCY_LAWS_COMPARED,
    rests: Sequence[Rest] = RESTS_COMPARED,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
) -> LawComparison[DecayFit]:
    """Fit combinations of laws and rest positions to a free decay, and select one by information criteria.

    The best one was compared with every other damping law, every other frequency law, and every other rest position.
    A combination that cannot be fitted is listed with the reason.

    Parameters
    ----------
    laws : sequence of {"linear", "quadratic", "friction", "power"}
        Damping laws to compare, the simplest first.
    frequency_laws : sequence of {"constant", "linear", "quadratic", "power", "logarithmic"}
        Frequency laws to compare, the simplest first.
    rests : sequence of {"zero", "constant", "drift", "creep"}
        Rest positions to compare, the simplest first.
    time, displacement, release_time, ratio_bounds
        As in ``fit_decay``.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, a law is unknown, or no law is given.
    FitError
        If no fit converges.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import compare_decay_laws
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> y = 0.02 / (1.0 + 0.2 * time) * np.cos(12.0 * time) + noise  # quadratic damping
    >>> comparison = compare_decay_laws(time, y, frequency_laws=["constant"], rests=["constant"])
    >>> comparison.best.law
    'quadratic'
    """
    models = combinations(laws, frequency_laws, rests, ratio_bounds)
    comparison = compare_models(cut_at_release(clean_record(time, displacement), release_time), models)
    refuse_unexplained(comparison.best)
    return comparison


def compare_models(decay: FreeDecay, models: Sequence[DecayModel]) -> LawComparison[DecayFit]:
    """Fit models of a decay and select one by information criteria.

    The fits begin with the frequency law that the track shows, and go on with the models that differ from the best one
    so far in one choice.
    """
    frequency_laws = list(dict.fromkeys(model.frequency_law for model in models))
    tracked_law = select_frequency_law(decay, frequency_laws)
    best = next(model for model in models if model.frequency_law == tracked_law)
    fits: dict[DecayModel, DecayFit] = {}
    failed: dict[DecayModel, str] = {}
    lags: dict[DecayModel, float] = {}  # by how much the criterion of each fit exceeds that of the best
    comparison: LawComparison[DecayFit] | None = None
    while candidates := _next_candidates(best, [model for model in models if model not in {*fits, *failed}], lags):
        for model in candidates:
            try:
                (fit,) = fit_one_mode([decay], model, other_fit=comparison.best if comparison else None)
                _refuse_creep_within_a_period(fit)
                fits[model] = fit
            except FitError as error:
                failed[model] = str(error)
        if fits:
            fits = {model: fits[model] for model in models if model in fits}
            comparison = _judge_fits(fits, failed)
            evidence = np.array(comparison.verdict.evidence)
            lags = dict(zip(fits, (2 * (evidence.max() - evidence)).tolist(), strict=True))
            best = next(model for model, fit in fits.items() if fit is comparison.best)
    if comparison is None:
        reasons = "; ".join(f"{_name(model)}: {reason}" for model, reason in failed.items())
        raise FitError(f"no law can be fitted; {reasons}")
    return comparison


def _judge_fits(fits: Mapping[DecayModel, DecayFit], failed: Mapping[DecayModel, str]) -> LawComparison[DecayFit]:
    """Return the comparison of the fits so far, with the reasons why others failed."""
    return LawComparison(
        names=tuple(map(_name, fits)),
        fits=tuple(fits.values()),
        terms=tuple(DAMPING_TERMS[model.law] for model in fits),
        failed={_name(model): reason for model, reason in failed.items()},
        other_records=partial(_other_records, list(fits.values())),
    )


def _refuse_creep_within_a_period(fit: DecayFit) -> None:
    """Raise a FitError if the rate of a creep is at its upper bound: such a motion is no rest position."""
    if "creep" in fit.fit.at_bound and fit.creep > 0.0:
        raise FitError(
            f"its creep of {fit.creep:.3g} 1/s ends within a period of the mode: it is a blow or another mode, "
            "which a later release_time leaves out, or nothing creeps"
        )


def comparison_arguments(law: str, frequency_law: str | None, rest: str | None) -> dict[str, Any]:
    """Return the names to compare as arguments of ``combinations``; ``auto`` and None stand for all of a kind.

    With a law that is named, None stands for what is constant.
    """
    default = None if law == "auto" else "constant"
    choices = {"laws": law, "frequency_laws": frequency_law or default, "rests": rest or default}
    return {name: (choice,) for name, choice in choices.items() if choice not in (None, "auto")}


def _other_records(fits: Sequence[DecayFit], truth: int, rival: int) -> dict[str, Expectation]:
    """Return, for each other record, what a comparison of two laws would find if the first were true.

    A record that starts later has a smaller amplitude at its start, since the laws have no other memory.
    """
    true_fit, rival_fit = fits[truth], fits[rival]
    best = min(fits, key=lambda fit: fit.fit.residual_rms)
    time, noise_growth = np.asarray(true_fit.fit.times), max(best.fit.noise.inflation, 1.0)
    later_times = time + time[-1] + np.median(np.diff(time))
    later_amplitude = cs.evalf(true_fit.model.amplitude(later_times[:1], *map(cs.MX, true_fit.fit.values.tolist())))
    amplitude_ratio = float(later_amplitude) / true_fit.fit["e0"]
    records = {"twice the amplitude": (2.0, time), "twice the length": (1.0, np.concatenate([time, later_times])),
               "a later start": (amplitude_ratio, time)}  # fmt: skip
    expectations = {}
    for name, (scale, instants) in records.items():
        exact = Measurement(instants, true_fit.decay.at(instants, _scaled_estimates(true_fit, scale)))
        try:
            record_fits = [_fit_exact(fit, exact, scale) for fit in (true_fit, rival_fit)]
        except FitError:  # no expectation for a record on which a law cannot be fitted
            continue
        terms = [DAMPING_TERMS[fit.law] for fit in (true_fit, rival_fit)]
        expectations[name] = expectation(
            record_fits, terms, record_fits[1].residuals, best.fit.residual_rms, noise_growth
        )
    return expectations


def _scaled_estimates(fit: DecayFit, scale: float) -> dict[str, float]:
    """Return the estimates of a decay with another amplitude, relative to the fitted one."""
    return fit.fit.estimates | {"e0": scale * fit.fit["e0"]}


def _fit_exact(fit: DecayFit, exact: Measurement, scale: float) -> Fit:
    """Return the fit of the laws of a fit to an exact decay with another amplitude, relative to the fitted one."""
    unknowns = with_guesses(fit.fit.unknowns, _scaled_estimates(fit, scale))
    block = DecayBlock.of([replace(fit.decay, record=exact, fitted=exact, share=1.0)])
    return fitted_once(FitProblem((block,), tuple(unknowns), advice="name the laws"))


def _next_candidates(
    best: DecayModel, untried: Sequence[DecayModel], lags: Mapping[DecayModel, float]
) -> list[DecayModel]:
    """Return the combinations, among those left, that differ from the best in the first respect in which any does.

    One that lagged far behind in this respect, with the others as they were then, is not tried again.
    """
    for respect in MODEL_CHOICES:

        def replaced(model: DecayModel, to: DecayModel, respect: str = respect) -> DecayModel:
            return replace(model, **{respect: getattr(to, respect)})

        candidates = [model for model in untried if replaced(best, model) == model]
        far_behind = {
            model
            for model in candidates
            for tried, lag in lags.items()
            if replaced(tried, model) == tried and lag - lags.get(replaced(tried, best), math.inf) > MAX_LAG
        }
        if len(candidates) > len(far_behind):
            return [model for model in candidates if model not in far_behind]
    return []


def _name(model: DecayModel) -> str:
    rest_label = {"drift": " + drift", "creep": " + creep"}.get(model.rest, "")
    return f"{model.law}{f' + {model.frequency_law} frequency' if model.frequency_varies else ''}{rest_label}"


def combinations(
    laws: Sequence[Law] = LAWS_COMPARED,
    frequency_laws: Sequence[FrequencyLaw] = FREQUENCY_LAWS_COMPARED,
    rests: Sequence[Rest] = RESTS_COMPARED,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
) -> list[DecayModel]:
    """Return the damping laws with each frequency law and each rest position."""
    kinds = {"rests": (rests, Rest), "frequency_laws": (frequency_laws, FrequencyLaw), "laws": (laws, Law)}
    names: Any = [tuple(dict.fromkeys(choices(values, get_args(kind), name))) for name, (values, kind) in kinds.items()]
    for name, chosen in zip(kinds, names, strict=True):
        if not chosen:
            raise InputError("is empty; name at least one", name)
    return [DecayModel(law, rest, bent, ratio_bounds) for rest, bent, law in product(*names)]
