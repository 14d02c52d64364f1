"""Exact first and second derivatives of natural frequencies and mode shapes by the properties of the beam.

Equilibrium q and eigenpairs (lambda, phi) follow the properties p through

    R(q, p) = Q_e - Q_g = 0,    (K(q, p) - lambda M(p)) phi = 0,    phi^T M phi = 1,    K = dR/dq.

Along a change dp the equilibrium moves by K dq = -R_p dp, and with f = (K phi)_q dq + ((K - lambda M) phi)_p dp

    dlambda = phi^T f,    (K - lambda M) dphi = -f + dlambda M phi,    phi^T M dphi = -1/2 (phi^T M phi)_p dp.

K - lambda M is singular along phi alone: with the largest component of dphi held it is regular, and keeps its band
(Nelson).  For second derivatives of y = sum_k (b_k lambda_k + c_k^T phi_k) each mode has multipliers a and beta,

    (K - lambda M) a = -c + beta M phi,    beta = phi^T c,    phi^T M a = b,

and K z = -sum_k ((K phi_k)_q)^T a_k.  The derivative by the properties is then, for any number of them,

    y_p = z^T R_p + sum_k (a_k^T ((K - lambda_k M) phi_k)_p - beta_k/2 (phi_k^T M phi_k)_p),

at the cost of one solution for each mode.  With X = (q, p, phi, lambda), its derivatives X_p and

    L = y + z^T R + sum_k (a_k^T (K - lambda_k M) phi_k - beta_k/2 (phi_k^T M phi_k - 1)),

and with u = (q, p), v = (phi, lambda), the second derivatives are

    y_pp = B + B^T + v_p^T L_vv v_p,    B = u_p^T (1/2 L_uu u_p + L_uv v_p),    u_p^T Y = Y_p - R_p^T K^-1 Y_q,

    v_p^T L_vv v_p = -sum_k (beta_k phi_p^T M phi_p + lambda_p^T (a_k^T M phi_p) + (a_k^T M phi_p)^T lambda_p).

L is a sum over the elements, so its Hessian is needed for one element and one mode only.  All matrices are banded: the
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

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import factorised, sparse
from ancf_casadi.vibration.assembly import BAND, Position, Structure
from ancf_casadi.vibration.parts import Part, blocks

COLUMNS = 128  # directions taken at once, which products of small matrices hold in cache


@dataclass(frozen=True, eq=False)
class Sensitivities:
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

    def sensitivities(self, directions: Array) -> Sensitivities:
        """Return the derivatives of equilibrium and modes along changes of the properties, (properties, N)."""
        free, count = self.model.free, len(self.eigenvalues)
        size, several = self.model.size, directions.shape[1]
        load, pencil, norm = np.zeros((size, several)), np.zeros((count, size, several)), np.zeros((count, several))
        for part, force_by_property in self._force_jacobians:
            load += _sum(part.coordinates, force_by_property @ directions[part.properties], size)
        coordinates = np.zeros((size, several))
        coordinates[free] = -self._solve(load[free])
        for part, by_coordinate, by_property, of_norm in self._pencil_jacobians:
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
        return Sensitivities(directions, coordinates, eigenvalues, shapes)

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
        return self._by_properties(*self._multipliers(of_eigenvalues, of_shapes))

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
        free, several = self.model.free, directions.shape[1]
        along = scipy.sparse.csr_array(directions).T
        a, beta, z = self._multipliers(of_eigenvalues[:, None], of_shapes[:, :, None])
        blocks_of_u = self._lagrangian_blocks(a, beta, z)
        half, of_norm = np.empty((several, several)), np.zeros((several, several))
        seen, eigenvalues = np.empty((2, len(beta), several))
        kept: list[Array] = []
        for begin in range(0, several, COLUMNS):
            columns = slice(begin, begin + COLUMNS)
            sensitivities = self.sensitivities(directions[:, columns])
            half[:, columns] = np.asarray(along @ self._curvature_along(sensitivities, blocks_of_u))
            eigenvalues[:, columns] = sensitivities.eigenvalues
            for k, shapes in enumerate(sensitivities.shapes[:, free]):
                seen[k, columns] = (self.inertia @ a[k, free, 0]) @ shapes
            if beta.any():
                kept.append(sensitivities.shapes[:, free])
        if kept:
            for k, shapes in enumerate(np.concatenate(kept, axis=2)):
                of_norm -= beta[k] * shapes.T @ (self.inertia @ shapes)
        half -= eigenvalues.T @ seen
        return half + half.T + of_norm

    def _lagrangian_blocks(self, a: Array, beta: Array, z: Array) -> list[tuple[Part, Array]]:
        """Return 1/2 L_uu and L_uv of the pieces side by side, each (pieces, d + k, d + k + m (d + 1))."""
        count, found = len(self.eigenvalues), []
        for part in self.structure.parts:
            pieces, shared = len(part.coordinates), sum(part.piece.sizes)
            (of_forces,) = blocks(part.piece.force_curvature, *self._of(part), z[part.coordinates, 0])
            inputs = a[:, part.coordinates, 0].reshape(count * pieces, -1), np.repeat(beta, pieces)[:, None]
            (of_modes,) = blocks(part.piece.pencil_curvature, *self._of_modes(part), *inputs)
            of_modes = of_modes.reshape(count, pieces, *of_modes.shape[1:])[:, :, :shared]
            of_u = (of_forces + of_modes[:, :, :, :shared].sum(axis=0)) / 2
            found.append((part, np.concatenate([of_u, *of_modes[:, :, :, shared:]], axis=2)))
        return found

    def _curvature_along(self, sensitivities: Sensitivities, of_u: list[tuple[Part, Array]]) -> Array:
        """Return u_p^T (1/2 L_uu u_p + L_uv v_p) along some directions, by all the properties, (properties, N)."""
        free, several = self.model.free, sensitivities.directions.shape[1]
        of_coordinates, total = np.zeros_like(sensitivities.coordinates), np.zeros_like(sensitivities.directions)
        for part, block in of_u:
            d = part.piece.sizes[0]
            rows = [sensitivities.coordinates[part.coordinates], sensitivities.directions[part.properties]]
            for shape, eigenvalue in zip(sensitivities.shapes, sensitivities.eigenvalues, strict=True):
                rows += [shape[part.coordinates], np.broadcast_to(eigenvalue, (len(block), 1, several))]
            local = block @ np.concatenate(rows, axis=1)
            of_coordinates += _sum(part.coordinates, local[:, :d], self.model.size)
            total += _sum(part.properties, local[:, d:], len(total))
        z = np.zeros_like(of_coordinates)
        z[free] = -self._solve(of_coordinates[free])
        for part, force_by_property in self._force_jacobians:
            total += _sum(part.properties, force_by_property.transpose(0, 2, 1) @ z[part.coordinates], len(total))
        return total

    def _multipliers(self, b: Array, c: Array) -> tuple[Array, Array, Array]:
        """Return a (m, 4 n + 4, C), beta (m, C) and z (4 n + 4, C), column by column."""
        free = self.model.free
        a, beta = np.zeros_like(c), np.zeros_like(b)
        load, z = np.zeros((2, *c.shape[1:]))
        for k, phi in enumerate(self.shapes[free].T):
            inertia = self.inertia @ phi
            beta[k] = phi @ c[k, free]
            particular = self._pencils[k].solve(np.outer(inertia, beta[k]) - c[k, free])
            a[k, free] = particular + np.outer(phi, b[k] - inertia @ particular)
        for part, by_coordinate, _, _ in self._pencil_jacobians:
            for k, block in enumerate(by_coordinate):
                load += _sum(part.coordinates, block.transpose(0, 2, 1) @ a[k, part.coordinates], len(load))
        z[free] = -self._solve(load[free])
        return a, beta, z

    def _by_properties(self, a: Array, beta: Array, z: Array) -> Array:
        """Return y_p from the multipliers, (properties, C)."""
        total = np.zeros((self.properties.size, beta.shape[1]))
        for (part, force_by_property), (_, _, by_property, of_norm) in zip(
            self._force_jacobians, self._pencil_jacobians, strict=True
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
        return factorised(self._matrices[0]).solve

    @cached_property
    def _pencils(self) -> list[_Pencil]:
        stiffness, mass = self._matrices
        return [
            _Pencil.of(stiffness - eigenvalue * mass, stiffness[BAND], shape)
            for eigenvalue, shape in zip(self.eigenvalues, self.shapes[self.model.free].T, strict=True)
        ]

    @cached_property
    def _force_jacobians(self) -> list[tuple[Part, Array]]:
        """dR/dp of the pieces, each (pieces, d, k)."""
        return [(part, blocks(part.piece.balance, *self._of(part))[2]) for part in self.structure.parts]

    @cached_property
    def _pencil_jacobians(self) -> list[tuple[Part, Array, Array, Array]]:
        """Outputs of ``pencil_jacobians``, each (m, pieces, rows, columns)."""
        found = []
        for part in self.structure.parts:
            shape = len(self.eigenvalues), len(part.coordinates)
            outputs = blocks(part.piece.pencil_jacobians, *self._of_modes(part))
            by_coordinate, by_property, of_norm = (output.reshape(*shape, *output.shape[1:]) for output in outputs)
            found.append((part, by_coordinate, by_property, of_norm))
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
        return cls(factorised(banded).solve, scale, held)

    def solve(self, right: Array) -> Array:
        """Return the solution that is zero in the held coordinate, for columns."""
        right = np.multiply(self.scale[:, None], right, order="F")
        right[self.held] = 0.0
        return np.asarray(self.scale[:, None] * self.factors(right))


def _sum(places: Index, rows: Array, size: int) -> Array:
    """Return the sum of rows (pieces, d, C) at their places (pieces, d), (size, C)."""
    count = places.size
    at = scipy.sparse.csr_array((np.ones(count), (places.ravel(), np.arange(count))), shape=(size, count))
    return np.asarray(at @ rows.reshape(count, -1))
