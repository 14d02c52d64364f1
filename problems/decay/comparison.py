"""Which law of damping a free decay speaks for.

All laws are fitted to the same samples; ``criteria`` says how they are judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.measurement import Measurement
from ancf_casadi.estimation.criteria import Candidate, Verdict, judge
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import flag, is_sequence, number, shown
from ancf_casadi.support.tables import Table
from problems.decay.fitting import as_record, check_law, fit_from
from problems.decay.laws import LAWS, Law
from problems.decay.result import DecayFit


@dataclass(frozen=True, eq=False)
class DecayComparison:
    """Laws of damping, fitted to one record.

    Parameters
    ----------
    fits : tuple of DecayFit
        One for each law.
    """

    fits: tuple[DecayFit, ...]

    @cached_property
    def verdict(self) -> Verdict:
        """What the criteria say."""
        return judge([Candidate.of(fit.law, fit.fit, LAWS[fit.law].terms or ("zeta",)) for fit in self.fits])

    @property
    def aicc(self) -> tuple[float, ...]:
        """AICc of each law."""
        return self.verdict.aicc

    @property
    def bic(self) -> tuple[float, ...]:
        """BIC of each law."""
        return self.verdict.bic

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before using them."""
        return self.verdict.warnings

    @property
    def best(self) -> DecayFit:
        """The fit with the least BIC."""
        return self.fits[self.verdict.best]

    def table(self) -> Table:
        """Return the laws with their criteria, from the least of each."""
        rows = [
            (
                fit.law,
                fit.fit.rank + 1,
                fit.residual_rms,
                aicc - min(self.aicc) if math.isfinite(aicc) else None,
                bic - min(self.bic),
                fit.fit.autocorrelation,
                ", ".join(fit.active_bounds),
            )
            for fit, aicc, bic in zip(self.fits, self.aicc, self.bic, strict=True)
        ]
        columns = ("law", "estimated", "residual_rms_m", "delta_AICc", "delta_BIC", "autocorrelation", "at_bound")
        said = f"best by BIC: {self.best.law}"
        if not self.verdict.settled:
            said = f"the record cannot tell for sure; {said}"
        notes = (said, *(f"note: {warning}" for warning in self.warnings))
        return Table("laws", "Laws of damping", columns, rows, notes)

    def report(self) -> str:
        """Return the table, and the best fit, as text."""
        return f"{self.table().text()}\n\n{self.best.report()}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "best": self.best.law,
            "settled": self.verdict.settled,
            "effective_samples": self.verdict.effective_samples,
            "laws": [
                {
                    "law": fit.law,
                    "estimated": fit.fit.rank + 1,
                    "aicc": aicc if math.isfinite(aicc) else None,
                    "bic": bic,
                    "residual_rms_m": fit.residual_rms,
                    "autocorrelation": fit.fit.autocorrelation if math.isfinite(fit.fit.autocorrelation) else None,
                    "at_bound": list(fit.active_bounds),
                }
                for fit, aicc, bic in zip(self.fits, self.aicc, self.bic, strict=True)
            ],
            "warnings": list(self.warnings),
        }


def compare_decay_laws(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    laws: Sequence[Law] = ("linear", "quadratic", "friction"),
    offset: bool = True,
    drift: bool = False,
    release_time: float | None = None,
) -> DecayComparison:
    """Fit a free decay by several laws, and tell which explains it with the least.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    laws : sequence of {"linear", "quadratic", "friction", "one-mode"}
        The laws, the simplest first.
    offset, drift, release_time
        As in ``fit_decay``.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, or a law is unknown or there is none.
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
    return DecayComparison(tuple(fits))
