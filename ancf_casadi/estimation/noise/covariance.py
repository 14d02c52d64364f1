"""The covariance R of the noise in the residuals of a fit.

With the Jacobian J of the residuals, the covariance of the estimates follows from J' R J.  White noise of variance s^2
has R = s^2 I.  Coloured noise has a power spectrum per series (``spectrum``); transient disturbances add to R in the
directions of the fitted curve (``transient``); residuals whose standard deviation the user states have noise of their
own (``stated``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf_casadi.estimation.noise.series import transform
from ancf_casadi.support.arrays import Array, Index, Mask


@dataclass(frozen=True, eq=False)
class SeriesSpectrum:
    """Power spectrum of the noise in one series of residuals."""

    rows: slice  # among all residuals
    slots: Index  # positions of the samples in an even grid of times
    power: Array  # power S (k,) times the weight of the frequency: 1 at both ends of the spectrum, 2 between them

    @property
    def length(self) -> int:
        """Length of the Fourier transform."""
        return 2 * (len(self.power) - 1)

    def form(self, columns: Array) -> Array:
        """Return X' R X (n, n) for columns X (m, n)."""
        spectra = transform(columns[self.rows], self.slots, self.length)
        product = spectra.conj().T @ (spectra * self.power[:, None])
        return np.asarray(product.real / self.length)


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance R of the noise in residuals."""

    variance: float  # variance s^2, as of white noise; nan for zero degrees of freedom
    freedom: float  # degrees of freedom of the estimated power, for Student's distribution
    spectra: tuple[SeriesSpectrum, ...] = ()  # spectrum of each series; none if the noise is white
    transient: Array | None = None  # significant part of the covariance of q'r (n, n) due to transient disturbances
    basis: Array | None = None  # q (m, n) of the columns of the Jacobian, dual if not orthonormal, for ``transient``
    inflation: float = 1.0  # mean variance in the directions of the fitted curve, relative to s^2
    subsets: tuple[tuple[Mask, Noise], ...] = ()  # residuals with noise of their own, all of them; s^2 is the mean
    p_value: float = math.nan  # probability of larger residuals for stated standard deviations; nan without these
    stated_ratio: float = 1.0  # standard deviation over the stated one

    @property
    def white(self) -> bool:
        """True if the noise is white as far as the residuals show."""
        return not self.spectra and self.transient is None and all(noise.white for _, noise in self.subsets)

    @property
    def coloured(self) -> bool:
        """True if neighbouring residuals are correlated."""
        return bool(self.spectra) or any(noise.coloured for _, noise in self.subsets)

    def form(self, columns: Array) -> Array:
        """Return X' R X (n, n) for columns X (m, n)."""
        if self.subsets:
            form = sum(noise.form(columns[rows]) for rows, noise in self.subsets)
        elif self.spectra:
            form = sum(spectrum.form(columns) for spectrum in self.spectra)
        else:
            form = self.variance * (columns.T @ columns)
        if self.transient is None or self.basis is None:
            return np.asarray(form)
        coordinates = self.basis.T @ columns
        return np.asarray(form + coordinates.T @ self.transient @ coordinates)

    def at_least(self, deviation: float) -> Noise:
        """Return white noise of no less than a standard deviation."""
        return self if not self.white or self.variance >= deviation**2 else Noise(deviation**2, self.freedom)

    def along(self, column: Array) -> float:
        """Return the variance of the noise in the direction of a column (m,); s^2 if the column is zero."""
        size = float(column @ column)
        return float(self.form(column[:, None])[0, 0]) / size if size else self.variance
