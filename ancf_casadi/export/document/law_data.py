"""Damping laws and models as plain data, and back to the last bit.

A law is an object with the key ``law``:

    rayleigh     alpha (1/s), beta (s), stiffness
    quadratic    eta1 (1/s), eta2 (1/m)
    modal        ratios, frequencies (Hz), modes
    sum          laws, which act together

The modes of a generic law are kept as they are, shapes and equilibrium, for to compute them again would change their
last digits.  They say of which beam they are where it is not that of the document.

A number that is infinite where that is the default, such as the stiffness of a rigid clamp, is null.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, fields
from typing import Any, TypeVar, cast

import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.strict_json import list_at, number_at, numbers_at, object_at, place, text_at
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import vector
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes

Made = TypeVar("Made")

SIMPLE: dict[str, type[DampingLaw]] = {"rayleigh": RayleighDamping, "quadratic": QuadraticDamping}
MODEL_KEYS = {"beam", "strain_measures"}
LONGEST_NAME = 40  # of a law that is not known, in a message


def model_data(model: Model) -> dict[str, Any]:
    """Return a model as plain data, of all fields of its beam and of its strain measures."""
    beam = {field.name: _beam_value(getattr(model.beam, field.name)) for field in fields(Beam)}
    measures = {field.name: getattr(model.measures, field.name) for field in fields(StrainMeasures)}
    return {"beam": beam, "strain_measures": measures}


def model_from(data: dict[str, Any], where: str) -> Model:
    """Make a model from the keys ``beam`` and ``strain_measures`` of an object.

    Raises
    ------
    InputError
        If a key or a value is not usable.
    """
    at = place(where, "beam")
    known = {field.name: field for field in fields(Beam)}
    required = {name for name, field in known.items() if field.default is MISSING}
    given = object_at(data["beam"], at, required, known.keys() - required)
    values = {
        name: _beam_field(value, place(at, name), nullable=_may_be_infinite(known[name].default))
        for name, value in given.items()
    }
    beam = made(lambda: Beam(**values), at)
    at = place(where, "strain_measures")
    names = {field.name for field in fields(StrainMeasures)}
    measures = object_at(data["strain_measures"], at, names)
    for name in ("axial", "curvature"):
        text_at(measures[name], place(at, name))
    for name in ("axial_points", "bending_points"):
        if isinstance(measures[name], bool) or not isinstance(measures[name], int):
            raise InputError("must be a whole number", place(at, name))
    return Model(beam, made(lambda: StrainMeasures(**measures), at))


def law_data(law: DampingLaw, model: Model) -> dict[str, Any]:
    """Return a law as plain data, beside those of a model.

    Raises
    ------
    InputError
        If the law is none of those of the toolkit.
    """
    for name, kind in SIMPLE.items():
        if isinstance(law, kind):
            return {"law": name} | {field.name: getattr(law, field.name) for field in fields(cast(Any, law))}
    if isinstance(law, SumOfLaws):
        return {"law": "sum", "laws": [law_data(term, model) for term in law.laws]}
    if isinstance(law, ModalDamping):
        return {
            "law": "modal",
            "ratios": list(law.ratios),
            "frequencies": list(law.frequencies or ()),
            "modes": _modes_data(law.modes, model),
        }
    known = ", ".join([*(kind.__name__ for kind in SIMPLE.values()), ModalDamping.__name__])
    raise InputError(f"a {type(law).__name__} has no form as data; {known} and their sums have", "damping")


def law_from(data: Any, model: Model, where: str) -> DampingLaw:
    """Make a law from plain data, beside those of a model.

    Raises
    ------
    InputError
        If a key or a value is not usable.
    """
    names = [*SIMPLE, "modal", "sum"]
    name = data.get("law") if isinstance(data, dict) else None
    if name not in names:
        got = f", got {name[:LONGEST_NAME]!r}" if isinstance(name, str) else ""
        raise InputError(f"must be one of {', '.join(names)}{got}", place(where, "law"))
    if name == "sum":
        terms = list_at(object_at(data, where, {"law", "laws"})["laws"], place(where, "laws"))
        if not terms:
            raise InputError("needs at least one law", place(where, "laws"))
        return SumOfLaws(
            tuple(law_from(term, model, place(place(where, "laws"), index)) for index, term in enumerate(terms))
        )
    if name == "modal":
        object_at(data, where, {"law", "ratios", "frequencies", "modes"})
        modes = _modes_from(data["modes"], model, place(where, "modes"))
        ratios, frequencies = (numbers_at(data[key], place(where, key)) for key in ("ratios", "frequencies"))
        return made(lambda: ModalDamping(modes, ratios, frequencies=frequencies), where)
    kind = SIMPLE[name]
    keys = {field.name for field in fields(cast(Any, kind))}
    object_at(data, where, {"law", *keys})
    values = {key: (text_at if key == "stiffness" else number_at)(data[key], place(where, key)) for key in sorted(keys)}
    law: DampingLaw = made(lambda: cast(Any, kind)(**values), where)
    return law


def made(make: Callable[[], Made], where: str) -> Made:
    """Return what a call makes; what it refuses is at a place.

    Raises
    ------
    InputError
        As the call.
    """
    try:
        return make()
    except InputError as error:
        raise InputError(str(error), where) from None


def _beam_value(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_beam_value(item) for item in value]
    return None if value == math.inf else value


def _beam_field(value: Any, where: str, *, nullable: bool) -> Any:
    if isinstance(value, list):
        return tuple(_beam_field(item, place(where, k), nullable=nullable) for k, item in enumerate(value))
    return math.inf if value is None and nullable else number_at(value, where)


def _may_be_infinite(default: Any) -> bool:
    return math.inf in (default if isinstance(default, tuple) else (default,))


def _modes_data(modes: Modes, model: Model) -> dict[str, Any]:
    rest = modes.equilibrium
    data = {
        "frequencies": modes.frequencies.tolist(),
        "shapes": modes.shapes.T.tolist(),
        "equilibrium": {
            "coordinates": rest.coordinates.tolist(),
            "tip_force": list(rest.tip_force),
            "tip_moment": rest.tip_moment,
        },
    }
    return data if modes.model == model else data | model_data(modes.model)


def _modes_from(data: Any, model: Model, where: str) -> Modes:
    own = MODEL_KEYS if isinstance(data, dict) and data.keys() & MODEL_KEYS else set()
    object_at(data, where, {"frequencies", "shapes", "equilibrium", *own})
    if own:
        model = model_from(data, where)
    frequencies = numbers_at(data["frequencies"], place(where, "frequencies"))
    if not frequencies or min(frequencies) <= 0.0:
        raise InputError("must be positive, and at least one", place(where, "frequencies"))
    at = place(where, "shapes")
    shapes = [_sized(shape, model.size, place(at, k)) for k, shape in enumerate(list_at(data["shapes"], at))]
    if len(shapes) != len(frequencies):
        raise InputError(f"has {len(shapes)} shapes for {len(frequencies)} frequencies", at)
    at = place(where, "equilibrium")
    rest = object_at(data["equilibrium"], at, {"coordinates", "tip_force", "tip_moment"})
    coordinates = _sized(rest["coordinates"], model.size, place(at, "coordinates"))
    force = vector(numbers_at(rest["tip_force"], place(at, "tip_force")), place(at, "tip_force"))
    moment = number_at(rest["tip_moment"], place(at, "tip_moment"))
    return Modes(
        Equilibrium(model, coordinates, force, moment), np.array(frequencies), np.ascontiguousarray(np.array(shapes).T)
    )


def _sized(values: Any, size: int, where: str) -> Array:
    found = np.array(numbers_at(values, where))
    if found.size != size:
        raise InputError(f"has {found.size} values for {size} coordinates", where)
    return found
