"""Which of the beams that fit is the answer: the one changed least, or the smoothest.

With more unknowns than data a family of beams has the measured modes.  A preference, a small multiple of a quadratic
form of the unknowns m less their values m_0 at the given beam, picks one:

    LeastChange    w/2 |m - m_0|^2
    Smoothness     w/2 sum (f_(i+1) - f_i)^2 over neighbouring elements, f the factors on each property.

The weight w stands against half the sum of the squared residuals, each in units of its standard deviation, or relative
frequency errors where none are given.  An uncertainty of 10 % known beforehand is w = 1/0.1^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.beam import PROPERTIES
from ancf_casadi.inputs import positive
from problems.design_space import DesignSpace

WEIGHT = 1e-8  # what a relative frequency error of 1e-4 costs, a change of 1 in one factor costs too


@dataclass(frozen=True)
class LeastChange:
    """The beam changed least.

    Parameters
    ----------
    weight : float, optional
        Weight w; if not given 1e-8 in units of the best known relative frequency, so that it only picks among beams
        that fit.

    Raises
    ------
    InputError
        If it is not positive.
    """

    weight: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        if self.weight is not None:
            positive(self.weight, "preference: weight")

    def matrix(self, space: DesignSpace, usual: float) -> NDArray[np.float64]:
        """Return the matrix of the quadratic form, weight included, (N, N)."""
        return np.eye(space.size) * (usual if self.weight is None else self.weight)


@dataclass(frozen=True)
class Smoothness:
    """The smoothest beam; among equally smooth ones the one changed least.

    Parameters
    ----------
    weight : float, optional
        Weight w, as in ``LeastChange``; if not given, 1000 times the usual one of least change.

    Raises
    ------
    InputError
        If it is not positive.
    """

    weight: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        if self.weight is not None:
            positive(self.weight, "preference: weight")

    def matrix(self, space: DesignSpace, usual: float) -> NDArray[np.float64]:
        """Return the matrix of the quadratic form, weight included, (N, N)."""
        of_elements = space.map[: len(PROPERTIES) * space.beam.elements]
        factors = of_elements.reshape(len(PROPERTIES), space.beam.elements, space.size)
        steps = np.diff(factors, axis=1).reshape(-1, space.size)
        weight = 1e3 * usual if self.weight is None else self.weight
        return np.asarray(weight * steps.T @ steps + usual * np.eye(space.size))


Preference = LeastChange | Smoothness
