"""Which of several models, fitted to the same samples, the samples speak for.

With m samples, the sum S of squared residuals, and K quantities estimated, the noise counted and an unknown at its
bound not, normal white noise gives the information criteria

    AICc = m ln(S/m) + 2 K + 2 K (K + 1)/(m - K - 1),    BIC = m ln(S/m) + K ln m.

The least is best; by itself it means nothing, a difference of 10 is clear.  An unknown at its bound is a term left out,
so that a model with such a one is judged as the smaller model it has become; of equal models the first is preferred.
AICc seeks the model that predicts best, and takes a term too many now and then; BIC finds the true one, if it is among
them and the record long.  A term too many costs ln m at most, so that only a model with fewer can be a rival.  Both
count m independent residuals.  Where successive ones correlate at rho, there are about m (1 - rho)/(1 + rho), and
differences are overstated by the inverse of that: the verdict then says so.

That a smaller model has the least criterion does not mean that the terms it lacks are not there: where the record is
short or noisy, they may be as large as the others and cost more than they explain.  So the record can tell only if no
model that is not clearly worse has a term that may be off by a third of all damping (``Fit.vagueness``).

References
----------
K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, Springer (2002), Sections 2.4, 6.4.
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.fit import COLOURED

COLOURED_CHOICE = 0.2  # that beyond which there are a third fewer of them
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
        How many residuals there are.
    residual_rms : float
        Root of their mean square.
    rank : int
        Unknowns estimated, those at a bound not counted.
    autocorrelation : float
        Correlation of successive residuals.
    vagueness : float
        Share of all damping that one of its terms may be off by.
    """

    name: str
    samples: int
    residual_rms: float
    rank: int
    autocorrelation: float
    vagueness: float = 0.0

    @property
    def estimated(self) -> int:
        """How many quantities were estimated, the variance of the noise being one."""
        return self.rank + 1

    @property
    def criteria(self) -> tuple[float, float]:
        """AICc and BIC."""
        m, K = self.samples, self.estimated
        misfit = m * math.log(max(self.residual_rms**2, np.finfo(float).tiny))
        small = 2 * K * (K + 1) / (m - K - 1) if m > K + 1 else math.inf
        return misfit + 2 * K + small, misfit + K * math.log(m)


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
    warnings : tuple of str
        What to know before believing it.
    """

    aicc: tuple[float, ...]
    bic: tuple[float, ...]
    best: int
    settled: bool
    warnings: tuple[str, ...]


def judge(candidates: Sequence[Candidate]) -> Verdict:
    """Compare candidates by their criteria, the simplest of them first."""
    aicc, bic = zip(*(candidate.criteria for candidate in candidates), strict=True)
    best = _least(bic)
    chosen = candidates[best]
    warnings = []
    if _least(aicc) != best:
        warnings.append(f"AICc prefers the {candidates[_least(aicc)].name} law: the record does not settle it")
    rivals = [
        candidate.name for candidate, value in zip(candidates, bic, strict=True)
        if SAME < value - bic[best] < CLEAR and candidate.rank <= chosen.rank
    ]  # fmt: skip
    if rivals:
        warnings.append(f"the {rivals[0]} law is not clearly worse")
    warnings += [
        f"the record cannot rule out the {candidate.name} law: a term of it may be off by {candidate.vagueness:.0%} of "
        "all damping"
        for candidate, value in zip(candidates, bic, strict=True)
        if candidate is not chosen and value - bic[best] < CLEAR and candidate.vagueness > VAGUE
    ]
    settled = not warnings
    rho = chosen.autocorrelation
    if rho > max(COLOURED_CHOICE, 3 / math.sqrt(chosen.samples)):
        effect = "no law tells all, and the choice means little" if rho > COLOURED else "differences are overstated"
        warnings.append(
            f"successive residuals of the best law correlate at {rho:.2f}, so that {chosen.samples} samples count "
            f"as {chosen.samples * (1 - rho) / (1 + rho):.0f}: {effect}"
        )
    return Verdict(aicc, bic, best, settled, tuple(warnings))


def _least(criterion: Sequence[float]) -> int:
    """Return the first that is the least."""
    return int(np.argmax(np.asarray(criterion) <= min(criterion) + SAME))
