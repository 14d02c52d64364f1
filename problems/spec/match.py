"""The table [match]: targets and unknowns of a frequency matching."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType, field

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


class MatchTable(Spec, frozen=True, kw_only=True):
    """Targets and unknowns of a frequency matching."""

    targets: Annotated[tuple[Positive, ...], Meta(description="Hz")]
    frequency_std: Annotated[Positive | tuple[Positive, ...] | UnsetType, Meta(description="Hz")] = UNSET
    points: Annotated[tuple[NotNegative, ...] | UnsetType, Meta(description="m, of measured shapes")] = UNSET
    shapes: tuple[tuple[float, ...], ...] | UnsetType = UNSET
    shape_std: Deviations | UnsetType = UNSET
    bounds: Annotated[RelativeBounds | UnsetType, Meta(description="largest relative change")] = UNSET
    objective: Objective | UnsetType = UNSET
    priors: Annotated[
        dict[str, Any] | UnsetType,
        Meta(description='{density = [7850.0, 50.0]}, or [MEDIAN, RELATIVE STD, "log-normal"]'),
    ] = UNSET
    starts: Annotated[int, Meta(ge=1)] | UnsetType = UNSET
    seed: Annotated[int, Meta(ge=0)] | UnsetType = UNSET
    unknowns: Annotated[
        dict[str, Literal["global", "element"] | UnknownSpec] | UnsetType,
        Meta(description='{width = "element", density = "global", thickness = {smooth = 3, relative_bounds = 0.05}}'),
    ] = UNSET

    def request(self) -> dict[str, Any]:
        """Return the arguments of ``match_frequencies`` after the beam."""
        request = self.set_fields()
        measured = {key: request.pop(key) for key in MODE_KEYS if key in request}
        request["targets"] = MeasuredModes(frequencies=self.targets, **measured) if measured else list(self.targets)
        if self.unknowns is not UNSET:
            kinds = {name: KINDS[kind] if isinstance(kind, str) else kind for name, kind in self.unknowns.items()}
            request["unknowns"] = tuple(kind.unknown(name) for name, kind in kinds.items())
        return request
