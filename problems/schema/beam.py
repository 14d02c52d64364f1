"""The tables of a beam: [beam], or a JSON document with a beam and its damping, and [[damping]], the terms of a law."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from ancf_casadi.damping import (
    DampingLaw,
    FrictionDamping,
    ModalDamping,
    QuadraticDamping,
    RayleighDamping,
    SumOfLaws,
)
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.model_document import Document, read_document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_keys, is_sequence, located, shown
from ancf_casadi.vibration.modes import natural_modes
from problems.schema.table import StudyFile, is_document, made

HEAD = "tables of a TOML file:\n"
BEAM_KEYS = """\
  [beam]        length (m), elements; width, thickness (m), density (kg/m^3),
                elastic_modulus (Pa): each a number, or a list with one value
                per element; optional: axis, gravity (m/s^2), tip_mass (kg),
                clamp_stiffness (N m/rad), natural_curvature (1/m),
                prestress (Pa);
                supports = []: a free beam
                or only document = "BEAM.json": a JSON document with a beam and
                its damping; a relative path starts at the folder of this file
"""
PART_KEYS = """\
  [[beam.supports]]
                instead of a clamp at 0; kind = "clamp": point (m), stiffness
                (N m/rad, inf if rigid), displacement (m), rotation (rad)
                kind = "pin": point, displacement
                kind = "roller": point, direction of sliding, displacement
                kind = "guide": point, direction, displacement, rotation
  [[beam.attachments]]
                kind = "mass": point (m), mass (kg), rotary_inertia (kg m^2)
                kind = "spring": point, stiffness = [X, Y] (N/m)
                kind = "rotational_spring": point, stiffness (N m/rad)
                kind = "dashpot": point, coefficient = [X, Y] (N s/m)
"""
DAMPING_KEYS = """\
  [[damping]]   law = "rayleigh": alpha (1/s), beta (s),
                stiffness ("strain-rate", "tangent" or "reference")
                law = "quadratic": eta1 (1/s), eta2 (1/m); or drag_coefficient,
                air_density (kg/m^3); flow = [X, Y] of the air (m/s)
                law = "friction": eta0 (m/s^2), smoothing_speed (m/s)
                law = "modal": ratios, frequencies (Hz)
                several tables add up
"""
BEAM_HELP = HEAD + BEAM_KEYS + PART_KEYS
DAMPED_HELP = BEAM_HELP + DAMPING_KEYS
DAMPING_LAWS: dict[str, Callable[..., DampingLaw]] = {
    "rayleigh": RayleighDamping,
    "quadratic": QuadraticDamping,
    "friction": FrictionDamping,
    "modal": ModalDamping,
}


def read_beam(given: str | StudyFile) -> Document:
    """Read the beam of a TOML file, or a JSON document (a name that ends in ``.json``) with a beam and its damping."""
    if isinstance(given, str) and is_document(given):
        return read_document(given)
    file = StudyFile.of(given)
    table, where = file.needed("beam"), file.where("beam")
    if isinstance(table, dict) and "document" in table:
        check_keys(table, {"document"}, set(), where)
        path = file.beside(table["document"], f"{where}: document")
        with located(f"{where}: document"):
            return read_document(path)
    return Document(Model(Beam.from_table(table, file.path)))


def read_damped(given: str | StudyFile) -> Document:
    """Read a beam and its damping; the damping of a document holds unless the file has its own."""
    if isinstance(given, str) and is_document(given):
        return read_document(given)
    file = StudyFile.of(given)
    source = read_beam(file)
    if "damping" not in file.tables:
        return source
    return replace(source, damping=law_of(file.several("damping"), source.model, file.where("damping")))


def damping_on(given: str | StudyFile, model: Model) -> DampingLaw | None:
    """Return the damping of a file on another beam than that of the file; modal laws take the modes of that beam."""
    file = StudyFile.of(given)
    if "damping" in file.tables:
        return law_of(file.several("damping"), model, file.where("damping"))
    law = read_beam(file).damping
    terms = law.laws if isinstance(law, SumOfLaws) else [] if law is None else [law]
    return total(
        [
            ModalDamping(natural_modes(model, count=len(term.ratios)), term.ratios)
            if isinstance(term, ModalDamping)
            else term
            for term in terms
        ]
    )


def law_of(terms: Sequence[Any], model: Model, where: str) -> DampingLaw | None:
    """Return the sum of terms given as tables [[damping]]; None if there are none."""
    return total([term_of(table, model, where) for table in terms])


def total(terms: Sequence[DampingLaw]) -> DampingLaw | None:
    """Return the sum of laws; None if there are none."""
    return reduce(operator.add, terms) if terms else None


def term_of(table: Any, model: Model, where: str) -> DampingLaw:
    """Return the law of one table [[damping]]."""
    kind = table.get("law") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in DAMPING_LAWS:
        raise InputError(f"law must be one of {', '.join(DAMPING_LAWS)}, got {shown(kind)}", where)
    own = {key: value for key, value in table.items() if key != "law"}
    if kind == "quadratic" and {"drag_coefficient", "air_density"} & own.keys():
        return made(own, QuadraticDamping.from_drag, where, beam=model.beam)
    if kind != "modal":
        return made(own, DAMPING_LAWS[kind], where)
    ratios: Any = own.get("ratios")
    count = min(max(1, len(ratios) if is_sequence(ratios) else 1), model.freedoms)
    return made(own, ModalDamping, where, modes=natural_modes(model, count=count))
