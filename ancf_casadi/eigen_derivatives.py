"""Exact first and second derivatives of natural frequencies and mode shapes by the properties of the beam.

Equilibrium q and eigenpairs (lambda, phi) follow the properties p through

    R(q, p) = Q_e - Q_g = 0,    (K(q, p) - lambda M(p)) phi = 0,    phi^T M phi = 1,    K = dR/dq.

Along a change dp the equilibrium moves by K dq = -R_p dp, and with f = (K phi)_q dq + ((K - lambda M) phi)_p dp

    dlambda = phi^T f,    (K - lambda M) dphi = -f + dlambda M phi,    phi^T M dphi = -1/2 (phi^T M phi)_p dp.

K - lambda M is singular along phi alone: with the largest component of dphi held it is regular, and keeps its band
(Nelson).  For second derivatives of y = sum_k (b_k lambda_k + c_k^T phi_k) each mode has multipliers a and beta,

    (K - lambda M) a = -c + beta M phi,    beta = phi^T c,    phi^T M a = b,

and K z = -y_q - sum_k ((K phi_k)_q)^T a_k.  The derivative by the properties is then, for any number of them,

    y_p = z^T R_p + sum_k (a_k^T ((K - lambda_k M) phi_k)_p - beta_k/2 (phi_k^T M phi_k)_p),

at the cost of one solution for each mode.  With X = (q, p, phi, lambda), its derivatives X_p and

    L = y + z^T R + sum_k (a_k^T (K - lambda_k M) phi_k - beta_k/2 (phi_k^T M phi_k - 1)),

the second derivatives are y_pp = X_p^T Y, Y = L_XX X_p.  L is a sum over the elements, so its Hessian is needed for one
element and one mode only; and X_p^T Y is what y_p is for a y with the derivatives Y.  All matrices are banded, so the
work grows with the square of the number of elements.

References
----------
R. L. Fox, M. P. Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6 (1968).
R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from ancf_casadi.assembly import BAND, Array, Index, Position, Structure, factorised, sparse
from ancf_casadi.model import Model
from ancf_casadi.parts import Part, blocks

COLUMNS = 128  # directions taken at once, which products of small matrices hold in cache


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
    structure : Structure
        The beam and its properties.
    at : Position
        Where it rests.
    numbers : array of int (m,)
        Numbers of the modes in ascending order of frequency, from 0.
    eigenvalues : array (m,)
        Squared angular frequencies, (rad/s)^2.
    shapes : array (4 n + 4, m)
        Mass-normalised mode shapes.
    """

    structure: Structure
    at: Position
    numbers: Index
    eigenvalues: Array
    shapes: Array

    @property
    def model(self) -> Model:
        """The beam, whose own properties are not used."""
        return self.structure.model

    @property
    def properties(self) -> Array:
        """Properties, ``model.properties`` row by row at first."""
        return self.structure.properties

    @property
    def coordinates(self) -> Array:
        """Nodal coordinates at rest, (4 n + 4,)."""
        return self.at.coordinates

    @property
    def frequencies(self) -> Array:
        """Natural frequencies, Hz."""
        return np.asarray(np.sqrt(self.eigenvalues) / (2 * np.pi))

    @cached_property
    def inertia(self) -> scipy.sparse.csr_array:
        """Mass of the free coordinates, sparse."""
        return sparse(self._matrices[1]).tocsr()

    def slopes(self, directions: Array) -> Slopes:
        """Return the derivatives of equilibrium and modes along changes of the properties, (properties, N)."""
        free, count = self.model.free, len(self.eigenvalues)
        size, several = self.model.size, directions.shape[1]
        load, pencil, norm = np.zeros((size, several)), np.zeros((count, size, several)), np.zeros((count, several))
        for part, force_by_property in self._force_slopes:
            load += _sum(part.coordinates, force_by_property @ directions[part.properties], size)
        coordinates = np.zeros((size, several))
        coordinates[free] = -self._solve(load[free])
        for part, by_coordinate, by_property, of_norm in self._pencil_slopes:
            moved, changed = coordinates[part.coordinates], directions[part.properties]
            for k in range(count):
                local = by_coordinate[k] @ moved + by_property[k] @ changed
                pencil[k] += _sum(part.coordinates, local, size)
                norm[k] += (of_norm[k] @ changed).sum(axis=(0, 1))
        eigenvalues, shapes = np.zeros((count, several)), np.zeros((count, size, several))
        for k, phi in enumerate(self.shapes[free].T):
            inertia = self.inertia @ phi
            eigenvalues[k] = phi @ pencil[k, free]
            particular = self._pencils[k].solve(np.outer(inertia, eigenvalues[k]) - pencil[k, free])
            shapes[k, free] = particular - np.outer(phi, inertia @ particular + norm[k])
        return Slopes(directions, coordinates, eigenvalues, shapes)

    def gradient(self, of_eigenvalues: Array, of_shapes: Array) -> Array:
        """Return the derivatives of combinations of eigenvalues and shapes by all the properties.

        Parameters
        ----------
        of_eigenvalues : array (m, C)
            Share b of each eigenvalue, one column for each combination.
        of_shapes : array (m, 4 n + 4, C)
            Share c of the coordinates of each shape.

        Returns
        -------
        array (properties, C)
        """
        none = np.zeros((self.model.size, of_eigenvalues.shape[1]))
        return self._by_properties(*self._multipliers(of_eigenvalues, of_shapes, none))

    def curvature(self, directions: Array, of_eigenvalues: Array, of_shapes: Array) -> Array:
        """Return the second derivatives of one combination of eigenvalues and shapes along given directions.

        Parameters
        ----------
        directions : array (properties, N)
            Changes of the properties.
        of_eigenvalues : array (m,)
            Share b of each eigenvalue.
        of_shapes : array (m, 4 n + 4)
            Share c of the coordinates of each shape.

        Returns
        -------
        array (N, N)
        """
        hessians = self._lagrangian_hessians(of_eigenvalues, of_shapes)
        several, along = directions.shape[1], scipy.sparse.csr_array(directions).T
        total = np.empty((several, several))
        for begin in range(0, several, COLUMNS):
            columns = slice(begin, begin + COLUMNS)
            total[:, columns] = along @ self._curvature_along(directions[:, columns], hessians)
        return (total + total.T) / 2

    def _lagrangian_hessians(self, of_eigenvalues: Array, of_shapes: Array) -> list[tuple[Part, Array, Array]]:
        """Return L_XX of the pieces: by (e, p) of the forces, and by (e, p, phi, lambda) of each mode."""
        count = len(self.eigenvalues)
        none = np.zeros((self.model.size, 1))
        a, beta, z = self._multipliers(of_eigenvalues[:, None], of_shapes[:, :, None], none)
        found = []
        for part in self.structure.parts:
            pieces = len(part.coordinates)
            (of_forces,) = blocks(part.piece.force_curvature, *self._of(part), z[part.coordinates, 0])
            inputs = a[:, part.coordinates, 0].reshape(count * pieces, -1), np.repeat(beta, pieces)[:, None]
            (of_modes,) = blocks(part.piece.pencil_curvature, *self._of_modes(part), *inputs)
            found.append((part, of_forces, of_modes.reshape(count, pieces, *of_modes.shape[1:])))
        return found

    def _curvature_along(self, directions: Array, hessians: list[tuple[Part, Array, Array]]) -> Array:
        """Return y_pp along some directions by all the properties, (properties, N)."""
        slopes, size = self.slopes(directions), self.model.size
        of_shapes, of_eigenvalues = np.zeros_like(slopes.shapes), np.zeros_like(slopes.eigenvalues)
        of_coordinates, of_properties = np.zeros_like(slopes.coordinates), np.zeros_like(directions)
        for part, of_forces, of_modes in hessians:
            d, shared = part.piece.sizes[0], sum(part.piece.sizes)
            moved = np.concatenate([slopes.coordinates[part.coordinates], directions[part.properties]], axis=1)
            by_shared = of_forces @ moved
            for k, of_mode in enumerate(of_modes):
                eigenvalue = np.broadcast_to(slopes.eigenvalues[k], (len(moved), 1, directions.shape[1]))
                local = np.concatenate([moved, slopes.shapes[k, part.coordinates], eigenvalue], axis=1)
                by_all = of_mode @ local
                by_shared += by_all[:, :shared]
                of_shapes[k] += _sum(part.coordinates, by_all[:, shared:-1], size)
                of_eigenvalues[k] += by_all[:, -1].sum(axis=0)
            of_coordinates += _sum(part.coordinates, by_shared[:, :d], size)
            of_properties += _sum(part.properties, by_shared[:, d:], len(directions))
        return of_properties + self._by_properties(*self._multipliers(of_eigenvalues, of_shapes, of_coordinates))

    def _multipliers(self, b: Array, c: Array, of_coordinates: Array) -> tuple[Array, Array, Array]:
        """Return a (m, 4 n + 4, C), beta (m, C) and z (4 n + 4, C), column by column."""
        free = self.model.free
        a, beta, z = np.zeros_like(c), np.zeros_like(b), np.zeros_like(of_coordinates)
        for k, phi in enumerate(self.shapes[free].T):
            inertia = self.inertia @ phi
            beta[k] = phi @ c[k, free]
            particular = self._pencils[k].solve(np.outer(inertia, beta[k]) - c[k, free])
            a[k, free] = particular + np.outer(phi, b[k] - inertia @ particular)
        load = of_coordinates.copy()
        for part, by_coordinate, _, _ in self._pencil_slopes:
            for k, block in enumerate(by_coordinate):
                load += _sum(part.coordinates, block.transpose(0, 2, 1) @ a[k, part.coordinates], len(load))
        z[free] = -self._solve(load[free])
        return a, beta, z

    def _by_properties(self, a: Array, beta: Array, z: Array) -> Array:
        """Return y_p from the multipliers, (properties, C)."""
        total = np.zeros((self.properties.size, beta.shape[1]))
        for (part, force_by_property), (_, _, by_property, of_norm) in zip(
            self._force_slopes, self._pencil_slopes, strict=True
        ):
            local = force_by_property.transpose(0, 2, 1) @ z[part.coordinates]
            for k in range(len(beta)):
                local += by_property[k].transpose(0, 2, 1) @ a[k, part.coordinates]
                local -= of_norm[k].transpose(0, 2, 1) * beta[k]
            total += _sum(part.properties, local, len(total))
        return total

    @cached_property
    def _matrices(self) -> tuple[Array, Array]:
        """Stiffness and mass of the free coordinates by diagonals."""
        _, stiffness, mass = self.structure.balance(self.at)
        return stiffness, mass

    @cached_property
    def _solve(self) -> Callable[[Array], Array]:
        return factorised(self._matrices[0])

    @cached_property
    def _pencils(self) -> list[_Pencil]:
        stiffness, mass = self._matrices
        return [
            _Pencil.of(stiffness - eigenvalue * mass, stiffness[BAND], shape)
            for eigenvalue, shape in zip(self.eigenvalues, self.shapes[self.model.free].T, strict=True)
        ]

    @cached_property
    def _force_slopes(self) -> list[tuple[Part, Array]]:
        """dR/dp of the pieces, each (pieces, d, k)."""
        return [(part, blocks(part.piece.balance, *self._of(part))[2]) for part in self.structure.parts]

    @cached_property
    def _pencil_slopes(self) -> list[tuple[Part, Array, Array, Array]]:
        """Outputs of ``pencil_slopes``, each (m, pieces, rows, columns)."""
        found = []
        for part in self.structure.parts:
            shape = len(self.eigenvalues), len(part.coordinates)
            outputs = blocks(part.piece.pencil_slopes, *self._of_modes(part))
            found.append((part, *(output.reshape(*shape, *output.shape[1:]) for output in outputs)))
        return found

    def _of(self, part: Part) -> tuple[Array, Array]:
        """Coordinates and properties of the pieces, as rows."""
        return self.structure.of_part(part, self.at)

    def _of_modes(self, part: Part) -> tuple[Array, Array, Array, Array]:
        """Coordinates, properties, shapes and eigenvalues of the pieces, mode by mode, as rows."""
        count, pieces = len(self.eigenvalues), len(part.coordinates)
        e, p = self._of(part)
        phi = self.shapes.T[:, part.coordinates].reshape(count * pieces, -1)
        return np.tile(e, (count, 1)), np.tile(p, (count, 1)), phi, np.repeat(self.eigenvalues, pieces)[:, None]


@dataclass(frozen=True, eq=False)
class _Pencil:
    """K - lambda M with one coordinate of its null vector held, rows and columns scaled, as its factors."""

    factors: Callable[[Array], Array]
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
        return cls(factorised(banded), scale, held)

    def solve(self, right: Array) -> Array:
        """Return the solution that is zero in the held coordinate, for columns."""
        right = self.scale[:, None] * right
        right[self.held] = 0.0
        return np.asarray(self.scale[:, None] * self.factors(right))


def _sum(places: Index, rows: Array, size: int) -> Array:
    """Return the sum of rows (pieces, d, C) at their places (pieces, d), (size, C)."""
    count = places.size
    at = scipy.sparse.csr_array((np.ones(count), (places.ravel(), np.arange(count))), shape=(size, count))
    return np.asarray(at @ rows.reshape(count, -1))
