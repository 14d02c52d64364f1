"""Weights of measured points: standard deviations of amplitudes, phases and levels, and their size from the residuals.

A record has standard deviations of its amplitudes, phases and levels (``ResponseRecord.deviations``).  Those that were
not given are proportions: a first fit takes them as they are, and the root mean square of its residuals gives one
factor c for the amplitudes and levels of each record, and one for its phases; a second fit uses these (iteratively
reweighted least squares).  With the geometric mean G of the factors over all residuals, which are distances in standard
deviations,

    G (distance in units of c s),

the likelihood of the normal distribution stays the same, so that fits of several laws can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.support.arrays import Array
from problems.response.record import ResponseRecord

LEAST = 1e-6  # least factor: below it, residuals are those of the computation


@dataclass(frozen=True, eq=False)
class Weights:
    """Standard deviations of all points.

    Parameters
    ----------
    proportions : tuple of array (3, m)
        Standard deviations of amplitudes, phases and levels of each record, given or proportional.
    lengths : tuple of int
        Lengths of the series of residuals: the amplitudes and, if they were measured, the phases of each record.
    owners : tuple of (int, int)
        Record and row of ``factors`` of each series.
    factors : array (records, 2)
        Factor c of the amplitudes, and of the phases, of each record.
    known : tuple of bool
        Whether the standard deviations of a series were given.
    """

    proportions: tuple[Array, ...]
    lengths: tuple[int, ...]
    owners: tuple[tuple[int, int], ...]
    factors: Array
    known: tuple[bool, ...]

    @property
    def scale(self) -> float:
        """The geometric mean G of the factors."""
        logarithms = np.log([self.factors[owner] for owner in self.owners])
        return math.exp(float(np.array(self.lengths) @ logarithms) / sum(self.lengths))

    @property
    def improvable(self) -> bool:
        """True if residuals would change the factors."""
        return not all(self.known)

    def deviations(self, record: int) -> Array:
        """Return the standard deviations of amplitudes, phases and levels of a record, (3, m)."""
        amplitudes, phases = self.factors[record]
        return np.asarray(self.proportions[record] * np.array([amplitudes, phases, amplitudes])[:, None])

    def improved(self, residuals: Array) -> Weights:
        """Return the weights with the factors of weighted residuals where no standard deviation was given."""
        factors = self.factors.copy()
        parts = np.split(residuals, np.cumsum(self.lengths))[:-1]
        for part, owner, known in zip(parts, self.owners, self.known, strict=True):
            if not known:
                size = math.sqrt(float(np.mean(part**2))) / self.scale
                factors[owner] = max(self.factors[owner] * size, LEAST)
        return replace(self, factors=factors)


def first_weights(records: Sequence[ResponseRecord]) -> Weights:
    """Return the weights of records before a fit."""
    lengths, owners, known = [], [], []
    for k, record in enumerate(records):
        measured = record.level_deviation if record.control == "response" else record.amplitude_deviation
        for row, given in ((0, measured), (1, record.phase_deviation)):
            if row == 0 or record.phases is not None:
                lengths.append(record.f.size)
                owners.append((k, row))
                known.append(given is not None)
    return Weights(
        tuple(one.deviations for one in records),
        tuple(lengths),
        tuple(owners),
        np.ones((len(records), 2)),
        tuple(known),
    )
