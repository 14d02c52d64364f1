"""Properties of a beam that the measured modes determine, and those that they leave open.

With the Jacobian J of the residuals by the unknowns m at the optimum, the singular value decomposition J = U S V^T
separates the combinations that the data determine, the rows of V^T with a nonzero singular value, from the null space
of J.  To first order, all m + dm within the bounds with J dm = 0 fit the data equally well.  The lowest and the highest
value of each factor t^T m among them follow from two linear programs, min and max of t^T dm.  Most need no solver: move
along the projection of t on the null space until the factor reaches its own bound; if no other bound is crossed, this
bound is the answer.

With standard deviations, the factors that the data determine have the covariance T (J^T J)^+ T^T, where unknowns at a
bound count as known.  A preference with a given weight adds its matrix to J^T J as prior information.

Over wide ranges, frequencies are products of powers of the global properties.  The data then determine such products,
for example E h^2/rho without gravity; their exponents are the combinations of the logarithms that the data determine.

References
----------
G. H. Golub, C. F. Van Loan, Matrix Computations, Johns Hopkins (2013), Section 5.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.determination import product
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.support.arrays import Array, Mask
from problems.matching.design_space import DesignSpace
from problems.matching.unknowns import Global

RANK_TOLERANCE = 1e-6  # times the largest singular value; smaller ones count as zero
BOUND_ROUNDING = 1e-9  # excess over a bound that may be due to rounding
PROPERTY_ORDER = (
    "elastic_modulus",
    "thickness",
    "density",
    "width",
    "tip_mass",
    "clamp_stiffness",
)  # order of the columns in the row reduction of the exponents


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The information in the data about the unknowns, at an optimum.

    Parameters
    ----------
    space : DesignSpace
        The unknowns and their bounds.
    values : array (N,)
        The optimum.
    jacobian : array (R, N)
        Derivatives of the residuals, in units of their standard deviations if these are known.
    prior : array (N, N)
        Prior information, the inverse of a covariance; zero if there is none.
    noisy : bool
        Whether the standard deviations are known.
    """

    space: DesignSpace
    values: Array
    jacobian: Array
    prior: Array
    noisy: bool

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        """Singular values of J, descending, and all rows of V^T."""
        _, singular_values, rows = np.linalg.svd(self.jacobian)
        return singular_values, rows

    @property
    def rank(self) -> int:
        """Number of combinations of the unknowns that the data determine."""
        return int(np.count_nonzero(self._svd[0] > RANK_TOLERANCE * self._svd[0][0]))

    @property
    def determined(self) -> Array:
        """Combinations of the unknowns that the data determine, the best known first, (rank, N)."""
        return self._svd[1][: self.rank]

    @property
    def null_space(self) -> Array:
        """Combinations of the unknowns that do not change the residuals, (N - rank, N)."""
        return self._svd[1][self.rank :]

    @cached_property
    def factor_names(self) -> tuple[str, ...]:
        """Names of the F factors that may change, one per global property or per element."""
        n = self.space.beam.elements
        return tuple(
            name
            for unknown in self.space.unknowns
            for name in (
                (unknown.name,) if isinstance(unknown, Global) else [f"{unknown.name}[{i + 1}]" for i in range(n)]
            )
        )

    @cached_property
    def factor_jacobian(self) -> Array:
        """Derivatives of these factors by the unknowns, (F, N)."""
        blocks = [(unknown, self.space.map[self.space.rows_of(unknown.name)]) for unknown in self.space.unknowns]
        return np.concatenate([rows[:1] if isinstance(unknown, Global) else rows for unknown, rows in blocks])

    @cached_property
    def factors(self) -> Array:
        """Values of these factors, (F,)."""
        return np.asarray(1 + self.factor_jacobian @ (self.values - self.space.standard))

    @cached_property
    def spread(self) -> Array:
        """Least and greatest value of each factor among the beams that fit the data equally well, (F, 2)."""
        if self.rank == self.space.size:
            return np.column_stack([self.factors, self.factors])
        lower, upper = self.space.room(self.values)
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
        own = [self.space.bounded_names.index(name) for name in self.factor_names]
        ends = [
            np.where(self._reaches(bound[own], lower, upper), bound[own], math.nan) for bound in (lower, upper)
        ]  # fmt: skip
        for side, changes in zip((1.0, -1.0), ends, strict=True):
            for k in np.flatnonzero(np.isnan(changes)).tolist():
                changes[k] = self._extreme(side * self.factor_jacobian[k], lower, upper) * side
        return np.asarray(self.factors[:, None] + np.column_stack(ends))

    def _reaches(self, changes: Array, lower: Array, upper: Array) -> Mask:
        """Return whether the projected move that makes each change of a factor stays within the bounds, (F,)."""
        moves = self.factor_jacobian @ self.null_space.T @ self.null_space
        with np.errstate(divide="ignore", invalid="ignore"):
            moves *= (changes / np.sum(moves**2, axis=1))[:, None]
            moves = np.concatenate([moves, moves @ self.space.rows.T], axis=1)
            return np.asarray(((moves >= lower - BOUND_ROUNDING) & (moves <= upper + BOUND_ROUNDING)).all(axis=1))

    def _extreme(self, row: Array, lower: Array, upper: Array) -> float:
        """Return the minimum of t^T dm, with t a row, over the null space within the bounds; nan if none is found."""
        space, size = self.space, self.space.size
        found = scipy.optimize.linprog(
            row,
            A_eq=self.determined,
            b_eq=np.zeros(self.rank),
            A_ub=np.concatenate([space.rows, -space.rows]),
            b_ub=np.concatenate([upper[size:], -lower[size:]]),
            bounds=list(zip(lower[:size].tolist(), upper[:size].tolist(), strict=True)),
        )
        return math.nan if not found.success or found.fun is None else float(found.fun)

    @cached_property
    def held(self) -> Mask:
        """Unknowns at a bound, which count as known, (N,)."""
        there = set(self.space.at_bound(self.values))
        return np.array([name in there for name in self.space.names])

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the unknowns, (N, N), for the combinations that data and prior determine."""
        values, directions = self._information
        known = values > RANK_TOLERANCE**2 * values[-1]
        return np.asarray((directions[:, known] / values[known]) @ directions[:, known].T)

    @cached_property
    def factor_covariance(self) -> Array:
        """Covariance of the factors, (F, F).

        Nan for factors that are not determined or are at a bound, and if no standard deviation is known.
        """
        rows = self.factor_jacobian
        found = rows @ self.covariance @ rows.T
        values, directions = self._information
        loose = directions[:, values <= RANK_TOLERANCE**2 * values[-1]]
        # relative part of a factor in the null space, below which the data determine the factor
        known = np.linalg.norm(rows @ loose, axis=1) < 1e-6 * np.linalg.norm(rows, axis=1)
        return np.where(np.outer(known, known) & self.noisy, found, math.nan)

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the factors, (F,); nan as in ``factor_covariance``."""
        return np.sqrt(np.diag(self.factor_covariance))

    def extremes(self, factor: int, room: float) -> tuple[float, float]:
        """Return the least and the greatest value of a factor where 2 (L(m) - L_min) <= room, to first order in r.

        Raises
        ------
        FitError
            If a nonlinear program does not converge.
        """
        below, above = self.space.room(self.values)
        information = (self.jacobian.T @ self.jacobian + self.prior) / room
        size = 1 / np.sqrt(np.maximum(np.diag(information), 1.0))  # of a step that uses all of the room, at most 1
        information *= np.outer(size, size)
        rows, row = self.space.rows * size, cs.DM(self.factor_jacobian[factor] * size)
        z, split = cs.MX.sym("z", self.space.size), self.space.size
        nlp = {"x": z, "g": cs.vertcat(cs.bilin(cs.DM(information), z, z), cs.DM(rows) @ z)}
        ends = []
        for sign in (1.0, -1.0):
            found = solve_nlp(
                {**nlp, "f": sign * cs.dot(row, z)},
                np.zeros(split),
                lower=np.minimum(below[:split], 0.0) / size,
                upper=np.maximum(above[:split], 0.0) / size,
                constraint_lower=np.concatenate([[-math.inf], np.minimum(below[split:], 0.0)]),
                constraint_upper=np.concatenate([[1.0], np.maximum(above[split:], 0.0)]),
                options={"ipopt.tol": 1e-8, "ipopt.bound_relax_factor": 0.0},
            )
            ends.append(float(self.factors[factor]) + sign * found.objective)
        return ends[0], ends[1]

    @cached_property
    def _information(self) -> tuple[Array, Array]:
        """Eigenvalues and eigenvectors of J^T J plus the prior, for the unknowns that are not held."""
        free = ~self.held
        information = (self.jacobian.T @ self.jacobian + self.prior) * np.outer(free, free)
        values, directions = np.linalg.eigh(information)
        return values, directions

    @cached_property
    def exponents(self) -> tuple[tuple[str, ...], Array]:
        """The G global unknowns, and the exponents, (r, G), of the products that the data determine, all else held."""
        given = {unknown.name for unknown in self.space.unknowns if isinstance(unknown, Global)}
        names = tuple(name for name in PROPERTY_ORDER if name in given)
        if not names:
            return (), np.zeros((0, 0))
        columns = [self.space.names.index(name) for name in names]
        logarithmic = self.jacobian[:, columns] * self.values[columns]
        return names, determined_exponents(logarithmic, RANK_TOLERANCE * self._svd[0][0])

    def statements(self) -> tuple[str, ...]:
        """Return sentences that say which combinations of the unknowns the data determine."""
        size = self.space.size
        said = [
            f"The data determine {self.rank} independent combinations of the {size} unknowns; the preference selects "
            "the rest."
            if self.rank < size
            else f"The data determine all {size} unknowns."
        ]
        names, rows = self.exponents
        if names and len(rows) < len(names):
            products = [product(names, row) for row in rows]
            held = "" if len(names) == size else ", with everything else held"
            found = f"only {' and '.join(products)}" if products else "nothing"
            said.append(f"Of {', '.join(names)}, they determine {found}{held}.")
        return tuple(said)


def determined_exponents(jacobian: Array, least: float) -> Array:
    """Return the exponents, (r, G), of the products of powers that data determine.

    Parameters
    ----------
    jacobian : array (R, G)
        Derivatives of the data by the logarithms of the G factors.
    least : float
        Singular value above which a combination of the logarithms is determined.
    """
    _, singular, rows = np.linalg.svd(jacobian)
    return _row_echelon(rows[: np.count_nonzero(singular > least)])


def _row_echelon(rows: Array) -> Array:
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
