"""Quantities to be estimated, and the coordinates in which the solver works.

The coordinate of an unknown x is y = x, or for a stiffness

    y = 1/(x + s),

in which the data are nearly linear, with the stiffness s of what deforms beside it: 0 for that of a beam.  For a clamp
of stiffness x at the end of a beam, s = 3 E I/L makes x y the fixity factor of semi-rigid joints, from 0 for a hinge to
1 for a rigid clamp.

References
----------
G. R. Monforton, T. S. Wu, Matrix analysis of semi-rigidly connected frames, Journal of the Structural Division, ASCE 89
(1963), for the fixity factor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import choice, is_sequence, positive, two_numbers

Symbol = TypeVar("Symbol", cs.MX, cs.SX)
Priors = Mapping[str, tuple[float, float] | tuple[float, float, str]]
LOG_NORMAL = "log-normal"  # third entry of a prior of the logarithm


@dataclass(frozen=True)
class Reported:
    """The quantity that reports print in place of an unknown, which is proportional to it."""

    symbol: str  # of the unknown; what follows it in the name, such as the number of a record, stays
    quantity: str
    unit: str
    factor: float = 1.0  # quantity over unknown


@dataclass(frozen=True)
class Unknown:
    """A quantity to be estimated."""

    name: str  # in the result
    guess: float
    scale: float = 1.0  # typical size of a change; the solver works in units of it
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""  # SI, for reports
    offset: float | None = None  # of a stiffness: s of the coordinate 1/(x + s), see above
    prior: tuple[float, float] | None = None  # mean and standard deviation that are known without the data
    relative_prior: bool = False  # that of a normal logarithm: median, and relative standard deviation
    reported: Reported | None = None  # if reports print another quantity
    curved: bool = False  # far from linear, so that intervals of derived quantities follow its likelihood; one in a fit

    def __post_init__(self) -> None:
        """Validate."""
        positive(self.scale, f"{self.name}: scale")
        if not self.lower < self.upper:
            raise InputError(f"the lower bound {self.lower:g} is not below the upper {self.upper:g}", self.name)
        if not (math.isfinite(self.guess) and self.lower <= self.guess <= self.upper):
            raise InputError(f"the guess {self.guess:g} is not within [{self.lower:g}, {self.upper:g}]", self.name)
        if self.offset is not None and not self.lower + self.offset > 0.0:
            raise InputError(f"the lower bound {self.lower:g} must be above {-self.offset:g}", self.name)

    @property
    def report(self) -> tuple[str, str, float]:
        """Name and unit in reports, and the ratio of the value there to that of the unknown."""
        if self.reported is None:
            return self.name, self.unit, 1.0
        return (
            self.reported.quantity + self.name.removeprefix(self.reported.symbol),
            self.reported.unit,
            self.reported.factor,
        )

    @property
    def prior_std(self) -> float:
        """Standard deviation of the prior in the unit of the unknown, to first order; infinite without one."""
        mean, std = self.prior or (1.0, math.inf)
        return std * mean if self.relative_prior else std

    def data_share(self, error: float) -> float:
        """Return the share that the data determine, 1 - (standard error/std of the prior)^2, nan for no error."""
        return float(np.maximum(1 - (error / self.prior_std) ** 2, 0.0))

    def with_mean(self, value: float, distance: float) -> tuple[float, float] | tuple[float, float, str]:
        """Return the prior, as users give it, with its mean some standard deviations above a value."""
        std = self.prior[1] if self.prior else math.inf
        return (
            (value * math.exp(std * distance), std, LOG_NORMAL)
            if self.relative_prior
            else (value + std * distance, std)
        )

    def prior_residual(self, x: Symbol) -> Symbol:
        """Return the distance of a value from its prior in standard deviations: (x - m)/s, or log(x/m)/s."""
        mean, std = self.prior or (0.0, math.inf)
        return (cs.log(x / mean) if self.relative_prior else x - mean) / std


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates y of the solver: y = x of an unknown x, or y = 1/(x + s) if it is reciprocal."""

    scale: Array  # (n,)
    guess: Array
    lower: Array
    upper: Array
    reciprocal: Mask  # (n,)
    offset: Array  # s (n,), 0 of those that are not reciprocal

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Coordinates:
        """Return the coordinates of unknowns."""
        rows = [
            (u.scale, u.guess, u.lower, u.upper)
            if u.offset is None
            else tuple(1 / (x + u.offset) for x in (u.scale, u.guess, u.upper, u.lower))
            for u in unknowns
        ]
        scale, guess, lower, upper = np.array(rows).reshape(len(rows), 4).T
        reciprocal = np.array([u.offset is not None for u in unknowns], dtype=bool)
        return cls(scale, guess, lower, upper, reciprocal, np.array([u.offset or 0.0 for u in unknowns]))

    @property
    def scaled_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (n,) in units of the scales."""
        return self.lower / self.scale, self.upper / self.scale

    def symbols(self, y: Sequence[cs.MX]) -> list[cs.MX]:
        """Return the unknowns as expressions of the coordinates."""
        kinds = zip(y, self.reciprocal.tolist(), self.offset.tolist(), strict=True)
        return [1 / coordinate - s if inverse else coordinate for coordinate, inverse, s in kinds]

    def unknowns(self, y: Array) -> Array:
        """Return the unknowns (n,) at values of the coordinates (n,)."""
        with np.errstate(divide="ignore"):
            return np.where(self.reciprocal, 1 / np.where(self.reciprocal, y, 1.0) - self.offset, y)

    def at(self, x: Array) -> Array:
        """Return the coordinates (n,) of values of the unknowns (n,)."""
        with np.errstate(divide="ignore"):
            return np.where(self.reciprocal, 1 / np.where(self.reciprocal, x + self.offset, 1.0), x)

    def slopes(self, y: Array) -> Array:
        """Return the derivatives (n,) of the unknowns by the coordinates."""
        return np.where(self.reciprocal, -((self.unknowns(y) + self.offset) ** 2), 1.0)

    def relative_slopes(self, y: Array) -> Array:
        """Return the derivatives (n,) of the coordinates by the logarithms of the unknowns."""
        return np.where(self.reciprocal, -y * (1.0 - self.offset * y), y)


def with_guesses(unknowns: Sequence[Unknown], values: Mapping[str, float]) -> list[Unknown]:
    """Return the unknowns with other guesses by name, each moved to its nearest bound if it is not within them."""
    return [replace(u, guess=min(max(values.get(u.name, u.guess), u.lower), u.upper)) for u in unknowns]


def with_prior(unknown: Unknown, prior: Any) -> Unknown:
    """Return an unknown with a prior: mean and standard deviation, or median, relative one and "log-normal"."""
    where, names = f"priors: {unknown.name}", "(mean, standard deviation)"
    if not (is_sequence(prior) and len(prior) == 3):
        mean, std = two_numbers(prior, where, f'{names}, or (median, relative standard deviation, "{LOG_NORMAL}")')
        return replace(unknown, prior=(mean, positive(std, where)))
    choice(prior[2], [LOG_NORMAL], where)
    mean, std = (positive(value, where) for value in prior[:2])
    if unknown.lower < 0.0:
        raise InputError(f"may be negative, and a {LOG_NORMAL} quantity may not; give it a lower bound of 0", where)
    return replace(unknown, prior=(mean, std), relative_prior=True)


def share_lines(shares: Mapping[str, float]) -> list[str]:
    """Return how far data and priors determine unknowns, by name, as text."""
    return [
        f"{name}: the data determine {share:.0%}, the prior {1 - share:.0%}"
        for name, share in shares.items()
        if math.isfinite(share)
    ]
