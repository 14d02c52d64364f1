"""The power spectrum of the noise near the frequencies of the fitted curve, from the residuals.

White noise has the same power at all frequencies, and the m residuals r of a fit with n unknowns give its variance
s^2 = r'r/(m - n).  The residuals of measured records are coloured: cameras and filters smooth them, other modes and
quantisation stand out as lines.  What counts for the estimates is the power S(f) at the frequencies f that the columns
of the Jacobian J contain, because with the covariance R of the noise

    cov(J'r) = J' R J = sum_f S(f) |J(f)|^2.

S is estimated in two steps.  First, an autoregressive process of order 1 is fitted (``autoregression``), R_ij =
rho^|i - j|, if this lowers the criterion BIC.  Second, the power P(f) of the residuals over that of this process, E(f),
is averaged over a band about each frequency,

    C(f) = sum P/E over the band / sum (1 - h),        S(f) = C(f) E(f).

The leverage h is the part of the noise that the fitted curve absorbs at a frequency, so that C is free of bias for
every band.  The band is the widest whose mean agrees with that of each narrower band within the random errors of these
means (Lepski's method).  Lines then end the band, and white or autoregressive noise extends it to the whole spectrum of
all series, which leaves no more than the errors of s^2 and rho.  The degrees of freedom nu of Student's distribution
allow for both: for a small variance V of the logarithm of S due to the error of rho, 1/nu is that of s^2 plus
V/(V + 2).  If no variance changes by more than a tenth, or than its random error, the noise counts as white, and the
errors are those of an ordinary fit.

A fit of an almost exact record leaves misfit, such as harmonics, instead of noise.  Misfit has no floor: between its
lines the power falls by orders of magnitude, and a low power beside a line says nothing of the misfit that the curve
has absorbed.  Where S exceeds ten times its median, it is therefore taken as the mean square of the residuals at least.

Samples that are missing leave zeros in an even grid of times (``series``); E is the expected power of the process with
these zeros.

References
----------
O. V. Lepskii, On a problem of adaptive estimation in Gaussian white noise, Theory of Probability and Its Applications
35 (1991).
E. Parzen, On spectral analysis with missing observations and amplitude modulation, Sankhya A 25 (1963).
H. White, A heteroskedasticity-consistent covariance matrix estimator, Econometrica 48 (1980), for the covariance of
estimates whose residuals are not white.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.estimation.noise.autoregression import FEWEST_RESIDUALS, correlations
from ancf_casadi.estimation.noise.covariance import Noise, SeriesSpectrum
from ancf_casadi.estimation.noise.series import even_transform, series_grids, transform
from ancf_casadi.estimation.noise.transient import transient_covariance
from ancf_casadi.support.arrays import Array, Index

NARROWEST_BAND = 12  # half-width of the narrowest band, in cycles per length of the series
SAME_MEAN = 2.0  # difference of two means, in standard errors, up to which they agree
WHITE_CHANGE = 0.1  # change of a variance, relative to white noise, up to which the noise counts as white
PEAK_POWER = 10.0  # power over the median of the spectrum, beyond which it is not the floor of the noise
UNSEEN = 1e-6  # share of the noise that a fit leaves, below which the residuals show none of it


def estimated_noise(residuals: Array, basis: Array, series: Sequence[int], times: Array | None) -> Noise:
    """Return the noise of a fit with n free unknowns from its residuals (m,), the psi of a robust one.

    The orthonormal ``basis`` (m, n) spans the columns of the Jacobian; for a subset of the residuals, it has the rows
    of these, and their leverage takes the place of n.  Without series, the residuals have no order and count as white
    noise; without times (m,), those of a series are equally spaced.
    """
    (m, n), gram = basis.shape, basis.T @ basis
    leverage = float(np.trace(gram))
    if m - leverage < UNSEEN * m:
        return Noise(math.nan, 0.0)
    white = Noise(float(residuals @ residuals) / (m - leverage), m - leverage)
    if not series or m < FEWEST_RESIDUALS or n == 0 or not white.variance > 0.0:
        return white
    grids = series_grids(series, times)
    coefficients, log_variance = correlations(residuals, basis, grids)
    powers = [
        _relative_power(residuals[rows], basis[rows], slots, ρ)
        for (rows, slots), ρ in zip(grids, coefficients, strict=True)
    ]
    coloured = _coloured_noise(residuals, white.variance, grids, powers, log_variance)
    change = abs(np.linalg.eigvalsh(coloured.form(basis) / white.variance - gram)).max()
    insignificant = max(WHITE_CHANGE, SAME_MEAN * math.sqrt(2 / coloured.freedom))
    stationary = white if change < insignificant else coloured
    leverages = [power.leverage for power in powers]
    transient = transient_covariance(residuals, basis, grids, leverages, stationary.form(basis))
    if stationary is white and transient is None:
        return white
    dual = None if transient is None else basis @ np.linalg.pinv(gram)
    noise = replace(stationary, transient=transient, basis=dual)
    return replace(noise, inflation=float(np.trace(noise.form(basis))) / (leverage * white.variance))


@dataclass(frozen=True, eq=False)
class _RelativePower:
    """Power of a series of residuals relative to the autoregressive process, as sums from the lowest frequency on.

    ``power`` and ``unabsorbed`` (k + 1,) are the sums of P/E and of 1 - h, ``leverage`` (k,) is h, and ``process`` (k,)
    the power of the process without gaps; all include the weights of the frequencies.
    """

    power: Array
    unabsorbed: Array
    leverage: Array
    process: Array


def _relative_power(residuals: Array, basis: Array, slots: Index, ρ: float) -> _RelativePower:
    """Return the power of a series relative to that of an autoregressive process with the coefficient ρ."""
    N = int(slots[-1]) + 1
    length = 2 ** math.ceil(math.log2(2 * N))
    present = transform(np.ones((len(slots), 1)), slots, length)[:, 0]
    pairs = np.fft.irfft(np.abs(present) ** 2, length)[:N]
    correlation = ρ ** np.arange(N, dtype=float)
    expected = even_transform(correlation * pairs, length) / len(slots)
    weights = _frequency_weights(len(expected))
    columns = np.column_stack([residuals, basis])
    power = np.abs(transform(columns, slots, length)) ** 2 * (weights / length)[:, None]
    leverage = power[:, 1:].sum(axis=1)
    unabsorbed = np.maximum(weights * len(slots) / length - leverage, 0.0)
    floor = np.finfo(float).eps * expected.max()
    process = np.maximum(even_transform(correlation, length), 0.0)
    return _RelativePower(
        power=np.concatenate([[0.0], np.cumsum(power[:, 0] / np.maximum(expected, floor))]),
        unabsorbed=np.concatenate([[0.0], np.cumsum(unabsorbed)]),
        leverage=leverage,
        process=weights * process,
    )


def _coloured_noise(
    residuals: Array,
    white_variance: float,
    grids: Sequence[tuple[slice, Index]],
    powers: Sequence[_RelativePower],
    log_variance: float,
) -> Noise:
    """Return the stationary noise with the spectrum S; ``log_variance`` is V of the logarithm of S."""
    total, unabsorbed = (sum(getattr(power, name)[-1] for power in powers) for name in ("power", "unabsorbed"))
    spectra, freedoms = [], []
    for (rows, slots), power in zip(grids, powers, strict=True):
        mean, freedom = _local_means(power, len(slots), float(total), float(unabsorbed))
        spectrum = _with_misfit(power.process * mean, float(np.mean(residuals[rows] ** 2)))
        spectra.append(SeriesSpectrum(rows, slots, spectrum))
        freedoms.append(freedom)
    leverage = np.concatenate([power.leverage for power in powers])
    inverse_freedom = float(leverage @ (1 / np.concatenate(freedoms))) / float(leverage.sum())
    return Noise(white_variance, 1 / (inverse_freedom + log_variance / (log_variance + 2)), tuple(spectra))


def _local_means(relative: _RelativePower, samples: int, total: float, unabsorbed: float) -> tuple[Array, Array]:
    """Return the mean C (k,) over the band of each frequency, and its degrees of freedom (k,).

    The widest band is the whole spectrum of all series, with the sums ``total`` and ``unabsorbed``.
    """
    k = np.arange(len(relative.leverage))
    bands = []
    half = NARROWEST_BAND * 2 * len(k) / max(2 * samples, 1)
    while half < len(k):
        low, high = np.maximum(k - int(half), 0), np.minimum(k + int(half) + 1, len(k))
        bands.append((relative.power[high] - relative.power[low], relative.unabsorbed[high] - relative.unabsorbed[low]))
        half *= 2
    everywhere = np.ones(len(k))
    bands += [
        (relative.power[-1] * everywhere, relative.unabsorbed[-1] * everywhere),
        (total * everywhere, unabsorbed * everywhere),
    ]
    mean, freedom = bands[-1][0] / bands[-1][1], bands[-1][1]
    lowest, highest, agrees = -np.inf * everywhere, np.inf * everywhere, np.ones(len(k), dtype=bool)
    for power, freedom_of_band in bands:
        usable = freedom_of_band > 1.0
        logarithm = np.log(np.maximum(power, np.finfo(float).tiny) / np.maximum(freedom_of_band, 1.0))
        error = SAME_MEAN * np.sqrt(2 / np.maximum(freedom_of_band, 1.0))
        agrees &= ~usable | ((logarithm + error >= lowest) & (logarithm - error <= highest))
        chosen = agrees & usable
        mean, freedom = np.where(chosen, np.exp(logarithm), mean), np.where(chosen, freedom_of_band, freedom)
        lowest = np.where(chosen, np.maximum(lowest, logarithm - error), lowest)
        highest = np.where(chosen, np.minimum(highest, logarithm + error), highest)
    return mean, freedom


def _with_misfit(power: Array, variance: float) -> Array:
    """Return the power of a series (k,), at least that of white noise of its variance where it exceeds the floor."""
    weights = _frequency_weights(len(power))
    misfit = power > PEAK_POWER * weights * np.median(power / weights)
    return np.where(misfit, np.maximum(power, weights * variance), power)


def _frequency_weights(count: int) -> Array:
    """Return the weights of the frequencies of a real spectrum: 1 at both ends, 2 between them."""
    weights = np.full(count, 2.0)
    weights[[0, -1]] = 1.0
    return weights
