"""Quantities to be estimated, and the coordinates in which the solver works."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import positive


@dataclass(frozen=True)
class Unknown:
    """A quantity to be estimated."""

    name: str  # in the result
    guess: float
    scale: float = 1.0  # typical size of a change; the solver works in units of it
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""  # SI, for reports
    reciprocal: bool = False  # solve for 1/x, in which the data are nearly linear, as in that of a stiffness
    prior: tuple[float, float] | None = None  # mean and standard deviation that are known without the data
    relative_prior: bool = False  # that of a normal logarithm: median, and relative standard deviation
    curved: bool = False  # far from linear, so that intervals of derived quantities follow its likelihood; one in a fit

    def __post_init__(self) -> None:
        """Validate."""
        positive(self.scale, f"{self.name}: scale")
        if not self.lower < self.upper:
            raise InputError(f"the lower bound {self.lower:g} is not below the upper {self.upper:g}", self.name)
        if not (math.isfinite(self.guess) and self.lower <= self.guess <= self.upper):
            raise InputError(f"the guess {self.guess:g} is not within [{self.lower:g}, {self.upper:g}]", self.name)
        if self.reciprocal and not self.lower > 0.0:
            raise InputError(f"the lower bound {self.lower:g} must be positive", self.name)

    @property
    def prior_std(self) -> float:
        """Standard deviation of the prior in the unit of the unknown, to first order; infinite without one."""
        mean, std = self.prior or (1.0, math.inf)
        return std * mean if self.relative_prior else std

    def prior_residual(self, x: cs.MX) -> cs.MX:
        """Return the distance of a value from its prior in standard deviations: (x - m)/s, or log(x/m)/s."""
        mean, std = self.prior or (0.0, math.inf)
        return (cs.log(x / mean) if self.relative_prior else x - mean) / std


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates y of the solver: y = x of an unknown x, or y = 1/x if it is reciprocal."""

    scale: Array  # (n,)
    guess: Array
    lower: Array
    upper: Array
    reciprocal: Mask  # (n,)

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Coordinates:
        """Return the coordinates of unknowns."""
        rows = [
            (1 / u.scale, 1 / u.guess, 1 / u.upper, 1 / u.lower)
            if u.reciprocal
            else (u.scale, u.guess, u.lower, u.upper)
            for u in unknowns
        ]
        scale, guess, lower, upper = np.array(rows).reshape(len(rows), 4).T
        return cls(scale, guess, lower, upper, np.array([u.reciprocal for u in unknowns], dtype=bool))

    def symbols(self, y: Sequence[cs.MX]) -> list[cs.MX]:
        """Return the unknowns as expressions of the coordinates."""
        return [1 / one if inverse else one for one, inverse in zip(y, self.reciprocal.tolist(), strict=True)]

    def unknowns(self, y: Array) -> Array:
        """Return the unknowns (n,) at values of the coordinates (n,)."""
        with np.errstate(divide="ignore"):
            return np.where(self.reciprocal, 1 / np.where(self.reciprocal, y, 1.0), y)

    def slopes(self, y: Array) -> Array:
        """Return the derivatives (n,) of the unknowns by the coordinates."""
        return np.where(self.reciprocal, -(self.unknowns(y) ** 2), 1.0)


def started(unknowns: Sequence[Unknown], values: Mapping[str, float]) -> list[Unknown]:
    """Return the unknowns with other guesses by name, each moved to its nearest bound if it is not within them."""
    return [replace(u, guess=min(max(values.get(u.name, u.guess), u.lower), u.upper)) for u in unknowns]
