"""The solution of a least-squares problem: estimates with warnings, notes and JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.estimation.estimates import Estimates
from ancf_casadi.estimation.solver.noise import MOST_CONCENTRATION, concentration
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import known

CORRELATED = 0.95  # correlation of two unknowns beyond which there is a warning


@dataclass(frozen=True, eq=False)
class Fit(Estimates):
    """Estimated unknowns and their uncertainty, with the parameters and attributes of ``Estimates``."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Unknowns at a bound, strong correlations, and intervals that reach a bound."""
        notes = [
            f"{name} is at its bound {self[name]:g}; the other standard errors take it as known"
            for name in self.at_bound
        ]
        with np.errstate(invalid="ignore"):
            pairs = np.argwhere(np.triu(np.abs(self.correlations), 1) > CORRELATED).tolist()
        notes += [
            f"{self.names[i]} and {self.names[j]} correlate at {self.correlations[i, j]:.3f}: the data determine a "
            "combination of the two much better than each alone; more data, or one unknown fewer, would help"
            for i, j in pairs
        ]
        for k in np.flatnonzero(~self.active_bounds).tolist():
            (low, high), unknown = self.intervals()[k], self.unknowns[k]
            for bound, end in ((unknown.lower, low), (unknown.upper, high)):
                if end == bound:
                    value = f"{self[unknown.name]:.2g} {unknown.unit}".rstrip()
                    notes.append(
                        f"{unknown.name} does not differ significantly from "
                        f"{f'its bound {bound:g}' if bound else 'zero'}: {value}, 95 % interval [{low:.2g}, {high:.2g}]"
                    )
        return tuple(notes)

    def lines(self) -> list[str]:
        """Return residuals, bounds and the status of the solver as text."""
        return [
            f"{len(self.residuals)} residuals, root mean square {self.residual_rms:.3g}; successive residuals "
            f"correlate at {self.autocorrelation:.2f}, effective number of independent "
            f"residuals {self.effective_samples:.0f}; {self.colour()}",
            f"{self.rank} of {len(self.names)} unknowns free of bounds, condition number {self.condition:.3g}",
            f"{self.status} after {self.iterations} iterations",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        white = self.white_errors.tolist()
        return {
            "unknowns": [
                {
                    "name": name,
                    "unit": unit,
                    "value": value,
                    "standard_error": known(error),
                    "standard_error_white": known(white[k]),
                    "interval_95": [known(low), known(high)],
                    "bounds": [known(self.unknowns[k].lower), known(self.unknowns[k].upper)],
                    "at_bound": active,
                }
                for k, (name, unit, value, error, (low, high), active) in enumerate(self._rows())
            ],
            "covariance": _matrix(self.covariance),
            "correlations": _matrix(self.correlations),
            "rank": self.rank,
            "condition": known(self.condition),
            "residuals": len(self.residuals),
            "residual_rms": self.residual_rms,
            "autocorrelation": known(self.autocorrelation),
            "effective_samples": self.effective_samples,
            "white_noise": self.noise.white,
            "status": self.status,
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
            "warnings": list(self.warnings),
        }

    def colour(self) -> str:
        """Return the colour of the noise, and the ratio of the standard errors to those for white noise, as text."""
        if self.noise.white or not self.rank:
            return "white noise"
        ratio = self.errors / self.white_errors
        ends = dict.fromkeys(f"{end:.2g}" for end in (np.nanmin(ratio), np.nanmax(ratio)))
        return f"coloured noise: standard errors {' to '.join(ends)} times those for white noise"

    def _rows(self) -> list[tuple[str, str, float, float, list[float], bool]]:
        """Return name, unit, value, standard error, interval and active bound of each unknown."""
        values, errors = self.estimates.values(), self.standard_errors.values()
        ends, active = self.intervals().tolist(), self.active_bounds.tolist()
        return list(zip(self.names, self.units, values, errors, ends, active, strict=True))


def colour_warning(fit: Estimates, *, noise_free: float = 0.0) -> str | None:
    """Return a warning if residuals are not noise and their root mean square is above ``noise_free``; None if not."""
    if not fit.residual_rms > noise_free:
        return None
    if not concentration(fit.residuals, fit.series, fit.times) > MOST_CONCENTRATION:
        return None
    m, n = len(fit.residuals), fit.effective_samples
    worth = f" and determine the unknowns as well as {n:.0f} independent ones would" if n < m else ""
    return (
        f"the {m} residuals are not noise{worth}: the standard errors allow for their colour, but the law "
        "does not explain all of the motion, unless the sensor colours its noise; another law, or more modes, may "
        "explain the rest"
    )


def _matrix(values: Array) -> list[list[float | None]]:
    return [[known(value) for value in row] for row in values.tolist()]
