"""Outliers of a record: single samples that the samples beside them contradict.

In an oscillation of one or two frequencies at even times, each sample follows from its four neighbours, whatever the
amplitudes, phases and rest position are,

    y_i = c0 + c1 (y_{i-1} + y_{i+1}) + c2 (y_{i-2} + y_{i+2}),

with coefficients from least squares over the record.  A sample is an outlier if its residual exceeds what is likely
among so many samples, relative to the residuals of the whole record and to those nearby, if its neighbours agree with
each other, and if a wrong value of this sample explains the residuals beside it.  A release, a blow or a step does not
look like that.  The largest outliers are removed, and the record is examined again.  The first and the last two samples
have too few neighbours, and outliers beside each other support each other: neither is found.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.decay.bic import BIC_MARGIN
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import UNEVEN
from ancf_casadi.support.arrays import Array, Index

NEIGHBOURS = 25  # samples to either side whose residuals an outlier must exceed, as those of a transient are large
MIN_EXPLAINED = 0.9  # least share of five residuals about an outlier that it explains; a step would explain 0.87
MAX_OUTLIERS = 0.05  # share of a record; more are no outliers, but another kind of noise
LISTED_OUTLIERS = 3  # outliers whose times a note lists


def without_outliers(record: Measurement) -> Measurement:
    """Return a record without its outliers, with a note that names them; the record itself if it has none."""
    indices = find_outliers(record.time, record.values)
    if not indices.size:
        return record
    times = ", ".join(f"{record.time[i]:.6g} s" for i in indices[:LISTED_OUTLIERS])
    omitted = f" and {indices.size - LISTED_OUTLIERS} more" if indices.size > LISTED_OUTLIERS else ""
    plural = f"{indices.size} outliers were" if indices.size > 1 else "1 outlier was"
    note = f"{plural} left out, at {times}{omitted}: single samples far from their neighbours"
    time, values = np.delete(record.time, indices), np.delete(record.values, indices)
    return Measurement(time, values, record.name, record.sensor, (*record.notes, note))


def find_outliers(time: Array, values: Array) -> Index:
    """Return the indices of the outliers of a record, in ascending order; none if there are too many."""
    y, removed, evenly_spaced = values.copy(), np.zeros(len(values), dtype=bool), _evenly_spaced(time)
    while evenly_spaced.any():
        columns = np.column_stack([np.ones(len(evenly_spaced)), y[1:-3] + y[3:-1], y[:-4] + y[4:]])
        coefficients = np.asarray(np.linalg.lstsq(columns[evenly_spaced], y[2:-2][evenly_spaced])[0], dtype=float)
        expected = columns @ coefficients
        residuals = np.where(evenly_spaced & ~removed[2:-2], y[2:-2] - expected, 0.0)
        outliers = _select_outliers(y, residuals, coefficients)
        if not outliers.size:
            break
        removed[outliers + 2], y[outliers + 2] = True, expected[outliers]
        if np.count_nonzero(removed) > MAX_OUTLIERS * len(y):
            return np.array([], dtype=int)
    return np.flatnonzero(removed)


def _select_outliers(y: Array, residuals: Array, coefficients: Array) -> Index:
    """Return the indices of residuals that only a wrong value of their own sample explains, the largest nearby."""
    squares = residuals**2
    _, c1, c2 = coefficients
    signature = np.array([-c2, -c1, 1.0, -c1, -c2])  # five residuals about an outlier of size 1
    neighbourhoods = np.lib.stride_tricks.sliding_window_view(np.pad(residuals, 2), 5)
    explained = (neighbourhoods @ signature) ** 2 / (signature @ signature)
    is_single = explained > MIN_EXPLAINED * np.sum(neighbourhoods**2, axis=1)
    neighbours_agree = np.abs(y[3:-1] - y[1:-3]) < np.abs(residuals) / 2
    rounding = float(np.spacing(np.abs(y).max()))
    variance = np.maximum(np.maximum(squares.mean(), _mean_nearby(squares)), rounding**2)
    is_unlikely = squares > (2 * math.log(len(y)) + BIC_MARGIN) * variance
    indices = np.flatnonzero(neighbours_agree & is_single & is_unlikely)
    return indices[[squares[k] == squares[max(k - 4, 0) : k + 5].max() for k in indices]]


def _evenly_spaced(time: Array) -> NDArray[np.bool_]:
    """Return for each sample but two at either end whether its neighbours are at equal distances in time."""
    steps = np.diff(time)
    is_typical = np.abs(steps / np.median(steps) - 1) <= UNEVEN
    return np.asarray(is_typical[:-3] & is_typical[1:-2] & is_typical[2:-1] & is_typical[3:], dtype=bool)


def _mean_nearby(squares: Array) -> Array:
    """Return the mean of the squared residuals around each sample, less the five that an outlier there disturbs."""

    def window_sums(values: Array, reach: int) -> Array:
        total = np.append(0.0, np.cumsum(values))
        indices = np.arange(len(values))
        return np.asarray(total[np.minimum(indices + reach + 1, len(values))] - total[np.maximum(indices - reach, 0)])

    unit_weights = np.ones_like(squares)
    total, count = (window_sums(values, NEIGHBOURS) - window_sums(values, 2) for values in (squares, unit_weights))
    return np.asarray(np.maximum(total, 0.0) / np.maximum(count, 1.0))
