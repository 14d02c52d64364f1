"""The properties of a beam that a match may change: factors that are linear in the unknowns m.

The properties P, one value per element, become P (c + T m), element by element:

    Global        one factor for all elements (or for the tip mass or the clamp stiffness);  the given beam has m = 1
    PerElement    one factor for each element;                                               m = 1
    Smooth        1 + sum_j m_j L_j(x), x = 2 s/L - 1 from -1 to 1;                          m = 0

L_j are Legendre polynomials at the centres of the elements.  The first two are the mean and the linear taper, which
matter most; unlike cosines, they need not be flat at the ends.  Each polynomial is at most 1 in magnitude, so that m_j
is the size of its term.  They are orthogonal, so that further terms hardly change the first ones.

Factors stay within 1 - bounds and 1 + bounds.  For a smooth property these are linear constraints on m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import LUMPED, MAXIMUM_ELEMENTS, PROPERTIES
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import choice, positive, whole


def check_bounds(bounds: float, where: str) -> float:
    """Return a largest relative change of a property as a float.

    Raises
    ------
    InputError
        If it is not above 0 and at most 1.
    """
    bounds = positive(bounds, where)
    if bounds > 1.0:
        raise InputError(f"must be at most 1, got {bounds:g}", where)
    return bounds


def _check(name: str, bounds: float | None, known: tuple[str, ...] = PROPERTIES) -> None:
    choice(name, known, "unknowns")
    if bounds is not None:
        check_bounds(bounds, f"unknowns: {name}: bounds")


@dataclass(frozen=True)
class Global:
    """One factor on a property of all elements.

    Parameters
    ----------
    name : str
        ``width``, ``thickness``, ``density``, ``elastic_modulus``, ``tip_mass`` or ``clamp_stiffness``.
    bounds : float, optional
        Largest relative change, above 0 and at most 1; if not given, the ``bounds`` of ``match_frequencies``.
    """

    name: str
    bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        _check(self.name, self.bounds, PROPERTIES + LUMPED)

    def shape(self, elements: int) -> Array:
        """Return T, (n, 1), or (1, 1) for the tip mass and the clamp."""
        return np.ones((1 if self.name in LUMPED else elements, 1))

    def names(self, elements: int) -> tuple[str, ...]:
        """Return the names of the unknowns."""
        return (self.name,)


@dataclass(frozen=True)
class PerElement:
    """One factor on a property for each element; parameters as in ``Global``."""

    name: str
    bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        _check(self.name, self.bounds)

    def shape(self, elements: int) -> Array:
        """Return T, (n, n)."""
        return np.eye(elements)

    def names(self, elements: int) -> tuple[str, ...]:
        """Return the names of the unknowns, with their element from 1."""
        return tuple(f"{self.name}[{i + 1}]" for i in range(elements))


@dataclass(frozen=True)
class Smooth:
    """A smooth factor along the beam on a property.

    Parameters
    ----------
    name : str
        ``width``, ``thickness``, ``density`` or ``elastic_modulus``.
    terms : int
        Number of Legendre polynomials, from 1 to the number of elements: 1 for a constant, 2 for a linear taper, ...
    bounds : float, optional
        Largest relative change of any element, above 0 and at most 1; if not given, that of ``match_frequencies``.
    """

    name: str
    terms: int = 3
    bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        _check(self.name, self.bounds)
        whole(self.terms, f"unknowns: {self.name}: terms", 1, MAXIMUM_ELEMENTS)

    def shape(self, elements: int) -> Array:
        """Return T, (n, terms)."""
        if self.terms > elements:
            raise InputError(
                f"{self.terms} terms are more than the {elements} elements; use fewer terms", f"unknowns: {self.name}"
            )
        return np.asarray(legvander((2 * np.arange(elements) + 1) / elements - 1, self.terms - 1))

    def names(self, elements: int) -> tuple[str, ...]:
        """Return the names of the unknowns, with the degree of the polynomial."""
        return tuple(f"{self.name}~L{j}" for j in range(self.terms))


PropertyUnknown = Global | PerElement | Smooth

PAPER: tuple[PropertyUnknown, ...] = (
    PerElement("width"), PerElement("thickness"), Global("density"), Global("elastic_modulus")
)  # fmt: skip
