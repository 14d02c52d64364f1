"""Static equilibrium under gravity and loads at the tip.

At rest the elastic force balances the loads, for all free coordinates:

    R(e, s) = Q_e(e) - s (Q_g + S(L)^T F + m dtheta/de) = 0,      theta = atan2(tau_y, tau_x) at the tip,

with tip force F, tip moment m (positive counterclockwise) and load factor s = 1.  The moment follows the tip's slope,
so it has a part in the tangent stiffness dR/de.

Newton's method converges from a neighbouring equilibrium.  The load factor therefore grows from 0, where the beam is
straight, in steps that keep the turn of every slope small; a step that fails or turns too far is halved, so that the
path is followed rather than another equilibrium found.  The path of the discrete beam ends where an element bends by
0.6 rad or so: two Gauss points no longer hold a cubic that curved (measured for a pure end moment with 5 to 10
elements).  What the loads make unstable (a standing beam beyond buckling) is still an equilibrium:
``Equilibrium.is_stable`` tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.inputs import check_instance, number, vector
from ancf_casadi.model import NODE, Model

NEWTON_ITERATIONS = 12
NEWTON_TOLERANCE = 1e-11  # of the beam's length (positions) and of 1 (slopes)
LARGEST_TURN = 0.5  # change of a slope in one load step
SMALLEST_STEP = 1e-5  # of the load
MOST_TRIALS = 500  # of load steps; a path that needs more crawls towards a fold


@dataclass(frozen=True)
class Equilibrium:
    """A beam at rest.

    Parameters
    ----------
    model : Model
        The beam.
    coordinates : array (4 n + 4,)
        Nodal coordinates, m and 1.
    tip_force : (float, float)
        Force at the tip, N.
    tip_moment : float
        Moment at the tip, counterclockwise, N m.
    """

    model: Model
    coordinates: NDArray[np.float64]
    tip_force: tuple[float, float] = (0.0, 0.0)
    tip_moment: float = 0.0

    def position(self, s: float) -> NDArray[np.float64]:
        """Return the position of the point at arc length ``s`` (m), (2,), m.

        Raises
        ------
        InputError
            If the point is not on the beam.
        """
        return self.model.interpolation(s) @ self.coordinates

    @property
    def tip(self) -> NDArray[np.float64]:
        """Position of the tip (x, y), m."""
        return self.coordinates[-NODE:-2]

    @property
    def tip_angle(self) -> float:
        """Angle of the tip's slope against the x axis, rad, in (-pi, pi]."""
        return float(np.arctan2(self.coordinates[-1], self.coordinates[-2]))

    @cached_property
    def stiffness(self) -> scipy.sparse.csc_array:
        """Tangent stiffness dR/de of the free coordinates, loads included, sparse."""
        load = np.array([*self.tip_force, self.tip_moment])
        _, stiffness = _balance(self.model)(self.coordinates, load, 1.0)
        return scipy.sparse.csc_array(stiffness.sparse())

    @cached_property
    def is_stable(self) -> bool:
        """Whether the tangent stiffness is positive definite."""
        try:
            np.linalg.cholesky(self.stiffness.toarray())
        except np.linalg.LinAlgError:
            return False
        return True


def static_equilibrium(
    model: Model, *, tip_force: tuple[float, float] = (0.0, 0.0), tip_moment: float = 0.0
) -> Equilibrium:
    """Find the equilibrium that grows from the straight beam as gravity and the tip loads grow together.

    Parameters
    ----------
    model : Model
        The beam.
    tip_force : (float, float)
        Force at the tip in the laboratory frame, N.
    tip_moment : float
        Moment at the tip, positive counterclockwise, N m.

    Raises
    ------
    InputError
        If a load is not finite.
    EquilibriumError
        If the path of equilibria cannot be followed to the full load.
    """
    check_instance(model, "model", Model)
    force, moment = vector(tip_force, "tip_force"), number(tip_moment, "tip_moment")
    balance, load = _balance(model), np.array([*force, moment])
    coordinates, factor, step, trials = model.straight.copy(), 0.0, 1.0, 0
    while factor < 1.0:
        trials += 1
        trial = _newton(model, balance, load, min(factor + step, 1.0), coordinates)
        if trial is None:
            step /= 2
            if step < SMALLEST_STEP or trials > MOST_TRIALS:
                raise EquilibriumError(
                    f"no static equilibrium was found beyond {factor:.4g} of the load (tip force {force} N, tip moment "
                    f"{moment:g} N m, gravity {model.beam.gravity} m/s^2); either an element bends by more than half a "
                    "radian, which a cubic cannot follow (use more elements), the beam buckles (tilt the axis), or a "
                    "value is in the wrong unit"
                )
            continue
        coordinates, factor = trial, min(factor + step, 1.0)
        step *= 2
    return Equilibrium(model, coordinates, force, moment)


def _balance(model: Model) -> cs.Function:
    """(e, (Fx, Fy, m), s) -> R and dR/de of the free coordinates."""
    e, load, factor = cs.MX.sym("e", model.size), cs.MX.sym("load", 3), cs.MX.sym("s")
    slope = e[-2:]
    theta = cs.atan2(slope[1], slope[0])
    gravity = model.gravity_force(model.properties, model.beam.gravity)
    tip = cs.MX(model.interpolation(model.beam.length).T) @ load[:2]
    moment = load[2] * cs.gradient(theta, e)
    residual = model.elastic_force(e, model.properties) - factor * (gravity + tip + moment)
    stiffness = model.tangent_stiffness(e, model.properties) - factor * cs.jacobian(moment, e)
    return cs.Function("balance", [e, load, factor], [residual[model.free], stiffness[model.free, model.free]])


def _newton(
    model: Model, balance: cs.Function, load: NDArray[np.float64], factor: float, start: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Solve R(e, factor) = 0 from a neighbouring equilibrium; None if it does not converge or turns too far."""
    coordinates = start.copy()
    scale = model.scale[model.free]
    slopes = np.arange(model.size).reshape(-1, NODE)[:, 2:]
    for _ in range(NEWTON_ITERATIONS):
        residual, stiffness = balance(coordinates, load, factor)
        try:
            factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(stiffness.sparse()))
        except RuntimeError:  # exactly singular
            return None
        update = factors.solve(residual.full().ravel())
        if not np.isfinite(update).all():
            return None
        coordinates[model.free] -= update
        if np.abs(coordinates[slopes] - start[slopes]).max() > 2 * LARGEST_TURN:
            return None
        if np.abs(update / scale).max() < NEWTON_TOLERANCE:
            turn = np.linalg.norm(coordinates[slopes] - start[slopes], axis=1).max()
            return coordinates if turn <= LARGEST_TURN else None
    return None
