"""Values of a record computed with fitted properties, next to the measured ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.tables import Displayed, Table, known
from problems.beam.properties import Owners
from problems.beam.values.block import ValueBlock
from problems.beam.values.records import PropertyRecord

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class ValuePrediction(Displayed):
    """Computed and measured values of a record.

    Parameters
    ----------
    record : PropertyRecord
        The record.
    values : array (m,)
        Computed values, SI units.
    value_errors : array (m,)
        Standard errors of the computed values, from those of the properties.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from problems import FrequencyRecord, fit_beam
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> fit = fit_beam(model, FrequencyRecord(model, [1.90, 10.8, 30.1]), unknowns=["elastic_modulus"])
    >>> loaded = FrequencyRecord(Model(beam.with_(tip_mass=2e-3)), [1.5, 9.1])
    >>> [f"{100 * error:.0f} %" for error in fit.predict(loaded).relative_errors]
    ['0 %', '-1 %']
    """

    record: PropertyRecord
    values: Array
    value_errors: Array

    @property
    def residuals(self) -> Array:
        """Computed less measured values, SI units, (m,)."""
        return np.asarray(self.values - self.record.measured)

    @property
    def relative_errors(self) -> Array:
        """Relative errors computed/measured - 1, (m,); infinite for a measured value of 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.residuals / self.record.measured)

    @property
    def rms_error(self) -> float:
        """Root mean square of the residuals, SI units; meaningful only if all values have the same unit."""
        return root_mean_square(self.residuals)

    @property
    def relative_error(self) -> float:
        """Root mean square of the relative errors."""
        return root_mean_square(self.relative_errors)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations, one sentence each."""
        return ()

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each computed value."""
        return dict(zip(self.record.labels, self.value_errors.tolist(), strict=True))

    def table(self) -> Table:
        """Return measured and computed values."""
        rows = list(
            zip(
                self.record.labels,
                self.record.units,
                self.record.measured.tolist(),
                self.values.tolist(),
                map(known, self.value_errors.tolist()),
                map(known, (100 * self.relative_errors).tolist()),
                strict=True,
            )
        )
        columns = ("value", "unit", "measured", "computed", "standard_error", "error_%")
        return Table("prediction", self.record.name, columns, rows)

    def report(self) -> str:
        """Return the values as text."""
        return self.table().text()

    def to_dict(self) -> dict[str, Any]:
        """Return the values for JSON, SI units."""
        return {
            "name": self.record.name,
            "labels": list(self.record.labels),
            "units": list(self.record.units),
            "measured": self.record.measured.tolist(),
            "computed": self.values.tolist(),
            "standard_errors": [known(error) for error in self.value_errors.tolist()],
            "rms_error": self.rms_error,
            "relative_error": known(self.relative_error),
        }

    def figure(self) -> Figure:
        """Draw measured and computed values, and the relative errors."""
        from problems.beam.values.figures import values_figure  # matplotlib is slow to import

        return values_figure([self])


def predicted(block: ValueBlock, fit: Fit) -> ValuePrediction:
    """Return the prediction of a record with the estimates of a fit.

    Raises
    ------
    EquilibriumError
        If the beam has no stable equilibrium.
    """
    record, places = block.record, [fit.names.index(name) for name in block.first]
    factors = np.array([fit.estimates[name] / first for name, first in block.first.items()])
    values, by_factors = record.response(Owners.of(record.model.beam, tuple(block.first)))(factors)
    jacobian = np.zeros((len(values), len(fit.names)))
    jacobian[:, places] = by_factors / np.array([*block.first.values()]) * fit.coordinates.slopes(fit.values)[places]
    return ValuePrediction(record, values, np.nan_to_num(fit.errors_of(jacobian)))
