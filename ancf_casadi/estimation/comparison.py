"""Comparison of laws that were fitted to the same records, by the information criteria of ``criteria``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.special import ndtr, ndtri

from ancf_casadi.estimation.criteria import Candidate, Expectation, Verdict, expectation, judge
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, drawing
from ancf_casadi.support.tables import Reported, Table, finite_or_none

F = TypeVar("F", bound=LeastSquaresResult)
LIKE_RECORDS = (2, 5)  # numbers of like records whose power is stated
RULED_OUT = 1e-3  # probability below which a law does not count in a mean over laws


@dataclass(frozen=True, eq=False)
class LawComparison(Reported, Generic[F]):
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
    other_records : callable, optional
        Function of the places of two laws in ``names`` that returns, by the name of another record, what a comparison
        on it is expected to find if the first law is true.

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

    _drawing = "ancf_casadi.estimation.comparison.comparison_figure"

    names: tuple[str, ...]
    fits: tuple[F, ...]
    terms: tuple[tuple[str, ...], ...]
    failed: Mapping[str, str] = field(default_factory=dict)
    other_records: Callable[[int, int], Mapping[str, Expectation]] | None = None

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """The fits as the criteria see them."""
        return tuple(
            Candidate.of(name, fit.fit, terms, fit.negligible)
            for name, fit, terms in zip(self.names, self.fits, self.terms, strict=True)
        )

    @cached_property
    def verdict(self) -> Verdict:
        """Information criteria and probabilities, and the best law."""
        return judge(self.candidates)

    @property
    def best(self) -> F:
        """Fit with the most probable law."""
        return self.fits[self.verdict.best]

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each law by name, if all were equally probable before."""
        return dict(zip(self.names, self.verdict.probabilities.tolist(), strict=True))

    @property
    def probable(self) -> tuple[tuple[float, F], ...]:
        """Probability and fit of each law that is not ruled out; the probabilities sum to 1."""
        pairs = zip(self.verdict.probabilities.tolist(), self.fits, strict=True)
        possible = [(probability, fit) for probability, fit in pairs if probability > RULED_OUT]
        total = sum(probability for probability, _ in possible)
        return tuple((probability / total, fit) for probability, fit in possible)

    @cached_property
    def deciding(self) -> dict[str, float]:
        """Probability that other records lead to the right choice between the two most probable laws, by their name.

        Each of the two is true with its probability, and with its estimates.  Laws that fit the same curve count as
        one.  Empty if the choice is settled.
        """
        first, *less_probable = sorted(range(len(self.fits)), key=lambda k: -self.verdict.evidence[k])
        fitted = self.fits[first].fit.residuals
        second = next((k for k in less_probable if not np.allclose(self.fits[k].fit.residuals, fitted, atol=0.0)), None)
        if self.verdict.settled or second is None:
            return {}
        p, q = self.verdict.probabilities[[first, second]].tolist()
        if_first, if_second = (self._expectations(*pair) for pair in ((first, second), (second, first)))
        in_both = [name for name in if_first if name in if_second]
        return {name: (p * if_first[name].right + q * if_second[name].right) / (p + q) for name in in_both}

    def _expectations(self, truth: int, rival: int) -> dict[str, Expectation]:
        """Return what other records would show if one law is true, as far as both laws can be fitted to them."""
        return self._by_repetition(truth, rival) | dict(self.other_records(truth, rival) if self.other_records else {})

    def _by_repetition(self, truth: int, rival: int) -> dict[str, Expectation]:
        """Return what several records like the fitted ones would show if one law is true."""
        fits, terms = [self.fits[k].fit for k in (truth, rival)], [self.terms[k] for k in (truth, rival)]
        change = fits[1].residuals - fits[0].residuals
        growth = self.candidates[truth].samples / self.verdict.effective_samples
        std = min(candidate.residual_rms for candidate in self.candidates)
        return {f"{count} records": expectation(fits, terms, change, std, growth, count) for count in LIKE_RECORDS}

    def predict(self, record: Any) -> RecordPrediction:
        """Compute another record with each law that is not ruled out, and compare the mean over the laws.

        The laws count by their probabilities.  The squared standard errors are the mean of those under each law, plus
        the variance between the laws.

        Raises
        ------
        InputError, FitError
            As in ``predict`` of the fits.
        """
        weights, fits = zip(*self.probable, strict=True)
        predictions = [fit.predict(record) for fit in fits]
        channels = []
        for by_law in zip(*(prediction.channels for prediction in predictions), strict=True):
            mean = sum(p * channel.predicted for p, channel in zip(weights, by_law, strict=True))
            variance: Any = sum(
                p * (channel.errors**2 + np.abs(channel.predicted - mean) ** 2)
                for p, channel in zip(weights, by_law, strict=True)
            )
            channels.append(replace(by_law[int(np.argmax(weights))], predicted=mean, errors=np.sqrt(variance)))
        notes = dict.fromkeys(note for prediction in predictions for note in prediction.notes)
        return RecordPrediction(predictions[0].kind, tuple(channels), tuple(notes))

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
        numbered = max(map(len, self.names)) > 22  # characters of a law in a table of 100 columns
        labels = [str(k) if numbered else name for k, name in enumerate(self.names, start=1)]
        rows = [
            (label, row["estimated"], round(row["probability"], 4), row["residual_rms"],
             finite_or_none(aicc - min(verdict.aicc)), row["bic"] - min(verdict.bic), row["autocorrelation"])
            for label, row, aicc in zip(labels, self._laws(), verdict.aicc, strict=True)
        ]  # fmt: skip
        columns = ("law", "estimated", "probability", "residual_rms", "delta_AICc", "delta_BIC", "autocorrelation")
        heads = [f"{label}: {name}" if numbered else name for label, name in zip(labels, self.names, strict=True)]
        listed = [
            f"{head}: {_parameters(fit.fit, terms)}"
            for head, fit, terms in zip(heads, self.fits, self.terms, strict=True)
        ]
        notes = [*listed, f"most probable: {self.names[verdict.best]}"]
        if self.deciding:
            powers = ", ".join(f"{name} {probability:.2g}" for name, probability in self.deciding.items())
            notes.append(f"probability of the right choice of the two most probable, with other records: {powers}")
        notes += [f"note: {text}" for text in self._choice_warnings]
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
            "kind": "law comparison",
            "best": self.names[verdict.best],
            "settled": verdict.settled,
            "deciding": self.deciding,
            "effective_samples": verdict.effective_samples,
            "laws": [
                {**fit.to_dict(), **row, "at_bound": list(fit.fit.at_bound)}
                for row, fit in zip(self._laws(), self.fits, strict=True)
            ],
            "failed": dict(self.failed),
            "warnings": list(self.warnings),
        }

    def _laws(self) -> list[dict[str, Any]]:
        """Return the numbers by which the laws are compared, None for unknown ones."""
        verdict = self.verdict
        columns = {
            "law": self.names,
            "estimated": [candidate.estimated for candidate in self.candidates],
            "probability": verdict.probabilities.tolist(),
            "aicc": map(finite_or_none, verdict.aicc),
            "bic": verdict.bic,
            "residual_rms": [fit.fit.residual_rms for fit in self.fits],
            "autocorrelation": [finite_or_none(fit.fit.autocorrelation) for fit in self.fits],
        }
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def comparison_figure(comparisons: Mapping[str, LawComparison[Any]]) -> Figure:
    """Draw the differences of AICc and BIC from their lowest values, by label; those of one with probabilities."""
    names = dict.fromkeys(name for comparison in comparisons.values() for name in comparison.names)
    criteria = {}
    for label, comparison in comparisons.items():
        for criterion, values in (("AICc", comparison.verdict.aicc), ("BIC", comparison.verdict.bic)):
            by_law = dict(zip(comparison.names, values, strict=True))
            criteria[f"{label} {criterion}".strip()] = [by_law.get(name, math.nan) for name in names]
    if len(comparisons) == 1:
        (comparison,) = comparisons.values()
        names = {f"{name}, {round(100 * share, 2):g} %": None for name, share in comparison.probabilities.items()}
    return drawing("ancf_casadi.figures.fits.criteria_figure")([*names], criteria)


def mixed_ends(weights: Array, values: Array, ends: Array, level: float) -> Array:
    """Return the ends (q, 2) of intervals of mixtures of distributions, whose quantiles are halves of normal ones.

    ``weights`` (k,) sum to 1; ``values`` (k, q) are the medians and ``ends`` (k, q, 2) the intervals of the parts.
    """
    quantile, interval_ends = float(ndtri((1 + level) / 2)), []
    below, above = (np.maximum(np.abs(ends[..., j] - values), np.finfo(float).tiny) / quantile for j in (0, 1))
    for side, share in ((0, (1 - level) / 2), (1, (1 + level) / 2)):
        low, high = ends[..., side].min(axis=0), ends[..., side].max(axis=0)
        for _ in range(60):  # bisection, to rounding
            middle = (low + high) / 2
            distance = middle - values
            inside = weights @ ndtr(distance / np.where(distance < 0, below, above))
            low, high = np.where(inside < share, middle, low), np.where(inside < share, high, middle)
        interval_ends.append((low + high) / 2)
    return np.stack(interval_ends, axis=1)


def _parameters(fit: Fit, terms: tuple[str, ...]) -> str:
    """Return the estimated damping parameters of a law as text, with a mark on those at a bound."""
    estimated = [unknown for unknown in fit.unknowns if unknown.name in terms]
    texts = []
    for unknown in estimated:
        name, _, factor = unknown.report
        texts.append(f"{name} {factor * fit[unknown.name]:.4g}{' (bound)' * (unknown.name in fit.at_bound)}")
    return ", ".join(texts)
