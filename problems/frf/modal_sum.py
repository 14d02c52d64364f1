"""Frequency response functions as a sum over modes, and its fit by variable projection.

With the undamped natural frequency omega_k and the damping ratio zeta_k of mode k, shared by all functions, each
function is

    H(omega) = (i omega)^d (sum_k (a_k + i omega b_k)/(omega_k^2 - omega^2 + 2 i zeta_k omega_k omega)
                            + sum_p c_p (i omega)^p),

with d = 0 for receptance, 1 for mobility, and 2 for accelerance and transmissibility.  The coefficients are real and
differ from function to function.  The pair a_k, b_k stands for the residue A_k of the pole s_k = -zeta_k omega_k +
i omega_k (1 - zeta_k^2)^1/2 in A_k/(i omega - s_k) + conj(A_k)/(i omega - conj(s_k)): a_k = -2 Re(A_k conj(s_k)), b_k =
2 Re A_k.  The modal constant of mode k is

    C_k = 2 i omega_k (1 - zeta_k^2)^1/2 A_k,

the product of the mass-normalised shape at output and input, phi_o phi_i (1/kg), and real, if the mode is.  The powers
p stand for the modes below the band (p = -2, -1) and above it (0, 1); further powers follow if a mode is close to it.

The coefficients enter linearly.  For given frequencies and damping ratios x, those of function o are therefore the
solution of a linear problem, with the columns Phi(x), the weights W_o and the values y_o,

    c_o(x) = argmin |W_o (Phi(x) c - y_o)|,

and the fit of all parameters at once is the fit of x with the residuals W_o (Phi(x) c_o(x) - y_o) (variable
projection).  With QR factors Q R of the weighted columns, their derivatives are (1 - Q Q') times the derivatives of the
columns times the coefficients (Kaufman), up to terms that do not change J' r.

References
----------
N. M. M. Maia, J. M. M. Silva, Theoretical and Experimental Modal Analysis, Research Studies Press (1997), Chapter 4.
G. Golub, V. Pereyra, Separable nonlinear least squares: the variable projection method and its applications, Inverse
Problems 19 (2003).
L. Kaufman, A variable projection method for solving separable nonlinear least squares problems, BIT 15 (1975).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ancf_casadi.estimation.noise.spectrum import estimated_noise
from ancf_casadi.response.linear_frf import FRF_POWERS, FrfKind
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.progress import count_step
from ancf_casadi.support.tall import inner, tall_qr, tall_times, tall_triangle
from problems.frf.window import BlockWindow

# Powers p of i omega in few, more and many residual terms.
RESIDUAL_POWERS = tuple(tuple(range(-size, size)) for size in (2, 4, 6))
LARGEST_RATIO = 0.999
LEAST_SCALE = 1e-4  # damping ratio that sets the scale of nearly undamped modes
SOLVER_TOLERANCE = 1e-9
LEAST_COLUMN = 1e-10  # least relative norm of a column beside the others


@dataclass(frozen=True, eq=False)
class ModalSum:
    """Frequency response functions as a linear model of the coefficients, at given frequencies."""

    frequencies: Array  # (k,), Hz
    derivatives: int  # the power d
    powers: tuple[int, ...]  # p of the residual terms
    reference: float  # angular frequency, rad/s, that makes the powers dimensionless
    starts: Index | None = None  # first frequency of each bin, (bins,), if means over bins are fitted
    window: BlockWindow | None = None  # of the blocks of time from which the functions were estimated

    @classmethod
    def of(
        cls, frequencies: Array, kind: FrfKind, powers: tuple[int, ...], window: BlockWindow | None = None
    ) -> ModalSum:
        """Return the model for the frequencies and the kind of a record; transmissibilities have d = 2."""
        reference = 2 * math.pi * float(np.sqrt(frequencies[0] * frequencies[-1]))
        return cls(frequencies, FRF_POWERS.get(kind, 2), powers, reference, window=window)

    @cached_property
    def bin_sizes(self) -> Array:
        """Number of frequencies in each bin; 1 without bins."""
        k = len(self.frequencies)
        return np.ones(k) if self.starts is None else np.diff(self.starts, append=k).astype(float)

    def bin_means(self, values: Any) -> Any:
        """Return the means of values over bins, times the root of the size of each; the values without bins."""
        if self.starts is None:
            return values
        return np.add.reduceat(values, self.starts) / np.sqrt(self.bin_sizes).reshape(-1, *[1] * (values.ndim - 1))

    @property
    def _iω(self) -> ComplexArray:
        """The Laplace variable, which an exponential window shifts."""
        return np.asarray((self.window.rate if self.window else 0.0) + 2j * np.pi * self.frequencies[:, None])

    def modal(self, frequencies: Array, ratios: Array) -> ComplexArray:
        """Return the columns of modes, (k, 2 m), or (bins, 2 m): those of a and b of each mode."""
        if self.window and self.window.leakage:
            (upper, lower), _ = self._smeared_resonances(frequencies, ratios)
            difference = (upper - lower) / (4j * np.pi * frequencies * np.sqrt(1 - ratios**2))
            pairs = np.stack([difference, (upper + lower) / 2 - 2 * np.pi * frequencies * ratios * difference], axis=2)
        else:
            resonance = self._resonances(frequencies, ratios)
            pairs = np.stack([resonance, self._iω * resonance], axis=2)
        return np.asarray(self.bin_means(pairs.reshape(len(pairs), -1)))

    def _resonances(self, frequencies: Array, ratios: Array) -> ComplexArray:
        """Return the resonance of each mode at all frequencies, (k, m)."""
        iω, ω_k = self._iω, 2 * np.pi * frequencies
        return np.asarray(iω**self.derivatives / (ω_k**2 + iω**2 + 2 * ratios * ω_k * iω))

    def _smeared_resonances(self, frequencies: Array, ratios: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return s_k^d R(i omega - s_k) and its derivative by s_k, (2, k, m) each: poles, and their conjugates."""
        assert self.window is not None
        poles, d = 2 * np.pi * frequencies * (-ratios + 1j * np.sqrt(1 - ratios**2)), self.derivatives
        s_k = np.array([poles, poles.conj()])[:, None]
        value, slope = self.window.resonance(self._iω - s_k)
        return s_k**d * value, d * s_k ** (d - 1) * value - s_k**d * slope

    def columns(self, frequencies: Array, ratios: Array) -> ComplexArray:
        """Return the columns of all coefficients, (k, 2 m + powers)."""
        return np.hstack([self.modal(frequencies, ratios), self._residual_terms])

    @cached_property
    def _residual_terms(self) -> ComplexArray:
        """Columns of the residual terms."""
        return np.asarray(
            self.bin_means(self._iω**self.derivatives * (self._iω / self.reference) ** np.array(self.powers))
        )

    def slopes(self, frequencies: Array, ratios: Array, coefficients: Array) -> ComplexArray:
        """Return the derivatives of the functions by frequency and damping ratio of each mode in turn, (F, k, 2 m)."""
        iω, ω_k = self._iω, 2 * np.pi * frequencies
        if self.window and self.window.leakage:
            return self._smeared_slopes(frequencies, ratios, coefficients)
        common = -2 * self._resonances(frequencies, ratios) ** 2 / iω**self.derivatives
        # shared by all functions, and therefore averaged over bins before these are formed
        powers = [self.bin_means(common * iω**power) for power in range(3)]
        a, b = (coefficient_rows.T[:, None, :] for coefficient_rows in _pairs(coefficients, len(frequencies)))
        slopes = np.empty((coefficients.shape[1], len(powers[0]), 2 * len(frequencies)), dtype=complex)
        twice = a * powers[1] + b * powers[2]
        slopes[:, :, ::2] = 2 * np.pi * (ω_k * (a * powers[0] + b * powers[1]) + ratios * twice)
        slopes[:, :, 1::2] = ω_k * twice
        return slopes

    def _smeared_slopes(self, frequencies: Array, ratios: Array, coefficients: Array) -> ComplexArray:
        """Return ``slopes`` under leakage, with A = b/2 + i (sigma b - a)/(2 omega_d) and s_k = -sigma + i omega_d."""
        (upper, lower), (upper_slope, lower_slope) = self._smeared_resonances(frequencies, ratios)
        a, b = (coefficient_rows.T for coefficient_rows in _pairs(coefficients, len(frequencies)))  # (F, m)
        ω_k, root = 2 * np.pi * frequencies, np.sqrt(1 - ratios**2)
        σ, ω_d = ω_k * ratios, ω_k * root
        imaginary = (b * σ - a) / (2 * ω_d)
        residue = (b / 2 + 1j * imaginary)[:, None]
        slopes = np.empty((len(a), len(self._residual_terms), 2 * len(frequencies)), dtype=complex)
        changes = (σ / frequencies, ω_d / frequencies), (ω_k, -ω_k * ratios / root)  # of sigma and omega_d
        for start, (change_σ, change_ω_d) in enumerate(changes):
            turned = 1j * (b * change_σ / (2 * ω_d) - imaginary * change_ω_d / ω_d)[:, None] * (upper - lower)
            change = -change_σ + 1j * change_ω_d
            moved = residue * upper_slope * change + residue.conj() * lower_slope * change.conj()
            slopes[:, :, start::2] = [self.bin_means(rows) for rows in turned + moved]
        return slopes

    def constants(self, frequencies: Array, ratios: Array, coefficients: Array) -> ComplexArray:
        """Return the modal constants C (m, F) from the coefficients (2 m + powers, F)."""
        (a, b), ζ = _pairs(coefficients, len(frequencies)), ratios[:, None]
        ω_k = 2 * np.pi * frequencies[:, None]
        return np.asarray(a - ζ * ω_k * b + 1j * ω_k * np.sqrt(1 - ζ**2) * b)


def _pairs(coefficients: Array, modes: int) -> tuple[Array, Array]:
    """Return a and b of each mode, (m, F) each, from the coefficients."""
    return coefficients[0 : 2 * modes : 2], coefficients[1 : 2 * modes : 2]


def stack_parts(values: ComplexArray) -> Array:
    """Return real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])


@dataclass(frozen=True, eq=False)
class TrialFit:
    """The linear fit of all coefficients for given frequencies and damping ratios of modes."""

    model: ModalSum
    values: ComplexArray  # measured, one column per function, (k, F)
    weights: Array  # (k, F)
    frequencies: Array  # natural frequencies, Hz, (m,)
    ratios: Array  # damping ratios, (m,)

    def with_modes(self, x: Array) -> TrialFit:
        """Return the fit with other frequencies and damping ratios, in turn (2 m,)."""
        return replace(self, frequencies=x[::2], ratios=x[1::2])

    def without(self, mode: int) -> TrialFit:
        """Return the fit without a mode, numbered from 0."""
        return replace(self, frequencies=np.delete(self.frequencies, mode), ratios=np.delete(self.ratios, mode))

    @property
    def bounded(self) -> Array:
        """Frequencies and damping ratios in turn, the latter within their bounds, (2 m,)."""
        ratios = np.clip(self.ratios, 0.1 * LEAST_SCALE, 0.99 * LARGEST_RATIO)
        return np.column_stack([self.frequencies, ratios]).ravel()

    @property
    def scales(self) -> Array:
        """Scales of frequencies and damping ratios in turn, (2 m,)."""
        ratios = np.maximum(self.ratios, LEAST_SCALE)
        return np.column_stack([self.frequencies * ratios, ratios]).ravel()

    @cached_property
    def columns(self) -> ComplexArray:
        """Columns of all coefficients (k, c)."""
        return self.model.columns(self.frequencies, self.ratios)

    @cached_property
    def factors(self) -> list[tuple[Array, Array]]:
        """QR factors of the weighted columns, (2 k, c) and (c, c), for each function."""
        columns = stack_parts(self.columns)
        return [tall_qr(np.tile(weight, 2)[:, None] * columns) for weight in self.weights.T]

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients (2 m + powers, F)."""
        weighted, coefficients = stack_parts(self.weights * self.values), []
        for function, (q, triangle) in enumerate(self.factors):
            size, y = np.linalg.norm(triangle, axis=0), weighted[:, [function]]
            coefficients.append(np.linalg.lstsq(triangle / size, inner(q, y)[:, 0])[0] / size)
        return np.column_stack(coefficients)

    @cached_property
    def fitted(self) -> ComplexArray:
        """Fitted values (k, F)."""
        return np.asarray(tall_times(self.columns, self.coefficients))

    def at(self, frequencies: Array) -> ComplexArray:
        """Return the fitted functions (k, F) at other frequencies, Hz."""
        model = replace(self.model, frequencies=frequencies, starts=None)
        return model.columns(self.frequencies, self.ratios) @ self.coefficients

    @property
    def residuals(self) -> ComplexArray:
        """Fitted less measured values (k, F)."""
        return self.fitted - self.values

    @property
    def weighted_residuals(self) -> Array:
        """Weighted residuals (2 k F,), function after function, real parts before imaginary parts."""
        return stack_parts(self.weights * self.residuals).T.ravel()

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of the weighted residuals by frequency and damping ratio of each mode in turn, (2 k F, 2 m)."""
        slopes, rows = self.model.slopes(self.frequencies, self.ratios, self.coefficients), []
        for (q, _), weight, function_slopes in zip(self.factors, self.weights.T, slopes, strict=True):
            change = stack_parts(weight[:, None] * function_slopes)
            rows.append(change - tall_times(q, inner(q, change)))
        return np.concatenate(rows)

    @cached_property
    def triangle(self) -> Array:
        """Triangle of the QR factors of the Jacobian and the weighted residuals, (2 m + 1, 2 m + 1)."""
        return tall_triangle(np.column_stack([self.jacobian, self.weighted_residuals]))

    @property
    def parameters(self) -> int:
        """Number of all parameters."""
        return 2 * len(self.frequencies) + self.coefficients.size

    @cached_property
    def leverage(self) -> Array:
        """Share of each complex value that the fit follows (k, F), the mean over real and imaginary part."""
        k, count = self.values.shape
        shares = np.column_stack([np.sum(q**2, axis=1) for q, _ in self.factors])
        shares += np.sum(self._basis**2, axis=1).reshape(count, 2 * k).T
        return np.asarray((shares[:k] + shares[k:]) / 2)

    @property
    def series(self) -> tuple[list[int], Array]:
        """Lengths of the series of weighted residuals, and their frequencies, Hz."""
        (k, count), lines = self.values.shape, self.model.frequencies
        frequencies = lines if self.model.starts is None else lines[self.model.starts]
        return [k] * (2 * count), np.tile(frequencies, 2 * count)

    @property
    def effective_samples(self) -> float:
        """Number of residuals with white noise that would determine the modes equally well."""
        k, count = self.values.shape
        noise = estimated_noise(self.weighted_residuals, self._basis, *self.series)
        factor = self.model.window.noise_factor if self.model.window else 1.0
        return float(2 * k * count / max(noise.inflation, 1.0) / factor)

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal basis of the columns of the Jacobian."""
        return tall_qr(self.jacobian)[0]


def quick_fit(start: TrialFit, tolerance: float = SOLVER_TOLERANCE) -> TrialFit | None:
    """Return the fit of all parameters from the modes of a start; None if the functions do not determine the modes."""
    bounded = start.bounded
    count_step()

    @lru_cache(maxsize=1)  # residuals and Jacobian are asked for in turn
    def fit_at(x: bytes) -> TrialFit:
        return start.with_modes(np.frombuffer(x))

    def residuals(x: Array) -> Array:
        return fit_at(x.tobytes()).triangle[:, -1]

    def jacobian(x: Array) -> Array:
        return fit_at(x.tobytes()).triangle[:, :-1]

    upper = np.tile([np.inf, LARGEST_RATIO], len(start.frequencies))
    try:
        solution = least_squares(
            residuals, bounded, jacobian, (0.0, upper),
            x_scale=start.scales, ftol=tolerance, xtol=tolerance, gtol=SOLVER_TOLERANCE,
            max_nfev=50 * len(bounded),
        )  # fmt: skip
    except (np.linalg.LinAlgError, ValueError):  # residuals that are not finite
        return None
    fit = fit_at(solution.x.tobytes())
    columns = [np.abs(np.diag(triangle)) / np.linalg.norm(triangle, axis=0) for _, triangle in fit.factors]
    return fit if np.min(columns) > LEAST_COLUMN and np.linalg.norm(fit.jacobian, axis=0).all() else None
