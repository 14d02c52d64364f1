"""The covariance due to transient disturbances, which a power spectrum does not show.

A spectrum describes stationary noise.  A disturbance that decays, such as another mode, acts while the columns of the
Jacobian J are large, and may shift the estimates by more than J' R J says.  The sum of the products of r_i J_i and
r_j J_j, which are near in time, shows this.  With an orthonormal basis q of the columns of J and the quadratic spectral
kernel k,

    M_ij = sum_t sum_u k(t - u) q_ti r_t q_uj r_u,

and a width of the kernel of one mean period of the basis, so that other frequencies do not enter.  In directions in
which M exceeds q' R q by more than four standard errors of M, it replaces q' R q.

References
----------
D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix estimation, Econometrica 59
(1991).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ancf_casadi.estimation.noise.series import even_transform, transform
from ancf_casadi.support.arrays import Array, Index

CLEAR_EXCESS = 4.0  # standard errors of M by which it is larger than q' R q where it replaces it


def transient_covariance(
    residuals: Array,
    basis: Array,
    grids: Sequence[tuple[slice, Index]],
    leverages: Sequence[Array],
    stationary: Array,
) -> Array | None:
    """Return the part of the covariance of q'r (n, n) due to transient disturbances; None if not significant.

    ``leverages`` (k,) are those of the frequencies of each series, and ``stationary`` is q' R q.
    """
    m, n = basis.shape
    period = _mean_period(leverages)
    if not math.isfinite(period):
        return None
    products = np.zeros((n, n))
    for (rows, slots), leverage in zip(grids, leverages, strict=True):
        length = 2 * (len(leverage) - 1)
        angle = 1.2 * math.pi / period * np.arange(1, int(slots[-1]) + 1)
        kernel = np.concatenate([[1.0], 3 / angle**2 * (np.sin(angle) / angle - np.cos(angle))])
        window = even_transform(kernel, length)
        window[1:-1] *= 2
        scores = transform(residuals[rows, None] * basis[rows], slots, length)
        products += (scores.conj().T @ (scores * window[:, None])).real / length
    products *= m / (m - np.sum(basis**2))
    ridge = np.finfo(float).eps * (float(np.trace(stationary)) + float(residuals @ residuals) / m)
    root = np.linalg.cholesky(stationary + ridge * np.eye(n))
    inverse = np.linalg.inv(root)
    ratios, directions = np.linalg.eigh(inverse @ products @ inverse.T)
    columns = basis @ (inverse.T @ directions)
    shares = columns**2 / np.sum(columns**2, axis=0)
    slots_per_sample = sum(int(slots[-1]) + 1 for _, slots in grids) / m
    freedom = 1.5 / np.sum(shares**2, axis=0) * slots_per_sample / period  # m slots/period for a sine
    excess = np.where(ratios > 1 + CLEAR_EXCESS * np.sqrt(2 / freedom), ratios - 1, 0.0)
    if not excess.any():
        return None
    axes = root @ directions
    return np.asarray((axes * excess) @ axes.T)


def _mean_period(leverages: Sequence[Array]) -> float:
    """Return the mean period of the basis, in slots; infinite if it is constant."""
    cycles = energy = 0.0
    for leverage in leverages:
        frequency = np.arange(len(leverage)) / (2 * (len(leverage) - 1))
        cycles, energy = cycles + float(frequency @ leverage), energy + float(leverage.sum())
    return energy / cycles if cycles > 0.0 else math.inf
