"""The table [match]: targets and unknowns of a frequency matching."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.inputs import check_keys, located, numbers, shown
from problems.matching.measured_modes import MeasuredModes
from problems.matching.unknowns import Global, PerElement, PropertyUnknown, Smooth
from problems.schema.beam import BEAM_HELP, read_beam
from problems.schema.file import StudyFile

KEYS = """\
  [match]       targets (Hz), frequency_std (Hz), bounds, starts, seed,
                objective ("least-squares" or "worst-error");
                for measured shapes: points (m), shapes, shape_std;
                unknowns = {width = "element", density = "global",
                thickness = {smooth = 3, bounds = 0.05}}
"""
MATCH_HELP = BEAM_HELP + KEYS
MOST_ELEMENTS = 1000  # a match with more takes minutes, and Ctrl-C does not end it at once
MODES = ("frequency_std", "points", "shapes", "shape_std")  # keys that belong to MeasuredModes
MATCH_KEYS = {"targets", "bounds", "objective", "starts", "seed", "unknowns", *MODES}


def read_match(given: str | StudyFile) -> tuple[Beam, dict[str, Any]]:
    """Read a beam and the arguments of ``match_frequencies`` after it.

    Raises
    ------
    InputError
        If a table is missing, a key or value cannot be used, or a match does not support the strain measures.
    """
    file = StudyFile.of(given)
    model, where = read_beam(file).model, file.where("match")
    if model.measures != StrainMeasures():
        raise InputError(
            "the document has strain measures that a match does not support; use the defaults", file.where("beam")
        )
    if model.beam.elements > MOST_ELEMENTS:
        raise InputError(
            f"a match takes {MOST_ELEMENTS} at most, got {model.beam.elements}; 20 to 100 are enough",
            f"{file.where('beam')}: elements",
        )
    table = file.needed("match")
    check_keys(table, {"targets"}, MATCH_KEYS - {"targets"}, where)
    with located(where):
        return model.beam, request_of(table)


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
