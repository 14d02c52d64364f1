"""Properties of a beam as unknowns: single properties, groups of elements, and combinations.

    diameter             of circles and tubes, which keep their proportions: width and thickness of each element
    thickness            of all elements, by a common factor; the value is the mean over the elements
    thickness[3:5]       of the elements 3, 4 and 5, counted from 1; ``thickness[3]`` of one element
    bending_stiffness    E I = E b h^3/12, by the elastic modulus
    mass_per_length      rho b h, by the density
    tip_mass, mass_2, spring_y, ...    lumped properties, named as in ``Beam.lumped``
    spring_stiffness     of all springs, by a common factor; the value is their mean

A change of E I by the modulus, or of rho b h by the density, is the only one for a beam that hardly stretches.

Small deflections are linear in 1/(E I), and nearly so in 1/(k + 3 E I/L) of a clamp; so are the squares of the periods
of vibration.  Stiffnesses of the beam and of its clamps enter a fit by these.  Those of springs enter as they are,
because a spring beside others adds to their stiffness.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam, SplitBeam
from ancf_casadi.mechanics.lumped import (
    BEAM_UNITS,
    PROPERTIES,
    lumped_kind,
    property_unit,
)
from ancf_casadi.mechanics.model import (
    Model,
    lumped_value,
    model_with_properties,
    owners_of_rows,
)
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.assembly import structure_properties

CLAMP_STIFFNESS = "clamp_stiffness"
CURVATURE = "natural_curvature"
SIGNED = (CURVATURE, "prestress")  # of either sign
# parts with strain energy of their own
ELASTIC = (CLAMP_STIFFNESS, "rotational_spring", "spring_x", "spring_y", "spring_stiffness")
STIFFNESSES = (CLAMP_STIFFNESS, "elastic_modulus", "bending_stiffness")
GROUP = re.compile(rf"({'|'.join((*PROPERTIES, 'diameter'))})\[(\d+)(?::(\d+))?\]")

FIXITY = 3.0  # stiffness of a beam whose far end is hinged against the turn of its near end, in units of E I/L
MOST_FACTOR = 10.0  # factor on a property, either way, without other bounds
MOST_LUMPED = 100.0  # largest factor on a lumped property without other bounds
SAME_PROPERTY = 1e-9  # relative difference of properties that are the same


def is_property(name: str) -> bool:
    """Return whether a name is that of a property, a group of elements, or a combination."""
    return name in BEAM_UNITS or GROUP.fullmatch(name) is not None or bool(lumped_kind(name))


def named_elements(name: str, beam: Beam) -> slice:
    """Return the elements that a name means: all, or those in brackets, whose parts a finer mesh has."""
    match = GROUP.fullmatch(name)
    if not match:
        return slice(0, beam.elements)
    first, parts_per_element = int(match[2]), beam.parts if isinstance(beam, SplitBeam) else 1
    last, elements = int(match[3] or first), beam.elements // parts_per_element
    if not 1 <= first <= last <= elements:
        raise InputError(f"must name elements from 1 to {elements}, the first before the last", name)
    return slice(parts_per_element * (first - 1), parts_per_element * last)


def property_value(beam: Beam, name: str) -> float:
    """Return a property or a combination of a beam, SI units; the mean over its elements, 0 of what it has not."""
    if lumped_kind(name):
        return lumped_value(beam, name)
    kind, elements = name.partition("[")[0], named_elements(name, beam)
    if kind == "diameter":
        return float(np.mean([section.diameter for section in beam.sections[elements]]))
    return float(np.mean(getattr(beam, kind)[elements]))


def property_owners(beam: Beam, names: Sequence[str]) -> Index:
    """Return which of unknown properties or groups of elements each property of a beam changes with."""
    return owners_of_rows(beam, names, [named_elements(name, beam) for name in names])


def scale_properties(properties: Array, owners: Index, factors: Array) -> tuple[Array, Array]:
    """Return properties, possibly followed by others, times the factors (p,), and their Jacobian by the factors."""
    scaled_properties, directions = properties.copy(), np.zeros((len(properties), len(factors)))
    changed = np.flatnonzero(owners >= 0)
    directions[changed, owners[changed]] = properties[changed]
    scaled_properties[changed] *= factors[owners[changed]]
    return scaled_properties, directions


def scaled_model(model: Model, owners: Index, factors: Array) -> Model:
    """Return a model with the factors (p,) on its properties."""
    if (factors == 1.0).all():
        return model
    return model_with_properties(model, scale_properties(structure_properties(model), owners, factors)[0])


def with_clamp(models: Sequence[Model]) -> list[Model]:
    """Return the models with a first stiffness for each clamp that is rigid: that of another one, or 10 E I/L."""
    elastic = [model.beam.clamp_stiffness for model in models if math.isfinite(model.beam.clamp_stiffness)]
    # first clamp stiffness if the clamp is rigid, in units of E I/L
    first = elastic[0] if elastic else 10.0 * _clamp_unit(models)
    return [with_clamp_stiffness(model, first) for model in models]


def with_clamp_stiffness(model: Model, first: float) -> Model:
    """Return a model with a stiffness of its clamp if that is rigid; as it is if it has no clamp."""
    rigid = math.isinf(model.beam.clamp_stiffness) and any(
        isinstance(support, Clamp) for support in model.beam.supports
    )
    return Model(model.beam.with_(clamp_stiffness=first), model.measures) if rigid else model


def first_values(models: Sequence[Model], names: Sequence[str]) -> dict[str, float]:
    """Return the first value of each unknown property, SI units; check that all models are of the same beam."""
    first = {}
    for name in dict.fromkeys((*PROPERTIES, *names)):
        values = [property_value(model.beam, name) for model in models]
        values = [value for value in values if value]
        if not values:
            words = name.replace("_", " ")
            raise InputError(f"no beam has a {words} to estimate; give one of the models a first value", name)
        if max(values) - min(values) > SAME_PROPERTY * max(map(abs, values)):
            raise InputError(
                f"the records must be of the same beam, but their models have a {name} from {min(values):g} to "
                f"{max(values):g} {property_unit(name)}",
                "records",
            )
        first[name] = values[0]
    return {name: first[name] for name in names}


def property_unknown(name: str, first: float, models: Sequence[Model]) -> Unknown:
    """Return a property as an unknown within its usual bounds.

    These are a tenth and ten times the first value; 0 and a hundred times for masses and dashpots; a hundredth and a
    hundred times for springs; 0.01 and 1e5 E I/L of the shortest beam for clamps; ten times the first value to either
    side for a natural curvature or a prestress.
    """
    kind = lumped_kind(name)
    if kind == CLAMP_STIFFNESS:
        # largest and least clamp stiffness without other bounds, in units of E I/L
        lower, upper = (bound * _clamp_unit(models) for bound in (1e-2, 1e5))
    elif kind in SIGNED:
        lower, upper = -MOST_FACTOR * abs(first), MOST_FACTOR * abs(first)
    elif kind:
        lower, upper = first / MOST_LUMPED if kind in ELASTIC else 0.0, first * MOST_LUMPED
    else:
        lower, upper = first / MOST_FACTOR, first * MOST_FACTOR
    stiffness = (kind or name.partition("[")[0]) in STIFFNESSES
    offset = FIXITY * _clamp_unit(models) if kind == CLAMP_STIFFNESS else 0.0
    return Unknown(name, first, abs(first), lower, upper, property_unit(name), offset=offset if stiffness else None)


def _clamp_unit(models: Sequence[Model]) -> float:
    """Return E I/L of the shortest beam, N m/rad."""
    return max(property_value(model.beam, "bending_stiffness") / model.beam.length for model in models)
