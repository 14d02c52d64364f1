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

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import kve

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import check_instance, number, positive
from ancf_casadi.vibration.modes import Modes

LEAST_REYNOLDS, LARGEST_REYNOLDS = 1e-6, 1e4  # range of the correction


@dataclass(frozen=True)
class Air:
    """The air around a beam; the defaults are those of a room at 20 degrees Celsius.

    Parameters
    ----------
    density : float
        Density, kg/m^3.
    viscosity : float
        Dynamic viscosity, Pa s.
    density_std : float
        Standard error of the density, kg/m^3.

    Raises
    ------
    InputError
        If density or viscosity is not positive, or the error is negative.
    """

    density: float = 1.2
    viscosity: float = 1.81e-5
    density_std: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        positive(self.density, "density")
        positive(self.viscosity, "viscosity")
        _not_negative(self.density_std, "density_std")


def implied_drag_coefficient(
    eta2: float, beam: Beam, air: Air | None = None, *, eta2_error: float = 0.0
) -> tuple[float, float]:
    """Return the drag coefficient with which air drag has a quadratic damping coefficient, and its standard error.

    Parameters
    ----------
    eta2 : float
        Quadratic coefficient of the law ``QuadraticDamping``, 1/m.
    beam : Beam
        The beam.
    air : Air, optional
        The air; at 20 degrees Celsius if not given.
    eta2_error : float
        Standard error of eta2, 1/m.

    Raises
    ------
    InputError
        If eta2 is not a finite number, or its error is negative.
    """
    air = Air() if air is None else air
    unit = QuadraticDamping.from_drag(1.0, air.density, beam).eta2
    value, error = number(eta2, "eta2") / unit, _not_negative(eta2_error, "eta2_error") / unit
    return value, math.hypot(error, value * air.density_std / air.density)


def viscous_damping_ratios(modes: Modes, air: Air | None = None) -> Array:
    """Return the damping ratio that the viscosity of the air causes in each mode at small amplitudes, (m,).

    Parameters
    ----------
    modes : Modes
        Natural modes of a beam that is much wider than thick.
    air : Air, optional
        The air; at 20 degrees Celsius if not given.

    Raises
    ------
    InputError
        If the Reynolds number of a mode is outside 1e-6 to 1e4.
    """
    check_instance(modes, "modes", Modes)
    air, model, l = Air() if air is None else air, modes.model, modes.model.beam.element_length
    width = np.array(model.beam.width)[:, None]
    Re = reynolds_numbers(modes.angular_frequencies, width, air)
    coefficients = math.pi / 4 * air.density * modes.angular_frequencies * width**2 * hydrodynamic_function(Re).imag
    points, weights = gauss(4)  # of an element, exact for the square of a cubic shape
    places = l * (np.arange(model.beam.elements)[:, None] + points)
    shapes = np.array([[model.interpolation(s) @ modes.shapes for s in row] for row in places.tolist()])
    squares = l * np.einsum("g,egdm->em", weights, shapes**2)  # int phi^2 dp of each element and mode
    return np.asarray((coefficients * squares).sum(axis=0) / (2 * modes.angular_frequencies))


def reynolds_numbers(angular_frequencies: Array, width: Array | float, air: Air) -> Array:
    """Return Re = rho_air omega b^2/(4 viscosity) of frequencies, rad/s, and widths, m."""
    return np.asarray(air.density * angular_frequencies * width**2 / (4 * air.viscosity))


def hydrodynamic_function(reynolds: ArrayLike) -> ComplexArray:
    """Return Gamma of a thin strip that oscillates across its plane, complex, at Reynolds numbers of any shape.

    Raises
    ------
    InputError
        If a Reynolds number is outside 1e-6 to 1e4.
    """
    Re = np.asarray(reynolds, dtype=float)
    if not ((Re >= LEAST_REYNOLDS) & (Re <= LARGEST_REYNOLDS)).all():
        raise InputError(
            f"{Re.min():.3g} to {Re.max():.3g} is not within {LEAST_REYNOLDS:g} to {LARGEST_REYNOLDS:g}, where the "
            "flow around a strip is known; check width, frequency and air",
            "Reynolds number",
        )
    return np.asarray(circular_function(Re) * _strip_correction(np.log10(Re)))


def circular_function(reynolds: ArrayLike) -> ComplexArray:
    """Return Gamma of a circular cylinder, exact."""
    root = np.sqrt(1j * np.asarray(reynolds))
    return np.asarray(1 + 4j * kve(1, -1j * root) / (root * kve(0, -1j * root)))


def _strip_correction(τ: Array) -> ComplexArray:
    """Return Omega at log10 Re, Eq. (21) of Sader."""
    real = _polynomial(τ, 0.91324, -0.48274, 0.46842, -0.12886, 0.044055, -0.0035117, 0.00069085) / _polynomial(
        τ, 1.0, -0.56964, 0.48690, -0.13444, 0.045155, -0.0035862, 0.00069085
    )
    imaginary = _polynomial(τ, -0.024134, -0.029256, 0.016294, -0.00010961, 0.000064577, -0.000044510) / _polynomial(
        τ, 1.0, -0.59702, 0.55182, -0.18357, 0.079156, -0.014369, 0.0028361
    )
    return np.asarray(real + 1j * imaginary)


def _polynomial(x: Array, *coefficients: float) -> Array:
    return np.asarray(np.polynomial.polynomial.polyval(x, np.array(coefficients)))


def _not_negative(value: float, where: str) -> float:
    """Return a finite number that is not negative.

    Raises
    ------
    InputError
        If it is anything else.
    """
    result = number(value, where)
    if result < 0.0:
        raise InputError(f"must not be negative, got {result:g}", where)
    return result
