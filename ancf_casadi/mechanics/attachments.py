"""Masses, springs and dashpots at points of a beam.

Springs and dashpots join a point of the beam to the base, with which their other ends move.  They are free of force
where the beam is without load, and in rest.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, final

from ancf_casadi.mechanics.supports import check_point
from ancf_casadi.support.inputs import check_fields, limited_number, not_negative, vector
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True)
class Attachment(Displayed):
    """Base class of what is attached to a beam.

    Parameters
    ----------
    point : float
        Arc length of the point, m.

    Raises
    ------
    InputError
        If the point is negative or not finite.

    Examples
    --------
    >>> from ancf_casadi import Attachment, PointMass
    >>> isinstance(PointMass(0.25, 5e-3), Attachment)
    True
    """

    point: float

    def __post_init__(self) -> None:
        """Validate; the fields of a kind are amounts, or pairs of amounts along x and y."""
        amounts = {parameter.name: _amount if parameter.type == "float" else _pair for parameter in fields(self)[1:]}
        check_fields(self, point=check_point, **amounts)


@final
@dataclass(frozen=True)
class PointMass(Attachment):
    """A mass at a point, such as an accelerometer.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    mass : float
        Mass, kg.
    rotary_inertia : float
        Moment of inertia about the point, kg m^2.

    Raises
    ------
    InputError
        If the point, the mass or the inertia is negative or not finite.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, PointMass, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, attachments=(PointMass(0.25, 5e-3),))
    >>> natural_modes(Model(beam), count=2).frequencies.round(2)
    array([1.76, 7.85])
    """

    mass: float
    rotary_inertia: float = 0.0


@final
@dataclass(frozen=True)
class Spring(Attachment):
    """A spring that joins a point to the base.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    stiffness : (float, float)
        Stiffness along x and y, N/m.

    Raises
    ------
    InputError
        If the point or a stiffness is negative or not finite.

    Examples
    --------
    >>> from ancf_casadi import Spring
    >>> Spring(0.3, (0.0, 80.0))
    Spring(point=0.3, stiffness=(0, 80))
    """

    stiffness: tuple[float, float]


@final
@dataclass(frozen=True)
class RotationalSpring(Attachment):
    """A torsional spring that resists the rotation of the beam at a point.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    stiffness : float
        Torsional stiffness, N m/rad.

    Raises
    ------
    InputError
        If the point or the stiffness is negative or not finite.

    Examples
    --------
    >>> from ancf_casadi import RotationalSpring
    >>> RotationalSpring(0.0, 2.0).stiffness
    2.0
    """

    stiffness: float


@final
@dataclass(frozen=True)
class Dashpot(Attachment):
    """A viscous damper that joins a point to the base.

    Parameters
    ----------
    point : float
        Arc length of the point, m.
    coefficient : (float, float)
        Force per velocity along x and y, N s/m.

    Raises
    ------
    InputError
        If the point or a coefficient is negative or not finite.

    Examples
    --------
    >>> from ancf_casadi import Dashpot
    >>> Dashpot(0.5, (0.0, 0.1)).coefficient
    (0.0, 0.1)
    """

    coefficient: tuple[float, float]


def _amount(value: Any, where: str) -> float:
    """Return a number of 0 or more whose powers are finite."""
    return limited_number(not_negative(value, where), where)


def _pair(values: Any, where: str) -> tuple[float, float]:
    x, y = vector(values, where)
    return _amount(x, where), _amount(y, where)
