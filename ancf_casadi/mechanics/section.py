"""Cross-sections, their equivalent rectangles, and the range of the properties of elements.

A section acts on the motion by its area A and its second moment of area I alone, as the rectangle does that has the
same two, of the width b and the thickness h,

    h = (12 I/A)^1/2,    b = A/h.

For a tube with the diameters d outside and k d inside, A = pi/4 d^2 (1 - k^2) and I = pi/64 d^4 (1 - k^4), so that

    h = (3/4 (1 + k^2))^1/2 d,    b = pi/4 (1 - k^2) d^2/h,

which for a rod (k = 0) are 0.866 d and 0.907 d.  A section of the stiffnesses E I and E A and the mass per length mu
has h = (12 E I/(E A))^1/2, and by convention b = h, E = E A/h^2 and rho = mu/h^2.

The equivalent rectangle has the width and the thickness of an element.  The extents of the section itself are its
breadth, which meets the air, and its depth, which a strain gauge on the surface notices.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, not_negative, positive
from ancf_casadi.support.specs import Positive, Spec
from ancf_casadi.support.tables import BRIEF, Displayed

# bounds in SI units; products of values beyond them overflow or vanish
SMALLEST_PROPERTY, LARGEST_PROPERTY = 1e-100, 1e100


class Shape(Spec, frozen=True):
    """Kind of a section, and its proportions: what its equivalent rectangle does not tell."""

    kind: Literal["rectangle", "round", "stiffness"] = "rectangle"
    bore: Annotated[float, Meta(ge=0.0, lt=1.0, description="inner per outer diameter, if round")] = 0.0
    breadth: Annotated[Positive | None, Meta(description="per width, of given stiffness; null if unknown")] = None
    depth: Annotated[Positive | None, Meta(description="per thickness, of given stiffness; null if unknown")] = None

    def extent(self, name: Literal["breadth", "depth"]) -> float:
        """Return breadth per width, or depth per thickness; one that is not known raises an ``InputError``."""
        if self.kind == "rectangle":
            return 1.0
        if self.kind == "round":
            thickness = math.sqrt(0.75 * (1.0 + self.bore**2))  # per diameter
            area = math.pi / 4 * (1.0 - self.bore) * (1.0 + self.bore)
            return 1 / thickness if name == "depth" else thickness / area
        value = self.depth if name == "depth" else self.breadth
        if value is None:
            stated = "a depth" if name == "depth" else "a depth or a breadth"
            raise InputError(f"is not known for a section of given stiffness; give Section.stiffness {stated}", name)
        return value


RECTANGLE = Shape()


@dataclass(frozen=True)
class Section(Displayed):
    """A cross-section: a rectangle, or by ``circle``, ``tube`` and ``stiffness`` another one.

    Another section has the width and the thickness of the rectangle with the same area and second moment of area.

    Parameters
    ----------
    width : float
        Extent out of the plane of motion, m.
    thickness : float
        Extent in the plane of motion, m.
    shape : Shape
        Kind and proportions of the section, as the class methods set them.
    elastic_modulus, density : float, optional
        Those of the equivalent rectangle, Pa and kg/m^3, of a section of given stiffness only.

    Raises
    ------
    InputError
        If a size is not a positive number, or exceeds 1e100 m.

    Examples
    --------
    >>> from ancf_casadi import Section
    >>> section = Section(width=5e-3, thickness=0.5e-3)
    >>> print(f"{section.area:.3g} m^2, {section.second_moment:.3g} m^4")
    2.5e-06 m^2, 5.21e-14 m^4
    >>> Section.circle(2e-3)
    Section(diameter=0.002)
    """

    width: float
    thickness: float
    shape: Shape = RECTANGLE
    elastic_modulus: float | None = None
    density: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        for name in ("width", "thickness"):
            if positive(getattr(self, name), name) > LARGEST_PROPERTY:
                raise InputError(f"{getattr(self, name):g} m is beyond the range of numbers; check the unit", name)
        check_instance(self.shape, "shape", Shape)

    @classmethod
    def rectangle(cls, width: float, thickness: float) -> Section:
        """Return a rectangle of a width out of the plane of motion and a thickness in this plane, m."""
        return cls(width, thickness)

    @classmethod
    def circle(cls, diameter: float) -> Section:
        """Return a circle, m."""
        return cls.of_diameter(positive(diameter, "diameter"), Shape("round"))

    @classmethod
    def tube(cls, outer: float, inner: float) -> Section:
        """Return the section of a tube with an outer and an inner diameter, m.

        Raises
        ------
        InputError
            If the inner diameter is negative, or not below the outer one.

        Examples
        --------
        >>> from ancf_casadi import Section
        >>> round(Section.tube(outer=10e-3, inner=8e-3).area / Section.circle(10e-3).area, 6)
        0.36
        """
        outer, inner = positive(outer, "outer"), not_negative(inner, "inner")
        if not inner < outer:
            raise InputError(f"the diameter must be below the outer one, {outer:g} m, got {inner:g} m", "inner")
        return cls.of_diameter(outer, Shape("round", inner / outer))

    @classmethod
    def stiffness(
        cls,
        bending: float,
        axial: float,
        mass_per_length: float,
        depth: float | None = None,
        breadth: float | None = None,
    ) -> Section:
        """Return a section of given stiffness and mass, as a data sheet states them.

        Parameters
        ----------
        bending : float
            Bending stiffness E I, N m^2.
        axial : float
            Axial stiffness E A, N.
        mass_per_length : float
            Mass per length, kg/m.
        depth : float, optional
            Extent in the plane of motion, m, which a strain gauge needs.
        breadth : float, optional
            Extent out of the plane of motion, m, which the drag needs; that in the plane if not given.

        Raises
        ------
        InputError
            If a value is not a positive number.

        Examples
        --------
        >>> from ancf_casadi import Section
        >>> cable = Section.stiffness(bending=0.02, axial=4e4, mass_per_length=0.05, depth=4e-3)
        >>> print(f"{1e3 * cable.thickness:.2f} mm, {cable.elastic_modulus / 1e9:.2f} GPa, {cable.density:.0f} kg/m^3")
        2.45 mm, 6.67 GPa, 8333 kg/m^3
        """
        values = {"bending": bending, "axial": axial, "mass_per_length": mass_per_length}
        bending, axial, mass_per_length = (positive(value, name) for name, value in values.items())
        side = math.sqrt(12 * (bending / axial))
        extents = {"depth": depth, "breadth": depth if breadth is None else breadth}
        ratios = {name: positive(size, name) / side for name, size in extents.items() if size is not None}
        return cls(side, side, Shape("stiffness", **ratios), axial / side**2, mass_per_length / side**2)

    @classmethod
    def of_diameter(cls, diameter: float, shape: Shape) -> Section:
        """Return a round section of a shape."""
        return cls(diameter / shape.extent("breadth"), diameter / shape.extent("depth"), shape)

    @property
    def area(self) -> float:
        """Area A = b h, m^2; of a section of given stiffness, that of its equivalent rectangle."""
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        """Second moment of area I = b h^3 / 12, m^4; as the area."""
        return self.width * self.thickness**3 / 12

    @property
    def breadth(self) -> float:
        """Extent of the section out of the plane of motion, m; an ``InputError`` if it is not known."""
        return self.width * self.shape.extent("breadth")

    @property
    def depth(self) -> float:
        """Extent of the section in the plane of motion, m; an ``InputError`` if it is not known."""
        return self.thickness * self.shape.extent("depth")

    @property
    def diameter(self) -> float:
        """Outer diameter of a circle or a tube, m; an ``InputError`` if the section is neither."""
        if self.shape.kind != "round":
            raise InputError("only circles and tubes have one", "diameter")
        return self.depth

    def _summary(self) -> str:
        sizes = {"width": self.width, "thickness": self.thickness}
        if self.shape.kind == "round":
            inner = self.shape.bore * self.diameter
            sizes = {"outer": self.diameter, "inner": inner} if inner else {"diameter": self.diameter}
        elif self.elastic_modulus and self.density:
            bending, axial = self.elastic_modulus * self.second_moment, self.elastic_modulus * self.area
            sizes = {"bending": bending, "axial": axial, "mass_per_length": self.density * self.area}
            sizes |= {name: getattr(self, name) for name in ("depth", "breadth") if getattr(self.shape, name)}
        return ", ".join(f"{name}={BRIEF.repr(size)}" for name, size in sizes.items())


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
