"""The table [match]: targets and unknowns of a frequency matching."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import located, numbers, shown
from problems.matching.measured_modes import MeasuredModes
from problems.matching.unknowns import Global, PerElement, PropertyUnknown, Smooth
from problems.tables.study import Study

KEYS = """\
  [match]       targets (Hz), frequency_std (Hz), bounds, starts, seed,
                objective ("least-squares" or "worst-error");
                for measured shapes: points (m), shapes, shape_std;
                unknowns = {width = "element", density = "global",
                thickness = {smooth = 3, bounds = 0.05}}
"""
MOST_ELEMENTS = 1000  # a match with more takes minutes, and Ctrl-C does not end it at once
MODES = ("frequency_std", "points", "shapes", "shape_std")  # keys that belong to MeasuredModes
MATCH_KEYS = {"targets", "bounds", "objective", "starts", "seed", "unknowns", *MODES}


def read_request(study: Study) -> dict[str, Any]:
    """Return the arguments of ``match_frequencies`` after the beam.

    Raises
    ------
    InputError
        If the table is missing, or a key or value cannot be used.
    """
    table = study.table("match", {"targets"}, MATCH_KEYS - {"targets"})
    with located(study.where("match")):
        return request_of(table)


def request_of(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of ``match_frequencies`` after the beam from the keys of a table [match].

    Raises
    ------
    InputError
        If the targets are missing, or a value cannot be used.
    """
    if "targets" not in table:
        raise InputError("the key is missing", "targets")
    request = dict(table)
    measured = {key: request.pop(key) for key in MODES if key in request}
    targets = list(numbers(request["targets"], "targets"))
    request["targets"] = MeasuredModes(frequencies=tuple(targets), **measured) if measured else targets
    if "unknowns" in request:
        request["unknowns"] = _unknowns(request["unknowns"])
    return request


def _unknowns(table: Any) -> tuple[PropertyUnknown, ...]:
    if not isinstance(table, dict):
        raise InputError(f"must be a table of properties, got {shown(table)}", "unknowns")
    return tuple(_unknown(name, given) for name, given in table.items())


def _unknown(name: str, given: Any) -> PropertyUnknown:
    """Make an unknown from "global", "element", {smooth = 3}, or {element = true, bounds = 0.05}."""
    table = {given: True} if given in ("global", "element") else given
    kinds = sorted({"global", "element", "smooth"} & set(table)) if isinstance(table, dict) else []
    usable = len(kinds) == 1 and set(table) <= {kinds[0], "bounds"}
    if not usable or (kinds[0] != "smooth" and table[kinds[0]] is not True):
        raise InputError(
            f'must be "global", "element", {{smooth = 3}} or {{element = true, bounds = 0.05}}, got {shown(given)}',
            f"unknowns: {name}",
        )
    bounds = table.get("bounds")
    if kinds[0] == "smooth":
        return Smooth(name, terms=table["smooth"], bounds=bounds)
    return Global(name, bounds) if kinds[0] == "global" else PerElement(name, bounds)
