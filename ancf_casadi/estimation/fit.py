"""Estimates of a least-squares fit and their standard errors, to first order, with warnings, notes and JSON.

A fit minimises L(x) = sum rho(r_i) over m residuals r(x).  With J their Jacobian by the n free unknowns (those not at a
bound), psi, w and e as in ``gauss_newton``, and the covariance R of the psi (``noise``), the estimates have to first
order the covariance

    C = (J' J)^-1 (J' R J/w^2 + m e^2 J' J) (J' J)^-1

For white noise this is (phi/w) (J' J)^-1 with phi of ``gauss_newton``.  Standard errors take an unknown at its bound as
known; intervals do not.  An unknown x_k has the interval

    x_k +- t (C_kk)^1/2

with the quantile t of Student's distribution with the degrees of freedom of R, for white noise m - n.  An interval ends
at a bound.  That of an unknown x_k at its bound begins there, and ends at a distance h from it.  With J_k = dr/dx_k,
and p = J_k - J c the part of it that the free unknowns cannot compensate,

    2 (psi' p) h + w p' p h^2 = phi t^2,    phi = p' R p/(w p' p) + m w e^2.

Meanwhile the free unknowns move by -c h.  A quantity q then changes by s = h (dq/dx_k - dq/dx c), and on the side of s
the interval of q reaches to (t^2 C_qq + s^2)^1/2 from its estimate, the extent of an ellipse that contains the region
of ``intervals``.

The solver may work with the reciprocal y = 1/(x + s) of an unknown (``unknown``).  All of the above then holds for y;
its standard error becomes that of x to first order, and the ends of its interval are those of the interval of y.

To first order, a change c of the residuals shifts the estimates by -(J' D J)^-1 J' D c, with D the diagonal matrix of
the psi'(r_i); ``Fit.shifts`` gives this in standard errors.

References
----------
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Sections 2.1, 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.noise.covariance import Noise
from ancf_casadi.estimation.noise.series import MOST_CONCENTRATION, autocorrelation, concentration
from ancf_casadi.estimation.noise.stated import CONTRADICTED
from ancf_casadi.estimation.solver.gauss_newton import dispersion, influence, row_weights
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown, share_lines
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import number
from ancf_casadi.support.tables import finite

Quantities = Callable[..., cs.MX]  # unknowns as MX scalars, in their order -> MX vector of quantities

CONFIDENCE_LEVEL = 0.95
CORRELATED = 0.95  # correlation of two unknowns beyond which there is a warning
POOR = 0.05  # relative standard error of one of them for it (test_unknowns_hardly_told_apart_are_named)
ROUNDING = 1e-10  # standard error relative to the scale of an unknown that only a record without noise leaves


def quantile(level: float, freedom: float) -> float:
    """Return the quantile of Student's distribution for a two-sided interval; nan for zero degrees of freedom."""
    if not 0.0 < number(level, "level") < 1.0:
        raise InputError(f"must be between 0 and 1, got {level:g}", "level")
    return float(scipy.special.stdtrit(freedom, 0.5 + level / 2)) if freedom else math.nan


@dataclass(frozen=True)
class SolverSettings:
    """Settings of the solver that minimises the sum of squares of residuals."""

    closed_form: bool = True  # second derivatives of the residuals are cheap: IPOPT, else Gauss-Newton steps
    inaccuracy: float = 0.0  # norm of the error of the residuals, below which they need not be minimised
    advice: str = ""  # for the error message if there is no solution


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimated unknowns and their uncertainty; ``fit["name"]`` is the value of an unknown.

    The arrays are in the coordinates of the solver: the unknowns, or the reciprocals of those that are reciprocal.
    """

    unknowns: tuple[Unknown, ...]  # n, free or not
    values: Array  # estimates (n,)
    covariance: Array  # (n, n); nan for unknowns at a bound
    active_bounds: Mask  # unknowns at a bound (n,)
    residuals: Array  # (m,)
    series: tuple[int, ...]  # lengths of the series of residuals, each in the order of time; empty if without order
    times: Array | None  # times of the residuals (m,), s; None if those of a series are equally spaced
    noise: Noise  # covariance of the noise in the residuals
    jacobian: Array  # of the residuals (m, n)
    condition: float  # of the Jacobian of the free unknowns, its columns scaled to unit length
    huber: float  # residual d beyond which the loss grows linearly; infinite for least squares
    systematic: float  # root mean square e of a systematic error of the residuals, for which the standard errors allow
    status: str  # return status of IPOPT; "converged" after Gauss-Newton steps
    iterations: int  # of IPOPT, or Gauss-Newton steps
    solve_seconds: float  # solution time, s
    model: cs.Function  # coordinates in units of their scales -> residuals, and their Jacobian by these
    settings: SolverSettings

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
    def free_columns(self) -> Array:
        """Jacobian of the residuals with respect to the f free coordinates in units of their scales, (m, f)."""
        return self.jacobian[:, ~self.active_bounds] * self.scale[~self.active_bounds]

    @property
    def free_basis(self) -> tuple[Array, Array]:
        """Orthonormal basis q (m, f) of ``free_columns``, and the triangle R (f, f) for which they are q R."""
        return np.linalg.qr(self.free_columns)

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

        It is m over ``noise.inflation``, the mean increase of the variances by the colour of the noise.
        """
        return len(self.residuals) / max(self.noise.inflation, 1.0)

    @property
    def white_errors(self) -> Array:
        """Standard errors (n,) if the noise were white; nan for unknowns at a bound."""
        errors, free = np.full(len(self.names), math.nan), ~self.active_bounds
        phi = dispersion(self.residuals, self.degrees_of_freedom, self.huber, self.systematic)
        w = influence(self.residuals, self.huber)[1]
        errors[free] = self.scale[free] * np.linalg.norm(np.linalg.inv(self.free_basis[1]), axis=1) * math.sqrt(phi / w)
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
    def data_shares(self) -> dict[str, float]:
        """Share of each unknown with a prior that the data determine, 1 - (standard error/std of the prior)^2.

        It is 1 if the prior adds nothing, and 0 if the data add nothing; nan at a bound.
        """
        pairs = zip(self.unknowns, self.standard_errors.values(), strict=True)
        return {unknown.name: unknown.data_share(error) for unknown, error in pairs if unknown.prior}

    @property
    def reported_shares(self) -> dict[str, float]:
        """The shares of the data by the names in reports."""
        shares = self.data_shares
        return {unknown.report[0]: shares[unknown.name] for unknown in self.unknowns if unknown.name in shares}

    @property
    def correlations(self) -> Array:
        """Correlations (n, n); nan for unknowns at a bound, or if all residuals are zero."""
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(self.errors, self.errors)

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> Array:
        """Return the intervals (n, 2) of the unknowns for a confidence level, to first order.

        The interval of a reciprocal unknown has no upper end if the reciprocal may be at its lower bound.
        """
        ends = self.first_order_ends(self.values, np.eye(len(self.names)), level)
        ends = np.clip(ends, self.lower[:, None], self.upper[:, None])
        is_reciprocal = self.coordinates.reciprocal
        ends[is_reciprocal & (ends[:, 0] <= self.lower), 0] = 0.0  # an infinite unknown
        ends[is_reciprocal] = ends[is_reciprocal, ::-1]  # the unknown falls as the coordinate grows
        return np.stack([self.coordinates.unknowns(end) for end in ends.T], axis=1)

    def derived(self, quantities: Quantities) -> tuple[Array, Array]:
        """Return quantities (q,) and their standard errors to first order, nan where no free unknown enters."""
        values, jacobian = self.linearised(quantities)
        return values, self.errors_of(jacobian)

    def first_order_ends(self, values: Array, jacobian: Array, level: float) -> Array:
        """Return the intervals (q, 2) of quantities from values (q,) and Jacobian (q, n); nan for certain ones."""
        half = np.nan_to_num(self.quantile(level) * self.errors_of(jacobian))
        with np.errstate(invalid="ignore"):  # 0 times an infinite move is nan; np.fmax ignores it
            steps = jacobian @ self.bound_moves(level)[0]
        below, above = (np.hypot(half, np.linalg.norm(np.fmax(side * steps, 0.0), axis=1)) for side in (-1.0, 1.0))
        ends = np.array([values - below, values + above]).T
        ends[~jacobian.any(axis=1) | (self.noise.freedom == 0)] = math.nan
        return ends

    def bound_moves(self, level: float) -> tuple[Array, Array]:
        """Return the changes (n, b) of all unknowns when each of the b unknowns at a bound moves inwards by its h.

        Also return the variances phi (b,) in the directions p.
        """
        moves = np.zeros((len(self.names), int(np.count_nonzero(self.active_bounds))))
        variances = np.zeros(moves.shape[1])
        psi, curvature = influence(self.residuals, self.huber)
        free, scale = ~self.active_bounds, self.scale[~self.active_bounds]
        scaled = self.free_columns
        for j, (move, k) in enumerate(zip(moves.T, np.flatnonzero(self.active_bounds).tolist(), strict=True)):
            inwards = 1.0 if self.values[k] == self.lower[k] else -1.0
            column = inwards * self.jacobian[:, k]
            compensation = np.linalg.lstsq(scaled, column)[0]
            column = column - scaled @ compensation
            g, a = max(float(psi @ column), 0.0), curvature * float(column @ column)
            variances[j] = self.dispersion(column)
            room = variances[j] * self.quantile(level) ** 2
            denominator = g + math.sqrt(g**2 + a * room)
            reach = room / denominator if denominator > 0.0 else math.inf
            move[k] = inwards * reach
            move[free] = -reach * scale * compensation if math.isfinite(reach) else 0.0
        return moves, variances

    def shifts(self, change: Array) -> Array:
        """Return the shifts (n,) of the estimates by a change of the residuals (m,), in standard errors.

        The shifts are to first order.  An unknown at a bound has no standard error; the length of its one-sided
        interval over the quantile t takes its place.  A shift is nan where neither is known.
        """
        return np.asarray(self._response @ change)

    def scatter(self, deviations: Array) -> Array:
        """Return the root mean squares (n,) of the shifts by independent changes of the residuals, in standard errors.

        ``deviations`` (m,) are the root mean squares of the changes.
        """
        return np.asarray(np.linalg.norm(self._response * deviations, axis=1))

    @cached_property
    def _response(self) -> Array:
        """The shifts by a unit change of each residual, in standard errors, (n, m)."""
        weights = row_weights(self.residuals, self.huber)
        columns = self.jacobian * self.scale * weights[:, None]
        free = columns[:, ~self.active_bounds]
        inverse = np.empty(columns.T.shape)
        inverse[~self.active_bounds] = np.linalg.pinv(free)
        for k in np.flatnonzero(self.active_bounds).tolist():
            column = columns[:, k] - free @ np.linalg.lstsq(free, columns[:, k])[0]
            inverse[k] = column / (column @ column)
        errors = self.errors
        reach = np.abs(np.diag(self.bound_moves(CONFIDENCE_LEVEL)[0][self.active_bounds]))
        errors[self.active_bounds] = reach / self.quantile(CONFIDENCE_LEVEL)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(-inverse * weights * (self.scale / errors)[:, None])

    @property
    def remaining(self) -> Array:
        """Step (n,) to the minimum of the linearised residuals, in standard errors; 0 at a bound."""
        psi, weights = influence(self.residuals, self.huber)[0], row_weights(self.residuals, self.huber)
        return np.where(self.active_bounds, 0.0, self.shifts(psi / weights**2))

    def quantile(self, level: float) -> float:
        """Return the quantile t of a two-sided interval (``quantile``)."""
        return quantile(level, self.noise.freedom)

    def linearised(self, quantities: Quantities) -> tuple[Array, Array]:
        """Return quantities (q,) and their Jacobian (q, n) at the estimates."""
        values, jacobian = self.linearisation(quantities)(self.values)
        return values.full().ravel(), jacobian.full()

    def linearisation(self, quantities: Quantities) -> cs.Function:
        """Return the Function from the coordinates to quantities (q,) and their Jacobian (q, n)."""
        y = cs.MX.sym("y", len(self.names))
        q = cs.densify(quantities(*self.coordinates.symbols(cs.vertsplit(y))))
        return cs.Function("quantities", [y], [q, cs.densify(cs.jacobian(q, y))])

    def errors_of(self, jacobian: Array) -> Array:
        """Return the standard errors of quantities from their Jacobian (q, n); nan where no free unknown enters."""
        free = ~self.active_bounds
        rows = jacobian[:, free]
        errors = np.sqrt(np.sum((rows @ self.covariance[np.ix_(free, free)]) * rows, axis=1))
        return np.where(rows.any(axis=1), errors, math.nan)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unknowns, as reports name them, at a bound, correlated or near a bound; contradicted standard deviations."""
        names, units, factors = zip(*(unknown.report for unknown in self.unknowns), strict=True)
        values = np.array(list(self.estimates.values())) * factors
        notes = [
            f"{names[k]} is at its bound {values[k]:g}; the other standard errors take it as known"
            for k in np.flatnonzero(self.active_bounds).tolist()
        ]
        with np.errstate(invalid="ignore"):
            strong = np.triu(np.abs(self.correlations), 1) > CORRELATED
            poor = self.errors > np.maximum(POOR * np.abs(self.values), ROUNDING * self.scale)
        pairs = np.argwhere(strong & np.logical_or.outer(poor, poor)).tolist()
        if pairs:
            named = [f"{names[i]} and {names[j]} ({self.correlations[i, j]:.3f})" for i, j in pairs]
            notes.append(
                f"{', '.join(named)} are strongly correlated: only a combination of each pair is well determined; more "
                "data, or fewer unknowns, would help"
            )
        if self.noise.p_value < CONTRADICTED:
            notes.append(
                f"the residuals are {self.noise.stated_ratio:.2g} times the stated standard deviations: the model or "
                "the records are less accurate than stated, and the standard errors allow for it"
            )
        for k in np.flatnonzero(~self.active_bounds).tolist():
            (low, high), unknown = self.intervals()[k], self.unknowns[k]
            for bound, end in ((unknown.lower, low), (unknown.upper, high)):
                if end == bound:
                    value = f"{values[k]:.2g} {units[k]}".rstrip()
                    ends = ", ".join(f"{factors[k] * limit:.2g}" for limit in (low, high))
                    notes.append(
                        f"{names[k]} does not differ significantly from "
                        f"{f'its bound {factors[k] * bound:g}' if bound else 'zero'}: {value}, 95 % interval [{ends}]"
                    )
        return tuple(notes)

    def lines(self) -> list[str]:
        """Return residuals, bounds and the number of iterations as text."""
        ρ = self.autocorrelation
        correlated = f"successive residuals correlate at {ρ:.2f}, " if math.isfinite(ρ) else ""
        return [
            f"{len(self.residuals)} residuals, root mean square {self.residual_rms:.3g}; {correlated}effective number "
            f"of independent residuals {self.effective_samples:.0f}; {self.colour()}",
            f"{self.rank} of {len(self.names)} unknowns free of bounds, condition number {self.condition:.3g}",
            f"converged after {self.iterations} iterations",
            *share_lines(self.reported_shares),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        columns = {
            "name": self.names,
            "unit": self.units,
            "value": self.estimates.values(),
            "standard_error": self.standard_errors.values(),
            "standard_error_white": self.white_errors.tolist(),
            "interval_95": self.intervals().tolist(),
            "bounds": [(unknown.lower, unknown.upper) for unknown in self.unknowns],
            "at_bound": self.active_bounds.tolist(),
            "prior": [(unknown.prior[0], unknown.prior_std) if unknown.prior else None for unknown in self.unknowns],
            "data_share": [self.data_shares.get(name) for name in self.names],
        }
        data = {
            "unknowns": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
            "covariance": self.covariance.tolist(),
            "correlations": self.correlations.tolist(),
            "rank": self.rank,
            "condition": self.condition,
            "residuals": len(self.residuals),
            "residual_rms": self.residual_rms,
            "autocorrelation": self.autocorrelation,
            "effective_samples": self.effective_samples,
            "white_noise": self.noise.white,
            "status": self.status,
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
            "warnings": self.warnings,
        }
        return finite(data)

    def colour(self) -> str:
        """Return the colour of the noise, and the ratio of the standard errors to those for white noise, as text."""
        if self.noise.white or not self.rank:
            return "white noise" + self._statement()
        ratio = self.errors / self.white_errors
        ends = dict.fromkeys(f"{end:.2g}" for end in (np.nanmin(ratio), np.nanmax(ratio)))
        kind = "coloured noise" if self.noise.coloured else "noise that varies along the record"
        return f"{kind}: standard errors {' to '.join(ends)} times those for white noise" + self._statement()

    def _statement(self) -> str:
        """Return how the residuals agree with stated standard deviations as text; empty without these."""
        p_value, ratio = self.noise.p_value, self.noise.stated_ratio
        if math.isnan(p_value):
            return ""
        rounded = f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"
        use = "are taken as known" if ratio == 1.0 else f"count {ratio:.3g} times, as the residuals exceed them"
        return f"; the stated standard deviations {use} ({rounded})"


def colour_warning(fit: Fit, *, noise_free: float = 0.0) -> str | None:
    """Return a warning if residuals are not noise and their root mean square is above ``noise_free``; None if not."""
    if not fit.residual_rms > noise_free:
        return None
    if not concentration(fit.residuals, fit.series, fit.times) > MOST_CONCENTRATION:
        return None
    m, n = len(fit.residuals), fit.effective_samples
    worth = f" and determine the unknowns as well as {n:.0f} independent ones would" if n < m else ""
    return (
        f"the {m} residuals are not noise{worth}: the standard errors allow for their correlation, but the law "
        "does not explain all of the motion, unless the sensor colours its noise; try another law, or more modes"
    )
