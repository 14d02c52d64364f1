"""The result of a fit of properties: values, uncertainties, and what the records leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.estimates import LEVEL
from ancf_casadi.estimation.fit import CORRELATED, Fit
from ancf_casadi.estimation.result import known
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import Table
from problems.properties.determined import CERTAIN, Determined
from problems.properties.observation import FACTORS
from problems.properties.prediction import Prediction
from problems.properties.quantities import (
    ALL_UNITS,
    CLAMP,
    STIFFNESSES,
    factors_of,
    names_of,
    quantities,
    relative_quantity,
    unknown_of,
)
from problems.properties.records import PropertyRecord
from problems.properties.response import changed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCATTER = 2.0  # residuals, in stated standard deviations, beyond which model or records do not fit


@dataclass(frozen=True, eq=False)
class PropertyFit:
    """Properties of a beam estimated from records; ``fit["elastic_modulus"]`` is a value in SI units.

    Parameters
    ----------
    records : tuple of PropertyRecord
        The measurements, with the first values of the properties.
    first : mapping
        The first values of the properties by name, SI units.
    fit : Fit
        The unknowns of the solver: factors on the first values, reciprocal ones for stiffnesses (``quantities``).
    others : tuple of Fit
        Other optima that fit the records as well within the 95 % level.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from problems import FrequencyRecord, fit_properties
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> record = FrequencyRecord(Model(beam), [1.90, 10.8, 30.1])
    >>> fit = fit_properties(record, ["elastic_modulus"])
    >>> [f"{end / 1e9:.0f} GPa" for end in fit.intervals()["elastic_modulus"]]
    ['216 GPa', '221 GPa']
    >>> list(fit.values)
    ['elastic_modulus', 'bending_stiffness']
    """

    records: tuple[PropertyRecord, ...]
    first: dict[str, float]
    fit: Fit
    others: tuple[Fit, ...] = ()

    def __getitem__(self, name: str) -> float:
        """Return the value of a property or of a combination, SI units.

        Raises
        ------
        InputError
            If the fit did not change it.
        """
        if name not in self.values:
            raise InputError(f"was not estimated; known are {', '.join(self.values)}", name)
        return self.values[name]

    @property
    def names(self) -> tuple[str, ...]:
        """The estimated properties."""
        return names_of(self.fit.names)

    @cached_property
    def values(self) -> dict[str, float]:
        """Value of each estimated property, and of the combinations that it changes, SI units."""
        ratios, _ = self.fit.derived(self._quantities)
        return {name: self.first[name] * ratio for name, ratio in zip(self._all, ratios.tolist(), strict=True)}

    @cached_property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each value, SI units; nan at a bound, or if there are no more values than unknowns."""
        _, errors = self.fit.derived(self._quantities)
        return {name: self.first[name] * error for name, error in zip(self._all, errors.tolist(), strict=True)}

    def intervals(self, level: float = LEVEL) -> dict[str, tuple[float, float]]:
        """Return the interval of each value for a confidence level, SI units, to first order.

        The interval of a stiffness is that of its reciprocal.  It has no upper end if the clamp may be rigid.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        ends = np.array([self._intervals(fit, level) for fit in (self.fit, *self.others)])
        low, high = np.fmin.reduce(ends[:, :, 0]).tolist(), np.fmax.reduce(ends[:, :, 1]).tolist()
        return dict(zip(self._all, zip(low, high, strict=True), strict=True))

    def _intervals(self, fit: Fit, level: float) -> Array:
        """Return the intervals of all values at one optimum, SI units, (q, 2)."""
        ends = fit.derived_intervals(self._fitted_quantities, level)
        ends[: len(fit.names)] = fit.intervals(level)
        for k, name in enumerate(self._all):
            if name in STIFFNESSES:
                low, high = ends[k].tolist()
                rigid = low <= (fit.lower[k] if name == CLAMP else 0.0)
                ends[k] = 1 / high, math.inf if rigid else 1 / low
        return np.asarray(ends * np.array([self.first[name] for name in self._all])[:, None])

    @property
    def model_factors(self) -> Array:
        """Factors on the properties of the given beams, in the order of ``FACTORS``, (6,)."""
        given = factors_of(dict(zip(self.fit.names, map(cs.MX, self.fit.values.tolist()), strict=True)))
        return np.array([float(cs.evalf(given[name])) if name in given else 1.0 for name in FACTORS])

    def model(self, model: Model) -> Model:
        """Return the beam of another configuration with the estimated properties.

        Raises
        ------
        InputError
            If ``model`` is not a model.
        """
        check_instance(model, "model", Model)
        return changed(self._started(model), self.model_factors)

    def predict(self, record: PropertyRecord) -> Prediction:
        """Compute the values of a record, of the same or of another configuration, with the estimated properties.

        Raises
        ------
        InputError
            If ``record`` is not a record.
        EquilibriumError
            If the beam has no stable equilibrium.

        Examples
        --------
        >>> from ancf_casadi import Beam, Model
        >>> from problems import FrequencyRecord, fit_properties
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> fit = fit_properties(FrequencyRecord(Model(beam), [1.90, 10.8, 30.1]), ["elastic_modulus"])
        >>> loaded = FrequencyRecord(Model(beam.with_(tip_mass=2e-3)), [1.5, 9.1])
        >>> fit.predict(loaded).values.round(1)
        array([1.5, 9. ])
        """
        check_instance(record, "record", PropertyRecord)
        record = record.with_model(self._started(record.model))
        values, by_factors = record.respond(self.model_factors)
        jacobian = by_factors @ self._chain
        free = ~self.fit.active_bounds
        covariance = self.fit.covariance[np.ix_(free, free)]
        errors = np.sqrt(np.sum((jacobian[:, free] @ covariance) * jacobian[:, free], axis=1))
        return Prediction(record, values, errors)

    @cached_property
    def predictions(self) -> tuple[Prediction, ...]:
        """The fitted records."""
        return tuple(self.predict(record) for record in self.records)

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals: relative, or in stated standard deviations if these are given."""
        freedom = self.fit.degrees_of_freedom
        return math.sqrt(float(np.sum(self.fit.residuals**2)) / freedom) if freedom else math.nan

    @cached_property
    def determined(self) -> Determined:
        """The products of properties that the records determine, at the estimates."""
        return Determined.of(self.records, self.fit.names, self.fit.values)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        groups = self._bound_warnings(), self._other_warnings(), self._scatter_warnings(), self._certainty_warnings()
        return tuple(note for group in groups for note in group)

    def _bound_warnings(self) -> list[str]:
        notes = []
        for k in np.flatnonzero(self.fit.active_bounds).tolist():
            name = self.names[k]
            if name == CLAMP and self.fit.values[k] == self.fit.lower[k]:
                low = self.intervals()[name][0]
                notes.append(
                    f"the records show no compliance of the clamp: its stiffness is above {low:.3g} N m/rad (95 %), "
                    "and the other standard errors take it as rigid"
                )
            else:
                notes.append(
                    f"{name} is at its bound {self.values[name]:.4g} {ALL_UNITS[name]}; the other standard errors take "
                    "it as known"
                )
        return notes

    def _other_warnings(self) -> list[str]:
        notes = []
        for other in self.others:
            values = other.values.tolist()
            named = [
                f"{name} {self.first[name] * (1 / value if name in STIFFNESSES else value):.4g} {ALL_UNITS[name]}"
                for name, value in zip(self.names, values, strict=True)
            ]
            notes.append(
                f"{', '.join(named)} fits as well; the intervals cover both optima. Fix one of the unknowns, or add a "
                "record that separates them"
            )
        return notes

    def _scatter_warnings(self) -> list[str]:
        if not self.fit.noise.freedom:
            return ["there are no more values than unknowns, so nothing shows their uncertainty; measure more"]
        if self.records[0].deviations is None or self.scatter < SCATTER:
            return []
        return [
            f"the residuals are {self.scatter:.2g} times the stated standard deviations: the model or the records are "
            "less accurate than stated, and the standard errors allow for it"
        ]

    def _certainty_warnings(self) -> list[str]:
        notes = [
            f"the records leave {name} open: the relative standard error of this product of powers is {error:.2g}"
            for name, error in self._certainty
            if error > CERTAIN
        ]
        with np.errstate(invalid="ignore"):
            pairs = np.argwhere(np.triu(np.abs(self.fit.correlations), 1) > CORRELATED).tolist()
        return notes + [
            f"{self.names[i]} and {self.names[j]} correlate at {abs(self.fit.correlations[i, j]):.3f}: the records "
            "determine a combination of the two much better than each alone"
            for i, j in pairs
        ]

    @property
    def _certainty(self) -> list[tuple[str, float]]:
        held = {name for name, active in zip(self.names, self.fit.active_bounds, strict=True) if active}
        return self.determined.without(held).certainty(math.sqrt(self.fit.noise.variance))

    def table(self) -> Table:
        """Return the values with standard errors and intervals."""
        intervals, rows = self.intervals(), []
        for k, name in enumerate(self._all):
            active = k < len(self.names) and bool(self.fit.active_bounds[k])
            low, high = intervals[name]
            first, value, error = self.first[name], self.values[name], known(self.standard_errors[name])
            note = "at a bound" if active else ""
            rows.append((name, ALL_UNITS[name], first, value, error, known(low), high, note))
        kind = "relative" if self.records[0].deviations is None else "in stated standard deviations"
        notes = [
            f"{len(self.fit.residuals)} values, {self.fit.degrees_of_freedom} more than free unknowns; scatter of the "
            f"residuals {self.scatter:.3g} ({kind})",
            self.determined.statement[0].upper() + self.determined.statement[1:],
            *(f"  {name}: relative standard error {error:.2g}" for name, error in self._certainty),
        ]
        columns = ("property", "unit", "first", "value", "standard_error", "lower_95", "upper_95", "")
        return Table("properties", "Properties with 95 % intervals", columns, rows, notes)

    def report(self) -> str:
        """Return the result as text."""
        texts = [self.table().text(), *(prediction.report() for prediction in self.predictions)]
        notes = [f"note: {note}" for note in self.warnings]
        return "\n\n".join([*texts, *(["\n".join(notes)] if notes else [])])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        intervals = self.intervals()
        return {
            "properties": [
                {
                    "name": name,
                    "unit": ALL_UNITS[name],
                    "first": self.first[name],
                    "value": self.values[name],
                    "standard_error": known(self.standard_errors[name]),
                    "interval_95": [known(end) for end in intervals[name]],
                    "estimated": name in self.names,
                }
                for name in self._all
            ],
            "scatter": known(self.scatter),
            "determined": self.determined.statement,
            "products": [{"product": name, "relative_error": known(error)} for name, error in self._certainty],
            "records": [prediction.to_dict() for prediction in self.predictions],
            "warnings": list(self.warnings),
        }

    def figure(self) -> Figure:
        """Draw measured and computed values of all records, and the relative errors."""
        from problems.properties.figures import records_figure  # matplotlib is slow to import

        return records_figure(self.predictions)

    @property
    def _all(self) -> tuple[str, ...]:
        return quantities(self.fit.names)

    def _quantities(self, *values: cs.MX) -> cs.MX:
        given = dict(zip(self.fit.names, values, strict=True))
        return cs.vertcat(*(relative_quantity(name, given) for name in self._all))

    def _fitted_quantities(self, *values: cs.MX) -> cs.MX:
        """Return the quantities in the form in which they are nearly linear: reciprocals of stiffnesses."""
        found = cs.vertsplit(self._quantities(*values))
        return cs.vertcat(*(1 / q if name in STIFFNESSES else q for name, q in zip(self._all, found, strict=True)))

    @cached_property
    def _chain(self) -> Array:
        """Derivatives of the factors on the properties by the unknowns, (6, n)."""
        x = cs.MX.sym("x", len(self.fit.names))
        given = factors_of(dict(zip(self.fit.names, cs.vertsplit(x), strict=True)))
        factors = cs.vertcat(*(given.get(name, cs.MX(1.0)) for name in FACTORS))
        chain = cs.Function("chain", [x], [cs.densify(cs.jacobian(factors, x))])
        return np.asarray(chain(self.fit.values).full())

    def _started(self, model: Model) -> Model:
        """Return a model whose clamp, if it was estimated, has its first stiffness."""
        if unknown_of(CLAMP) not in self.fit.names:
            return model
        return Model(model.beam.with_(clamp_stiffness=self.first[CLAMP]), model.measures)
