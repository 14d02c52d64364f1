"""The air around a vibrating beam: drag coefficient of a quadratic coefficient, and damping by viscosity.

**Drag.**  ``QuadraticDamping.from_drag`` makes eta2 proportional to the drag coefficient; the inverse for a uniform
section is Cd = 2 rho h eta2 (1183/876)/rho_air.  The relative variances of eta2 and of the density of the air add up.

**Viscosity.**  A strip of width b that oscillates across its plane with w = Re W exp(-i omega t), at amplitudes far
below its width, meets the force per length

    F = pi/4 rho_air omega^2 b^2 Gamma W,        Re = omega b^2/(4 nu),

with the hydrodynamic function Gamma of the Reynolds number and the kinematic viscosity nu.  Its imaginary part is
viscous damping with c = pi/4 rho_air omega b^2 Im Gamma, and in one mode of shape phi

    zeta = int c phi^2 dp / (2 omega phi^T M phi),

for a uniform strip pi rho_air b Im Gamma/(8 rho h).  The real part, the mass of air that moves along, is left out; it
is about a thousandth of that of a steel strip.  For a circular cylinder

    Gamma = 1 + 4 i K1(z)/((i Re)^1/2 K0(z)),    z = -i (i Re)^1/2,

and for a thin strip this times the correction Omega, rational functions of log10 Re that are accurate to 0.1 % for
Re from 1e-6 to 1e4.

References
----------
J. E. Sader, Frequency response of cantilever beams immersed in viscous fluids, Journal of Applied Physics 84 (1998),
64-76, Eqs. (20) and (21).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.special import kve

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.vibration.modes import Modes


@dataclass(frozen=True)
class Air:
    """The air around a beam; the defaults are those of a room at 20 degrees Celsius."""

    density: float = 1.2  # kg/m^3
    viscosity: float = 1.81e-5  # dynamic, Pa s
    density_std: float = 0.0  # standard error of the density, kg/m^3


def implied_drag_coefficient(eta2: Any, beam: Beam, air: Air, *, eta2_error: Any = 0.0) -> tuple[Any, Any]:
    """Return the drag coefficients of a beam for values of eta2 (1/m), and their standard errors."""
    unit = QuadraticDamping.from_drag(1.0, air.density, beam).eta2
    return eta2 / unit, np.hypot(eta2_error / unit, eta2 / unit * air.density_std / air.density)


def viscous_damping_ratios(modes: Modes, air: Air) -> Array:
    """Return the damping ratio that the viscosity of the air causes in each mode at small amplitudes, (m,)."""
    beam, ω = modes.model.beam, modes.angular_frequencies
    width = np.array(beam.width)[:, None]
    reynolds = air.density * ω * width**2 / (4 * air.viscosity)
    coefficients = math.pi / 4 * air.density * ω * width**2 * hydrodynamic_function(reynolds).imag
    points, weights = gauss(4)  # of an element, exact for the square of a cubic shape
    places = beam.node_points[:-1, None] + beam.element_lengths[:, None] * points
    shapes = np.array([[modes.model.interpolation(s) @ modes.shapes for s in row] for row in places.tolist()])
    # int phi^2 dp of element and mode
    squares = beam.element_lengths[:, None] * np.einsum("g,egdm->em", weights, shapes**2)
    return np.asarray((coefficients * squares).sum(axis=0) / (2 * ω))


def hydrodynamic_function(reynolds: ArrayLike) -> ComplexArray:
    """Return Gamma of a thin strip that oscillates across its plane, with the correction Omega, Eq. (21) of Sader."""
    τ = np.log10(reynolds)
    real = Polynomial([0.91324, -0.48274, 0.46842, -0.12886, 0.044055, -0.0035117, 0.00069085])(τ) / Polynomial(
        [1.0, -0.56964, 0.48690, -0.13444, 0.045155, -0.0035862, 0.00069085]
    )(τ)
    imaginary = Polynomial([-0.024134, -0.029256, 0.016294, -0.00010961, 0.000064577, -0.000044510])(τ) / Polynomial(
        [1.0, -0.59702, 0.55182, -0.18357, 0.079156, -0.014369, 0.0028361]
    )(τ)
    return np.asarray(circular_function(reynolds) * (real + 1j * imaginary))


def circular_function(reynolds: ArrayLike) -> ComplexArray:
    """Return Gamma of a circular cylinder, exact."""
    root = np.sqrt(1j * np.asarray(reynolds))
    return np.asarray(1 + 4j * kve(1, -1j * root) / (root * kve(0, -1j * root)))
