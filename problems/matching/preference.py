"""Which of the beams that fit is the answer: the one changed least, or the smoothest.

With more unknowns than data a family of beams has the measured modes.  A preference, a small multiple of a quadratic
form of the factors f(x) on the properties along the beam, x = s/L from 0 to 1, picks one:

    LeastChange    w/2 sum over the properties of c int_0^1 (f - 1)^2 dx
    Smoothness     w/2 sum over the properties of int_0^1 (df/dx)^2 dx.

For n elements the integrals are 1/n sum (f_i - 1)^2 and n sum (f_(i+1) - f_i)^2: each element counts by its share of
the length, so that they, and the answer, converge with the mesh.  For a ``Global`` property, the tip mass and the clamp
stiffness the first is (f - 1)^2.

The count c is 1 for properties that change as a whole or smoothly, and 20 for ``PerElement``: there a change in one
twentieth of the beam costs as much as that of a global property.  With c = 1 everywhere, elements would be changed by
much more than the modulus or the density, as only the mean along the beam would be known as well as these.

The weight w stands against half the sum of the squared residuals, each in units of its standard deviation, or relative
frequency errors where none are given.  An uncertainty of 10 % known beforehand, of a global property or of the mean
over a twentieth of the beam, is w = 1/0.1^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import positive
from problems.matching.design_space import DesignSpace
from problems.matching.unknowns import PerElement

WEIGHT = 1e-8  # what a relative frequency error of 1e-4 costs, a change of 1 in one factor costs too
PATCHES = 20.0  # c of a property that may change in each element: 1/c of the beam counts as a global property
SMOOTH = 50.0  # usual weight of smoothness against that of least change


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

    def matrix(self, space: DesignSpace, usual: float) -> Array:
        """Return the matrix of the quadratic form, weight included, (N, N)."""
        weight = usual if self.weight is None else self.weight
        matrix = np.zeros((space.size, space.size))
        for unknown in space.unknowns:
            factors = space.map[space.rows_of(unknown.name)]
            count = PATCHES if isinstance(unknown, PerElement) else 1.0
            matrix += weight * count / len(factors) * factors.T @ factors
        return matrix


@dataclass(frozen=True)
class Smoothness:
    """The smoothest beam; among equally smooth ones the one changed least.

    Parameters
    ----------
    weight : float, optional
        Weight w, as in ``LeastChange``; if not given, 50 times the usual one of least change.

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

    def matrix(self, space: DesignSpace, usual: float) -> Array:
        """Return the matrix of the quadratic form, weight included, (N, N)."""
        elements = space.beam.elements
        steps = np.concatenate([np.diff(space.map[space.rows_of(name)], axis=0) for name in PROPERTIES])
        weight = SMOOTH * usual if self.weight is None else self.weight
        return np.asarray(weight * elements * steps.T @ steps + LeastChange().matrix(space, usual))


Preference = LeastChange | Smoothness
