"""The errors of the toolkit.

Every error a caller can provoke is an ``AncfError``.  Each leaf says what is wrong, where, and what to do,
and carries the data a program needs to react, so that no error of a solver library leaks through.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class AncfError(Exception):
    """Base of all errors of this package."""


class InputError(AncfError):
    """What the caller gave cannot be used.

    Parameters
    ----------
    message : str
        What is wrong and what would be right.
    where : str, optional
        The name of the offending argument, key or file; it opens the message.
    """

    def __init__(self, message: str, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.where = where


class NumericsError(AncfError):
    """A numerical method did not reach its answer.

    Parameters
    ----------
    message : str
        What failed, and what to try.
    stats : mapping, optional
        What the solver said of its run.
    """

    def __init__(self, message: str, stats: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.stats = dict(stats or {})


class EquilibriumError(NumericsError):
    """No static equilibrium was found."""


class SimulationError(NumericsError):
    """A time integration stopped before its end.

    Parameters
    ----------
    message : str
        What failed, and what to try.
    time : float
        The simulated time that was reached, in s.

    Attributes
    ----------
    partial : Trajectory or None
        The motion up to there.
    """

    def __init__(self, message: str, time: float = math.nan, stats: Mapping[str, Any] | None = None) -> None:
        super().__init__(message, stats)
        self.time = time
        self.partial: Any = None


class FitError(NumericsError):
    """An estimation problem did not converge."""
