"""Newton's method for the stage equations of Radau IIA, with matrices that may serve several steps.

Each iteration solves a real and a complex system (``collocation``).  With the norm |.| relative to the tolerance and
the contraction theta = |dW_k|/|dW_k-1|, the iteration ends when theta/(1 - theta) |dW_k| is below ``NEWTON_RATIO``.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Section IV.8.
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.dynamics.radau.buffers import Buffers
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.step_control import NEWTON_ITERATIONS
from ancf_casadi.dynamics.radau.tableau import STAGES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

NEWTON_RATIO = 0.001  # relative to the tolerance of the step; with a larger one, the errors of many steps add up
MIDDLE = STAGES // 2  # stage in which the matrices are taken


class Newton:
    """Newton's method for the stage equations of the step in ``buffers.trial``.

    ``iterations`` and ``factorisations`` count the work of the run.  ``contraction`` is the last theta that was
    measured, in an earlier step if the last step took a single iteration.

    Parameters
    ----------
    form : Collocation
        The Functions of a step.
    buffers : Buffers
        The arrays of these Functions.
    tolerance : float
        Tolerance of the step.
    """

    def __init__(self, form: Collocation, buffers: Buffers, tolerance: float) -> None:
        model, reference = form.equations.model, buffers.reference
        self.iterations = self.factorisations = 0
        self.contraction = 1.0
        self._buffers = buffers
        self._weights = 1 / (model.scale[model.free] * tolerance * math.sqrt(form.equations.free))
        self._stage_weights = np.tile(self._weights / math.sqrt(STAGES), STAGES)
        q, v, h = reference.coordinates[NODE:], buffers.last.end[1], buffers.trial.length
        self._stages = Buffered(form.stages, *buffers.of_stages)
        self._factors = Buffered(form.factors, q, v, h, reference.excitation, buffers.parameters)

    def factorise(self) -> None:
        """Evaluate and factorise the matrices in the predicted configuration of the middle stage."""
        self.factorisations += 1
        trial, reference, (q, _, _) = self._buffers.trial, self._buffers.reference, self._buffers.last.end
        reference.excitation[:] = trial.excitations[MIDDLE]
        reference.coordinates[:NODE] = reference.excitation[:NODE]
        reference.coordinates[NODE:] = q + trial.increments[MIDDLE]
        reference.real[:], reference.pair[:] = self._factors()

    def converge(self) -> int:
        """Solve the stage equations, and return the number of iterations; 0 if they do not converge."""
        trial = self._buffers.trial
        increments, corrections, turns = trial.increments.ravel(), trial.corrections.ravel(), trial.turns
        corrections[:] = 0.0
        size = math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            self.iterations += 1
            corrections[:], increments[:], turns[:] = self._stages()
            weighted = corrections * self._stage_weights
            before, size = size, math.sqrt(weighted.dot(weighted))
            if iteration == 1:
                contraction = 0.0 if size < NEWTON_RATIO else 1.0
            else:
                contraction = self.contraction = size / before
            if not math.isfinite(size) or contraction > 2.0:  # theta above which the iteration is given up
                return 0
            if contraction < 1.0 and contraction / (1.0 - contraction) * size < NEWTON_RATIO:
                return iteration
        return 0

    def error(self, estimate: Array) -> float:
        """Return the size of an error estimate relative to the tolerance."""
        weighted = estimate * self._weights
        return math.sqrt(weighted.dot(weighted))
