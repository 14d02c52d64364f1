"""What a least squares fit tells: estimates, how sure they are, and what to know before using them.

With residuals r(x), their Jacobian J, m of them and n unknowns that are not at a bound, the fit minimises L(x) = sum
rho(r_i).  Least squares has rho = r^2/2.  A robust fit has the pseudo-Huber loss rho = d^2 ((1 + (r/d)^2)^1/2 - 1),
which grows in proportion to r beyond d.  With psi = rho' and the mean w of psi'(r_i), white residuals give to first
order

    C = (phi/w) (J' J)^-1,    phi = sum psi_i^2 / ((m - n) w) + m w e^2   (least squares: w = 1, phi = s^2 + m e^2)

and an interval x_k +- t (C_kk)^1/2 with the quantile t of Student's distribution with m - n degrees of freedom.  An
interval ends at a bound.  Standard errors take an unknown at its bound as known, intervals do not.  Its own begins at
the bound and ends a distance h inwards, where, with the part p = J_k - J c of its column J_k of the Jacobian that the
free unknowns cannot make up for,

    2 (psi' p) h + w p' p h^2 = phi t^2.

Meanwhile the free unknowns move by -c h.  To a quantity q this adds the step s = h (dq/dx_k - dq/dx c), and its
interval reaches (t^2 C_qq + s^2)^1/2 to the side of s, which is the extent of an ellipse that holds the region below.

The second part of phi allows for a systematic error of root mean square e, which the residuals need not show: shared by
all m of them in the direction that is worst for an unknown, it shifts this one by m^1/2 e ((J' J)^-1_kk)^1/2.  It is 0
unless the caller knows of such an error.  To first order, a change c of the residuals shifts the estimates by
-(J' D J)^-1 J' D c, D the diagonal matrix of the psi'(r_i); ``Fit.shifts`` gives this in standard errors.

The interval by profile likelihood asks less: it is the range of a quantity q(x) over the x within all bounds that have
2 (L(x) - L_min) <= phi t^2.  Its ends are the solutions of two nonlinear programs, min and max q.  The same level is
used at a bound, where one end is certain: an interval there covers the truth at least as often as it says.

References
----------
G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley (1989), Sections 2.1, 5.3.
P. J. Huber, Robust Statistics, Wiley (1981), Section 7.6.
M. C. Neale, M. B. Miller, The use of likelihood-based confidence intervals in genetic models, Behavior Genetics 27
(1997).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np
from scipy.special import stdtrit

from ancf_casadi.estimation.autocorrelation import autocorrelation, effective_samples
from ancf_casadi.estimation.result import known
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import number
from ancf_casadi.support.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Quantities = Callable[..., cs.MX]

LEVEL = 0.95
CORRELATED = 0.95  # two unknowns beyond this are hardly told apart
COLOURED = 0.5  # correlation of successive residuals beyond which they are not noise


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimated unknowns, and how well the data determine them.

    ``fit["name"]`` is the value of an unknown.

    Parameters
    ----------
    names, units : tuple of str
        Names of the n unknowns, and their units.
    values : ndarray
        Their estimates (n,).
    lower, upper : ndarray
        Their bounds (n,).
    scale : ndarray
        The changes of them that matter (n,).
    covariance : ndarray
        Covariance (n, n); nan for unknowns at a bound.
    active_bounds : ndarray of bool
        Which unknowns are at a bound (n,).
    residuals : ndarray
        What the model leaves unexplained (m,).
    series : tuple of int
        Lengths of the series that the residuals are made of, one after the other, each in the order of time.
    jacobian : ndarray
        Derivatives of the residuals (m, n).
    condition : float
        Condition number of the Jacobian of the free unknowns, its columns of unit length.
    huber : float
        Residual d beyond which the loss grows linearly; infinite for least squares.
    systematic : float
        Root mean square e of a systematic error of the residuals that the standard errors allow for.
    status : str
        What the solver said.
    iterations : int
        Iterations of IPOPT.
    solve_seconds : float
        Time they took.
    model : casadi.Function
        Unknowns in units of their scales -> residuals, and their derivatives.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    lower: Array
    upper: Array
    scale: Array
    covariance: Array
    active_bounds: Mask
    residuals: Array
    series: tuple[int, ...]
    jacobian: Array
    condition: float
    huber: float
    systematic: float
    status: str
    iterations: int
    solve_seconds: float
    model: cs.Function

    def __getitem__(self, name: str) -> float:
        """Return the value of an unknown."""
        return float(self.values[self.names.index(name)])

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return tuple(name for name, active in zip(self.names, self.active_bounds, strict=True) if active)

    @property
    def rank(self) -> int:
        """How many unknowns the data determine: those not at a bound."""
        return int(np.count_nonzero(~self.active_bounds))

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of the residuals, m - n."""
        return len(self.residuals) - self.rank

    @property
    def residual_rms(self) -> float:
        """Root of the mean squared residual, Eq. (10)."""
        return math.sqrt(np.mean(self.residuals**2))

    @property
    def autocorrelation(self) -> float:
        """Correlation of successive residuals of a series; nan if there are none."""
        rho = autocorrelation(self.residuals, self.series)
        return float(rho[1]) if len(rho) > 1 else math.nan

    @property
    def effective_samples(self) -> float:
        """Number of independent residuals that tell as much as these (``ancf_casadi.estimation.autocorrelation``)."""
        return effective_samples(self.residuals, self.series)

    @property
    def errors(self) -> Array:
        """Standard errors (n,); nan for unknowns at a bound."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each unknown by name; nan at a bound."""
        return dict(zip(self.names, self.errors.tolist(), strict=True))

    @property
    def correlations(self) -> Array:
        """Correlations (n, n); nan for unknowns at a bound, or where there is no residual."""
        error = self.errors
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(error, error)

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of two unknowns; nan if one is at a bound, or there is no residual."""
        return float(self.correlations[self.names.index(first), self.names.index(second)])

    def intervals(self, level: float = LEVEL) -> Array:
        """Return the intervals (n, 2) of the unknowns that hold the truth with a probability, to first order.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        ends = self._ends(self.values, np.eye(len(self.names)), level)
        return np.asarray(np.clip(ends, self.lower[:, None], self.upper[:, None]))

    def derived(self, quantities: Quantities) -> tuple[Array, Array]:
        """Return functions of the unknowns, and their standard errors to first order.

        Parameters
        ----------
        quantities : callable
            Takes the unknowns as MX scalars, in their order; returns an MX vector.

        Returns
        -------
        values, standard_errors : ndarray
            A standard error is nan where a quantity depends on no unknown, or only on such as are at a bound.
        """
        values, slopes = self._linearised(quantities)
        return values, self._errors(slopes)

    def derived_intervals(self, quantities: Quantities, level: float = LEVEL) -> Array:
        """Return the intervals (q, 2) of functions of the unknowns, to first order; nan for one that depends on none.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        return self._ends(*self._linearised(quantities), level)

    def vagueness(self, names: Sequence[str]) -> float:
        """Return the largest share that one of some unknowns may be off by, in what all of them do to the residuals.

        With columns J_k of the Jacobian, and the wider side w_k of its interval, max |J_k| w_k / sum |J_k| |x_k|.
        """
        chosen = [k for k, name in enumerate(self.names) if name in names]
        if not chosen:
            return 0.0
        sizes = np.linalg.norm(self.jacobian[:, chosen], axis=0)
        wide = np.abs(self.intervals()[chosen] - self.values[chosen, None]).max(axis=1)
        total = float(sizes @ np.abs(self.values[chosen]))
        return float((sizes * wide).max()) / total if total > 0.0 else math.inf

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unknowns at a bound, strong correlations, and intervals that reach a bound."""
        notes = [
            f"{name} is at its bound {value:g}"
            for name, value, there in zip(self.names, self.values, self.active_bounds, strict=True)
            if there
        ]
        with np.errstate(invalid="ignore"):
            pairs = np.argwhere(np.triu(np.abs(self.correlations), 1) > CORRELATED).tolist()
        notes += [
            f"{self.names[i]} and {self.names[j]} correlate at {self.correlations[i, j]:.3f}: the data hardly tell "
            "them apart"
            for i, j in pairs
        ]
        for k in np.flatnonzero(~self.active_bounds).tolist():
            low, high = self.intervals()[k]
            for bound, end in ((self.lower[k], low), (self.upper[k], high)):
                if end == bound:
                    notes.append(
                        f"{self.names[k]} cannot be told from {f'its bound {bound:g}' if bound else 'zero'}: "
                        f"{self.values[k]:.2g} {self.units[k]}".rstrip()
                        + f", anywhere in [{low:.2g}, {high:.2g}]"
                    )
        return tuple(notes)

    def table(self) -> Table:
        """Return the unknowns with units, standard errors, intervals and bounds."""
        rows = [
            (
                name,
                float(value),
                unit,
                *(known(number) for number in (error, low, high)),
                "at its bound" if there else "",
            )
            for name, value, unit, error, (low, high), there in zip(
                self.names,
                self.values,
                self.units,
                self.errors,
                self.intervals(),
                self.active_bounds,
                strict=True,
            )
        ]
        columns = ("unknown", "value", "unit", "standard_error", "lower_95", "upper_95", "")
        notes = [
            f"{len(self.residuals)} residuals, rms {self.residual_rms:.3g}, successive ones correlate at "
            f"{self.autocorrelation:.2f}; worth {self.effective_samples:.0f} independent ones",
            f"rank {self.rank} of {len(self.names)}, condition {self.condition:.3g}",
            f"{self.status} after {self.iterations} iterations",
        ]
        return Table("fit", "Estimates with 95 % intervals", columns, rows, notes)

    def report(self) -> str:
        """Return the result as text."""
        return "\n".join([self.table().text(), *(f"  note: {note}" for note in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for what is not known."""
        per_unknown = zip(
            self.names, self.units, self.values, self.errors, self.intervals(), self.lower, self.upper,
            self.active_bounds, strict=True,
        )  # fmt: skip
        return {
            "unknowns": [
                {
                    "name": name,
                    "unit": unit,
                    "value": float(value),
                    "standard_error": known(error),
                    "interval_95": [known(low), known(high)],
                    "bounds": [known(lower), known(upper)],
                    "at_bound": bool(there),
                }
                for name, unit, value, error, (low, high), lower, upper, there in per_unknown
            ],
            "covariance": [[known(value) for value in row] for row in self.covariance],
            "correlations": [[known(value) for value in row] for row in self.correlations],
            "rank": self.rank,
            "condition": known(self.condition),
            "residuals": len(self.residuals),
            "residual_rms": self.residual_rms,
            "autocorrelation": known(self.autocorrelation),
            "effective_samples": self.effective_samples,
            "status": self.status,
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw the residuals and their autocorrelation."""
        from ancf_casadi.estimation.figures import residual_figure  # matplotlib is slow to import

        return residual_figure(self.residuals, self.series)

    @property
    def dispersion(self) -> float:
        """Variance phi of the residuals as the loss sees them; nan if they are not more than the free unknowns."""
        return dispersion(self.residuals, self.degrees_of_freedom, self.huber, self.systematic)

    def shifts(self, change: Array) -> Array:
        """Return the shifts (n,) of the estimates that a change of the residuals (m,) causes, in standard errors.

        The standard error of an unknown at a bound is that of an interval as wide as its own.  The shifts are to first
        order; nan where there is no standard error.
        """
        weights = (1 + (self.residuals / self.huber) ** 2) ** -0.75
        columns, change = self.jacobian * self.scale * weights[:, None], weights * change
        free = columns[:, ~self.active_bounds]
        shifts = np.empty(len(self.names))
        shifts[~self.active_bounds] = -np.linalg.lstsq(free, change)[0]
        for k in np.flatnonzero(self.active_bounds).tolist():
            column = columns[:, k] - free @ np.linalg.lstsq(free, columns[:, k])[0]
            shifts[k] = -(column @ change) / (column @ column)
        errors = self.errors
        own_moves = np.diag(self.moves(LEVEL)[self.active_bounds])
        errors[self.active_bounds] = np.abs(own_moves) / quantile(LEVEL, self.degrees_of_freedom)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(shifts * self.scale / errors)

    def _influence(self) -> tuple[Array, float]:
        """Return psi (m,) and w."""
        return influence(self.residuals, self.huber)

    def _linearised(self, quantities: Quantities) -> tuple[Array, Array]:
        x = cs.MX.sym("x", len(self.names))
        q = cs.densify(quantities(*cs.vertsplit(x)))
        values, slopes = cs.Function("quantities", [x], [q, cs.densify(cs.jacobian(q, x))])(self.values)
        return values.full().ravel(), slopes.full()

    def _errors(self, slopes: Array) -> Array:
        free = ~self.active_bounds
        errors = np.sqrt(np.sum((slopes[:, free] @ self.covariance[np.ix_(free, free)]) * slopes[:, free], axis=1))
        return np.where(slopes[:, free].any(axis=1), errors, math.nan)

    def _ends(self, values: Array, slopes: Array, level: float) -> Array:
        """Return the intervals (q, 2) of quantities with these values (q,) and derivatives by the unknowns (q, n)."""
        half = np.nan_to_num(quantile(level, self.degrees_of_freedom) * self._errors(slopes))
        with np.errstate(invalid="ignore"):  # of what may go anywhere, at no slope
            steps = slopes @ self.moves(level)
        below, above = (np.hypot(half, np.linalg.norm(np.fmax(side * steps, 0.0), axis=1)) for side in (-1.0, 1.0))
        ends = np.array([values - below, values + above]).T
        ends[~slopes.any(axis=1) | (self.degrees_of_freedom == 0)] = math.nan
        return ends

    def moves(self, level: float) -> Array:
        """Return the changes (n, b) of all unknowns as one of the b at a bound goes inwards as far as it may."""
        moves = np.zeros((len(self.names), int(np.count_nonzero(self.active_bounds))))
        slope, curvature = self._influence()
        room = self.dispersion * quantile(level, self.degrees_of_freedom) ** 2
        free, scale = ~self.active_bounds, self.scale[~self.active_bounds]
        scaled = self.jacobian[:, free] * scale
        for move, k in zip(moves.T, np.flatnonzero(self.active_bounds).tolist(), strict=True):
            inwards = 1.0 if self.values[k] == self.lower[k] else -1.0
            column = inwards * self.jacobian[:, k]
            made_up = np.linalg.lstsq(scaled, column)[0]
            column = column - scaled @ made_up
            g, a = max(float(slope @ column), 0.0), curvature * float(column @ column)
            slowness = g + math.sqrt(g**2 + a * room)
            reach = room / slowness if slowness > 0.0 else math.inf
            move[k] = inwards * reach
            move[free] = -reach * scale * made_up if math.isfinite(reach) else 0.0
        return moves


def influence(residuals: Array, huber: float) -> tuple[Array, float]:
    """Return the derivatives psi of the loss at residuals, and the mean w of its second derivatives."""
    stretch = 1 + (residuals / huber) ** 2
    return residuals / np.sqrt(stretch), float(np.mean(stretch**-1.5))


def dispersion(residuals: Array, freedom: int, huber: float, systematic: float) -> float:
    """Return the variance phi of residuals as the loss sees them; nan without freedom."""
    slope, curvature = influence(residuals, huber)
    spread = float(slope @ slope) / (freedom * curvature) if freedom else math.nan
    return spread + len(residuals) * curvature * systematic**2


def colour_warning(residuals: Array, noise_free: float = 0.0) -> str | None:
    """Return a warning if successive residuals correlate, and their root mean square is above ``noise_free``."""
    total, repeated = float(residuals @ residuals), float(residuals[1:] @ residuals[:-1])
    if not (total > len(residuals) * noise_free**2 and repeated > COLOURED * total):
        return None
    return (
        f"successive residuals correlate at {repeated / total:.2f}: they are not noise, the law does not tell all, and "
        "the standard errors are too small"
    )


def quantile(level: float, freedom: int) -> float:
    """Return the quantile of Student's distribution for a two-sided interval of a level; nan without freedom."""
    if not 0.0 < number(level, "level") < 1.0:
        raise InputError(f"must be between 0 and 1, got {level:g}", "level")
    return float(stdtrit(freedom, 0.5 + level / 2)) if freedom else math.nan
