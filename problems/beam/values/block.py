"""Static tests and natural frequencies as a block of a fit: each value is a residual of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.estimation.block import Account, Block, Fitted
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.support.callbacks import Differentiable
from problems.beam.properties import Owners
from problems.beam.values.records import PropertyRecord

ACCURACY = 1e-6  # relative accuracy of computed values; in standard deviations if these are given


@dataclass(frozen=True, eq=False)
class ValueBlock(Block):
    """Measured values of a beam at rest or in small vibration."""

    record: PropertyRecord  # with the beam in the configuration of the test
    first: Mapping[str, float]  # first values of the unknown properties by name, SI units

    @property
    def lengths(self) -> list[list[int]]:
        """Single values of one record."""
        return [[1] * len(self.record.measured)]

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

    @property
    def failure(self) -> str:
        """Reason why the values could not be computed; empty if they could."""
        return self._computed.failure

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured values over their standard deviations, or relative errors, (m,)."""
        factors = cs.vertcat(cs.MX(0, 1), *(given[name] / first for name, first in self.first.items()))
        return (self._computed(factors) - cs.DM(self.record.measured)) / cs.DM(self.record.scatter)

    @cached_property
    def _computed(self) -> Differentiable:
        """The values as a differentiable function of the factors on the unknown properties."""
        respond = self.record.response(Owners.of(self.record.model.beam, tuple(self.first)))
        return Differentiable(respond, len(self.record.measured), len(self.first))

    def channels(self, fitted: Fitted) -> list[PredictedChannel]:
        """Return measured and computed values, a channel for each quantity."""
        record, rest = self.record, fitted.residuals * self.record.scatter
        errors, labels = fitted.errors * record.scatter, np.array(record.labels)
        kinds, found = np.array(record.quantities), []
        for quantity, unit in dict(zip(record.quantities, record.units, strict=True)).items():
            own = kinds == quantity
            measured = record.measured[own]
            name = record.name if own.all() else f"{record.name}, {quantity}"
            found.append(
                PredictedChannel(name, unit, measured, measured + rest[own], errors[own], record.places[own],
                                 record.axis, math.nan, np.abs(measured), tuple(labels[own].tolist()), quantity)
            )  # fmt: skip
        return found

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
