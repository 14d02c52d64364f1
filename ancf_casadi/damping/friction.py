"""Dry friction along the beam.

Friction resists the velocity v = S e_t along the beam, Eq. (20), with a force per length of constant magnitude gamma0
against the motion, and so

    Q = int S^T gamma0 v/|v| dp,    gamma0 = eta0 mu 52/81.

For the shape S of Eq. (21) alone, with int S^2 dp / int S dp = 52/81, this is the equation of one mode under friction,
r'' + eta0 sign(r') + omega^2 r = 0 (``decay.friction``).  The coefficient eta0 of a decay fitted with friction is
therefore eta0 of this law.

Smoothing.  The direction v/|v| jumps where the motion turns back.  It is replaced by

    v/(|v|^2 + v0^2)^(1/2)

with a smoothing speed v0: friction of full magnitude where |v| is well above v0, and linear damping with the rate
eta0 (52/81)/v0 where |v| is well below.  A beam that friction would hold at rest thus creeps to its equilibrium.

References
----------
"Comparison of external damping models in a large deformation problem", Eqs. (20), (21).
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Section 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

from ancf_casadi.damping.law import (
    DampingLaw,
    Forces,
    Parameter,
    S,
    nonzero,
    ratios_over_a_period,
    weighted_sum,
)
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_fields, check_instance, not_negative, positive
from ancf_casadi.vibration.modes import Modes

FRICTION_CONSTANT = 52 / 81  # exact: int S^2 dp / int S dp for the shape S of Eq. (21)


@final
@dataclass(frozen=True)
class FrictionDamping(DampingLaw):
    """Dry friction along the beam, of constant magnitude against the motion: ``gamma0 v/|v|``.

    Parameters
    ----------
    eta0 : float
        Coefficient 81/52 gamma0/mu, m/s^2: friction force per mass of one mode.
    smoothing_speed : float
        Speed v0 below which friction fades to zero, m/s; a setting, not a parameter to estimate.  With the default, the
        equivalent damping ratio is within 1 % of that of ideal friction if the tip of a bending beam reaches 0.05 m/s.

    Raises
    ------
    InputError
        If the coefficient is negative or not finite, or the speed is not positive.

    Examples
    --------
    >>> from ancf_casadi import Beam, FrictionDamping, Model, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=1)
    >>> friction = FrictionDamping(eta0=0.05)
    >>> for amplitude in (0.02, 0.04):  # of the tip, m
    ...     print(friction.damping_ratios(modes, [amplitude]).round(4))
    [0.0115]
    [0.0058]
    """

    eta0: float = 0.0
    smoothing_speed: float = 1e-3

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, eta0=not_negative, smoothing_speed=positive)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficient eta0 (m/s^2), if it is not 0."""
        return nonzero(Parameter("eta0", self.eta0, "m/s^2", "dry friction, divided by the mass per length"))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return ``eta0 52/81 int S^T mu v/(|v|^2 + v0^2)^(1/2) dp``."""
        forces = [body.friction_force(e_t, properties, self.smoothing_speed)] if self.eta0 else []
        return weighted_sum([FRICTION_CONSTANT * force for force in forces], parameters, e_t)

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return ``2 eta0 b/(pi omega^2 A)``, ``b = 52/81 int mu |phi| dp / phi^T M phi``, corrected for the smoothing.

        The mode shape phi is 1 at the tip.  The constant b is 1 for the shape of Eq. (21).  The energy per period is
        exact for the smoothed friction.  The ratio therefore stays finite at zero amplitude: it is that of the linear
        damping with the rate eta0 (52/81)/v0, often above 1, and means that friction holds the beam.

        Raises
        ------
        InputError
            If there is not one amplitude per mode.
        """
        check_instance(modes, "modes", Modes)
        model, least_speed = modes.model, 1e-6 * self.smoothing_speed  # below it, friction is linear to 1e-12

        def unit(velocities: Array) -> Any:
            return model.friction_force(velocities, model.properties, self.smoothing_speed)

        return self.eta0 * FRICTION_CONSTANT * ratios_over_a_period(modes, amplitudes, unit, least_speed)
