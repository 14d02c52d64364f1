"""A result of a fit that was saved as JSON, for comparison and for documents; the measurements are not in the file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import read_bytes
from ancf_casadi.support.inputs import number
from ancf_casadi.support.tables import Reported, Table


class SavedEstimate(msgspec.Struct, frozen=True):
    """An estimate as ``FitResult.to_dict`` states it; None for unknown numbers."""

    name: str
    value: float | None
    unit: str
    standard_error: float | None
    interval_95: tuple[float | None, float | None]


class SavedNumbers(msgspec.Struct, frozen=True):
    """Content that every saved result has."""

    kind: Annotated[str, msgspec.Meta(min_length=1)]
    estimates: list[SavedEstimate]
    covariance: list[list[float | None]]
    degrees_of_freedom: Annotated[float, msgspec.Meta(ge=0.0)] | None
    at_bound: list[str]
    warnings: list[str]
    report: str

    def __post_init__(self) -> None:
        """Check that names and sizes belong together."""
        size = len({estimate.name for estimate in self.estimates})
        if size < len(self.estimates):
            raise ValueError("an estimate appears twice")
        if [len(row) for row in self.covariance] != [size] * size:
            raise ValueError(f"the covariance is not {size} by {size}")


@dataclass(frozen=True, eq=False)
class SavedFit(Reported):
    """A result of a fit, read from a file.

    Parameters
    ----------
    numbers : SavedNumbers
        What every result states.
    data : dict
        All content of the file.

    Examples
    --------
    >>> from problems import fit_rayleigh, load_fit
    >>> fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003]).save("rayleigh.json")
    >>> fit = load_fit("rayleigh.json")
    >>> fit.kind, round(fit.estimates["alpha"], 2), fit.units["alpha"]
    ('rayleigh', 0.24, '1/s')
    """

    _drawing = "ancf_casadi.figures.fits.saved_figure"

    numbers: SavedNumbers
    data: dict[str, Any]

    @property
    def kind(self) -> str:
        """Kind of the fit."""
        return self.numbers.kind

    @property
    def estimates(self) -> dict[str, float]:
        """Value of each estimated quantity by name."""
        return {estimate.name: _number(estimate.value) for estimate in self.numbers.estimates}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each estimated quantity by name."""
        return {estimate.name: estimate.unit for estimate in self.numbers.estimates}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each estimated quantity by name; nan at a bound."""
        return {estimate.name: _number(estimate.standard_error) for estimate in self.numbers.estimates}

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> dict[str, tuple[float, float]]:
        """Return the interval of each estimated quantity by name.

        Raises
        ------
        InputError
            If the level is not 0.95: the file has no other intervals, and those at a bound or by profile likelihood do
            not follow from it.
        """
        if number(level, "level") != CONFIDENCE_LEVEL:
            raise InputError("the file has the intervals of 0.95 alone; fit the record again for others", "level")
        return {
            estimate.name: (_number(estimate.interval_95[0]), _number(estimate.interval_95[1]))
            for estimate in self.numbers.estimates
        }

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the estimates."""
        return np.array([[_number(value) for value in row] for row in self.numbers.covariance])

    @property
    def correlations(self) -> Array:
        """Correlations (p, p) of the estimates."""
        errors = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(errors, errors))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the unknowns at a bound."""
        return tuple(self.numbers.at_bound)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        return tuple(self.numbers.warnings)

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals."""
        rows = [(o.name, o.value, o.unit, o.standard_error, *o.interval_95) for o in self.numbers.estimates]
        columns = ("estimate", "value", "unit", "standard_error", "lower_95", "upper_95")
        return Table(self.kind, f"{self.kind}, 95 % intervals", columns, rows)

    def report(self) -> str:
        """Return the report that was saved."""
        return self.numbers.report

    def to_dict(self) -> dict[str, Any]:
        """Return all content of the file."""
        return self.data

    def _summary(self) -> str:
        return ", ".join([self.kind, *(f"{name} {value:.5g}" for name, value in self.estimates.items())])


def load_fit(path: str | Path) -> SavedFit:
    """Return a result that ``save`` of any fit wrote.

    It has all numbers, the report and the warnings.  Profiles, predictions and further fits need the measurements.

    Raises
    ------
    InputError
        If the file cannot be read, or is not a saved result.

    Examples
    --------
    >>> from problems import fit_rayleigh, load_fit
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> fit.save("rayleigh.json")
    >>> load_fit("rayleigh.json").intervals() == fit.intervals()
    True
    """
    content = read_bytes(path)
    try:
        return SavedFit(
            msgspec.json.decode(content, type=SavedNumbers), msgspec.json.decode(content, type=dict[str, Any])
        )
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"is not the saved result of a fit: {error}", str(path)) from None


def _number(value: float | None) -> float:
    return math.nan if value is None else value
