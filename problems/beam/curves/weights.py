"""Weights of measured points: standard deviations of amplitudes, phases and levels, and their size from the residuals.

A record has standard deviations of its amplitudes, phases and levels (``ResponseRecord.stds``).  Those that were
not given are proportions: a first fit takes them as they are, and the root mean square of its residuals gives one
factor c for the amplitudes and levels of all records of one sensor, and one for their phases; a second fit uses these
(iteratively reweighted least squares).  A factor of its own for each record would follow the scatter of a few points,
and make the intervals too narrow.

The fit weighs the residuals, distances in units of c s, by the geometric mean G of the factors
(``ancf_casadi.estimation.solve``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.support.arrays import Array
from problems.beam.curves.record import ResponseRecord


@dataclass(frozen=True, eq=False)
class CurveWeights:
    """Standard deviations of all points.

    Parameters
    ----------
    proportions : tuple of array (3, m)
        Standard deviations of amplitudes, phases and levels of each record, given or proportional.
    lengths : tuple of int
        Lengths of the series of residuals: the amplitudes and, if they were measured, the phases of each record.
    owners : tuple of (int, int)
        Record of each series, and 0 for amplitudes or 1 for phases.
    groups : tuple of int
        Row of ``factors`` of each record.
    factors : array (groups, 2)
        Factor c of the amplitudes, and of the phases, of each group of records.
    known : tuple of bool
        Whether the standard deviations of a series were given.
    """

    proportions: tuple[Array, ...]
    lengths: tuple[int, ...]
    owners: tuple[tuple[int, int], ...]
    groups: tuple[int, ...]
    factors: Array
    known: tuple[bool, ...]

    @property
    def scale(self) -> float:
        """The geometric mean G of the factors."""
        logarithms = np.log([self.factors[place] for place in self._places])
        return math.exp(float(np.array(self.lengths) @ logarithms) / sum(self.lengths))

    @property
    def improvable(self) -> bool:
        """True if residuals would change the factors."""
        return not all(self.known)

    def deviations(self, record: int) -> Array:
        """Return the standard deviations of amplitudes, phases and levels of a record, (3, m)."""
        amplitudes, phases = self.factors[self.groups[record]]
        return np.asarray(self.proportions[record] * np.array([amplitudes, phases, amplitudes])[:, None])

    def improved(self, residuals: Array) -> CurveWeights:
        """Return the weights with the factors of residuals where no standard deviation was given."""
        factors, places = self.factors.copy(), self._places
        parts = np.split(residuals, np.cumsum(self.lengths))[:-1]
        for place in set(places):
            own = [
                part for part, one, known in zip(parts, places, self.known, strict=True) if one == place and not known
            ]
            if own:
                size = math.sqrt(float(np.mean(np.concatenate(own) ** 2)))
                # least factor: below it, residuals are those of the computation
                factors[place] = max(self.factors[place] * size, 1e-6)
        return replace(self, factors=factors)

    @property
    def _places(self) -> list[tuple[int, int]]:
        """Place of the factor of each series."""
        return [(self.groups[record], row) for record, row in self.owners]


def first_weights(records: Sequence[ResponseRecord]) -> CurveWeights:
    """Return the weights of records before a fit."""
    lengths, owners, known = [], [], []
    for k, record in enumerate(records):
        for row, given in enumerate(given_of(record)):
            if row == 0 or record.phases is not None:
                lengths.append(record.f.size)
                owners.append((k, row))
                known.append(given is not None)
    kinds = [
        (record.sensor, record.control, *(deviation is None for deviation in given_of(record))) for record in records
    ]
    groups = tuple(kinds.index(kind) for kind in kinds)
    return CurveWeights(
        proportions=tuple(one.stds for one in records),
        lengths=tuple(lengths),
        owners=tuple(owners),
        groups=groups,
        factors=np.ones((len(records), 2)),
        known=tuple(known),
    )


def given_of(record: ResponseRecord) -> tuple[object, object]:
    """Return the standard deviations that were given of the measured quantity, amplitude or level, and of the phase."""
    measured = record.level_std if record.control == "response" else record.amplitude_std
    return measured, record.phase_std
