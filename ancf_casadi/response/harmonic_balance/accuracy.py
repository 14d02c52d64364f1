"""Error of a periodic motion due to its number of harmonics and of samples.

A motion with H harmonics and N samples is put into the equation of motion at 2 N samples.  The harmonics of the
residual beyond H would drive the missing harmonics of the motion,

    x_k = -Z_k^-1 r_k,    Z_k = K + i k omega D - (k omega)^2 M    with the mean matrices of a period,

and those up to H, which vanish at N samples, shift the unknowns along the normal of the curve.  The missing harmonics
change the residual up to H as well, and near a resonance this shifts the unknowns by more than the missing harmonics
themselves, by a factor of about 1/zeta.  All are compared with the size of the motion.  Forces with a kink, such as
drag and friction, decide both numbers: their harmonics fall as 1/k^3 and 1/k.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.response.harmonic_balance.balance import HarmonicBalance, Setting
from ancf_casadi.response.harmonic_balance.fourier import fourier, resized
from ancf_casadi.support.arrays import Array

FIRST_HARMONICS = 5
MOST_HARMONICS = 199
MOST_PERIOD_SAMPLES = 4096


@dataclass(frozen=True)
class Errors:
    """Estimated errors of a motion, relative to its size.

    Parameters
    ----------
    harmonics : float
        Size of the missing harmonics, and of the error of the others that is due to them.
    samples : float
        Error of the coefficients due to the sampling.
    """

    harmonics: float
    samples: float

    @property
    def largest(self) -> float:
        """The larger of both."""
        return max(self.harmonics, self.samples)


def size_of(balance: HarmonicBalance, C: Array) -> float:
    """Return the size of the motion about its mean, relative to the scale of the system."""
    return float((np.abs(C[1:]) / balance.system.scale).max())


def errors_of(
    balance: HarmonicBalance,
    C: Array,
    setting: Setting,
    matrices: tuple[Array, Array, Array],
    size: float,
    shift: Callable[[Array], Array],
) -> Errors:
    """Return the estimated errors of a motion, relative to a size.

    Parameters
    ----------
    balance, C, setting
        The motion.
    matrices : (array, array, array)
        Entries of K, D and M at the samples, (N, k).
    size : float
        Size of the motion.
    shift : callable
        Returns the change of the coefficients, (2 H + 1, n), due to a residual (2 H + 1, n).
    """
    series, system = balance.fourier, balance.system
    # harmonics of the residual are checked up to this multiple of H
    most = min(3 * series.harmonics, series.samples - 1)
    finer = replace(balance, fourier=fourier(series.harmonics, 2 * series.samples, series.half))
    whole = fourier(most, 2 * series.samples, series.half)
    r = np.where(whole.allowed(system.mirror), whole.analysis @ finer.sampled_residual(C, setting).T, 0.0)
    K, D, M = (system.matrix(entries.mean(axis=0)) for entries in matrices)
    if series.half:
        K, D, M = (matrix * (system.mirror[:, None] == system.mirror) for matrix in (K, D, M))
    D = D - setting.growth * M
    k = setting.omega * np.arange(series.harmonics + 1, most + 1)
    missing = r[series.size :: 2] - 1j * r[series.size + 1 :: 2]
    Z = K + 1j * k[:, None, None] * D - k[:, None, None] ** 2 * M
    x = np.linalg.solve(Z, missing[:, :, None])[:, :, 0]
    longer = resized(C, most)
    longer[series.size :: 2], longer[series.size + 1 :: 2] = -x.real, x.imag
    R = replace(balance, fourier=whole).sampled_residual(longer, setting).T
    feedback, sampling = (whole.analysis @ R - r)[: series.size], r[: series.size] - balance.residual(C, setting)

    def largest(change: Array) -> float:
        return float((change / system.scale).max(initial=0.0)) / size

    shifted, sampled = (np.abs(shift(part)) for part in (feedback, sampling))
    return Errors(max(largest(np.abs(x)), largest(shifted)), largest(sampled))


def refined(errors: Errors, harmonics: int, samples: int, tolerance: float) -> tuple[int, int]:
    """Return larger numbers of harmonics and samples where an error exceeds the tolerance."""
    if errors.harmonics > tolerance:
        harmonics = harmonics + max(2, harmonics // 3)
        samples = max(samples, least_samples(harmonics))
    if errors.samples > tolerance:
        samples *= 2
    return harmonics, samples


def least_samples(harmonics: int) -> int:
    """Return the number of samples to begin with, 4 (H + 1)."""
    return 4 * (harmonics + 1)
