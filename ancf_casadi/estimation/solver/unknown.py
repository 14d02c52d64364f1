"""A quantity to be estimated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import positive


@dataclass(frozen=True)
class Unknown:
    """A quantity to be estimated.

    Parameters
    ----------
    name : str
        Name in the result.
    guess : float
        Starting value.
    scale : float
        Typical size of a change of the unknown; the solver works in units of it.
    lower, upper : float
        Bounds.
    unit : str
        SI unit, for reports.
    reciprocal : bool
        Whether the solver works with scale/x instead of x/scale: for a positive unknown such as a stiffness, in whose
        reciprocal the data are nearly linear.
    prior : (float, float), optional
        Mean and standard deviation that are known without the data.

    Raises
    ------
    InputError
        If the scale is not positive, the bounds are not in order, the guess is not finite and between them, or the
        lower bound of a reciprocal unknown is not positive.
    """

    name: str
    guess: float
    scale: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    unit: str = ""
    reciprocal: bool = False
    prior: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Validate."""
        positive(self.scale, f"{self.name}: scale")
        if not self.lower < self.upper:
            raise InputError(f"the lower bound {self.lower:g} is not below the upper {self.upper:g}", self.name)
        if not (math.isfinite(self.guess) and self.lower <= self.guess <= self.upper):
            raise InputError(f"the guess {self.guess:g} is not within [{self.lower:g}, {self.upper:g}]", self.name)
        if self.reciprocal and not self.lower > 0.0:
            raise InputError(f"the lower bound {self.lower:g} must be positive", self.name)


def started(unknowns: Sequence[Unknown], values: Mapping[str, float]) -> list[Unknown]:
    """Return the unknowns with other guesses by name, each moved to its nearest bound if it is not within them."""
    return [replace(u, guess=min(max(values.get(u.name, u.guess), u.lower), u.upper)) for u in unknowns]
