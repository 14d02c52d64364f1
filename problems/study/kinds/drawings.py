"""A part with a drawing: the element, Figure 1, or the assumed deflection, Figure 11 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

import numpy as np

from ancf_casadi.support.inputs import check_keys, choice, located
from problems.study.drawing import drawn
from problems.study.figures.deflection import deflection_figure, deflections
from problems.study.figures.element import element_figure
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part
from problems.study.source import BeamChoice, Source

KEYS = """\
  kind = "drawing"      subject = "element" (a two-node element with its
                        coordinates) or "uniform-load" (the deflection under a
                        uniform load beside mode 1); beam ("PART")
"""
SUBJECTS = ("element", "uniform-load")


class DrawingNumbers(TypedDict, total=False):
    """Largest differences of the computed deflections from Eq. (21), relative to that of the tip; none for others."""

    uniform_load_difference: float
    mode_1_difference: float


@final
@dataclass(frozen=True)
class DrawingPart(Part):
    """A drawing.

    Parameters
    ----------
    choice : BeamChoice
        The beam.
    subject : str
        One of ``SUBJECTS``.
    """

    kind = "drawing"
    numbers = DrawingNumbers

    choice: BeamChoice
    subject: str

    @property
    def needs(self) -> tuple[str, ...]:
        """The part that finds the beam."""
        return self.choice.needs

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the drawing."""
        name = self.heading.name
        if self.subject == "element":
            caption = (
                "Element of the beam: the positions r₀, rₗ and the slopes τ₀, τₗ of its nodes, in the inertial frame, "
                "are its coordinates; r(p) is a point of the centre line."
            )
            return Finding(Outcome({}), figures=(drawn(name, caption, element_figure),))
        shapes = deflections(self.choice.beam(found))
        differences = {
            "uniform_load_difference": float(np.abs(shapes.uniform_load - shapes.assumed).max()),
            "mode_1_difference": float(np.abs(shapes.mode - shapes.assumed).max()),
        }
        caption = (
            "Deflection of the beam under a uniform load, relative to that of the tip: Eq. (21), the computed "
            "equilibrium, and mode 1 beside them.  Below: differences from Eq. (21)."
        )
        return Finding(Outcome(differences), figures=(drawn(name, caption, lambda: deflection_figure(shapes)),))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> DrawingPart:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"subject"}, {"beam"}, where)
    with located(where):
        subject = choice(given["subject"], SUBJECTS, "subject")
    return DrawingPart(heading, source.beam_choice(given, where), subject)


KIND = Kind(DrawingPart.kind, "Drawing", KEYS, read)
