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

from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.block import SeriesWeights
from problems.beam.curves.record import ResponseRecord


def first_weights(records: Sequence[ResponseRecord]) -> SeriesWeights:
    """Return the factors c of the amplitudes and, if they were measured, of the phases of each record before a fit."""
    lengths: list[int] = []
    groups: dict[tuple[object, ...], list[int]] = {}
    known: list[bool] = []
    for record in records:
        given = given_of(record)
        for row in range(1 if record.phases is None else 2):
            kind = (record.sensor, record.control, *(own is None for own in given), row)
            if kind not in groups:
                known.append(given[row] is not None)
            groups.setdefault(kind, []).append(len(lengths))
            lengths.append(record.f.size)
    return SeriesWeights(
        lengths=np.array(lengths),
        deviations=np.ones(len(lengths)),
        floors=np.full(len(lengths), 1e-6),  # below this factor, residuals are those of the computation
        groups=tuple(map(tuple, groups.values())),
        known=tuple(known),
    )


def given_of(record: ResponseRecord) -> tuple[object, object]:
    """Return the standard deviations that were given of the measured quantity, amplitude or level, and of the phase."""
    measured = record.level_std if record.control == "response" else record.amplitude_std
    return measured, record.phase_std
