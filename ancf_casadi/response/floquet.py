"""Stability of a periodic motion: Floquet multipliers, and the bifurcations at which stability is lost.

A small disturbance x of a motion with period T follows the linear equation with periodic coefficients

    M(t) x_tt + D(t) x_t + K(t) x = 0,    M, D, K of period T.

The monodromy matrix P maps the state (x, x_t) of any disturbance at time 0 to that at time T.  Its eigenvalues are the
Floquet multipliers: the motion is stable if none of them lies outside the unit circle.  Where one leaves the circle
along a curve of motions, the curve bifurcates:

    at +1              fold, if the curve turns there; otherwise branch point (loss of a symmetry)
    at -1              period doubling
    a complex pair     Neimark-Sacker

P is the product of the matrices of equal steps h.  Each step is taken by collocation at the seven Radau points c_i, a
method of order 13.  With z_i = x(t_i) - x_0, w = h x_t and the derivative matrix B of the polynomial through 0 and
z_1, ..., z_7,

    M_i ((B^2 z)_i - (B 1)_i w_0) + h D_i (B z)_i + h^2 K_i (z_i + x_0) = 0,    i = 1, ..., 7

    x_1 = x_0 + z_7,    w_1 = (B z)_7.

The coefficients between the samples follow by trigonometric interpolation.  A step of half an oscillation keeps the
amplitude to within 1e-7.  Faster vibrations are damped, ultimately to zero, because the method is L-stable: those of a
fine mesh remain stable and do not disturb the slow ones.  The magnitudes of their multipliers are then too small.  This
does not change the verdict, because N samples hold no harmonic that could excite a vibration of more than N/4
oscillations per period.

References
----------
A. H. Nayfeh, B. Balachandran, Applied Nonlinear Dynamics, Wiley (1995), Sections 3.2 and 3.5.
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer (1996), Sections IV.3 and IV.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.harmonic_balance.balance import basis_at
from ancf_casadi.support.arrays import Array, ComplexArray, Index

FLOQUET_STAGES = 7
STABILITY_TOLERANCE = 1e-6  # of a magnitude; undamped vibrations stay on the unit circle to rounding and truncation

Bifurcation = Literal["fold", "branch point", "period doubling", "Neimark-Sacker"]


def floquet_multipliers(
    K: Array,
    D: Array,
    M: Array,
    period: float,
    *,
    mirror: Array | None = None,
) -> ComplexArray:
    """Return the Floquet multipliers (2n,) of M(t) x_tt + D(t) x_t + K(t) x = 0, the largest magnitude first.

    K is (N, n, n) at equally spaced samples of one period, s; D and M are likewise, or constant, (n, n).  With the
    signs P = diag(+-1) of a symmetry K(t + T/2) = P K(t) P, likewise of D and M, the multipliers are the squares of the
    eigenvalues of P times the matrix of half a period.
    """
    samples, size, _ = K.shape
    # the multipliers of vibrations up to this number of oscillations per period are accurate to 3e-6; the computing
    # time is proportional to it, and up to 32 degrees of freedom all that N samples can excite takes milliseconds
    resolved_oscillations = max(8, samples / 4 if size <= 32 else min(samples / 8, 64))
    steps = 2 * max(1, int(np.ceil(resolved_oscillations)))
    taken_steps = steps if mirror is None else steps // 2
    batch_size = max(1, (2**22) // (FLOQUET_STAGES * size) ** 2)  # steps whose matrices are solved at a time
    try:
        batches = [
            _step_matrices((K, D, M), np.arange(begin, min(begin + batch_size, taken_steps)), steps, period)
            for begin in range(0, taken_steps, batch_size)
        ]
        monodromy = _ordered_product(np.concatenate(batches))
        if mirror is not None:
            monodromy = np.tile(mirror, 2)[:, None] * monodromy
        values = np.linalg.eigvals(monodromy).astype(complex)
    except np.linalg.LinAlgError:
        raise NumericsError("the Floquet multipliers cannot be computed: the equation of motion is singular") from None
    values = values[np.argsort(-np.abs(values), kind="stable")]
    return values if mirror is None else values**2


def is_stable(multipliers: ComplexArray) -> bool:
    """Return whether no multiplier lies outside the unit circle by more than 1e-6.

    An instability that grows more slowly than by a factor e in 1e6 periods is not detected.
    """
    return bool(np.all(np.abs(multipliers) <= 1 + STABILITY_TOLERANCE))


def bifurcations(before: ComplexArray, after: ComplexArray, *, turned: bool) -> tuple[Bifurcation, ...]:
    """Return the bifurcations between two neighbouring points of a curve.

    An odd change of the number of multipliers beyond +1 or -1 shows that a real one has crossed, also if other
    multipliers cross at the same time or conjugates meet on the real axis.  If the curve turns between the points, a
    crossing of +1 is a fold.
    """
    plus_crossings, minus_crossings, complex_crossings = (
        abs(_outside(before, sign) - _outside(after, sign)) for sign in (1, -1, 0)
    )
    all_crossings = abs(_outside(before) - _outside(after))
    kinds: list[Bifurcation] = ["fold"] if turned else ["branch point"] if plus_crossings % 2 else []
    kinds += ["period doubling"] if minus_crossings % 2 else []
    if all_crossings - plus_crossings % 2 - minus_crossings % 2 >= 2:
        kinds.append(
            "Neimark-Sacker" if complex_crossings else "period doubling" if minus_crossings else "branch point"
        )
    return tuple(kinds)


def _outside(multipliers: ComplexArray, sign: int | None = None) -> int:
    """Return the number of multipliers outside the unit circle: all, or the positive, negative or complex (0) ones."""
    outside = multipliers[np.abs(multipliers) > 1 + STABILITY_TOLERANCE]
    signs = np.where(outside.imag == 0, np.sign(outside.real), 0)
    return int(np.sum(signs == sign)) if sign is not None else len(outside)


def _step_matrices(matrices: Sequence[Array], numbers: Index, steps: int, period: float) -> Array:
    """Return the matrices (k, 2n, 2n) of the steps with the numbers (k,), for the state (x, h x_t)."""
    phases = 2 * np.pi * (numbers[:, None] + _nodes()).ravel() / steps
    basis = basis_at(phases, (max(map(len, matrices)) - 1) // 2)
    K, D, M = (_interpolate(A, basis).reshape(len(numbers), FLOQUET_STAGES, *A.shape[-2:]) for A in matrices)
    B, size, step = _derivative_matrix(), K.shape[-1], period / steps
    A = np.empty((len(numbers), FLOQUET_STAGES, size, FLOQUET_STAGES, size))  # of the increments z
    A[:] = (B @ B)[:, None, :, None] * M[:, :, :, None, :]
    A += step * B[:, None, :, None] * D[:, :, :, None, :]
    stage = np.arange(FLOQUET_STAGES)
    A[:, stage, :, stage, :] += step**2 * K.transpose(1, 0, 2, 3)
    right = np.empty((len(numbers), FLOQUET_STAGES, size, 2, size))
    right[..., 0, :] = -(step**2) * K
    right[..., 1, :] = B.sum(axis=1)[:, None, None] * M
    rows = FLOQUET_STAGES * size
    z = np.linalg.solve(A.reshape(-1, rows, rows), right.reshape(-1, rows, 2 * size))
    z = z.reshape(-1, FLOQUET_STAGES, size, 2 * size)
    factors = np.concatenate([z[:, -1], np.einsum("j,kjab->kab", B[-1], z)], axis=1)
    factors[:, :size, :size] += np.eye(size)
    return np.asarray(factors)


def _ordered_product(factors: Array) -> Array:
    """Return the product of matrices (k, m, m), the first on the right."""
    while len(factors) > 1:
        even = len(factors) - len(factors) % 2
        factors = np.concatenate([factors[1:even:2] @ factors[:even:2], factors[even:]])
    return np.asarray(factors[0])


def _interpolate(A: Array, basis: Array) -> Array:
    """Return a periodic matrix, of samples (N, n, n) or a constant (n, n), at the phases of a Fourier basis."""
    A = A.reshape(-1, *A.shape[-2:])
    varying, harmonics = np.any(A != A[0], axis=0), (len(A) - 1) // 2
    spectrum = np.fft.rfft(A[:, varying], axis=0)[: harmonics + 1] / len(A)
    coefficients = np.empty((2 * harmonics + 1, spectrum.shape[1]))
    coefficients[0] = spectrum[0].real
    coefficients[1::2], coefficients[2::2] = 2 * spectrum[1:].real, -2 * spectrum[1:].imag
    values = np.tile(A[0], (len(basis), 1, 1))
    values[:, varying] = basis[:, : len(coefficients)] @ coefficients
    return values


def _nodes() -> Array:
    """Return the Radau points (7,) in (0, 1]."""
    return np.array(cs.collocation_points(FLOQUET_STAGES, "radau"))


@lru_cache(maxsize=1)
def _derivative_matrix() -> Array:
    """Return the matrix B (7, 7) from the values at the nodes of a polynomial that is 0 at 0 to its derivatives."""
    nodes = np.append(0.0, _nodes())
    distance = nodes[:, None] - nodes + np.eye(FLOQUET_STAGES + 1)
    weights = 1 / distance.prod(axis=1)
    B = weights / weights[:, None] / distance
    np.fill_diagonal(B, 1 - B.sum(axis=1))
    return np.asarray(B[1:, 1:])
