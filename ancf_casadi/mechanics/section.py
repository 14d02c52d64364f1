"""A rectangular cross-section, and the range of the properties of elements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import positive
from ancf_casadi.support.tables import Displayed

# bounds in SI units; products of values beyond them overflow or vanish
SMALLEST_PROPERTY, LARGEST_PROPERTY = 1e-100, 1e100


@dataclass(frozen=True)
class Section(Displayed):
    """A rectangular cross-section.

    Parameters
    ----------
    width : float
        Extent out of the plane of motion, m.
    thickness : float
        Extent in the plane of motion, m.

    Raises
    ------
    InputError
        If a side is not a positive number, or exceeds 1e100 m.

    Examples
    --------
    >>> from ancf_casadi import Section
    >>> section = Section(width=5e-3, thickness=0.5e-3)
    >>> print(f"{section.area:.3g} m^2, {section.second_moment:.3g} m^4")
    2.5e-06 m^2, 5.21e-14 m^4
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        """Validate."""
        for name in ("width", "thickness"):
            if positive(getattr(self, name), name) > LARGEST_PROPERTY:
                raise InputError(f"{getattr(self, name):g} m is beyond the range of numbers; check the unit", name)

    @property
    def area(self) -> float:
        """Area A = b h, m^2."""
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        """Second moment of area I = b h^3 / 12, m^4."""
        return self.width * self.thickness**3 / 12


def masses_per_length(densities: Iterable[float], sections: Iterable[Section]) -> Array:
    """Return the mass per length rho A of elements, (n,), kg/m."""
    return np.array([rho * section.area for rho, section in zip(densities, sections, strict=True)])


def check_elements(lengths: Array, properties: Iterable[tuple[float, float, float, float]]) -> None:
    """Reject elements whose mass or stiffness overflows or vanishes; the usual cause is a wrong unit.

    Their properties are width, thickness, density and elastic modulus.
    """
    if not lengths.min():
        raise InputError(f"{lengths.sum():g} m is beyond the range of numbers; check the units", "length")
    for k, (l, (b, h, rho, modulus)) in enumerate(zip(lengths.tolist(), properties, strict=True)):
        terms = {
            "mass": rho * b * h * l,
            "axial stiffness": modulus * b * h / l,
            "bending stiffness": modulus * (b * h * h * h) / 12 / l / l / l,
        }
        for name, value in terms.items():
            if not SMALLEST_PROPERTY <= value <= LARGEST_PROPERTY:
                raise InputError(
                    f"the {name} of element {k + 1} is {value:g}, beyond the range of numbers; check the units"
                )
