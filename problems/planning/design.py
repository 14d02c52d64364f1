"""Planned experiments: the standard errors to be expected, and the experiments that reduce them most.

To first order, the residuals of a record, in standard deviations, depend on the unknowns by their Jacobian J.  With
white noise of these standard deviations a record of its own has the Fisher information J' J.  Colour of the noise
divides this by the inflation of the variances (``Noise.inflation``).  Unknowns that belong to one record alone, such as
the zero of its sensor, are marginalised: with the columns J_s of the shared and J_o of the own unknowns, and the
projection Q onto the complement of J_o,

    A = J_s' Q J_s.

Priors of own unknowns are further rows of J_o.  The list that has the record k n_k times has the information and the
covariance

    M = P + sum n_k A_k,    C = M^-1,

with the information P of priors and of earlier records.  The unknowns z are in units of their scales, and reciprocal
where those of the fit are.  A list is good if its loss is small:

    D    -log det M    (the volume of the region of confidence)
    A    tr C          (the sum of the squared standard errors in units of the scales)
    name C_kk          (the squared standard error of one unknown)

With the cost c_k of a record, the share w_k of a budget B buys n_k = w_k B/c_k of it.  The best shares w >= 0 with
sum w_k = 1 solve a convex program.  The derivative of the loss by w_k is -B g_k/c_k with the gains g_k = tr(C A_k) for
D, and (C A_k C)_jj, summed over the unknowns j of the goal, for the others.  By the equivalence theorem shares are
optimal if and only if no B g_k/c_k exceeds the mean over the shares, which for D without P is the number of unknowns.

Whole numbers of records come from an exchange: to the empty list, and to the optimal shares rounded down, the record
with the largest decrease of the loss per cost is added until the budget is spent.  Then one or two records are
exchanged for one or two others, the best first, as long as this helps.

References
----------
V. V. Fedorov, Theory of Optimal Experiments, Academic Press (1972).
J. Kiefer, J. Wolfowitz, The equivalence of two extremum problems, Canadian Journal of Mathematics 12 (1960).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as cs
import numpy as np

from ancf_casadi.estimation.determination import LEAST_EXPONENT
from ancf_casadi.estimation.solver.nlp import solve_nlp
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.tall import tall_triangle

UNUSED = 1e-6  # share of a budget that the interior-point method returns in place of zero
PROGRESS = 1e-9  # least relative decrease of a loss that counts as an improvement
SHARE_OPTIONS = {"ipopt.tol": 1e-11}


@dataclass(frozen=True, eq=False)
class ExpectedRecord:
    """Expected record: the dependence of its residuals, in standard deviations, on the unknowns."""

    jacobian: Array  # by n unknowns that records share and q of its own, in units of their scales, (m, n + q)
    shared: int  # n
    prior_jacobian: Array  # residuals of the priors of its own unknowns by all, (p, n + q)
    lengths: tuple[int, ...]  # of the series of residuals, one per sensor or value
    places: Array  # arc length of the sensor of each series, m; nan without a place
    times: Array  # of the residuals, s, (m,); nan without times
    negligible: float  # norm of a change of the residuals that the computation does not tell from none
    growth: float  # of the variances by the colour of the noise

    @cached_property
    def triangles(self) -> list[Array]:
        """Triangles of the QR factors of the Jacobians of the series."""
        ends = np.cumsum([0, *self.lengths]).tolist()
        return [tall_triangle(self.jacobian[slice(*pair)]) for pair in pairwise(ends)]

    @cached_property
    def information(self) -> Array:
        """Information of the whole record on the shared unknowns, (n, n)."""
        return self._marginal(self.triangles)

    def series_information(self, series: Sequence[int]) -> Array:
        """Return the information of some of the series, (n, n)."""
        return self._marginal([self.triangles[k] for k in series])

    def informations_until(self, times: Array) -> Array:
        """Return the information of the record if it ended at each of some ascending times, (t, n, n)."""
        informations, triangle, previous_time = [], np.zeros((0, self.jacobian.shape[1])), -math.inf
        for time in times.tolist():
            new_samples: Mask = (self.times > previous_time) & (self.times <= time)
            triangle, previous_time = tall_triangle(np.vstack([triangle, self.jacobian[new_samples]])), time
            informations.append(self._marginal([triangle]))
        return np.array(informations)

    def _marginal(self, triangles: Sequence[Array]) -> Array:
        """Return the information of some series on the shared unknowns, with the own unknowns marginalised."""
        rows = np.vstack([*(triangle / math.sqrt(self.growth) for triangle in triangles), self.prior_jacobian])
        shared, own_columns = rows[:, : self.shared], rows[:, self.shared :]
        norms = np.linalg.norm(own_columns, axis=0)
        own_columns = own_columns[:, norms > 0.0] / norms[norms > 0.0]
        residuals = shared - own_columns @ np.linalg.lstsq(own_columns, shared)[0] if own_columns.size else shared
        return np.asarray(residuals.T @ residuals)


@dataclass(frozen=True, eq=False)
class Design:
    """Candidate records, and the criteria by which lists of them are chosen."""

    informations: Array  # (c, n, n)
    prior: Array  # information of priors and of earlier records, (n, n)
    negligible: float  # information below this squared is none
    costs: Array  # (c,)

    def total(self, amounts: Array) -> Array:
        """Return the information of a list with these amounts (c,) of the records, (n, n)."""
        return np.asarray(self.prior + np.tensordot(amounts, self.informations, 1))

    def errors(self, information: Array) -> Array:
        """Return the standard errors (n,) in units of the scales; infinite for what is not determined."""
        values, vectors = np.linalg.eigh(information)
        determined = values > self.negligible**2
        undetermined = (np.abs(vectors[:, ~determined]) > LEAST_EXPONENT).any(axis=1)
        scaled_vectors = vectors[:, determined] / np.sqrt(values[determined])
        return np.where(undetermined, math.inf, np.linalg.norm(scaled_vectors, axis=1))

    def loss(self, information: Array, goal: Array | None) -> Array:
        """Return the loss of lists with the information (..., n, n); ``goal`` has the weights of C_kk, None for D."""
        information = self._regularise(information)
        if goal is None:
            return np.asarray(-np.linalg.slogdet(information)[1])
        return np.asarray(np.einsum("...kk,k->...", np.linalg.inv(information), goal))

    def _regularise(self, information: Array) -> Array:
        """Return the information plus a negligible one, which makes it invertible."""
        return np.asarray(information + self.negligible**2 * np.eye(len(self.prior)))

    def gains(self, amounts: Array, goal: Array | None) -> Array:
        """Return the gains g (c,): the decrease of the loss per further record, to first order."""
        covariance = np.linalg.inv(self._regularise(self.total(amounts)))
        weights = covariance if goal is None else covariance @ np.diag(goal) @ covariance
        return np.asarray(np.einsum("ij,kji->k", weights, self.informations))

    def shares(self, budget: float, goal: Array | None) -> Array:
        """Return the optimal shares (c,) of a budget."""
        count = len(self.costs)
        purchases = self.informations * (budget / self.costs)[:, None, None]
        prior = self._regularise(self.prior)
        # coordinates in which equal shares have the information I
        root = np.linalg.inv(np.linalg.cholesky(prior + purchases.mean(axis=0))).T
        w = cs.SX.sym("w", count)
        information = cs.SX(cs.DM(root.T @ prior @ root))
        for k, purchase in enumerate(purchases):
            information += w[k] * cs.DM(root.T @ purchase @ root)
        triangle = cs.chol(information)
        if goal is None:
            value = -2 * cs.sum1(cs.log(cs.diag(triangle)))
        else:
            columns = root.T * np.sqrt(goal)
            value = cs.sumsqr(cs.solve(triangle.T, cs.DM(columns))) / float(np.sum(columns**2))
        loss, x = cs.Function("loss", [w], [value]), cs.MX.sym("w", count)
        equal = np.full(count, 1 / count)
        program = {"x": x, "f": loss(x), "g": cs.sum1(x) - 1}
        shares = solve_nlp(program, equal, lower=0.0, upper=1.0, options=SHARE_OPTIONS).x
        shares = np.where(shares > UNUSED, shares, 0.0)
        return np.asarray(shares / shares.sum())

    def counts(self, budget: float, goal: Array | None, most_each: int | None = None) -> Array:
        """Return the best numbers (c,) of the records within a budget, each at most ``most_each`` times."""
        limit = np.floor((budget / self.costs) * (1 + PROGRESS))
        limit = limit if most_each is None else np.minimum(limit, most_each)
        rounded = np.minimum(np.floor(self.shares(budget, goal) * budget / self.costs), limit)
        starts = [self._fill(start, budget, goal, limit) for start in (np.zeros(len(limit)), rounded)]
        lists = [self._exchange(start, budget, goal, limit) for start in starts]
        return min(lists, key=lambda counts: float(self.loss(self.total(counts), goal)))

    def _fill(self, counts: Array, budget: float, goal: Array | None, limit: Array) -> Array:
        """Add records to a list until the budget is spent, the largest decrease of the loss per cost first."""
        counts = counts.copy()
        while True:
            remaining = budget * (1 + PROGRESS) - counts @ self.costs
            possible = np.flatnonzero((self.costs <= remaining) & (counts < limit))
            if not len(possible):
                return counts
            information = self.total(counts)
            decrease = self.loss(information, goal) - self.loss(information + self.informations[possible], goal)
            counts[possible[np.argmax(decrease / self.costs[possible])]] += 1

    def _exchange(self, counts: Array, budget: float, goal: Array | None, limit: Array) -> Array:
        """Exchange one or two records of a list for one or two others, as long as this improves the list."""
        singles, (i, j) = np.eye(len(counts)), np.triu_indices(len(counts))
        exchangeable = np.vstack([singles, singles[i] + singles[j]])  # numbers of one or two records, (b, c)
        informations = np.tensordot(exchangeable, self.informations, 1)
        least_loss = float(self.loss(self.total(counts), goal))
        while True:
            improved: Array | None = None
            for removed in exchangeable[(exchangeable <= counts).all(axis=1)]:
                kept_counts = counts - removed
                affordable = (kept_counts + exchangeable) @ self.costs <= budget * (1 + PROGRESS)
                possible = np.flatnonzero(affordable & (kept_counts + exchangeable <= limit).all(axis=1))
                losses = self.loss(self.total(kept_counts) + informations[possible], goal)
                if losses.min(initial=math.inf) < least_loss - PROGRESS * abs(least_loss):
                    least_loss, improved = float(losses.min()), kept_counts + exchangeable[possible[np.argmin(losses)]]
            if improved is None:
                return counts
            counts = self._fill(improved, budget, goal, limit)
            least_loss = float(self.loss(self.total(counts), goal))


def best_subset(count: int, size: int, loss: Callable[[tuple[int, ...]], float]) -> tuple[int, ...]:
    """Return ``count`` of the numbers from 0 to ``size`` - 1 that have a small loss, by addition and exchange."""
    chosen: tuple[int, ...] = ()
    for _ in range(count):
        chosen = min(((*chosen, k) for k in range(size) if k not in chosen), key=loss)
    best = loss(chosen)
    while True:
        exchanges = [(*chosen[:j], k, *chosen[j + 1 :]) for j in range(count) for k in range(size) if k not in chosen]
        exchange = min(exchanges, key=loss, default=chosen)
        if not loss(exchange) < best - PROGRESS * abs(best):
            return tuple(sorted(chosen))
        best, chosen = loss(exchange), exchange
