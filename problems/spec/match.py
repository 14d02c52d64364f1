"""The table [match]: targets and unknowns of a frequency matching."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any

from msgspec import Meta

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import numbers, shown
from problems.matching.measured_modes import MeasuredModes
from problems.matching.unknowns import Global, PerElement, PropertyUnknown, Smooth
from problems.spec.help import table_help


@dataclass(frozen=True, kw_only=True)
class MatchTable:
    """Keys of the table [match], which ``match_frequencies`` and ``MeasuredModes`` check; None for those not given."""

    targets: Annotated[Any, Meta(description="Hz")] = None
    frequency_std: Annotated[Any, Meta(description="Hz")] = None
    points: Annotated[Any, Meta(description="m, of measured shapes")] = None
    shapes: Any = None
    shape_std: Any = None
    bounds: Any = None
    objective: Annotated[Any, Meta(description='"least-squares" or "worst-error"')] = None
    priors: Annotated[Any, Meta(description='{density = [7850.0, 50.0]}, or [MEDIAN, RELATIVE STD, "log-normal"]')] = (
        None
    )
    starts: Any = None
    seed: Any = None
    unknowns: Annotated[
        Any,
        Meta(description='{width = "element", density = "global", thickness = {smooth = 3, relative_bounds = 0.05}}'),
    ] = None

    @property
    def request(self) -> dict[str, Any]:
        """The keys that are given."""
        given = {field.name: getattr(self, field.name) for field in fields(MatchTable)}
        return {key: value for key, value in given.items() if value is not None}


MATCH_KEYS = table_help("[match]", "{}", MatchTable)
MOST_ELEMENTS = 1000  # a match with more takes minutes, and Ctrl-C does not end it at once
MODE_KEYS = ("frequency_std", "points", "shapes", "shape_std")  # keys that belong to MeasuredModes


def request_of(table: MatchTable) -> dict[str, Any]:
    """Return the arguments of ``match_frequencies`` after the beam from the keys of a table [match]."""
    request = table.request
    if "targets" not in request:
        raise InputError("the key 'targets' is missing")
    measured = {key: request.pop(key) for key in MODE_KEYS if key in request}
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
    """Make an unknown from "global", "element", {smooth = 3}, or {element = true, relative_bounds = 0.05}."""
    table = {given: True} if given in ("global", "element") else given
    kinds = sorted({"global", "element", "smooth"} & set(table)) if isinstance(table, dict) else []
    usable = len(kinds) == 1 and set(table) <= {kinds[0], "relative_bounds"}
    if not usable or (kinds[0] != "smooth" and table[kinds[0]] is not True):
        raise InputError(
            'must be "global", "element", {smooth = 3} or {element = true, relative_bounds = 0.05}, '
            f"got {shown(given)}",
            f"unknowns: {name}",
        )
    bounds = table.get("relative_bounds")
    if kinds[0] == "smooth":
        return Smooth(name, terms=table["smooth"], relative_bounds=bounds)
    return Global(name, bounds) if kinds[0] == "global" else PerElement(name, bounds)
