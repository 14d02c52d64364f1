"""Supports of a beam: the directions of motion that they hold at a point, exactly.

A support at arc length s holds some components of the position r(s), and perhaps the direction of r'(s), at the place
where the beam has them without load, in a frame that moves with the base.  The direction of a ``Roller`` or ``Guide``
keeps its angle in the laboratory.

    Clamp    holds the position, and the direction rigidly or by a torsional spring
    Pin      holds the position; the beam may turn
    Roller   holds the position across a direction; the beam may slide and turn
    Guide    holds the position across a direction, and the direction of the beam; the beam may slide

A support may sit away from the place of the unloaded beam: a displacement along the beam prestresses or buckles it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, final

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_fields, limited_vector, number, positive_or_infinite, unit_vector
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True)
class Support(Displayed):
    """Base class of the supports.

    Parameters
    ----------
    point : float
        Arc length of the point that is held, m.
    displacement : (float, float)
        Displacement of the support from the place of the unloaded beam, in the laboratory frame, m.

    Raises
    ------
    InputError
        If the point is negative, or a value is not finite.

    Examples
    --------
    >>> from ancf_casadi import Clamp, Pin, Support
    >>> supports = (Clamp(0.0), Pin(0.5, displacement=(0.0, 1e-3)))
    >>> all(isinstance(one, Support) for one in supports), supports[1]
    (True, Pin(point=0.5, displacement=(0, 0.001)))
    """

    turns: ClassVar[bool] = True  # whether the beam may turn at the support

    point: float
    displacement: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, point=check_point, displacement=limited_vector)
        further = {"rotation": number, "direction": unit_vector, "stiffness": positive_or_infinite}
        check_fields(self, **{name: check for name, check in further.items() if hasattr(self, name)})

    @property
    def sliding(self) -> tuple[float, float] | None:
        """Direction in which the point may slide, a unit vector; None if it may not."""
        return getattr(self, "direction", None)

    @property
    def angle(self) -> float:
        """Angle by which the support turns the beam from its direction without load, rad: its rotation, if any."""
        return float(getattr(self, "rotation", 0.0))


@final
@dataclass(frozen=True)
class Clamp(Support):
    """A clamp, which holds position and direction; with a finite stiffness the beam turns in it against a spring.

    Parameters
    ----------
    point : float
        Arc length of the clamped point, m.
    stiffness : float
        Torsional stiffness, N m/rad; infinite for a rigid clamp.
    displacement : (float, float)
        See ``Support``.
    rotation : float
        Angle by which the clamp turns the beam from its direction without load, rad, counterclockwise.

    Raises
    ------
    InputError
        As in ``Support``; or if the stiffness is not positive.

    Examples
    --------
    >>> from ancf_casadi import Beam, Clamp, Model, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, supports=(Clamp(0.0), Clamp(0.5)), gravity=(0.0, 0.0))
    >>> natural_modes(Model(beam), count=2).frequencies.round(1)
    array([10.5, 29.1])
    """

    turns: ClassVar[bool] = False

    point: float = 0.0
    stiffness: float = math.inf
    rotation: float = field(default=0.0, kw_only=True)


@final
@dataclass(frozen=True)
class Pin(Support):
    """A hinge, which holds the position.

    Parameters
    ----------
    point, displacement
        See ``Support``.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, Pin, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, supports=(Pin(0.0), Pin(0.5)), gravity=(0.0, 0.0))
    >>> natural_modes(Model(beam), count=2).frequencies.round(1)
    array([ 4.6, 18.6])
    """


@final
@dataclass(frozen=True)
class Roller(Support):
    """A roller, which lets the point slide along a direction, and the beam turn.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    direction : (float, float)
        Direction of sliding in the laboratory frame, of any length above 0.
    displacement : (float, float)
        See ``Support``.

    Raises
    ------
    InputError
        As in ``Support``; or if the direction is zero.

    Examples
    --------
    >>> from ancf_casadi import Roller
    >>> Roller(0.5, direction=(2.0, 0.0)).sliding
    (1.0, 0.0)
    """

    direction: tuple[float, float] = (1.0, 0.0)


@final
@dataclass(frozen=True)
class Guide(Support):
    """A guide, which lets the point slide along a direction, and does not let the beam turn.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    direction : (float, float)
        Direction of sliding in the laboratory frame, of any length above 0.
    displacement : (float, float)
        See ``Support``.
    rotation : float
        Angle by which the guide turns the beam from its direction without load, rad, counterclockwise.

    Raises
    ------
    InputError
        As in ``Support``; or if the direction is zero.

    Examples
    --------
    >>> from ancf_casadi import Guide
    >>> Guide(0.5, direction=(0.0, 1.0)).turns
    False
    """

    turns: ClassVar[bool] = False

    direction: tuple[float, float] = (1.0, 0.0)
    rotation: float = field(default=0.0, kw_only=True)


def can_slide(supports: Iterable[Support]) -> bool:
    """Return whether the beam slides along one of the supports, whose direction does not turn with the base."""
    return any(support.sliding for support in supports)


def check_point(point: float, where: str = "point") -> float:
    """Return the arc length of a point, m, 0 or more."""
    point = number(point, where)
    if point < 0.0:
        raise InputError(f"must be 0 or more, got {point:g}", where)
    return point


def snap_to_point(component: Any, places: Array, rounding: float) -> Any:
    """Return a support or attachment at the first of the places that differs from its point by rounding alone."""
    first = float(places[np.abs(places - component.point) <= rounding][0])
    return component if first == component.point else replace(component, point=first)
