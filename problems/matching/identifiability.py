"""What measured modes tell of the properties of a beam, and what they leave open.

With the Jacobian J of the residuals by the unknowns m at the answer, its singular value decomposition J = U S V^T parts
the combinations that the data fix, the rows of V^T with a singular value, from those that they cannot see, N dm with
J N = 0.  To first order the data admit every m + dm with J dm = 0 within the bounds; the least and the largest value of
each factor among them are linear programs, min and max of t^T dm.

With standard deviations, the factors that the data fix have the covariance T (J^T J)^+ T^T, those at a bound taken as
known.  A preference whose weight is given adds its matrix to J^T J, as what was known before.

Frequencies are products of powers of global properties over wide ranges.  In logarithms the combinations of those that
the data fix therefore read as exponents: without gravity, E h^2/rho.

References
----------
G. H. Golub, C. F. Van Loan, Matrix Computations, Johns Hopkins (2013), Section 5.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linprog

from ancf_casadi.support.arrays import Array, Mask
from problems.matching.design_space import DesignSpace
from problems.matching.unknowns import Global

RANK = 1e-6  # of the largest singular value; smaller ones are not seen
FIXED = 1e-6  # share of an unknown in what the data cannot see, below which it is fixed
ORDER = (
    "elastic_modulus",
    "thickness",
    "density",
    "width",
    "tip_mass",
    "clamp_stiffness",
)  # in which exponents are reduced


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the data tell of the unknowns at an answer.

    Parameters
    ----------
    space : DesignSpace
        The unknowns and their bounds.
    values : array (N,)
        Where they are.
    jacobian : array (R, N)
        Derivatives of the residuals, in units of their standard deviations if there are any.
    prior : array (N, N)
        What was known before, the inverse of a covariance; zero if nothing.
    noisy : bool
        Whether the standard deviations are known.
    """

    space: DesignSpace
    values: Array
    jacobian: Array
    prior: Array
    noisy: bool

    @cached_property
    def singular_values(self) -> Array:
        """Singular values of J, descending."""
        return np.asarray(np.linalg.svd(self.jacobian, compute_uv=False))

    @property
    def rank(self) -> int:
        """How many combinations of the unknowns the data fix."""
        return int(np.count_nonzero(self.singular_values > RANK * self.singular_values[0]))

    @cached_property
    def fixed(self) -> Array:
        """Combinations of the unknowns that the data fix, the best known first, (rank, N)."""
        return np.linalg.svd(self.jacobian)[2][: self.rank]

    @cached_property
    def unseen(self) -> Array:
        """Combinations of the unknowns that the data cannot see, (N - rank, N)."""
        return np.linalg.svd(self.jacobian)[2][self.rank :]

    @cached_property
    def quantities(self) -> tuple[tuple[str, ...], Array]:
        """Names of the factors that may change, and their derivatives by the unknowns, (F, N)."""
        n, names, rows = self.space.beam.elements, [], []
        for unknown in self.space.unknowns:
            share = self.space.map[self.space.rows_of(unknown.name)]
            if isinstance(unknown, Global):
                names.append(unknown.name)
                rows.append(share[:1])
            else:
                names += [f"{unknown.name}[{i + 1}]" for i in range(n)]
                rows.append(share)
        return tuple(names), np.concatenate(rows)

    @cached_property
    def factors(self) -> Array:
        """Values of these factors, (F,)."""
        return 1 + self.quantities[1] @ (self.values - self.space.standard)

    @cached_property
    def spread(self) -> Array:
        """Least and largest value of each factor among the beams that the data cannot tell apart, (F, 2)."""
        if self.rank == self.space.size:
            return np.column_stack([self.factors, self.factors])
        space, values = self.space, self.values
        low, high = space.row_bounds
        changes = space.rows @ values
        limits = {
            "A_eq": self.fixed,
            "b_eq": np.zeros(self.rank),
            "A_ub": np.concatenate([space.rows, -space.rows]),
            "b_ub": np.maximum(np.concatenate([high - changes, changes - low]), 0.0),
            "bounds": np.column_stack([np.minimum(space.lower - values, 0.0), np.maximum(space.upper - values, 0.0)]),
        }
        ends = []
        for row in self.quantities[1]:
            least, most = (linprog(sign * row, **limits) for sign in (1.0, -1.0))
            ends.append([least.fun if least.success else math.nan, -most.fun if most.success else math.nan])
        return np.asarray(self.factors[:, None] + np.array(ends))

    @cached_property
    def held(self) -> Mask:
        """Unknowns at a bound, which count as known, (N,)."""
        at_bound = set(self.space.active_bounds(self.values))
        return np.array([name in at_bound for name in self.space.names])

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the unknowns, (N, N), of the part that the data and what was known before fix."""
        values, directions = self._information
        known = values > RANK**2 * values[-1]
        return np.asarray((directions[:, known] / values[known]) @ directions[:, known].T)

    @cached_property
    def standard_errors(self) -> Array:
        """Standard errors of the factors, (F,).

        Nan for those that are not fixed or at a bound, and where no deviation is known.
        """
        rows = self.quantities[1]
        errors = np.sqrt(np.einsum("ij,jk,ik->i", rows, self.covariance, rows))
        values, directions = self._information
        loose = directions[:, values <= RANK**2 * values[-1]]
        fixed = np.linalg.norm(rows @ loose, axis=1) < FIXED * np.linalg.norm(rows, axis=1)
        return np.where(fixed & self.noisy, errors, math.nan)

    @cached_property
    def _information(self) -> tuple[Array, Array]:
        """Eigenvalues and directions of J^T J and the prior, of the unknowns that are not held."""
        free = ~self.held
        information = (self.jacobian.T @ self.jacobian + self.prior) * np.outer(free, free)
        values, directions = np.linalg.eigh(information)
        return values, directions

    @cached_property
    def exponents(self) -> tuple[tuple[str, ...], Array]:
        """Global unknowns, and exponents of their products that the data fix with all else held, (r, G)."""
        held = {unknown.name for unknown in self.space.unknowns if isinstance(unknown, Global)}
        names = tuple(name for name in ORDER if name in held)
        if not names:
            return (), np.zeros((0, 0))
        columns = [self.space.names.index(name) for name in names]
        _, singular, rows = np.linalg.svd(self.jacobian[:, columns] * self.values[columns])
        return names, _reduced(rows[: np.count_nonzero(singular > RANK * self.singular_values[0])])

    def words(self) -> tuple[str, ...]:
        """Return in words what the data tell."""
        size = self.space.size
        said = [
            f"The data fix {self.rank} of {size} combinations of the unknowns."
            if self.rank < size
            else f"The data fix all {size} unknowns."
        ]
        names, rows = self.exponents
        if names and len(rows) < len(names):
            products = [
                " ".join(f"{name}^{value:.3g}" for name, value in zip(names, row, strict=True) if abs(value) > 1e-3)
                for row in rows
            ]
            held = "" if len(names) == size else " with everything else held"
            said.append(f"Of {', '.join(names)} they fix{held} " + (f"{' and '.join(products)} only." if products else
                        "nothing."))  # fmt: skip
        return tuple(said)


def _reduced(rows: Array) -> Array:
    """Return the reduced row echelon form of independent rows."""
    rows, done = rows.copy(), 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.abs(rows[done:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-3 * np.abs(rows[done:]).max():
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return rows
