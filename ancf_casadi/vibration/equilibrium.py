"""An equilibrium of a beam under gravity and loads at its points, and Newton's method from a neighbouring position.

At rest the elastic force balances the loads, for all free coordinates:

    R(e) = Q_e(e) - Q_g - sum_i (S_i^T F_i + m_i dtheta_i/de) = 0,      theta = atan2(r'_y, r'_x),

with forces F_i and moments m_i (positive counterclockwise) at the points i.  A moment follows the slope at its point,
so it contributes to the tangent stiffness dR/de.  Newton's method converges from a neighbouring equilibrium.

The last correction of Newton's method, too small to be added to the coordinates, is kept beside them
(``ancf_casadi.vibration.assembly``), so the balance holds to the rounding error of the forces on any mesh.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse

from ancf_casadi.mechanics.loads import Load, PointLoad, loads_text
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import factorise, sparse
from ancf_casadi.support.tables import Reported, Table, plural
from ancf_casadi.vibration.assembly import Position, Structure, eigenvalue_shift, solve_refined
from ancf_casadi.vibration.eigensolver import is_definite, lowest_modes

MAX_ROTATION = 0.5  # norm of the change of a slope vector in one load step; about the angle, rad


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
    >>> round(rest.tip_angle, 3), rest.stable
    (-0.357, True)
    """

    _drawing = "ancf_casadi.figures.equilibria.equilibrium_figure"

    model: Model
    coordinates: Array
    tip_force: tuple[float, float] = (0.0, 0.0)
    tip_moment: float = 0.0
    remainder: Array | None = None
    loads: tuple[Load, ...] = ()

    @property
    def all_loads(self) -> tuple[Load, ...]:
        """All loads that are not zero."""
        return tuple(load for load in (PointLoad(self.tip_force, self.tip_moment), *self.loads) if any(load.values))

    @property
    def structure(self) -> Structure:
        """The beam and its loads as groups of equal elements."""
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
    def stable(self) -> bool:
        """True if no small disturbance grows; if forces follow the beam, as far as divergence goes."""
        _, stiffness, mass = self.structure.linearisation(self.exact)
        if any(load.follower for load in self.all_loads):
            return factorise(stiffness).determinant[0] > 0.0
        surely = is_definite(stiffness - eigenvalue_shift(self.model, stiffness, mass) * mass)
        return surely or lowest_modes(self.structure, self.exact, 1) is not None

    def table(self) -> Table:
        """Return position and angle of the tip, and the loads."""
        x, y = self.tip.tolist()
        title = f"Equilibrium, {'stable' if self.stable else 'unstable'}"
        rows = [("tip x", x, "m"), ("tip y", y, "m"), ("tip angle", self.tip_angle, "rad")]
        return Table("equilibrium", title, ("quantity", "value", "unit"), rows, (loads_text(self.all_loads),))

    def to_dict(self) -> dict[str, Any]:
        """Return tip, stability, loads and nodal coordinates as plain data."""
        return {
            "kind": "equilibrium",
            "tip_m": self.tip.tolist(),
            "tip_angle_rad": self.tip_angle,
            "stable": self.stable,
            "loads": [asdict(load) for load in self.all_loads],
            "coordinates": self.coordinates.tolist(),
        }

    def _summary(self) -> str:
        x, y = np.round(self.tip, 6) + 0.0  # no -0.0
        state = "stable" if self.stable else "unstable"
        return f"tip ({x:g}, {y:g}) m, {state}, {plural(self.model.beam.elements, 'element')}"


def neighbouring_equilibrium(
    structure: Structure, start: Position, relief: Array | float = 0.0, support_motion: Array | None = None
) -> Position | None:
    """Return the equilibrium next to a position; None if Newton's method fails or a slope rotates too far.

    ``relief`` (N,) are generalized forces that carry a share of the loads; they are added to the balance R.
    ``support_motion`` (size,) leads from the position to the equilibrium; only the first correction contains it.
    """
    model, position = structure.model, start
    slopes = np.arange(model.size).reshape(-1, NODE)[:, 2:]
    converged = False
    for _ in range(12):
        position = Position.of(position.coordinates)
        force, *matrices = structure.linearisation(position)
        if support_motion is not None:
            force = force + structure.whole_product(position)(support_motion)
        try:
            solve = factorise(structure.regular_stiffness(*matrices)).solve
            step = -solve_refined(solve, structure.stiffness_product(position), force + relief)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(step).all():
            return None
        update, support_motion = model.with_fixed_base(step) + (0.0 if support_motion is None else support_motion), None
        if converged:
            return Position(position.coordinates, update)
        position = Position.of(position.coordinates + update)
        rotation = np.linalg.norm(position.coordinates[slopes] - start.coordinates[slopes], axis=1).max()
        if rotation > 2 * MAX_ROTATION:
            return None
        # of a correction, relative to the beam's length (positions) and to 1/2 (slopes)
        converged = np.abs(update / model.scale).max() < 1e-11
        if converged and rotation > MAX_ROTATION:
            return None
    return None
