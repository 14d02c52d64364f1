"""Harmonic balance: the periodic motion of a second-order system as algebraic equations.

With the phase tau = omega t, a motion of n coordinates with H harmonics is

    q(tau) = c_0 + sum_k (a_k cos k tau + b_k sin k tau) = E(tau) C,    k = 1 ... H,

with the coefficients C (2 H + 1, n) in the order c_0, a_1, b_1, a_2, b_2, ...  At N > 2 H equally spaced samples, the
basis is E (N, 2 H + 1), its derivatives with respect to tau are E' = E S and E'' = E S^2 with a constant matrix S, and
W = (E^T E)^-1 E^T gives the coefficients of a sampled function.

Symmetry.  If a system and its excitation have a mirror symmetry P = diag(+-1), it may vibrate with
q(tau + pi) = P q(tau).  Coordinates with P = -1 then have odd harmonics only, the others even ones, and samples of half
a period suffice.

The motion has the velocity v = omega q' and the acceleration a = omega^2 q''.  The coefficients of the residual
(``system``) at N samples of one period,

    F(C) = W R(q, v, a - xi v, u, p) = 0,

are 2 H + 1 equations for each coordinate (alternating frequency-time method).  The term xi v is a negative damping
-xi M v, which makes a damped free vibration periodic; it is 0 in a forced motion.  The derivatives are exact,

    dF/dC     = sum_s W_s (K E_s + omega (D - xi M) E'_s + omega^2 M E''_s),
    dF/domega = W (D q' + M (2 omega q'' - xi q') + U du/domega),
    dF/dA     = W U du/dA,      dF/dxi = -W M v,      dF/dp = W dR/dp.

Error.  The residual of a motion with H harmonics and N samples is evaluated at 2 N samples.  Its harmonics beyond H
would drive the missing harmonics of the motion,

    x_k = -Z_k^-1 r_k,    Z_k = K + i k omega D - (k omega)^2 M    with the mean matrices of a period,

and those up to H, which vanish at N samples, shift the unknowns along the normal of the curve.  The missing harmonics
change the residual up to H as well, and near a resonance this shifts the unknowns by more than the missing harmonics
themselves, by a factor of about 1/zeta.  All are compared with the size of the motion.  Forces with a kink, such as
drag and friction, decide both numbers: their harmonics fall as 1/k^3 and 1/k.

References
----------
T. M. Cameron, J. H. Griffin, An alternating frequency/time domain method for calculating the steady-state response of
nonlinear dynamic systems, Journal of Applied Mechanics 56 (1989).
M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer (2019).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as cs
import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from ancf_casadi.response.harmonic_balance.system import Drive, SampledFunctions, SecondOrderSystem
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.compilation import evaluate_dense

FIRST_HARMONICS = 5
MOST_HARMONICS = 199
MOST_PERIOD_SAMPLES = 4096


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

    def symmetry_mask(self, mirror: Array) -> NDArray[np.bool_]:
        """Return which coefficients (2 H + 1, n) are not zero by symmetry; all of them for a whole period."""
        if not self.half:
            return np.ones((self.size, len(mirror)), dtype=bool)
        return np.asarray((-1.0) ** self.orders[:, None] == mirror)


fourier = lru_cache(maxsize=32)(Fourier)  # equal series share their matrices


def basis_at(phases: Array, harmonics: int) -> Array:
    """Return the basis E at any phases (k,), rad, as an array (k, 2 H + 1)."""
    angles = np.multiply.outer(phases, np.arange(1, harmonics + 1))
    pairs = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(len(phases), -1)
    return np.hstack([np.ones((len(phases), 1)), pairs])


def resize(coefficients: Array, harmonics: int) -> Array:
    """Return coefficients (2 H + 1, n) truncated to another number of harmonics, or padded with zeros."""
    result = np.zeros((2 * harmonics + 1, coefficients.shape[1]))
    common = min(len(coefficients), len(result))
    result[:common] = coefficients[:common]
    return result


@dataclass(frozen=True)
class Setting:
    """Frequency, excitation and parameter of a periodic motion."""

    omega: float  # angular frequency, rad/s
    amplitude: float  # amplitude A of the excitation
    growth: float = 0.0  # coefficient xi of the negative damping, 1/s
    value: float = math.nan  # value of the parameter of the system that varies; nan if none does


@dataclass(frozen=True, eq=False)
class BalanceDerivatives:
    """Derivatives of the equations at a motion."""

    by_coefficients: Array  # dF/dC, (c, c), for the c coefficients not zero by symmetry, in the order of C.ravel()
    by: Mapping[str, Array]  # derivatives (c,) by each field of the setting
    matrices: tuple[Array, Array, Array]  # entries of K, D and M at the samples, (N, k)


@dataclass(frozen=True, eq=False)
class HarmonicBalance:
    """The equations of harmonic balance of a system under a drive."""

    system: SecondOrderSystem
    drive: Drive
    fourier: Fourier
    varied: int | None = None  # index of the parameter of the system whose value belongs to the setting

    def parameters(self, setting: Setting) -> Array:
        """Return the parameters p of the system."""
        values = self.system.values.copy()
        if self.varied is not None:
            values[self.varied] = setting.value
        return values

    def motion(self, C: Array, setting: Setting) -> list[Array]:
        """Return q, v, a and u at the samples, (n, N) and (e, N)."""
        series, omega = self.fourier, setting.omega
        u, _, _ = self.drive.samples(series.phases, omega, setting.amplitude)
        factors = (series.basis, omega * series.slope, omega**2 * series.curvature)
        q, v, a = (np.ascontiguousarray((factor @ C).T) for factor in factors)
        return [q, v, a, u]

    def residual(self, C: Array, setting: Setting) -> Array:
        """Return F, (2 H + 1, n)."""
        return np.asarray(self.fourier.analysis @ self.sampled_residual(C, setting).T)

    def sampled_residual(self, C: Array, setting: Setting) -> Array:
        """Return R at the samples, (n, N)."""
        return evaluate_dense(self._functions.balance, *self._inputs(C, setting))[0]

    def linearise(self, C: Array, setting: Setting) -> BalanceDerivatives:
        """Return the derivatives of F."""
        series, omega, (_, v, a, _) = self.fourier, setting.omega, self.motion(C, setting)
        _, omega_excitation, shape = self.drive.samples(series.phases, omega, setting.amplitude)
        inputs = (*self._inputs(C, setting), omega_excitation, shape)
        k, d, m, omega_force, amplitude_force = evaluate_dense(self._functions.tangents, *inputs)
        damping = d - setting.growth * m
        J = self._assemble((k, omega * damping, omega**2 * m))
        omega_derivative = self._times(damping, v / omega) + self._times(m, 2 / omega * a) + omega_force
        derivatives = {"omega": omega_derivative, "amplitude": amplitude_force, "growth": -self._times(m, v)}
        by = {name: (series.analysis @ samples.T)[self.allowed] for name, samples in derivatives.items()}
        if self.varied is not None:
            by["value"] = self.by_parameters(C, setting, np.eye(len(self.system.parameters))[:, [self.varied]])[:, 0]
        return BalanceDerivatives(J, by, (k.T, d.T, m.T))

    def by_parameters(self, C: Array, setting: Setting, directions: Array) -> Array:
        """Return dF/dp times directions (l, k) in the space of the parameters, (c, k)."""
        R = _directional(self._functions.differentiable)(*self._inputs(C, setting), directions).full()
        columns = R.reshape(self.system.size, directions.shape[1], -1)
        return np.asarray(np.einsum("as,iks->aik", self.fourier.analysis, columns)[self.allowed])

    def _inputs(self, C: Array, setting: Setting) -> tuple[Array, ...]:
        q, v, a, u = self.motion(C, setting)
        return q, v, a - setting.growth * v, u, self.parameters(setting)

    def sampled_powers(self, C: Array, setting: Setting) -> tuple[Array, Array]:
        """Return the power lost to damping and the power supplied at the samples, (N,), W."""
        motion = self.motion(C, setting)
        lost, supplied = evaluate_dense(self._functions.powers, *motion, self.parameters(setting))
        return lost.ravel(), supplied.ravel()

    @cached_property
    def allowed(self) -> NDArray[np.bool_]:
        """True for each coefficient that is not zero by symmetry, (2 H + 1, n)."""
        return self.fourier.symmetry_mask(self.system.mirror)

    @property
    def _functions(self) -> SampledFunctions:
        return self.system.functions(self.fourier.count)

    def _assemble(self, blocks: tuple[Array, Array, Array]) -> Array:
        """Return dF/dC from the entries (k, N) of the factors of E, E' and E''."""
        mirror = self.system.mirror if self.fourier.half else np.ones(self.system.size)
        unknown_index = np.full(self.allowed.shape, -1)
        unknown_index[self.allowed] = np.arange(self.allowed.sum())
        J = np.zeros((self.allowed.sum(), self.allowed.sum()))
        rows, columns = self.system.entries
        for row_sign, column_sign in itertools.product(np.unique(mirror), repeat=2):
            selected = (mirror[rows] == row_sign) & (mirror[columns] == column_sign)
            if not selected.any():
                continue
            i, j = rows[selected], columns[selected]
            a, b = np.flatnonzero(self.allowed[:, i[0]]), np.flatnonzero(self.allowed[:, j[0]])
            at_row, at_column = unknown_index[np.ix_(a, i)].T, unknown_index[np.ix_(b, j)].T
            J[at_row[:, :, None], at_column[:, None, :]] = self._sums([block[selected] for block in blocks], a, b)
        return J

    def _sums(self, blocks: list[Array], a: Index, b: Index) -> Array:
        """Return the sums over the samples for entries (k, N), and rows a and columns b of coefficients, (k, a, b)."""
        series = self.fourier
        W, factors = series.analysis[a].T, [matrix[:, b] for matrix in (series.basis, series.slope, series.curvature)]
        is_varying = np.any([np.ptp(entries, axis=1) > 0.0 for entries in blocks], axis=0)
        sums = np.zeros((len(is_varying), len(a), len(b)))
        for entries, factor in zip(blocks, factors, strict=True):
            sums[~is_varying] += entries[~is_varying, :1, None] * (W.T @ factor)
        varying = [entries[is_varying] for entries in blocks]
        for k in range(len(b)):
            sums[is_varying, :, k] = sum(v * factor[:, k] for v, factor in zip(varying, factors, strict=True)) @ W
        return sums

    def _times(self, entries: Array, vectors: Array) -> Array:
        """Return the products of the matrices with entries (k, N) and the vectors (n, N) of each sample, (n, N)."""
        return np.asarray(self._row_sums @ (entries * vectors[self.system.entries[1]]))

    @cached_property
    def _row_sums(self) -> scipy.sparse.csr_array:
        """The matrix (n, k) that adds up entries of equal row."""
        rows, n = self.system.entries[0], self.system.size
        return scipy.sparse.csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(n, len(rows)))


@lru_cache(maxsize=16)
def _directional(function: cs.Function) -> cs.Function:
    """Return (q, v, a, u, p, direction) -> dR/dp times the direction, (n, N), for any number of directions."""
    symbols = [cs.MX.sym(function.name_in(k), function.size1_in(k), function.size2_in(k)) for k in range(5)]
    direction = cs.MX.sym("direction", symbols[4].numel())
    product = cs.jtimes(cs.vec(function(*symbols)), symbols[4], direction)
    return cs.Function("directional", [*symbols, direction], [cs.reshape(cs.densify(product), *symbols[0].shape)])


@dataclass(frozen=True)
class Errors:
    """Estimated errors of a motion, relative to its size."""

    harmonics: float  # size of the missing harmonics, and of the error of the others that is due to them
    samples: float  # error of the coefficients due to the sampling

    @property
    def largest(self) -> float:
        """The larger of both."""
        return max(self.harmonics, self.samples)


def motion_size(balance: HarmonicBalance, C: Array) -> float:
    """Return the size of the motion about its mean, relative to the scale of the system."""
    return float((np.abs(C[1:]) / balance.system.scale).max())


def estimate_errors(
    balance: HarmonicBalance,
    C: Array,
    setting: Setting,
    matrices: tuple[Array, Array, Array],
    size: float,
    shift: Callable[[Array], Array],
) -> Errors:
    """Return the estimated errors of a motion relative to its size, from the entries of K, D and M at the samples."""
    series, system = balance.fourier, balance.system
    # highest harmonic of the residual that is checked
    harmonics = min(3 * series.harmonics, series.samples - 1)
    finer_balance = replace(balance, fourier=fourier(series.harmonics, 2 * series.samples, series.half))
    fine_series = fourier(harmonics, 2 * series.samples, series.half)
    r = np.where(
        fine_series.symmetry_mask(system.mirror),
        fine_series.analysis @ finer_balance.sampled_residual(C, setting).T,
        0.0,
    )
    K, D, M = (system.matrix(entries.mean(axis=0)) for entries in matrices)
    if series.half:
        K, D, M = (matrix * (system.mirror[:, None] == system.mirror) for matrix in (K, D, M))
    D = D - setting.growth * M
    k = setting.omega * np.arange(series.harmonics + 1, harmonics + 1)
    missing_residuals = r[series.size :: 2] - 1j * r[series.size + 1 :: 2]
    Z = K + 1j * k[:, None, None] * D - k[:, None, None] ** 2 * M
    x = np.linalg.solve(Z, missing_residuals[:, :, None])[:, :, 0]
    extended_coefficients = resize(C, harmonics)
    extended_coefficients[series.size :: 2], extended_coefficients[series.size + 1 :: 2] = -x.real, x.imag
    R = replace(balance, fourier=fine_series).sampled_residual(extended_coefficients, setting).T
    feedback, sampling = (fine_series.analysis @ R - r)[: series.size], r[: series.size] - balance.residual(C, setting)

    def largest_change(change: Array) -> float:
        return float((change / system.scale).max(initial=0.0)) / size

    feedback_shift, sampling_shift = (np.abs(shift(residual)) for residual in (feedback, sampling))
    return Errors(max(largest_change(np.abs(x)), largest_change(feedback_shift)), largest_change(sampling_shift))


def initial_samples(harmonics: int) -> int:
    """Return the initial number of samples, 4 (H + 1)."""
    return 4 * (harmonics + 1)
