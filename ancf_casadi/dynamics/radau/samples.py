"""Motion and energies within a step of Radau IIA.

Motion.  The quintic polynomial through positions, velocities and accelerations at both ends of the step is corrected by
one Newton iteration on the equation of motion, because it may stretch the beam more than the axial forces do.

Energies.  The powers lost to damping and supplied by the base and the tip load are integrated by the quadrature of the
stages.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import EXCITATION
from ancf_casadi.dynamics.radau.buffers import Buffers
from ancf_casadi.dynamics.radau.collocation import Collocation
from ancf_casadi.dynamics.radau.tableau import RADAU
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import Buffered


@dataclass(frozen=True, eq=False)
class StepEnergies:
    """Energies lost to damping and supplied by the base and the tip load within a step, J.

    Parameters
    ----------
    start : array (3,)
        The energies at the start of the step.
    coefficients : array (3, 3)
        Coefficients of x, x^2 and x^3 in the energies added by the step, x from 0 to 1.
    """

    start: Array
    coefficients: Array

    def at(self, x: Array) -> Array:
        """Return the energies at k places x in the step, (k, 3)."""
        x, (first, second, third) = x[:, None], self.coefficients
        return np.asarray(self.start + x * (first + x * (second + x * third)))

    def followed_by(self, h: float, powers: Array) -> StepEnergies:
        """Return the energies of the next step from the powers at its stages, (3, 3)."""
        return StepEnergies(self.start + self.coefficients.sum(axis=0), h * RADAU.integral @ powers)


class Samples:
    """Evaluation of k samples of the last step at once.

    Parameters
    ----------
    count : int
        Number k of samples.
    form : Collocation
        The Functions of a step.
    buffers : Buffers
        The arrays of these Functions.
    excitation : Function
        (t) -> the excitation, (15,).
    """

    def __init__(self, count: int, form: Collocation, buffers: Buffers, excitation: cs.Function) -> None:
        self._count, self._instants = count, np.zeros(count)
        self._places, self._excitations = np.zeros(count), np.zeros((count, EXCITATION))
        step = [buffers.trial.length, *buffers.last.start, *buffers.last.end]
        reference = buffers.reference
        shared = [*step, reference.coordinates, buffers.parameters, reference.real]
        inputs = [self._places, *step, self._excitations, *shared[len(step) :]]
        places = [k for k, array in enumerate(inputs) if any(array is one for one in shared)]
        self._excite = Buffered(excitation.map(count), self._instants)
        self._evaluate = Buffered(form.sample.map("samples", "serial", count, places, []), *inputs)

    def __call__(self, instants: Array, places: Array) -> tuple[Array, Array, Array]:
        """Return coordinates and velocities, (k, 4 n + 4), and forces of the base, (k, 4).

        Parameters
        ----------
        instants, places : array (k,)
            Times, s, and their places in the step, 0 to 1.
        """
        self._instants[:], self._places[:] = instants, places
        self._excitations.ravel()[:] = self._excite()[0]
        one, two, three = (part.reshape(self._count, -1).copy() for part in self._evaluate())
        return one, two, three
