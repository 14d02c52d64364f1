"""The interface that all results share: estimates come with warnings, standard errors, text, JSON and a figure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@runtime_checkable
class Result(Protocol):
    """The result of an estimation."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Standard error of each quantity by name, in the unit of the quantity; nan where there is none."""

    def report(self) -> str:
        """Return the result as text."""

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""

    def figure(self) -> Figure:
        """Draw the result."""


def known(value: float) -> float | None:
    """Return a number for JSON, None if it is not finite."""
    return float(value) if math.isfinite(value) else None
