"""Step length of Radau IIA, and the decision to keep the matrices of the last step.

With the error estimate err relative to the tolerance, k iterations of Newton's method and at most k_max of them, the
step h is followed by the smaller of

    SAFETY (2 k_max + 1)/(2 k_max + k) h err^(-1/4),    SAFETY h (h/h_last) (err_last/err^2)^(1/4),

the second of which extrapolates the trend of the error.  If Newton's method converges fast and the new length would
differ little from the old one, the next step keeps both the length and the matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ancf_casadi.dynamics.segments import SAME_TIME

ERROR_ORDER = 4  # of the error estimate in the step length
NEWTON_ITERATIONS = 10  # k_max
STEADY = 3e-4  # contraction of Newton's method below which matrices may be kept
KEEP = (0.9, 1.2)  # factors of the length in this range are not applied, so that the matrices can be kept
SAFETY = 0.9
GROWTH = (0.2, 5.0)  # smallest and largest factor of the length
AFTER_FAILURE = 1.05  # largest factor of the length after Newton's method has failed
RECOVERY = 1.02  # factor by which each step relaxes the limit set by a failure
LEAST_ERROR, LEAST_TREND = 1e-10, 1e-2  # lower limits of err and err_last


@dataclass(frozen=True)
class StepControl:
    """The state on which the next step length depends."""

    proposal: float = 1e-5  # length to try next, s
    keep: bool = False  # whether a step of the same length as the last one keeps its matrices
    largest_growth: float = GROWTH[1]  # largest factor of the length after the next step
    length: float = 0.0  # of the last step, s; 0 before the first step
    error: float = 1.0  # of the last step, relative to the tolerance

    def trial_length(self, left: float, largest_step: float) -> float:
        """Return the length of the step to try, s, given the time ``left``, so that no tiny last step remains."""
        h = min(self.proposal, largest_step)
        return left if h > (1 - SAME_TIME) * left else min(h, left / 2)

    def not_converged(self, h: float, *, kept: bool) -> StepControl:
        """Return the state after Newton's method failed: new matrices if it had kept some, else half the length."""
        if kept:
            return replace(self, proposal=h, keep=False)
        return replace(self, proposal=h / 2, keep=False, largest_growth=AFTER_FAILURE)

    def inaccurate(self, h: float, error: float, iterations: int) -> StepControl:
        """Return the state after a step whose error exceeds the tolerance: repeat it with a smaller length."""
        return replace(self, proposal=h * _growth(error, iterations), keep=False)

    def accepted(self, h: float, error: float, iterations: int, contraction: float, largest_step: float) -> StepControl:
        """Return the state after an accepted step of length h."""
        growth = _growth(error, iterations)
        if self.length:
            trend = h / self.length * (self.error / max(error, LEAST_ERROR) ** 2) ** (1 / ERROR_ORDER)
            growth = min(growth, max(SAFETY * trend, GROWTH[0]), self.largest_growth)
        growth = min(growth, largest_step / h)
        keep = contraction <= STEADY and KEEP[0] <= growth < KEEP[1]
        return StepControl(
            proposal=h if keep else h * growth,
            keep=keep,
            largest_growth=min(self.largest_growth * RECOVERY, GROWTH[1]),
            length=h,
            error=max(error, LEAST_TREND),
        )


def _growth(error: float, iterations: int) -> float:
    """Return the factor of the length that the error of a step allows."""
    effort = (2 * NEWTON_ITERATIONS + 1) / (2 * NEWTON_ITERATIONS + iterations)
    growth = SAFETY * effort * max(error, LEAST_ERROR) ** (-1 / ERROR_ORDER)
    return float(min(max(growth, GROWTH[0]), GROWTH[1]))
