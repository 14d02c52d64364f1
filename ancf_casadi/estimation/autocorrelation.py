"""Autocorrelation of residuals, and the number of independent ones that they are worth.

The residuals r of several series (a series is one coordinate of one record, in the order of time) have the
autocorrelation

    rho_k = sum r_i r_(i+k) / sum r_i^2,

both sums over all series, and products within a series only.  At the frequency f, in cycles per sample, the noise has
the power s^2 (1 + 2 sum_k rho_k cos(2 pi f k)), and m samples tell of a signal there as much as

    m/(1 + 2 sum_k rho_k cos(2 pi f k))

samples with white noise do.  Since a misfit and the motion that it is part of have the same frequencies, whatever these
are, the effective number of samples is here the least over all frequencies that the autocorrelation permits,

    n = m/(1 + 2 sum_(k <= M) |rho_k|).

For an autoregressive process of order 1 this is the familiar m (1 - rho)/(1 + rho).  Estimates of rho_k are noise
beyond some lag: M is the last lag before five successive ones within 2 (log10 m/m)^1/2, about 3.7 standard deviations
of white noise where m = 2500.  White residuals nearly always have M = 0, and so count in full.

References
----------
G. V. Bayley, J. M. Hammersley, The "effective" number of independent observations in an autocorrelated time series,
Supplement to the Journal of the Royal Statistical Society 8 (1946).
D. N. Politis, Adaptive bandwidth choice, Journal of Nonparametric Statistics 15 (2003).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.support.arrays import Array

QUIET_LAGS = 5  # successive insignificant ones that end the sum
SIGNIFICANT = 2.0  # times (log10 m/m)^1/2


def autocorrelation(residuals: Array, series: Sequence[int] = ()) -> Array:
    """Return the autocorrelation rho_0 = 1, rho_1, ... of residuals; nan if all of them are zero.

    Parameters
    ----------
    residuals : ndarray
        Residuals (m,), one series after the other.
    series : sequence of int
        Lengths of the series, m in all; a single one if not given.
    """
    lengths = tuple(series) or (len(residuals),)
    products = np.zeros(max(lengths))
    for part in np.split(residuals, np.cumsum(lengths)[:-1]):
        spectrum = np.fft.rfft(part, 2 * len(part))
        products[: len(part)] += np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(part))[: len(part)]
    return products / products[0] if products[0] > 0.0 else np.full(len(products), math.nan)


def effective_samples(residuals: Array, series: Sequence[int] = ()) -> float:
    """Return how many independent residuals tell as much as these; all of them where they are zero.

    Parameters
    ----------
    residuals, series
        As of ``autocorrelation``.
    """
    m = len(residuals)
    size = np.abs(autocorrelation(residuals, series)[1:])
    if np.isnan(size).any():
        return float(m)
    quiet = np.append(size < SIGNIFICANT * math.sqrt(math.log10(m) / m), np.ones(QUIET_LAGS, dtype=bool))
    last = int(np.argmax(np.lib.stride_tricks.sliding_window_view(quiet, QUIET_LAGS).all(axis=1)))
    return m / (1 + 2 * float(size[:last].sum()))
