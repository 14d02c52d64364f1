"""Models and damping laws as data of the document's layout, and back without loss."""

from __future__ import annotations

import math
from typing import assert_never

import numpy as np
from msgspec import UNSET
from msgspec.structs import asdict, replace

from ancf_casadi.damping import DampingLaw, FrictionDamping, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.strict_json import place
from ancf_casadi.export.document.structs import (
    BeamData,
    EquilibriumData,
    FrictionData,
    LawData,
    ModalData,
    ModesData,
    QuadraticData,
    RayleighData,
    StrainMeasuresData,
    SumData,
    data_of,
)
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import located
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes


def beam_data(beam: Beam) -> BeamData:
    """Return the fields of a beam."""
    data = data_of(beam, BeamData)
    return replace(data, clamp_stiffness=None) if math.isinf(beam.clamp_stiffness) else data


def law_data(law: DampingLaw, model: Model) -> LawData:
    """Return the fields of a damping law, for a document that holds a model.

    Raises
    ------
    InputError
        If the layout has no place for the law.
    """
    match law:
        case RayleighDamping():
            return data_of(law, RayleighData)
        case QuadraticDamping():
            return data_of(law, QuadraticData)
        case FrictionDamping():
            return data_of(law, FrictionData)
        case ModalDamping():
            return ModalData(tuple(law.ratios), tuple(law.frequencies or ()), _modes_data(law.modes, model))
        case SumOfLaws():
            return SumData(tuple(law_data(term, model) for term in law.laws))
    known = ", ".join(kind.__name__ for kind in (RayleighDamping, QuadraticDamping, FrictionDamping, ModalDamping))
    message = f"a {type(law).__name__} cannot be written to a document; only {known} and their sums can"
    raise InputError(message, "damping")


def model_from(beam: BeamData, measures: StrainMeasuresData, where: str) -> Model:
    """Return the model that a document holds at a place.

    Raises
    ------
    InputError
        If the values do not make a beam.
    """
    given = asdict(beam) | {"clamp_stiffness": math.inf if beam.clamp_stiffness is None else beam.clamp_stiffness}
    with located(place(where, "beam")):
        known = Beam(**given)
    with located(place(where, "strain_measures")):
        return Model(known, StrainMeasures(**asdict(measures)))


def law_from(data: LawData, model: Model, where: str) -> DampingLaw:
    """Return the damping law that a document holds at a place, beside a model.

    Raises
    ------
    InputError
        If the values do not make a law.
    """
    match data:
        case RayleighData():
            with located(where):
                return RayleighDamping(**asdict(data))
        case QuadraticData():
            with located(where):
                return QuadraticDamping(**asdict(data))
        case FrictionData():
            with located(where):
                return FrictionDamping(**asdict(data))
        case ModalData():
            modes = _modes_from(data.modes, model, place(where, "modes"))
            with located(where):
                return ModalDamping(modes, data.ratios, frequencies=data.frequencies)
        case SumData():
            at = place(where, "laws")
            return SumOfLaws(tuple(law_from(term, model, place(at, k)) for k, term in enumerate(data.laws)))
    assert_never(data)


def _modes_data(modes: Modes, model: Model) -> ModesData:
    rest, own = modes.equilibrium, modes.model != model
    if rest.loads:
        raise InputError("refer to an equilibrium under loads away from the tip, which a document cannot hold", "modes")
    return ModesData(
        frequencies=tuple(modes.frequencies.tolist()),
        shapes=tuple(map(tuple, modes.shapes.T.tolist())),
        equilibrium=EquilibriumData(tuple(rest.coordinates.tolist()), rest.tip_force, rest.tip_moment),
        beam=beam_data(modes.model.beam) if own else UNSET,
        strain_measures=data_of(modes.model.measures, StrainMeasuresData) if own else UNSET,
    )


def _modes_from(data: ModesData, model: Model, where: str) -> Modes:
    if data.beam is not UNSET and data.strain_measures is not UNSET:
        model = model_from(data.beam, data.strain_measures, where)
    at, count = place(where, "shapes"), len(data.frequencies)
    if len(data.shapes) != count:
        raise InputError(f"has {len(data.shapes)} shapes for {count} frequencies", at)
    shapes = [_coordinates(shape, model, place(at, k)) for k, shape in enumerate(data.shapes)]
    rest = data.equilibrium
    coordinates = _coordinates(rest.coordinates, model, f"{where}.equilibrium.coordinates")
    equilibrium = Equilibrium(model, coordinates, rest.tip_force, rest.tip_moment)
    return Modes(equilibrium, np.array(data.frequencies), np.ascontiguousarray(np.array(shapes).T))


def _coordinates(values: tuple[float, ...], model: Model, where: str) -> Array:
    if len(values) != model.size:
        raise InputError(f"has {len(values)} values for {model.size} coordinates", where)
    return np.array(values)
