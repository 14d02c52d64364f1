"""The arrays of a step, and Newton's method for its stage equations, with matrices that may serve several steps.

Each iteration solves a real and a complex system (``collocation``).  With the norm |.| relative to the tolerance and
the contraction theta = |dW_k|/|dW_k-1|, the iteration ends when theta/(1 - theta) |dW_k| is below ``NEWTON_RATIO``.

CasADi's ``buffer`` binds a Function to arrays, so that a call copies nothing and costs half a microsecond.
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.dynamics.excitation import EXCITATION
from ancf_casadi.dynamics.radau.collocation import STAGES, Collocation
from ancf_casadi.dynamics.radau.step_control import NEWTON_ITERATIONS
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered

NEWTON_RATIO = 0.001  # relative to the tolerance of the step; with a larger one, the errors of many steps add up
MIDDLE = STAGES // 2  # stage in which the matrices are taken


class StepArrays:
    """The arrays that the Functions of a step read in place; N is the number of free coordinates.

    ``Stepper`` writes ``start`` and ``end``, q, v and a at both ends of the last step, and ``nodes``, all coordinates
    at its start and its stages, when a step is accepted.  For the step being tried, it writes ``time``, its start, s,
    ``length``, s, ``ratio``, relative to that of the last step, and the ``excitations`` at the stages, and predicts the
    ``increments`` Z of the free coordinates.  ``Newton`` writes their last ``corrections`` dW, the ``turns`` of the
    stages from the reference of the matrices, and, where it takes the matrices, the coordinates and excitation of this
    ``reference`` and the factors of the ``real`` and the complex matrix, the ``pair``.
    """

    def __init__(self, form: Collocation, parameters: Array) -> None:
        size, free = form.equations.model.size, form.equations.free
        self.start, self.end, self.nodes = np.zeros((3, free)), np.zeros((3, free)), np.zeros((STAGES + 1, size))
        self.time, self.length, self.ratio = np.zeros(1), np.zeros(1), np.zeros(1)
        self.excitations = np.zeros((STAGES, EXCITATION))
        self.increments, self.corrections = np.zeros((STAGES, free)), np.zeros((STAGES, free))
        self.turns = np.zeros(form.stages.numel_out(2))
        self.reference, self.reference_excitation = np.zeros(size), np.zeros(EXCITATION)
        self.real, self.pair = (np.zeros(form.factors.numel_out(k)) for k in range(2))
        self.parameters = parameters

    @property
    def of_stages(self) -> list[Array]:
        """The inputs of ``Collocation.stages``, in order."""
        trial = [self.increments, self.corrections, *self.end[:2], self.length, self.excitations, self.turns]
        return [*trial, self.reference, self.parameters, self.real, self.pair]


class Newton:
    """Newton's method for the stage equations of the step being tried, whose error may be ``tolerance``.

    ``iterations`` and ``factorisations`` count the work of the run.  ``contraction`` is the last theta that was
    measured, in an earlier step if the last step took a single iteration.
    """

    def __init__(self, form: Collocation, arrays: StepArrays, tolerance: float) -> None:
        model = form.equations.model
        self.iterations = self.factorisations = 0
        self.contraction = 1.0
        self._arrays = arrays
        self._weights = 1 / (model.scale[model.free] * tolerance * math.sqrt(form.equations.free))
        self._stage_weights = np.tile(self._weights / math.sqrt(STAGES), STAGES)
        state = arrays.reference[NODE:], arrays.end[1], arrays.length, arrays.reference_excitation
        self._stages = Buffered(form.stages, *arrays.of_stages)
        self._factors = Buffered(form.factors, *state, arrays.parameters)

    def factorise(self) -> None:
        """Evaluate and factorise the matrices in the predicted configuration of the middle stage."""
        self.factorisations += 1
        arrays = self._arrays
        arrays.reference_excitation[:] = arrays.excitations[MIDDLE]
        arrays.reference[:NODE] = arrays.reference_excitation[:NODE]
        arrays.reference[NODE:] = arrays.end[0] + arrays.increments[MIDDLE]
        arrays.real[:], arrays.pair[:] = self._factors()

    def converge(self) -> int:
        """Solve the stage equations, and return the number of iterations; 0 if they do not converge."""
        arrays = self._arrays
        increments, corrections, turns = arrays.increments.ravel(), arrays.corrections.ravel(), arrays.turns
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
