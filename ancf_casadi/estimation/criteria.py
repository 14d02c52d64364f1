"""Information criteria for models that were fitted to the same samples.

With m residuals that contain as much information as n independent ones, the sum S of their squares, and K estimated
quantities (the free unknowns and the variance of the noise), normal noise gives the criteria

    AICc = n ln(S/m) + 2 K + 2 K (K + 1)/(n - K - 1),    BIC = n ln(S/m) + K ln n.

The lowest value is best.  Only differences have a meaning; a difference of 10 is clear.  A model with an unknown at its
bound is judged as the smaller model without this term, unless this smaller model is a new one: friction and drag
without linear damping have two terms chosen from three.  Of equal models the first is preferred.  A model with a lower
prior probability P has -2 ln P added to its BIC, which approximates -2 ln of the probability of the data.  AICc favours
predictive accuracy and sometimes selects one term too many; BIC finds the true model, if it is among the candidates and
the record is long.  A superfluous term raises BIC by ln n at most, which is rarely clear, so that only a model with no
more free unknowns than the best counts as a rival.

Coloured residuals carry less information on the laws, and criteria that count all m of them overstate the differences.
n is the number of residuals with white noise that would determine the unknowns as well
(``Fit.effective_samples``), which is m for white residuals.  The model with the lowest S gives the best estimate
of the noise.  The n of its residuals is therefore used for all models, as QAIC uses the overdispersion of the most
general model.  Residuals that are not noise, but motion that no model explains, may lead the models astray in ways that
n does not show: if their power is concentrated in the spectrum by a factor c above 3 (``concentration``), n is at most
m/c.

If a smaller model has the lowest criterion, the terms that it lacks need not be absent: in a short or noisy record, a
term as large as the others may cost more than it explains.  The choice is therefore settled only if every other model
either is clearly worse, or has no term that is uncertain by more than a third of the total damping (``vagueness``).

References
----------
K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, Springer (2002), Sections 2.4, 2.5, 6.4.
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.noise import MOST_CONCENTRATION, concentration

LEAST_EXPLAINED = 1 / 3  # ratio n/m below which no law is said to explain all of the motion
LEAST_INDEPENDENT = 2 / 3  # ratio n/m below which a warning states n
MOST_VAGUENESS = 1 / 3  # vagueness of a term beyond which the record does not settle the choice
VERY_STRONG = 10.0  # difference of a criterion that leaves no doubt
EQUAL_CRITERION = 1e-6  # difference of a criterion below which two models are equal


@dataclass(frozen=True)
class Candidate:
    """A fitted model."""

    name: str
    samples: int  # m residuals
    effective_samples: float  # n independent residuals that carry as much information
    residual_rms: float
    rank: int  # number of free unknowns, and of those at a bound that count
    autocorrelation: float  # correlation of successive residuals; nan if unknown
    vagueness: float = 0.0  # largest uncertainty of a damping term relative to the total damping (``vagueness``)
    prior: float = 1.0  # prior probability relative to that of other models

    @classmethod
    def of(
        cls, name: str, fit: Fit, terms: Sequence[str], counted: Sequence[str] = (), prior: float = 1.0
    ) -> Candidate:
        """Return a fit as a candidate.

        ``terms`` are the names of its damping parameters, ``counted`` those of the unknowns that count even at a bound.
        """
        m, narrow = len(fit.residuals), concentration(fit.residuals, fit.series, fit.times)
        return cls(
            name,
            m,
            min(fit.effective_samples, m / narrow if narrow > MOST_CONCENTRATION else m),
            fit.residual_rms,
            fit.rank + len(set(counted) & set(fit.at_bound)),
            fit.autocorrelation,
            vagueness(fit, terms),
            prior,
        )

    @property
    def estimated(self) -> int:
        """Number K of estimated quantities, including the variance of the noise."""
        return self.rank + 1

    def criteria(self, n: float) -> tuple[float, float]:
        """Return AICc and BIC for n independent residuals; AICc is infinite if n is too small."""
        K = self.estimated
        misfit = n * math.log(max(self.residual_rms**2, np.finfo(float).tiny))
        small = 2 * K * (K + 1) / (n - K - 1) if n > K + 1 else math.inf
        return misfit + 2 * K + small, misfit + K * math.log(n) - 2 * math.log(self.prior)


@dataclass(frozen=True)
class Verdict:
    """Result of the comparison of candidates."""

    aicc: tuple[float, ...]  # of each candidate
    bic: tuple[float, ...]
    best: int  # position of the candidate with the lowest BIC
    settled: bool  # no rival is close, no other law may have a large term, and AICc agrees
    effective_samples: float  # effective number n of independent residuals in the criteria
    warnings: tuple[str, ...]  # reasons to doubt the result


def judge(candidates: Sequence[Candidate]) -> Verdict:
    """Compare candidates, given with the simplest first, by their criteria."""
    noise = min(candidates, key=lambda candidate: candidate.residual_rms)
    m, n = noise.samples, noise.effective_samples
    aicc, bic = zip(*(candidate.criteria(n) for candidate in candidates), strict=True)
    best = _least(bic)
    chosen = candidates[best]
    warnings = []
    if not math.isfinite(max(aicc)):
        warnings.append(
            f"the laws cannot be compared: {m} residuals that carry the information of {n:.0f} independent ones are "
            "too few; use a longer record, or laws that explain more of the motion"
        )
    elif _least(aicc) != best:
        warnings.append(
            f"BIC favours the {chosen.name} law, AICc the {candidates[_least(aicc)].name} law: the record does not "
            "settle the choice"
        )
    rivals = [
        (candidate.name, value - bic[best]) for candidate, value in zip(candidates, bic, strict=True)
        if EQUAL_CRITERION < value - bic[best] < VERY_STRONG and candidate.rank <= chosen.rank
    ]  # fmt: skip
    warnings += [
        f"the {name} law is not clearly worse: its BIC is higher by {excess:.2g}, and 10 would be clear"
        for name, excess in rivals
    ]
    for candidate, value in zip(candidates, bic, strict=True):
        if candidate is not chosen and value - bic[best] < VERY_STRONG and candidate.vagueness > MOST_VAGUENESS:
            warnings.append(
                f"the record cannot rule out the {candidate.name} law: one of its terms is uncertain by "
                f"{candidate.vagueness:.0%} of the total damping; a longer record, less noise or a larger release "
                "would help"
            )
    settled = not warnings
    if n < LEAST_INDEPENDENT * m:
        unexplained = ": no law explains all of the motion" if n < LEAST_EXPLAINED * m else ""
        warnings.append(
            f"the residuals of the {noise.name} law are coloured (successive ones correlate at "
            f"{noise.autocorrelation:.2f}), so the criteria count {m} samples as {n:.0f} independent ones{unexplained}"
        )
    return Verdict(aicc, bic, best, settled, n, tuple(warnings))


def vagueness(fit: Fit, names: Sequence[str]) -> float:
    """Return the largest uncertainty among the named unknowns, relative to the effect of all of them on the residuals.

    It is max_k |J_k| w_k / sum_k |J_k| |x_k|, with the columns J_k of the Jacobian, and w_k the longer of the two
    distances from the estimate x_k to the ends of its 95 % interval.
    """
    chosen = [k for k, name in enumerate(fit.names) if name in names]
    if not chosen:
        return 0.0
    sizes = np.linalg.norm(fit.jacobian[:, chosen], axis=0)
    wide = np.abs(fit.intervals()[chosen] - fit.values[chosen, None]).max(axis=1)
    total = float(sizes @ np.abs(fit.values[chosen]))
    return float((sizes * wide).max()) / total if total > 0.0 else math.inf


def _least(criterion: Sequence[float]) -> int:
    """Return the position of the lowest value; of equal ones, the first."""
    return int(np.argmax(np.asarray(criterion) <= min(criterion) + EQUAL_CRITERION))
