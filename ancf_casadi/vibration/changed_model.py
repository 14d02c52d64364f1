"""A model with other values of its properties, as fits and matches find them.

A name stands for one lumped property, as in ``Beam.lumped``, and ``spring_stiffness`` for all springs together.
Supports hold the beam where they are, whatever its natural curvature becomes.  A beam of other curvature is elsewhere
without load, which is what supports refer to, so their displacements and rotations change.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import PointMass
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.supports import Clamp, Guide, Support
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import number


def lumped_places(beam: Beam, name: str) -> list[int]:
    """Return the places in ``Beam.lumped`` of what a name stands for; none if the beam does not have it."""
    together = name == "spring_stiffness"
    return [k for k, own in enumerate(beam.lumped) if own == name or (together and own.startswith("spring_"))]


def lumped_value(beam: Beam, name: str) -> float:
    """Return a lumped property, the mean of several; 0 if the beam does not have it."""
    values, places = [*beam.lumped.values()], lumped_places(beam, name)
    return sum(values[k] for k in places) / len(places) if places else 0.0


def changed_model(model: Model, properties: Array) -> Model:
    """Return the model with other properties, in the order of ``structure_properties``."""
    rows: Any = properties[: model.properties.size].reshape(model.properties.shape).tolist()
    given = zip(model.lumped, properties[model.properties.size :].tolist(), strict=True)
    lumped = {name: number(value, name) for name, value in given}
    beam = model.beam.with_(**dict(zip(PROPERTIES, rows, strict=True))).with_lumped(lumped)
    if "natural_curvature" in lumped:
        after = Model(beam)
        beam = beam.with_(supports=[_in_place(one, model, after) for one in beam.supports])
    return Model(beam, model.measures)


def _in_place(support: Support, model: Model, after: Model) -> Support:
    """Return a support of a beam, ``after``, where it holds another one."""
    node = int(np.abs(model.beam.node_points - support.point).argmin())
    (places, slopes), (others, turns) = model.natural_nodes, after.natural_nodes
    place, slope, other, turned = places[node], slopes[node], others[node], turns[node]
    changes: dict[str, Any] = {"displacement": tuple((support.displacement + place - other).tolist())}
    if isinstance(support, Clamp | Guide):
        sine, cosine = turned[0] * slope[1] - turned[1] * slope[0], turned @ slope
        changes["rotation"] = support.rotation + math.atan2(sine, cosine)
    return replace(support, **changes)


def check_curvature(beam: Beam) -> None:
    """Refuse to estimate the natural curvature of a beam with springs or dashpots away from its beginning."""
    for one in beam.attachments:
        if one.point and not isinstance(one, PointMass):
            raise InputError(
                f"cannot be estimated for a beam with a {type(one).__name__} at {one.point:g} m: it is free of force "
                "where the beam is without load, and would move with the curvature",
                "natural_curvature",
            )
