"""Which of several models, fitted to the same samples, the samples speak for.

With m residuals that are worth n independent ones, the sum S of their squares, and K quantities estimated, the noise
counted and an unknown at its bound not, normal noise gives the information criteria

    AICc = n ln(S/m) + 2 K + 2 K (K + 1)/(n - K - 1),    BIC = n ln(S/m) + K ln n.

The least is best; by itself it means nothing, a difference of 10 is clear.  An unknown at its bound is a term left out,
so that a model with such a one is judged as the smaller model it has become; of equal models the first is preferred.
AICc favours predictive accuracy and sometimes selects one term too many; BIC finds the true model, if it is among the
candidates and the record long.  A term too many costs ln n at most, so that only a model with fewer can be a rival.

Where residuals correlate, they repeat each other, and differences that count all m of them are overstated.  With their
autocorrelation rho_k, up to the last lag M at which it is significant,

    n = m/(1 + 2 sum_(k <= M) |rho_k|)                                        (``autocorrelation``),

which is m for white residuals.  The residuals of the model that leaves least are the best estimate of the noise, so
that n is theirs for all models, as the overdispersion of QAIC is that of the most general model.

That a smaller model has the least criterion does not mean that the terms it lacks are not there: where the record is
short or noisy, they may be as large as the others and cost more than they explain.  So the record can tell only if no
model that is not clearly worse has a term that may be off by a third of all damping (``Fit.vagueness``, which takes the
residuals to be white, times (m/n)^1/2).

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

from ancf_casadi.estimation.fit import COLOURED, Fit

DEPENDENT = 2 / 3  # share of the residuals below which it is said how many they are worth
VAGUE = 1 / 3  # share of all damping that a term may be off by
CLEAR = 10.0  # difference of a criterion that leaves no doubt
SAME = 1e-6  # difference below which two models are one


@dataclass(frozen=True)
class Candidate:
    """A model that was fitted.

    Parameters
    ----------
    name : str
        What it is called.
    samples : int
        Number m of residuals.
    effective_samples : float
        Number of independent residuals that they are worth.
    residual_rms : float
        Root of their mean square.
    rank : int
        Unknowns estimated, those at a bound not counted.
    autocorrelation : float
        Correlation of successive residuals.
    vagueness : float
        Share of all damping that one of its terms may be off by, if the residuals are white.
    """

    name: str
    samples: int
    effective_samples: float
    residual_rms: float
    rank: int
    autocorrelation: float
    vagueness: float = 0.0

    @classmethod
    def of(cls, name: str, fit: Fit, terms: Sequence[str]) -> Candidate:
        """Return a fit as a candidate, with the names of the unknowns that are its damping."""
        return cls(
            name,
            len(fit.residuals),
            fit.effective_samples,
            fit.residual_rms,
            fit.rank,
            fit.autocorrelation,
            fit.vagueness(terms),
        )

    @property
    def estimated(self) -> int:
        """Number of quantities estimated, the variance of the noise being one."""
        return self.rank + 1

    def criteria(self, n: float) -> tuple[float, float]:
        """Return AICc and BIC for residuals that are worth n independent ones; infinite AICc where n is too few."""
        K = self.estimated
        misfit = n * math.log(max(self.residual_rms**2, np.finfo(float).tiny))
        small = 2 * K * (K + 1) / (n - K - 1) if n > K + 1 else math.inf
        return misfit + 2 * K + small, misfit + K * math.log(n)


@dataclass(frozen=True)
class Verdict:
    """What the criteria say.

    Parameters
    ----------
    aicc, bic : tuple of float
        Information criteria of each candidate.
    best : int
        The one with the least BIC.
    settled : bool
        Whether the record can tell: no other comes near, none hides a term as large, and AICc agrees.
    effective_samples : float
        Number n of independent residuals that the criteria count.
    warnings : tuple of str
        What to know before believing it.
    """

    aicc: tuple[float, ...]
    bic: tuple[float, ...]
    best: int
    settled: bool
    effective_samples: float
    warnings: tuple[str, ...]


def judge(candidates: Sequence[Candidate]) -> Verdict:
    """Compare candidates by their criteria, the simplest of them first."""
    noise = min(candidates, key=lambda candidate: candidate.residual_rms)
    m, n = noise.samples, noise.effective_samples
    aicc, bic = zip(*(candidate.criteria(n) for candidate in candidates), strict=True)
    best = _least(bic)
    chosen = candidates[best]
    warnings = []
    if not math.isfinite(max(aicc)):
        warnings.append(f"{m} residuals that are worth {n:.0f} independent ones are too few to judge the laws by")
    elif _least(aicc) != best:
        warnings.append(f"AICc prefers the {candidates[_least(aicc)].name} law: the record does not settle it")
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
                f"the record cannot rule out the {candidate.name} law: a term of it may be off by {vague:.0%} of all "
                "damping"
            )
    settled = not warnings
    if n < DEPENDENT * m:
        rho = chosen.autocorrelation
        warnings.append(
            f"successive residuals of the best law correlate at {rho:.2f}, and the criteria count {m} samples as "
            f"{n:.0f}{': no law tells all' if rho > COLOURED else ''}"
        )
    return Verdict(aicc, bic, best, settled, n, tuple(warnings))


def _least(criterion: Sequence[float]) -> int:
    """Return the position of the first that is the least."""
    return int(np.argmax(np.asarray(criterion) <= min(criterion) + SAME))
