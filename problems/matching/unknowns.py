"""The properties of a beam that a match may change: factors that are linear in the unknowns m, within bounds.

The properties P, one value per element, become P f with the factors f = 1 + T (m - m_0), element by element:

    Global        one factor for all elements, or for a lumped property;  the given beam has m = 1
    PerElement    one factor for each element;                            m = 1
    Smooth        1 + sum_j m_j L_j(x), x = 2 s/L - 1 from -1 to 1;       m = 0

L_j are Legendre polynomials at the centres of the elements.  The first two are the mean and the linear taper, which
matter most; unlike cosines, they need not be flat at the ends.  Each polynomial is at most 1 in magnitude, so that m_j
is the size of its term.  They are orthogonal, so that further terms hardly change the first ones.

Factors stay within 1 - b and 1 + b for the relative bounds b.  For a smooth property these are linear constraints on m.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import MAXIMUM_ELEMENTS
from ancf_casadi.mechanics.lumped import COMBINED, LUMPED_KINDS, PROPERTIES, lumped_kind
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import choice, positive, shown, whole
from ancf_casadi.support.tables import Displayed


def check_bounds(bounds: float, where: str) -> float:
    """Return a largest relative change of a property as a float; it must be above 0 and at most 1."""
    with contextlib.suppress(InputError):
        if positive(bounds, where) <= 1.0:
            return float(bounds)
    wanted = "one number above 0 and at most 1, the largest relative change of a property, such as 0.1 for 10 %"
    raise InputError(f"must be {wanted}, got {shown(bounds)}", where)


def _check(name: str, bounds: float | None, names: tuple[str, ...] = ()) -> None:
    choice(name, (*PROPERTIES, *COMBINED, *names), "unknowns")
    if bounds is not None:
        check_bounds(bounds, f"unknowns: {name}: relative_bounds")


@dataclass(frozen=True)
class Global(Displayed):
    """One factor on a property of all elements.

    Parameters
    ----------
    name : str
        ``width``, ``thickness``, ``density``, ``elastic_modulus``, ``diameter``, ``bending_stiffness`` (by the
        modulus), ``mass_per_length`` (by the density), or a lumped property of the beam, such as
        ``tip_mass``, ``clamp_stiffness`` or ``spring_y`` (``Beam.lumped``).
    relative_bounds : float, optional
        Largest relative change, above 0 and at most 1; if not given, the ``bounds`` of ``match_frequencies``.

    Raises
    ------
    InputError
        If the property is unknown, or the bounds are not in this range.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import Global, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> match = match_frequencies(beam, targets=[1.95], unknowns=[Global("thickness", relative_bounds=0.2)])
    >>> print(f"{1e3 * match.beam.thickness[0]:.3f} mm")
    0.525 mm
    """

    name: str
    relative_bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        numbered = (self.name,) if lumped_kind(str(self.name)) else ()
        _check(self.name, self.relative_bounds, (*sorted(LUMPED_KINDS), *numbered))

    def shape(self, elements: int) -> Array:
        """Return T of the only factor, (1, 1)."""
        return np.ones((1, 1))


@dataclass(frozen=True)
class PerElement(Displayed):
    """One factor on a property for each element.

    Parameters
    ----------
    name : str
        Of all elements, as in ``Global``.
    relative_bounds : float, optional
        Largest relative change of any element, above 0 and at most 1; if not given, that of ``match_frequencies``.

    Raises
    ------
    InputError
        If the property is unknown, or the bounds are not in this range.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import PerElement, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> widths = PerElement("width", relative_bounds=0.2)
    >>> match = match_frequencies(beam, targets=[1.85, 10.4], unknowns=[widths])
    >>> [round(1e3 * width, 2) for width in match.beam.width]
    [4.77, 5.31, 4.67, 5.19]
    """

    name: str
    relative_bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        _check(self.name, self.relative_bounds)

    def shape(self, elements: int) -> Array:
        """Return T, (n, n)."""
        return np.eye(elements)


@dataclass(frozen=True)
class Smooth(Displayed):
    """A smooth factor along the beam on a property.

    Parameters
    ----------
    name : str
        Of all elements, as in ``Global``.
    terms : int
        Number of Legendre polynomials, from 1 to the number of elements: 1 for a constant, 2 for a linear taper, and so
        on.
    relative_bounds : float, optional
        Largest relative change of any element, above 0 and at most 1; if not given, that of ``match_frequencies``.

    Raises
    ------
    InputError
        If the property is unknown, or the number of terms or the bounds are not in their ranges.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import Smooth, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> taper = Smooth("thickness", terms=2)
    >>> match = match_frequencies(beam, targets=[1.95, 10.4], unknowns=[taper])
    >>> [round(1e3 * thickness, 3) for thickness in match.beam.thickness]
    [0.509, 0.49, 0.471, 0.452]
    """

    name: str
    terms: int = 3
    relative_bounds: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        _check(self.name, self.relative_bounds)
        whole(self.terms, f"unknowns: {self.name}: terms", 1, MAXIMUM_ELEMENTS)

    def shape(self, elements: int) -> Array:
        """Return T, (n, terms)."""
        if self.terms > elements:
            raise InputError(
                f"{self.terms} terms are more than the {elements} elements; use fewer terms", f"unknowns: {self.name}"
            )
        return np.asarray(legvander((2 * np.arange(elements) + 1) / elements - 1, self.terms - 1))


PropertyUnknown = Global | PerElement | Smooth

PAPER_UNKNOWNS: tuple[PropertyUnknown, ...] = (
    PerElement("width"), PerElement("thickness"), Global("density"), Global("elastic_modulus")
)  # fmt: skip
USUAL_UNKNOWNS: Mapping[frozenset[str], tuple[PropertyUnknown, ...]] = {  # by the kinds of the sections
    frozenset({"round"}): (PerElement("diameter"), Global("density"), Global("elastic_modulus")),
    frozenset({"stiffness"}): (PerElement("bending_stiffness"), Global("mass_per_length")),
}
