"""Loads on a beam at rest: a force and a moment at a point, and a force per length along a part of the beam.

A dead force F keeps its direction in the laboratory.  A follower force turns with the beam: its components are along
the slope and across it, to the left, F = F_1 t + F_2 n with t = r'/|r'| and n = t turned by 90 degrees.  The moment m
turns the cross-section, theta = atan2(r'_y, r'_x).  The generalized force on the nodal coordinates is

    at a point               S^T F + m dtheta/de,    r = S e there,
    along a part (a, b)      int_a^b S^T q dp,        q per unit of the arc length without load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.supports import check_point
from ancf_casadi.support.inputs import check_fields, flag, limited_number, limited_vector, number, positive, vector
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True)
class PointLoad(Displayed):
    """A force and a moment at one point of a beam.

    Parameters
    ----------
    force : (float, float)
        Force in the laboratory frame, or along and across the beam if it is a follower, N.
    moment : float
        Moment, positive counterclockwise, N m.
    point : float, optional
        Arc length of the point from the clamp, m; the tip if not given.
    follower : bool
        Whether the force turns with the beam.

    Raises
    ------
    InputError
        If a value is not finite, or the point is negative.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, PointLoad, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> push = PointLoad(force=(0.02, 0.0), point=0.25)
    >>> rest = static_equilibrium(Model(beam), loads=[push])
    >>> print(f"{1e3 * rest.position(0.25)[0]:.1f} mm")
    7.6 mm
    """

    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0
    point: float | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, follower=flag, force=limited_vector, moment=limited_number)
        if self.point is not None:
            check_point(self.point)

    @classmethod
    def hung(cls, mass: float, point: float | None = None, *, gravity: tuple[float, float] = (0.0, -9.81)) -> PointLoad:
        """Return the weight of a mass (kg) that hangs at a point.

        Raises
        ------
        InputError
            If the mass is not positive, or the gravity is zero.

        Examples
        --------
        >>> from ancf_casadi import PointLoad
        >>> PointLoad.hung(0.1, point=0.45)
        PointLoad(force=(0, -0.981), point=0.45)
        """
        x, y = vector(gravity, "gravity")
        if not (x or y):
            raise InputError("is zero, so a mass has no weight; give the gravity at the place of the test", "gravity")
        mass = positive(mass, "mass")
        return cls((mass * x, mass * y), point=point)

    def place(self, beam: Beam) -> float:
        """Return the arc length of the point on a beam, m; a point beyond its tip raises an ``InputError``."""
        if self.point is None:
            return beam.length
        if self.point > beam.length:
            raise InputError(f"{self.point:g} m is beyond the tip of the beam, at {beam.length:g} m", "point")
        return self.point

    def scaled(self, factor: float) -> PointLoad:
        """Return a multiple of the load at the same point."""
        force = factor * self.force[0], factor * self.force[1]
        return replace(self, force=force, moment=factor * self.moment)

    @property
    def values(self) -> tuple[float, float, float]:
        """Force (Fx, Fy), N, and moment, N m."""
        return (*self.force, self.moment)

    @property
    def text(self) -> str:
        """The load in words."""
        place = "the tip" if self.point is None else f"{self.point:g} m"
        kind = "follower force" if self.follower else "force"
        return f"{kind} {self.force} N and moment {self.moment:g} N m at {place}"


@dataclass(frozen=True)
class LineLoad(Displayed):
    """A force per length along a part of a beam.

    Parameters
    ----------
    force : (float, float)
        Force per length in the laboratory frame, or along and across the beam if it is a follower, N/m.
    begin : float
        Arc length at which the load begins, m.
    end : float, optional
        Arc length at which it ends, m; the tip if not given.
    follower : bool
        Whether the force turns with the beam, as a pressure does.

    Raises
    ------
    InputError
        If a value is not finite, the beginning is negative, or the end is not beyond it.

    Examples
    --------
    >>> from ancf_casadi import Beam, LineLoad, Model, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> rest = static_equilibrium(Model(beam), loads=[LineLoad((0.1, 0.0), begin=0.25)])
    >>> print(f"{1e3 * rest.tip[0]:.1f} mm")
    47.1 mm
    """

    force: tuple[float, float]
    begin: float = 0.0
    end: float | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        """Validate."""
        check_fields(self, force=limited_vector, follower=flag)
        check_point(self.begin, "begin")
        if self.end is not None and number(self.end, "end") <= self.begin:
            raise InputError(f"must be beyond the beginning at {self.begin:g} m, got {self.end:g}", "end")

    def places(self, beam: Beam) -> tuple[float, float]:
        """Return where the load begins and ends on a beam, m; beyond its tip this raises an ``InputError``."""
        end = beam.length if self.end is None else self.end
        if max(end, self.begin) > beam.length:
            raise InputError(f"{max(end, self.begin):g} m is beyond the tip of the beam, at {beam.length:g} m", "end")
        return self.begin, end

    def scaled(self, factor: float) -> LineLoad:
        """Return a multiple of the load."""
        return replace(self, force=(factor * self.force[0], factor * self.force[1]))

    @property
    def values(self) -> tuple[float, float]:
        """Force per length, N/m."""
        return self.force

    @property
    def text(self) -> str:
        """The load in words."""
        kind = "follower force" if self.follower else "force"
        return (
            f"{kind} {self.force} N/m from {self.begin:g} m to {'the tip' if self.end is None else f'{self.end:g} m'}"
        )


Load = PointLoad | LineLoad


def loads_text(loads: Sequence[Load]) -> str:
    """Return loads in words."""
    return "; ".join(load.text for load in loads) or "no load"
