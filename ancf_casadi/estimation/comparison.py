"""Comparison of laws that were fitted to the same records, by the information criteria of ``criteria``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

from ancf_casadi.estimation.criteria import Candidate, Verdict, judge
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.tables import Displayed, Table, known

F = TypeVar("F", bound=LeastSquaresResult)


@dataclass(frozen=True, eq=False)
class LawComparison(Displayed, Generic[F]):
    """Damping laws that were fitted to the same records.

    Parameters
    ----------
    names : tuple of str
        Name of each law.
    fits : tuple
        Fit of each law.
    terms : tuple of tuple of str
        Names of the unknowns that are the damping parameters of each law.
    failed : mapping of str to str
        Reason for the failure of each law that could not be fitted, by its name; such laws are not among ``names``.
    counted : mapping of str to tuple of str
        Unknowns of a law, by its name, that the criteria count even at a bound.
    priors : mapping of str to float
        Prior probability of a law, by its name, relative to that of the others; 1 if not given.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import compare_decay_laws
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> y = 0.02 / (1.0 + 0.2 * time) * np.cos(12.0 * time) + noise  # quadratic damping
    >>> comparison = compare_decay_laws(time, y, laws=["linear", "quadratic"], frequency_laws=["constant"])
    >>> comparison.names[:2], comparison.best.law
    (('linear', 'quadratic'), 'quadratic')
    >>> print(f"{comparison.best.eta2:.1f} 1/m")
    2.0 1/m
    """

    names: tuple[str, ...]
    fits: tuple[F, ...]
    terms: tuple[tuple[str, ...], ...]
    failed: Mapping[str, str] = field(default_factory=dict)
    counted: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    priors: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """The fits as the criteria see them."""
        return tuple(
            Candidate.of(name, one.fit, terms, self.counted.get(name, ()), self.priors.get(name, 1.0))
            for name, one, terms in zip(self.names, self.fits, self.terms, strict=True)
        )

    @cached_property
    def verdict(self) -> Verdict:
        """Information criteria, and the best law."""
        return judge(self.candidates)

    @property
    def best(self) -> F:
        """Fit with the lowest BIC."""
        return self.fits[self.verdict.best]

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Standard errors of the best fit."""
        return self.best.standard_errors

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the criteria, laws that could not be fitted, and warnings of the best fit."""
        return (*self._choice_warnings, *self.best.warnings)

    @property
    def _choice_warnings(self) -> tuple[str, ...]:
        left_out = (f"the {name} law is left out: {reason}" for name, reason in self.failed.items())
        return (*self.verdict.warnings, *left_out)

    def table(self) -> Table:
        """Return residuals and differences of the criteria from the lowest, one row per law; notes list parameters.

        Laws with long names are numbered in the rows.
        """
        verdict = self.verdict
        numbered = max(map(len, self.names)) > 32  # characters of a law in a table of 100 columns
        labels = [str(k) if numbered else name for k, name in enumerate(self.names, start=1)]
        laws = zip(labels, self.fits, self.candidates, verdict.aicc, verdict.bic, strict=True)
        rows = [
            (
                label,
                candidate.estimated,
                one.fit.residual_rms,
                known(aicc - min(verdict.aicc)),
                bic - min(verdict.bic),
                known(one.fit.autocorrelation),
            )
            for label, one, candidate, aicc, bic in laws
        ]
        columns = ("law", "estimated", "residual_rms", "delta_AICc", "delta_BIC", "autocorrelation")
        heads = [f"{label}: {name}" if numbered else name for label, name in zip(labels, self.names, strict=True)]
        listed = [
            f"{head}: {_parameters(one.fit, terms)}"
            for head, one, terms in zip(heads, self.fits, self.terms, strict=True)
        ]
        best = f"best by BIC: {self.names[verdict.best]}"
        if not verdict.settled:
            best = f"the record does not settle the choice; {best}"
        notes = (*listed, best, *(f"note: {text}" for text in self._choice_warnings))
        return Table("laws", "Damping laws", columns, rows, notes)

    def _summary(self) -> str:
        return f"best {self.names[self.verdict.best]} of {', '.join(self.names)}"

    def report(self) -> str:
        """Return the table and the best fit as text."""
        return f"{self.table().text()}\n\n{self.best.report()}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        verdict = self.verdict
        return {
            "best": self.names[verdict.best],
            "settled": verdict.settled,
            "effective_samples": verdict.effective_samples,
            "laws": [
                {
                    "law": name,
                    "estimated": candidate.estimated,
                    "aicc": known(aicc),
                    "bic": bic,
                    "residual_rms": one.fit.residual_rms,
                    "autocorrelation": known(one.fit.autocorrelation),
                    "at_bound": list(one.fit.at_bound),
                    **one.to_dict(),
                }
                for name, one, candidate, aicc, bic in zip(
                    self.names, self.fits, self.candidates, verdict.aicc, verdict.bic, strict=True
                )
            ],
            "failed": dict(self.failed),
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw the differences of AICc and BIC from their lowest values."""
        from ancf_casadi.estimation.figures import criteria_figure  # matplotlib is slow to import

        return criteria_figure(self.names, self.verdict.aicc, self.verdict.bic)


def _parameters(fit: Fit, terms: tuple[str, ...]) -> str:
    """Return the estimated damping parameters of a law as text, with a mark on those at a bound."""
    estimated = [name for name in terms if name in fit.names]
    return ", ".join(f"{name} {fit[name]:.4g}{' (bound)' * (name in fit.at_bound)}" for name in estimated)
