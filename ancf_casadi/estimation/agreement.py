"""Agreement of several estimates of one quantity: of repeated takes, of several records, or of the parts of a record.

The estimates x_k with standard errors s_k agree if they scatter as these errors say.  With the weights w_k = 1/s_k^2
and their weighted mean x,

    Q = sum w_k (x_k - x)^2

then follows the chi-squared distribution with K - 1 degrees of freedom.  If they do not agree, the quantity itself
differs from record to record, with a standard deviation tau for which Q with w_k = 1/(s_k^2 + tau^2) has its
expectation K - 1.  The interval of the mean includes this scatter,

    x +- t s,    s^2 = max(1, Q/(K - 1))/sum w_k,

with t of Student's distribution with K - 1 degrees of freedom.  Few records may agree by chance: if tau = 0, t has
3 (K - 1) degrees of freedom.  Of two records whose scatter is 2 times their errors, the interval of 95 % then covers in
93 %; by a normal quantile it would cover in 85 %, and one that covers in 95 % for any scatter would be 6 times as wide
where the records agree.  Inexact records hardly show the scatter of exact ones: of two with the errors 0.5 and 1, 0.3
and 1, 0.1 and 1, and a scatter of 1, the interval covers in 95, 87 and 69 %.  Where one record has nearly all of the
weight, the text says that the others hardly test it.  Of a quantity that cannot be negative, such as a damping ratio,
the interval is that of the logarithm, from x exp(-t s/x) to x exp(t s/x).  Mean and interval stay within the bounds of
the quantity, which a first-order estimate may leave.

``part_estimates`` has the estimates from a part of the residuals of a fit, to first order: one Gauss-Newton step from
the estimates x of the whole fit, with the rows J_k, r_k of the part,

    x_k = x - (J_k' J_k)^-1 J_k' r_k,

for the unknowns that the part determines, to better than their scale.

If a law holds, the estimates from two parts of a record differ by noise alone.  Otherwise they scatter as estimates of
two records that do not agree, and so does the estimate from both (``allowing_for_later_starts``).  With an orthonormal
basis q of the columns of the Jacobian by the n free unknowns, of which a part has the rows q_1, and its share H = q_1'
q_1 of the information, the scores

    v = (H (I - H))^-1/2 q_1' psi_1

have the covariance q' R q if the law holds, and g = v' (q' R q)^-1 v follows the chi-squared distribution with n
degrees of freedom.  If g is too large, q' R q becomes q' R q + (1 - 1/g) v v', which makes v one standard error in its
own direction: the scatter of two estimates about their weighted mean.  The residuals then count as fewer independent
ones, so that a law which does not hold is not chosen for the little that it explains beyond a simpler one.

Few residuals do not show how their variance changes along a record.  ``allowing_for_unequal_variances`` then takes as
q' R q the least matrix that is nowhere below it nor below the estimate without any assumption on the variances,

    sum_i psi_i^2/(1 - h_i) q_i q_i',   h_i = q_i' q_i,

with the row q_i of residual i (HC2).

References
----------
G. C. Chow, Tests of equality between sets of coefficients in two linear regressions, Econometrica 28 (1960).
R. C. Paule, J. Mandel, Consensus values and weighting factors, Journal of Research of the National Bureau of Standards
87 (1982).
J. G. MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with improved finite sample
properties, Journal of Econometrics 29 (1985).
G. Knapp, J. Hartung, Improved tests for a random effects meta-regression with a single covariate, Statistics in
Medicine 22 (2003).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, ROUNDING, Fit, quantile
from ancf_casadi.estimation.noise.spectrum import estimated_noise
from ancf_casadi.estimation.solver.gauss_newton import influence, row_weights
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.tables import finite_or_none, to_width, with_error

FREEDOM_AGREED = 3  # degrees of freedom per record if tau = 0 (test_two_records_may_agree_by_chance)
AGREE, DISAGREE = 0.05, 0.01  # probabilities of Q above which estimates agree, and below which they do not
NEARLY_ALL = 0.9  # share of the weights; test_a_record_that_decides_alone_is_named fails at 0.7 and at 0.99
SHARED = 1e-3  # least product of the shares of the information in both parts for a direction to count fully


@dataclass(frozen=True, eq=False)
class Agreement:
    """Several estimates of one quantity."""

    name: str
    unit: str
    values: Array  # estimates (K,), K at least 2
    errors: Array  # their standard errors (K,), all positive
    lower: float = -math.inf  # bounds of the quantity
    upper: float = math.inf

    @cached_property
    def scatter(self) -> float:
        """Standard deviation tau between the records, beyond the standard errors."""
        freedom = len(self.values) - 1
        if self._excess(0.0) <= freedom:
            return 0.0
        # a variance at which Q < K - 1, even where rounding moves the mean to an estimate
        widest = 4 * float(np.ptp(self.values)) ** 2
        return math.sqrt(scipy.optimize.brentq(lambda variance: self._excess(variance) - freedom, 0.0, widest))

    @property
    def probability(self) -> float:
        """Probability of a Q as large or larger if the estimates agree."""
        return float(scipy.special.chdtrc(len(self.values) - 1, self._excess(0.0)))

    @property
    def mean(self) -> float:
        """Weighted mean x of the estimates, within the bounds."""
        mean = float(np.average(self.values, weights=1 / (self.errors**2 + self.scatter**2)))
        return min(max(mean, self.lower), self.upper)

    @property
    def error(self) -> float:
        """Standard error of the mean, which includes the scatter."""
        variance, freedom = self.scatter**2, len(self.values) - 1
        return math.sqrt(max(1.0, self._excess(variance) / freedom) / float(np.sum(1 / (self.errors**2 + variance))))

    def _excess(self, variance: float) -> float:
        """Return Q for a variance tau^2."""
        weights = 1 / (self.errors**2 + variance)
        return float(weights @ (self.values - np.average(self.values, weights=weights)) ** 2)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean."""
        return self.ends(CONFIDENCE_LEVEL)

    def ends(self, level: float) -> tuple[float, float]:
        """Return the interval of the mean for a confidence level."""
        freedom = (len(self.values) - 1) * (1 if self.scatter else FREEDOM_AGREED)
        reach = quantile(level, freedom) * self.error
        if self.lower == 0.0 and self.mean > 0.0:
            factor = math.exp(min(reach / self.mean, 700.0))  # finite
            return self.mean / factor, min(self.mean * factor, self.upper)
        return max(self.mean - reach, self.lower), min(self.mean + reach, self.upper)

    @property
    def agrees(self) -> bool:
        """True if the estimates scatter as their standard errors say."""
        return self.probability >= AGREE

    @property
    def warning(self) -> str | None:
        """Warning if the estimates do not agree; None if they do."""
        if self.probability >= DISAGREE:
            return None
        pairs = zip(self.values.tolist(), self.errors.tolist(), strict=True)
        texts = [with_error(*pair) for pair in pairs]
        outlier = "" if self.outlier is None else f" (all but number {self.outlier + 1}, {texts[self.outlier]}, agree)"
        return (
            f"the records do not agree on {self.name}: {', '.join(texts)}{outlier}; the fit to all of them understates "
            f"its error; use the mean with its scatter, {with_error(self.mean, self.error)}"
        )

    @cached_property
    def outlier(self) -> int | None:
        """Index of the only estimate without which the others, three or more, agree; None if there is none."""
        count = len(self.values)
        if self.agrees or count < 4:
            return None
        candidates = [k for k in range(count) if self._without(k).agrees]
        return candidates[0] if len(candidates) == 1 else None

    def _without(self, k: int) -> Agreement:
        """Return the agreement of all estimates but one."""
        return replace(self, values=np.delete(self.values, k), errors=np.delete(self.errors, k))

    @property
    def decisive(self) -> int | None:
        """Index of the estimate with nearly all of the weight of the mean; None if there is none."""
        weights = 1 / (self.errors**2 + self.scatter**2)
        heaviest = int(np.argmax(weights))
        return heaviest if weights[heaviest] > NEARLY_ALL * weights.sum() else None

    def text(self) -> str:
        """Return the agreement as one line."""
        low, high = self.interval
        ends = ", ".join(to_width(end, high - low, 3) for end in (low, high))
        unit = f" {self.unit}" if self.unit else ""
        p_value = f"p = {self.probability:.2g}" if self.probability >= 1e-4 else "p < 0.0001"
        verdict = "agree" if self.agrees else "hardly agree" if self.probability >= DISAGREE else "do not agree"
        alone = "" if self.decisive is None else f"; number {self.decisive + 1} decides, and the others hardly test it"
        return (
            f"{self.name}: {with_error(self.mean, self.error, self.unit)}, 95 % interval [{ends}]; the "
            f"{len(self.values)} records {verdict} ({p_value}), scatter between them {self.scatter:.2g}{unit}{alone}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the agreement for JSON."""
        return {
            "name": self.name,
            "unit": self.unit,
            "values": [finite_or_none(value) for value in self.values.tolist()],
            "standard_errors": [finite_or_none(error) for error in self.errors.tolist()],
            "scatter": self.scatter,
            "probability": self.probability,
            "mean": self.mean,
            "standard_error": self.error,
            "interval_95": list(self.interval),
            "agrees": self.agrees,
        }


def agreements(fit: Fit, masks: Sequence[Mask]) -> tuple[Agreement, ...]:
    """Return the agreement of the records of a fit on each unknown that two or more determine.

    ``masks`` (m,) select the residuals of each record.  The noise of a record counts as no less than that of the fit: a
    few values may be near their curve by chance.
    """
    if len(masks) < 2:
        return ()
    y = fit.coordinates
    by_record = [subset_estimates(fit, mask, math.sqrt(fit.noise.variance)) for mask in masks]
    values = np.array([y.unknowns(coordinates) for coordinates, _ in by_record])
    steps = np.array([np.sqrt(np.diag(covariance)) for _, covariance in by_record])
    determined = (steps > 0.0) & (steps < fit.scale)
    errors = np.maximum(steps, ROUNDING * fit.scale) * np.abs([y.slopes(coordinates) for coordinates, _ in by_record])
    return tuple(
        Agreement(unknown.name, unknown.unit, values[rows, k], errors[rows, k], unknown.lower, unknown.upper)
        for k, (unknown, rows) in enumerate(zip(fit.unknowns, determined.T, strict=True))
        if np.count_nonzero(rows) > 1
    )


def subset_estimates(fit: Fit, mask: Mask, least_deviation: float = 0.0) -> tuple[Array, Array]:
    """Return the estimates (n,) from a subset of the residuals of a fit, to first order, and their covariance (n, n).

    Both are nan for unknowns that the subset does not determine, or that are at a bound.  The standard deviation of its
    noise counts as no less than ``least_deviation``.
    """
    n = len(fit.names)
    weights = row_weights(fit.residuals[mask], fit.huber)
    rows = fit.jacobian[mask] * fit.scale * weights[:, None]
    free = np.flatnonzero(~fit.active_bounds & (np.linalg.norm(rows, axis=0) > 0.0))
    values, covariance = np.full(n, math.nan), np.full((n, n), math.nan)
    if not 0 < len(free) < len(rows):
        return values, covariance
    length = np.linalg.norm(rows[:, free], axis=0)
    basis, triangle = np.linalg.qr(rows[:, free] / length)
    size = np.abs(np.diag(triangle))
    # share of a column that the other columns do not explain, below which it is undetermined
    if size.min() < 1e-10 * size.max():
        return values, covariance
    inverse = (fit.scale[free] / length)[:, None] * np.linalg.inv(triangle)
    r = weights * fit.residuals[mask]
    values[free] = fit.values[free] - inverse @ (basis.T @ r)
    by_series = np.split(mask, np.cumsum(fit.series))[: len(fit.series)]
    series = [int(np.count_nonzero(selected)) for selected in by_series]
    times = None if fit.times is None else fit.times[mask]
    noise = estimated_noise(r - basis @ (basis.T @ r), basis, series, times).at_least(least_deviation)
    allowance = len(rows) * fit.systematic**2 * np.eye(len(free))
    covariance[np.ix_(free, free)] = inverse @ (noise.form(basis) + allowance) @ inverse.T
    return values, covariance


def allowing_for_later_starts(fit: Fit, late: Sequence[Mask]) -> Fit:
    """Return a fit whose covariance allows for the scatter of its estimates between late residuals and the others."""
    if not fit.rank or not fit.noise.variance > 0.0:
        return fit
    (basis, _), (psi, _) = fit.free_basis, influence(fit.residuals, fit.huber)
    before = fit.noise.form(basis)
    form = before.copy()
    for mask in late:
        share, axes = np.linalg.eigh(basis[mask].T @ basis[mask])
        v = axes @ ((axes.T @ (basis[mask].T @ psi[mask])) / np.sqrt(np.maximum(share * (1 - share), SHARED)))
        g = float(v @ np.linalg.solve(form, v))
        if scipy.special.chdtrc(len(v), g) < DISAGREE:
            form += (1 - 1 / g) * np.outer(v, v)
    return fit if np.array_equal(form, before) else _with_transient(fit, form - before)


def allowing_for_errors(fit: Fit, errors: Array) -> Fit:
    """Return a fit whose covariance allows for errors of its data: independent normal multiples of columns (m, k)."""
    if not fit.rank or not fit.noise.variance > 0.0:
        return fit
    projections = fit.free_basis[0].T @ (row_weights(fit.residuals, fit.huber)[:, None] ** 2 * errors)
    return _with_transient(fit, projections @ projections.T)


def allowing_for_unequal_variances(fit: Fit) -> Fit:
    """Return a fit whose covariance is in no direction below that for residuals of unknown, unequal variances (HC2)."""
    if not fit.rank or not fit.noise.variance > 0.0:
        return fit
    (basis, _), (psi, _) = fit.free_basis, influence(fit.residuals, fit.huber)
    rows = (psi / np.sqrt(1.0 - np.sum(basis**2, axis=1)))[:, None] * basis
    excess, axes = np.linalg.eigh(rows.T @ rows - fit.noise.form(basis))
    return _with_transient(fit, axes @ (np.maximum(excess, 0.0)[:, None] * axes.T))


def _with_transient(fit: Fit, transient: Array) -> Fit:
    """Return a fit whose noise has a further covariance (n, n) of the projections on its orthonormal columns."""
    free, w, (basis, triangle) = ~fit.active_bounds, influence(fit.residuals, fit.huber)[1], fit.free_basis
    form = fit.noise.form(basis) + transient
    root = fit.scale[free, None] * np.linalg.inv(triangle) / w
    covariance = fit.covariance.copy()
    covariance[np.ix_(free, free)] += root @ transient @ root.T
    if fit.noise.transient is not None and fit.noise.basis is not None:
        turn = basis.T @ fit.noise.basis
        transient = transient + turn @ fit.noise.transient @ turn.T
    inflation = float(np.trace(form)) / (len(form) * fit.noise.variance)
    noise = replace(fit.noise, transient=transient, basis=basis, inflation=inflation)
    return replace(fit, covariance=covariance, noise=noise)
