"""The linear equation of motion about an equilibrium, solved for harmonic excitation.

Small displacements w of the free coordinates about an equilibrium obey

    M w_tt + D w_t + K w = S_j^T f(t),

with the tangent stiffness K at the equilibrium (gravity and loads included), the mass M, and D = dQ_damp/de_t at rest,
the low-rank part of modal damping included.  The row S_j picks the displacement of the loaded point along the direction
of the load, S_i that of a response.  Under f = F exp(i omega t), the receptance is

    H_ij = S_i (K + i omega D - omega^2 M)^-1 S_j^T.

If the base moves by u exp(i omega t) along a direction, with E the translation of all nodes along it, the motion
relative to the base is w u exp(i omega t) with

    (K + i omega D - omega^2 M) w = -(i omega D - omega^2 M) E    (rows of the free coordinates),

because K E = 0.

The equations are solved directly at each frequency, by LU factors of the banded matrix and Woodbury's identity for the
modal damping, so that no mode is truncated.  Rounding K changes the resonances by less than 1e-10 of their frequency
with 20 elements, and 1e-7 with 400.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.tip_load import LOAD_SIZE
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.banded import BandedFactors
from ancf_casadi.vibration.assembly import BANDWIDTH
from ancf_casadi.vibration.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class SmallMotion:
    """The linear equation of motion about an equilibrium.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equilibrium.
    law : DampingLaw
        The damping law.
    """

    equilibrium: Equilibrium
    law: DampingLaw

    def rows(self, points: Sequence[float], direction: tuple[float, float]) -> Array:
        """Return the rows S of points along a direction, (points, free)."""
        model = self.equilibrium.model
        return np.array([np.array(direction) @ model.interpolation(s)[:, model.free] for s in points])

    def receptance(self, frequencies: Array, outputs: Array, inputs: Array) -> ComplexArray:
        """Return H, (outputs, inputs, k), m/N."""
        solutions = [self.factors(ω).solve(inputs.T.astype(complex)) for ω in 2 * np.pi * frequencies]
        return np.stack([outputs @ x for x in solutions], axis=2)

    def relative_transmissibility(
        self, frequencies: Array, outputs: Array, direction: tuple[float, float]
    ) -> ComplexArray:
        """Return the displacement relative to the base per displacement of the base, (outputs, 1, k)."""
        model = self.equilibrium.model
        translation = np.tile([*direction, 0.0, 0.0], model.size // NODE)
        _, damping, mass = self._matrices
        projection, coefficients = self._modal
        resisted = (damping @ translation + projection @ (coefficients * (projection.T @ translation)))[model.free]
        moved = (mass @ translation)[model.free]
        solutions = [self.factors(ω).solve(ω**2 * moved - 1j * ω * resisted) for ω in 2 * np.pi * frequencies]
        return np.stack([outputs @ x for x in solutions], axis=1)[:, None, :]

    def factors(self, ω: float) -> BandedFactors:
        """Return the factors of K + i omega D - omega^2 M of the free coordinates."""
        stiffness, damping, mass = self._bands
        storage = np.zeros((3 * BANDWIDTH + 1, stiffness.shape[1]), dtype=complex, order="F")
        storage[BANDWIDTH:] = stiffness + 1j * ω * damping - ω**2 * mass
        free = self.equilibrium.model.free
        projection, coefficients = self._modal
        left = (1j * ω * projection[free] * coefficients).astype(complex)
        return BandedFactors.of(storage, BANDWIDTH, left, projection[free])

    @cached_property
    def _modal(self) -> tuple[Array, Array]:
        """B (size, m) and d (m,) of the low-rank part B diag(d) B^T of D."""
        values = cs.MX(cs.DM([parameter.value for parameter in self.law.parameters]))
        coefficients = cs.evalf(cs.densify(self.law.modal_coefficients(values))).full().ravel()
        return self.law.projection(self.equilibrium.model), coefficients

    @cached_property
    def _matrices(self) -> tuple[Any, Any, Any]:
        """K without moments, local D and M of all coordinates, sparse."""
        model = self.equilibrium.model
        equations = Equations(model, self.law)
        e = cs.MX(cs.DM(self.equilibrium.coordinates))
        balance = equations.balance(cs.MX(cs.DM(equations.parameters)))
        entries = balance.tangents(e, cs.MX.zeros(model.size), cs.MX.zeros(LOAD_SIZE))
        return tuple(cs.evalf(model.matrix(values)).sparse() for values in entries)

    @cached_property
    def _bands(self) -> tuple[Array, Array, Array]:
        """K with loads, local D and M of the free coordinates, stored by diagonals."""
        rest = self.equilibrium
        _, stiffness, mass = rest.structure.linearisation(rest.exact)
        coo = self._matrices[1].tocoo()
        rows, columns = coo.row - NODE, coo.col - NODE
        inside = (rows >= 0) & (columns >= 0)
        damping = np.zeros_like(stiffness)
        np.add.at(damping, (BANDWIDTH + rows[inside] - columns[inside], columns[inside]), coo.data[inside])
        return stiffness, damping, mass
