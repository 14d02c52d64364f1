"""Paths of equilibria through limit points and bifurcations, as loads and displacements of supports grow together.

The loads and the displacements and rotations of the supports are multiplied by a factor; gravity is not.
``ancf_casadi.vibration.continuation`` follows the equilibria.

An equilibrium is critical if its stiffness K is singular, so that the determinant of K changes its sign: at a limit
point, where the factor turns, or at a bifurcation, where another path crosses in the direction of the null vector.
With dead loads K is symmetric, and the equilibrium is stable if no eigenvalue is negative.  With follower forces the
sign of the determinant shows divergence alone; ``critical_load`` finds flutter too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, pairwise
from types import NoneType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad
from ancf_casadi.mechanics.mesh_limits import warn_of_overbent_elements
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import check_instance, instances, number, positive, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Displayed, Reported, Table, plural, spread
from ancf_casadi.vibration.continuation import (
    MAX_STEP,
    PathPoint,
    ProportionalLoading,
    at_factor,
    branch_tangent,
    follow_path,
    longest_step,
    null_shape,
)
from ancf_casadi.vibration.eigensolver import moves_freely
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.statics import static_equilibrium


@dataclass(frozen=True, eq=False)
class CriticalPoint(Displayed):
    """An equilibrium at which the stiffness is singular.

    Parameters
    ----------
    factor : float
        Factor on loads and displacements.
    kind : {"limit", "bifurcation"}
        A limit point, where the factor turns, or a bifurcation, where another path crosses.
    equilibrium : Equilibrium
        The equilibrium.
    shape : array (4 n + 4,)
        Null vector of the stiffness in all nodal coordinates; its largest displacement is 1 m.

    Examples
    --------
    A strip between two clamps buckles as they approach each other:

    >>> from ancf_casadi import Beam, Clamp, Model, equilibrium_path
    >>> beam = Beam.uniform(length=0.3, width=0.02, thickness=1e-3, density=7800.0, elastic_modulus=210e9, elements=8,
    ...                     gravity=(0.0, 0.0), supports=(Clamp(), Clamp(0.3, displacement=(0.0, 2e-5))))
    >>> (buckling,) = equilibrium_path(Model(beam)).critical_points
    >>> buckling.kind, round(2e-5 * buckling.factor, 8)
    ('bifurcation', 1.098e-05)
    >>> buckling.shape.shape == buckling.equilibrium.coordinates.shape
    True
    """

    factor: float
    kind: Literal["limit", "bifurcation"]
    equilibrium: Equilibrium
    shape: Array


@dataclass(frozen=True, eq=False)
class EquilibriumPath(Reported):
    """A path of equilibria.

    Parameters
    ----------
    model : Model
        The beam, its supports displaced as at a factor of 1.
    loads : tuple of PointLoad or LineLoad
        The loads at a factor of 1.
    factors : array (k,)
        Factor of each equilibrium, in the order of the path.
    equilibria : tuple of Equilibrium
        The equilibria; each has the model with its displacements of the supports.
    stable : array (k,)
        True for each stable equilibrium, as far as divergence goes if forces follow the beam.
    critical_points : tuple of CriticalPoint
        Limit points and bifurcations, which are among the equilibria.
    complete : bool
        Whether the path reaches the largest factor.

    Examples
    --------
    A shallow frame snaps through; half of it is enough:

    >>> from ancf_casadi import Beam, Clamp, Guide, Model, PointLoad, equilibrium_path
    >>> half = Beam.uniform(length=0.2, width=0.01, thickness=1e-3, density=7800.0, elastic_modulus=210e9, elements=4,
    ...                     axis=(1.0, 0.04), supports=(Clamp(), Guide(0.2, direction=(0.0, 1.0))))
    >>> path = equilibrium_path(Model(half), loads=[PointLoad((0.0, -20.0))])
    >>> [(one.kind, round(one.factor, 2)) for one in path.critical_points]
    [('limit', 0.31), ('limit', -0.1)]
    >>> [rest.stable for rest in path.equilibria_at(0.2)]
    [True, False, True]
    """

    _drawing = "ancf_casadi.figures.equilibria.path_figure"

    model: Model
    loads: tuple[Load, ...]
    factors: Array
    equilibria: tuple[Equilibrium, ...]
    stable: NDArray[np.bool_]
    critical_points: tuple[CriticalPoint, ...]
    complete: bool

    def equilibria_at(self, factor: float) -> tuple[Equilibrium, ...]:
        """Return all equilibria of the path at a factor, in the order of the path.

        Raises
        ------
        InputError
            If the factor is not a number.
        EquilibriumError
            If an equilibrium is so close to a bifurcation that it is not found.
        """
        factor, equilibria = number(factor, "factor"), []
        growing = ProportionalLoading(self.model, self.loads, float(np.abs(self.factors).max()))
        points = [growing.point(*pair) for pair in zip(self.factors.tolist(), self.equilibria, strict=True)]
        for first, last in pairwise(points):
            if (first.factor - factor) * (last.factor - factor) < 0.0:
                point = at_factor(first, last, factor)
                if point is None:
                    raise EquilibriumError(
                        f"no equilibrium was found at the factor {factor:g}, next to a critical point"
                    )
                equilibria.append(point.equilibrium)
            elif first.factor == factor:
                equilibria.append(first.equilibrium)
        return (*equilibria, *(point.equilibrium for point in points[-1:] if point.factor == factor))

    def positions(self, point: float | None = None) -> Array:
        """Return the position (x, y) of a point, (k, 2), m.

        Parameters
        ----------
        point : float, optional
            Arc length, m; ``reference_point`` if not given.
        """
        rows = self.model.interpolation(self.reference_point if point is None else point)
        return np.array([rows @ equilibrium.coordinates for equilibrium in self.equilibria])

    @cached_property
    def reference_point(self) -> float:
        """Arc length of the node that moves most, m."""
        coordinates = np.array([equilibrium.coordinates for equilibrium in self.equilibria])
        displacements = (coordinates - coordinates[0]).reshape(len(coordinates), -1, NODE)[:, self.model.root :, :2]
        return float(self.model.beam.node_points[np.linalg.norm(displacements, axis=2).max(axis=0).argmax()])

    @property
    def critical_indices(self) -> dict[int, CriticalPoint]:
        """The critical points by their number in the path, from 0."""
        critical = {id(point.equilibrium): point for point in self.critical_points}
        return {k: critical[id(state)] for k, state in enumerate(self.equilibria) if id(state) in critical}

    def table(self) -> Table:
        """Return the factor and the position of the reference point at both ends and at the critical points."""
        kinds = {0: "begin", len(self.factors) - 1: "end"}
        kinds |= {k: point.kind for k, point in self.critical_indices.items()}
        x, y = self.positions().T.tolist()
        rows = [(kinds[k], float(self.factors[k]), x[k], y[k]) for k in sorted(kinds)]
        title = f"Path of {len(self.factors)} equilibria, {np.count_nonzero(~self.stable)} of them unstable"
        note = f"x and y of the point at {self.reference_point:.4g} m"
        return Table("path", title, ("", "factor", "x_m", "y_m"), rows, (note,))

    def to_dict(self) -> dict[str, Any]:
        """Return factors, stability, critical points and nodal coordinates as plain data."""
        return {
            "kind": "equilibrium path",
            "factors": self.factors.tolist(),
            "stable": self.stable.tolist(),
            "critical_points": [{"kind": point.kind, "factor": point.factor} for point in self.critical_points],
            "coordinates": [state.coordinates.tolist() for state in self.equilibria],
            "complete": self.complete,
        }

    def figure(self, *others: EquilibriumPath, labels: Sequence[str] = (), point: float | None = None) -> Figure:
        """Draw the factor against the displacement of a point, and other paths; unstable equilibria are dashed.

        Parameters
        ----------
        *others : EquilibriumPath
            Other paths, such as branches.
        labels : sequence of str
            Names of this path and the others in the legend; their numbers, from 1, if not given.
        point : float, optional
            Arc length of the point, m; ``reference_point`` if not given.

        Raises
        ------
        InputError
            If a result is of another kind, or there is not one label for each.
        """
        return self._draw_figure(others, labels, point=point)

    def _summary(self) -> str:
        critical = plural(len(self.critical_points), "critical point")
        return f"{len(self.factors)} equilibria, factor {spread(self.factors, '')}, {critical}"


@lasting_interrupts()
def equilibrium_path(
    model: Model,
    *,
    loads: Sequence[Load] = (),
    largest_factor: float = 1.0,
    most_steps: int = 500,
    start: CriticalPoint | None = None,
    side: int = 1,
) -> EquilibriumPath:
    """Return the path of equilibria on which loads and displacements of supports grow with a factor; gravity does not.

    The path begins without loads, or at a bifurcation of another path, and ends where the factor has reached the
    largest one, positive or negative.

    Parameters
    ----------
    model : Model
        The beam, its supports displaced as at a factor of 1.
    loads : sequence of PointLoad or LineLoad
        The loads at a factor of 1.
    largest_factor : float
        Largest factor.
    most_steps : int
        Largest number of steps.
    start : CriticalPoint, optional
        A bifurcation of a path of this model and these loads, from which to follow the path that crosses there.
    side : {1, -1}
        Side of the bifurcation: along its shape, or against it.

    Raises
    ------
    InputError
        If an argument is unusable, nothing grows with the factor, or the start is no bifurcation of this model.
    EquilibriumError
        If the path does not begin with an equilibrium, or has no second one.

    Examples
    --------
    A column buckles, and bends to either side:

    >>> from ancf_casadi import Beam, Model, PointLoad, equilibrium_path
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    >>> push = [PointLoad((-0.1, 0.0))]
    >>> straight = equilibrium_path(Model(beam), loads=push, largest_factor=2.0)
    >>> buckled = straight.critical_points[0]
    >>> print(f"{buckled.kind} at {buckled.factor:.3f}")
    bifurcation at 1.079
    >>> bent = equilibrium_path(Model(beam), loads=push, largest_factor=2.0, start=buckled)
    >>> [one.stable for one in (*straight.equilibria_at(1.5), *bent.equilibria_at(1.5))]
    [False, True]
    """
    check_instance(model, "model", Model)
    check_instance(start, "start", CriticalPoint, NoneType)
    applied_loads = instances(loads, "loads", PointLoad, LineLoad, minimum=0)
    loading = ProportionalLoading(model, applied_loads, positive(largest_factor, "largest_factor"))
    most_steps, side = whole(most_steps, "most_steps", 1), whole(side, "side", -1, 1)
    if not (loading.moves or any(any(load.values) for load in applied_loads)):
        raise InputError("are zero, and no support is displaced, so nothing grows with the factor", "loads")
    if side == 0:
        raise InputError("must be 1 or -1", "side")
    point, tangent, step = _beginning(loading) if start is None else _crossing(loading, start, side)
    factors, equilibria, stable = [point.factor], [point.equilibrium], [start is None and point.negative == 0]
    critical_points: list[CriticalPoint] = []
    for path_step in islice(follow_path(point, tangent, step, regular=start is None), most_steps):
        if path_step.critical is not None and path_step.kind is not None:
            critical, shape = path_step.critical, null_shape(path_step.critical)
            critical_points.append(CriticalPoint(critical.factor, path_step.kind, critical.equilibrium, shape))
        for path_point in (path_step.critical, path_step.end):
            if path_point is not None:
                factors.append(path_point.factor)
                equilibria.append(path_point.equilibrium)
                stable.append(path_point is path_step.end and path_point.negative == 0)
        point = path_step.end
    if len(factors) == 1:
        raise EquilibriumError(
            f"the path of equilibria has no point after the factor {point.factor:g}; use more elements, or a smaller "
            "largest factor if a value is in the wrong unit"
        )
    warn_of_overbent_elements(model, np.array([equilibrium.coordinates for equilibrium in equilibria]))
    complete = abs(point.factor) >= loading.largest
    arrays = np.array(factors), tuple(equilibria), np.array(stable)
    return EquilibriumPath(model, applied_loads, *arrays, tuple(critical_points), complete)


def _beginning(loading: ProportionalLoading) -> tuple[PathPoint, Array, float]:
    """Return the equilibrium without loads, the tangent there, and the first step."""
    point = loading.point(0.0, static_equilibrium(loading.model_at(0.0)))
    if not point.rate.any():
        raise InputError("act on supports alone, so the factor does not change the equilibrium", "loads")
    if moves_freely(point.structure, point.at):
        raise EquilibriumError("the beam moves without resistance; hold it by supports or springs")
    tangent = point.tangent(np.append(np.zeros(point.q.size), 1.0))
    return point, tangent, longest_step(tangent)


def _crossing(loading: ProportionalLoading, start: CriticalPoint, side: int) -> tuple[PathPoint, Array, float]:
    """Return a bifurcation, the direction of the path that crosses there, and the first step."""
    point, equilibrium = loading.point(start.factor, start.equilibrium), start.equilibrium
    is_same = (equilibrium.model, equilibrium.loads) == (point.equilibrium.model, point.equilibrium.loads)
    if not (is_same and start.kind == "bifurcation"):
        raise InputError("is no bifurcation of a path of this model under these loads", "start")
    if abs(start.factor) >= loading.largest:
        raise InputError(f"must be beyond the start at {start.factor:g}, got {loading.largest:g}", "largest_factor")
    return point, branch_tangent(point, start.shape, side), MAX_STEP
