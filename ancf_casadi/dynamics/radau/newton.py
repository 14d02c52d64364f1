"""Newton's method for the stage equations of Radau IIA, with matrices that may serve several steps.

Each iteration solves a real and a complex banded system (``collocation``); the low-rank part B diag(d) B^T of the
damping enters both by Woodbury's identity.  With the norm |.| relative to the tolerance and the contraction
theta = |dW_k|/|dW_k-1|, the iteration ends when theta/(1 - theta) |dW_k| is below ``TOLERANCE``.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Section IV.8.
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.radau.buffers import Buffers
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.step_control import NEWTON_ITERATIONS
from ancf_casadi.dynamics.radau.tableau import RADAU, STAGES
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import Factors, lapack_storage
from ancf_casadi.support.compilation import Buffered

TOLERANCE = 0.001  # relative to the tolerance of the step; with a larger one, the errors of many steps add up
LARGEST_CONTRACTION = 2.0  # theta above which the iteration is given up
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
        model, parameters = form.equations.model, buffers.parameters
        self.iterations = self.factorisations = 0
        self.contraction = 1.0
        self._buffers, self._width = buffers, form.bandwidth
        self._weights = 1 / (model.scale[model.free] * tolerance * math.sqrt(form.equations.free))
        every = np.concatenate([self._weights, np.repeat(self._weights, 2)])
        self._stage_weights = every / math.sqrt(STAGES)
        self._modal_coefficients = (
            cs.evalf(form.equations.balance(cs.MX(cs.DM(parameters))).modal_coefficients).full().ravel()
        )
        reference = buffers.reference
        v, h = buffers.last.end[1], buffers.trial.length
        self._stages = Buffered(form.stages, *buffers.of_stages)
        self._matrices = Buffered(form.matrices, reference.coordinates[NODE:], v, h, reference.excitation, parameters)
        self._projection = Buffered(form.equations.turned_projection, reference.excitation)
        self._real: Factors
        self._pair: Factors

    def factorise(self) -> None:
        """Evaluate and factorise the matrices in the predicted configuration of the middle stage."""
        self.factorisations += 1
        trial, reference, (q, _, _) = self._buffers.trial, self._buffers.reference, self._buffers.last.end
        free = q.size
        reference.excitation[:] = trial.excitations[MIDDLE]
        reference.coordinates[:NODE] = reference.excitation[:NODE]
        reference.coordinates[NODE:] = q + trial.increments[MIDDLE]
        real, pair = self._matrices()
        right = self._projection()[0].reshape(self._modal_coefficients.size, free).T
        left = right * (self._modal_coefficients / trial.length)
        self._real = Factors.of(lapack_storage(real, self._width), self._width, RADAU.gamma * left, right)
        self._pair = Factors.of(lapack_storage(pair.view(complex), self._width), self._width, RADAU.mu * left, right)

    def converge(self) -> int:
        """Solve the stage equations, and return the number of iterations; 0 if they do not converge."""
        trial = self._buffers.trial
        increments, corrections, turns = trial.increments.ravel(), trial.corrections, trial.turns
        corrections[:] = 0.0
        free, size = self._weights.size, math.inf
        for iteration in range(1, NEWTON_ITERATIONS + 1):
            self.iterations += 1
            residuals, increments[:], turns[:] = self._stages()
            corrections[:free] = self._real.solve(residuals[:free], overwrite=True)
            corrections[free:] = self._pair.solve(residuals[free:].view(complex), overwrite=True).view(float)
            weighted = corrections * self._stage_weights
            before, size = size, math.sqrt(weighted.dot(weighted))
            if iteration == 1:
                contraction = 0.0 if size < TOLERANCE else 1.0
            else:
                contraction = self.contraction = size / before
            if not math.isfinite(size) or contraction > LARGEST_CONTRACTION:
                return 0
            if contraction < 1.0 and contraction / (1.0 - contraction) * size < TOLERANCE:
                return iteration
        return 0

    def error(self, residual: Array) -> float:
        """Return the error relative to the tolerance from the right-hand side of its system, which is overwritten."""
        weighted = self.solve(residual) * self._weights
        return math.sqrt(weighted.dot(weighted))

    def solve(self, right: Array) -> Array:
        """Solve with the real matrix for right-hand sides, which are overwritten."""
        return self._real.solve(right, overwrite=True)
