"""Quadratic damping, Q = int S^T (gamma1 v + gamma2 |v| v) dp, Eq. (19), (23)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ancf_casadi.damping.law import DampingLaw, Forces, S, coefficients, named, nonzero, weighted
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, numbers
from ancf_casadi.vibration.modes import Modes

DRAG_CONSTANT = 1183 / 876  # gamma2 = eta2 mu 1183/876, Eq. (24)-(25) exact; the paper rounds 876/1183 to 0.74


@final
@dataclass(frozen=True)
class QuadraticDamping(DampingLaw):
    """Air drag along the beam, linear and quadratic in the speed: gamma1 v + gamma2 |v| v, Eq. (19).

    gamma1 = eta1 mu and gamma2 = eta2 mu 1183/876, Eq. (25), so that Eq. (26) is what it becomes in the one-mode
    form of Eq. (21).

    Parameters
    ----------
    eta1 : float
        Linear coefficient, 1/s.
    eta2 : float
        Quadratic coefficient, 1/m.  The paper's tables are per mm.

    Raises
    ------
    InputError
        If a coefficient is negative or not finite.
    """

    eta1: float = 0.0
    eta2: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        coefficients(self, "eta1", "eta2")

    @property
    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Eta1 (1/s) and eta2 (1/m)."""
        return nonzero(eta1=self.eta1, eta2=self.eta2)

    def with_parameters(self, values: Sequence[float] | Array) -> QuadraticDamping:
        """Return the law with other coefficients."""
        return replace(self, **named(self, values))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return eta1 int S^T mu v dp + eta2 1183/876 int S^T mu |v| v dp, Eq. (23)."""
        forces = []
        if self.eta1:
            forces.append(body.line_inertia_force(e_t, properties))
        if self.eta2:
            forces.append(DRAG_CONSTANT * body.drag_force(e_t, properties))
        return weighted(forces, parameters, e_t)

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return zeta = b eta1/(2 omega) + 4 eta2 c A/(3 pi), with c = 1183/876 int mu |phi|^3 dp / phi^T M phi.

        The mode shape phi is 1 at the tip; c is 1 for the shape of Eq. (21), and less for the higher modes.
        b = int mu phi^2 dp / phi^T M phi is 1 unless the tip carries a mass.

        Raises
        ------
        InputError
            If there is not one amplitude a mode.
        """
        check_instance(modes, "modes", Modes)
        amplitudes = numbers(amplitudes, "amplitudes")
        model = modes.model
        shapes = modes.shapes / modes.tip_amplitudes()
        mass = model.mass(model.properties).sparse()
        linear, quadratic = [], []
        for phi in shapes.T:
            forces = (
                function(phi, model.properties).full() for function in (model.line_inertia_force, model.drag_force)
            )
            shares = [float(phi @ force.ravel() / (phi @ (mass @ phi))) for force in forces]
            linear.append(self.eta1 * shares[0])
            quadratic.append(4 * self.eta2 * DRAG_CONSTANT * shares[1] / (3 * math.pi))
        if len(amplitudes) != modes.count:
            raise InputError(f"has {len(amplitudes)} values for {modes.count} modes", "amplitudes")
        return np.asarray(np.array(linear) / (2 * modes.angular_frequencies) + np.array(quadratic) * np.abs(amplitudes))
