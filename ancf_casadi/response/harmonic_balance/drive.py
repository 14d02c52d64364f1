"""Harmonic excitation at the phase tau = omega t.

    u = A (u_0 sin tau + omega u_1 cos tau - omega^2 u_2 sin tau)

with constant vectors u_0, u_1, u_2.  A motion of the clamp, A sin tau along a direction, has its displacement in u_0,
its velocity in u_1 and its acceleration in u_2.  A force has only u_0.

The excitation of a beam has 12 components: displacement (x, y) and rotation of the clamp, their velocities, their
accelerations, and force (x, y) and moment at the tip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, HarmonicBase
from ancf_casadi.dynamics.tip_load import TIP, HarmonicLoad, TipLoad
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, check_instance, physical
from ancf_casadi.support.tables import Displayed

BEAM_EXCITATION = 12


@dataclass(frozen=True)
class HarmonicForce(Displayed):
    """Excitation u = amplitude direction sin(2 pi frequency t) of a ``SecondOrderSystem``.

    Parameters
    ----------
    amplitude : float
        Amplitude, positive.
    frequency : float
        Frequency, Hz, positive.
    direction : sequence of float
        Value of each component of u at unit amplitude.

    Raises
    ------
    InputError
        If a value is not a number in its range.

    Examples
    --------
    >>> from ancf_casadi import HarmonicForce
    >>> HarmonicForce(amplitude=0.1, frequency=2.0).direction
    (1.0,)
    """

    amplitude: float
    frequency: float
    direction: Sequence[float] = (1.0,)

    def __post_init__(self) -> None:
        """Validate."""
        physical(self.amplitude, "amplitude")
        physical(self.frequency, "frequency")
        direction = array(self.direction, "direction")
        if direction.ndim != 1 or not direction.any():
            raise InputError("must be a sequence of numbers that are not all zero", "direction")
        object.__setattr__(self, "direction", tuple(direction.tolist()))


@dataclass(frozen=True, eq=False)
class Drive:
    """A harmonic excitation of a system."""

    parts: Array  # u_0, u_1 and u_2, (3, e)
    amplitude: float  # A; of a beam, m, N or N m
    omega: float  # rad/s
    unit: str = ""  # of the amplitude
    direction: tuple[float, float] = (0.0, 0.0)  # of the base motion or the force at the tip; zero for a moment alone

    @property
    def moves_base(self) -> bool:
        """True if the excitation is a motion of the base."""
        return bool(self.parts[1].any())

    def expression(self, phases: Array, omega: cs.MX, amplitude: cs.MX) -> cs.MX:
        """Return u at phases (k,) as an expression, (e, k)."""
        constant, linear, square = map(cs.DM, self._powers(phases))
        return amplitude * (constant + omega * linear + omega**2 * square)

    def samples(self, phases: Array, omega: float, amplitude: float) -> tuple[Array, Array, Array]:
        """Return u and its derivatives with respect to omega and A at phases (k,), each (e, k)."""
        constant, linear, square = self._powers(phases)
        shape = constant + omega * linear + omega**2 * square
        return amplitude * shape, amplitude * (linear + 2 * omega * square), shape

    def _powers(self, phases: Array) -> Array:
        """Return the coefficients of 1, omega and omega^2 in u/A, (3, e, k)."""
        factors = np.array([np.sin(phases), np.cos(phases), -np.sin(phases)])
        return np.asarray(self.parts[:, :, None] * factors[:, None, :])


def no_drive(components: int) -> Drive:
    """Return a drive without any excitation."""
    return Drive(np.zeros((3, components)), 0.0, 1.0)


def beam_drive(base: BaseMotion | None, load: TipLoad | None) -> Drive:
    """Return the excitation of a beam by its base or at its tip, at its full amplitude."""
    if (base is None) == (load is None):
        raise InputError("give either a HarmonicBase or a HarmonicLoad", "base" if base is not None else "load")
    parts = np.zeros((3, BEAM_EXCITATION))
    if base is not None:
        check_instance(base, "base", HarmonicBase)
        assert isinstance(base, HarmonicBase)
        _check_endless(base.stop, "base")
        for order in range(3):
            parts[order, 3 * order : 3 * order + 2] = base.direction
        return Drive(parts, base.amplitude, 2 * math.pi * base.frequency, "m", base.direction)
    check_instance(load, "load", HarmonicLoad)
    assert isinstance(load, HarmonicLoad)
    _check_endless(load.stop, "load")
    if load.place != TIP:
        raise InputError("acts elsewhere than at the tip, or follows the beam, which needs simulate or motion", "load")
    force = math.hypot(*load.force)
    amplitude, unit = (force, "N") if force else (abs(load.moment), "N m")
    if not amplitude:
        raise InputError("is zero", "load")
    parts[0, 9:] = np.array([*load.force, load.moment]) / amplitude
    direction = (load.force[0] / force, load.force[1] / force) if force else (0.0, 0.0)
    return Drive(parts, amplitude, 2 * math.pi * load.frequency, unit, direction)


def force_drive(force: HarmonicForce, components: int) -> Drive:
    """Return the excitation of a system by a harmonic force."""
    if len(force.direction) != components:
        raise InputError(f"has {len(force.direction)} entries for {components} of the excitation", "direction")
    parts = np.zeros((3, components))
    parts[0] = force.direction
    return Drive(parts, force.amplitude, 2 * math.pi * force.frequency)


def _check_endless(stop: float, where: str) -> None:
    if stop != math.inf:
        raise InputError("stops; a steady vibration needs an excitation without a stop", where)
