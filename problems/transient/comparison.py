"""Which damping law the measured large motion of a beam speaks for.

Each law is fitted to all records by the nonlinear beam (``transient_fitting``); ``criteria`` says how they are judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from ancf_casadi.damping import DampingLaw, SumOfLaws
from ancf_casadi.estimation.criteria import Candidate, Verdict, judge
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import instances
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.tables import Table
from problems.transient.fitting import TransientFit, fit_transient
from problems.transient.marker_record import MarkerRecord


@dataclass(frozen=True, eq=False)
class LawComparison:
    """Damping laws, fitted to the same records.

    Parameters
    ----------
    names : tuple of str
        What each law is called.
    fits : tuple of TransientFit
        One for each law.
    """

    names: tuple[str, ...]
    fits: tuple[TransientFit, ...]

    @cached_property
    def verdict(self) -> Verdict:
        """What the criteria say."""
        return judge(
            [
                Candidate.of(name, one.fit, [own.name for own in one.law.parameters])
                for name, one in zip(self.names, self.fits, strict=True)
            ]
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the criteria, then those of the fits, each with the name of its law."""
        own = [
            f"{name}: {warning}" for name, one in zip(self.names, self.fits, strict=True) for warning in one.warnings
        ]
        return (*self.verdict.warnings, *own)

    @property
    def best(self) -> TransientFit:
        """The fit with the least BIC."""
        return self.fits[self.verdict.best]

    def table(self) -> Table:
        """Return the laws with their fit errors, criteria from the least of each, and parameters."""
        verdict = self.verdict
        rows = [
            (
                name,
                fit.fit.rank + 1,
                fit.fit.residual_rms,
                aicc - min(verdict.aicc) if math.isfinite(aicc) else None,
                bic - min(verdict.bic),
                fit.fit.autocorrelation,
                ", ".join(f"{own} {value:.4g}" for own, value in zip(fit.fit.names, fit.fit.values, strict=True)),
            )
            for name, fit, aicc, bic in zip(self.names, self.fits, verdict.aicc, verdict.bic, strict=True)
        ]
        columns = ("law", "estimated", "residual_rms_m", "delta_AICc", "delta_BIC", "autocorrelation", "parameters")
        said = f"best by BIC: {self.names[verdict.best]}"
        if not verdict.settled:
            said = f"the records cannot tell for sure; {said}"
        return Table("laws", "Damping laws", columns, rows, (said, *(f"note: {warning}" for warning in self.warnings)))

    def report(self) -> str:
        """Return the table as text."""
        return self.table().text()

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        verdict = self.verdict
        return {
            "best": self.names[verdict.best],
            "settled": verdict.settled,
            "effective_samples": verdict.effective_samples,
            "laws": [
                {"law": name, "aicc": aicc if math.isfinite(aicc) else None, "bic": bic, **fit.to_dict()}
                for name, fit, aicc, bic in zip(self.names, self.fits, verdict.aicc, verdict.bic, strict=True)
            ],
            "warnings": list(self.warnings),
        }


def compare_laws(
    model: Model,
    records: MarkerRecord | Sequence[MarkerRecord],
    laws: Sequence[DampingLaw],
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
    **settings: Any,
) -> LawComparison:
    """Fit measured motions by several damping laws, and tell which explains them with the least.

    Parameters
    ----------
    model, records
        As of ``fit_transient``.
    laws : sequence of DampingLaw
        The laws with guesses of their parameters, the simplest first.
    executor, jobs, progress
        As of ``run_all``; the laws are fitted at the same time.  With ``jobs`` above 1 a script must call this under
        ``if __name__ == "__main__":``.
    **settings
        Further settings of ``fit_transient``.

    Raises
    ------
    InputError
        If there is no law, or as ``fit_transient``.
    FitError
        If a fit does not converge.
    """
    laws = instances(laws, "laws", DampingLaw)
    tasks = [partial(fit_transient, model, records, law, **settings) for law in laws]
    fits = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="laws")
    return LawComparison(tuple(_name(law) for law in laws), tuple(fits))


def _name(law: DampingLaw) -> str:
    """Return what a law is called in a table."""
    terms = law.laws if isinstance(law, SumOfLaws) else (law,)
    return " + ".join(f"{type(term).__name__}({', '.join(own.name for own in term.parameters)})" for term in terms)
