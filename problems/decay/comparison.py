"""Comparison of damping laws on one free decay: all laws are fitted to the same samples from one release."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import flag, is_sequence, number, shown
from problems.decay.fitting import as_record, check_law, fit_from
from problems.decay.laws import LAWS, Law
from problems.decay.result import DecayFit


def compare_decay_laws(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    laws: Sequence[Law] = ("linear", "quadratic", "friction"),
    offset: bool = True,
    drift: bool = False,
    release_time: float | None = None,
) -> LawComparison[DecayFit]:
    """Fit several damping laws to a free decay, and select one by information criteria.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    laws : sequence of {"linear", "quadratic", "friction", "one-mode"}
        Laws to compare, the simplest first.
    offset, drift, release_time
        As in ``fit_decay``.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, a law is unknown, or no law is given.
    FitError
        If a fit does not converge.
    """
    if not is_sequence(laws) or not len(laws):
        raise InputError(f"must be a sequence of laws, got {shown(laws)}", "laws")
    for law in laws:
        check_law(law)
    offset, drift = flag(offset, "offset"), flag(drift, "drift")
    record = as_record(time, displacement)
    release = None if release_time is None else number(release_time, "release_time")
    guess = first_guess(record, release_time=release, offset=offset, drift=drift)
    fits = [fit_from([guess], [record], law=law, offset=offset, drift=drift)[0] for law in laws]
    terms = tuple(LAWS[law].terms or ("zeta",) for law in laws)
    return LawComparison(tuple(laws), tuple(fits), terms)
