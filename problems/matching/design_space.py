"""The unknowns of a matching as one vector m, their bounds, and the properties and the beam that follow from m.

The factors on all properties are f = 1 + T (m - m_0), with m_0 at the given beam.  If the unknowns are factors, they
are bounded directly.  If they are the coefficients of a smooth property, the bounds apply to the factors of its
elements, which are linear in m: the rows of T for this property are linear constraints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ancf_casadi.estimation.solver.least_squares import AT_BOUND
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES, Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, is_sequence, numbers, shown
from ancf_casadi.vibration.assembly import structure_properties
from problems.matching.unknowns import PAPER_UNKNOWNS, Global, PerElement, PropertyUnknown, Smooth, check_bounds

SMALLEST_FACTOR = 1e-7  # factor: a property never vanishes


@dataclass(frozen=True)
class DesignSpace:
    """The N unknowns m of a beam, and the properties that follow from them.

    Parameters
    ----------
    beam : Beam
        The given beam.
    unknowns : tuple of Global, PerElement, Smooth
        Properties that may change.
    bounds : float
        Largest relative change of a property whose unknown states no bounds.

    Raises
    ------
    InputError
        If there is no unknown, a property has two, the beam has no tip mass or clamp stiffness to change, or bounds or
        terms are out of range.
    """

    beam: Beam
    unknowns: tuple[PropertyUnknown, ...] = PAPER_UNKNOWNS
    bounds: float = 0.10

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
        given = [unknown.name for unknown in self.unknowns]
        if not given:
            raise InputError("nothing may change; give at least one property", "unknowns")
        for name in given:
            if given.count(name) > 1:
                raise InputError(f"{name} is given {given.count(name)} times; give it once", "unknowns")
            if name in LUMPED and getattr(self.beam, name) in (0.0, math.inf):
                raise InputError(f"the beam has no {name} to change; give the beam a first value of it", "unknowns")
        _ = self.map

    @property
    def size(self) -> int:
        """Number of unknowns N."""
        return len(self.names)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(name for unknown in self.unknowns for name in unknown.names(self.beam.elements))

    def rows_of(self, name: str) -> slice:
        """Return the rows of a property among all properties, in the order of ``structure_properties``."""
        n = self.beam.elements
        if name in LUMPED:
            row = n * len(PROPERTIES) + LUMPED.index(name)
            return slice(row, row + 1)
        return slice(n * PROPERTIES.index(name), n * (PROPERTIES.index(name) + 1))

    @cached_property
    def map(self) -> Array:
        """Matrix T from unknowns to factors on all properties, (4 n + 2, N)."""
        n = self.beam.elements
        columns = []
        for unknown in self.unknowns:
            shape = unknown.shape(n)
            column = np.zeros((n * len(PROPERTIES) + len(LUMPED), shape.shape[1]))
            column[self.rows_of(unknown.name)] = shape
            columns.append(column)
        return np.concatenate(columns, axis=1)

    @cached_property
    def standard(self) -> Array:
        """Values m_0 of the unknowns at the given beam, (N,)."""
        return self._repeated(lambda smooth, _: 0.0 if smooth else 1.0)

    @cached_property
    def lower(self) -> Array:
        """Lower bounds of the unknowns, (N,)."""
        return self._repeated(lambda smooth, bounds: -math.inf if smooth else max(1 - bounds, SMALLEST_FACTOR))

    @cached_property
    def upper(self) -> Array:
        """Upper bounds of the unknowns, (N,)."""
        return self._repeated(lambda smooth, bounds: math.inf if smooth else 1 + bounds)

    @cached_property
    def rows(self) -> Array:
        """Rows of T for the smooth properties: times m, they are the changes of the factors, (r, N)."""
        blocks = [self.map[self.rows_of(name)] for name in self._smooth]
        return np.concatenate(blocks) if blocks else np.zeros((0, self.size))

    @cached_property
    def row_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the changes ``rows @ m``, (r,) each."""
        widths = [bounds for _, smooth, bounds in self._blocks if smooth]
        width = np.repeat(widths, self.beam.elements)
        return np.maximum(-width, SMALLEST_FACTOR - 1), width

    @cached_property
    def bounded_names(self) -> tuple[str, ...]:
        """Names of all bounded quantities, (N + r): the unknowns, then the factors of the smooth properties."""
        return self.names + tuple(f"{name}[{i + 1}]" for name in self._smooth for i in range(self.beam.elements))

    def room(self, m: Array) -> tuple[Array, Array]:
        """Return the changes that lead to the lower and to the upper bounds, by ``bounded_names``, (N + r,) each."""
        values, (below, above) = np.concatenate([m, self.rows @ m]), self.row_bounds
        return np.concatenate([self.lower, below]) - values, np.concatenate([self.upper, above]) - values

    @cached_property
    def given(self) -> Array:
        """Properties of the given beam, (4 n + 2,)."""
        return structure_properties(Model(self.beam))

    @cached_property
    def directions(self) -> Array:
        """Derivatives of the properties by the unknowns, (4 n + 2, N)."""
        return self.given[:, None] * self.map

    def factors(self, m: Array) -> Array:
        """Return the factors on the properties, (4 n + 2,)."""
        return np.asarray(1 + self.map @ (m - self.standard))

    def properties(self, m: Array) -> Array:
        """Return the properties, (4 n + 2,)."""
        return np.asarray(self.factors(m) * self.given)

    def changed(self, m: Array) -> Beam:
        """Return the beam with these properties."""
        values = self.properties(m)
        changes: dict[str, Any] = {name: tuple(values[self.rows_of(name)].tolist()) for name in PROPERTIES}
        changes |= {
            unknown.name: float(values[self.rows_of(unknown.name)][0])
            for unknown in self.unknowns
            if unknown.name in LUMPED
        }
        return self.beam.with_(**changes)

    def at_bound(self, m: Array) -> tuple[str, ...]:
        """Return the names of the unknowns, and of the elements of smooth properties, that are at a bound."""
        below, above = self.room(m)
        with np.errstate(invalid="ignore"):
            active = np.minimum(-below, above) < AT_BOUND * (above - below) / 2
        active &= np.isfinite(below)
        return tuple(name for name, there in zip(self.bounded_names, active, strict=True) if there)

    def check_guess(self, guess: Sequence[float] | None) -> Array:
        """Return the first values of the unknowns as an array; those of the given beam if none are given.

        Raises
        ------
        InputError
            If there are more or fewer values than unknowns, or one is outside its bounds.
        """
        if guess is None:
            return self.standard.copy()
        m = np.array(numbers(guess, "guess"))
        if m.size != self.size:
            raise InputError(f"needs {self.size} values, one per unknown, got {m.size}", "guess")
        below, above = self.room(m)
        excess = np.maximum(below, -above)
        if (excess[: self.size] > 0.0).any():
            k = int(np.flatnonzero(excess[: self.size] > 0.0)[0])
            raise InputError(
                f"the factors must be between {self.lower[k]:g} and {self.upper[k]:g}, got {m[k]:g} for "
                f"{self.names[k]}",
                "guess",
            )
        if (excess > 0.0).any():
            k = int(excess.argmax())
            change, most = (self.rows @ m)[k - self.size], self.row_bounds[1][k - self.size]
            raise InputError(
                f"changes {self.bounded_names[k]} by {100 * change:.3g} %, beyond {100 * most:g} %", "guess"
            )
        return m

    def random(self, generator: np.random.Generator) -> Array:
        """Return random values within the bounds: uniform factors, and smooth changes of uniformly distributed size."""
        m = self.standard.copy()
        for block, smooth, bounds in self._blocks:
            if not smooth:
                m[block] = generator.uniform(self.lower[block], self.upper[block])
                continue
            direction = generator.standard_normal(block.stop - block.start)
            largest = np.abs(self.map[:, block] @ direction).max()
            m[block] = direction * (min(bounds, 1 - SMALLEST_FACTOR) * generator.uniform() / largest)
        return m

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, bool, float], ...]:
        """Slice of m for each property, whether the property is smooth, and its bounds."""
        sizes = [len(unknown.names(self.beam.elements)) for unknown in self.unknowns]
        ends = np.cumsum([0, *sizes]).tolist()
        return tuple(
            (
                slice(begin, end),
                isinstance(unknown, Smooth),
                self.bounds if (own := unknown.relative_bounds) is None else own,
            )
            for unknown, begin, end in zip(self.unknowns, ends[:-1], ends[1:], strict=True)
        )

    def _repeated(self, value: Callable[[bool, float], float]) -> Array:
        """Return ``value(smooth, bounds)`` of each property, repeated for each of its unknowns, (N,)."""
        values = [value(smooth, bounds) for _, smooth, bounds in self._blocks]
        return np.repeat(values, [block.stop - block.start for block, _, _ in self._blocks])

    @property
    def _smooth(self) -> list[str]:
        return [unknown.name for unknown in self.unknowns if isinstance(unknown, Smooth)]
