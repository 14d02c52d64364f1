"""Static tests and natural frequencies as a block of a fit: each value is a residual of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import Account, Block, Evaluation, Fitted
from ancf_casadi.support.arrays import Index
from ancf_casadi.support.callbacks import Differentiable
from problems.beam.properties import Owners
from problems.beam.values.records import PropertyRecord

ACCURACY = 1e-6  # relative accuracy of computed values; in standard deviations if these are given


@dataclass(frozen=True, eq=False)
class ValueBlock(Block):
    """Measured values of a beam at rest or in small vibration.

    Parameters
    ----------
    record : PropertyRecord
        The measurements, with the beam in the configuration of the test.
    first : mapping
        First values of the unknown properties by name, SI units.
    """

    record: PropertyRecord
    first: Mapping[str, float]

    @property
    def records(self) -> Sequence[PropertyRecord]:
        """The record."""
        return [self.record]

    @property
    def series(self) -> list[int]:
        """Single values."""
        return [1] * len(self.record.measured)

    @property
    def owners(self) -> Index:
        """Zeros: there is one record."""
        return np.zeros(len(self.record.measured), dtype=np.int64)

    @property
    def stated(self) -> bool:
        """True if the values have standard deviations."""
        return self.record.stds is not None

    @property
    def systematic(self) -> float:
        """Error of the computation."""
        return ACCURACY

    @property
    def accuracy(self) -> float:
        """Accuracy of the computation, because residuals without standard deviations have no known size."""
        return ACCURACY

    @property
    def negligible(self) -> float:
        """Norm of a small relative change of all values."""
        # relative change of all values that counts as none; the stretching of a beam causes less
        return 3e-6 * float(np.linalg.norm(self.record.measured / self.record.scatter))

    def account(self, fitted: Fitted) -> Account:
        """Return measured and computed values."""
        record = self.record
        values = record.measured + fitted.residuals * record.scatter
        rows = zip(record.labels, record.units, record.measured.tolist(), values.tolist(), strict=True)
        lines = [
            f"{record.name}, {label}: measured {measured:.6g}, computed {computed:.6g} {unit}".rstrip()
            for label, unit, measured, computed in rows
        ]
        data = {"kind": "values", "name": record.name, "labels": list(record.labels), "units": list(record.units)}
        return Account(lines, (), {**data, "measured": record.measured.tolist(), "computed": values.tolist()})

    def evaluation(self, before: Evaluation | None = None) -> Evaluation:
        """Return the values as a differentiable function."""
        return before or ValueEvaluation(self)


class ValueEvaluation:
    """The values of a block as a differentiable function of the unknown properties."""

    failure = ""

    def __init__(self, block: ValueBlock) -> None:
        self.block = block

    @cached_property
    def _computed(self) -> Differentiable:
        block = self.block
        respond = block.record.response(Owners.of(block.record.model.beam, tuple(block.first)))
        return Differentiable(respond, len(block.record.measured), len(block.first))

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured values over their standard deviations, or relative errors, (m,)."""
        record = self.block.record
        factors = cs.vertcat(cs.MX(0, 1), *(given[name] / first for name, first in self.block.first.items()))
        return (self._computed(factors) - cs.DM(record.measured)) / cs.DM(record.scatter)

    def close(self) -> None:
        """Keep the function, which is small."""
