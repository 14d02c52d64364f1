"""The beam: geometry, material, orientation and gravity, in SI units.

A beam of length L is divided into n elements of equal length l = L/n.  Each element has a rectangular section of
width b (out of the plane) and thickness h (in the plane of motion), a density rho and an elastic modulus E, so that

    area A = b h,    second moment I = b h^3 / 12,    mass per length mu = rho A.

The width and the thickness of another section are those of the rectangle with the same A and I (``section``).

The unloaded beam begins at the origin along ``axis`` and is straight, or bent to its natural curvature.  It is clamped
at its beginning, or held by other supports, and carries masses, springs and dashpots (``supports``, ``attachments``).
Where one of these is not at the end of an element, the nearest node moves there, and the nodes between spread evenly.
The laboratory frame has x to the right and y up.

Lumped properties (``lumped``) are those that the beam does not have once per element: masses, stiffnesses,
coefficients, and the largest natural curvature and prestress, which stand for all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Attachment
from ancf_casadi.mechanics.lumped import PROPERTIES, Place, lumped_places, replace_lumped
from ancf_casadi.mechanics.section import RECTANGLE, Section, Shape, check_elements
from ancf_casadi.mechanics.supports import Clamp, Support, snap_to_point
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import read_toml
from ancf_casadi.support.inputs import (
    check_fields,
    check_size,
    error_prefix,
    flag,
    instances,
    is_sequence,
    numbers,
    positive,
    shown,
    unit_vector,
    vector,
    whole,
)
from ancf_casadi.support.specs import convert
from ancf_casadi.support.tables import Displayed, plural

INITIAL = ("natural_curvature", "prestress")  # one value per element, or none; the largest is a lumped property
MINIMUM_ELEMENTS = 2
MAXIMUM_ELEMENTS = 10_000  # a larger number is taken for a typing error
SAME_POINT, SHORTEST_ELEMENT = 1e-9, 1e-5  # distances relative to the length; shorter elements drown in rounding


@dataclass(frozen=True)
class Beam(Displayed):
    """A clamped beam with one value of each property per element.

    ``Beam.uniform`` and ``Beam.from_toml`` are the usual ways to make one.

    Parameters
    ----------
    length : float
        Length L, m.
    width, thickness : tuple of float
        Section of each element, m; if it is not a rectangle, those of the rectangle with the same area and second
        moment of area.
    density : tuple of float
        Density of each element, kg/m^3.
    elastic_modulus : tuple of float
        Elastic modulus of each element, Pa.
    axis : (float, float)
        Direction of the unloaded beam at its beginning, of any length above 0; stored as a unit vector.
    gravity : (float, float)
        Acceleration of gravity, m/s^2.
    natural_curvature : tuple of float
        Curvature of each element without stress, 1/m, positive counterclockwise; empty for a straight beam.
    prestress : tuple of float
        Axial stress of each element while the beam has its length, Pa, tension positive; empty if there is none.  It
        acts where supports keep the ends apart; a beam with a free end becomes shorter until it is without stress.
    supports : tuple of Support
        The supports, none for a free beam; by default a rigid clamp at the beginning.
    attachments : tuple of Attachment
        Masses, springs and dashpots.
    section_shape : tuple of Shape
        Kind and proportions of the section of each element, as ``uniform`` and ``with_`` set them; empty for
        rectangles.
    rotary_sections : bool
        Whether the sections have rotary inertia, as in Rayleigh's beam, which lowers the frequencies of a beam that is
        not slender.

    Raises
    ------
    InputError
        If a value is not finite and positive (gravity, curvature, prestress: not finite), the axis is zero, the tuples
        differ in length, width and thickness do not fit a round section, there are fewer than 2 or more than 10000
        elements, the mass or a stiffness of an element is beyond the range of numbers, a support or attachment is not
        on the beam, two supports hold the same point, or the supports and attachments are at more points than the beam
        has nodes.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=20)
    >>> print(f"{1e3 * beam.mass:.1f} g, elements of {1e3 * beam.element_lengths[0]:.0f} mm")
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
    natural_curvature: tuple[float, ...] = ()
    prestress: tuple[float, ...] = ()
    supports: tuple[Support, ...] = (Clamp(),)
    attachments: tuple[Attachment, ...] = ()
    section_shape: tuple[Shape, ...] = ()
    rotary_sections: bool = False

    def __post_init__(self) -> None:
        """Validate, and normalise the axis."""
        check_fields(self, length=positive)
        for name in PROPERTIES:
            if not is_sequence(getattr(self, name)):
                raise InputError("must have one value per element; Beam.uniform also takes one number", name)
            object.__setattr__(self, name, tuple(positive(value, name) for value in getattr(self, name)))
            if len(getattr(self, name)) != len(self.width):
                raise InputError(f"has {len(getattr(self, name))} values for {len(self.width)} elements", name)
        whole(self.elements, "elements", MINIMUM_ELEMENTS, MAXIMUM_ELEMENTS)
        check_fields(self, axis=unit_vector, gravity=vector, rotary_sections=flag)
        for name in INITIAL:
            initial_values = numbers(getattr(self, name), name)
            if len(initial_values) not in (0, self.elements):
                raise InputError(f"has {len(initial_values)} values for {self.elements} elements", name)
            check_size(initial_values or 0.0, name)
            object.__setattr__(self, name, initial_values if any(initial_values) else ())
        self._check_shapes()
        kinds = {"supports": Support, "attachments": Attachment}
        items = {name: instances(getattr(self, name), name, kind, minimum=0) for name, kind in kinds.items()}
        points = np.array([0.0, self.length, *sorted(item.point for item in itertools.chain(*items.values()))])
        for name in items:
            snapped = (snap_to_point(item, points, SAME_POINT * self.length) for item in items[name])
            object.__setattr__(self, name, tuple(sorted(snapped, key=lambda item: item.point)))
        self._check_points()
        check_elements(self.element_lengths, zip(*(getattr(self, name) for name in PROPERTIES), strict=True))

    @classmethod
    def uniform(
        cls,
        *,
        length: float,
        width: float | Sequence[float] | None = None,
        thickness: float | Sequence[float] | None = None,
        density: float | Sequence[float] | None = None,
        elastic_modulus: float | Sequence[float] | None = None,
        section: Section | Sequence[Section] | None = None,
        elements: int,
        axis: tuple[float, float] = (0.0, -1.0),
        gravity: tuple[float, float] = (0.0, -9.81),
        natural_curvature: float | Sequence[float] = 0.0,
        prestress: float | Sequence[float] = 0.0,
        supports: Sequence[Support] = (Clamp(),),
        attachments: Sequence[Attachment] = (),
        tip_mass: float = 0.0,
        clamp_stiffness: float = math.inf,
        rotary_sections: bool = False,
    ) -> Beam:
        """Make a beam with properties that are the same in all elements, or given element by element.

        Parameters
        ----------
        width, thickness, density, elastic_modulus, natural_curvature, prestress : float or sequence of float
            As in ``Beam``, or one number for all elements.
        section : Section or sequence of Section
            In place of width and thickness, the section of each element, or of all; one of given stiffness also states
            density and elastic modulus.
        elements : int
            Number of elements, at least 2.
        length, axis, gravity, supports, attachments, rotary_sections
            See ``Beam``.
        tip_mass : float
            Mass of the ``PointMass`` at the tip, kg; it takes the place of the mass of the first in ``attachments``.
        clamp_stiffness : float
            Torsional stiffness of the first clamp, N m/rad.

        Raises
        ------
        InputError
            As in ``Beam``; or if a sequence does not have ``elements`` values, a property is missing or is given twice,
            or only some of the sections are of given stiffness.

        Examples
        --------
        >>> from ancf_casadi import Beam, Section
        >>> taper = Beam.uniform(length=0.3, width=0.02, thickness=(2e-3, 1.5e-3, 1e-3),
        ...                      density=1200.0, elastic_modulus=2e9, elements=3)
        >>> taper.thickness
        (0.002, 0.0015, 0.001)
        >>> taper.density
        (1200.0, 1200.0, 1200.0)
        >>> Beam.uniform(length=0.3, section=Section.circle(2e-3), density=1200.0, elastic_modulus=2e9, elements=3)
        Beam(0.3 m, 3 elements, Section(diameter=0.002))
        """
        elements = whole(elements, "elements", MINIMUM_ELEMENTS, MAXIMUM_ELEMENTS)
        values = (width, thickness, density, elastic_modulus)
        per_element: dict[str, Any] = dict(zip(PROPERTIES, values, strict=True))
        of_sections = {} if section is None else _section_values(section, elements)
        for name, value in per_element.items():
            if value is not None and name in of_sections:
                raise InputError("follows from the section; give one or the other", name)
            if value is None and name not in of_sections:
                raise InputError("must be a finite number, got None; state it, or a section that does", name)
        per_element |= {"natural_curvature": natural_curvature, "prestress": prestress, **of_sections}
        element_values: dict[str, Any] = {
            name: _per_element(value, elements, name) for name, value in per_element.items()
        }
        for_all: dict[str, Any] = {"supports": supports, "attachments": attachments, "rotary_sections": rotary_sections}
        beam = cls(length=length, axis=axis, gravity=gravity, **for_all, **element_values)
        lumped = {"tip_mass": tip_mass} if tip_mass != 0.0 else {}
        if clamp_stiffness != math.inf:
            lumped["clamp_stiffness"] = clamp_stiffness
        return beam.with_(**lumped) if lumped else beam

    @classmethod
    def from_toml(cls, path: str | Path) -> Beam:
        """Read a beam from the table ``[beam]`` of a TOML file, with the keys of ``Beam.uniform``.

        Each support is a table ``[[beam.supports]]``, and each attachment a table ``[[beam.attachments]]``, whose key
        ``kind`` is clamp, pin, roller or guide, or mass, spring, rotational_spring or dashpot, and whose other keys are
        the fields of its class.  A beam with ``supports = []`` is free.  A ``section`` is a table, or a list of them,
        whose ``kind`` is rectangle, circle, tube or stiffness, and whose other keys are the arguments of ``Section``'s
        method of this name.

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
        from ancf_casadi.mechanics.spec import BeamSpec  # which imports this module

        where = f"{path}: [beam]"
        if "beam" not in (tables := read_toml(path)):
            raise InputError("the table is missing", where)
        spec = convert(tables["beam"], BeamSpec, where)
        with error_prefix(where):
            return spec.beam()

    @property
    def elements(self) -> int:
        """Number of elements n."""
        return len(self.width)

    @cached_property
    def node_points(self) -> Array:
        """Arc length of each node, (n + 1,), m."""
        return self._points_of_nodes(self.elements)

    def _points_of_nodes(self, n: int) -> Array:
        """Return the arc lengths of the nodes of n elements, (n + 1,), m."""
        inner = self._inner_points
        places = [0, *_distinct_nodes([point / self.length * n for point in inner], n), n]
        return np.interp(np.arange(n + 1), places, [0.0, *inner, self.length])

    @property
    def _inner_points(self) -> list[float]:
        """The points of supports and attachments between the ends, m, ascending."""
        points = {component.point for component in self.supports} | {component.point for component in self.attachments}
        return sorted(points - {0.0, self.length})

    @cached_property
    def element_lengths(self) -> Array:
        """Length l of each element, (n,), m."""
        if self._inner_points:
            return np.diff(self.node_points)
        return np.full(self.elements, self.length / self.elements)

    @property
    def sections(self) -> tuple[Section, ...]:
        """The section of each element."""
        rows = zip(self.width, self.thickness, self.shapes, self.elastic_modulus, self.density, strict=True)
        return tuple(
            Section(b, h, shape, modulus, rho) if shape.kind == "stiffness" else Section(b, h, shape)
            for b, h, shape, modulus, rho in rows
        )

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Kind and proportions of the section of each element."""
        return self.section_shape or (RECTANGLE,) * self.elements

    @property
    def diameter(self) -> tuple[float, ...]:
        """Outer diameter of each element, m; an ``InputError`` if a section is not round."""
        return tuple(section.diameter for section in self.sections)

    @property
    def bending_stiffness(self) -> Array:
        """Bending stiffness E I of each element, (n,), N m^2."""
        return np.array(self.elastic_modulus) * [section.second_moment for section in self.sections]

    @property
    def axial_stiffness(self) -> Array:
        """Axial stiffness E A of each element, (n,), N."""
        return np.array(self.elastic_modulus) * [section.area for section in self.sections]

    @property
    def mass_per_length(self) -> Array:
        """Mass per length rho A of each element, (n,), kg/m."""
        return np.array(self.density) * [section.area for section in self.sections]

    @property
    def mass(self) -> float:
        """Mass of the beam without its attachments, kg."""
        return float(np.array(self.density) @ ([s.area for s in self.sections] * self.element_lengths))

    @cached_property
    def lumped(self) -> dict[str, float]:
        """The lumped properties by name: those of attachments and supports along the beam, curvature, prestress."""
        properties = {name: place.value(self.supports, self.attachments) for name, place in self.lumped_places.items()}
        return properties | {name: max(getattr(self, name), key=abs) for name in INITIAL if getattr(self, name)}

    @property
    def begin_angle(self) -> float:
        """Angle by which a support turns the beam at its beginning, rad."""
        return sum(support.angle for support in self.supports if not support.point)

    @property
    def across(self) -> tuple[float, float]:
        """Unit vector across the beam at its beginning, to the left of its axis as a support there turns it."""
        (ax, ay), cosine, sine = self.axis, math.cos(self.begin_angle), math.sin(self.begin_angle)
        return -(sine * ax + cosine * ay), cosine * ax - sine * ay

    @property
    def tip_is_held(self) -> bool:
        """True if a support is at the tip."""
        return any(support.point == self.length for support in self.supports)

    @property
    def tip_mass(self) -> float:
        """Mass of the first ``PointMass`` at the tip, kg, 0 if there is none; further ones are tip_mass_2, ..."""
        return self.lumped.get("tip_mass", 0.0)

    @property
    def clamp_stiffness(self) -> float:
        """Torsional stiffness of the first clamp that is not rigid, N m/rad; infinite if there is none."""
        return self.lumped.get("clamp_stiffness", math.inf)

    def with_(self, **changes: Any) -> Beam:
        """Return a copy with some fields or lumped properties changed; a number applies to all elements.

        ``section`` changes the sections, and ``diameter`` the sizes of round ones, which keep their proportions.  A
        mass at the tip and the stiffness of a clamp may also be added; of several, tip_mass changes the first.  What is
        at the tip stays there if the length changes.

        Raises
        ------
        InputError
            If a name is neither a field nor a lumped property of the beam, or a value is unusable.

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
        if "section" in changes or "diameter" in changes:
            changes = self._with_sections(changes)
        lumped = {name: changes.pop(name) for name in list(changes) if name not in names}
        for name in changes.keys() & {*PROPERTIES, *INITIAL}:
            if not (name in INITIAL and is_sequence(changes[name]) and not len(changes[name])):
                changes[name] = _per_element(changes[name], self.elements, name)
        if "length" in changes:  # what is at the tip stays there
            length = positive(changes["length"], "length")
            for name in ("supports", "attachments"):
                items = getattr(self, name)
                at_tip = {item: replace(item, point=length) for item in items if item.point == self.length}
                changes.setdefault(name, tuple(at_tip.get(item, item) for item in items))
        beam = replace(self, **changes)
        for name, value in lumped.items():
            if name not in {*beam.lumped_places, "tip_mass", "clamp_stiffness"}:
                known_names = sorted(names | {*beam.lumped_places, "tip_mass", "clamp_stiffness"})
                raise InputError(f"is not a property of the beam; known are {', '.join(known_names)}", name)
            supports, attachments = replace_lumped(beam.length, beam.supports, beam.attachments, name, value)
            beam = replace(beam, supports=supports, attachments=attachments)
        return beam

    def _with_sections(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Return changes with the properties of elements in place of sections or diameters."""
        if "section" in changes:
            values = _section_values(changes.pop("section"), self.elements)
            for name in ("density", "elastic_modulus"):
                if name not in {*values, *changes} and any(shape.kind == "stiffness" for shape in self.shapes):
                    raise InputError("is that of a section of given stiffness; give that of the new section", name)
        else:
            _ = self.diameter  # check that the sections are round
            diameters = _per_element(changes.pop("diameter"), self.elements, "diameter")
            pairs = zip(diameters, self.section_shape, strict=True)
            sections = [Section.of_diameter(positive(diameter, "diameter"), shape) for diameter, shape in pairs]
            values = _section_values(sections, self.elements)
        if twice := sorted(values.keys() & changes.keys()):
            raise InputError("follows from the section; give one or the other", twice[0])
        return changes | values

    def with_lumped(self, values: Mapping[str, float]) -> Beam:
        """Return a copy with other lumped properties; the ratios of curvatures and of prestresses stay the same."""
        changes: dict[str, Any] = dict(values)
        for name in changes.keys() & {*INITIAL}:
            ratio = changes[name] / self.lumped[name]
            changes[name] = [ratio * value for value in getattr(self, name)]
        return self.with_(**changes)

    @cached_property
    def lumped_places(self) -> dict[str, Place]:
        """The place of each lumped property of a support or attachment (``mechanics.lumped``)."""
        return lumped_places(self.length, self.supports, self.attachments)

    def _check_points(self) -> None:
        """Refuse supports and attachments that are off the beam, at the same point, or more than the nodes."""
        for name in ("supports", "attachments"):
            for component in getattr(self, name):
                if component.point > self.length:
                    place, length = shown(component.point), f"{self.length:g} m"
                    raise InputError(f"the point {place} m is not on the beam, which is {length} long", name)
        points = [support.point for support in self.supports]
        if twice := [point for point in points if points.count(point) > 1]:
            raise InputError(f"two supports hold the point at {twice[0]:g} m; give one that holds both", "supports")
        for point, next_point in itertools.pairwise([0.0, *self._inner_points, self.length]):
            if next_point - point < SHORTEST_ELEMENT * self.length:
                ends = f"{shown(point)} and {shown(next_point)} m"
                raise InputError(f"{ends} are too close for an element; give both one point", "supports, attachments")
        inner = len(self._inner_points)
        if inner > self.elements - 1:
            raise InputError(
                f"supports and attachments are at {inner} points between the ends, but the beam has "
                f"{self.elements - 1} nodes there; use more elements",
                "elements",
            )

    def _check_shapes(self) -> None:
        """Check the shapes of the sections; drop those of rectangles alone."""
        shapes = instances(self.section_shape, "section_shape", Shape, minimum=0)
        if len(shapes) not in (0, self.elements):
            raise InputError(f"has {len(shapes)} values for {self.elements} elements", "section_shape")
        object.__setattr__(self, "section_shape", shapes if {*shapes} - {RECTANGLE} else ())
        for k, section in enumerate(self.sections if self.section_shape else (), start=1):
            if section.shape.kind == "round" and not math.isclose(section.breadth, section.depth, rel_tol=SAME_POINT):
                raise InputError(
                    f"the section of element {k} is round, so width and thickness change together; change its diameter",
                    "width, thickness",
                )

    def _summary(self) -> str:
        wide, thick = (f"{1e3 * min(sizes):.4g}" for sizes in (self.width, self.thickness))
        varies = "" if len({*self.sections}) == 1 else " or more"
        size = repr(self.sections[0]) if self.section_shape else f"{wide} x {thick} mm"
        return f"{self.length:.4g} m, {plural(self.elements, 'element')}, {size}{varies}"


@dataclass(frozen=True, repr=False)
class SplitBeam(Beam):
    """A beam on a finer mesh, with ``parts`` equal elements in place of each element."""

    parts: ClassVar[int] = 2

    @classmethod
    def of(cls, beam: Beam) -> SplitBeam:
        """Return a beam on the finer mesh."""
        values = {field.name: getattr(beam, field.name) for field in fields(beam)}
        names = (*PROPERTIES, *INITIAL, "section_shape")
        repeated = {name: tuple(np.repeat(values[name], cls.parts).tolist()) for name in names}
        return cls(**(values | repeated))

    @cached_property
    def node_points(self) -> Array:
        """Arc length of each node, (n + 1,), m."""
        places = np.arange(self.elements + 1) / self.parts
        coarse = self.elements // self.parts
        return np.interp(places, np.arange(coarse + 1), self._points_of_nodes(coarse))


def _per_element(value: Any, elements: int, name: str) -> tuple[float, ...]:
    if is_sequence(value):
        if len(value) != elements:
            raise InputError(f"has {len(value)} values for {elements} elements", name)
        return tuple(value)
    return (value,) * elements


def _distinct_nodes(places: Sequence[float], n: int) -> list[int]:
    """Return distinct nodes between 0 and n, one near each of the ascending places."""
    nodes: list[int] = []
    for k, place in enumerate(places):
        nodes.append(min(max(round(place), nodes[-1] + 1 if nodes else 1), n - len(places) + k))
    return nodes


def _section_values(section: Any, elements: int) -> dict[str, Any]:
    """Return the properties of elements that their sections state."""
    sections = instances(_per_element(section, elements, "section"), "section", Section)
    names = {"width": "width", "thickness": "thickness", "shape": "section_shape"}
    stated = [section.elastic_modulus is not None for section in sections]
    if any(stated):
        if not all(stated):
            raise InputError("some are of given stiffness and some are not; state the stiffnesses of all", "section")
        names |= {name: name for name in ("density", "elastic_modulus")}
    return {key: tuple(getattr(section, name) for section in sections) for name, key in names.items()}
