"""Information criteria and probabilities of models that were fitted to the same samples.

With m residuals that contain as much information as n independent ones, the sum S of their squares, and K estimated
quantities (the free unknowns and the variance of the noise), normal noise gives the criteria

    AICc = n ln(S/m) + 2 K + 2 K (K + 1)/(n - K - 1),    BIC = n ln(S/m) + K ln n,

of which only differences have a meaning.  Weights of either are no probabilities: they treat a term that the record
cannot show like one that it excludes (docs/theory.md).  If all models were equally probable before, and each unknown
x_k uniformly distributed over a width W_k, the integral of the likelihood by Laplace's method gives the probabilities

    P = exp(-D/2)/sum of exp(-D/2) over all models,        D = n ln(S/m) + ln det(I + W J'J W n/(2 pi S)).

A term that the record hardly shows does not change D, and one that it shows well costs more the wider its prior is.
Damping terms may have any share of the damping: W_k |J_k| = sum |J_j| |x_j| over the damping terms j, with the columns
J_j of the Jacobian.  Another unknown has the width between its bounds or, without these, one that moves the curve by
about its own size: W_k |J_k| is the largest of their |J_j| times scale.  I keeps the integral below the largest
likelihood.  The choice is settled if the best model has a probability of at least 95 %.  Of equal models the first is
preferred.

Coloured residuals carry less information on the laws, and criteria that count all m of them overstate the differences.
n is the number of residuals with white noise that would determine the unknowns as well
(``Fit.effective_samples``), which is m for white residuals.  The model with the lowest S gives the best estimate
of the noise.  The n of its residuals is therefore used for all models, as QAIC uses the overdispersion of the most
general model.  Residuals that are not noise, but motion that no model explains, may lead the models astray in ways that
n does not show: if their power is concentrated in the spectrum by a factor c above 3 (``concentration``), n is at most
m/c.

The probability that a record tells two laws apart is known before it is measured (``expectation``).  The rival, fitted
to the record of the true law without noise, leaves the residuals d.  With noise e, in standard deviations, a law leaves

    S = min |d + e + J y|^2    over changes y of its unknowns within their bounds,

and d = 0 for the true one.  If no bound is near and the rival is a special case, S_rival - S_true is noncentral
chi-squared.  D differs by n ln(S_rival/S_true) and the determinants; its distribution comes from draws of e in the few
dimensions of d and the columns of both J.  Of the bounds, those count that the noise may reach.

References
----------
K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, Springer (2002), Sections 2.4, 2.5, 6.4.
R. E. Kass, A. E. Raftery, Bayes factors, Journal of the American Statistical Association 90 (1995).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.linalg import orth

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.noise.series import MOST_CONCENTRATION, concentration
from ancf_casadi.support.arrays import Array

LEAST_EXPLAINED = 1 / 3  # ratio n/m below which no law is said to explain all of the motion
LEAST_INDEPENDENT = 2 / 3  # ratio n/m below which a warning states n
SETTLED = 0.95  # probability from which a choice is settled
DRAWS = 20_000  # of the noise, which give a probability within 0.004
WITHIN_REACH = 4.0  # distance of a bound, in standard errors, that noise hardly covers
MOST_BOUNDED = 6  # unknowns near bounds, of which every subset may be at them
EQUAL_EVIDENCE = 1e-6  # difference below which two models are equal


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted model."""

    name: str
    samples: int  # m residuals
    effective_samples: float  # n independent residuals that carry as much information
    residual_rms: float
    rank: int  # number of free unknowns
    autocorrelation: float  # correlation of successive residuals; nan if unknown
    information: Array = field(default_factory=lambda: np.zeros((0, 0)))  # W J'J W/(2 pi S), per independent residual

    @classmethod
    def of(cls, name: str, fit: Fit, terms: Sequence[str], negligible: float = 0.0) -> Candidate:
        """Return a fit as a candidate; ``terms`` are the names of its damping terms.

        ``negligible`` is the norm of residuals below which smaller ones are no evidence.
        """
        square = max(float(fit.residuals @ fit.residuals), negligible**2)
        m, narrow = len(fit.residuals), concentration(fit.residuals, fit.series, fit.times)
        return cls(
            name,
            m,
            min(fit.effective_samples, m / narrow if narrow > MOST_CONCENTRATION else m),
            math.sqrt(square / m),
            fit.rank,
            fit.autocorrelation,
            _information(fit, terms, square),
        )

    @property
    def estimated(self) -> int:
        """Number K of estimated quantities, including the variance of the noise."""
        return self.rank + 1

    def misfit(self, n: float) -> float:
        """Return n ln(S/m) for n independent residuals."""
        return n * math.log(max(self.residual_rms**2, np.finfo(float).tiny))

    def criteria(self, n: float) -> tuple[float, float]:
        """Return AICc and BIC for n independent residuals; AICc is infinite if n is too small."""
        K = self.estimated
        small = 2 * K * (K + 1) / (n - K - 1) if n > K + 1 else math.inf
        return self.misfit(n) + 2 * K + small, self.misfit(n) + K * math.log(n)

    def evidence(self, n: float) -> float:
        """Return -D/2, the logarithm of the integral of the likelihood but for a constant of the record."""
        return -(self.misfit(n) + _spread(self.information, n)) / 2


@dataclass(frozen=True)
class Verdict:
    """Result of the comparison of candidates."""

    aicc: tuple[float, ...]  # of each candidate
    bic: tuple[float, ...]
    evidence: tuple[float, ...]
    best: int  # position of the most probable candidate
    settled: bool  # its probability is at least 95 %
    effective_samples: float  # effective number n of independent residuals in the criteria
    warnings: tuple[str, ...]  # reasons to doubt the result

    @property
    def probabilities(self) -> Array:
        """Probability of each candidate."""
        weights = np.exp(np.array(self.evidence) - max(self.evidence))
        return np.asarray(weights / weights.sum())


def judge(candidates: Sequence[Candidate]) -> Verdict:
    """Compare candidates, given with the simplest first, by their criteria."""
    noise = min(candidates, key=lambda candidate: candidate.residual_rms)
    m, n = noise.samples, noise.effective_samples
    aicc, bic = zip(*(candidate.criteria(n) for candidate in candidates), strict=True)
    evidence = tuple(candidate.evidence(n) for candidate in candidates)
    best = int(np.argmax(np.array(evidence) >= max(evidence) - EQUAL_EVIDENCE))
    verdict = Verdict(aicc, bic, evidence, best, True, n, ())
    probabilities, warnings = verdict.probabilities, []
    if not math.isfinite(max(aicc)):
        warnings.append(
            f"the laws cannot be compared: {m} residuals, worth {n:.0f} independent ones, are too few; "
            "use a longer record, or laws that explain more of the motion"
        )
    elif probabilities[verdict.best] < SETTLED:
        order = np.argsort(-probabilities, kind="stable")
        several = order[: 1 + int(np.argmax(np.cumsum(probabilities[order]) >= SETTLED))].tolist()
        listed = ", ".join(f"{candidates[k].name} {probabilities[k]:.2g}" for k in several)
        warnings.append(f"the record leaves the choice of the law open; probabilities: {listed}")
    settled = not warnings
    if n < LEAST_INDEPENDENT * m:
        unexplained = ": no law explains all of the motion" if n < LEAST_EXPLAINED * m else ""
        warnings.append(
            f"the residuals of the {noise.name} law are coloured (successive ones correlate at "
            f"{noise.autocorrelation:.2f}), so the criteria count {m} samples as {n:.0f} independent ones{unexplained}"
        )
    return replace(verdict, settled=settled, warnings=tuple(warnings))


@dataclass(frozen=True)
class Expectation:
    """The comparison of a true law and a rival to be expected of records."""

    difference: float  # mean of D of the rival less that of the true law
    right: float  # probability of the right choice: that the true law becomes the more probable one


def expectation(
    fits: Sequence[Fit], terms: Sequence[Sequence[str]], change: Array, std: float, growth: float, count: int = 1
) -> Expectation:
    """Return what a comparison of two fitted laws on ``count`` equal records will find if the first one is true.

    ``change`` (m,) is the residuals of the rival without noise, ``std`` that of the noise, and ``growth`` that of the
    variances by its colour; ``terms`` are those of both laws.
    """
    n, unit = count * len(change) / growth, std * math.sqrt(growth / count)
    squares = [len(change) * std**2 + extra for extra in (0.0, float(change @ change))]
    spreads = [
        _spread(_information(fit, law_terms, square), n)
        for fit, law_terms, square in zip(fits, terms, squares, strict=True)
    ]
    span = orth(np.column_stack([_unit(columns) for columns in (fits[0].jacobian, fits[1].jacobian, change[:, None])]))
    noise = np.random.default_rng(0).standard_normal((DRAWS, span.shape[1]))
    squares_of_truth, squares_of_rival = (
        _squares(fit, noise + shift @ span / unit, span, unit)
        for fit, shift in zip(fits, (0 * change, change), strict=True)
    )
    lag = n * np.log1p(np.maximum((squares_of_rival - squares_of_truth) / n, -0.5)) + spreads[1] - spreads[0]
    return Expectation(float(lag.mean()), float(np.mean(lag > 0.0)))


def _unit(columns: Array) -> Array:
    """Return columns (m, k) with unit lengths; those of zeros stay."""
    lengths = np.linalg.norm(columns, axis=0)
    return np.asarray(columns / np.where(lengths > 0.0, lengths, 1.0))


def _squares(fit: Fit, residuals: Array, span: Array, unit: float) -> Array:
    """Return the sums of squares (N,) that a law leaves of residuals (N, k) in a basis (m, k), in stds of the noise."""
    ends = np.array([fit.lower, fit.upper]) - fit.values
    error = unit * np.linalg.norm(np.linalg.pinv(np.linalg.qr(fit.jacobian, mode="r")), axis=1)
    room = np.abs(ends).min(axis=0) / np.maximum(error, np.finfo(float).tiny)  # to the nearer bound
    order = np.argsort(-room)
    bounded = min(int(np.count_nonzero(room < WITHIN_REACH)), MOST_BOUNDED)
    basis, triangle = np.linalg.qr(fit.jacobian[:, order] / unit)
    along = residuals @ (span.T @ basis)
    split = len(order) - bounded
    tail, T, near_ends = along[:, split:], triangle[split:, split:], ends[:, order[split:]]
    nearer_ends = np.where(-near_ends[0] < near_ends[1], near_ends[0], near_ends[1])
    least_squares = np.full(len(residuals), math.inf)
    for at_bound in product((False, True), repeat=bounded):
        at = np.array(at_bound, dtype=bool)
        free = ~at
        target = tail + T[:, at] @ nearer_ends[at]
        steps = -target @ np.linalg.pinv(T[:, free]).T
        inside = ((steps >= near_ends[0, free]) & (steps <= near_ends[1, free])).all(axis=1)
        squares = np.sum((target + steps @ T[:, free].T) ** 2, axis=1)
        least_squares = np.where(inside, np.minimum(least_squares, squares), least_squares)
    return np.asarray(np.sum(residuals**2, axis=1) - np.sum(along**2, axis=1) + least_squares)


def _spread(information: Array, n: float) -> float:
    """Return ln det(I + n H) with the information H of an independent residual."""
    return float(np.linalg.slogdet(np.eye(len(information)) + n * information)[1])


def _information(fit: Fit, terms: Sequence[str], square: float) -> Array:
    """Return W J'J W/(2 pi S) of all unknowns (k, k); ``terms`` are the names of the damping terms."""
    damping = np.array([name in terms for name in fit.names])
    sizes = np.maximum(np.linalg.norm(fit.jacobian, axis=0), np.finfo(float).tiny)
    unbounded, total = ~damping & np.isinf(fit.upper - fit.lower), float(sizes[damping] @ np.abs(fit.values[damping]))
    moved = float((sizes * fit.scale)[unbounded].max(initial=0.0))
    widths = np.where(unbounded, moved / sizes, np.where(damping, total / sizes, fit.upper - fit.lower))
    columns = fit.jacobian * widths
    return np.asarray(columns.T @ columns / max(2 * math.pi * square, np.finfo(float).tiny))
