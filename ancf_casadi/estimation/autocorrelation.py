"""Autocorrelation of residuals, and the effective number of independent residuals.

The residuals r of several series (a series is one coordinate of one record, in the order of time) have the
autocorrelation

    rho_k = sum r_i r_(i+k) / sum r_i^2,

both sums over all series, and products within a series only.  At the frequency f, in cycles per sample, the noise has
the power s^2 (1 + 2 sum_k rho_k cos(2 pi f k)), and m samples contain as much information on a signal there as

    m/(1 + 2 sum_k rho_k cos(2 pi f k))

samples with white noise.  The motion that a law fails to explain may have any frequency.  The effective number of
samples is therefore taken as a lower bound over all frequencies,

    n = m/(1 + 2 sum_(k <= M) |rho_k|).

For an autoregressive process of order 1 this is the familiar m (1 - rho)/(1 + rho).  Estimates of rho_k are noise
beyond some lag: M is the last lag before five successive ones within 2 (log10 m/m)^1/2, about 3.7 standard deviations
of white noise for m = 2500.  White residuals nearly always have M = 0, and so count in full.

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

QUIET_LAGS = 5  # successive insignificant lags that end the sum
SIGNIFICANT = 2.0  # times (log10 m/m)^1/2
COLOURED = (
    1 / 3
)  # ratio n/m below which residuals do not count as noise; an autoregressive process with rho = 0.5 has it


def autocorrelation(residuals: Array, series: Sequence[int] = ()) -> Array:
    """Return the autocorrelation rho_0 = 1, rho_1, ... of residuals; nan if all of them are zero.

    Parameters
    ----------
    residuals : ndarray
        Residuals (m,), one series after the other.
    series : sequence of int
        Lengths of the series, m in all; one series if not given.
    """
    lengths = tuple(series) or (len(residuals),)
    products = np.zeros(max(lengths))
    for part in np.split(residuals, np.cumsum(lengths)[:-1]):
        spectrum = np.fft.rfft(part, 2 * len(part))
        products[: len(part)] += np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(part))[: len(part)]
    return products / products[0] if products[0] > 0.0 else np.full(len(products), math.nan)


def effective_samples(residuals: Array, series: Sequence[int] = ()) -> float:
    """Return the effective number n of independent residuals; m if all residuals are zero.

    Parameters
    ----------
    residuals, series
        As in ``autocorrelation``.
    """
    m = len(residuals)
    size = np.abs(autocorrelation(residuals, series)[1:])
    if np.isnan(size).any():
        return float(m)
    quiet = np.append(size < SIGNIFICANT * math.sqrt(math.log10(m) / m), np.ones(QUIET_LAGS, dtype=bool))
    last = int(np.argmax(np.lib.stride_tricks.sliding_window_view(quiet, QUIET_LAGS).all(axis=1)))
    return m / (1 + 2 * float(size[:last].sum()))


def colour_warning(residuals: Array, series: Sequence[int] = (), *, noise_free: float = 0.0) -> str | None:
    """Return a warning if residuals are correlated and their root mean square is above ``noise_free``; None if not."""
    m, n = len(residuals), effective_samples(residuals, series)
    if n >= COLOURED * m or not residuals @ residuals > m * noise_free**2:
        return None
    return (
        f"the {m} residuals are not noise and carry the information of {n:.0f} independent ones: the law does "
        "not explain all of the motion, and the standard errors are too small, by a factor of up to "
        f"{math.sqrt(m / n):.2g}; another law, or more modes, may explain the rest"
    )
