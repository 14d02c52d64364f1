"""Comparison of decay laws on one free decay: all combinations are fitted to the same samples from one release."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, get_args

from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import choice, flag, is_sequence, number, shown
from problems.decay.laws import DECAY_TERMS, RATIO_BOUNDS, DecayModel, Law
from problems.decay.result import DecayFit
from problems.decay.solution import as_record, fit_from

LAWS_COMPARED: tuple[Law, ...] = ("linear", "quadratic", "friction", "power")
EMPIRICAL = math.exp(-3)  # prior probability of the power law, an empirical one: its BIC must be lower by 6
FREQUENCY_LAWS_COMPARED: tuple[FrequencyLaw, ...] = get_args(FrequencyLaw)
ADDITIVE: Mapping[Law, tuple[str, ...]] = {  # unknowns whose uncertainty may leave the choice of a law open
    law: ("zeta",) if law in ("linear", "power") else terms for law, terms in DECAY_TERMS.items()
}
COUNTED: Mapping[Law, tuple[str, ...]] = {  # unknowns that count even at a bound; the others make the law a simpler one
    "linear": ("zeta",), "quadratic": ("eta1",), "friction": ("eta1", "eta2"), "power": ("zeta", "exponent"),
    "one-mode": ("eta1",),
}  # fmt: skip


def compare_decay_laws(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    laws: Sequence[Law] = LAWS_COMPARED,
    frequency_laws: Sequence[FrequencyLaw] = FREQUENCY_LAWS_COMPARED,
    offset: bool = True,
    drift: bool = False,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
) -> LawComparison[DecayFit]:
    """Fit all combinations of damping laws and frequency laws to a free decay, and select one by information criteria.

    A combination that cannot be fitted is listed with the reason.  ``one-mode`` is combined with a constant frequency
    only.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    laws : sequence of {"linear", "quadratic", "friction", "power", "one-mode"}
        Damping laws to compare, the simplest first.
    frequency_laws : sequence of {"constant", "linear", "quadratic", "power", "logarithmic"}
        Frequency laws to compare, the simplest first.
    offset, drift, release_time, ratio_bounds
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
    >>> comparison = compare_decay_laws(time, y, frequency_laws=["constant"])
    >>> comparison.best.law
    'quadratic'
    """
    offset, drift = flag(offset, "offset"), flag(drift, "drift")
    models = _combinations(laws, frequency_laws, offset, drift, ratio_bounds)
    record = as_record(time, displacement)
    release = None if release_time is None else number(release_time, "release_time")
    guess = first_guess(record, release_time=release, offset=offset, drift=drift)
    fits: dict[str, DecayFit] = {}
    failed: dict[str, str] = {}
    for model in models:
        name = model.law if not model.bends else f"{model.law} + {model.frequency_law} frequency"
        try:
            (fits[name],) = fit_from([guess], [record], model)
        except FitError as error:
            failed[name] = str(error)
    if not fits:
        raise FitError("no law can be fitted; " + "; ".join(f"{name}: {reason}" for name, reason in failed.items()))
    return LawComparison(
        names=tuple(fits),
        fits=tuple(fits.values()),
        terms=tuple(ADDITIVE[fit.law] for fit in fits.values()),
        failed=failed,
        counted={name: COUNTED[fit.law] for name, fit in fits.items()},
        priors={name: EMPIRICAL for name, fit in fits.items() if fit.law == "power"},
    )


def _combinations(laws: Any, frequency_laws: Any, offset: bool, drift: bool, ratios: Any) -> list[DecayModel]:
    """Return the damping laws with each frequency law; one that is integrated has a constant frequency only."""
    for names, where in ((laws, "laws"), (frequency_laws, "frequency_laws")):
        if not is_sequence(names) or not len(names):
            raise InputError(f"must be a sequence of laws, got {shown(names)}", where)
    constant = [DecayModel(law, offset, drift, ratio_bounds=ratios) for law in laws]
    for frequency_law in frequency_laws:
        choice(frequency_law, get_args(FrequencyLaw), "frequency_law")
    pairs = [(model, law) for law, model in product(frequency_laws, constant)]
    possible = [(model, law) for model, law in pairs if law == "constant" or not model.integrated]
    return [replace(model, frequency_law=law) for model, law in possible or pairs]
