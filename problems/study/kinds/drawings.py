"""Parts without computed numbers: a drawing, and the reason why tables and figures are not computed.

The drawings are the element, Figure 1, and the assumed deflection, Figure 11 of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, TypedDict, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from problems.study.drawing import drawn
from problems.study.figures.deflection import deflection_figure, deflections
from problems.study.figures.element import element_figure
from problems.study.part import Effort, Finding, Found, Part
from problems.study.source import Source


class DrawingNumbers(TypedDict, total=False):
    """Largest differences of the computed deflections from Eq. (21), relative to that of the tip; none for others."""

    uniform_load_difference: float
    mode_1_difference: float


@final
@dataclass(frozen=True, kw_only=True)
class DrawingPart(Part):
    """A drawing."""

    kind, about, heading = "drawing", "{}", "Drawing"
    numbers = DrawingNumbers
    naming = ("beam",)

    subject: Annotated[
        Literal["element", "uniform-load"],
        Meta(
            description='"element": a two-node element with its coordinates; "uniform-load": the deflection under a '
            "uniform load beside mode 1"
        ),
    ]
    beam: Annotated[str, Meta(description='"PART"')] = ""

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the drawing."""
        if self.subject == "element":
            caption = (
                "Element of the beam: the positions r₀, rₗ and the slopes τ₀, τₗ of its nodes, in the inertial frame, "
                "are its coordinates; r(p) is a point of the centre line."
            )
            return Finding({}, figures=(drawn(self.name, caption, element_figure),))
        shapes = deflections(self.beam_in(found))
        differences = {
            "uniform_load_difference": float(np.abs(shapes.uniform_load - shapes.assumed).max()),
            "mode_1_difference": float(np.abs(shapes.mode - shapes.assumed).max()),
        }
        caption = (
            "Deflection of the beam under a uniform load, relative to that of the tip: Eq. (21), the computed "
            "equilibrium, and mode 1 beside them.  Below: differences from Eq. (21)."
        )
        return Finding(differences, figures=(drawn(self.name, caption, lambda: deflection_figure(shapes)),))


class OmittedNumbers(TypedDict):
    """Labels that are not computed, and the reason."""

    omitted: list[str]
    reason: str


@final
@dataclass(frozen=True, kw_only=True)
class Omitted(Part):
    """Tables and figures that are not computed."""

    kind, about, heading = "omitted", "{}", "Not computed"
    numbers = OmittedNumbers

    reason: Annotated[str, Meta(description="why the labelled tables and figures are not computed")]

    def checked(self, source: Source, where: str) -> Self:
        """Return the part, which must have a reason."""
        if not self.reason.strip():
            raise InputError("must not be empty; say why the tables and figures are not computed", f"{where}: reason")
        return self

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the reason."""
        return Finding({"omitted": [*self.tables, *self.figures], "reason": self.reason})
