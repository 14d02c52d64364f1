"""Outliers of a record: single samples that the samples beside them contradict.

In an oscillation of one or two frequencies at even times, each sample follows from its four neighbours, whatever the
amplitudes, phases and rest position are,

    y_i = c0 + c1 (y_{i-1} + y_{i+1}) + c2 (y_{i-2} + y_{i+2}),

with coefficients from least squares over the record.  A sample is an outlier if its residual exceeds what is likely
among so many samples, relative to the residuals of the whole record and to those nearby, if its neighbours agree with
each other, and if a wrong value of this sample explains the residuals beside it.  A release, a blow or a step does not
look like that.  The largest outliers are removed, and the record is examined again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.decay.evidence import CLEAR
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import UNEVEN
from ancf_casadi.support.arrays import Array, Index

NEARBY = 25  # samples to either side whose residuals a sample must exceed; a transient of several modes has large ones
EXPLAINED = 0.9  # least share of five residuals about an outlier that it explains; a step would explain 0.87
MOST_OUTLIERS = 0.05  # share of a record; more are no outliers, but another kind of noise
NAMED = 3  # outliers whose times a note lists


def without_outliers(record: Measurement) -> Measurement:
    """Return a record without its outliers, with a note that names them; the record itself if it has none."""
    places = outliers(record.time, record.values)
    if not places.size:
        return record
    times = ", ".join(f"{record.time[i]:.6g} s" for i in places[:NAMED])
    more = f" and {places.size - NAMED} more" if places.size > NAMED else ""
    plural = f"{places.size} outliers were" if places.size > 1 else "1 outlier was"
    note = f"{plural} left out, at {times}{more}: single samples that those beside them contradict"
    kept = np.delete(np.arange(len(record.time)), places)
    return Measurement(record.time[kept], record.values[kept], record.name, record.sensor, (*record.notes, note))


def outliers(time: Array, values: Array) -> Index:
    """Return the indices of the outliers of a record, in ascending order; none if there are too many."""
    y = values.copy()
    removed = np.zeros(len(y), dtype=bool)
    even = _evenly_surrounded(time)
    least, rounding = 2 * math.log(len(y)) + CLEAR, float(np.spacing(np.abs(y).max()))
    while even.any():
        columns = np.column_stack([np.ones(len(even)), y[1:-3] + y[3:-1], y[:-4] + y[4:]])
        c = np.linalg.lstsq(columns[even], y[2:-2][even])[0]
        residuals = np.where(even & ~removed[2:-2], y[2:-2] - columns @ c, 0.0)
        squares = residuals**2
        trace = np.array([-c[2], -c[1], 1.0, -c[1], -c[2]])  # of an outlier of size 1 in five residuals
        around = np.lib.stride_tricks.sliding_window_view(np.pad(residuals, 2), 5)
        explained = (around @ trace) ** 2 / (trace @ trace) > EXPLAINED * np.sum(around**2, axis=1)
        agree = np.abs(y[3:-1] - y[1:-3]) < np.abs(residuals) / 2
        variance = np.maximum(np.maximum(squares.mean(), _mean_nearby(squares)), rounding**2)
        places = np.flatnonzero(agree & explained & (squares > least * variance))
        places = places[[squares[k] == squares[max(k - 4, 0) : k + 5].max() for k in places]]
        if not places.size:
            break
        removed[places + 2], y[places + 2] = True, (columns @ c)[places]
        if np.count_nonzero(removed) > MOST_OUTLIERS * len(y):
            return np.array([], dtype=int)
    return np.flatnonzero(removed)


def _evenly_surrounded(time: Array) -> NDArray[np.bool_]:
    """Return for each sample but two at either end whether its neighbours are at equal distances in time."""
    steps = np.diff(time)
    even = np.abs(steps / np.median(steps) - 1) <= UNEVEN
    return np.asarray(even[:-3] & even[1:-2] & even[2:-1] & even[3:], dtype=bool)


def _mean_nearby(squares: Array) -> Array:
    """Return the mean of the values around each one, without those that an outlier there disturbs."""

    def windowed(values: Array, reach: int) -> Array:
        total = np.append(0.0, np.cumsum(values))
        places = np.arange(len(values))
        return np.asarray(total[np.minimum(places + reach + 1, len(values))] - total[np.maximum(places - reach, 0)])

    ones = np.ones_like(squares)
    total, count = (windowed(values, NEARBY) - windowed(values, 2) for values in (squares, ones))
    return np.asarray(np.maximum(total, 0.0) / np.maximum(count, 1.0))
