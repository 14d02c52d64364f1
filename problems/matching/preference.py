"""Preferences that select one of the beams that fit: the one changed least, or the smoothest.

If there are more unknowns than data, a family of beams has the measured modes.  A preference is a small multiple of a
quadratic form of the factors f(x) on the properties along the beam, x = s/L from 0 to 1, which selects one of them:

    LeastChange    w/2 sum over the properties of c int_0^1 (f - 1)^2 dx
    Smoothness     w/2 sum over the properties of int_0^1 (df/dx)^2 dx.

For n elements the integrals are 1/n sum (f_i - 1)^2 and n sum (f_(i+1) - f_i)^2: each element counts by its fraction of
the length, so that the integrals, and the result, converge with the mesh.  For a ``Global`` property, including the tip
mass and the clamp stiffness, the first integral is (f - 1)^2, the second 0.

The factor c is 1 for properties that change as a whole or smoothly, and 20 for ``PerElement``: a change of one
twentieth of the beam then costs as much as the same change of a global property.  With c = 1, the elements would change
by much more than the modulus or the density, because only their mean along the beam would cost as much as these.

The preference is added to half the sum of the squared residuals, each in units of its standard deviation, or relative
frequency errors if no deviations are given.  The weight w = 1/0.1^2 thus means a prior uncertainty of 10 % of a global
property, or of the mean over a twentieth of the beam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import positive
from ancf_casadi.support.tables import Displayed
from problems.matching.design_space import DesignSpace
from problems.matching.unknowns import PerElement

WEIGHT = 1e-8  # a change of 1 in one factor costs as much as a relative frequency error of 1e-4
PATCHES = 20.0  # c of PerElement: a fraction 1/c of the beam counts as a global property


@dataclass(frozen=True)
class LeastChange(Displayed):
    """Preference for the least change of the beam.

    Parameters
    ----------
    weight : float, optional
        Weight w.  If not given, 1e-8 over the square of the smallest relative standard deviation of a frequency (1 if
        none is given), so small that it only selects among beams that fit.

    Raises
    ------
    InputError
        If the weight is not positive.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import LeastChange, PerElement, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> widths = [PerElement("width")]
    >>> match = match_frequencies(beam, targets=[1.95], unknowns=widths, preference=LeastChange())
    >>> [round(1e3 * width, 2) for width in match.beam.width]
    [5.3, 5.09, 4.91, 4.66]
    """

    weight: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        if self.weight is not None:
            positive(self.weight, "preference: weight")

    def matrix(self, space: DesignSpace, default: float) -> Array:
        """Return the matrix of the quadratic form, (N, N), with the given or else the default weight."""
        weight = default if self.weight is None else self.weight
        matrix = np.zeros((space.size, space.size))
        for unknown in space.unknowns:
            factors = space.map[space.rows_of(unknown.name)]
            count = PATCHES if isinstance(unknown, PerElement) else 1.0
            matrix += weight * count / len(factors) * factors.T @ factors
        return matrix


@dataclass(frozen=True)
class Smoothness(Displayed):
    """Preference for the smoothest beam and, among equally smooth ones, for the least change.

    Parameters
    ----------
    weight : float, optional
        Weight w, as in ``LeastChange``; if not given, 50 times the default of ``LeastChange``.

    Raises
    ------
    InputError
        If the weight is not positive.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import PerElement, Smoothness, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> widths = [PerElement("width")]
    >>> match = match_frequencies(beam, targets=[1.95], unknowns=widths, preference=Smoothness())
    >>> [round(1e3 * width, 2) for width in match.beam.width]
    [5.1, 4.92, 4.69, 4.5]
    """

    weight: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        LeastChange(self.weight)

    def matrix(self, space: DesignSpace, default: float) -> Array:
        """Return the matrix of the quadratic form, (N, N), with the given or else the default weight."""
        steps = np.concatenate([np.diff(space.map[space.rows_of(name)], axis=0) for name in PROPERTIES])
        # default weight of smoothness relative to that of least change
        weight = 50.0 * default if self.weight is None else self.weight
        return np.asarray(weight * space.beam.elements * steps.T @ steps + LeastChange().matrix(space, default))


Preference = LeastChange | Smoothness
