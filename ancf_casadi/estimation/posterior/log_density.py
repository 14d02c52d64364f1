"""The density of the posterior distribution of the unknowns of a fit, with its exact gradient.

With the residuals r(y) of m measured values, their Jacobian J at the estimates y_e, and its QR decomposition J = q T,
the noise has the variances

    P = q' R q/w^2 + m e^2 I    in the directions q of the n fitted columns,    v = tr P/n    in all others,

with R, w and e as in ``fit``.  For white noise all of them are s^2.  With psi the derivatives of the loss L of the
residuals (``gauss_newton``; psi = r and w = 1 for least squares), the sum of squares

    Q(y) = 2 (L(y) - L(y_e))/(v w) + (u(y)' K u(y) - u(y_e)' K u(y_e)),    u = q' psi/w,    K = P^-1 - I/v,

has its minimum at the estimates, where its second derivatives are J' q P^-1 q' J, the inverse of the covariance of the
fit.  (Under the Huber loss, D = diag(psi') and M = q' D q/w, K is M^-1 (P^-1 - q' D q/(v w)) M^-1.)  The variances come
from the residuals, with f degrees of freedom (``noise``).  Integrated over a common factor of all variances with the
density 1/s^2, the likelihood of the normal distribution becomes that of Student's,

    log p(y | data) = -(f + n)/2 log(1 + Q(y)/f),

which for linear residuals gives the intervals of the fit exactly, and for large f is -Q/2.

Where p of the unknowns have priors, m counts the measured values alone, (f + n)/2 becomes (f + n - p)/2, and the
density is multiplied by those of the priors.  The estimates weigh priors by the standard deviations of the blocks; if
the noise differs from these, or is coloured, the maximum of the density is beside them.

An unknown without a prior has a constant density within its bounds.  Stiffnesses of a beam and of its clamps have it in
their reciprocal y (``solver.unknown``), in which a rigid clamp is no more than the point 0.

Samplers work with coordinates z without bounds (``transformation``).
The density of z is that of y times the Jacobian determinant, the product of the derivatives dy_k/dz_k.

References
----------
M. Ribatet, D. Cooley, A. C. Davison, Bayesian inference from composite likelihoods, with an application to spatial
extremes, Statistica Sinica 22 (2012), for densities whose curvature agrees with the covariance of an estimate.
A. Gelman et al., Bayesian Data Analysis, 3rd ed., CRC Press (2013), Section 14.2, for the variance integrated out.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.posterior.transformation import BoundTransformation
from ancf_casadi.estimation.solve import FitSolution
from ancf_casadi.estimation.solver.gauss_newton import influence, loss_value, row_weights
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.compilation import evaluate_dense
from ancf_casadi.support.inputs import array
from ancf_casadi.support.interrupts import delayed_interrupts
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True, eq=False)
class SumOfSquares:
    """The sum of squares Q(y) of the m residuals of measured values."""

    huber: float  # threshold of the loss L
    variance: float  # v
    curvature: float  # w
    basis: Array  # q, (m, n)
    weights: Array  # K, (n, n)
    least: float  # 2 L/(v w) + u' K u at the estimates

    def value_and_derivatives(self, residuals: Array) -> tuple[float, Array]:
        """Return Q, and its derivatives (m,) by the residuals (m,)."""
        psi, v, w = influence(residuals, self.huber)[0], self.variance, self.curvature
        u = self.basis.T @ psi / w
        value = 2 * loss_value(residuals, self.huber) / (v * w) + float(u @ self.weights @ u) - self.least
        rows = row_weights(residuals, self.huber) ** 2
        return value, 2 / w * (psi / v + rows * (self.basis @ (self.weights @ u)))


@dataclass(frozen=True, eq=False)
class LogDensity(Displayed):
    """The logarithm of the posterior density of the unknowns of a fit, in coordinates without bounds.

    It is known up to a constant, and can be pickled.

    Parameters
    ----------
    fit : Fit
        The estimates, the noise, and the residuals with their exact derivatives.
    solution : FitSolution, optional
        The blocks of measurements that the residuals come from.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
    >>> density = fit_decay(record).log_density()
    >>> density.names
    ('omega', 'zeta', 'e0', 'phase', 'offset')
    >>> value, gradient = density.value_and_gradient(density.start)
    >>> gradient.shape, bool(density.value(density.start + density.scale[:, 0]) < value)
    ((5,), True)
    """

    fit: Fit
    solution: FitSolution | None = None

    def __post_init__(self) -> None:
        """Check that the residuals scatter."""
        if not (self.fit.noise.freedom > 0.0 and self.fit.noise.variance + self.fit.systematic > 0.0):
            raise InputError(
                "has no scatter: the residuals are zero, or no more than the unknowns; use more data", "fit"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle blocks without Functions; the solution derives them again."""
        return (LogDensity, (self.fit,)) if self.solution is None else (_of_solution, (self.solution,))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n unknowns."""
        return self.fit.names

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each unknown."""
        return self.fit.units

    @cached_property
    def start(self) -> Array:
        """Coordinates (n,) of the estimates, moved to one standard error from each bound that is nearer.

        The other unknowns follow as their correlations say.
        """
        fit, y = self.fit, self.fit.values + self._moves_from_bounds.sum(axis=1) / max(len(self.fit.at_bound), 1)
        for k in np.flatnonzero(~fit.active_bounds).tolist():
            error = self.transformation.units[k]
            move = max(error - (y[k] - fit.lower[k]), 0.0) - max(error - (fit.upper[k] - y[k]), 0.0)
            y = y + np.nan_to_num(fit.covariance[:, k]) / fit.covariance[k, k] * move
        low, high = (fit.values + 0.9 * (bound - fit.values) for bound in (fit.lower, fit.upper))  # a tenth is left
        return self.transformation.unbounded(np.clip(y, low, high))

    @cached_property
    def scale(self) -> Array:
        """Square root (n, n) of the covariance of the coordinates, a lower triangle; columns are changes of them."""
        errors = np.sqrt(np.diag(self.covariance))
        root = np.linalg.cholesky(self.covariance / np.outer(errors, errors))
        return np.asarray(root * (self.transformation.units / self.transformation.slopes(self.start))[:, None])

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of the bounded coordinates, also of those at a bound."""
        return np.asarray(np.nan_to_num(self.fit.covariance) + self._moves_from_bounds @ self._moves_from_bounds.T)

    @cached_property
    def transformation(self) -> BoundTransformation:
        """The coordinates, in place of those of the solver, which have bounds."""
        lower, upper = self.fit.lower, self.fit.upper
        return BoundTransformation(lower, upper, np.minimum(np.sqrt(np.diag(self.covariance)), (upper - lower) / 4))

    def unknowns(self, x: Array) -> Array:
        """Return the unknowns (..., n), SI units, at coordinates (..., n)."""
        return self.fit.coordinates.unknowns(self.transformation.bounded(x))

    def coordinates(self, unknowns: Array) -> Array:
        """Return the coordinates (n,) of unknowns (n,) in SI units, which are within their bounds.

        Raises
        ------
        InputError
            If the unknowns are not n numbers within their bounds.
        """
        values = self._each(unknowns, "unknowns")
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            free_coordinates = self.transformation.unbounded(self.fit.coordinates.at(values))
        if not np.isfinite(free_coordinates).all():
            raise InputError("must be within their bounds", "unknowns")
        return free_coordinates

    def log_jacobian(self, x: Array) -> float:
        """Return the logarithm of the Jacobian determinant from the coordinates (n,) to the bounded unknowns."""
        with np.errstate(divide="ignore"):
            return float(np.sum(np.log(np.abs(self.transformation.slopes(x)))))

    def value(self, x: Array) -> float:
        """Return the logarithm of the density at coordinates (n,); minus infinity where it cannot be computed."""
        x = self._each(x, "x")
        r, *_ = self._evaluate(self._residuals, x)
        if not np.isfinite(r).all():
            return -math.inf
        return self._log_likelihood(r)[0] + self._prior(x)[0] + self.log_jacobian(x)

    def value_and_gradient(self, x: Array) -> tuple[float, Array]:
        """Return the logarithm of the density at coordinates (n,), and its gradient (n,) by them.

        Where the density cannot be computed, they are minus infinity and zeros.
        """
        x = self._each(x, "x")
        r, jacobian = self._evaluate(self.fit.model, x)
        if not (np.isfinite(r).all() and np.isfinite(jacobian).all()):
            return -math.inf, np.zeros(len(x))
        value, by_residuals = self._log_likelihood(r)
        prior, by_prior = self._prior(x)
        by_bounded = jacobian[: len(by_residuals)].T @ by_residuals / self.fit.scale + by_prior
        gradient = by_bounded * self.transformation.slopes(x) + self.transformation.log_slope_derivatives(x)
        return value + prior + self.log_jacobian(x), gradient

    def _prior(self, x: Array) -> tuple[float, Array]:
        """Return the logarithm of the density of the priors, and its derivatives (n,) by the bounded coordinates."""
        if not self._prior_count:
            return 0.0, np.zeros(len(x))
        value, gradient = evaluate_dense(self._prior_function, self.transformation.bounded(x))
        return float(value[0, 0]), gradient.ravel()

    @cached_property
    def _prior_function(self) -> cs.Function:
        """The logarithm of the density of the priors, and its gradient, as a Function of the bounded coordinates."""
        y, value = cs.MX.sym("y", len(self.names)), cs.MX(0.0)
        for unknown, x in zip(self.fit.unknowns, self.fit.coordinates.symbols(cs.vertsplit(y)), strict=True):
            if unknown.prior:
                # the density of y is that of x or log x times their derivative, of size 1, 1/x, (x + s)^2, (x + s)^2/x
                value -= unknown.prior_residual(x) ** 2 / 2
                value -= cs.log(x) if unknown.relative_prior else 0.0
                value += 2 * cs.log(x + unknown.offset) if unknown.offset is not None else 0.0
        return cs.Function("prior", [y], [value, cs.densify(cs.gradient(value, y))])

    def _evaluate(self, function: cs.Function, x: Array) -> list[Array]:
        """Return the outputs of a Function at coordinates (n,); nan where they cannot be computed."""
        y = self.transformation.bounded(x)
        try:
            with warnings.catch_warnings(), delayed_interrupts():
                warnings.simplefilter("ignore", RuntimeWarning)  # of a motion that cannot be computed
                if np.isfinite(y).all() and np.isfinite(self.transformation.slopes(x)).all():
                    return evaluate_dense(function, y / self.fit.scale)
        except RuntimeError:
            pass
        return [np.full(function.size_out(k), math.nan) for k in range(function.n_out())]

    def _log_likelihood(self, residuals: Array) -> tuple[float, Array]:
        """Return the logarithm of the likelihood, and its derivatives (m,) by the residuals of measured values."""
        f, n = self.fit.noise.freedom, len(self.names) - self._prior_count
        square, by_residuals = self._sum_of_squares.value_and_derivatives(
            residuals.ravel()[: len(self._sum_of_squares.basis)]
        )
        if math.isinf(f):
            return -square / 2, -by_residuals / 2
        if square < 0.0:  # below the least of a fit that did not quite reach it
            return -(f + n) / (2 * f) * square, -(f + n) / (2 * f) * by_residuals
        return -(f + n) / 2 * math.log1p(square / f), -(f + n) / (2 * (f + square)) * by_residuals

    @cached_property
    def _prior_count(self) -> int:
        """Number of priors, whose distances are the last residuals."""
        return sum(unknown.prior is not None for unknown in self.fit.unknowns)

    @cached_property
    def _residuals(self) -> cs.Function:
        """The residuals without their Jacobian."""
        z = cs.MX.sym("z", len(self.names))
        return cs.Function("residuals_alone", [z], [self.fit.model.call([z], True, False)[0]])

    @cached_property
    def _sum_of_squares(self) -> SumOfSquares:
        """Q, whose curvature at the estimates is the inverse of the covariance of the fit."""
        fit = self.fit
        order, m = np.argsort(fit.active_bounds, kind="stable"), len(fit.residuals) - self._prior_count
        residuals = fit.residuals[:m]
        basis = np.linalg.qr((fit.jacobian * fit.scale)[:m, order])[0]
        w, n = influence(residuals, fit.huber)[1], basis.shape[1]
        at_bound = fit.active_bounds[order][:n]
        P = fit.noise.form(np.pad(basis, [(0, self._prior_count), (0, 0)])) / w**2 + m * fit.systematic**2 * np.eye(n)
        P[np.not_equal.outer(at_bound, at_bound)] = 0.0  # so that the score of one at a bound moves no other
        v, rows = float(np.trace(P)) / n, row_weights(residuals, fit.huber)[:, None] * basis
        M = rows.T @ rows / w
        K = np.linalg.solve(M, np.linalg.solve(M, np.linalg.inv(P) - M / v).T)
        square = SumOfSquares(fit.huber, v, w, basis, K, 0.0)
        return replace(square, least=square.value_and_derivatives(residuals)[0])

    @cached_property
    def _moves_from_bounds(self) -> Array:
        """Changes (n, b) of all unknowns when each of the b ones at a bound moves inwards by one standard error."""
        fit, moves = self.fit, self.fit.bound_moves(CONFIDENCE_LEVEL)[0] / self.fit.quantile(CONFIDENCE_LEVEL)
        for step, k in zip(moves.T, np.flatnonzero(fit.active_bounds).tolist(), strict=True):
            if not math.isfinite(step[k]):  # the data do not depend on it
                step[k] = math.copysign(min(fit.scale[k], fit.upper[k] - fit.lower[k]), step[k])
            # other unknowns stay within their bounds, with a half of the room that they have
            room = np.where(step > 0.0, fit.upper - fit.values, fit.values - fit.lower) / 2
            step *= min(1.0, float(np.min(room[step != 0.0] / np.abs(step[step != 0.0]))))
        return moves

    def _each(self, values: Array, where: str) -> Array:
        """Return one number for each unknown (n,)."""
        numbers = array(values, where, finite=where != "x")  # samplers may go very far
        if numbers.shape != (len(self.names),):
            raise InputError(f"must be {len(self.names)} numbers, for {', '.join(self.names)}", where)
        return numbers

    def _summary(self) -> str:
        return f"of {', '.join(self.names)}; {len(self.fit.residuals)} residuals"


def _of_solution(solution: FitSolution) -> LogDensity:
    return LogDensity(solution.fit, solution)
