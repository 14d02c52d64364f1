"""Static equilibrium under gravity and loads at points of the beam.

At rest the elastic force balances the loads, for all free coordinates:

    R(e, s) = Q_e(e) - s (Q_g + sum_i (S_i^T F_i + m_i dtheta_i/de)) = 0,      theta = atan2(r'_y, r'_x),

with forces F_i and moments m_i (positive counterclockwise) at the points i and load factor s = 1.  A moment follows the
slope at its point, so it contributes to the tangent stiffness dR/de.

Newton's method converges from a neighbouring equilibrium.  The load factor therefore grows from 0, where the beam is
straight, in steps that keep the rotation of every slope small.  A step that fails or rotates a slope too far is halved,
so the solver follows the path instead of jumping to another equilibrium.  The path of the discrete beam ends where an
element bends by about 0.6 rad, because two Gauss points do not control a cubic with more curvature (measured for a
pure end moment with 5 to 10 elements).  An unstable equilibrium, such as a standing beam beyond buckling, is returned
too; ``Equilibrium.is_stable`` marks it.

The last correction of Newton's method, too small to be added to the coordinates, is kept beside them
(``ancf_casadi.vibration.assembly``), so the balance holds to the rounding error of the forces on any mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import factorised, sparse
from ancf_casadi.support.inputs import check_instance, check_size, instances, number, vector
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Reported, Table, counted
from ancf_casadi.vibration.assembly import Position, Structure, refined
from ancf_casadi.vibration.eigensolver import lowest_modes, shift_of

LARGEST_ROTATION = 0.5  # norm of the change of a slope vector in one load step; about the angle, rad


@dataclass(frozen=True)
class Equilibrium(Reported):
    """A beam at rest.

    Parameters
    ----------
    model : Model
        The beam.
    coordinates : array (4 n + 4,)
        Nodal coordinates: positions, m, and dimensionless slopes.
    tip_force : (float, float)
        Force at the tip, N.
    tip_moment : float
        Moment at the tip, counterclockwise, N m.
    remainder : array (4 n + 4,), optional
        The part of the coordinates lost by rounding; zero if not given.
    loads : tuple of PointLoad or LineLoad
        Further loads.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> rest = static_equilibrium(Model(beam.with_(axis=(1.0, 0.0))))
    >>> rest.tip.round(3)
    array([ 0.48 , -0.132])
    >>> round(rest.tip_angle, 3), rest.is_stable
    (-0.357, True)
    """

    _drawing = "ancf_casadi.plot.equilibrium_figure"

    model: Model
    coordinates: Array
    tip_force: tuple[float, float] = (0.0, 0.0)
    tip_moment: float = 0.0
    remainder: Array | None = None
    loads: tuple[Load, ...] = ()

    @property
    def all_loads(self) -> tuple[Load, ...]:
        """All loads that are not zero."""
        return _all_loads(self.tip_force, self.tip_moment, self.loads)

    @property
    def structure(self) -> Structure:
        """The beam and its loads as parts with properties."""
        return Structure.of(self.model, self.all_loads)

    @property
    def exact(self) -> Position:
        """The coordinates and their remainder."""
        if self.remainder is None:
            return Position.of(self.coordinates)
        return Position(self.coordinates, self.remainder)

    def position(self, point: float) -> Array:
        """Return the position of the point at arc length ``point`` (m), (2,), m; it must be on the beam."""
        return self.model.interpolation(point) @ self.coordinates

    @property
    def tip(self) -> Array:
        """Position of the tip (x, y), m."""
        return self.coordinates[-NODE:-2]

    @property
    def tip_angle(self) -> float:
        """Angle of the slope at the tip from the x axis, rad, in (-pi, pi]."""
        return float(np.arctan2(self.coordinates[-1], self.coordinates[-2]))

    @cached_property
    def stiffness(self) -> scipy.sparse.csc_array:
        """Tangent stiffness dR/de of the free coordinates, loads included, sparse."""
        return sparse(self.structure.linearisation(self.exact)[1]).tocsc()

    @cached_property
    def is_stable(self) -> bool:
        """Stability: True if the tangent stiffness is positive definite."""
        return lowest_modes(self.structure, self.exact, 1) is not None

    def table(self) -> Table:
        """Return position and angle of the tip, and the loads."""
        x, y = self.tip.tolist()
        title = f"Equilibrium, {'stable' if self.is_stable else 'unstable'}"
        rows = [("tip x", x, "m"), ("tip y", y, "m"), ("tip angle", self.tip_angle, "rad")]
        return Table("equilibrium", title, ("quantity", "value", "unit"), rows, (_described(self.all_loads),))

    def to_dict(self) -> dict[str, Any]:
        """Return tip, stability, loads and nodal coordinates as plain data."""
        return {
            "kind": "equilibrium",
            "tip_m": self.tip.tolist(),
            "tip_angle_rad": self.tip_angle,
            "stable": self.is_stable,
            "loads": [asdict(load) for load in self.all_loads],
            "coordinates": self.coordinates.tolist(),
        }

    def _summary(self) -> str:
        x, y = np.round(self.tip, 6) + 0.0  # no -0.0
        return f"tip ({x:g}, {y:g}) m, {counted(self.model.beam.elements, 'element')}"


@lasting_interrupts()
def static_equilibrium(
    model: Model,
    *,
    tip_force: tuple[float, float] = (0.0, 0.0),
    tip_moment: float = 0.0,
    loads: Sequence[Load] = (),
) -> Equilibrium:
    """Return the equilibrium reached from the straight beam as gravity and all loads grow together.

    Parameters
    ----------
    model : Model
        The beam.
    tip_force : (float, float)
        Force at the tip in the laboratory frame, N.
    tip_moment : float
        Moment at the tip, positive counterclockwise, N m.
    loads : sequence of PointLoad or LineLoad
        Further loads, at any points and along any parts of the beam.

    Raises
    ------
    InputError
        If a load is not finite, or not on the beam.
    EquilibriumError
        If the path of equilibria cannot be followed to the full load.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, static_equilibrium
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> rest = static_equilibrium(Model(beam), tip_force=(0.02, 0.0))
    >>> print(f"{1e3 * rest.tip[0]:.0f} mm sideways, {1e3 * (rest.tip[1] + beam.length):.0f} mm up")
    59 mm sideways, 4 mm up
    """
    check_instance(model, "model", Model)
    force, moment = vector(tip_force, "tip_force"), number(tip_moment, "tip_moment")
    check_size(force, "tip_force")
    check_size(moment, "tip_moment")
    further = instances(loads, "loads", PointLoad, LineLoad, least=0)
    acting = _all_loads(force, moment, further)
    rest = Position.of(model.straight)
    weight = -Structure.of(model).linearisation(rest)[0]
    way = model.displacement if model.displacement.any() else None
    factor, step, trials = 0.0, 1.0, 0
    while factor < 1.0:
        trials += 1
        s = min(factor + step, 1.0)
        loaded = Structure.of(model, [load.scaled(s) for load in acting])
        trial = neighbour(loaded, rest, (1.0 - s) * weight, None if way is None else (s - factor) * way)
        if trial is None:
            step /= 2
            # a path that needs smaller steps of the load factor, or more of them, is close to a fold
            if step < 1e-5 or trials > 500:
                if not model.is_held:
                    raise EquilibriumError(
                        f"no static equilibrium was found beyond {factor:.4g} of the load ({_described(acting)}, "
                        f"gravity {model.beam.gravity} m/s^2): the supports do not hold the beam against rigid "
                        "motions. Hold it, turn it to where it hangs, or simulate its motion from start='straight'"
                    )
                raise EquilibriumError(
                    f"no static equilibrium was found beyond {factor:.4g} of the load ({_described(acting)}, "
                    f"gravity {model.beam.gravity} m/s^2). Either an element bends by more than half a "
                    "radian, which a cubic cannot follow (use more elements), or the beam buckles (tilt the axis), or "
                    "a value is in the wrong unit"
                )
            continue
        rest, factor = trial, s
        step *= 2
    return Equilibrium(model, rest.coordinates, force, moment, rest.remainder, further)


def _all_loads(tip_force: tuple[float, float], tip_moment: float, loads: tuple[Load, ...]) -> tuple[Load, ...]:
    """Return the loads that are not zero."""
    return tuple(load for load in (PointLoad(tip_force, tip_moment), *loads) if any(load.values))


def _described(loads: Sequence[Load]) -> str:
    """Return the loads in words."""
    return "; ".join(load.text for load in loads) or "no load"


def neighbour(
    structure: Structure, near: Position, support: Array | float = 0.0, way: Array | None = None
) -> Position | None:
    """Return the equilibrium next to a position; None if Newton's method fails or a slope rotates too far.

    ``support`` (N,) are generalized forces that carry a part of the loads; they are added to the balance R.  ``way``
    (size,) is the motion of the supports from the position to the equilibrium; the first correction is that of K.
    """
    model, at = structure.model, near
    slopes = np.arange(model.size).reshape(-1, NODE)[:, 2:]
    converged = False
    for _ in range(12):
        at = Position.of(at.coordinates)
        force, stiffness, mass = structure.linearisation(at)
        if not model.is_held:
            stiffness = stiffness + shift_of(model, stiffness, mass) * mass
        if way is not None:
            force = force + structure.whole_product(at)(way)
        try:
            step = -refined(factorised(stiffness).solve, structure.stiffness_product(at), force + support)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(step).all():
            return None
        update, way = model.moved(step) + (0.0 if way is None else way), None
        if converged:
            return Position(at.coordinates, update)
        at = Position.of(at.coordinates + update)
        rotation = np.linalg.norm(at.coordinates[slopes] - near.coordinates[slopes], axis=1).max()
        if rotation > 2 * LARGEST_ROTATION:
            return None
        # of a correction, relative to the beam's length (positions) and to 1/2 (slopes)
        converged = np.abs(update / model.scale).max() < 1e-11
        if converged and rotation > LARGEST_ROTATION:
            return None
    return None
