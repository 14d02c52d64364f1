"""Newton's method for a point of a family of periodic motions.

One more equation, row . (z - z_0)/s = distance, selects a point of the curve: the row is the tangent at z_0
(pseudo-arclength), or the unit vector of an entry that is prescribed.  The Jacobian matrix costs more than ten
residuals and is kept, also from the last point of a curve, as long as each step reduces the error fivefold; large
matrices are kept as long as it reduces it twofold.  For a beam that turns, residuals are turned back to the motion at
which the matrix was evaluated, and corrections forth (``systems.system.Corrections``).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from ancf_casadi.response.harmonic_balance.balance import BalanceDerivatives
from ancf_casadi.response.harmonic_balance.family import Family
from ancf_casadi.support.arrays import Array

NEWTON_ERROR = 1e-11  # error of the unknowns relative to their scales
LARGEST_NEWTON_STEP = 100.0  # largest step, relative to the scales


class NotFound(Exception):
    """No point was found near a guess; the continuation shortens its step."""


@dataclass(frozen=True, eq=False)
class Condition:
    """The equation row . (z - origin)/s = distance.

    Parameters
    ----------
    row : array
        Coefficients in scaled unknowns.
    origin : array
        z_0.
    distance : float
        Right side.
    """

    row: Array
    origin: Array
    distance: float


@dataclass(frozen=True, eq=False)
class Jacobian:
    """The derivatives of the equations.

    Parameters
    ----------
    matrix : array (k - 1, k)
        Derivatives with respect to the unknowns.
    linear : BalanceDerivatives
        Derivatives of harmonic balance.
    z : array
        Unknowns at which they were evaluated.
    """

    matrix: Array
    linear: BalanceDerivatives
    z: Array

    def factorised(self, row: Array, scale: Array) -> ScaledFactors:
        """Return the LU factors in scaled unknowns, with a last row; other rows are divided by their largest entry."""
        scaled = self.matrix * scale
        rows = np.abs(scaled).max(axis=1)
        with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)  # steps from a singular matrix are not finite
            factors = scipy.linalg.lu_factor(np.vstack([scaled / rows[:, None], row]), check_finite=False)
        return ScaledFactors(factors, np.append(rows, 1.0))


@dataclass(frozen=True, eq=False)
class ScaledFactors:
    """The LU factors of a matrix whose rows were divided by numbers.

    Parameters
    ----------
    factors : tuple
        LU factors and pivots.
    rows : array
        The numbers.
    """

    factors: Any
    rows: Array

    def solve(self, right: Array) -> Array:
        """Return the solution, in scaled unknowns."""
        return np.asarray(scipy.linalg.lu_solve(self.factors, right / self.rows, check_finite=False))


def jacobian_at(family: Family, z: Array) -> Jacobian:
    """Return the derivatives of the equations at z."""
    return Jacobian(*family.jacobian(z), z)


def solve(family: Family, guess: Array, condition: Condition, jacobian: Jacobian | None = None) -> Array:
    """Return the unknowns of the point that fulfils a condition.

    Parameters
    ----------
    family : Family
        The equations.
    guess : array
        First unknowns.
    condition : Condition
        The last equation.
    jacobian : Jacobian, optional
        Derivatives near the guess.

    Raises
    ------
    NotFound
        If the iteration does not converge.
    """
    scale, z, evaluations, last = family.scale, guess, 1, np.inf
    # with a slower decrease, the Jacobian matrix is evaluated anew
    contraction = 0.2 if family.cheap else 0.5  # the same, where its factors are expensive
    fresh, distance = jacobian is None, np.inf
    used = jacobian_at(family, z) if jacobian is None else jacobian
    factors = used.factorised(condition.row, scale)
    for _ in range(30):
        gap = condition.row @ ((z - condition.origin) / scale) - condition.distance
        residual = family.back(used.z, z, family.residual(z))
        step = -family.forth(used.z, z, scale * factors.solve(np.append(residual, gap))) / scale
        length = float(np.abs(step).max())
        if not np.isfinite(length) or (fresh and length > LARGEST_NEWTON_STEP):
            raise NotFound
        if length > min(LARGEST_NEWTON_STEP, contraction * last):
            # a step below 1e-6 stagnates by rounding, with derivatives from within 1e-3
            if distance <= 1e-3 and last <= 1e-6 and length > last / 2:
                return z
            if evaluations == 10:
                raise NotFound
            used, evaluations, last, fresh = jacobian_at(family, z), evaluations + 1, np.inf, True
            factors = used.factorised(condition.row, scale)
            continue
        distance = length if fresh else distance
        z, fresh = family.moved(z, scale * step), False
        if min(length / last, 1.0) * length <= NEWTON_ERROR and (last < np.inf or length <= NEWTON_ERROR):
            return z
        last = length
    raise NotFound
