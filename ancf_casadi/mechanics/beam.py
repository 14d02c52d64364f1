"""The beam: geometry, material, orientation and gravity, in SI units.

A beam of length L is divided into n elements of equal length l = L/n.  Each element has a rectangular section of
width b (out of the plane) and thickness h (in the plane of motion), a density rho and an elastic modulus E, so that

    area A = b h,    second moment I = b h^3 / 12,    mass per length mu = rho A.

The unloaded beam is straight.  It is clamped at its first node and points along ``axis`` there.  Optionally the clamp
is a torsional spring, and the tip carries a mass.  The laboratory frame has x to the right and y up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import read_toml
from ancf_casadi.support.inputs import (
    check_keys,
    is_sequence,
    located,
    number,
    positive,
    positive_or_infinite,
    vector,
    whole,
)
from ancf_casadi.support.tables import Displayed, counted

PROPERTIES = ("width", "thickness", "density", "elastic_modulus")
LUMPED = ("tip_mass", "clamp_stiffness")
BEAM_UNITS = {"width": "m", "thickness": "m", "density": "kg/m^3", "elastic_modulus": "Pa", "tip_mass": "kg",
         "clamp_stiffness": "N m/rad"}  # fmt: skip
MINIMUM_ELEMENTS = 2
MAXIMUM_ELEMENTS = 10_000  # a larger number is taken for a typing error
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


@dataclass(frozen=True)
class Beam(Displayed):
    """A clamped beam with one value of each property per element.

    ``Beam.uniform`` and ``Beam.from_toml`` are the usual ways to make one.

    Parameters
    ----------
    length : float
        Length L, m.
    width, thickness : tuple of float
        Section of each element, m.
    density : tuple of float
        Density of each element, kg/m^3.
    elastic_modulus : tuple of float
        Elastic modulus of each element, Pa.
    axis : (float, float)
        Direction of the beam at the clamp, of any length above 0; stored as a unit vector.
    gravity : (float, float)
        Acceleration of gravity, m/s^2.
    tip_mass : float
        Point mass at the tip, kg.
    clamp_stiffness : float
        Torsional stiffness of the clamp, N m/rad; infinite for a rigid clamp.

    Raises
    ------
    InputError
        If a value is not finite and positive (gravity: not finite; tip mass: negative), the axis is zero, the tuples
        differ in length, there are fewer than 2 or more than 10000 elements, or the mass or a stiffness of an element
        is beyond the range of numbers.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=20)
    >>> print(f"{1e3 * beam.mass:.1f} g, elements of {1e3 * beam.element_length:.0f} mm")
    10.0 g, elements of 25 mm
    >>> standing = beam.with_(axis=(0.0, 1.0), tip_mass=2e-3)
    """

    length: float
    width: tuple[float, ...]
    thickness: tuple[float, ...]
    density: tuple[float, ...]
    elastic_modulus: tuple[float, ...]
    axis: tuple[float, float] = (0.0, -1.0)
    gravity: tuple[float, float] = (0.0, -9.81)
    tip_mass: float = 0.0
    clamp_stiffness: float = math.inf

    def __post_init__(self) -> None:
        """Validate, and normalise the axis."""
        object.__setattr__(self, "length", positive(self.length, "length"))
        for name in PROPERTIES:
            if not is_sequence(getattr(self, name)):
                raise InputError("must have one value per element; Beam.uniform also takes one number", name)
            object.__setattr__(self, name, tuple(positive(value, name) for value in getattr(self, name)))
            if len(getattr(self, name)) != len(self.width):
                raise InputError(f"has {len(getattr(self, name))} values for {len(self.width)} elements", name)
        whole(self.elements, "elements", MINIMUM_ELEMENTS, MAXIMUM_ELEMENTS)
        self._check_range()
        axis, gravity = vector(self.axis, "axis"), vector(self.gravity, "gravity")
        norm = math.hypot(*axis)
        if norm == 0.0:
            raise InputError("must not be the zero vector", "axis")
        if abs(norm - 1.0) > 1e-15:  # a unit vector keeps all its digits
            axis = axis[0] / norm, axis[1] / norm
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "gravity", gravity)
        if number(self.tip_mass, "tip_mass") < 0.0:
            raise InputError(f"must not be negative, got {self.tip_mass:g}", "tip_mass")
        object.__setattr__(self, "tip_mass", float(self.tip_mass))
        object.__setattr__(self, "clamp_stiffness", positive_or_infinite(self.clamp_stiffness, "clamp_stiffness"))

    @classmethod
    def uniform(
        cls,
        *,
        length: float,
        width: float | Sequence[float],
        thickness: float | Sequence[float],
        density: float | Sequence[float],
        elastic_modulus: float | Sequence[float],
        elements: int,
        axis: tuple[float, float] = (0.0, -1.0),
        gravity: tuple[float, float] = (0.0, -9.81),
        tip_mass: float = 0.0,
        clamp_stiffness: float = math.inf,
    ) -> Beam:
        """Make a beam with properties that are the same in all elements, or given element by element.

        Parameters
        ----------
        width, thickness, density, elastic_modulus : float or sequence of float
            As in ``Beam``, or one number for all elements.
        elements : int
            Number of elements, at least 2.
        length, axis, gravity, tip_mass, clamp_stiffness
            See ``Beam``.

        Raises
        ------
        InputError
            As in ``Beam``; or if a sequence does not have ``elements`` values.

        Examples
        --------
        >>> from ancf_casadi import Beam
        >>> taper = Beam.uniform(length=0.3, width=0.02, thickness=(2e-3, 1.5e-3, 1e-3),
        ...                      density=1200.0, elastic_modulus=2e9, elements=3)
        >>> taper.thickness
        (0.002, 0.0015, 0.001)
        >>> taper.density
        (1200.0, 1200.0, 1200.0)
        """
        elements = whole(elements, "elements", MINIMUM_ELEMENTS, MAXIMUM_ELEMENTS)
        given = {"width": width, "thickness": thickness, "density": density, "elastic_modulus": elastic_modulus}
        spread: dict[str, Any] = {name: _spread(value, elements, name) for name, value in given.items()}
        lumped: dict[str, Any] = {"tip_mass": tip_mass, "clamp_stiffness": clamp_stiffness}
        return cls(length=length, axis=axis, gravity=gravity, **lumped, **spread)

    @classmethod
    def from_toml(cls, path: str | Path) -> Beam:
        """Read a beam from the table ``[beam]`` of a TOML file, with the keys of ``Beam.uniform``.

        Raises
        ------
        InputError
            If the file cannot be read, a key is missing or unknown, or a value is unusable.

        Examples
        --------
        >>> from pathlib import Path
        >>> from ancf_casadi import Beam
        >>> _ = Path("beam.toml").write_text('''[beam]
        ... length = 0.5
        ... width = 5e-3
        ... thickness = 0.5e-3
        ... density = 8000.0
        ... elastic_modulus = 210e9
        ... elements = 20
        ... ''')
        >>> Beam.from_toml("beam.toml").elements
        20
        """
        return cls.from_table(read_toml(path).get("beam"), str(path))

    @classmethod
    def from_table(cls, table: Any, where: str) -> Beam:
        """Make a beam from the table ``[beam]`` of a document, called ``where`` in messages; see ``from_toml``."""
        if not isinstance(table, dict):
            raise InputError("has no table [beam]", where)
        required = {"length", "elements", *PROPERTIES}
        check_keys(table, required, {"axis", "gravity", *LUMPED}, f"{where}: [beam]")
        with located(f"{where}: [beam]"):
            return cls.uniform(**table)

    @property
    def elements(self) -> int:
        """Number of elements n."""
        return len(self.width)

    @property
    def element_length(self) -> float:
        """Length l = L/n of an element, m."""
        return self.length / self.elements

    @property
    def sections(self) -> tuple[Section, ...]:
        """The section of each element."""
        return tuple(Section(b, h) for b, h in zip(self.width, self.thickness, strict=True))

    @property
    def mass(self) -> float:
        """Mass of the beam without the tip mass, kg."""
        return sum(rho * s.area for rho, s in zip(self.density, self.sections, strict=True)) * self.element_length

    def with_(self, **changes: Any) -> Beam:
        """Return a copy with some fields changed; a number applies to all elements.

        Raises
        ------
        InputError
            If a name is not a field of ``Beam``, or a value is unusable.

        Examples
        --------
        >>> from ancf_casadi import Beam
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> thicker = beam.with_(thickness=0.6e-3, tip_mass=1e-3)
        >>> thicker.thickness
        (0.0006, 0.0006, 0.0006, 0.0006)
        >>> beam.tip_mass, thicker.tip_mass
        (0.0, 0.001)
        """
        names = {field.name for field in fields(self)}
        for name, value in changes.items():
            if name not in names:
                raise InputError(f"is not a property of a beam; known are {', '.join(sorted(names))}", name)
            if name in PROPERTIES:
                changes[name] = _spread(value, self.elements, name)
        return replace(self, **changes)

    def _check_range(self) -> None:
        """Reject values whose products overflow or vanish; the usual cause is a wrong unit."""
        l = self.element_length
        if l == 0.0:
            raise InputError(f"{self.length:g} m is beyond the range of numbers; check the units", "length")
        values = zip(*(getattr(self, name) for name in PROPERTIES), strict=True)
        for k, (b, h, rho, modulus) in enumerate(values):
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

    def _summary(self) -> str:
        wide, thick = (f"{1e3 * min(sizes):.4g}" for sizes in (self.width, self.thickness))
        varies = "" if len({*self.sections}) == 1 else " or more"
        return f"{self.length:.4g} m, {counted(self.elements, 'element')}, {wide} x {thick} mm{varies}"


def _spread(value: Any, elements: int, name: str) -> tuple[float, ...]:
    if is_sequence(value):
        if len(value) != elements:
            raise InputError(f"has {len(value)} values for {elements} elements", name)
        return tuple(value)
    return (value,) * elements
