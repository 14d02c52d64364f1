"""The exceptions of the toolkit.

Every error that a caller can provoke is an ``AncfError``.  Each says what is wrong, where, and what to do, and carries
the data that a program needs to react, so that no exception of a solver library reaches the caller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class AncfError(Exception):
    """Base class of all exceptions of this package."""


class InputError(AncfError):
    """An argument, a key or a file cannot be used.

    Parameters
    ----------
    message : str
        The fault and the values that are allowed.
    where : str, optional
        Name of the argument, key or file; the message begins with it.
    """

    def __init__(self, message: str, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.where = where


class NumericsError(AncfError):
    """A numerical method did not reach its solution.

    Parameters
    ----------
    message : str
        The failure, and advice.
    stats : mapping, optional
        Statistics of the solver.
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
        The failure, and advice.
    time : float
        Simulated time reached, s.

    Attributes
    ----------
    partial : Trajectory or None
        The motion up to that time.
    """

    def __init__(self, message: str, time: float = math.nan, stats: Mapping[str, Any] | None = None) -> None:
        super().__init__(message, stats)
        self.time = time
        self.partial: Any = None


class FitError(NumericsError):
    """An estimation problem did not converge."""
