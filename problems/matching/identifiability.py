"""Properties of a beam that the measured modes determine, and those that they do not.

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

from ancf_casadi.estimation.determination import product, reduce_rows
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.support.arrays import Array, Mask
from problems.matching.design_space import DesignSpace
from problems.matching.response import Matching
from problems.matching.unknowns import Global

RANK_TOLERANCE = 1e-6  # times the largest singular value; smaller ones count as zero
NULL_SHARE = 1e-6  # relative part of a factor in the null space below which the data determine the factor
BOUND_ROUNDING = 1e-9  # excess over a bound that may be due to rounding
# order of the columns in the row reduction of the exponents
PROPERTY_ORDER = ("elastic_modulus", "thickness", "density", "width")  # and then the lumped ones


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The information in the data about the unknowns, at an optimum."""

    matching: Matching
    values: Array  # of the unknowns at the optimum, (N,)

    @property
    def space(self) -> DesignSpace:
        """The unknowns and their bounds."""
        return self.matching.space

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of the residuals, in units of their standard deviations if these are known, (R, N)."""
        return self.matching.jacobian(self.values) / self.matching.unit

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        """Singular values of J, descending, and all rows of V^T."""
        return np.linalg.svd(self.jacobian)[1:]

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
    def factors(self) -> Array:
        """Values of the factors, (F,)."""
        return 1 + self.space.changes(self.values)

    @cached_property
    def spread(self) -> Array:
        """Least and greatest value of each factor over the beams that fit the data equally well, (F, 2)."""
        lower, upper = self.room
        if self.rank == self.space.size:
            return np.column_stack([self.factors, self.factors])
        ends = [np.where(self._reaches(bound), bound, math.nan) for bound in (lower, upper)]
        for side, changes in zip((1.0, -1.0), ends, strict=True):
            for k in np.flatnonzero(np.isnan(changes)).tolist():
                changes[k] = self._extreme(side * self.space.map[k]) * side
        return np.asarray(self.factors[:, None] + np.column_stack(ends))

    @cached_property
    def room(self) -> tuple[Array, Array]:
        """Changes of the factors that lead to the lower and to the upper bounds, (F,) each."""
        lower, upper = self.space.room(self.values)
        return np.minimum(lower, 0.0), np.maximum(upper, 0.0)

    def _reaches(self, changes: Array) -> Mask:
        """Return whether the projected move that makes each change of a factor stays within the bounds, (F,)."""
        (lower, upper), projected = self.room, self.space.map @ self.null_space.T
        moves = projected @ projected.T
        with np.errstate(divide="ignore", invalid="ignore"):
            moves = moves * (changes / np.diag(moves))[:, None]
            return np.asarray(((moves >= lower - BOUND_ROUNDING) & (moves <= upper + BOUND_ROUNDING)).all(axis=1))

    def _extreme(self, row: Array) -> float:
        """Return the minimum of t^T dm, with t a row, over the null space within the bounds; nan if none is found."""
        space, (lower, upper) = self.space, self.room
        rows = space.map[~space.single]
        program = scipy.optimize.linprog(
            row,
            A_eq=self.determined,
            b_eq=np.zeros(self.rank),
            A_ub=np.concatenate([rows, -rows]),
            b_ub=np.concatenate([upper[~space.single], -lower[~space.single]]),
            bounds=list(zip(space.from_factors(lower, -math.inf), space.from_factors(upper, math.inf), strict=True)),
        )
        return math.nan if not program.success or program.fun is None else float(program.fun)

    @cached_property
    def at_bound(self) -> Mask:
        """Unknowns at a bound, which count as known, (N,)."""
        return np.isin(self.space.names, self.space.at_bound(self.values))

    @cached_property
    def _information(self) -> Array:
        """J^T J plus, if the standard deviations are known and the preference has a weight, its matrix, (N, N)."""
        matching, information = self.matching, self.jacobian.T @ self.jacobian
        prior = matching.noisy and matching.preference.weight is not None
        return np.asarray(information + matching.preference_matrix if prior else information)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array, Mask]:
        """Eigenvalues and eigenvectors of the information on the unknowns within bounds, and the nonzero ones."""
        values, directions = np.linalg.eigh(self._information * np.outer(~self.at_bound, ~self.at_bound))
        return values, directions, values > RANK_TOLERANCE**2 * values[-1]

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the unknowns, (N, N), for the combinations that data and prior determine."""
        values, directions, determined = self._spectrum
        return np.asarray((directions[:, determined] / values[determined]) @ directions[:, determined].T)

    @cached_property
    def factor_covariance(self) -> Array:
        """Covariance of the factors, (F, F).

        Nan for factors that are not determined or are at a bound, and if no standard deviation weighs the residuals.
        """
        rows = self.space.map
        covariance, is_determined = rows @ self.covariance @ rows.T, self.determines(rows)
        return np.where(np.outer(is_determined, is_determined) & self.matching.weighted, covariance, math.nan)

    def determines(self, rows: Array) -> Mask:
        """Return whether data and prior determine each combination (r, N) of unknowns that are not at a bound."""
        _, directions, determined = self._spectrum
        undetermined = np.linalg.norm(rows @ directions[:, ~determined], axis=1)
        return np.asarray(undetermined < NULL_SHARE * np.linalg.norm(rows, axis=1))

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the factors, (F,); nan as in ``factor_covariance``."""
        return np.sqrt(np.diag(self.factor_covariance))

    def extremes(self, factor: int, room: float) -> tuple[float, float]:
        """Return the least and the greatest value of a factor where 2 (L(m) - L_min) <= room, to first order in r."""
        space, (below, above) = self.space, self.room
        information = self._information / room
        size = 1 / np.sqrt(np.maximum(np.diag(information), 1.0))  # of a step that uses all of the room, at most 1
        information *= np.outer(size, size)
        z, rows = cs.MX.sym("z", space.size), cs.DM(space.map * size)
        smooth = np.flatnonzero(~space.single).tolist()
        g = cs.vertcat(cs.bilin(cs.DM(information), z, z), rows[smooth, :] @ z)
        ends = []
        for sign in (1.0, -1.0):
            solution = solve_nlp(
                {"x": z, "f": sign * (rows[factor, :] @ z), "g": g},
                np.zeros(space.size),
                lower=space.from_factors(below, -math.inf) / size,
                upper=space.from_factors(above, math.inf) / size,
                constraint_lower=np.append(-math.inf, below[smooth]),
                constraint_upper=np.append(1.0, above[smooth]),
                options={"ipopt.tol": 1e-8, "ipopt.bound_relax_factor": 0.0},
            )
            ends.append(float(self.factors[factor]) + sign * solution.objective)
        return ends[0], ends[1]

    @cached_property
    def exponents(self) -> tuple[tuple[str, ...], Array]:
        """The G global unknowns, and the exponents (r, G) of the products that the data determine, all else fixed."""
        global_names = {unknown.name for unknown in self.space.unknowns if isinstance(unknown, Global)}
        names = tuple(name for name in PROPERTY_ORDER if name in global_names)
        names += tuple(sorted(global_names.difference(names)))
        if not names:
            return (), np.zeros((0, 0))
        columns = [self.space.names.index(name) for name in names]
        logarithmic = self.jacobian[:, columns] * self.values[columns]
        _, singular, rows = np.linalg.svd(logarithmic)
        determined = rows[: np.count_nonzero(singular > RANK_TOLERANCE * self._svd[0][0])]
        return names, reduce_rows(determined, range(len(names)))

    def statements(self) -> tuple[str, ...]:
        """Return sentences that say which combinations of the unknowns the data determine."""
        size = self.space.size
        source = "The data and the priors" if self.matching.priors else "The data"
        sentences = [
            f"{source} determine {self.rank} independent combinations of the {size} unknowns; the preference selects "
            "the rest."
            if self.rank < size
            else f"{source} determine all {size} unknowns."
        ]
        names, rows = self.exponents
        if names and len(rows) < len(names):
            products = [product(names, row) for row in rows]
            condition = "" if len(names) == size else ", with everything else held"
            determined = f"only {' and '.join(products)}" if products else "nothing"
            sentences.append(f"Of {', '.join(names)}, they determine {determined}{condition}.")
        return tuple(sentences)
