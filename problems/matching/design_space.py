"""The unknowns of a matching as one vector m: the factors, their bounds, the beam, and the preference among beams.

If there are more unknowns than data, a family of beams has the measured modes.  A preference is a small multiple of a
quadratic form of the factors f(x) on the properties along the beam, x = s/L from 0 to 1, which selects one of them:

    LeastChange    w/2 sum over the properties of c int_0^1 (f - 1)^2 dx
    Smoothness     w/2 sum over the properties of int_0^1 (df/dx)^2 dx.

For n elements the integrals are 1/n sum (f_i - 1)^2 and n sum (f_(i+1) - f_i)^2: each element counts by its fraction of
the length, so that the integrals, and the result, converge with the mesh.  For a ``Global`` property, including the
lumped ones, the first integral is (f - 1)^2, the second 0.

The factor c is 1 for properties that change as a whole or smoothly, and 20 for ``PerElement``: a change of one
twentieth of the beam then costs as much as the same change of a global property.  With c = 1, the elements would change
by much more than the modulus or the density, because only their mean along the beam would cost as much as these.

The preference is added to half the sum of the squared residuals, each in units of its standard deviation, or relative
frequency errors if no deviations are given.  The weight w = 1/0.1^2 thus means a prior uncertainty of 10 % of a global
property, or of the mean over a twentieth of the beam.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.solver.least_squares import AT_BOUND
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import lumped_kind
from ancf_casadi.mechanics.model import (
    Model,
    lumped_value,
    model_with_properties,
    owners_of_rows,
    property_rows,
)
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import check_instance, is_sequence, numbers, positive, shown
from ancf_casadi.support.tables import Displayed
from ancf_casadi.vibration.assembly import structure_properties
from problems.matching.unknowns import PAPER_UNKNOWNS, Global, PerElement, PropertyUnknown, Smooth, check_bounds

SMALLEST_FACTOR = 1e-7  # least factor, so that no property vanishes
WEIGHT = 1e-8  # a change of 1 in one factor costs as much as a relative frequency error of 1e-4
GUESS_ROUNDING = 1e-12  # excess of a guess over its bound that is rounding
SMOOTHNESS = 50.0  # default weight of smoothness relative to that of least change
PATCHES = 20.0  # c of PerElement: a fraction 1/c of the beam counts as a global property


@dataclass(frozen=True)
class DesignSpace:
    """The N unknowns m of a beam, the F factors that they determine, one per global property or element, and bounds."""

    beam: Beam  # the given beam
    unknowns: tuple[PropertyUnknown, ...] = PAPER_UNKNOWNS
    bounds: float = 0.10  # largest relative change of a property whose unknown states no bounds

    def __post_init__(self) -> None:
        """Validate."""
        object.__setattr__(self, "bounds", check_bounds(self.bounds, "bounds"))
        if not is_sequence(self.unknowns):
            raise InputError(
                f"must be a sequence of Global, PerElement and Smooth, got {shown(self.unknowns)}", "unknowns"
            )
        object.__setattr__(self, "unknowns", tuple(self.unknowns))
        for unknown in self.unknowns:
            check_instance(unknown, "unknowns", Global, PerElement, Smooth)
        if not self.unknowns:
            raise InputError("nothing may change; give at least one property", "unknowns")
        names = [unknown.name for unknown in self.unknowns]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"{name} is given {names.count(name)} times; give it once", "unknowns")
            if lumped_kind(name) and not lumped_value(self.beam, name):
                raise InputError(f"the beam has no {name} to change; give the beam a first value of it", "unknowns")
        owners_of_rows(self.beam, names, [slice(None)] * len(names))  # for its checks
        _ = self.shapes  # which are checked

    @cached_property
    def shapes(self) -> list[Array]:
        """T of each property."""
        return [unknown.shape(self.beam.elements) for unknown in self.unknowns]

    def _repeat(self, values: Sequence[float], axis: int) -> Array:
        """Return a value of each property for each of its factors (axis 0) or unknowns (axis 1)."""
        return np.repeat(values, [shape.shape[axis] for shape in self.shapes])

    @property
    def size(self) -> int:
        """Number of unknowns N."""
        return len(self.standard)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns: those of their factors, and of smooth properties the degree of the polynomial."""
        names = list[str]()
        for unknown in self.unknowns:
            terms = range(unknown.terms) if isinstance(unknown, Smooth) else ()
            names += [f"{unknown.name}~L{j}" for j in terms] or self._factor_labels(unknown)
        return tuple(names)

    @cached_property
    def factor_names(self) -> tuple[str, ...]:
        """Names of the factors, those of elements with their number from 1."""
        return tuple(name for unknown in self.unknowns for name in self._factor_labels(unknown))

    def _factor_labels(self, unknown: PropertyUnknown) -> list[str]:
        elements = range(1, self.beam.elements + 1)
        return [unknown.name] if isinstance(unknown, Global) else [f"{unknown.name}[{i}]" for i in elements]

    @cached_property
    def map(self) -> Array:
        """Matrix T from unknowns to factors, (F, N)."""
        return np.asarray(scipy.linalg.block_diag(*self.shapes))

    @cached_property
    def standard(self) -> Array:
        """Values m_0 of the unknowns at the given beam, (N,)."""
        return self._repeat([0.0 if isinstance(unknown, Smooth) else 1.0 for unknown in self.unknowns], 1)

    @cached_property
    def single(self) -> Mask:
        """True for the factors that are unknowns themselves, false for those of smooth properties, (F,)."""
        return self._repeat([not isinstance(unknown, Smooth) for unknown in self.unknowns], 0) > 0

    @property
    def _limits(self) -> list[tuple[float, float]]:
        """Least and largest change of the factors of each property."""
        widths = [self.bounds if u.relative_bounds is None else u.relative_bounds for u in self.unknowns]
        return [(max(-width, SMALLEST_FACTOR - 1), width) for width in widths]

    @cached_property
    def given_properties(self) -> Array:
        """Properties of the given beam, (4 n + lumped,)."""
        return structure_properties(Model(self.beam))

    @cached_property
    def given_values(self) -> Array:
        """Values in the given beam of the properties with a factor, (F,); the mean of those that change as a whole."""
        values: list[Array] = [
            self.given_properties[property_rows(self.beam, unknown.name)]
            if lumped_kind(unknown.name)
            else np.array(getattr(self.beam, unknown.name))
            for unknown in self.unknowns
        ]
        pairs = zip(self.unknowns, values, strict=True)
        return np.concatenate([[p.mean()] if isinstance(unknown, Global) else p for unknown, p in pairs])

    def by_property(self, values: Array) -> dict[str, Array]:
        """Return values (F, ...) of the factors by the name of their property."""
        blocks = np.split(values, np.cumsum([len(shape) for shape in self.shapes])[:-1])
        return {unknown.name: block for unknown, block in zip(self.unknowns, blocks, strict=True)}

    @cached_property
    def directions(self) -> Array:
        """Derivatives of the properties by the unknowns, (4 n + lumped, N)."""
        directions, columns = np.zeros((len(self.given_properties), self.size)), iter(range(self.size))
        for unknown, shape in zip(self.unknowns, self.shapes, strict=True):
            rows = property_rows(self.beam, unknown.name)
            for column in shape.T:
                directions[rows, next(columns)] = np.resize(column, rows.size)
        return self.given_properties[:, None] * directions

    def changes(self, m: Array) -> Array:
        """Return the relative changes of the factors, (F,)."""
        return np.asarray(self.map @ (m - self.standard))

    def properties(self, m: Array) -> Array:
        """Return the properties, (4 n + lumped,)."""
        return np.asarray(self.given_properties + self.directions @ (m - self.standard))

    def changed_beam(self, m: Array) -> Beam:
        """Return the beam with these properties."""
        return model_with_properties(Model(self.beam), self.properties(m)).beam

    def room(self, m: Array) -> tuple[Array, Array]:
        """Return the changes of the factors that lead to the lower and to the upper bounds, (F,) each."""
        lower, upper = (self._repeat(side, 0) for side in zip(*self._limits, strict=True))
        return lower - self.changes(m), upper - self.changes(m)

    def from_factors(self, values: Array, otherwise: float) -> Array:
        """Return values (F,) of the factors by unknown, (N,), with a default for unknowns that are no factors."""
        unknown_values = np.full(self.size, otherwise)
        unknown_values[self.map[self.single].argmax(axis=1)] = values[self.single]
        return unknown_values

    def at_bound(self, m: Array) -> tuple[str, ...]:
        """Return the names of the factors that are at a bound."""
        below, above = self.room(m)
        active = np.minimum(-below, above) < AT_BOUND * (above - below) / 2
        return tuple(np.array(self.factor_names)[active].tolist())

    def check_guess(self, guess: Sequence[float] | None) -> Array:
        """Return the first values of the unknowns, (N,), within bounds; those of the given beam if none are given."""
        if guess is None:
            return self.standard.copy()
        m = np.array(numbers(guess, "guess"))
        if m.size != self.size:
            raise InputError(f"needs {self.size} values, one per unknown, got {m.size}", "guess")
        below, above = self.room(m)
        excess = np.maximum(below, -above)
        if excess.max() > GUESS_ROUNDING:
            k = int(excess.argmax())
            low, value, high = (1 + self.changes(m)[k] + room for room in (below[k], 0.0, above[k]))
            raise InputError(
                f"the factors must be between {low:g} and {high:g}, got {value:g} for {self.factor_names[k]}", "guess"
            )
        return m

    def random(self, generator: np.random.Generator) -> Array:
        """Return random values within the bounds: uniform factors, and smooth changes of uniformly distributed size."""
        values = []
        for unknown, shape, (lower, upper) in zip(self.unknowns, self.shapes, self._limits, strict=True):
            if isinstance(unknown, Smooth):
                direction = generator.standard_normal(shape.shape[1])
                values.append(direction * (-lower * generator.uniform() / np.abs(shape @ direction).max()))
            else:
                values.append(1 + generator.uniform(lower, upper, len(shape)))
        return np.concatenate(values)


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

    def matrix(self, space: DesignSpace, default: float = math.nan) -> Array:
        """Return the matrix of the quadratic form, (N, N), with the given or else the default weight."""
        weight = default if self.weight is None else self.weight
        patches = [PATCHES if isinstance(unknown, PerElement) else 1.0 for unknown in space.unknowns]
        factors = [count / len(shape) * shape.T @ shape for count, shape in zip(patches, space.shapes, strict=True)]
        return np.asarray(weight * scipy.linalg.block_diag(*factors))


@dataclass(frozen=True)
class Smoothness(LeastChange):
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

    def matrix(self, space: DesignSpace, default: float = math.nan) -> Array:
        """Return the matrix of the quadratic form, (N, N), with the given or else the default weight."""
        steps = scipy.linalg.block_diag(*(np.diff(shape, axis=0) for shape in space.shapes))
        weight = SMOOTHNESS * default if self.weight is None else self.weight
        return np.asarray(weight * space.beam.elements * steps.T @ steps + LeastChange().matrix(space, default))
