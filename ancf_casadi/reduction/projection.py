"""Constants of the reduced model: mass, stiffness, gravity and drag of the full model, projected once.

With the nodal coordinates e = u + P r' (``kinematics``) these are

    P^T M P = R^T R,    P^T M 1,    1^T M 1             inertia and gravity, M of one component,
    K_b = W^T K W,    f_0 = (dr'/dq)^T P^T Q_e          bending,

with the tangent stiffness K of the straight beam, the displacements W across the straight beam whose slopes are Theta,
and the elastic force Q_e at rest.  The elastic force f_0 + K_b q is linear in q because the curvature theta' is.

The drag acts at Gauss points along the whole beam.  With their masses as weights, sums over these points integrate
polynomials exactly over the mass of the elements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.reduction.kinematics import Slopes
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes


@dataclass(frozen=True, eq=False)
class Projection:
    """The constants of the reduced equation of motion.

    Parameters
    ----------
    slopes : Slopes
        The slopes that determine the shape.
    mass_factor : array (k, k)
        R with R^T R = P^T M P, upper triangular.
    mass_moment : array (k,)
        P^T M 1.
    total_mass : float
        1^T M 1, kg.
    tip_mass : float
        Mass at the tip, which has no drag, kg.
    bending_stiffness : array (m, m)
        K_b.
    rest_force : array (m,)
        f_0.
    rest_energy : float
        Strain energy at rest, J.
    drag_shape, drag_mass : array (d, k), (d,)
        Matrix from the slopes to the positions of the drag points, and the mass at each point, kg.
    """

    slopes: Slopes
    mass_factor: Array
    mass_moment: Array
    total_mass: float
    tip_mass: float
    bending_stiffness: Array
    rest_force: Array
    rest_energy: float
    drag_shape: Array
    drag_mass: Array


def project_model(modes: Modes, nodal: Slopes, selected: Slopes, drag_points: int) -> Projection:
    """Project mass, stiffness and drag of the full model.

    Parameters
    ----------
    modes : Modes
        The modes kept.
    nodal, selected : Slopes
        The slopes at all nodes and midpoints, and at the selected points.
    drag_points : int
        Number of Gauss points of the drag.
    """
    model, rest = modes.model, modes.equilibrium.coordinates
    p, beam = model.properties, model.beam
    mass = model.mass(p).full()[::2, ::2]
    moment = mass @ np.tile([1.0, 0.0], len(mass) // 2)
    across = np.kron(nodal.shape @ nodal.rotations, [[-beam.axis[1]], [beam.axis[0]]])
    jacobian = np.kron(nodal.shape, np.eye(2)) @ nodal.jacobian.reshape(-1, modes.count)
    points, weights = gauss(drag_points)
    own_mass = selected.shape.T @ mass @ selected.shape
    rounding = 1e-14 * float(own_mass.diagonal().max())  # of a mesh so coarse that it is singular
    return Projection(
        slopes=selected,
        mass_factor=np.linalg.cholesky(own_mass + rounding * np.eye(len(own_mass))).T,
        mass_moment=selected.shape.T @ moment,
        total_mass=float(moment[::2].sum()),
        tip_mass=beam.tip_mass,
        bending_stiffness=across.T @ (model.tangent_stiffness(model.straight, p).sparse() @ across),
        rest_force=jacobian.T @ model.elastic_force(rest, p).full().ravel(),
        rest_energy=float(model.strain_energy(rest, p)),
        drag_shape=np.array([model.interpolation(float(s))[0, ::2] for s in points * beam.length]) @ selected.shape,
        drag_mass=_point_masses(model, points, weights),
    )


def _point_masses(model: Model, points: Array, weights: Array) -> Array:
    """Return masses at points of [0, 1] that integrate polynomials over the mass of the elements, (d,), kg."""
    beam, degree = model.beam, len(points) - 1
    width, thickness, density, _ = model.properties
    own_points, own_weights = gauss(degree // 2 + 1)
    within = (np.arange(beam.elements)[:, None] + own_points) / beam.elements
    masses = (width * thickness * density * beam.element_length)[:, None] * own_weights
    legendre = np.polynomial.legendre.legvander
    moments = masses.ravel() @ legendre(2 * within.ravel() - 1, degree)
    return np.asarray(weights * (legendre(2 * points - 1, degree) @ (moments * (2 * np.arange(degree + 1) + 1))))
