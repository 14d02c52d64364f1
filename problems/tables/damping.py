"""The tables [[damping]]: the terms of a damping law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located, numbers, shown
from ancf_casadi.vibration.modes import natural_modes
from problems.tables.study import Study, checked

KEYS = """\
  [[damping]]   law = "rayleigh": alpha (1/s), beta (s),
                stiffness ("strain-rate", "tangent" or "reference")
                law = "quadratic": eta1 (1/s), eta2 (1/m)
                law = "modal": ratios, frequencies (Hz)
                several tables add up
"""
OF_LAW = {
    "rayleigh": {"alpha", "beta", "stiffness"},
    "quadratic": {"eta1", "eta2"},
    "modal": {"ratios", "frequencies"},
}


def read_terms(study: Study, model: Model) -> list[DampingLaw]:
    """Return the laws of the tables [[damping]], in their order.

    Raises
    ------
    InputError
        If a law is unknown, or a key or value cannot be used.
    """
    return [_term(table, model, study.where("damping")) for table in study.several("damping")]


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
    if kind != "modal":
        with located(where):
            return RayleighDamping(**arguments) if kind == "rayleigh" else QuadraticDamping(**arguments)
    ratios = numbers(arguments.pop("ratios"), f"{where}: ratios")
    if "frequencies" in arguments:
        arguments["frequencies"] = numbers(arguments["frequencies"], f"{where}: frequencies")
    count = min(max(1, len(ratios)), model.size - model.free.start)
    with located(where):
        return ModalDamping(natural_modes(model, count=count), ratios, **arguments)
