"""Newton's method for the stage equations of a step, with matrices that may serve several steps, and the step length.

Each iteration solves a real and a complex system (``collocation``).  With the norm |.| relative to the tolerance and
the contraction theta = |dW_k|/|dW_k-1|, the iteration ends when theta/(1 - theta) |dW_k| is below ``NEWTON_RATIO``.

With the error estimate err relative to the tolerance, k iterations and at most k_max of them, the step h is followed by
the smaller of

    SAFETY (2 k_max + 1)/(2 k_max + k) h err^(-1/4),    SAFETY h (h/h_last) (err_last/err^2)^(1/4),

the second of which extrapolates the trend of the error.  If the new length would differ little from the old one, and
Newton's method converges fast, or nearly as fast as when the matrices were new, the next step keeps both the length and
the matrices.  (What matrices omit, such as modal damping, slows down the convergence whether they are new or old.)

CasADi's ``buffer`` binds a Function to arrays, so that a call copies nothing and costs half a microsecond.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ancf_casadi.dynamics.excitation import EXCITATION, SAME_TIME
from ancf_casadi.dynamics.radau.collocation import MIDDLE, Collocation
from ancf_casadi.dynamics.radau.tableau import STAGES
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered, evaluate_dense

NEWTON_RATIO = 0.001  # relative to the tolerance of the step; with a larger one, the errors of many steps add up
ERROR_ORDER = 4  # of the error estimate in the step length
NEWTON_ITERATIONS = 10  # k_max
STEADY = 3e-4  # contraction of Newton's method below which matrices may be kept (test_a_tight_tolerance_is_met_...)
STALE = 1.5  # ratio of the contraction to that with new matrices below which they may be kept, too,
SLOW = 1e-2  # unless the contraction is above this (test_after_the_spin_up_of_simo_and_vu_quoc_...)
KEEP = (0.85, 1.25)  # factors of the length in this range are not applied, so that the matrices can be kept
SAFETY = 0.9
GROWTH = (0.2, 5.0)  # smallest and largest factor of the length
AFTER_FAILURE = 1.05  # largest factor of the length after Newton's method has failed
RECOVERY = 1.02  # factor by which each step relaxes the limit set by a failure
LEAST_ERROR, LEAST_TREND = 1e-10, 1e-2  # lower limits of err and err_last


class Newton:
    """Newton's method for the stage equations of the step being tried, and the arrays that the Functions read in place.

    N is the number of free coordinates; arrays with a row per link, or per node, are the columns of ``Collocation``.
    ``Stepper`` writes ``end``, q, v and a at the end of the last step, ``internal``, the internal strains there, and
    ``nodes``, all coordinates at its start and its stages, when a step is accepted.  For the step being tried, it
    writes ``time``, its start, s, ``length``, s, ``ratio``, relative to that of the last step, and the ``excitations``
    at the stages, and predicts the ``increments`` Z.  ``converge`` writes their last ``corrections`` dW and the
    ``turns`` of the stages from the reference of the matrices; ``factorise`` writes this reference and the factors.

    ``iterations`` and ``factorisations`` count the work of the run.  ``contraction`` is the last theta that was
    measured, in an earlier step if the last step took a single iteration.
    """

    def __init__(self, form: Collocation, parameters: Array, tolerance: float) -> None:
        model, links = form.equations.model, form.links.count
        free = form.equations.free
        self.end = np.zeros((3, free))
        self.nodes = np.zeros((links + 1, STAGES + 1, NODE))
        self.time, self.length, self.ratio = np.zeros(1), np.zeros(1), np.zeros(1)
        self.excitations = np.zeros((STAGES, EXCITATION))
        self._iterate, self._next = np.zeros((2, 3, links, STAGES, NODE))
        self.corrections, self.increments, self.turns = self._iterate
        self.internal = np.zeros(form.equations.internal_shape[::-1])
        self.iterations = self.factorisations = 0
        self.contraction = 1.0
        motion = *self.end[:2], self.length
        middle = self.excitations[MIDDLE]
        self._factors = Buffered(form.factors, self.increments, *motion, middle, parameters, self.internal)
        reference, *factors = self._factors.outputs
        columns = evaluate_dense(form.columns, parameters)
        trial = self.increments, self.corrections, self.turns, *motion, self.excitations
        weights = np.zeros(NODE * links)  # of corrections at four places per node
        weights[model.first_moved - NODE] = 1 / (model.free_scale * tolerance * math.sqrt(STAGES * free))
        weights = np.repeat(weights.reshape(links, 1, NODE), STAGES, axis=1)
        self.of_stages = [*trial, reference, parameters, *(x.T for x in columns), *factors, weights, self.internal]
        self._stages = Buffered(form.stages, *self.of_stages, outputs=[*self._next])

    def factorise(self) -> None:
        """Evaluate and factorise the matrices in the predicted configuration of the middle stage."""
        self.factorisations += 1
        self._factors()

    def converge(self) -> int:
        """Solve the stage equations, and return the number of iterations; 0 if they do not converge."""
        self.corrections[:] = self.turns[:] = 0.0  # the latter may be nan after a trial that failed
        size = math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            self.iterations += 1
            before, size = size, self._stages()[-1].item()
            self._iterate[:] = self._next
            if iteration == 1:
                contraction = 0.0 if size < NEWTON_RATIO else 1.0
            else:
                contraction = self.contraction = size / before
            if not math.isfinite(size) or contraction > 2.0:  # theta above which the iteration is given up
                return 0
            if contraction < 1.0 and contraction / (1.0 - contraction) * size < NEWTON_RATIO:
                return iteration
        return 0


class StepControl(NamedTuple):
    """The state on which the next step length depends."""

    proposal: float = 1e-5  # length to try next, s
    keep: bool = False  # whether a step of the same length as the last one keeps its matrices
    largest_growth: float = GROWTH[1]  # largest factor of the length after the next step
    length: float = 0.0  # of the last step, s; 0 before the first step
    error: float = 1.0  # of the last step, relative to the tolerance
    contraction: float = 0.0  # of the last step with new matrices

    def trial_length(self, remaining: float, largest_step: float) -> float:
        """Return the length of the step to try, s, given the time ``remaining``, so that no tiny last step remains."""
        h = min(self.proposal, largest_step)
        return remaining if h > (1 - SAME_TIME) * remaining else min(h, remaining / 2)

    def keeps_matrices(self, h: float) -> bool:
        """Return whether a step of length h is to be solved with the matrices of the last one."""
        return self.keep and h == self.length

    def after_failure(self, h: float) -> StepControl:
        """Return the state after Newton's method failed: new matrices if they were old, else half the length."""
        if self.keeps_matrices(h):
            return self._replace(proposal=h, keep=False)
        return self._replace(proposal=h / 2, keep=False, largest_growth=AFTER_FAILURE)

    def after_error(self, h: float, error: float, iterations: int) -> StepControl:
        """Return the state after a step whose error exceeds the tolerance: repeat it with a smaller length."""
        return self._replace(proposal=h * _growth(error, iterations), keep=False)

    def after_step(
        self, h: float, error: float, iterations: int, contraction: float, largest_step: float
    ) -> StepControl:
        """Return the state after an accepted step of length h."""
        growth = _growth(error, iterations)
        if self.length:
            trend = h / self.length * (self.error / max(error, LEAST_ERROR) ** 2) ** (1 / ERROR_ORDER)
            growth = min(growth, max(SAFETY * trend, GROWTH[0]), self.largest_growth)
        growth = min(growth, largest_step / h)
        contraction_when_new = self.contraction if self.keeps_matrices(h) else contraction
        keep = contraction <= max(STEADY, min(STALE * contraction_when_new, SLOW)) and KEEP[0] <= growth < KEEP[1]
        return StepControl(
            proposal=h if keep else h * growth,
            keep=keep,
            largest_growth=min(self.largest_growth * RECOVERY, GROWTH[1]),
            length=h,
            error=max(error, LEAST_TREND),
            contraction=contraction_when_new,
        )


def _growth(error: float, iterations: int) -> float:
    """Return the factor of the length that the error of a step allows."""
    effort = (2 * NEWTON_ITERATIONS + 1) / (2 * NEWTON_ITERATIONS + iterations)
    growth = SAFETY * effort * max(error, LEAST_ERROR) ** (-1 / ERROR_ORDER)
    return float(min(max(growth, GROWTH[0]), GROWTH[1]))
