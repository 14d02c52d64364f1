"""Curvature and axial strain at any point of a beam, from the places of an element where they are accurate.

The curvature of a cubic element is accurate at its two Gauss points; elsewhere it is taken from the straight line
through these values.  Of the axial strain, only the mean over an element is accurate; elsewhere the straight line
through the means of two elements is used.

The coordinates are numbers or symbols: ``at`` multiplies an interpolation matrix (2, 4 n + 4) by them, and returns the
x and the y component.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import axial_strain, curvature, gauss
from ancf_casadi.support.arrays import Array

At = Callable[[Array], tuple[Any, Any]]


def curvature_at(model: Model, s: float, at: At) -> Any:
    """Return the curvature at arc length ``s`` (m), 1/m, positive counterclockwise."""
    points = first, second = _gauss_points(model, model.element_at(s))
    slopes, seconds = (
        [at(rows(point)) for point in points] for rows in (model.slope_interpolation, model.curvature_interpolation)
    )
    values = [curvature(*pair, model.measures.curvature) for pair in zip(slopes, seconds, strict=True)]
    return values[0] + (s - first) / (second - first) * (values[1] - values[0])


def axial_strains_near(model: Model, s: float, at: At) -> list[tuple[float, int, Any]]:
    """Return the two elements whose mean axial strains give that at arc length ``s`` (m): weight, number and strain."""
    model.element_at(s)
    place = s / model.beam.element_length - 0.5
    index = min(max(int(place), 0), model.beam.elements - 2)
    pairs = ((1.0 - (place - index), index), (place - index, index + 1))
    return [(weight, k, _mean_axial_strain(model, k, at)) for weight, k in pairs]


def _mean_axial_strain(model: Model, index: int, at: At) -> Any:
    first, second = _gauss_points(model, index)
    strains = [axial_strain(at(model.slope_interpolation(s)), model.measures.axial) for s in (first, second)]
    return (strains[0] + strains[1]) / 2


def _gauss_points(model: Model, index: int) -> tuple[float, float]:
    """Return the arc lengths of the Gauss points of an element, m."""
    first, second = ((index + gauss(2)[0]) * model.beam.element_length).tolist()
    return first, second
