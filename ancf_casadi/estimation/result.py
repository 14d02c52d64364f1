"""Results of fits: estimates with units, standard errors, intervals, warnings, text, JSON and a figure.

The result of least squares states quantities q(x) of the unknowns x of its fit, by default the unknowns themselves.
Those that depend on an unknown are its estimates.  With the derivatives Q = dq/dx and the covariance C of the free
unknowns, their covariance is Q C Q' to first order.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self, cast

import casadi as cs
import numpy as np

from ancf_casadi.estimation.agreement import Agreement, agreements
from ancf_casadi.estimation.block import Account
from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit, Quantities, colour_warning
from ancf_casadi.estimation.intervals import profile_interval, profiles
from ancf_casadi.estimation.posterior.log_density import LogDensity
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.estimation.solve import FitSolution
from ancf_casadi.estimation.solver.least_squares import refit_with_noise
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Reported, Table, finite, finite_or_none, with_error

Interval = tuple[float, float]


class FitResult(Reported):
    """The result of a fit."""

    kind: ClassVar[str]  # of the fit, in JSON
    _comparing = "ancf_casadi.figures.fits.saved_figure"

    again: Callable[[Any], Any]  # takes other records; returns the result of the same fit to them

    @property
    @abstractmethod
    def estimates(self) -> dict[str, float]:
        """Value of each estimated quantity by name."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """Unit of each estimated quantity by name."""

    @property
    @abstractmethod
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each estimated quantity by name; nan if unknown, as at a bound."""

    @abstractmethod
    def intervals(self, level: float = CONFIDENCE_LEVEL) -> dict[str, Interval]:
        """Return the interval of each estimated quantity by name for a confidence level, to first order."""

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """Covariance (p, p) of the p estimates; nan where unknown, as at a bound."""

    @property
    def correlations(self) -> Array:
        """Correlations (p, p) of the estimates; nan where unknown, as at a bound, or if all residuals are zero."""
        errors = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance / np.outer(errors, errors))

    @property
    @abstractmethod
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""

    @property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records on each quantity that several of them determine."""
        return ()

    @property
    @abstractmethod
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of Student's distribution for the intervals; infinite if the noise is known."""

    @property
    @abstractmethod
    def residual_count(self) -> int:
        """Number of residuals with known scatter; 0 if it is not known."""

    @abstractmethod
    def profile(self, name: str, level: float = CONFIDENCE_LEVEL) -> Interval:
        """Return the interval of an estimate by profile likelihood."""

    @abstractmethod
    def predict(self, record: Any) -> Any:
        """Compute another record with the estimates, without fitting, and compare."""

    def refit(self, records: Any) -> Self:
        """Return the result of the same fit, with the same settings, to other records."""
        return cast(Self, self.again(records))

    @abstractmethod
    def resampled(self, noise: Array) -> Array:
        """Return the estimates (p,) from a fit to the fitted curve plus noise of each residual (m,)."""

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals."""
        rows = [
            (name, value, unit, *map(finite_or_none, (error, low, high)), self._remark(name, error))
            for name, value, unit, error, (low, high) in self._rows()
        ]
        columns = ("estimate", "value", "unit", "standard_error", "lower_95", "upper_95", "")
        return Table(self.kind.replace(" ", "_"), f"{self.title}, 95 % intervals", columns, rows)

    @property
    def title(self) -> str:
        """Name of the fitted model, for the table and the one line that represents the result."""
        return self.kind

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        columns = ("name", "value", "unit", "standard_error", "interval_95")
        data = {
            "kind": self.kind,
            "estimates": [dict(zip(columns, row, strict=True)) for row in self._rows()],
            "covariance": self.covariance.tolist(),
            "degrees_of_freedom": self.degrees_of_freedom,
            "report": self.report(),
            "at_bound": self.at_bound,
            "agreements": [agreement.to_dict() for agreement in self.agreements],
            "warnings": self.warnings,
        }
        return finite(data)

    def check_name(self, name: str) -> None:
        """Check the name of an estimate."""
        if name not in self.estimates:
            raise InputError(f"is not estimated by this fit; it has {', '.join(self.estimates)}", name)

    def _remark(self, name: str, error: float) -> str:
        return "at its bound" if name in self.at_bound else "error unknown" * math.isnan(error)

    def _rows(self) -> list[tuple[str, float, str, float, Interval]]:
        """Return name, value, unit, standard error and interval of each estimate."""
        columns = (self.estimates, self.estimates.values(), self.units.values(), self.standard_errors.values())
        return list(zip(*columns, self.intervals().values(), strict=True))

    def _summary(self) -> str:
        shown = [
            f"{name} {with_error(value, error, unit) if math.isfinite(error) else f'{value:.5g} {unit}'.rstrip()}"
            for name, value, unit, error, _ in self._rows()
        ]
        return f"{self.title}: {', '.join(shown)}"


@dataclass(frozen=True, eq=False)
class LeastSquaresResult(FitResult):
    """The result of a fit by least squares."""

    fit: Fit  # the unknowns of the solver, with their uncertainty
    again: Callable[[Any], Any] = field(kw_only=True)

    @property
    def negligible(self) -> float:
        """Norm of residuals below which smaller ones are no evidence, such as that of rounding errors."""
        return 0.0

    @property
    def quantities(self) -> tuple[tuple[str, ...], tuple[str, ...], Quantities]:
        """Names and units of the quantities, and the function from the unknowns to them."""
        return self.fit.names, self.fit.units, lambda *x: cs.vertcat(*x)

    @cached_property
    def _linearised(self) -> tuple[Array, Array]:
        """Values (q,) of the quantities, and their Jacobian (q, n) by the coordinates of the solver."""
        return self.fit.linearised(self.quantities[2])

    @cached_property
    def _estimated(self) -> list[int]:
        """Positions of the estimates among the quantities."""
        return np.flatnonzero(self._linearised[1].any(axis=1)).tolist()

    def _named(self, values: Any) -> dict[str, Any]:
        """Return values (q, ...) of all quantities as a mapping from the names of the estimates."""
        names = self.quantities[0]
        return {names[k]: values[k] for k in self._estimated}

    @property
    def estimates(self) -> dict[str, float]:
        """Value of each estimated quantity by name."""
        return self._named(self._linearised[0].tolist())

    @property
    def units(self) -> dict[str, str]:
        """Unit of each estimated quantity by name."""
        return self._named(self.quantities[1])

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each estimated quantity by name; nan at a bound."""
        return self._named(self.fit.errors_of(self._linearised[1]).tolist())

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> dict[str, Interval]:
        """Return the interval of each estimated quantity by name for a confidence level.

        They are to first order, or by profile likelihood where the former are wrong by more than 5 % of their width
        (``profiled``).  Fits of beams, which would take long, and of response functions leave it to ``profile``.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        return self._named([(low, high) for low, high in self._ends(level).tolist()]) | self._profiles(level)

    @property
    def profiled(self) -> tuple[str, ...]:
        """Names of the estimates whose 95 % intervals are by profile likelihood."""
        return tuple(self._profiles(CONFIDENCE_LEVEL))

    def _profiles(self, level: float) -> dict[str, Interval]:
        """Return the intervals by profile likelihood where those to first order are wrong."""
        names, _, of = self.quantities
        return profiles(self.fit, names, None if names == self.fit.names else of, level)

    def _ends(self, level: float) -> Array:
        """Return the intervals (q, 2) of all quantities."""
        return self.fit.intervals(level)

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the p estimates; nan where one is at a bound."""
        free = ~self.fit.active_bounds
        jacobian = self._linearised[1][self._estimated][:, free]
        covariance = jacobian @ self.fit.covariance[np.ix_(free, free)] @ jacobian.T
        covariance[~jacobian.any(axis=1)] = covariance[:, ~jacobian.any(axis=1)] = math.nan
        return np.asarray(covariance)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return self.fit.at_bound

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        return self.fit.warnings

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the noise."""
        return self.fit.noise.freedom

    @property
    def residual_count(self) -> int:
        """Number of residuals with known scatter; 0 if they are zero or no more than the unknowns."""
        return len(self.fit.residuals) if self.fit.noise.variance > 0.0 else 0

    def profile(self, name: str, level: float = CONFIDENCE_LEVEL) -> Interval:
        """Return the interval of an estimate by profile likelihood.

        Raises
        ------
        InputError
            If there is no such estimate, the level is not between 0 and 1, or there is no scatter.
        FitError
            If a nonlinear program for an end does not converge.
        """
        self.check_name(name)
        names, _, of = self.quantities
        return profile_interval(self.fit, lambda *x: of(*x)[names.index(name)], level)

    def resampled(self, noise: Array) -> Array:
        """Return the estimates (p,) from a fit to the fitted curve plus noise of each residual (m,)."""
        x, of = refit_with_noise(self.fit, noise), self.quantities[2]
        return np.asarray(cs.evalf(cs.densify(of(*map(cs.MX, x.tolist()))))).ravel()[self._estimated]

    def _remark(self, name: str, error: float) -> str:
        return "interval by profile likelihood" if name in self.profiled else super()._remark(name, error)

    def log_density(self) -> LogDensity:
        """Return the logarithm of the posterior density of the unknowns of the fit, with its exact gradient.

        Raises
        ------
        InputError
            If there is no scatter.
        """
        return LogDensity(self.fit)

    @lasting_interrupts()
    def sample(
        self,
        draws: int = 500,
        *,
        chains: int = 4,
        seed: int = 0,
        executor: Executor | None = None,
        jobs: int = 1,
        progress: bool = False,
    ) -> Any:
        """Draw samples of the posterior distribution of the estimates with nutpie.

        Parameters
        ----------
        draws, chains, seed : int
            Draws of each chain, at least 4; chains, which start at different points, so that two or more show whether
            they agree; seed of the draws.
        executor, jobs, progress
            As in ``run_all``, for the chains; with ``jobs`` above 1 a script needs ``if __name__ == "__main__":``.

        Returns
        -------
        arviz.InferenceData
            The groups ``posterior``, with each estimate by name, and ``sample_stats``.

        Raises
        ------
        InputError
            If a number is not usable, there is no scatter, or nutpie or ArviZ is not installed.

        Warns
        -----
        RuntimeWarning
            If the chains have not converged.
        """
        from ancf_casadi.estimation.posterior.sampling import sample_posterior  # only here

        (names, units, of), estimated = self.quantities, self._estimated
        named = [names[k] for k in estimated], [units[k] for k in estimated], lambda *x: of(*x)[estimated]
        runs: dict[str, Any] = {"executor": executor, "jobs": jobs, "progress": progress}
        return sample_posterior(self.log_density(), named, draws=draws, chains=chains, seed=seed, **runs)

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals."""
        return replace(super().table(), notes=self.fit.lines())

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        return {**super().to_dict(), "profiled": list(self.profiled), "fit": self.fit.to_dict()}


@dataclass(frozen=True, eq=False)
class BlocksResult(LeastSquaresResult):
    """The result of a fit of blocks of measurements."""

    solution: FitSolution  # of ``fit``

    @property
    def negligible(self) -> float:
        """Norm of residuals below which smaller ones are no evidence, those of the computation."""
        return self.solution.problem.negligible

    def log_density(self) -> LogDensity:
        """Return the logarithm of the posterior density of the unknowns of the fit, with its exact gradient."""
        return LogDensity(self.fit, self.solution)

    def _profiles(self, level: float) -> dict[str, Interval]:
        return {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without Functions; the solution has the fit, and derives them again."""
        return _restore, (
            type(self),
            {field_.name: getattr(self, field_.name) for field_ in fields(self) if field_.name != "fit"},
        )

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return agreements(self.fit, [mask for mask in self.solution.problem.masks if mask.any()])

    @cached_property
    def accounts(self) -> tuple[Account, ...]:
        """Lines, warnings and data of each block of measurements."""
        return tuple(block.account(fitted) for block, fitted in self.solution.fitted_blocks)

    @property
    def channels(self) -> tuple[PredictedChannel, ...]:
        """Measured and computed values of all records."""
        return tuple(channel for block, fitted in self.solution.fitted_blocks for channel in block.channels(fitted))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        # systematic errors of a record, up to which residuals may be those of the computation
        colour = colour_warning(self.fit, noise_free=3.0 * self.fit.systematic)
        notes = [colour, *(agreement.warning for agreement in self.agreements)]
        return (
            *self.fit.warnings,
            *filter(None, notes),
            *(text for account in self.accounts for text in account.warnings),
        )

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals; notes say what each record shows."""
        table, lines = super().table(), [line for account in self.accounts for line in account.lines]
        return replace(table, notes=[*table.notes, *lines, *(agreement.text() for agreement in self.agreements)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        return {**super().to_dict(), "records": [account.data for account in self.accounts]}


def _restore(kind: type[BlocksResult], fields_by_name: dict[str, Any]) -> BlocksResult:
    return kind(fields_by_name["solution"].fit, **fields_by_name)
