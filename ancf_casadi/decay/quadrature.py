"""Integrals of a smooth function of time from 0 to each of many instants.

The time from 0 to the last instant T is divided into panels that end at T, T/2, T/4, ..., so that a decay is resolved
at any rate up to about 1e4/T.  The function is evaluated at the Gauss points of each panel only, and the integral of
the polynomial through these values, expanded in Legendre polynomials, is taken up to each instant:

    int_-1^x P_n = (P_(n+1)(x) - P_(n-1)(x))/(2 n + 1).

The integrals are linear in the values, whose number does not depend on the number of instants.

References
----------
P. J. Davis, P. Rabinowitz, Methods of Numerical Integration, Academic Press (1984), Section 2.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.polynomial import legendre

from ancf_casadi.support.arrays import Array

POINTS = 16  # in a panel


@dataclass(frozen=True, eq=False)
class Antiderivative:
    """Linear map from values of a function at ``nodes`` to its integrals from 0 to given instants.

    Parameters
    ----------
    instants : ndarray
        Instants (m,), none negative, in any order.
    edges : ndarray
        Ends of the panels (k + 1,), from 0 on.
    """

    instants: Array
    edges: Array

    @cached_property
    def nodes(self) -> Array:
        """Instants (16 k,) at which the function is needed."""
        middle, half = (self.edges[1:] + self.edges[:-1]) / 2, np.diff(self.edges) / 2
        return np.asarray((middle[:, None] + half[:, None] * _GAUSS).ravel())

    def __call__(self, values: cs.MX) -> cs.MX:
        """Return the integrals (m,) of a function with the given values at the nodes."""
        order = np.argsort(self.instants, kind="stable")
        ascending = self.instants[order]
        ends = np.searchsorted(ascending, self.edges[1:], side="right")
        parts, before, begin = [], cs.MX(0), 0
        for panel, end in enumerate(ends.tolist()):
            low, high = self.edges[panel], self.edges[panel + 1]
            half = (high - low) / 2
            own = values[panel * POINTS : (panel + 1) * POINTS]
            if end > begin:
                x = (ascending[begin:end] - low) / half - 1
                parts.append(before + cs.mtimes(cs.DM(half * _weights(x)), own))
            before, begin = before + half * cs.dot(cs.DM(_WEIGHTS), own), end
        back = np.empty(len(order), dtype=int)
        back[order] = np.arange(len(order))
        return cs.vertcat(*parts)[back.tolist()]


def antiderivative(instants: Array) -> Antiderivative:
    """Return the map from values of a function to its integrals from 0 to instants (m,), at least 0, s."""
    instants = np.maximum(np.asarray(instants, dtype=float), 0.0)
    last = float(instants.max(initial=0.0)) or 1.0
    return Antiderivative(instants, np.append(0.0, last * 0.5 ** np.arange(14, -1, -1)))


def _weights(x: Array) -> Array:
    """Return the integrals (m, 16) from -1 to x (m,) of the polynomials that are 1 at one Gauss point, 0 at others."""
    P = legendre.legvander(x, POINTS)
    integrals = np.column_stack([x + 1, (P[:, 2:] - P[:, :-2]) / (2 * np.arange(1, POINTS) + 1)])
    return np.asarray(integrals @ _EXPANSION)


_GAUSS, _WEIGHTS = legendre.leggauss(POINTS)
_EXPANSION = (np.arange(POINTS)[:, None] + 0.5) * legendre.legvander(_GAUSS, POINTS - 1).T * _WEIGHTS
