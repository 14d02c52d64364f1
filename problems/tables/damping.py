"""The tables [[damping]]: the terms of a damping law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ancf_casadi.damping import DampingLaw, FrictionDamping, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located, numbers, shown
from ancf_casadi.vibration.modes import natural_modes
from problems.tables.study import Study, checked

KEYS = """\
  [[damping]]   law = "rayleigh": alpha (1/s), beta (s),
                stiffness ("strain-rate", "tangent" or "reference")
                law = "quadratic": eta1 (1/s), eta2 (1/m); or drag_coefficient,
                air_density (kg/m^3)
                law = "friction": eta0 (m/s^2), smoothing_speed (m/s)
                law = "modal": ratios, frequencies (Hz)
                several tables add up
"""
OF_LAW = {
    "rayleigh": {"alpha", "beta", "stiffness"},
    "quadratic": {"eta1", "eta2", "drag_coefficient", "air_density"},
    "friction": {"eta0", "smoothing_speed"},
    "modal": {"ratios", "frequencies"},
}
PLAIN: dict[str, Callable[..., DampingLaw]] = {
    "rayleigh": RayleighDamping,
    "quadratic": QuadraticDamping,
    "friction": FrictionDamping,
}


def read_terms(study: Study, model: Model) -> list[DampingLaw]:
    """Return the laws of the tables [[damping]], in their order.

    Raises
    ------
    InputError
        If a law is unknown, or a key or value cannot be used.
    """
    return [_term(table, model, study.where("damping")) for table in study.several("damping")]


@dataclass(frozen=True)
class NamedLaw:
    """A law of a study, from a table [[laws]].

    Parameters
    ----------
    name, title : str
        Name, and title in figures.
    terms : tuple of dict
        Its terms as tables [[damping]]; ``{part = "NAME"}`` stands for the terms that a part of the study finds.
    """

    name: str
    title: str
    terms: tuple[dict[str, Any], ...]


def named_laws(study: Study) -> tuple[NamedLaw, ...]:
    """Return the laws of the tables [[laws]].

    Raises
    ------
    InputError
        If a key or value cannot be used, or two laws have one name.
    """
    where = study.where("laws")
    found: dict[str, NamedLaw] = {}
    for table in study.several("laws"):
        given = checked(table, {"name", "terms"}, {"title"}, where)
        name, title, terms = given["name"], given.get("title", given["name"]), given["terms"]
        if not isinstance(name, str) or not name.isidentifier() or name in found:
            raise InputError(f"must be made of letters, digits and _, and differ, got {shown(name)}", f"{where}: name")
        if not isinstance(title, str):
            raise InputError(f"must be a text, got {shown(title)}", f"{where}: {name}: title")
        if not isinstance(terms, list) or not all(isinstance(term, dict) for term in terms):
            raise InputError(f"must be a list of tables, got {shown(terms)}", f"{where}: {name}: terms")
        for term in terms:
            if not isinstance(term.get("part", ""), str):
                raise InputError(f"must be the name of a part, got {shown(term['part'])}", f"{where}: {name}: part")
        found[name] = NamedLaw(name, title, tuple(terms))
    return tuple(found.values())


def resolved(
    terms: Sequence[dict[str, Any]], parts: Mapping[str, Sequence[dict[str, Any]]]
) -> tuple[dict[str, Any], ...]:
    """Return terms in which the references to parts are replaced by what the parts have found.

    Other keys beside ``part`` override those of the terms that the part has found.
    """
    found: list[dict[str, Any]] = []
    for term in terms:
        own = {key: value for key, value in term.items() if key != "part"}
        found += [other | own for other in parts[term["part"]]] if "part" in term else [term]
    return tuple(found)


def law_of(terms: Sequence[Any], model: Model, where: str) -> DampingLaw | None:
    """Return the sum of terms given as tables [[damping]]; None if there are none.

    Raises
    ------
    InputError
        If a law is unknown, or a key or value cannot be used.
    """
    return total([_term(table, model, where) for table in terms])


def total(terms: Sequence[DampingLaw]) -> DampingLaw | None:
    """Return the sum of laws; None if there are none."""
    law: DampingLaw | None = None
    for term in terms:
        law = term if law is None else law + term
    return law


def _term(table: Any, model: Model, where: str) -> DampingLaw:
    kind = table.get("law") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in OF_LAW:
        raise InputError(f"law must be one of {', '.join(OF_LAW)}, got {shown(kind)}", where)
    required = {"law", "ratios"} if kind == "modal" else {"law"}
    given = checked(table, required, OF_LAW[kind], where)
    arguments = {key: value for key, value in given.items() if key != "law"}
    if kind == "quadratic" and {"drag_coefficient", "air_density"} & arguments.keys():
        checked(table, {"law", "drag_coefficient", "air_density"}, set(), where)
        with located(where):
            return QuadraticDamping.from_drag(**arguments, beam=model.beam)
    if kind in PLAIN:
        with located(where):
            return PLAIN[kind](**arguments)
    ratios = numbers(arguments.pop("ratios"), f"{where}: ratios")
    if "frequencies" in arguments:
        arguments["frequencies"] = numbers(arguments["frequencies"], f"{where}: frequencies")
    count = min(max(1, len(ratios)), model.size - model.free.start)
    with located(where):
        return ModalDamping(natural_modes(model, count=count), ratios, **arguments)
