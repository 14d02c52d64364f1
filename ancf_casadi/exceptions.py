"""The exceptions of the toolkit.

Every error that a caller can provoke is an ``AncfError``.  Each says what is wrong, where, and what to do, and carries
the data that a program needs to react, so that no exception of a solver library reaches the caller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class AncfError(Exception):
    """Base class of all exceptions of this package.

    Examples
    --------
    >>> from ancf_casadi import AncfError, Section
    >>> try:
    ...     Section(width=-5e-3, thickness=0.5e-3)
    ... except AncfError as error:
    ...     print(error)
    width: must be positive, got -0.005
    """


class InputError(AncfError):
    """An argument, a key or a file cannot be used.

    Parameters
    ----------
    message : str
        The fault and the values that are allowed.
    where : str, optional
        Name of the argument, key or file; the message begins with it.

    Examples
    --------
    >>> from ancf_casadi import HarmonicBase, InputError
    >>> try:
    ...     HarmonicBase(amplitude=1e-3, frequency=0.0)
    ... except InputError as error:
    ...     print(error.where)
    ...     print(error)
    frequency
    frequency: must be positive, got 0
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

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, NumericsError, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> try:
    ...     static_equilibrium(Model(beam), tip_moment=10.0)
    ... except NumericsError as error:
    ...     print(type(error).__name__)
    EquilibriumError
    """

    def __init__(self, message: str, stats: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.stats = dict(stats or {})


class EquilibriumError(NumericsError):
    """No static equilibrium was found.

    Examples
    --------
    >>> from ancf_casadi import Beam, EquilibriumError, Model, Pin, natural_modes
    >>> standing = Beam.uniform(length=1.0, width=5e-3, thickness=0.5e-3, axis=(0.0, 1.0), supports=[Pin(0.0)],
    ...                         density=8000.0, elastic_modulus=210e9, elements=4)
    >>> try:
    ...     natural_modes(Model(standing))
    ... except EquilibriumError as error:
    ...     print(error)
    no static equilibrium was found ...: the supports do not hold the beam against rigid motions. ...
    """


class SimulationError(NumericsError):
    """A time integration stopped before its end.

    Parameters
    ----------
    message, stats
        See ``NumericsError``.
    time : float
        Simulated time reached, s.

    Attributes
    ----------
    partial : Trajectory or None
        The motion up to that time.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, SimulationError, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> base = HarmonicBase(amplitude=1e-3, frequency=2.0)
    >>> try:
    ...     simulate(Model(beam), base=base, duration=1.0, most_steps=100)
    ... except SimulationError as error:
    ...     print(0.0 < error.time < 1.0, error.partial.time[-1] <= error.time)
    True True
    """

    def __init__(self, message: str, time: float = math.nan, stats: Mapping[str, Any] | None = None) -> None:
        super().__init__(message, stats)
        self.time = time
        self.partial: Any = None


class ContinuationError(NumericsError):
    """A curve of periodic motions cannot be followed to its end.

    Parameters
    ----------
    message, stats
        See ``NumericsError``.
    partial : ResponseCurve or Backbone, optional
        The curve up to there.

    Examples
    --------
    A hard stop at q = 1:

    >>> import casadi as cs
    >>> from ancf_casadi import ContinuationError, HarmonicForce, SecondOrderSystem, frequency_response
    >>> q, v, a, u = (cs.SX.sym(name) for name in ("q", "v", "a", "u"))
    >>> stopped = SecondOrderSystem.of(
    ...     q, v, a, u, conservative=a + q + 1e6 * cs.fmax(q - 1, 0), damping=0.05 * v, excitation=u)
    >>> try:
    ...     frequency_response(stopped, (0.1, 0.2), force=HarmonicForce(amplitude=0.1, frequency=0.1))
    ... except ContinuationError as error:
    ...     print(f"{error.partial.amplitude().max():.3f}")
    1.000
    """

    def __init__(self, message: str, stats: Mapping[str, Any] | None = None, partial: Any = None) -> None:
        super().__init__(message, stats)
        self.partial = partial


class FitError(NumericsError):
    """An estimation problem did not converge.

    Examples
    --------
    >>> from ancf_casadi import Beam, FitError, Model
    >>> from problems import FrequencyRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> record = FrequencyRecord(Model(beam), frequencies=[1.9, 10.6, 29.3])
    >>> try:
    ...     fit_beam(record.model, record, unknowns=["elastic_modulus", "density"])
    ... except FitError as error:
    ...     print(error)
    the records determine density/elastic_modulus, but not elastic_modulus and density each; ...
    """
