"""The table [match]: targets and unknowns of a frequency matching."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.specs import NotNegative, Positive, Spec
from problems.matching.measured_modes import MeasuredModes
from problems.matching.response import Objective
from problems.matching.unknowns import Global, PerElement, PropertyUnknown, Smooth

RelativeBounds = Annotated[float, Meta(gt=0.0, le=1.0)]
Deviations = float | tuple[float | tuple[float, ...], ...]
MOST_ELEMENTS = 1000  # a match with more takes minutes, and Ctrl-C does not end it at once
MODE_KEYS = ("frequency_std", "points", "shapes", "shape_std")  # keys that belong to MeasuredModes


class UnknownSpec(Spec, frozen=True):
    """A property that may change: by one factor, in each element, or as a smooth function with so many terms."""

    all_elements: bool = field(default=False, name="global")
    element: bool = False
    smooth: Annotated[int, Meta(ge=1)] | None = None
    relative_bounds: RelativeBounds | None = None

    def __post_init__(self) -> None:
        """Refuse several kinds, or none."""
        if [self.all_elements, self.element, self.smooth is not None].count(True) != 1:
            raise ValueError('must be "global", "element", {smooth = 3} or {element = true, relative_bounds = 0.05}')

    def unknown(self, name: str) -> PropertyUnknown:
        """Return the unknown with the name of the property."""
        if self.smooth is not None:
            return Smooth(name, terms=self.smooth, relative_bounds=self.relative_bounds)
        return (Global if self.all_elements else PerElement)(name, self.relative_bounds)


KINDS = {"global": UnknownSpec(all_elements=True), "element": UnknownSpec(element=True)}


@dataclass(frozen=True, kw_only=True)
class MatchTable:
    """Targets and unknowns of a frequency matching."""

    targets: Annotated[tuple[Positive, ...] | None, Meta(description="Hz")] = None
    frequency_std: Annotated[Positive | tuple[Positive, ...] | None, Meta(description="Hz")] = None
    points: Annotated[tuple[NotNegative, ...] | None, Meta(description="m, of measured shapes")] = None
    shapes: tuple[tuple[float, ...], ...] | None = None
    shape_std: Deviations | None = None
    bounds: Annotated[RelativeBounds | None, Meta(description="largest relative change")] = None
    objective: Objective | None = None
    priors: Annotated[
        dict[str, Any] | None,
        Meta(description='{density = [7850.0, 50.0]}, or [MEDIAN, RELATIVE STD, "log-normal"]'),
    ] = None
    starts: Annotated[int, Meta(ge=1)] | None = None
    seed: Annotated[int, Meta(ge=0)] | None = None
    unknowns: Annotated[
        dict[str, Literal["global", "element"] | UnknownSpec] | None,
        Meta(description='{width = "element", density = "global", thickness = {smooth = 3, relative_bounds = 0.05}}'),
    ] = None

    @property
    def request(self) -> dict[str, Any]:
        """The keys that are given."""
        keys = {declared.name: getattr(self, declared.name) for declared in fields(MatchTable)}
        return {key: value for key, value in keys.items() if value is not None}


def request_of(table: MatchTable) -> dict[str, Any]:
    """Return the arguments of ``match_frequencies`` after the beam from the keys of a table [match]."""
    request = table.request
    if table.targets is None:
        raise InputError("the key 'targets' is missing")
    measured = {key: request.pop(key) for key in MODE_KEYS if key in request}
    request["targets"] = MeasuredModes(frequencies=table.targets, **measured) if measured else list(table.targets)
    if table.unknowns is not None:
        kinds = {name: KINDS[kind] if isinstance(kind, str) else kind for name, kind in table.unknowns.items()}
        request["unknowns"] = tuple(kind.unknown(name) for name, kind in kinds.items())
    return request
