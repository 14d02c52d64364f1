"""Rayleigh (proportional) damping, Eqs. (11)-(16).

Q = C e_t,    C = alpha M + beta K,                             Eqs. (11), (14)
zeta = alpha/(2 omega) + beta omega/2                           Eq. (16)
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np

from ancf_casadi.damping.law import DampingLaw, Forces, Parameter, S, nonzero, weighted_sum
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_fields, check_instance, choice, not_negative
from ancf_casadi.vibration.modes import Modes

ProportionalStiffness = Literal["strain-rate", "tangent", "reference"]


@final
@dataclass(frozen=True)
class RayleighDamping(DampingLaw):
    """Rayleigh (proportional) damping, C = alpha M + beta K, Eq. (14).

    Parameters
    ----------
    alpha : float
        Mass-proportional coefficient, 1/s.
    beta : float
        Stiffness-proportional coefficient, s.
    stiffness : {"strain-rate", "tangent", "reference"}
        The meaning of K in large motion.  ``strain-rate``: a Kelvin-Voigt force from the rates of axial strain and
        curvature.  It is objective, and about the straight beam its linearisation is the elastic K.  ``tangent``: the
        current tangent stiffness.  Where this stiffness is indefinite, as in a buckling beam, the force may add energy;
        ``simulate`` then warns.  ``reference``: the constant K of the straight beam, as in the paper.  It is not
        objective: in elements that have rotated, its axial part resists transverse motion.

    Raises
    ------
    InputError
        If a coefficient is negative or not finite, or the name is unknown.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=3)
    >>> law = RayleighDamping(alpha=0.2, beta=1e-5)
    >>> law.damping_ratios(modes, [0.0, 0.0, 0.0]).round(4)
    array([0.0085, 0.0018, 0.0015])
    """

    alpha: float = 0.0
    beta: float = 0.0
    stiffness: ProportionalStiffness = "strain-rate"

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, alpha=not_negative, beta=not_negative)
        choice(self.stiffness, get_args(ProportionalStiffness), "stiffness")
        if self.stiffness == "reference" and self.beta > 0.0:
            message = "damping proportional to the reference stiffness is not objective: it resists large rotations"
            warnings.warn(message, stacklevel=3)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients alpha (1/s) and beta (s) that are not 0."""
        return nonzero(
            Parameter("alpha", self.alpha, "1/s", "damping proportional to the mass"),
            Parameter("beta", self.beta, "s", "damping proportional to the stiffness"),
        )

    @property
    def dissipative(self) -> bool:
        """False with the tangent stiffness, which may be indefinite."""
        return self.stiffness != "tangent" or not self.beta

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return alpha M e_t and the stiffness-proportional force, Eqs. (11), (14)."""
        forces = []
        if self.alpha:
            forces.append(body.inertia_force(e_t, properties))
        if self.beta and self.stiffness == "strain-rate":
            forces.append(body.strain_rate_force(e, e_t, properties))
        elif self.beta and self.stiffness == "tangent":
            forces.append(body.tangent_force(e, e_t, properties))
        elif self.beta:
            forces.append(body.reference_force(e_t, properties))
        return weighted_sum(forces, parameters, e_t)

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return zeta = alpha/(2 omega) + beta phi^T K phi/(2 omega), at any amplitude.

        With the ``tangent`` stiffness phi^T K phi is omega^2, and this is Eq. (16).  The other two choices lack the
        stiffness due to gravity, 4 % of the beta part in mode 2 of the paper's beam.
        """
        check_instance(modes, "modes", Modes)
        stiffness = modes.angular_frequencies**2
        if self.stiffness != "tangent":
            model, p, shapes = modes.model, modes.model.properties, modes.shapes
            if self.stiffness == "strain-rate":
                forces = model.strain_rate_force(modes.equilibrium.coordinates, shapes, p).full()
            else:
                forces = model.tangent_stiffness(model.straight, p).sparse() @ shapes
            stiffness = (shapes * forces).sum(axis=0)
        return np.asarray((self.alpha + self.beta * stiffness) / (2 * modes.angular_frequencies))
