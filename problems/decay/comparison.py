"""Comparison of decay laws on one free decay: all are fitted to the same samples from one release.

Of all combinations of damping and frequency laws, those are fitted that lead to the best one: each damping law with the
first frequency law, then each frequency law with the best damping law, and so on, until the best combination was
compared with every other damping law and every other frequency law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import flag, is_sequence, number, shown
from ancf_casadi.support.interrupts import lasting_interrupts
from problems.decay.laws import DECAY_TERMS, RATIO_BOUNDS, DecayModel, Law
from problems.decay.result import DecayFit
from problems.decay.solution import as_record, fit_from

LAWS_COMPARED: tuple[Law, ...] = ("linear", "quadratic", "friction", "power")
EMPIRICAL = math.exp(-3)  # prior probability of the power law, an empirical one: its BIC must be lower by 6
FREQUENCY_LAWS_COMPARED: tuple[FrequencyLaw, ...] = ("constant", "linear", "quadratic", "logarithmic")
ADDITIVE: Mapping[Law, tuple[str, ...]] = {  # unknowns whose uncertainty may leave the choice of a law open
    law: ("zeta",) if law in ("linear", "power") else terms for law, terms in DECAY_TERMS.items()
}
COUNTED: Mapping[Law, tuple[str, ...]] = {  # unknowns that count even at a bound; the others make the law a simpler one
    "linear": ("zeta",), "quadratic": ("eta1",), "friction": ("eta1", "eta2"), "power": ("zeta", "exponent"),
}  # fmt: skip


@lasting_interrupts()
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
    """Fit combinations of damping laws and frequency laws to a free decay, and select one by information criteria.

    The best one was compared with every other damping law and with every other frequency law.  A combination that
    cannot be fitted is listed with the reason.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    laws : sequence of {"linear", "quadratic", "friction", "power"}
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
    fits: dict[DecayModel, DecayFit] = {}
    failed: dict[DecayModel, str] = {}
    best = models[0]
    while left := [
        model
        for model in models
        if model not in {*fits, *failed}
        and (model.frequency_law == best.frequency_law or (fits and model.law == best.law))
    ]:
        for model in [model for model in left if model.frequency_law == best.frequency_law] or left:
            try:
                (fits[model],) = fit_from([guess], [record], model)
            except FitError as error:
                failed[model] = str(error)
        if fits:
            names = {_name(model): model for model in models if model in fits}
            found = LawComparison(
                names=tuple(names),
                fits=tuple(fits[model] for model in names.values()),
                terms=tuple(ADDITIVE[model.law] for model in names.values()),
                failed={_name(model): reason for model, reason in failed.items()},
                counted={name: (*COUNTED[model.law], *model.frequency_terms) for name, model in names.items()},
                priors={name: EMPIRICAL for name, model in names.items() if model.law == "power"},
            )
            best = next(model for model, fit in fits.items() if fit is found.best)
    if not fits:
        reasons = "; ".join(f"{_name(model)}: {reason}" for model, reason in failed.items())
        raise FitError(f"no law can be fitted; {reasons}")
    return found


def _name(model: DecayModel) -> str:
    return model.law if not model.bends else f"{model.law} + {model.frequency_law} frequency"


def _combinations(laws: Any, frequency_laws: Any, offset: bool, drift: bool, ratios: Any) -> list[DecayModel]:
    """Return the damping laws with each frequency law."""
    for names, where in ((laws, "laws"), (frequency_laws, "frequency_laws")):
        if not is_sequence(names) or not len(names):
            raise InputError(f"must be a sequence of laws, got {shown(names)}", where)
    return [DecayModel(law, offset, drift, bent, ratios) for bent, law in product(frequency_laws, laws)]
