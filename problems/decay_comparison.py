"""Which law of damping a record speaks for.

All laws are fitted to the same samples.  With m of them, the sum S of squared residuals, and K quantities estimated,
the noise counted and an unknown at its bound not, normal white noise gives the information criteria

    AICc = m ln(S/m) + 2 K + 2 K (K + 1)/(m - K - 1),    BIC = m ln(S/m) + K ln m.

The least is best; by itself it means nothing, a difference of 10 is clear.  An unknown at its bound is a term left out,
so that a law with such a one is judged as the smaller law it has become; of equal laws the first is preferred.  AICc
seeks the law that predicts best, and takes a term too many now and then; BIC finds the true law, if it is among them
and the record long.  A term too many costs ln m at most, so that only a law with fewer can be a rival.  Both count m
independent residuals.  Where successive ones correlate at rho, there are about m (1 - rho)/(1 + rho), and differences
are overstated by the inverse of that: the comparison then says so.

References
----------
K. P. Burnham, D. R. Anderson, Model Selection and Multimodel Inference, Springer (2002), Sections 2.4, 6.4.
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.measurement import Measurement
from ancf_casadi.report import Table
from problems.decay_fitting import fit_decay
from problems.decay_laws import Law
from problems.decay_result import COLOURED, DecayFit

COLOURED_CHOICE = 0.2  # correlation of successive residuals beyond which there are a third fewer of them
CLEAR = 10.0  # difference of a criterion that leaves no doubt
SAME = 1e-6  # difference below which two laws are one


@dataclass(frozen=True, eq=False)
class DecayComparison:
    """Laws of damping, fitted to one record.

    Parameters
    ----------
    fits : tuple of DecayFit
        One for each law.
    aicc, bic : tuple of float
        Information criteria of each.
    warnings : tuple of str
        What to know before using them.
    """

    fits: tuple[DecayFit, ...]
    aicc: tuple[float, ...]
    bic: tuple[float, ...]
    warnings: tuple[str, ...]

    @property
    def best(self) -> DecayFit:
        """The fit with the least BIC."""
        return self.fits[_least(self.bic)]

    def table(self) -> Table:
        """Return the laws with their criteria, from the least of each."""
        rows = [
            (
                fit.law,
                _estimated(fit),
                fit.residual_rms,
                aicc - min(self.aicc),
                bic - min(self.bic),
                fit.fit.autocorrelation,
                ", ".join(fit.at_bound),
            )
            for fit, aicc, bic in zip(self.fits, self.aicc, self.bic, strict=True)
        ]
        columns = ("law", "estimated", "residual_rms_m", "delta_AICc", "delta_BIC", "autocorrelation", "at_bound")
        notes = (f"best by BIC: {self.best.law}", *(f"note: {warning}" for warning in self.warnings))
        return Table("laws", "Laws of damping", columns, rows, notes)

    def report(self) -> str:
        """Return the table, and the best fit, as text."""
        return f"{self.table().text()}\n\n{self.best.report()}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "best": self.best.law,
            "laws": [
                {
                    "law": fit.law,
                    "estimated": _estimated(fit),
                    "aicc": aicc,
                    "bic": bic,
                    "residual_rms_m": fit.residual_rms,
                    "autocorrelation": fit.fit.autocorrelation if math.isfinite(fit.fit.autocorrelation) else None,
                    "at_bound": list(fit.at_bound),
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
    if isinstance(laws, str) or not laws:
        raise InputError(f"must be a sequence of laws, got {laws!r}", "laws")
    fits = tuple(
        fit_decay(time, displacement, law=law, offset=offset, drift=drift, release_time=release_time) for law in laws
    )
    criteria = [_criteria(fit) for fit in fits]
    aicc, bic = (tuple(column) for column in zip(*criteria, strict=True))
    return DecayComparison(fits, aicc, bic, _warnings(fits, aicc, bic))


def _criteria(fit: DecayFit) -> tuple[float, float]:
    """Return AICc and BIC."""
    m, K = fit.samples, _estimated(fit)
    misfit = m * math.log(max(fit.residual_rms**2, np.finfo(float).tiny))
    small = 2 * K * (K + 1) / (m - K - 1) if m > K + 1 else math.inf
    return misfit + 2 * K + small, misfit + K * math.log(m)


def _estimated(fit: DecayFit) -> int:
    """Return how many quantities were estimated, the variance of the noise being one."""
    return fit.fit.rank + 1


def _least(criterion: Sequence[float]) -> int:
    """Return the first that is the least."""
    return int(np.argmax(np.asarray(criterion) <= min(criterion) + SAME))


def _warnings(fits: Sequence[DecayFit], aicc: Sequence[float], bic: Sequence[float]) -> tuple[str, ...]:
    best = _least(bic)
    warnings = []
    if _least(aicc) != best:
        warnings.append(f"AICc prefers the {fits[_least(aicc)].law} law: the record does not settle it")
    rivals = [
        fit.law for fit, value in zip(fits, bic, strict=True)
        if SAME < value - bic[best] < CLEAR and fit.fit.rank <= fits[best].fit.rank
    ]  # fmt: skip
    if rivals:
        warnings.append(f"the {rivals[0]} law is not clearly worse")
    rho = fits[best].fit.autocorrelation
    if rho > max(COLOURED_CHOICE, 3 / math.sqrt(fits[best].samples)):
        effect = "no law tells all, and the choice means little" if rho > COLOURED else "differences are overstated"
        warnings.append(
            f"successive residuals of the best law correlate at {rho:.2f}, so that {fits[best].samples} samples count "
            f"as {fits[best].samples * (1 - rho) / (1 + rho):.0f}: {effect}"
        )
    return tuple(warnings)
