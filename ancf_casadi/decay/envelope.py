"""Damping against amplitude from the envelope of a free decay, without a damping law.

The record is divided into successive windows of a few periods.  In a window, with tau from its middle, a decay is

    y = Re((z0 + z1 tau) exp((i omega - lambda) tau)) + d

and z0, z1, d follow from linear least squares.  To first order, Re(z1/z0) is the error of the decay rate lambda, and
-Im(z1/z0) that of the frequency omega.  Three rounds of

    lambda <- lambda - Re(z1/z0),    omega <- omega + Im(z1/z0)

make z1 vanish.  Then |z0| is the amplitude A in the middle of the window, and lambda/(omega^2 + lambda^2)^1/2 is the
damping ratio there, whatever the law, because lambda = -d(ln A)/dt.  The windows do not overlap, so that their errors
are independent; the noise is assumed to be white and equal in all.  The curve ends where noise hides the oscillation.

References
----------
M. Feldman, Hilbert Transform Applications in Mechanical Vibration, Wiley (2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.colours import COMPUTED
from ancf_casadi.support.inputs import positive
from ancf_casadi.support.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROUNDS = 3
UNKNOWNS = 5  # per window
MINIMUM_SAMPLES = 8  # in a window
VISIBLE = 5.0  # amplitude, in standard errors, below which noise hides the oscillation
PLAUSIBLE = 0.5  # largest change of decay rate and frequency per round, relative to the frequency; beyond is noise


@dataclass(frozen=True, eq=False)
class DampingCurve:
    """Damping ratio and frequency of a decaying mode against its amplitude.

    Parameters
    ----------
    time : ndarray
        Middle of each window (k,), s, in the times of the record.
    amplitude : ndarray
        Amplitude in the middle of each window (k,), m.
    damping_ratio, damping_ratio_errors : ndarray
        Damping ratio (k,), and its standard error.
    frequency, frequency_errors : ndarray
        Natural frequency (k,), Hz, and its standard error.
    """

    time: Array
    amplitude: Array
    damping_ratio: Array
    damping_ratio_errors: Array
    frequency: Array
    frequency_errors: Array

    def table(self) -> Table:
        """Return the curve, one row per window."""
        columns = (
            "time_s",
            "amplitude_m",
            "damping_ratio",
            "damping_ratio_stderr",
            "frequency_hz",
            "frequency_stderr_hz",
        )
        series = (
            self.time, self.amplitude, self.damping_ratio, self.damping_ratio_errors, self.frequency,
            self.frequency_errors,
        )  # fmt: skip
        return Table("damping_curve", "Damping against amplitude", columns, np.column_stack(series).tolist())

    def figure(self) -> Figure:
        """Draw the damping ratio against the amplitude, with 95 % intervals."""
        from matplotlib.figure import Figure  # slow to import

        figure = Figure(figsize=(6, 3.6), layout="constrained")
        axes = figure.subplots()
        ratio, error = 100 * self.damping_ratio, 196 * self.damping_ratio_errors
        axes.errorbar(1e3 * self.amplitude, ratio, yerr=error, fmt="o", ms=3, lw=0.8, color=COMPUTED)
        axes.set(xlabel="amplitude, mm", ylabel="damping ratio, %")
        return figure


def damping_curve(record: Measurement, *, periods: float = 2.0, release_time: float | None = None) -> DampingCurve:
    """Return damping ratio and frequency of a decaying mode against its amplitude.

    Parameters
    ----------
    record : Measurement
        Record, which may begin at rest.
    periods : float
        Length of a window in periods, 1 or more; longer windows give smaller errors and fewer points.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, or a window has too few samples.
    """
    if positive(periods, "periods") < 1.0:
        raise InputError(f"must be 1 or more, got {periods:g}", "periods")
    guess = first_guess(record, release_time=release_time)
    time, y = record.time[guess.release :], record.values[guess.release :]
    width = periods * 2 * math.pi / guess.ω
    edges = np.searchsorted(time, np.arange(time[0], time[-1], width))
    λ, ω = guess.ζ * guess.ω, guess.ω
    rows, squares, freedom = [], 0.0, 0
    for begin, end in pairwise(edges.tolist()):
        if end - begin < MINIMUM_SAMPLES:
            raise InputError(
                f"makes windows of {end - begin} samples, fewer than {MINIMUM_SAMPLES}; use more periods per window",
                "periods",
            )
        middle = (time[begin] + time[end - 1]) / 2
        fitted = _local_decay(time[begin:end] - middle, y[begin:end], λ, ω)
        if fitted is None:
            break
        λ, ω, amplitude, spread, left = fitted
        squares, freedom = squares + left, freedom + end - begin - UNKNOWNS
        rows.append((middle, amplitude, λ, ω, *spread))
        if amplitude < VISIBLE * spread[0] * math.sqrt(squares / freedom):
            rows.pop()
            break
    if not rows:
        raise InputError(
            "shows no oscillation above the noise in its first window; use more periods per window", "record"
        )
    middles, amplitudes, rates, frequencies, _, rate_spread, frequency_spread = np.array(rows).T
    noise = math.sqrt(squares / freedom)
    natural = np.hypot(rates, frequencies)
    return DampingCurve(
        time=middles,
        amplitude=amplitudes,
        damping_ratio=rates / natural,
        damping_ratio_errors=noise * rate_spread / natural,
        frequency=natural / (2 * math.pi),
        frequency_errors=noise * frequency_spread / (2 * math.pi),
    )


def _local_decay(
    τ: Array, y: Array, λ: float, ω: float
) -> tuple[float, float, float, tuple[float, float, float], float] | None:
    """Return decay rate, frequency, amplitude, their standard errors for unit noise, and the sum of squared residuals.

    None if a round changes decay rate and frequency too much.
    """
    for _ in range(ROUNDS):
        fading = np.exp(-λ * τ)
        cosine, sine = fading * np.cos(ω * τ), -fading * np.sin(ω * τ)
        basis = np.column_stack([cosine, sine, τ * cosine, τ * sine, np.ones(len(τ))])
        root = np.linalg.pinv(basis)
        a, b, a1, b1, _ = found = root @ y
        correction = complex(a1, b1) / complex(a, b)
        if not abs(correction) < PLAUSIBLE * ω:
            return None
        λ, ω = λ - correction.real, ω + correction.imag
    amplitude = math.hypot(a, b)
    size, rate = (a * root[0] + b * root[1]) / amplitude, (a * root[2] + b * root[3]) / amplitude**2
    frequency = (a * root[3] - b * root[2]) / amplitude**2
    spread = tuple(float(np.linalg.norm(row)) for row in (size, rate, frequency))
    return λ, ω, amplitude, (spread[0], spread[1], spread[2]), float(np.sum((y - basis @ found) ** 2))
