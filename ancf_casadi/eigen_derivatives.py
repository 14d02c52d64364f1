"""Exact first and second derivatives of natural frequencies and mode shapes by the properties of the beam.

Equilibrium q and eigenpairs (lambda, phi) follow the properties p through

    R(q, p) = Q_e - Q_g = 0,    (K(q, p) - lambda M(p)) phi = 0,    phi^T M phi = 1,    K = dR/dq.

Along a change dp the equilibrium moves by K dq = -R_p dp, and with f = (K phi)_q dq + ((K - lambda M) phi)_p dp

    dlambda = phi^T f,    (K - lambda M) dphi = -f + dlambda M phi,    phi^T M dphi = -1/2 (phi^T M phi)_p dp.

K - lambda M is singular along phi alone: with the largest component of dphi held it is regular, and keeps its band
(Nelson).  For second derivatives of y = sum_k (b_k lambda_k + c_k^T phi_k) each mode has multipliers a and beta,

    (K - lambda M) a = -c + beta M phi,    beta = phi^T c,    phi^T M a = b,

and K z = -sum_k ((K phi_k)_q)^T a_k; then, with X = (q, p, phi, lambda) and its derivatives X_p,

    y_pp = X_p^T L_XX X_p,    L = y + z^T R + sum_k (a_k^T (K - lambda_k M) phi_k - beta_k/2 (phi_k^T M phi_k - 1)).

L is a sum over the elements, so its Hessian is needed for one element and one mode only.  All matrices are banded.

References
----------
R. L. Fox, M. P. Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6 (1968).
R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray

from ancf_casadi.model import NODE, Model
from ancf_casadi.parts import Part, blocks

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BAND = 2 * NODE - 1  # diagonals on either side of the main one
ONE_THREAD = 200_000  # multiplications in a product of matrices that BLAS does not share between threads


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of an equilibrium and its modes along N directions.

    Parameters
    ----------
    directions : array (properties, N)
        Changes of the properties.
    coordinates : array (4 n + 4, N)
        Of the equilibrium.
    eigenvalues : array (m, N)
        Of the squared angular frequencies.
    shapes : array (m, 4 n + 4, N)
        Of the mass-normalised mode shapes.
    """

    directions: Array
    coordinates: Array
    eigenvalues: Array
    shapes: Array


@dataclass(frozen=True, eq=False)
class ModalState:
    """An equilibrium and some of its modes, with exact derivatives.

    Parameters
    ----------
    model : Model
        The beam.
    parts : tuple of Part
        What it is made of.
    properties : array (properties,)
        Properties, ``model.properties`` row by row at first.
    coordinates : array (4 n + 4,)
        Nodal coordinates at rest.
    numbers : array of int (m,)
        Numbers of the modes in ascending order of frequency, from 0.
    eigenvalues : array (m,)
        Squared angular frequencies, (rad/s)^2.
    shapes : array (4 n + 4, m)
        Mass-normalised mode shapes.
    stiffness, mass : array (15, free)
        Tangent stiffness and mass of the free coordinates, by diagonals as LAPACK has them.
    """

    model: Model
    parts: tuple[Part, ...]
    properties: Array
    coordinates: Array
    numbers: Index
    eigenvalues: Array
    shapes: Array
    stiffness: Array
    mass: Array

    @property
    def frequencies(self) -> Array:
        """Natural frequencies, Hz."""
        return np.asarray(np.sqrt(self.eigenvalues) / (2 * np.pi))

    def slopes(self, directions: Array) -> Slopes:
        """Return the derivatives of equilibrium and modes along changes of the properties, (properties, N)."""
        free, count = self.model.free, len(self.eigenvalues)
        size, several = self.model.size, directions.shape[1]
        load = np.zeros((size, several))
        for part in self.parts:
            e, p = self._of(part)
            _, _, by_property, _ = blocks(part.piece.balance, e, p)
            np.add.at(load, part.coordinates, by_property @ directions[part.properties])
        coordinates = np.zeros((size, several))
        coordinates[free] = -scipy.linalg.cho_solve_banded(self._factors, load[free])

        pencil, norm = np.zeros((count, size, several)), np.zeros((count, several))
        for part in self.parts:
            d_properties = directions[part.properties]
            by_coordinate, by_property, of_norm = self._pencil_slopes(part)
            local = by_coordinate @ coordinates[part.coordinates] + by_property @ d_properties
            for k in range(count):
                np.add.at(pencil[k], part.coordinates, local[k])
            norm += (of_norm @ d_properties)[:, :, 0].sum(axis=1)
        eigenvalues, shapes = np.zeros((count, several)), np.zeros((count, size, several))
        for k, phi in enumerate(self.shapes[free].T):
            inertia = self.inertia @ phi
            eigenvalues[k] = phi @ pencil[k, free]
            particular = self._pencils[k].solve(np.outer(inertia, eigenvalues[k]) - pencil[k, free])
            shapes[k, free] = particular - np.outer(phi, inertia @ particular + norm[k])
        return Slopes(directions, coordinates, eigenvalues, shapes)

    def curvature(self, slopes: Slopes, of_eigenvalues: Array, of_shapes: Array) -> Array:
        """Return the second derivatives of a combination of eigenvalues and shapes along given directions.

        Parameters
        ----------
        slopes : Slopes
            First derivatives along them.
        of_eigenvalues : array (m,)
            Share b of each eigenvalue.
        of_shapes : array (m, 4 n + 4)
            Share c of the coordinates of each shape.

        Returns
        -------
        array (N, N)
        """
        free, count = self.model.free, len(self.eigenvalues)
        a, beta = np.zeros((count, self.model.size)), np.zeros(count)
        for k, phi in enumerate(self.shapes[free].T):
            inertia = self.inertia @ phi
            beta[k] = phi @ of_shapes[k, free]
            particular = self._pencils[k].solve(beta[k] * inertia - of_shapes[k, free])
            a[k, free] = particular + phi * (of_eigenvalues[k] - inertia @ particular)
        load = np.zeros(self.model.size)
        for part in self.parts:
            by_coordinate = self._pencil_slopes(part)[0]
            np.add.at(load, part.coordinates, np.einsum("kpij,kpi->pj", by_coordinate, a[:, part.coordinates]))
        z = np.zeros(self.model.size)
        z[free] = -scipy.linalg.cho_solve_banded(self._factors, load[free])

        several = slopes.directions.shape[1]
        total = np.zeros((several, several))
        for part in self.parts:
            pieces, (d, k) = len(part.coordinates), part.piece.sizes
            inputs = a[:, part.coordinates].reshape(count * pieces, d), np.repeat(beta, pieces)[:, None]
            of_modes = blocks(part.piece.pencil_curvature, *self._of_modes(part), *inputs)[0]
            of_modes = of_modes.reshape(count, pieces, *of_modes.shape[1:])
            of_forces = blocks(part.piece.force_curvature, *self._of(part), z[part.coordinates])[0]
            # unknowns of a piece: e, p, then phi and lambda of each mode
            shared, own = d + k, d + 1
            hessian = np.zeros((pieces, shared + count * own, shared + count * own))
            hessian[:, :shared, :shared] = of_forces + of_modes[:, :, :shared, :shared].sum(axis=0)
            for mode, block in enumerate(of_modes):
                here = slice(shared + mode * own, shared + (mode + 1) * own)
                hessian[:, :shared, here] = block[:, :shared, shared:]
                hessian[:, here, :shared] = block[:, shared:, :shared]
                hessian[:, here, here] = block[:, shared:, shared:]
            rows = [slopes.coordinates[part.coordinates], slopes.directions[part.properties]]
            for shape, eigenvalue in zip(slopes.shapes, slopes.eigenvalues, strict=True):
                rows += [shape[part.coordinates], np.broadcast_to(eigenvalue, (pieces, 1, several))]
            local = np.concatenate(rows, axis=1)
            total += _congruence(hessian, local)
        return (total + total.T) / 2

    @cached_property
    def _factors(self) -> tuple[Array, bool]:
        return scipy.linalg.cholesky_banded(self.stiffness[BAND:], lower=True), True

    @cached_property
    def inertia(self) -> scipy.sparse.dia_array:
        """Mass of the free coordinates, sparse."""
        return sparse(self.mass)

    @cached_property
    def _pencils(self) -> list[_Pencil]:
        return [
            _Pencil.of(self.stiffness - eigenvalue * self.mass, self.stiffness[BAND], shape)
            for eigenvalue, shape in zip(self.eigenvalues, self.shapes[self.model.free].T, strict=True)
        ]

    def _of(self, part: Part) -> tuple[Array, Array]:
        """Coordinates and properties of the pieces, as rows."""
        return self.coordinates[part.coordinates], self.properties[part.properties]

    def _of_modes(self, part: Part) -> tuple[Array, Array, Array, Array]:
        """Coordinates, properties, shapes and eigenvalues of the pieces, mode by mode, as rows."""
        count, pieces = len(self.eigenvalues), len(part.coordinates)
        e, p = self._of(part)
        phi = self.shapes.T[:, part.coordinates].reshape(count * pieces, -1)
        return np.tile(e, (count, 1)), np.tile(p, (count, 1)), phi, np.repeat(self.eigenvalues, pieces)[:, None]

    def _pencil_slopes(self, part: Part) -> list[Array]:
        """Return the outputs of ``pencil_slopes``, each (m, pieces, rows, columns)."""
        shape = len(self.eigenvalues), len(part.coordinates)
        found = blocks(part.piece.pencil_slopes, *self._of_modes(part))
        return [block.reshape(*shape, *block.shape[1:]) for block in found]


@dataclass(frozen=True, eq=False)
class _Pencil:
    """K - lambda M with one coordinate of its null vector held, rows and columns scaled."""

    banded: Array
    scale: Array
    held: int

    @classmethod
    def of(cls, pencil: Array, diagonal: Array, null: Array) -> _Pencil:
        scale = 1 / np.sqrt(diagonal)
        size, held = len(scale), int(np.abs(null / scale).argmax())
        rows = np.arange(size) - np.arange(BAND, -BAND - 1, -1)[:, None]
        inside = (rows >= 0) & (rows < size)
        banded = np.where(inside, pencil * scale * scale[np.clip(rows, 0, size - 1)], 0.0)
        banded[rows == held] = 0.0
        banded[:, held] = 0.0
        banded[BAND, held] = 1.0
        return cls(banded, scale, held)

    def solve(self, right: Array) -> Array:
        """Return the solution that is zero in the held coordinate, for a vector or columns."""
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        right = scale * right
        right[self.held] = 0.0
        return np.asarray(scale * scipy.linalg.solve_banded((BAND, BAND), self.banded, right, check_finite=False))


def sparse(banded: Array) -> scipy.sparse.dia_array:
    """Return a banded matrix as a sparse one."""
    size = banded.shape[1]
    return scipy.sparse.dia_array((banded, np.arange(BAND, -BAND - 1, -1)), shape=(size, size))


def _congruence(hessians: Array, slopes: Array) -> Array:
    """Return sum_i Z_i^T H_i Z_i, in products small enough for BLAS to use one thread.

    Threads that wait for each other cost more than they save where several processes share the cores.
    """
    rows, columns = slopes.shape[1:]
    width, height = max(1, ONE_THREAD // rows**2), max(1, ONE_THREAD // columns**2)
    products = np.concatenate([hessians @ slopes[:, :, k : k + width] for k in range(0, columns, width)], axis=2)
    left, right = slopes.reshape(-1, columns), products.reshape(-1, columns)
    total = np.zeros((columns, columns))
    for k in range(0, len(left), height):
        total += left[k : k + height].T @ right[k : k + height]
    return total
