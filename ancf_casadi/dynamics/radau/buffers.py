"""The arrays that the Functions of a step read in place.

CasADi's ``buffer`` binds a Function to arrays, so that a call copies nothing and costs half a microsecond.  Each group
of arrays here has one owner that writes it; N is the number of free coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.dynamics.equations import EXCITATION
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.tableau import STAGES
from ancf_casadi.support.arrays import Array


@dataclass(frozen=True, eq=False)
class LastStep:
    """The last step taken.  ``Stepper`` writes it when a step is accepted.

    Parameters
    ----------
    start, end : array (3, N)
        q, v and a at the start and at the end.
    nodes : array (4, 4 n + 4)
        All coordinates at the start and at the stages.
    """

    start: Array
    end: Array
    nodes: Array


@dataclass(frozen=True, eq=False)
class TrialStep:
    """The step being tried, from the end of the last one; after acceptance, the last step.

    ``Stepper`` writes all but the corrections and the turns, and predicts the increments; ``Newton`` corrects them.

    Parameters
    ----------
    time, length, ratio : array (1,)
        Start, s, length, s, and length relative to that of the last step.
    excitations : array (3, 15)
        The excitation at each stage.
    increments : array (3, N)
        Z, increments of the free coordinates at the stages.
    corrections : array (3, N)
        dW, the last correction of Newton's method.
    turns : array
        Turns of the stages from the reference of the matrices.
    """

    time: Array
    length: Array
    ratio: Array
    excitations: Array
    increments: Array
    corrections: Array
    turns: Array


@dataclass(frozen=True, eq=False)
class Reference:
    """Configuration in which the matrices were taken.  ``Newton.factorise`` writes it.

    Parameters
    ----------
    coordinates : array (4 n + 4,)
        All coordinates.
    excitation : array (15,)
        The excitation.
    real, pair : array
        The factors of the real and of the complex matrix.
    """

    coordinates: Array
    excitation: Array
    real: Array
    pair: Array


@dataclass(frozen=True, eq=False)
class Buffers:
    """All arrays of a run, and the parameters of the equation of motion, which nothing overwrites."""

    last: LastStep
    trial: TrialStep
    reference: Reference
    parameters: Array

    @staticmethod
    def of(form: Collocation, parameters: Array) -> Buffers:
        """Return arrays of zeros for the Functions of a step."""
        size, free = form.equations.model.size, form.equations.free
        return Buffers(
            last=LastStep(np.zeros((3, free)), np.zeros((3, free)), np.zeros((STAGES + 1, size))),
            trial=TrialStep(
                time=np.zeros(1),
                length=np.zeros(1),
                ratio=np.zeros(1),
                excitations=np.zeros((STAGES, EXCITATION)),
                increments=np.zeros((STAGES, free)),
                corrections=np.zeros((STAGES, free)),
                turns=np.zeros(form.stages.numel_out(2)),
            ),
            reference=Reference(
                np.zeros(size), np.zeros(EXCITATION), *(np.zeros(form.factors.numel_out(k)) for k in range(2))
            ),
            parameters=parameters,
        )

    @property
    def of_stages(self) -> list[Array]:
        """The inputs of ``Collocation.stages``, in order."""
        trial, reference, (q, v, _) = self.trial, self.reference, self.last.end
        return [
            trial.increments,
            trial.corrections,
            q,
            v,
            trial.length,
            trial.excitations,
            trial.turns,
            reference.coordinates,
            self.parameters,
            reference.real,
            reference.pair,
        ]
