"""The unknowns of a matching as one vector m: their bounds, and the properties and the beam that they stand for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES, Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, is_sequence, numbers, shown
from ancf_casadi.vibration.assembly import structure_properties
from problems.matching.unknowns import PAPER, Global, PerElement, PropertyUnknown, Smooth, check_bounds

SMALLEST = 1e-7  # factor: a property never vanishes
AT_BOUND = 1e-6  # of the width of the bounds


@dataclass(frozen=True)
class DesignSpace:
    """The unknowns m of a beam, N of them, and the properties they stand for.

    Parameters
    ----------
    beam : Beam
        The given beam.
    unknowns : tuple of Global, PerElement, Smooth
        What may change.
    bounds : float
        Largest relative change where an unknown states none.

    Raises
    ------
    InputError
        If there is no unknown, a property has two, the beam has no tip mass or no clamp stiffness to change, or bounds
        or terms are not usable.
    """

    beam: Beam
    unknowns: tuple[PropertyUnknown, ...] = PAPER
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
                raise InputError(f"{name} is given {given.count(name)} times", "unknowns")
            if name in LUMPED and getattr(self.beam, name) in (0.0, math.inf):
                raise InputError(f"the beam has no {name} to change; give it one that you expect", "unknowns")
        _ = self.map

    @property
    def size(self) -> int:
        """How many unknowns, N."""
        return len(self.names)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What they are called."""
        return tuple(name for unknown in self.unknowns for name in unknown.names(self.beam.elements))

    def rows_of(self, name: str) -> slice:
        """Return where a property is among all of them, in the order of ``structure_properties``."""
        n = self.beam.elements
        if name in LUMPED:
            row = n * len(PROPERTIES) + LUMPED.index(name)
            return slice(row, row + 1)
        return slice(n * PROPERTIES.index(name), n * (PROPERTIES.index(name) + 1))

    @cached_property
    def map(self) -> Array:
        """T, from unknowns to factors of all properties, those of the elements row by row, (4 n + 2, N)."""
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
        """Values of the unknowns at the given beam, (N,)."""
        return np.concatenate(
            [np.full(block.stop - block.start, float(not smooth)) for block, smooth, _ in self._blocks]
        )

    @cached_property
    def lower(self) -> Array:
        """Lower bounds of the unknowns, (N,)."""
        return np.concatenate([
            np.full(block.stop - block.start, -math.inf if smooth else max(1 - bounds, SMALLEST))
            for block, smooth, bounds in self._blocks
        ])  # fmt: skip

    @cached_property
    def upper(self) -> Array:
        """Upper bounds of the unknowns, (N,)."""
        return np.concatenate([
            np.full(block.stop - block.start, math.inf if smooth else 1 + bounds)
            for block, smooth, bounds in self._blocks
        ])  # fmt: skip

    @cached_property
    def rows(self) -> Array:
        """Changes of the factors of the smooth properties by the unknowns, (r, N)."""
        n = self.beam.elements
        rows = [self.map[n * k : n * (k + 1)] for k in self._smooth]
        return np.concatenate(rows) if rows else np.zeros((0, self.size))

    @cached_property
    def row_bounds(self) -> tuple[Array, Array]:
        """Bounds of these changes, two of (r,)."""
        widths = [
            np.full(self.beam.elements, bounds)
            for (_, smooth, bounds) in self._blocks
            if smooth
        ]  # fmt: skip
        room = np.concatenate(widths) if widths else np.zeros(0)
        return np.maximum(-room, SMALLEST - 1), room

    @property
    def row_names(self) -> tuple[str, ...]:
        """What these factors are called."""
        return tuple(f"{PROPERTIES[k]}[{i + 1}]" for k in self._smooth for i in range(self.beam.elements))

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
        """Return the beam that the unknowns stand for."""
        values = self.properties(m)
        changes: dict[str, Any] = {name: tuple(values[self.rows_of(name)].tolist()) for name in PROPERTIES}
        changes |= {
            unknown.name: float(values[self.rows_of(unknown.name)][0])
            for unknown in self.unknowns
            if unknown.name in LUMPED
        }
        return self.beam.with_(**changes)

    def active_bounds(self, m: Array) -> tuple[str, ...]:
        """Return the unknowns, and the elements of smooth properties, that are at a bound."""
        values = np.concatenate([m, self.rows @ m])
        lower, upper = (np.concatenate(pair) for pair in zip((self.lower, self.upper), self.row_bounds, strict=True))
        with np.errstate(invalid="ignore"):
            there = np.minimum(values - lower, upper - values) < AT_BOUND * (upper - lower) / 2
        there &= np.isfinite(lower)
        return tuple(name for name, is_there in zip(self.names + self.row_names, there, strict=True) if is_there)

    def check_start(self, start: Sequence[float] | None) -> Array:
        """Return values to start from as an array; those of the given beam if there are none.

        Raises
        ------
        InputError
            If they are not as many as the unknowns, or not within the bounds.
        """
        if start is None:
            return self.standard.copy()
        m = np.array(numbers(start, "start"))
        if m.size != self.size:
            raise InputError(f"needs {self.size} factors, got {m.size}", "start")
        inside = (m >= self.lower) & (m <= self.upper)
        low, high = self.row_bounds
        changes = self.rows @ m
        if not inside.all():
            k = int(np.flatnonzero(~inside)[0])
            raise InputError(
                f"the factors must be above 0 and within {self.lower[k]:g} to {self.upper[k]:g}, got {m[k]:g} for "
                f"{self.names[k]}",
                "start",
            )
        if (changes < low).any() or (changes > high).any():
            k = int(np.argmax(np.maximum(low - changes, changes - high)))
            raise InputError(
                f"changes {self.row_names[k]} by {100 * changes[k]:.3g} %, beyond {100 * high[k]:g} %", "start"
            )
        return m

    def random(self, generator: np.random.Generator) -> Array:
        """Return a point within the bounds: uniform in them, and within a smooth property's as far in a random way."""
        m = self.standard.copy()
        for block, smooth, bounds in self._blocks:
            size = block.stop - block.start
            if not smooth:
                m[block] = generator.uniform(self.lower[block], self.upper[block])
                continue
            way = generator.standard_normal(size)
            largest = np.abs(self.map[:, block] @ way).max()
            m[block] = way * (min(bounds, 1 - SMALLEST) * generator.uniform() / largest)
        return m

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, bool, float], ...]:
        """Where the values of each unknown are, whether it is smooth, and its bounds."""
        sizes = [len(unknown.names(self.beam.elements)) for unknown in self.unknowns]
        ends = np.cumsum([0, *sizes]).tolist()
        return tuple(
            (slice(begin, end), isinstance(unknown, Smooth), self.bounds if unknown.bounds is None else unknown.bounds)
            for unknown, begin, end in zip(self.unknowns, ends[:-1], ends[1:], strict=True)
        )

    @property
    def _smooth(self) -> list[int]:
        return [PROPERTIES.index(unknown.name) for unknown in self.unknowns if isinstance(unknown, Smooth)]
