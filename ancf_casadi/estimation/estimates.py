"""Estimates of a least-squares fit and their uncertainty, to first order.

A fit minimises L(x) = sum rho(r_i) over m residuals r(x).  With J their Jacobian by the n free unknowns (those not at a
bound), psi, w and e as in ``loss``, and the covariance R of the psi (``noise``), the estimates have to first order the
covariance

    C = (J' J)^-1 (J' R J/w^2 + m e^2 J' J) (J' J)^-1

and an interval x_k +- t (C_kk)^1/2 with the quantile t of Student's distribution with the degrees of freedom of R.  For
white noise these are m - n, and C = (phi/w) (J' J)^-1 with phi of ``loss``.  An interval ends at a bound.  Standard
errors take an unknown at its bound as known, intervals do not.  The interval of such an unknown x_k begins at the bound
and ends at a distance h from it.  With J_k = dr/dx_k, and p = J_k - J c the part of it that the free unknowns cannot
compensate,

    2 (psi' p) h + w p' p h^2 = phi t^2,    phi = p' R p/(w p' p) + m w e^2.

Meanwhile the free unknowns move by -c h.  A quantity q then changes by s = h (dq/dx_k - dq/dx c), and on the side of s
the interval of q reaches to (t^2 C_qq + s^2)^1/2 from its estimate, the extent of an ellipse that contains the region
of ``profile``.

The solver may work with the reciprocal y = 1/x of an unknown (``Unknown.reciprocal``).  All of the above then holds for
y; its standard error becomes that of x to first order, and the ends of its interval are the reciprocals of those of y.

To first order, a change c of the residuals shifts the estimates by -(J' D J)^-1 J' D c, with D the diagonal matrix of
the psi'(r_i); ``Estimates.shifts`` gives this in standard errors.

References
----------
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Sections 2.1, 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.solver.loss import dispersion, influence, row_weights
from ancf_casadi.estimation.solver.noise import Noise, autocorrelation
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import number

Quantities = Callable[..., cs.MX]  # unknowns as MX scalars, in their order -> MX vector of quantities

CONFIDENCE_LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimated unknowns and their uncertainty; ``estimates["name"]`` is the value of an unknown.

    The arrays are in the coordinates of the solver: the unknowns, or the reciprocals of those that are reciprocal.

    Parameters
    ----------
    unknowns : tuple of Unknown
        The n unknowns, free or not.
    values : ndarray
        Estimates (n,).
    covariance : ndarray
        Covariance (n, n); nan for unknowns at a bound.
    active_bounds : ndarray of bool
        Unknowns at a bound (n,).
    residuals : ndarray
        Residuals (m,).
    series : tuple of int
        Lengths of the series of residuals, which follow one another; each series is in the order of time.  Empty if the
        residuals have no order.
    times : ndarray or None
        Times of the residuals (m,), s; None if those of a series are equally spaced.
    noise : Noise
        Covariance of the noise in the residuals.
    jacobian : ndarray
        Jacobian of the residuals (m, n).
    condition : float
        Condition number of the Jacobian of the free unknowns, its columns scaled to unit length.
    huber : float
        Residual d beyond which the loss grows linearly; infinite for least squares.
    systematic : float
        Root mean square e of a systematic error of the residuals, for which the standard errors allow.
    status : str
        Return status of IPOPT.
    iterations : int
        Iterations of IPOPT, and Gauss-Newton steps.
    solve_seconds : float
        Solution time of IPOPT, s.
    model : casadi.Function
        Coordinates in units of their scales -> residuals, and their Jacobian by these.
    settings : mapping
        Settings of ``least_squares``, for a fit to other data.
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    active_bounds: Mask
    residuals: Array
    series: tuple[int, ...]
    times: Array | None
    noise: Noise
    jacobian: Array
    condition: float
    huber: float
    systematic: float
    status: str
    iterations: int
    solve_seconds: float
    model: cs.Function
    settings: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the unknowns."""
        return tuple(unknown.unit for unknown in self.unknowns)

    @cached_property
    def coordinates(self) -> Coordinates:
        """The coordinates of the solver."""
        return Coordinates.of(self.unknowns)

    @property
    def scale(self) -> Array:
        """Scales of the coordinates (n,): typical sizes of their changes."""
        return self.coordinates.scale

    @property
    def lower(self) -> Array:
        """Lower bounds of the coordinates (n,)."""
        return self.coordinates.lower

    @property
    def upper(self) -> Array:
        """Upper bounds of the coordinates (n,)."""
        return self.coordinates.upper

    @property
    def estimates(self) -> dict[str, float]:
        """Value of each unknown by name; infinite for a reciprocal of zero."""
        return dict(zip(self.names, self.coordinates.unknowns(self.values).tolist(), strict=True))

    def __getitem__(self, name: str) -> float:
        """Return the value of an unknown."""
        return self.estimates[name]

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return tuple(name for name, active in zip(self.names, self.active_bounds, strict=True) if active)

    @property
    def rank(self) -> int:
        """Number of free unknowns."""
        return int(np.count_nonzero(~self.active_bounds))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of residuals less the number of free unknowns."""
        return len(self.residuals) - self.rank

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals, Eq. (10)."""
        return math.sqrt(np.mean(self.residuals**2))

    @property
    def autocorrelation(self) -> float:
        """Correlation of successive residuals of a series; nan if there are none."""
        if max(self.series, default=len(self.residuals)) < 2:
            return math.nan
        return float(autocorrelation(self.residuals, self.series, self.times)[1])

    @property
    def effective_samples(self) -> float:
        """Number of residuals with white noise of equal variance that would determine the unknowns as well, at most m.

        It is m over ``noise.growth``, the mean increase of the variances by the colour of the noise.
        """
        return len(self.residuals) / max(self.noise.growth, 1.0)

    @property
    def white_errors(self) -> Array:
        """Standard errors (n,) if the noise were white; nan for unknowns at a bound."""
        errors, free = np.full(len(self.names), math.nan), ~self.active_bounds
        triangle = np.linalg.qr(self.jacobian[:, free] * self.scale[free], mode="r")
        phi = dispersion(self.residuals, self.degrees_of_freedom, self.huber, self.systematic)
        w = influence(self.residuals, self.huber)[1]
        errors[free] = self.scale[free] * np.linalg.norm(np.linalg.inv(triangle), axis=1) * math.sqrt(phi / w)
        return errors

    def dispersion(self, column: Array) -> float:
        """Return the variance phi of the residuals in the direction of a column (m,); nan for no degrees of freedom."""
        w = influence(self.residuals, self.huber)[1]
        return self.noise.along(column) / w + len(self.residuals) * w * self.systematic**2

    @property
    def errors(self) -> Array:
        """Standard errors of the coordinates (n,); nan at a bound."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each unknown by name; nan at a bound."""
        errors = self.errors * np.abs(self.coordinates.slopes(self.values))
        return dict(zip(self.names, errors.tolist(), strict=True))

    @property
    def correlations(self) -> Array:
        """Correlations (n, n); nan for unknowns at a bound, or if all residuals are zero."""
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(self.errors, self.errors)

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> Array:
        """Return the intervals (n, 2) of the unknowns for a confidence level, to first order.

        The interval of a reciprocal unknown has no upper end if the reciprocal may be at its lower bound.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        ends = self.ends_of(self.values, np.eye(len(self.names)), level)
        ends = np.clip(ends, self.lower[:, None], self.upper[:, None])
        inverse = self.coordinates.reciprocal
        ends[inverse & (ends[:, 0] <= self.lower), 0] = 0.0
        with np.errstate(divide="ignore"):
            ends[inverse] = 1 / ends[inverse, ::-1]
        return np.asarray(ends)

    def derived(self, quantities: Quantities) -> tuple[Array, Array]:
        """Return quantities (q,) and their standard errors to first order, nan where no free unknown enters."""
        values, jacobian = self.linearised(quantities)
        return values, self.errors_of(jacobian)

    def derived_intervals(self, quantities: Quantities, level: float = CONFIDENCE_LEVEL) -> Array:
        """Return the intervals (q, 2) of quantities, to first order; nan where no unknown enters."""
        return self.ends_of(*self.linearised(quantities), level)

    def shifts(self, change: Array) -> Array:
        """Return the shifts (n,) of the estimates by a change of the residuals (m,), in standard errors.

        The shifts are to first order.  An unknown at a bound has no standard error; the length of its one-sided
        interval over the quantile t takes its place.  A shift is nan where neither is known.
        """
        weights = row_weights(self.residuals, self.huber)
        columns, change = self.jacobian * self.scale * weights[:, None], weights * change
        free = columns[:, ~self.active_bounds]
        shifts = np.empty(len(self.names))
        shifts[~self.active_bounds] = -np.linalg.lstsq(free, change)[0]
        for k in np.flatnonzero(self.active_bounds).tolist():
            column = columns[:, k] - free @ np.linalg.lstsq(free, columns[:, k])[0]
            shifts[k] = -(column @ change) / (column @ column)
        errors = self.errors
        reach = np.abs(np.diag(self.moves(CONFIDENCE_LEVEL)[self.active_bounds]))
        errors[self.active_bounds] = reach / self.quantile(CONFIDENCE_LEVEL)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(shifts * self.scale / errors)

    def quantile(self, level: float) -> float:
        """Return the quantile t of a two-sided interval (``quantile``)."""
        return quantile(level, self.noise.freedom)

    def moves(self, level: float) -> Array:
        """Return the changes (n, b) of all unknowns when each of the b unknowns at a bound moves inwards by its h."""
        moves = np.zeros((len(self.names), int(np.count_nonzero(self.active_bounds))))
        psi, curvature = influence(self.residuals, self.huber)
        free, scale = ~self.active_bounds, self.scale[~self.active_bounds]
        scaled = self.jacobian[:, free] * scale
        for move, k in zip(moves.T, np.flatnonzero(self.active_bounds).tolist(), strict=True):
            inwards = 1.0 if self.values[k] == self.lower[k] else -1.0
            column = inwards * self.jacobian[:, k]
            compensation = np.linalg.lstsq(scaled, column)[0]
            column = column - scaled @ compensation
            g, a = max(float(psi @ column), 0.0), curvature * float(column @ column)
            room = self.dispersion(column) * self.quantile(level) ** 2
            denominator = g + math.sqrt(g**2 + a * room)
            reach = room / denominator if denominator > 0.0 else math.inf
            move[k] = inwards * reach
            move[free] = -reach * scale * compensation if math.isfinite(reach) else 0.0
        return moves

    def linearised(self, quantities: Quantities) -> tuple[Array, Array]:
        """Return quantities (q,) and their Jacobian (q, n) at the estimates."""
        y = cs.MX.sym("y", len(self.names))
        q = cs.densify(quantities(*self.coordinates.symbols(cs.vertsplit(y))))
        values, jacobian = cs.Function("quantities", [y], [q, cs.densify(cs.jacobian(q, y))])(self.values)
        return values.full().ravel(), jacobian.full()

    def errors_of(self, jacobian: Array) -> Array:
        """Return the standard errors of quantities from their Jacobian (q, n); nan where no free unknown enters."""
        free = ~self.active_bounds
        own = jacobian[:, free]
        errors = np.sqrt(np.sum((own @ self.covariance[np.ix_(free, free)]) * own, axis=1))
        return np.where(own.any(axis=1), errors, math.nan)

    def ends_of(self, values: Array, jacobian: Array, level: float) -> Array:
        """Return the intervals (q, 2) of quantities from values (q,) and Jacobian (q, n); nan for certain ones."""
        half = np.nan_to_num(self.quantile(level) * self.errors_of(jacobian))
        with np.errstate(invalid="ignore"):  # 0 times an infinite move is nan; np.fmax ignores it
            steps = jacobian @ self.moves(level)
        below, above = (np.hypot(half, np.linalg.norm(np.fmax(side * steps, 0.0), axis=1)) for side in (-1.0, 1.0))
        ends = np.array([values - below, values + above]).T
        ends[~jacobian.any(axis=1) | (self.noise.freedom == 0)] = math.nan
        return ends


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates y of the solver: y = x of an unknown x, or y = 1/x if it is reciprocal.

    Parameters
    ----------
    scale, guess, lower, upper : ndarray
        Scales, starting values and bounds (n,).
    reciprocal : ndarray of bool
        Unknowns that are reciprocal (n,).
    """

    scale: Array
    guess: Array
    lower: Array
    upper: Array
    reciprocal: Mask

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Coordinates:
        """Return the coordinates of unknowns."""
        rows = [
            (1 / u.scale, 1 / u.guess, 1 / u.upper, 1 / u.lower)
            if u.reciprocal
            else (u.scale, u.guess, u.lower, u.upper)
            for u in unknowns
        ]
        scale, guess, lower, upper = np.array(rows).reshape(len(rows), 4).T
        return cls(scale, guess, lower, upper, np.array([u.reciprocal for u in unknowns], dtype=bool))

    def symbols(self, y: Sequence[cs.MX]) -> list[cs.MX]:
        """Return the unknowns as expressions of the coordinates."""
        return [1 / one if inverse else one for one, inverse in zip(y, self.reciprocal.tolist(), strict=True)]

    def unknowns(self, y: Array) -> Array:
        """Return the unknowns (n,) at values of the coordinates (n,)."""
        with np.errstate(divide="ignore"):
            return np.where(self.reciprocal, 1 / np.where(self.reciprocal, y, 1.0), y)

    def slopes(self, y: Array) -> Array:
        """Return the derivatives (n,) of the unknowns by the coordinates."""
        return np.where(self.reciprocal, -(self.unknowns(y) ** 2), 1.0)


def quantile(level: float, freedom: float) -> float:
    """Return the quantile of Student's distribution for a two-sided interval; nan for zero degrees of freedom."""
    if not 0.0 < number(level, "level") < 1.0:
        raise InputError(f"must be between 0 and 1, got {level:g}", "level")
    return float(scipy.special.stdtrit(freedom, 0.5 + level / 2)) if freedom else math.nan
