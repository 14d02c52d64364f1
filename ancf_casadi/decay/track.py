"""Amplitude and phase of a free decay over time, as a first estimate without a law.

The record is divided into windows of whole periods of a carrier near its frequency.  In each window,

    y = Re(z exp(i omega t)) + d

is fitted by linear least squares.  |z| is the amplitude in the middle of the window, and omega t + arg z the phase,
counted on from window to window.  The track ends where noise hides the oscillation.  It follows a frequency that
changes by up to 1/(2 w) of itself, with windows of w periods, over any number of periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.support.arrays import Array

LEAST_SAMPLES = 8  # in a window
MOST_WINDOWS = 1000
FULL = 0.6  # share of the usual number of samples, below which a window is left out
VISIBLE = 4.0  # amplitude, in standard errors, below which noise hides the oscillation


@dataclass(frozen=True, eq=False)
class Track:
    """Amplitude and phase in the middle of successive windows.

    Parameters
    ----------
    time : ndarray
        Middle of each window (k,), s.
    amplitude : ndarray
        Amplitude there (k,), in the unit of the record.
    phase : ndarray
        Phase there (k,), rad; that of the release differs from it by the whole turns since.
    """

    time: Array
    amplitude: Array
    phase: Array

    def since_start(self, rate: Array) -> Array:
        """Return the integral (k,) of a rate (k,) from time 0 on, by the trapezoidal rule."""
        steps = np.diff(self.time) * (rate[1:] + rate[:-1]) / 2
        return np.asarray(self.time[0] * rate[0] + np.concatenate([[0.0], np.cumsum(steps)]))


def track(time: Array, measured: Array, ω: float) -> Track:
    """Return amplitude and phase of a decay.

    Parameters
    ----------
    time : ndarray
        Times after the release (m,), s, ascending.
    measured : ndarray
        Value at each (m,), in any unit.
    ω : float
        Frequency of the carrier, rad/s.
    """
    period = 2 * math.pi / ω
    rate = len(time) * period / (time[-1] - time[0])  # samples per period
    periods = max(1, math.ceil(LEAST_SAMPLES / rate), math.ceil((time[-1] - time[0]) / period / MOST_WINDOWS))
    edges = np.searchsorted(time, np.arange(time[0], time[-1], periods * period))
    counts = np.diff(edges)
    full = counts >= max(LEAST_SAMPLES / 2, FULL * np.median(counts)) if len(counts) else np.zeros(0, dtype=bool)
    if not full.any():
        return Track(np.zeros(0), np.zeros(0), np.zeros(0))
    columns = np.array([np.cos(ω * time), -np.sin(ω * time), np.ones(len(time)), measured])
    products = columns[:, None] * columns

    def sums(values: Array) -> Array:
        return np.asarray(np.add.reduceat(values[..., : edges[-1]], edges[:-1], axis=-1)[..., full])

    normal = np.moveaxis(sums(products), -1, 0)
    matrix = normal[:, :3, :3] + 1e-12 * np.eye(3) * counts[full, None, None]
    found = np.linalg.solve(matrix, normal[:, :3, 3:])[..., 0]
    left = np.maximum(normal[:, 3, 3] - np.sum(found * normal[:, :3, 3], axis=1), 0.0)
    noise = math.sqrt(np.median(left / counts[full]))
    middle = sums(time) / counts[full]
    amplitude = np.hypot(found[:, 0], found[:, 1])
    hidden = np.flatnonzero(amplitude < VISIBLE * noise * np.sqrt(2 / counts[full]))
    hidden = hidden[hidden > np.argmax(amplitude)]
    end = int(hidden[0]) if hidden.size else len(middle)
    angle = np.unwrap(np.arctan2(found[:end, 1], found[:end, 0]))
    return Track(middle[:end], amplitude[:end], ω * middle[:end] + angle)
