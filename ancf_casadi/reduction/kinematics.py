"""The motions a reduced beam can make: it bends in a few modes and does not stretch.

The slope r' = stretch (cos theta, sin theta) keeps the stretch it has at rest, and its angle against the x axis is

    theta(s, t) = phi(t) + theta_0(s) + sum_k Theta_k(s) q_k(t),

with the rotation phi of the clamp, the angle theta_0 at rest, and the rotations Theta_k that the modes of the full
beam give the slope.  Positions follow by integration along the beam.  This bending is inextensible exactly, at any
amplitude; no shape for the shortening has to be found.

On the mesh the slope is taken at the 2 n + 1 nodes and midpoints, and integrated by Simpson's rule, which is exact for
the cubics of the elements: e = u + P r', P constant, gives the rest and, to first order in q, the modes of the full
beam exactly.

A few of these points suffice (empirical interpolation).  The components of r' of many bent shapes, drawn at random,
lie close to a space of few dimensions: that of the first singular vectors U of these samples.  As many points are
selected by QR with pivoting, and r' = U (U_selected)^-1 r'_selected everywhere.  The rest and the first-order motion
are samples of a large weight, so that small motion stays what it is in the full model; the selection enters the
nonlinear part alone.

References
----------
Drmac and Gugercin 2016, "A new selection operator for the discrete empirical interpolation method - improved a priori
error bound and extensions" (the selection by QR).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes

SAMPLES = 200  # bent shapes
TURN = 0.8  # rad; the rotations of the modes in a sample together, root of the sum of the squares of the largest
WEIGHT = 1e4  # of the rest and of small motion among the samples
AXIAL = 0.1  # stretch by rotation, above which a mode is no bending mode


@dataclass(frozen=True, eq=False)
class Slopes:
    """The slope at some points of the beam, and how it makes the shape of the whole.

    Parameters
    ----------
    angles : array (k,)
        theta_0, angle of the slope at rest, rad.
    stretches : array (k,)
        |r'| at rest.
    rotations : array (k, m)
        Theta, rotation of the slope a unit of each modal coordinate, rad/(m kg^1/2).
    shape : array (2 n + 2, k), or (2 n + 4, k) behind an elastic clamp
        From one component of the slopes to that of all nodal coordinates, relative to the base.
    """

    angles: Array
    stretches: Array
    rotations: Array
    shape: Array

    @property
    def rest(self) -> Array:
        """The slopes at rest, (k, 2)."""
        return np.asarray(self.stretches * np.array([np.cos(self.angles), np.sin(self.angles)])).T

    @property
    def first_order(self) -> Array:
        """Change of the slopes a unit of each modal coordinate, at rest, (k, 2, m)."""
        x, y = self.rest.T
        return np.stack([-y[:, None] * self.rotations, x[:, None] * self.rotations], axis=1)


def slopes_of(modes: Modes) -> Slopes:
    """Return the slopes at all nodes and midpoints of the mesh.

    Raises
    ------
    InputError
        If one of the modes stretches the beam.
    """
    model, length = modes.model, modes.model.beam.length
    elements = model.beam.elements
    places = np.linspace(0.0, length, 2 * elements + 1)
    interpolation = np.array([model.slope_interpolation(min(float(s), length)) for s in places])
    rest, change = interpolation @ modes.equilibrium.coordinates, interpolation @ modes.shapes
    (x, y), square = rest.T, (rest**2).sum(axis=1)
    base = model.root  # behind an elastic clamp the base has a slope of its own, which only turns with the base
    rotations = (x[:, None] * change[:, 1] - y[:, None] * change[:, 0]) / square[:, None]
    stretching = (x[:, None] * change[:, 0] + y[:, None] * change[:, 1]) / square[:, None]
    axial = np.abs(stretching).max(axis=0) > AXIAL * np.abs(rotations).max(axis=0)
    if axial.any():
        raise InputError(f"mode {axial.argmax() + 1} stretches the beam; keep fewer", "modes")
    angles = np.unwrap(np.concatenate([[np.arctan2(*model.beam.axis[::-1])] * base, np.arctan2(y, x)]))
    return Slopes(
        angles,
        np.concatenate([np.ones(base), np.sqrt(square)]),
        np.vstack([np.zeros((base, modes.count)), rotations]),
        _simpson(model),
    )


def selected(slopes: Slopes, points: int) -> Slopes:
    """Return the slopes at the few points, more than modes, that tell those at all points best."""
    count, m = slopes.rotations.shape
    largest = TURN / np.sqrt(m) / np.abs(slopes.rotations).max(axis=0)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, m)) * largest
    angles = slopes.angles + q @ slopes.rotations.T
    samples = np.vstack([slopes.stretches * np.cos(angles), slopes.stretches * np.sin(angles)])
    small = np.concatenate([slopes.rest[:, :, None], slopes.first_order * largest], axis=2).reshape(count, -1)
    basis = scipy.linalg.svd(np.column_stack([WEIGHT * small, samples.T]), full_matrices=False)[0][:, :points]
    rows = np.sort(scipy.linalg.qr(basis.T, pivoting=True, mode="r")[1][:points])
    return Slopes(
        slopes.angles[rows],
        slopes.stretches[rows],
        slopes.rotations[rows],
        np.linalg.solve(basis[rows].T, (slopes.shape @ basis).T).T,
    )


def _simpson(model: Model) -> Array:
    """From slopes at nodes and midpoints to positions and slopes of the nodes, (2 n + 2, 2 n + 1) and the base."""
    elements, l = model.beam.elements, model.beam.element_length
    base, shape = model.root, np.zeros((2 * elements + 2, 2 * elements + 1))
    nodes = np.arange(elements + 1)
    shape[2 * nodes + 1, 2 * nodes] = 1.0
    for i in range(elements):
        shape[2 * i + 2] = shape[2 * i]
        shape[2 * i + 2, 2 * i : 2 * i + 3] += l / 6 * np.array([1.0, 4.0, 1.0])
    return np.asarray(scipy.linalg.block_diag(*[np.array([[0.0], [1.0]])] * base, shape))
