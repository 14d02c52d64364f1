"""Quadratic damping, Eqs. (19)-(26).

The air resists the velocity v = S e_t along the beam, Eq. (20), with the force per length gamma1 v + gamma2 |v| v,
Eq. (19), and so

    Q = int S^T (gamma1 v + gamma2 |v| v) dp,                       Eq. (23)
    gamma1 = eta1 mu,    gamma2 = eta2 mu 1183/876.                 Eq. (25)

In a uniform flow of the velocity u, v is the velocity relative to the air, S e_t - u.  On a beam at rest, the air then
exerts the force per length q = (gamma1 + gamma2 |u|) u, whatever the direction of the beam.  Small motion about rest is
damped by gamma1 + 2 gamma2 |u| per length along the flow, and by gamma1 + gamma2 |u| across it.

For the assumed shape of Eq. (21) alone, this gives Eq. (26), M e_tt + eta1 M e_t + eta2 M e_t |e_t| + K e = 0.

A strip of width b that moves across its plane through air of density rho_air meets the drag 1/2 rho_air Cd b |v| v per
length, which is gamma2 |v| v; so does a round rod of the diameter b.  With mu = rho b h of a strip this gives

    eta2 = 876/1183 rho_air Cd/(2 rho h).

If rho h varies along the beam, so does gamma2/mu, while the law has one eta2 for the whole beam.  This is then the mean
that takes the same energy out of a swing in the shape S of Eq. (21),

    eta2 = 876/1183 rho_air Cd/2 int b S^3 dp / int rho b h S^3 dp.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import casadi as cs
import numpy as np
from numpy.polynomial import Polynomial

from ancf_casadi.damping.law import (
    DampingLaw,
    Forces,
    Parameter,
    S,
    at_tip_amplitudes,
    check_values,
    nonzero,
    ratios_over_a_period,
    weighted_sum,
)
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.loads import LineLoad
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_fields, check_instance, limited_vector, not_negative, positive
from ancf_casadi.vibration.modes import Modes

DRAG_CONSTANT = 1183 / 876  # exact in Eqs. (24) and (25), where the paper rounds its inverse to 0.74
ASSUMED_SHAPE = Polynomial([0, 0, 2, -4 / 3, 1 / 3])  # S of Eq. (21), of the arc length relative to that of the beam


@final
@dataclass(frozen=True)
class QuadraticDamping(DampingLaw):
    """Air drag along the beam, linear and quadratic in the velocity: ``gamma1 v + gamma2 |v| v``, Eq. (19).

    Parameters
    ----------
    eta1 : float
        Linear coefficient gamma1/mu, 1/s.
    eta2 : float
        Quadratic coefficient 876/1183 gamma2/mu, 1/m.  The tables of the paper give it in 1/mm.
    flow : (float, float)
        Velocity u of the air along x and y, m/s; still air if not given.

    Raises
    ------
    InputError
        If a coefficient is negative, or a value is not finite.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, QuadraticDamping, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=1)
    >>> air = QuadraticDamping(eta1=0.1, eta2=0.2)
    >>> for amplitude in (0.01, 0.05):  # of the tip, m
    ...     print(air.damping_ratios(modes, [amplitude]).round(4))
    [0.0051]
    [0.0085]
    """

    eta1: float = 0.0
    eta2: float = 0.0
    flow: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, eta1=not_negative, eta2=not_negative, flow=limited_vector)

    @classmethod
    def from_drag(
        cls, drag_coefficient: float, air_density: float, beam: Beam, *, flow: tuple[float, float] = (0.0, 0.0)
    ) -> QuadraticDamping:
        """Return the law of a drag coefficient; the linear coefficient eta1 is 0.

        For a beam whose thickness or density varies, eta2 is the mean that takes as much energy as the drag itself out
        of a swing in the shape of Eq. (21).

        Parameters
        ----------
        drag_coefficient : float
            Drag coefficient Cd of the section, for motion across its breadth; in steady flow about 2 for a flat strip,
            and 1.2 for a cylinder at Reynolds numbers from 1e3 to 1e5.
        air_density : float
            Density of the air, kg/m^3.
        beam : Beam
            The beam.
        flow : (float, float)
            Velocity of the air along x and y, m/s; still air if not given.

        Raises
        ------
        InputError
            If the drag coefficient is negative, the density is not positive, a value is not finite, or a section of
            given stiffness states no breadth.

        Examples
        --------
        >>> from ancf_casadi import Beam, QuadraticDamping
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> law = QuadraticDamping.from_drag(drag_coefficient=0.99, air_density=1.2, beam=beam)
        >>> round(law.eta2, 3)  # 1/m
        0.11
        """
        check_instance(beam, "beam", Beam)
        drag_coefficient = not_negative(drag_coefficient, "drag_coefficient")
        air_density = positive(air_density, "air_density")
        share = np.diff((ASSUMED_SHAPE**3).integ()(np.linspace(0.0, 1.0, beam.elements + 1)))
        breadths = share @ [section.breadth for section in beam.sections]
        masses = share @ beam.mass_per_length
        return cls(eta2=float(drag_coefficient * air_density * breadths / (2 * masses) / DRAG_CONSTANT), flow=flow)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients eta1 (1/s) and eta2 (1/m), and the components of the flow (m/s), that are not 0."""
        x, y = self.flow
        return nonzero(
            Parameter("eta1", self.eta1, "1/s", "linear air drag, divided by the mass per length"),
            Parameter("eta2", self.eta2, "1/m", "quadratic air drag, divided by the mass per length"),
            Parameter("flow_x", x, "m/s", "velocity of the air along x", -math.inf),
            Parameter("flow_y", y, "m/s", "velocity of the air along y", -math.inf),
        )

    def with_parameters(self, values: Sequence[float] | Array) -> QuadraticDamping:
        """Return the law with other values of its parameters, in order; one out of range raises an ``InputError``."""
        names = [parameter.name for parameter in self.parameters]
        coefficients = dict(zip(names, check_values(self, values), strict=True))
        flow = coefficients.pop("flow_x", 0.0), coefficients.pop("flow_y", 0.0)
        return replace(self, **coefficients, flow=flow)

    def loads(self, beam: Beam) -> tuple[LineLoad, ...]:
        """Return the force per length q of a flow on a beam at rest, for each part of constant mass per length."""
        rate = self.eta1 + DRAG_CONSTANT * self.eta2 * math.hypot(*self.flow)
        if not (rate and any(self.flow)):
            return ()
        masses = beam.mass_per_length
        marks = [*np.flatnonzero(np.diff(masses, prepend=0.0)).tolist(), beam.elements]
        ends, (x, y) = beam.node_points.tolist(), self.flow
        sizes = (rate * masses).tolist()
        return tuple(LineLoad((sizes[k] * x, sizes[k] * y), ends[k], ends[m]) for k, m in itertools.pairwise(marks))

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return ``eta1 int S^T mu v dp + eta2 1183/876 int S^T mu |v| v dp``, Eq. (23), v relative to the air."""
        flow_axes = np.flatnonzero(self.flow)
        if flow_axes.size:
            count = len(self.parameters)
            parameters, flow = cs.vertsplit(parameters, [0, count - flow_axes.size, count])
            e_t = e_t - cs.repmat(cs.DM(body.unit_velocities[:, flow_axes]) @ flow, 1, e_t.shape[1])
        forces = []
        if self.eta1:
            forces.append(body.line_inertia_force(e_t, properties))
        if self.eta2:
            forces.append(DRAG_CONSTANT * body.drag_force(e_t, properties))
        return weighted_sum(forces, parameters, e_t)

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return ``b eta1/(2 omega) + 4 eta2 c A/(3 pi)``, ``c = 1183/876 int mu |phi|^3 dp / phi^T M phi``.

        The mode shape phi is 1 at the tip.  The constant c is 1 for the shape of Eq. (21), and smaller for the higher
        modes; b = int mu phi^2 dp / phi^T M phi is 1 unless the tip carries a mass.  In a flow, the ratios follow from
        the energy that a period loses beyond the mean force.

        Raises
        ------
        InputError
            If there is not one amplitude per mode.
        """
        check_instance(modes, "modes", Modes)
        if any(self.flow):
            model, values = modes.model, cs.DM([parameter.value for parameter in self.parameters])

            def force(velocities: Any) -> Any:
                return self.local_force(model, velocities, velocities, model.properties, values)

            # relative to the flow; below it, the damping is linear in the velocity to 1e-12
            return ratios_over_a_period(modes, amplitudes, force, 1e-6 * math.hypot(*self.flow))
        (tip, shapes, modal_mass), model = at_tip_amplitudes(modes, amplitudes), modes.model
        b, c = (
            (shapes * function(shapes, model.properties).full()).sum(axis=0) / modal_mass
            for function in (model.line_inertia_force, model.drag_force)
        )
        linear = self.eta1 * b / (2 * modes.angular_frequencies)
        return np.asarray(linear + 4 * self.eta2 * DRAG_CONSTANT * c * tip / (3 * math.pi))
