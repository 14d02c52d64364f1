"""The linearised steps of a computed motion: the factors of G, and products with R_u and its transpose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.run import MotionRun, Passage, stop_if_interrupted
from ancf_casadi.dynamics.derivatives.tangent import Tangent
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.stepper import RadauStep
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import BandedFactors, lapack_storage
from ancf_casadi.support.compilation import Buffered


@dataclass(frozen=True, eq=False)
class LinearisedStep:
    """A step and its linearisation G dZ + R_u du = 0, for d directions side by side.

    Parameters
    ----------
    step : RadauStep
        The step.
    samples : array
        Indices of the samples in the step.
    factors : BandedFactors
        The factors of G, with the unknowns in the order of ``Tangent.order``.
    linearisation : LinearisedSteps
        The Functions.
    parameters : array
        The parameters of the equation of motion.
    """

    step: RadauStep
    samples: Index
    factors: BandedFactors
    linearisation: LinearisedSteps
    parameters: Array

    def increments(self, du: Array) -> Array:
        """Return dZ = -G^-1 R_u du, (3 N, d)."""
        lin = self.linearisation
        right = np.column_stack([lin.forward(self.step, self.parameters, direction) for direction in du.T])
        return -self.factors.solve(right[lin.tangent.inverse_order], overwrite=True)[lin.tangent.order]

    def given(self, weights: Array) -> Array:
        """Return -R_u^T G^-T w for weights w of the increments, (3 N, d)."""
        lin = self.linearisation
        residuals = -self.factors.solve_transposed(weights[lin.tangent.inverse_order])[lin.tangent.order]
        return np.column_stack([lin.reverse(self.step, self.parameters, direction) for direction in residuals.T])


@dataclass(frozen=True, eq=False)
class LinearisedSteps:
    """The Functions of linearised steps.

    Parameters
    ----------
    form : Collocation
        The Functions of a step.
    """

    form: Collocation

    @cached_property
    def tangent(self) -> Tangent:
        """The Functions of a linearised step as expressions."""
        return Tangent(self.form)

    @cached_property
    def forward(self) -> StepFunction:
        """R_u du."""
        return StepFunction(self.tangent.forward)

    @cached_property
    def reverse(self) -> StepFunction:
        """R_u^T dR."""
        return StepFunction(self.tangent.reverse)

    def steps(self, run: MotionRun, passage: Passage, *, backwards: bool = False) -> Iterator[LinearisedStep]:
        """Go through the steps of a piece.

        Raises
        ------
        SimulationError
            If ``noted_interrupts`` has noted a Ctrl-C.
        """
        order = -1 if backwards else 1
        modal_coefficients = self._modal_coefficients(run.parameters).full().ravel()
        width = self.tangent.bandwidth
        for step, samples in zip(passage.steps[::order], passage.samples[::order], strict=True):
            stop_if_interrupted()
            band = lapack_storage(self._matrix(step, run.parameters), width)
            factors = BandedFactors.of(
                band, width, *self.tangent.low_rank(step.excitations, step.length, modal_coefficients)
            )
            yield LinearisedStep(step, samples, factors, self, run.parameters)

    @cached_property
    def _matrix(self) -> StepFunction:
        return StepFunction(self.tangent.matrix)

    @cached_property
    def _modal_coefficients(self) -> cs.Function:
        p = cs.MX.sym("p", self.form.equations.layout.size)
        return cs.Function("modal_coefficients", [p], [self.form.equations.balance(p).modal_coefficients])


class StepFunction:
    """A Function (Z, h, u, [vector]) of ``Tangent``, bound to arrays."""

    def __init__(self, function: cs.Function) -> None:
        self._inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self._call = Buffered(function, *self._inputs)

    def __call__(self, step: RadauStep, parameters: Array, vector: Array | None = None) -> Array:
        """Evaluate for a step."""
        self._inputs[0][:] = step.increments.ravel()
        self._inputs[1][:] = step.length
        self._inputs[2][:] = np.concatenate([step.q, step.v, step.excitations.ravel(), parameters])
        if vector is not None:
            self._inputs[3][:] = vector
        return self._call()[0].copy()
