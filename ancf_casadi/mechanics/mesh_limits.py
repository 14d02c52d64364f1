"""Limits of a mesh: the largest bend and the least length of its elements.

A cubic follows a bend of about half a radian.  In a bent beam, the lengths of the slopes at the nodes may alternate,
which two axial Gauss points per element hardly resist: elements about as short as the beam is thick are unstable
(``docs/theory.md``).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array

MAX_BEND = 0.5  # of an element, rad; the error of positions is then 3e-4 of the length, and grows steeply
SHAPES_TOGETHER = 1024  # shapes of the beam whose angles are computed at once
SHORTEST_PER_BEND = 0.9  # thicknesses per rad; an arc of shorter elements is unstable
SHORT_ELEMENTS_ADVICE = "elements as short as the beam is thick are unstable in bending: use fewer"


def largest_bend(model: Model, coordinates: Array) -> float:
    """Return the largest bend of an element in some coordinates (..., size), rad.

    This is its turn, or more if the slopes at its ends are turned to the same side of the chord.
    """
    return max((float(np.abs(angles).sum(axis=-1).max()) for angles in _end_angles(model, coordinates)), default=0.0)


def _end_angles(model: Model, coordinates: Array) -> Iterator[Array]:
    """Yield the angles to the chords (k, n, 2) in coordinates (..., size), of k shapes at a time to save memory."""
    shapes = coordinates.reshape(-1, model.size)
    for start in range(0, len(shapes), SHAPES_TOGETHER):
        yield model.end_angles(shapes[start : start + SHAPES_TOGETHER])


def bend_advice(model: Model, bend: float) -> str:
    """Return advice if an element bends by too much (rad); empty if none does."""
    if not bend > MAX_BEND:
        return ""
    return (
        f"an element bends by {bend:.2g} rad, more than the {MAX_BEND:g} rad that a cubic element can follow; use "
        f"{math.ceil(model.beam.elements * bend / MAX_BEND)} elements or more"
    )


def warn_of_overbent_elements(model: Model, coordinates: Array) -> None:
    """Warn if an element bends too far in some coordinates (..., size)."""
    if text := bend_advice(model, largest_bend(model, coordinates)):
        warnings.warn(text, stacklevel=3)


@contextmanager
def bends_allowed() -> Iterator[None]:
    """Suppress the warning of elements that bend too far, where the result of a computation states it once."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "an element bends")
        yield


def warn_of_short_elements(model: Model, coordinates: Array) -> None:
    """Warn if elements are too short for the bend of a beam in some coordinates (..., size)."""
    if model.measures.axial_points > 2:
        return
    turns = (np.cumsum(-np.diff(angles)[..., 0], axis=1) for angles in _end_angles(model, coordinates))
    bent = max(float(np.ptp(np.insert(sums, 0, 0.0, axis=1), axis=1).max()) for sums in turns)
    shortest = float((model.beam.element_lengths / model.beam.thickness).min())
    shortest_allowed = SHORTEST_PER_BEND * bent
    if shortest >= shortest_allowed:
        return
    warnings.warn(
        f"the beam bends by {bent:.2g} rad, and its shortest element is {shortest:.2g} thicknesses long: below "
        f"{shortest_allowed:.2g} the motion may be wrong; use fewer elements, or StrainMeasures(axial_points=3)",
        stacklevel=3,
    )
