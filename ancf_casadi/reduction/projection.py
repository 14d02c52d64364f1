"""Projection of the full beam on bending in a few modes, without stretching.

One clamp or pin holds the beam at its beginning; for others see ``condensed``.

The slope r' = lambda (cos theta, sin theta) keeps the length lambda it has at rest.  Its angle to the x axis is

    theta(s, t) = phi(t) + theta_0(s) + sum_k Theta_k(s) q_k(t),

with the rotation phi of the base, the angle theta_0 at rest, and the rotation Theta_k of the slope in mode k of the
full beam.  Integration along the beam gives the positions.  The beam therefore keeps its length exactly, at any
amplitude, and needs no separate function for the shortening of its projection.

Mesh.  The slopes at the 2 n + 1 nodes and midpoints are integrated by Simpson's rule, which is exact for the cubic
elements.  The nodal coordinates are e = u + P r' with a constant matrix P and the displacement u of the clamp.  The
state at rest and, to first order in q, the modes of the full beam are exact.

Selected points.  The slopes at a few points determine all others (discrete empirical interpolation).  Random bent
shapes give snapshots of r'.  The snapshots lie close to the space of their leading left singular vectors U.  QR with
pivoting selects as many points as there are vectors, and r' = U (U_selected)^-1 r'_selected holds at all points.  The
state at rest and the first-order motion are snapshots of large weight, so the interpolation error affects large motion
only.

Constants.  With the nodal coordinates e = u + P r', mass, stiffness, gravity and drag of the full model are projected
once,

    P^T M P = R^T R,    P^T M 1,    1^T M 1             inertia and gravity, M of one component,
    K_b = int E I Theta'^T Theta' ds + sum_j k_j Theta(s_j)^T Theta(s_j),    f_0 = (dr'/dq)^T P^T Q_e    bending,

with the slopes Theta of the modes as rotations of a straight beam, k of the torsional springs between beam and base at
the points s_j, and the elastic force Q_e at rest, without that of the springs.  The elastic force f_0 + K_b q is linear
in q because the curvature theta' is.

The drag acts at Gauss points along the whole beam.  With their masses as weights, sums over these points integrate
polynomials exactly over the mass of the elements.

References
----------
Drmac and Gugercin 2016, "A new selection operator for the discrete empirical interpolation method - improved a priori
error bound and extensions" (the selection by QR).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.attachments import Dashpot, PointMass, RotationalSpring, Spring
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import gauss
from ancf_casadi.mechanics.supports import Clamp
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.modes import Modes


@dataclass(frozen=True, eq=False)
class Slopes:
    """Nodal slopes at points of the beam, and the shape that they determine."""

    angles: Array  # theta_0 of the slope at rest, (k,), rad
    lengths: Array  # lambda of the slope, which is constant, (k,)
    rotations: Array  # Theta of the slope per unit modal coordinate, (k, m), rad/(m kg^1/2)
    shape: Array  # P, for one component of the coordinates, (2 n + 2, k), or (2 n + 4, k) with a node of the base
    rows: Index  # places among the nodes and midpoints, (k,); a node of the base comes first

    @property
    def at_rest(self) -> Array:
        """The slopes at rest, (k, 2)."""
        return np.asarray(self.lengths * np.array([np.cos(self.angles), np.sin(self.angles)])).T

    @property
    def jacobian(self) -> Array:
        """Jacobian of the slopes with respect to the modal coordinates, at rest, (k, 2, m)."""
        x, y = self.at_rest.T
        return np.stack([-y[:, None] * self.rotations, x[:, None] * self.rotations], axis=1)


def begins_open(model: Model) -> bool:
    """Return whether one clamp or pin holds the beam at its beginning, undisplaced, and no other support."""
    own = [(one.point, one.sliding, *one.displacement) for one in model.beam.supports]
    return own == [(0.0, None, 0.0, 0.0)]


def nodal_slopes(modes: Modes) -> Slopes:
    """Return the slopes at all nodes and midpoints of the mesh."""
    model, beam = modes.model, modes.model.beam
    points = np.interp(np.arange(2 * beam.elements + 1) / 2, np.arange(beam.elements + 1), beam.node_points)
    interpolation = np.array([model.slope_interpolation(s) for s in points.tolist()])
    rest, change = interpolation @ modes.equilibrium.coordinates, interpolation @ modes.shapes
    (x, y), square = rest.T, (rest**2).sum(axis=1)
    rotations = (x[:, None] * change[:, 1] - y[:, None] * change[:, 0]) / square[:, None]
    strains = (x[:, None] * change[:, 0] + y[:, None] * change[:, 1]) / square[:, None]
    # axial strain per unit rotation; a mode with more is not a bending mode
    axial = np.abs(strains).max(axis=0) > 0.1 * np.abs(rotations).max(axis=0)
    if axial.any():
        raise InputError(
            f"mode {axial.argmax() + 1} stretches the beam, and the reduced model only bends; keep fewer modes", "modes"
        )
    root = model.root  # 1 if the base has its own slope, which turns with phi alone
    angles = np.concatenate([[np.arctan2(*beam.axis[::-1])] * root, np.arctan2(y, x)])
    return Slopes(
        angles=np.unwrap(angles),
        lengths=np.concatenate([np.ones(root), np.sqrt(square)]),
        rotations=np.vstack([np.zeros((root, modes.count)), rotations]),
        shape=_simpson(model),
        rows=np.arange(root + len(points)),
    )


def select_points(slopes: Slopes, count: int, rows: Index | None = None) -> Slopes:
    """Return the slopes at the ``count`` points, or at given ones, that best determine all slopes; more than modes."""
    points, m = slopes.rotations.shape
    # rad, of the slope in a snapshot: root of the sum of squares over the modes
    largest = 0.8 / np.sqrt(m) / np.abs(slopes.rotations).max(axis=0)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (200, m)) * largest  # random bent shapes
    angles = slopes.angles + q @ slopes.rotations.T
    bent = np.vstack([slopes.lengths * np.cos(angles), slopes.lengths * np.sin(angles)])
    first_order = np.concatenate([slopes.at_rest[:, :, None], slopes.jacobian * largest], axis=2).reshape(points, -1)
    # weight of the state at rest and of the first-order motion among the snapshots
    snapshots = np.column_stack([1e4 * first_order, bent.T])
    basis = scipy.linalg.svd(snapshots, full_matrices=False)[0][:, :count]
    if rows is None:
        rows = np.sort(scipy.linalg.qr(basis.T, pivoting=True, mode="r")[1][:count])
    return Slopes(
        angles=slopes.angles[rows],
        lengths=slopes.lengths[rows],
        rotations=slopes.rotations[rows],
        shape=np.linalg.solve(basis[rows].T, (slopes.shape @ basis).T).T,
        rows=rows,
    )


def _simpson(model: Model) -> Array:
    """Return P, from the slopes at nodes and midpoints (and of a node of the base) to the nodal coordinates."""
    elements = model.beam.elements
    shape = np.zeros((2 * elements + 2, 2 * elements + 1))
    nodes = np.arange(elements + 1)
    shape[2 * nodes + 1, 2 * nodes] = 1.0
    for i, l in enumerate(model.beam.element_lengths.tolist()):
        shape[2 * i + 2] = shape[2 * i]
        shape[2 * i + 2, 2 * i : 2 * i + 3] += l / 6 * np.array([1.0, 4.0, 1.0])
    return np.asarray(scipy.linalg.block_diag(*[np.array([[0.0], [1.0]])] * model.root, shape))


@dataclass(frozen=True, eq=False)
class Joined:
    """Points of the beam that springs or dashpots join to the base."""

    shape: Array  # from the parts to the positions of the points, (d, k)
    places: Array  # of the points without load, which the base keeps as it turns, (d, 2), m
    coefficients: Array  # along x and y, (d, 2), N/m or N s/m


@dataclass(frozen=True, eq=False)
class Projection:
    """Constants of any reduced equation of motion, for coordinates e = u + P r with parts r (k,) of each component."""

    shape: Array  # P, for one component of the coordinates, (size/2, k)
    mass_factor: Array  # R with R^T R = P^T M P, upper triangular, (k, k) or with fewer rows
    mass_moment: Array  # P^T M 1, (k,)
    total_mass: float  # 1^T M 1, kg
    lumped_shape: Array  # from the parts to the coordinates of point masses and rotary inertias, (l, k)
    lumped_mass: Array  # of these coordinates, which have no drag, (l,), kg or kg m^2
    lumped_moved: Array  # 1 for a position, which the base displaces, and 0 for a slope, (l,)
    springs: Joined
    dashpots: Joined
    drag_shape: Array  # from the parts to the positions of the drag points, (d, k)
    drag_mass: Array  # at each of these points, (d,), kg


@dataclass(frozen=True, eq=False)
class SlopeProjection(Projection):
    """The constants of the equation of motion of a beam that does not stretch; the parts are slopes."""

    slopes: Slopes  # those that determine the shape
    bending_stiffness: Array  # K_b, (m, m)
    rest_force: Array  # f_0, (m,)
    rest_energy: float  # strain energy at rest, without that of the springs, J


def projected_constants(model: Model, shape: Array, drag_points: int) -> dict[str, Any]:
    """Return the fields of ``Projection`` but the factor of the mass, for a given P (size/2, k)."""
    mass, lumped = component_mass(model), _lumped_rows(model)
    moment = mass @ np.tile([1.0, 0.0], len(mass) // 2)
    points, weights = gauss(drag_points)
    return {
        "shape": shape,
        "mass_moment": shape.T @ moment,
        "total_mass": float(moment[::2].sum()),
        "lumped_shape": shape[[row for row, _ in lumped]],
        "lumped_mass": np.array([value for _, value in lumped]),
        "lumped_moved": np.array([1.0 - row % 2 for row, _ in lumped]),
        "springs": _joined(model, shape, Spring, "stiffness"),
        "dashpots": _joined(model, shape, Dashpot, "coefficient"),
        "drag_shape": np.array([model.interpolation(float(s))[0, ::2] for s in points * model.beam.length]) @ shape,
        "drag_mass": _point_masses(model, points, weights),
    }


def component_mass(model: Model) -> Array:
    """Return M of one component of the coordinates, (size/2, size/2)."""
    return np.asarray(model.mass(model.properties).full()[::2, ::2])


def project_model(modes: Modes, nodal: Slopes, selected: Slopes, drag_points: int) -> SlopeProjection:
    """Project the full model on the modes, by the slopes at all nodes and midpoints and at the selected points."""
    model, rest = modes.model, modes.equilibrium.coordinates
    constants = projected_constants(model, selected.shape, drag_points)
    jacobian = np.kron(nodal.shape, np.eye(2)) @ nodal.jacobian.reshape(-1, modes.count)
    own_mass = selected.shape.T @ component_mass(model) @ selected.shape
    rounding = 1e-14 * float(own_mass.diagonal().max())  # of a mesh so coarse that it is singular
    springs, force = constants["springs"], model.elastic_force(rest, model.properties).full().ravel()
    at_rest = springs.shape @ selected.at_rest - springs.places
    rows = [model.nodes_of(one.point)[:2] for one in model.beam.attachments if isinstance(one, Spring)]
    np.subtract.at(force, np.array(rows, dtype=int).reshape(-1, 2), springs.coefficients * at_rest)
    by_springs = float((springs.coefficients * at_rest**2).sum()) / 2
    return SlopeProjection(
        **constants,
        mass_factor=np.asarray(np.linalg.cholesky(own_mass + rounding * np.eye(len(own_mass))).T),
        slopes=selected,
        bending_stiffness=_bending_stiffness(model, nodal),
        rest_force=jacobian.T @ force,
        rest_energy=float(model.strain_energy(rest, model.properties)) - by_springs,
    )


def _bending_stiffness(model: Model, nodal: Slopes) -> Array:
    """Return K_b, the integral of E I Theta'^2, with the torsional springs between beam and base."""
    beam, across = model.beam, nodal.shape @ nodal.rotations
    points = [s for index in range(beam.elements) for s in model.gauss_points(index)]
    curvature = np.array([model.curvature_interpolation(s)[0, ::2] for s in points]) @ across
    width, thickness, _, modulus = model.properties
    stiffness = np.kron(modulus * width * thickness**3 / 12 * beam.element_lengths, gauss(2)[1])
    turning = [one for one in (*beam.supports, *beam.attachments) if isinstance(one, RotationalSpring)
               or (isinstance(one, Clamp) and one.stiffness < math.inf)]  # fmt: skip
    rotation = across[[model.nodes_of(one.point)[2] // 2 for one in turning]]
    own = np.array([one.stiffness for one in turning])
    return np.asarray((curvature.T * stiffness) @ curvature + (rotation.T * own) @ rotation)


def _lumped_rows(model: Model) -> list[tuple[int, float]]:
    """Return the rows, in one component of the coordinates, of point masses and rotary inertias, with their values."""
    masses = [one for one in model.beam.attachments if isinstance(one, PointMass)]
    values = [(model.nodes_of(one.point)[2 * k] // 2, value) for one in masses
              for k, value in enumerate((one.mass, one.rotary_inertia)) if value]  # fmt: skip
    return [(int(row), value) for row, value in values]


def _joined(model: Model, shape: Array, kind: type[Spring | Dashpot], attribute: str) -> Joined:
    """Return the points that attachments of a kind join to the base."""
    own = [one for one in model.beam.attachments if isinstance(one, kind)]
    nodes = np.array([model.nodes_of(one.point)[:2] for one in own], dtype=int).reshape(-1, 2)
    values = np.array([getattr(one, attribute) for one in own]).reshape(-1, 2)
    return Joined(shape[nodes[:, 0] // 2], model.straight[nodes], values)


def _point_masses(model: Model, points: Array, weights: Array) -> Array:
    """Return masses at points of [0, 1] that integrate polynomials over the mass of the elements, (d,), kg."""
    beam, degree = model.beam, len(points) - 1
    width, thickness, density, _ = model.properties
    own_points, own_weights = gauss(degree // 2 + 1)
    within = (beam.node_points[:-1, None] + beam.element_lengths[:, None] * own_points) / beam.length
    masses = (width * thickness * density * beam.element_lengths)[:, None] * own_weights
    legendre = np.polynomial.legendre.legvander
    moments = masses.ravel() @ legendre(2 * within.ravel() - 1, degree)
    return np.asarray(weights * (legendre(2 * points - 1, degree) @ (moments * (2 * np.arange(degree + 1) + 1))))
