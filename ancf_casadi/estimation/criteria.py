"""Information criteria for models that were fitted to the same samples.

With m residuals that contain as much information as n independent ones, the sum S of their squares, and K estimated
quantities, the variance of the noise counted and an unknown at its bound not, normal noise gives the criteria

    AICc = n ln(S/m) + 2 K + 2 K (K + 1)/(n - K - 1),    BIC = n ln(S/m) + K ln n.

The lowest is best.  Only differences have a meaning; a difference of 10 is clear.  An unknown at its bound is a term
left out, so that its model is judged as the smaller model it has become; of equal models the first is preferred.  AICc
favours predictive accuracy and sometimes selects one term too many; BIC finds the true model, if it is among the
candidates and the record is long.  A term too many costs ln n at most, so that only a model with fewer can be a rival.

Correlated residuals repeat each other, and criteria that count all m of them overstate the differences.  With their
autocorrelation rho_k, up to the last lag M at which it is significant,

    n = m/(1 + 2 sum_(k <= M) |rho_k|)                                        (``autocorrelation``),

which is m for white residuals.  The residuals of the model with the lowest S are the best estimate of the noise.  Their
n is therefore used for all models, as QAIC uses the overdispersion of the most general model.

A smaller model with the lowest criterion does not prove that the terms it lacks are absent.  If the record is short or
noisy, they may be as large as the others and cost more than they explain.  The record can therefore decide only if no
model that is not clearly worse has a term that is uncertain by a third of the total damping (``vagueness``, which
assumes white residuals, times (m/n)^1/2).

References
----------
K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, Springer (2002), Sections 2.4, 2.5, 6.4.
G. V. Bayley, J. M. Hammersley, The "effective" number of independent observations in an autocorrelated time series,
Supplement to the Journal of the Royal Statistical Society 8 (1946).
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.estimation.autocorrelation import COLOURED
from ancf_casadi.estimation.estimates import Estimates

DEPENDENT = 2 / 3  # ratio n/m below which n is reported
VAGUE = 1 / 3  # vagueness of a term beyond which the record cannot decide
CLEAR = 10.0  # difference of a criterion that leaves no doubt
SAME = 1e-6  # difference of a criterion below which two models are equal


@dataclass(frozen=True)
class Candidate:
    """A fitted model.

    Parameters
    ----------
    name : str
        Name of the model.
    samples : int
        Number m of residuals.
    effective_samples : float
        Number n of independent residuals with the same information.
    residual_rms : float
        Root mean square of the residuals.
    rank : int
        Number of free unknowns.
    autocorrelation : float
        Correlation of successive residuals.
    vagueness : float
        Largest uncertainty of a damping term relative to all damping, for white residuals (``vagueness``).
    """

    name: str
    samples: int
    effective_samples: float
    residual_rms: float
    rank: int
    autocorrelation: float
    vagueness: float = 0.0

    @classmethod
    def of(cls, name: str, fit: Estimates, terms: Sequence[str]) -> Candidate:
        """Return a fit as a candidate; ``terms`` are the names of its damping parameters."""
        return cls(
            name,
            len(fit.residuals),
            fit.effective_samples,
            fit.residual_rms,
            fit.rank,
            fit.autocorrelation,
            vagueness(fit, terms),
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
        return misfit + 2 * K + small, misfit + K * math.log(n)


@dataclass(frozen=True)
class Verdict:
    """Result of the comparison of candidates.

    Parameters
    ----------
    aicc, bic : tuple of float
        Information criteria of each candidate.
    best : int
        Position of the candidate with the lowest BIC.
    settled : bool
        Whether the record decides: no rival is close, none may have a large term, and AICc agrees.
    effective_samples : float
        Number n of independent residuals that the criteria count.
    warnings : tuple of str
        Reasons to doubt the result.
    """

    aicc: tuple[float, ...]
    bic: tuple[float, ...]
    best: int
    settled: bool
    effective_samples: float
    warnings: tuple[str, ...]


def judge(candidates: Sequence[Candidate]) -> Verdict:
    """Compare candidates by their criteria; the simplest comes first."""
    noise = min(candidates, key=lambda candidate: candidate.residual_rms)
    m, n = noise.samples, noise.effective_samples
    aicc, bic = zip(*(candidate.criteria(n) for candidate in candidates), strict=True)
    best = _least(bic)
    chosen = candidates[best]
    warnings = []
    if not math.isfinite(max(aicc)):
        warnings.append(f"{m} residuals that are worth {n:.0f} independent ones are too few to judge the laws by")
    elif _least(aicc) != best:
        warnings.append(f"AICc prefers the {candidates[_least(aicc)].name} law: the record does not settle the choice")
    rivals = [
        candidate.name for candidate, value in zip(candidates, bic, strict=True)
        if SAME < value - bic[best] < CLEAR and candidate.rank <= chosen.rank
    ]  # fmt: skip
    if rivals:
        warnings.append(f"the {rivals[0]} law is not clearly worse")
    for candidate, value in zip(candidates, bic, strict=True):
        vague = candidate.vagueness * math.sqrt(m / n)
        if candidate is not chosen and value - bic[best] < CLEAR and vague > VAGUE:
            warnings.append(
                f"the record cannot rule out the {candidate.name} law: one of its terms is uncertain by {vague:.0%} of "
                "the total damping"
            )
    settled = not warnings
    if n < DEPENDENT * m:
        unexplained = ": no law explains all of the motion" if n < COLOURED * m else ""
        warnings.append(
            f"successive residuals of the best law correlate at {chosen.autocorrelation:.2f}, and the criteria count "
            f"{m} samples as {n:.0f}{unexplained}"
        )
    return Verdict(aicc, bic, best, settled, n, tuple(warnings))


def vagueness(fit: Estimates, names: Sequence[str]) -> float:
    """Return the largest uncertainty of one of some unknowns, relative to the effect of all of them on the residuals.

    With columns J_k of the Jacobian, and the wider side w_k of the interval, max |J_k| w_k / sum |J_k| |x_k|.
    """
    chosen = [k for k, name in enumerate(fit.names) if name in names]
    if not chosen:
        return 0.0
    sizes = np.linalg.norm(fit.jacobian[:, chosen], axis=0)
    wide = np.abs(fit.intervals()[chosen] - fit.values[chosen, None]).max(axis=1)
    total = float(sizes @ np.abs(fit.values[chosen]))
    return float((sizes * wide).max()) / total if total > 0.0 else math.inf


def _least(criterion: Sequence[float]) -> int:
    """Return the position of the first of the lowest."""
    return int(np.argmax(np.asarray(criterion) <= min(criterion) + SAME))
