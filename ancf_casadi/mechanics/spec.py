"""The beam as data: the table ``[beam]`` of a TOML file, and the object ``beam`` of a JSON document.

A document holds one value per element and every key; a TOML file may give one number for all elements, and leave out
the keys that have a default.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, ClassVar

from msgspec import UNSET, Meta, UnsetType

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Attachment, Dashpot, PointMass, RotationalSpring, Spring
from ancf_casadi.mechanics.beam import MAXIMUM_ELEMENTS, MINIMUM_ELEMENTS, Beam
from ancf_casadi.mechanics.lumped import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.section import Section, Shape
from ancf_casadi.mechanics.strain import AxialStrain, Curvature, StrainMeasures
from ancf_casadi.mechanics.supports import Clamp, Guide, Pin, Roller, Support
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import (
    UNLISTED,
    NotNegative,
    Pair,
    Positive,
    PositiveOrInfinite,
    Spec,
    convert,
    value_place,
)

Point = Annotated[float, Meta(ge=0.0, description="m")]
Displacement = Annotated[Pair, Meta(description="m")]
Rotation = Annotated[float, Meta(description="rad")]
Direction = Annotated[Pair, Meta(description="of sliding")]
TorsionalStiffness = Annotated[PositiveOrInfinite | None, Meta(description="N m/rad; inf or null if rigid")]
AmountPair = tuple[NotNegative, NotNegative]
PerElement = Positive | Annotated[tuple[Positive, ...], Meta(min_length=2)]
Elements = Annotated[int, Meta(ge=MINIMUM_ELEMENTS, le=MAXIMUM_ELEMENTS, description="not needed beside a list")]
Points = Annotated[int, Meta(ge=1, le=9, description="Gauss points")]


class LumpedSpec(Spec, frozen=True, tag_field="kind"):
    """A support, attachment or section of the named kind; its other keys are the arguments of ``described``."""

    described: ClassVar[Any]

    def object(self) -> Any:
        """Return the support, attachment or section."""
        values = {name: math.inf if value is None else value for name, value in self.set_fields().items()}
        return self.described(**values)


class ClampSpec(LumpedSpec, frozen=True, tag="clamp"):
    """A clamp, which holds position and direction."""

    described = Clamp

    point: Point = 0.0
    stiffness: TorsionalStiffness = None
    displacement: Displacement = (0.0, 0.0)
    rotation: Rotation = 0.0


class PinSpec(LumpedSpec, frozen=True, tag="pin"):
    """A hinge, which holds the position."""

    described = Pin

    point: Point
    displacement: Displacement = (0.0, 0.0)


class RollerSpec(LumpedSpec, frozen=True, tag="roller"):
    """A roller: the point may slide, and the beam turn."""

    described = Roller

    point: Point
    direction: Direction = (1.0, 0.0)
    displacement: Displacement = (0.0, 0.0)


class GuideSpec(LumpedSpec, frozen=True, tag="guide"):
    """A guide: the point may slide, and the beam does not turn."""

    described = Guide

    point: Point
    direction: Direction = (1.0, 0.0)
    displacement: Displacement = (0.0, 0.0)
    rotation: Rotation = 0.0


class PointMassSpec(LumpedSpec, frozen=True, tag="mass"):
    """A mass at a point."""

    described = PointMass

    point: Point
    mass: Annotated[float, Meta(ge=0.0, description="kg")]
    rotary_inertia: Annotated[float, Meta(ge=0.0, description="kg m^2")] = 0.0


class SpringSpec(LumpedSpec, frozen=True, tag="spring"):
    """A spring between a point and the base."""

    described = Spring

    point: Point
    stiffness: Annotated[AmountPair, Meta(description="along x and y, N/m")]


class RotationalSpringSpec(LumpedSpec, frozen=True, tag="rotational_spring"):
    """A torsional spring at a point."""

    described = RotationalSpring

    point: Point
    stiffness: Annotated[float, Meta(ge=0.0, description="N m/rad")]


class DashpotSpec(LumpedSpec, frozen=True, tag="dashpot"):
    """A viscous damper between a point and the base."""

    described = Dashpot

    point: Point
    coefficient: Annotated[AmountPair, Meta(description="along x and y, N s/m")]


class RectangleSpec(LumpedSpec, frozen=True, tag="rectangle"):
    """A rectangle."""

    described = Section.rectangle

    width: Annotated[Positive, Meta(description="out of the plane of motion, m")]
    thickness: Annotated[Positive, Meta(description="in the plane of motion, m")]


class CircleSpec(LumpedSpec, frozen=True, tag="circle"):
    """A circle."""

    described = Section.circle

    diameter: Annotated[Positive, Meta(description="m")]


class TubeSpec(LumpedSpec, frozen=True, tag="tube"):
    """A tube."""

    described = Section.tube

    outer: Annotated[Positive, Meta(description="diameter, m")]
    inner: Annotated[NotNegative, Meta(description="diameter, m")]


class StiffnessSpec(LumpedSpec, frozen=True, tag="stiffness"):
    """A section of given stiffness and mass."""

    described = Section.stiffness

    bending: Annotated[Positive, Meta(description="E I, N m^2")]
    axial: Annotated[Positive, Meta(description="E A, N")]
    mass_per_length: Annotated[Positive, Meta(description="kg/m")]
    depth: Annotated[Positive | UnsetType, Meta(description="in the plane of motion, m")] = UNSET
    breadth: Annotated[Positive | UnsetType, Meta(description="out of the plane of motion, m; else the depth")] = UNSET


SectionSpec = RectangleSpec | CircleSpec | TubeSpec | StiffnessSpec
SupportSpec = ClampSpec | PinSpec | RollerSpec | GuideSpec
AttachmentSpec = PointMassSpec | SpringSpec | RotationalSpringSpec | DashpotSpec


class ConfigurationSpec(Spec, frozen=True):
    """The configuration of a beam in one measurement, as far as it differs from that of the file."""

    length: Annotated[Positive | UnsetType, Meta(description="m")] = UNSET
    axis: Pair | UnsetType = UNSET
    tip_mass: Annotated[NotNegative | UnsetType, Meta(description="kg")] = UNSET
    clamp_stiffness: Annotated[PositiveOrInfinite | UnsetType, Meta(description="N m/rad")] = UNSET
    supports: tuple[SupportSpec, ...] | UnsetType = UNSET
    attachments: tuple[AttachmentSpec, ...] | UnsetType = UNSET

    def other_model(self, model: Model, where: str) -> Model | None:
        """Return a model in this configuration; None if it is the same."""
        with error_prefix(where):
            changes = _with_objects(self.set_fields())
            return Model(model.beam.with_(**changes), model.measures) if changes else None


class BeamSpec(Spec, frozen=True):
    """A beam (m, kg/m^3, Pa, m/s^2, 1/m); a property is one number, or a list with one value per element."""

    length: Annotated[Positive, Meta(description="m")]
    width: Annotated[PerElement | UnsetType, Meta(description="m")] = UNSET
    thickness: Annotated[PerElement | UnsetType, Meta(description="m")] = UNSET
    density: Annotated[PerElement | UnsetType, Meta(description="kg/m^3")] = UNSET
    elastic_modulus: Annotated[PerElement | UnsetType, Meta(description="Pa")] = UNSET
    section: Annotated[
        SectionSpec | Annotated[tuple[SectionSpec, ...], Meta(min_length=2)] | UnsetType,
        Meta(description="in place of width and thickness; one of given stiffness states density and modulus too"),
    ] = UNSET
    section_shape: Annotated[tuple[Shape, ...] | UnsetType, UNLISTED] = UNSET  # of a document
    elements: Elements | UnsetType = UNSET
    axis: Pair = (0.0, -1.0)
    gravity: Annotated[Pair, Meta(description="m/s^2")] = (0.0, -9.81)
    natural_curvature: Annotated[float | tuple[float, ...], Meta(description="1/m")] = ()
    prestress: Annotated[float | tuple[float, ...] | UnsetType, Meta(description="Pa")] = UNSET
    rotary_sections: Annotated[bool | UnsetType, Meta(description="whether the sections have rotary inertia")] = UNSET
    supports: tuple[SupportSpec, ...] = (ClampSpec(),)
    attachments: tuple[AttachmentSpec, ...] = ()
    tip_mass: Annotated[NotNegative | UnsetType, Meta(description="kg")] = UNSET
    clamp_stiffness: Annotated[PositiveOrInfinite | UnsetType, Meta(description="N m/rad")] = UNSET

    @classmethod
    def of(cls, beam: Beam) -> BeamSpec:
        """Return the specification of a beam, with one value per element."""
        fields = {field.name: getattr(beam, field.name) for field in dataclasses.fields(beam)}
        for name in ("prestress", "section_shape", "rotary_sections"):
            if not fields[name]:
                del fields[name]  # so that documents stay as they were
        for name in ("supports", "attachments"):
            fields[name] = tuple(map(lumped_spec, fields[name]))
        return convert(fields, cls)

    def beam(self) -> Beam:
        """Return the beam; refuse values that make none."""
        arguments = _with_objects(self.set_fields())
        if missing := [name for name in PROPERTIES if not {name, "section"} & arguments.keys()]:
            raise InputError(f"the key '{missing[0]}' is missing")
        if {"section", "section_shape"} <= arguments.keys():
            raise InputError("follows from the section; give one or the other", "section_shape")
        shapes = arguments.pop("section_shape", ())
        lists = [arguments[name] for name in (*PROPERTIES, "section") if isinstance(arguments.get(name), tuple)]
        if "elements" not in arguments and not lists:
            raise InputError("the key 'elements' is missing")
        arguments.setdefault("elements", len(lists[0]) if lists else 0)
        if arguments["natural_curvature"] == ():
            arguments["natural_curvature"] = 0.0
        return Beam.uniform(**arguments).with_(**({"section_shape": shapes} if shapes else {}))


class StrainMeasuresSpec(Spec, frozen=True):
    """Strain measures."""

    axial: AxialStrain
    curvature: Curvature
    axial_points: Points
    bending_points: Points


def lumped_spec(component: Support | Attachment) -> LumpedSpec:
    """Return the specification of a support or attachment; the stiffness of a rigid clamp is None."""
    kinds = (ClampSpec, PinSpec, RollerSpec, GuideSpec, PointMassSpec, SpringSpec, RotationalSpringSpec, DashpotSpec)
    (kind,) = (kind for kind in kinds if kind.described is type(component))
    values = {field.name: getattr(component, field.name) for field in dataclasses.fields(component)}
    return convert({name: None if value == math.inf else value for name, value in values.items()}, kind)


def model_from(beam: BeamSpec, measures: StrainMeasuresSpec, where: str) -> Model:
    """Return the model of a document's beam and strain measures at a place; refuse values that make no beam."""
    with error_prefix(value_place(where, ["beam"])):
        beam_object = beam.beam()
    with error_prefix(value_place(where, ["strain_measures"])):
        return Model(beam_object, StrainMeasures(**measures.set_fields()))


def _with_objects(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return arguments with supports, attachments and sections in place of their specifications."""
    for name in ("supports", "attachments", "section"):
        specs = arguments.get(name)
        if isinstance(specs, LumpedSpec):
            arguments[name] = _object(specs, name)
        elif specs is not None:
            arguments[name] = tuple(_object(spec, f"{name}: {k}") for k, spec in enumerate(specs, start=1))
    return arguments


def _object(spec: LumpedSpec, where: str) -> Any:
    """Return the object of a specification."""
    with error_prefix(where):
        return spec.object()
