"""A load at one point of a beam: a force and a moment that keep their values while the beam moves.

The force F keeps its direction in the laboratory.  The moment m turns the cross-section, theta = atan2(r'_y, r'_x), so
that the generalized force on the nodal coordinates is S^T F + m dtheta/de, with r = S e at the point.
"""

from __future__ import annotations

from dataclasses import dataclass

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.inputs import check_size, number, positive, vector
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True)
class PointLoad(Displayed):
    """A force and a moment at one point of a beam.

    Parameters
    ----------
    force : (float, float)
        Force in the laboratory frame, N.
    moment : float
        Moment, positive counterclockwise, N m.
    point : float, optional
        Arc length of the point from the clamp, m; the tip if not given.

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

    def __post_init__(self) -> None:
        """Validate."""
        object.__setattr__(self, "force", vector(self.force, "force"))
        object.__setattr__(self, "moment", number(self.moment, "moment"))
        check_size(self.force, "force")
        check_size(self.moment, "moment")
        if self.point is not None and number(self.point, "point") < 0.0:
            raise InputError(f"must be 0 or more, got {self.point:g}", "point")

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
        return PointLoad((factor * self.force[0], factor * self.force[1]), factor * self.moment, self.point)

    @property
    def values(self) -> tuple[float, float, float]:
        """Force (Fx, Fy), N, and moment, N m."""
        return (*self.force, self.moment)
