"""Properties of a beam: names and units, the lumped ones, which a beam does not have once per element, and tables.

    tip_mass, mass                     of a ``PointMass`` at the tip, or elsewhere, kg
    rotary_inertia                     of a ``PointMass``, if it is not 0, kg m^2
    rotational_spring                  stiffness of a ``RotationalSpring``, N m/rad
    spring_x, spring_y                 stiffnesses of a ``Spring`` that are not 0, N/m
    dashpot_x, dashpot_y               coefficients of a ``Dashpot`` that are not 0, N s/m
    clamp_stiffness                    torsional stiffness of a ``Clamp``, if it is finite, N m/rad
    natural_curvature, prestress       the largest one of the elements, which keep their ratios, 1/m, Pa

A second one of a name counts on along the beam: mass, mass_2.  ``spring_stiffness`` stands for all springs.

A combined property changes others with it: the diameter of a round section its width and its thickness in proportion,
the bending stiffness E I = E b h^3/12 the elastic modulus, the mass per length rho b h the density.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Attachment, Dashpot, PointMass, RotationalSpring, Spring
from ancf_casadi.mechanics.supports import Clamp, Support

PROPERTIES = ("width", "thickness", "density", "elastic_modulus")
COMBINED: Mapping[str, tuple[str, ...]] = {  # and the properties that change with each
    "diameter": ("width", "thickness"),
    "bending_stiffness": ("elastic_modulus",),
    "mass_per_length": ("density",),
}
PROPERTY_POWERS: Mapping[str, Mapping[str, int]] = {  # in the combined property
    "bending_stiffness": {"elastic_modulus": 1, "width": 1, "thickness": 3},
    "mass_per_length": {"density": 1, "width": 1, "thickness": 1},
}
BEAM_UNITS = {
    "width": "m",
    "thickness": "m",
    "density": "kg/m^3",
    "elastic_modulus": "Pa",
    "diameter": "m",
    "bending_stiffness": "N m^2",
    "mass_per_length": "kg/m",
    "tip_mass": "kg",
    "mass": "kg",
    "rotary_inertia": "kg m^2",
    "clamp_stiffness": "N m/rad",
    "rotational_spring": "N m/rad",
    "spring_x": "N/m",
    "spring_y": "N/m",
    "spring_stiffness": "N/m",
    "dashpot_x": "N s/m",
    "dashpot_y": "N s/m",
    "natural_curvature": "1/m",
    "prestress": "Pa",
}
LUMPED_KINDS = tuple(name for name in BEAM_UNITS if name not in (*PROPERTIES, *COMBINED))


def lumped_kind(name: str) -> str:
    """Return the name of a lumped property without its number; empty if the name is not that of a lumped property."""
    kind = re.sub("_[0-9]+$", "", name)
    return kind if kind in LUMPED_KINDS else ""


def property_unit(name: str) -> str:
    """Return the SI unit of a property; a name may have elements in brackets, or a number."""
    return BEAM_UNITS[lumped_kind(name) or name.partition("[")[0]]


def changed_properties(name: str) -> tuple[str, ...]:
    """Return the properties that an unknown changes, without its elements; lumped ones keep their number."""
    kind = name.partition("[")[0]
    return COMBINED.get(kind, (kind,))


def check_combinations(names: Sequence[str]) -> None:
    """Refuse a combined property beside another unknown that changes one of its factors."""
    for name in sorted(set(names) & set(PROPERTY_POWERS)):
        factors = set(PROPERTY_POWERS[name]) - set(COMBINED[name])
        rivals = sorted({rival.partition("[")[0] for rival in names if factors & set(changed_properties(rival))})
        if rivals:
            raise InputError(f"{name} contains {', '.join(rivals)}; estimate one or the other", "unknowns")


@dataclass(frozen=True)
class Place:
    """The place of a lumped property among the supports and attachments of a beam."""

    kind: str  # the name without its number
    owner: Literal["supports", "attachments"]
    number: int  # of the support or attachment, from 0
    attribute: str
    component: int | None = None  # 0 for x, 1 for y, None for a single number

    def value(self, supports: Sequence[Support], attachments: Sequence[Attachment]) -> float:
        """Return the value of the property."""
        value = getattr((supports if self.owner == "supports" else attachments)[self.number], self.attribute)
        return float(value if self.component is None else value[self.component])


def lumped_places(length: float, supports: Sequence[Support], attachments: Sequence[Attachment]) -> dict[str, Place]:
    """Return the place of each lumped property of a beam: those of attachments, then those of supports."""
    places = []
    for k, attachment in enumerate(attachments):
        if isinstance(attachment, PointMass):
            places.append(Place("tip_mass" if attachment.point == length else "mass", "attachments", k, "mass"))
            if attachment.rotary_inertia:
                places.append(Place("rotary_inertia", "attachments", k, "rotary_inertia"))
        elif isinstance(attachment, RotationalSpring):
            places.append(Place("rotational_spring", "attachments", k, "stiffness"))
        elif isinstance(attachment, Spring | Dashpot):
            kind, attribute = ("spring", "stiffness") if isinstance(attachment, Spring) else ("dashpot", "coefficient")
            pairs = [(j, axis) for j, axis in enumerate("xy") if getattr(attachment, attribute)[j]]
            places += [Place(f"{kind}_{axis}", "attachments", k, attribute, j) for j, axis in pairs]
    for k, support in enumerate(supports):
        if isinstance(support, Clamp) and math.isfinite(support.stiffness):
            places.append(Place("clamp_stiffness", "supports", k, "stiffness"))
    named_places: dict[str, Place] = {}
    for place in places:
        count = sum(named.kind == place.kind for named in named_places.values())
        named_places[f"{place.kind}_{count + 1}" if count else place.kind] = place
    return named_places


def replace_lumped(
    length: float, supports: tuple[Support, ...], attachments: tuple[Attachment, ...], name: str, value: Any
) -> tuple[tuple[Support, ...], tuple[Attachment, ...]]:
    """Return supports and attachments with another value of a lumped property, or with a tip mass or clamp stiffness.

    A value that is unusable, or a clamp stiffness without a clamp, raises an ``InputError`` with the name.
    """
    place = lumped_places(length, supports, attachments).get(name)
    if place is None and name == "tip_mass":
        attachments = (*attachments, PointMass(length, 0.0))
        place = Place("tip_mass", "attachments", len(attachments) - 1, "mass")
    elif place is None:
        clamps = [k for k, support in enumerate(supports) if isinstance(support, Clamp)]
        if not clamps:
            raise InputError("the beam has no clamp", name)
        place = Place("clamp_stiffness", "supports", clamps[0], "stiffness")
    components: list[Any] = list(supports if place.owner == "supports" else attachments)
    if place.component is not None:
        pair = list(getattr(components[place.number], place.attribute))
        pair[place.component] = value
        value = tuple(pair)
    try:
        components[place.number] = replace(components[place.number], **{place.attribute: value})
    except InputError as error:
        raise InputError(str(error).removeprefix(f"{place.attribute}: "), name) from None
    return (tuple(components), attachments) if place.owner == "supports" else (supports, tuple(components))
