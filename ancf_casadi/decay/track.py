"""Amplitude and phase of an oscillation over time, as a first estimate without a law.

The record is divided into windows of whole periods of a carrier near its frequency.  In each window,

    y = Re(z exp(i omega t)) + d

is fitted by linear least squares to the samples at their own times.  |z| is the amplitude in the middle of the window,
and omega t + arg z the phase, counted on from window to window.  A window in which missing frames increase the variance
of z too much is left out.  The track ends where noise hides the oscillation (``evidence``).  It follows a frequency
that changes by up to 1/(2 w) of itself, with windows of w periods, over any number of periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.decay.evidence import visible
from ancf_casadi.decay.spectrum import LEAST_SAMPLES, typical_step
from ancf_casadi.support.arrays import Array, ComplexArray, Index

# Halved, test_without_the_finder_the_damping_would_be_wrong fails; doubled,
# test_a_plain_decay_with_missing_frames_is_hardly_ever_taken_for_an_excitation does.
POOREST = 2.5  # variance of z, relative to a window without missing frames, beyond which it is left out


@dataclass(frozen=True, eq=False)
class Windows:
    """The oscillation in successive windows.

    Parameters
    ----------
    number : ndarray
        Number of each window (k,), from 0 at the first sample; those left out are missing.
    z : ndarray
        Complex amplitude relative to the carrier (k,), in the unit of the record.
    seen : ndarray
        Whether noise leaves it visible (k,); it may not be before the largest one.
    middle : ndarray
        Mean time of its samples (k,), s.
    length : float
        Length of a window, s.
    """

    number: Index
    z: ComplexArray
    seen: NDArray[np.bool_]
    middle: Array
    length: float


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
    """Return amplitude and phase of a decay in up to a thousand windows.

    Parameters
    ----------
    time : ndarray
        Times after the release (m,), s, ascending.
    measured : ndarray
        Value at each (m,), in any unit.
    ω : float
        Frequency of the carrier, rad/s.
    """
    found = windows(time, measured, ω, most=1000, degree=0)
    return Track(found.middle, np.abs(found.z), ω * found.middle + np.unwrap(np.angle(found.z)))


def windows(time: Array, measured: Array, ω: float, *, most: int, degree: int) -> Windows:
    """Return the oscillation about a polynomial of a degree in successive windows, until noise hides it; see ``track``.

    There are ``most`` windows at most.
    """
    step = typical_step(time)
    period, count = 2 * math.pi / (ω * step), (time[-1] - time[0]) / step + 1  # both in steps
    size = round(period * max(1, math.ceil(LEAST_SAMPLES / period), math.ceil(count / period / most)))
    edges = np.searchsorted(time, time[0] + step * (size * np.arange(int(count / size + 1e-9) + 1) - 0.5))
    counts, unknowns = np.diff(edges), 3 + degree
    number = np.flatnonzero(counts > unknowns)
    line = 2 * (((time - time[0]) / step + 0.5) / size % 1.0) - 1  # from -1 to 1 in each window
    columns = np.array([np.cos(ω * time), -np.sin(ω * time), *(line**n for n in range(degree + 1)), measured, time])
    columns = np.append(columns, np.zeros((len(columns), 1)), axis=1)  # so that the last window may be empty
    normal = np.moveaxis(np.add.reduceat(columns[:, None] * columns, edges, axis=-1)[..., number], -1, 0)
    basis, y = slice(unknowns), unknowns
    inverse = np.linalg.inv(normal[:, basis, basis] + 1e-12 * np.eye(unknowns) * counts[number, None, None])
    found = (inverse @ normal[:, basis, y, None])[..., 0]
    variance = (inverse[:, 0, 0] + inverse[:, 1, 1]) / 2  # of z, over that of the noise; 2/size without missing frames
    left = np.maximum(normal[:, y, y] - np.sum(found * normal[:, basis, y], axis=1), 0.0)
    z, middle = found[:, 0] + 1j * found[:, 1], normal[:, 2, -1] / counts[number]
    full = (variance < POOREST * 2 / size) & (np.abs(z) > 1e-12 * np.abs(z).max(initial=0.0))
    number, z, middle, left, variance = (values[full] for values in (number, z, middle, left, variance))
    end, seen = len(number), np.zeros(0, dtype=bool)
    if end:
        error = np.sqrt(variance * np.median(left / (counts[number] - unknowns)))
        seen = visible(np.abs(z), error, counts[number])
        end = next((k for k in range(int(np.argmax(np.abs(z))) + 1, end) if not seen[k]), end)
    return Windows(number[:end], z[:end], seen[:end], middle[:end], size * step)
