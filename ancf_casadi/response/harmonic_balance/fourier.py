"""Real Fourier series of one period, and their samples.

With the phase tau = omega t, a motion of n coordinates with H harmonics is

    q(tau) = c_0 + sum_k (a_k cos k tau + b_k sin k tau) = E(tau) C,    k = 1 ... H,

with the coefficients C (2 H + 1, n) in the order c_0, a_1, b_1, a_2, b_2, ...  At N > 2 H equally spaced samples, the
basis is E (N, 2 H + 1), its derivatives with respect to tau are E' = E S and E'' = E S^2 with a constant matrix S, and
W = (E^T E)^-1 E^T gives the coefficients of a sampled function.

Symmetry.  If a system and its excitation have a mirror symmetry P = diag(+-1), it may vibrate with
q(tau + pi) = P q(tau).  Coordinates with P = -1 then have odd harmonics only, the others even ones, and samples of half
a period suffice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.support.arrays import Array, Index


@dataclass(frozen=True)
class Fourier:
    """The Fourier series with H harmonics at N samples of one period."""

    harmonics: int  # H
    samples: int  # N per period, more than 2 H
    half: bool = False  # whether only the samples of the first half of the period are taken

    @property
    def count(self) -> int:
        """Number of samples that are taken."""
        return self.samples // 2 if self.half else self.samples

    @property
    def size(self) -> int:
        """Number of coefficients per coordinate, 2 H + 1."""
        return 2 * self.harmonics + 1

    @cached_property
    def phases(self) -> Array:
        """Phase tau of the samples, (N,), rad."""
        return 2 * np.pi * np.arange(self.count) / self.samples

    @cached_property
    def basis(self) -> Array:
        """E, (N, 2 H + 1)."""
        return basis_at(self.phases, self.harmonics)

    @cached_property
    def derivative(self) -> Array:
        """S, (2 H + 1, 2 H + 1): the coefficients of the derivative with respect to tau are S C."""
        S = np.zeros((self.size, self.size))
        for k in range(1, self.harmonics + 1):
            S[2 * k - 1, 2 * k], S[2 * k, 2 * k - 1] = k, -k
        return S

    @cached_property
    def slope(self) -> Array:
        """E' = E S, (N, 2 H + 1)."""
        return np.asarray(self.basis @ self.derivative)

    @cached_property
    def curvature(self) -> Array:
        """E'' = E S^2, (N, 2 H + 1)."""
        return np.asarray(self.slope @ self.derivative)

    @cached_property
    def analysis(self) -> Array:
        """W, (2 H + 1, N)."""
        weights = np.full(self.size, 2.0 / self.count)
        weights[0] = 1.0 / self.count
        return np.asarray(weights[:, None] * self.basis.T)

    @cached_property
    def orders(self) -> Index:
        """Number of the harmonic of each coefficient, (2 H + 1,)."""
        return (np.arange(self.size) + 1) // 2

    def allowed(self, mirror: Array) -> NDArray[np.bool_]:
        """Return which coefficients (2 H + 1, n) are not zero by symmetry; all of them for a whole period."""
        if not self.half:
            return np.ones((self.size, len(mirror)), dtype=bool)
        return np.asarray((-1.0) ** self.orders[:, None] == mirror)


@lru_cache(maxsize=32)
def fourier(harmonics: int, samples: int, half: bool = False) -> Fourier:
    """Return the Fourier series with a number of harmonics and samples; equal ones share their matrices."""
    return Fourier(harmonics, samples, half)


def basis_at(phases: Array, harmonics: int) -> Array:
    """Return the basis E at any phases (k,), rad, as an array (k, 2 H + 1)."""
    angles = np.multiply.outer(phases, np.arange(1, harmonics + 1))
    pairs = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(len(phases), -1)
    return np.hstack([np.ones((len(phases), 1)), pairs])


def resized(coefficients: Array, harmonics: int) -> Array:
    """Return coefficients (2 H + 1, n) with another number of harmonics: cut off, or with zeros added."""
    result = np.zeros((2 * harmonics + 1, coefficients.shape[1]))
    kept = min(len(coefficients), len(result))
    result[:kept] = coefficients[:kept]
    return result
