"""Combinations of properties that records determine, and how well.

With the Jacobian J of the residuals by the logarithms of the properties, the singular value decomposition J = U S V^T
gives independent products of powers of the properties, one per row v of V^T.  A change of log(product) by d changes the
residuals by s d.  If s is zero, to rounding or because only the slight stretching of the beam distinguishes the
properties, the records do not determine the product.  Otherwise its relative standard error is phi^1/2/s, with phi the
variance of the residuals.

Positions under known weights determine E b h^3.  Positions under the beam's own weight, and frequencies, determine
ratios of stiffness and mass, such as E h^2/rho: only a force or a weight that is known sets their scale.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array
from problems.matching.identifiability import ORDER, determined_exponents, product
from problems.properties.observation import FACTORS
from problems.properties.quantities import INVERSE, factors_of, names_of
from problems.properties.records import PropertyRecord

RANK = 1e-5  # singular value, relative to the largest, below which a product is not determined
CERTAIN = 1.0  # relative standard error from which the data leave a product open


@dataclass(frozen=True, eq=False)
class Determined:
    """The information of records about the logarithms of properties.

    Parameters
    ----------
    names : tuple of str
        The n properties.
    jacobian : array (m, n)
        Derivatives of the residuals by the logarithms of the properties.
    """

    names: tuple[str, ...]
    jacobian: Array

    @classmethod
    def of(cls, records: Sequence[PropertyRecord], unknowns: tuple[str, ...], values: Array) -> Determined:
        """Return the information of records about the unknowns of a fit at some values."""
        x = cs.MX.sym("x", len(unknowns))
        given = factors_of(dict(zip(unknowns, cs.vertsplit(x), strict=True)))
        factors = cs.vertcat(*(given.get(name, cs.MX(1.0)) for name in FACTORS))
        at, chain = cs.Function("factors", [x], [factors, cs.densify(cs.jacobian(factors, x))])(values)
        blocks = [record.respond(at.full().ravel())[1] / record.scatter[:, None] for record in records]
        signs = np.array([-1.0 if name.startswith(INVERSE) else 1.0 for name in unknowns])
        jacobian = np.vstack(blocks) @ chain.full() * (signs * values)
        names = names_of(unknowns)
        order = sorted(range(len(names)), key=lambda k: ORDER.index(names[k]) if names[k] in ORDER else -1)
        return cls(tuple(names[k] for k in order), jacobian[:, order])

    def without(self, names: Collection[str]) -> Determined:
        """Return the information about the other properties, if some are known."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        return Determined(tuple(self.names[k] for k in kept), self.jacobian[:, kept])

    @property
    def rank(self) -> int:
        """Number of independent products that the records determine."""
        singular = np.linalg.svd(self.jacobian, compute_uv=False)
        return int(np.count_nonzero(singular > RANK * singular[0])) if singular.size and singular[0] > 0.0 else 0

    @property
    def products(self) -> tuple[str, ...]:
        """The products of powers that the records determine."""
        if not self.rank:
            return ()
        largest = float(np.linalg.norm(self.jacobian, 2))
        return tuple(product(self.names, row) for row in determined_exponents(self.jacobian, RANK * largest))

    @property
    def statement(self) -> str:
        """Sentence on the products that the records determine."""
        if self.rank == len(self.names):
            return f"the records determine all {self.rank} unknowns" if self.rank > 1 else "the records determine it"
        found = " and ".join(self.products) or "nothing"
        return f"of {', '.join(self.names)}, the records determine only {found}"

    def certainty(self, deviation: float) -> list[tuple[str, float]]:
        """Return independent products of powers and their relative standard errors, the best known first.

        The largest exponent of each product is 1.

        Parameters
        ----------
        deviation : float
            Standard deviation of the residuals.
        """
        _, singular, rows = np.linalg.svd(self.jacobian, full_matrices=False)
        found = []
        for value, row in zip(singular.tolist(), rows, strict=True):
            largest = float(row[np.abs(row).argmax()])
            found.append((product(self.names, row / largest), deviation / (value * abs(largest)) if value else np.inf))
        return found
