"""Results of fits that consist of blocks: what each block, and the records together, say of the estimates."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

from ancf_casadi.estimation.agreement import Agreement, agreement_of_parts
from ancf_casadi.estimation.block import Account
from ancf_casadi.estimation.fit import colour_warning
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.estimation.result import LeastSquaresResult
from ancf_casadi.estimation.solve import FitSolution
from ancf_casadi.support.tables import Table


@dataclass(frozen=True, eq=False)
class BlocksResult(LeastSquaresResult):
    """The result of a fit of blocks of measurements."""

    solution: FitSolution  # of ``fit``

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without Functions; the solution has the fit, and derives them again."""
        return _restored, (type(self), {own.name: getattr(self, own.name) for own in fields(self) if own.name != "fit"})

    @cached_property
    def agreements(self) -> tuple[Agreement, ...]:
        """Agreement of the records, to first order, on each unknown that several determine; empty for one record."""
        return agreement_of_parts(self.fit, [mask for mask in self.solution.problem.masks if mask.any()])

    @cached_property
    def accounts(self) -> tuple[Account, ...]:
        """Lines, warnings and data of each block of measurements."""
        return tuple(block.account(fitted) for block, fitted in self.solution.parts)

    @property
    def channels(self) -> tuple[PredictedChannel, ...]:
        """Measured and computed values of all records."""
        return tuple(one for block, fitted in self.solution.parts for one in block.channels(fitted))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the estimates, one sentence each."""
        notes = [
            *self.fit.warnings,
            # systematic errors of a record, up to which residuals may be those of the computation
            colour_warning(self.fit, noise_free=3.0 * self.fit.systematic),
            *(one.warning for one in self.agreements),
            *(note for account in self.accounts for note in account.warnings),
        ]
        return tuple(note for note in notes if note)

    def table(self) -> Table:
        """Return the estimates with units, standard errors and 95 % intervals; notes say what each record shows."""
        own, lines = super().table(), [line for account in self.accounts for line in account.lines]
        return replace(own, notes=[*own.notes, *lines, *(one.text() for one in self.agreements)])

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        return {**super().to_dict(), "records": [account.data for account in self.accounts]}


def _restored(kind: type[BlocksResult], own: dict[str, Any]) -> BlocksResult:
    return kind(own["solution"].fit, **own)
